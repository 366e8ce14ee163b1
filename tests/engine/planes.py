"""Plane meshes to map, and the planes of the bundled faces."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import Delaunay

from engine.io import read_mesh
from engine.parameterization import align_disk, disk_map
from engine.topology import disk_surface, editable_surface
from engine.types import ComplexArray, IntArray
from tests.engine.shapes import grid_faces
from tests.faces import DATA


def square(side: int, *, shake: float = 0.0) -> tuple[ComplexArray, IntArray]:
    """A grid on [-1, 1]², its inner vertices moved by up to ``shake`` cells; seeded."""
    y, x = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side), indexing="ij")
    random = np.random.default_rng(7)
    jitter = random.uniform(-1, 1, (2, side, side)) * 2 * shake / (side - 1)
    jitter[:, [0, -1]] = jitter[:, :, [0, -1]] = 0
    return ((x + jitter[0]) + 1j * (y + jitter[1])).ravel(), grid_faces(side, side)


def square_boundary(side: int) -> IntArray:
    at = np.arange(side * side).reshape(side, side)
    return np.concatenate([at[0, :-1], at[:-1, -1], at[-1, :0:-1], at[:0:-1, 0]])


def random_disk(count: int, rim: int, seed: int) -> tuple[ComplexArray, IntArray]:
    """Delaunay triangles of ``rim`` points around the unit circle, first, and ``count`` inside."""
    random = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(rim) + random.uniform(-0.3, 0.3, rim)) / rim
    inside = 0.95 * np.sqrt(random.uniform(size=count))
    inside = inside * np.exp(2j * np.pi * random.uniform(size=count))
    z = np.concatenate([np.exp(1j * angle), inside])
    faces = Delaunay(np.stack([z.real, z.imag], axis=1)).simplices.astype(np.int64)
    a, b, c = z[faces].T
    turned = ((b - a).conj() * (c - a)).imag < 0
    faces[turned] = faces[turned][:, ::-1]
    return z, faces


@dataclass(frozen=True)
class FacePlane:
    """The neutral face's plane ``z``, and where an expression's own plane has the same points."""

    z: ComplexArray
    faces: IntArray
    boundary: IntArray
    expressed: ComplexArray
    surface_of: IntArray


def face_plane(neutral: Path, expression: Path) -> FacePlane:
    rest, other = read_mesh(neutral).mesh, read_mesh(expression).mesh
    surface, _ = editable_surface(rest)
    disk = disk_surface(surface)
    file_vertex = np.empty(len(surface.mesh.vertices), np.int64)
    on_surface = np.flatnonzero(surface.vertex_of >= 0)
    file_vertex[surface.vertex_of[on_surface]] = on_surface
    moved = replace(disk, mesh=disk.mesh.moved(other.vertices[file_vertex[disk.vertex]]))
    z, other_z = disk_map(disk).z, disk_map(moved).z
    expressed = align_disk(other_z, z, np.ones(len(z)))(other_z)
    expressed[disk.boundary] /= np.abs(expressed[disk.boundary])
    return FacePlane(z, disk.mesh.faces, disk.boundary, expressed, surface.vertex_of)


def face_landmarks() -> IntArray:
    """File vertices of the 68 Multi-PIE landmarks that the ICT face patch has."""
    named = json.loads((DATA / "ict_face" / "landmarks.json").read_text())["multi_pie_68"]
    return np.array(named)
