"""Disks as bad as files make them: slivers, ears, pinholes, holes that touch, random triangles."""

import numpy as np
from scipy.spatial import Delaunay

from engine.topology import boundary_loops
from engine.types import Mesh


def rim_of(mesh: Mesh) -> np.ndarray:
    return max(boundary_loops(mesh.faces, len(mesh.vertices)), key=len)


def with_slivers(mesh: Mesh, count: int, degrees: float) -> Mesh:
    """Some faces flattened until the angles at their longest side measure ``degrees``."""
    random, vertices = np.random.default_rng(3), mesh.vertices.copy()
    for a, b, c in random.permutation(mesh.faces)[:count]:
        foot, side = (vertices[b] + vertices[c]) / 2, np.linalg.norm(vertices[b] - vertices[c])
        height = vertices[a] - foot
        height *= np.tan(np.radians(degrees)) * side / 2 / np.linalg.norm(height)
        vertices[a] = foot + height
    return mesh.moved(vertices)


def with_ears(mesh: Mesh, sides: int) -> Mesh:
    """Strips of one to three triangles that hang on every ``sides``-th boundary edge."""
    vertices, faces, rim = list(mesh.vertices), list(mesh.faces), rim_of(mesh)
    for at, (a, b) in enumerate(zip(rim[:-1:sides], rim[1::sides], strict=False)):
        last = b
        for step in range(1 + at % 3):
            vertices.append(1.3**step * (vertices[a] + vertices[b]) / 2 + [0, 0, 0.1 * step])
            faces.append(np.array([a, len(vertices) - 1, last]))
            last = len(vertices) - 1
    return Mesh(np.array(vertices), np.array(faces))


def with_whisker(mesh: Mesh, face: int, rings: int) -> Mesh:
    """A face drawn out into a thin closed tube of so many rings of three vertices."""
    ring, faces = mesh.faces[face], list(np.delete(mesh.faces, face, axis=0))
    corners = mesh.vertices[ring]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    step = normal / np.sqrt(np.linalg.norm(normal))
    vertices, turned = [mesh.vertices], corners
    for number in range(1, rings + 1):
        turned = (turned + np.roll(turned, -1, axis=0)) / 2 + step
        turned = turned.mean(axis=0) + 2 * (turned - turned.mean(axis=0))
        inner = np.arange(3) + len(mesh.vertices) + 3 * (number - 1)
        for a, b, c, d in zip(ring, np.roll(ring, -1), inner, np.roll(inner, -1), strict=True):
            faces += [np.array((a, b, c)), np.array((b, d, c))]
        vertices.append(turned)
        ring = inner
    return Mesh(np.concatenate(vertices), np.array([*faces, ring]))


def with_pinholes(mesh: Mesh, count: int) -> Mesh:
    gone = np.random.default_rng(5).permutation(len(mesh.faces))[:count]
    return Mesh(mesh.vertices, np.delete(mesh.faces, gone, axis=0))


def with_touching_holes(mesh: Mesh, count: int) -> Mesh:
    """Pairs of one-face holes that share a vertex, and holes that share one with the rim."""
    on_rim = np.isin(mesh.faces, rim_of(mesh)).sum(axis=1)
    random = np.random.default_rng(6)
    gone = random.permutation(np.flatnonzero(on_rim == 1))[:count].tolist()
    for face in random.permutation(np.flatnonzero(on_rim == 0))[:count]:
        shared = np.isin(mesh.faces, mesh.faces[face]).sum(axis=1)
        beside = np.flatnonzero((shared == 1) & (on_rim == 0))
        gone += [face, *beside[:1]]
    return Mesh(mesh.vertices, np.delete(mesh.faces, np.unique(gone), axis=0))


def random_disk(seed: int) -> Mesh:
    """A Delaunay triangulation of random points, of any height, with vertices collapsed onto
    sides or each other, and faces missing."""
    random = np.random.default_rng(seed)
    points = random.normal(size=(random.integers(4, 150), 2))
    if random.random() < 0.3:
        points = np.unique(np.round(3 * points) / 3, axis=0)
    corner = points[faces := Delaunay(points).simplices.astype(np.int64)]
    ahead, back = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = ahead[:, 0] * back[:, 1] - ahead[:, 1] * back[:, 0]
    faces = np.where(area[:, None] < 0, faces[:, ::-1], faces)[area != 0]
    rough = 10.0 ** random.uniform(-4, 1) * random.normal(size=len(points))
    vertices = np.concatenate([points, rough[:, None]], axis=1)
    for a, b, c in random.permutation(faces)[: random.integers(0, 8)]:
        share, off = random.choice([0.0, 0.5]), 10.0 ** random.uniform(-14, -3)
        vertices[a] += (1 - off) * (share * vertices[b] + (1 - share) * vertices[c] - vertices[a])
    gone = random.permutation(len(faces))[: random.integers(0, 1 + len(faces) // 6)]
    return Mesh(vertices, np.delete(faces, gone, axis=0))
