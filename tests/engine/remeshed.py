"""Faces on other triangulations, with other labels, in other poses."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from engine.decimation import decimate
from engine.io import read_mesh
from engine.topology import boundary_loops
from engine.types import FloatArray, IntArray, Mesh, Similarity, Surface
from tests.faces import ICT_NEUTRAL


def surface_of(mesh: Mesh) -> Surface:
    """The mesh itself as a surface, its longest loop first."""
    loops = boundary_loops(mesh.faces, len(mesh.vertices))
    lengths = [-np.linalg.norm(np.diff(mesh.vertices[x], axis=0), axis=1).sum() for x in loops]
    ordered = tuple(loops[k] for k in np.argsort(lengths))
    return Surface(mesh, np.arange(len(mesh.vertices)), np.arange(len(mesh.faces)), ordered)


def face(path: Path = ICT_NEUTRAL) -> Mesh:
    return read_mesh(path).mesh


def coarser(mesh: Mesh, count: int) -> tuple[Mesh, IntArray]:
    """About ``count`` of the mesh's own vertices, triangulated, and which they are."""
    kept, faces = decimate(mesh, boundary_loops(mesh.faces, len(mesh.vertices)), count)
    return Mesh(mesh.vertices[kept], faces), kept


def subdivided(mesh: Mesh) -> Mesh:
    """Every face in four, without moving anything."""
    ends = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    pairs, middle = np.unique(ends, axis=0, return_inverse=True)
    ab, bc, ca = (middle.reshape(-1, 3) + len(mesh.vertices)).T
    a, b, c = mesh.faces.T
    vertices = np.concatenate([mesh.vertices, mesh.vertices[pairs].mean(axis=1)])
    faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1)
    return Mesh(vertices, faces.reshape(-1, 3))


def closed(mesh: Mesh) -> Mesh:
    """With triangles from the middle of the longest boundary loop to its edges."""
    loop = boundary_loops(mesh.faces, len(mesh.vertices))[0]
    vertices = np.concatenate([mesh.vertices, mesh.vertices[loop].mean(axis=0)[None]])
    fan = np.stack([np.roll(loop, -1), loop, np.full(len(loop), len(mesh.vertices))], axis=1)
    return Mesh(vertices, np.concatenate([mesh.faces, fan]))


def relabelled(mesh: Mesh, seed: int = 7) -> tuple[Mesh, IntArray]:
    """The same surface with shuffled vertices and faces; old vertex v is called number[v]."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(mesh.vertices))
    number = np.argsort(order)
    faces = number[mesh.faces][rng.permutation(len(mesh.faces))]
    return Mesh(mesh.vertices[order], faces), number


def motion(degrees: float, shift: FloatArray, scale: float = 1.0) -> Similarity:
    axis = np.array([1.0, 2.0, -0.5])
    vector = np.deg2rad(degrees) * axis / np.linalg.norm(axis)
    return Similarity(Rotation.from_rotvec(vector).as_matrix(), shift, scale)


def part_of(mesh: Mesh, keep: FloatArray) -> Mesh:
    """The faces all of whose vertices are kept, over these vertices."""
    faces = mesh.faces[keep[mesh.faces].all(axis=1)]
    used, flat = np.unique(faces, return_inverse=True)
    return Mesh(mesh.vertices[used], flat.reshape(-1, 3))
