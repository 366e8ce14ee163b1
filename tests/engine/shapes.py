"""Small surfaces with known topology."""

import numpy as np

from engine.types import IntArray, Mesh


def grid_faces(rows: int, columns: int, wrap: tuple[bool, bool] = (False, False)) -> IntArray:
    """Two triangles per cell of a grid of vertices, row by row, wound counter-clockwise."""
    r, c = np.meshgrid(
        np.arange(rows - (not wrap[0])), np.arange(columns - (not wrap[1])), indexing="ij"
    )
    a, b = r * columns + c, r * columns + (c + 1) % columns
    d, e = (r + 1) % rows * columns + c, (r + 1) % rows * columns + (c + 1) % columns
    return np.stack([a, b, e, a, e, d], axis=-1).reshape(-1, 3)


def sheet(rows: int = 9, columns: int = 11) -> Mesh:
    y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    z = 0.3 * np.sin(x) * np.cos(y)
    return Mesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), grid_faces(rows, columns))


def torus(rows: int = 12, columns: int = 8) -> Mesh:
    u, v = np.meshgrid(
        np.arange(rows) * 2 * np.pi / rows, np.arange(columns) * 2 * np.pi / columns, indexing="ij"
    )
    ring = 3 + np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), np.sin(v)], axis=-1)
    return Mesh(vertices.reshape(-1, 3), grid_faces(rows, columns, (True, True)))


def moebius_strip(columns: int = 20) -> Mesh:
    angle = np.arange(columns) * 2 * np.pi / columns
    across = np.array([-1.0, 0.0, 1.0])[:, None]
    radius = 4 + across * np.cos(angle / 2)
    height = across * np.sin(angle / 2)
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    faces = grid_faces(3, columns + 1)
    row, column = np.divmod(faces, columns + 1)
    around = column == columns
    row, column = np.where(around, 2 - row, row), np.where(around, 0, column)
    return Mesh(vertices.reshape(-1, 3), row * columns + column)


def sphere(subdivisions: int = 3) -> Mesh:
    """An octahedron, subdivided; faces outward."""
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array(
        [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    )
    for _ in range(subdivisions):
        ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, middle = np.unique(ends, axis=0, return_inverse=True)
        ab, bc, ca = (middle.reshape(-1, 3) + len(vertices)).T
        a, b, c = faces.T
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    return Mesh(vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces)


def soup(mesh: Mesh) -> Mesh:
    """Every triangle with three vertices of its own."""
    return Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(mesh.faces.size).reshape(-1, 3))


def together(*meshes: Mesh) -> Mesh:
    """Several meshes in one file, one after the other."""
    offsets = np.cumsum([0, *(len(m.vertices) for m in meshes)])[:-1]
    faces = [m.faces + offset for m, offset in zip(meshes, offsets, strict=True)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(faces))


def without_faces(mesh: Mesh, faces: IntArray) -> Mesh:
    return Mesh(mesh.vertices, np.delete(mesh.faces, faces, axis=0))
