"""What lies between a disk that ends at edges and the curve on which a surface is opened."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from engine.errors import TopologyError
from engine.topology._cut import Cut
from engine.topology._handles import euler_characteristic
from engine.topology._loops import boundary_loops
from engine.types import BoolArray, DiskSurface, FloatArray, IntArray, Mesh, Opening


def collar(vertices: FloatArray, patch: IntArray, disk: DiskSurface, cut: Cut) -> Opening:
    """The part of the faces ``patch`` (k, 3) outside of the ball of ``cut``, seen from ``disk``."""
    points, faces = _clipped(vertices, patch, cut)
    count = len(vertices)
    number = np.full(count + len(points), -1)
    number[disk.vertex] = np.arange(len(disk.vertex))
    extra = np.unique(faces[number[faces] < 0])
    number[extra] = len(disk.vertex) + np.arange(len(extra))
    faces = number[faces]
    every = np.concatenate([disk.mesh.faces, faces])
    boundary = _one_loop(every, len(disk.vertex) + len(extra))
    points = np.concatenate([vertices, points])[extra]
    if boundary is None or boundary.min() < number[count:].min(initial=len(every)):
        points, faces, boundary = points[:0], faces[:0], disk.boundary
    return Opening(points, faces, boundary, cut.centre, cut.bearing)


def with_collar(disk: DiskSurface) -> DiskSurface:
    """An opened disk and what there is of the surface up to the curve on which it was opened."""
    opening = disk.opening
    if opening is None or not len(opening.faces):
        return disk
    own = len(disk.face)
    faces = [disk.mesh.faces[:own], opening.faces, disk.mesh.faces[own:]]
    mesh = Mesh(np.concatenate([disk.mesh.vertices, opening.vertices]), np.concatenate(faces))
    vertex = np.concatenate([disk.vertex, np.full(len(opening.vertices), -1)])
    face = np.concatenate([disk.face, np.full(len(opening.faces), -1)])
    return replace(disk, mesh=mesh, boundary=opening.boundary, vertex=vertex, face=face)


def _one_loop(faces: IntArray, vertex_count: int) -> IntArray | None:
    try:
        loops = boundary_loops(faces, vertex_count)
    except TopologyError:
        return None
    return loops[0] if len(loops) == 1 and euler_characteristic(faces) == 1 else None


def _clipped(vertices: FloatArray, faces: IntArray, cut: Cut) -> tuple[FloatArray, IntArray]:
    """The faces (k, 3) outside of the ball, over ``vertices`` and points (c, 3) on the sphere."""
    inside = np.linalg.norm(vertices - cut.pole, axis=1) < cut.radius
    within = inside[faces].sum(axis=1)
    one, two = faces[within == 1], faces[within == 2]
    a, b, c = _first(one, inside[one]).T
    d, e, f = _first(two, ~inside[two]).T
    crossing = np.concatenate([a, c, d, f]), np.concatenate([b, a, e, d])
    low, high = np.minimum(*crossing), np.maximum(*crossing)
    keys, number = np.unique(low * len(vertices) + high, return_inverse=True)
    points = _on_sphere(vertices, keys // len(vertices), keys % len(vertices), cut)
    p, q, r, s = np.split(len(vertices) + number, np.cumsum([len(a), len(a), len(d)]))
    parts = [faces[within == 0]]
    parts += [np.stack(part, axis=1) for part in ((p, b, c), (p, c, q), (d, r, s))]
    return points, np.concatenate(parts)


def _first(faces: IntArray, odd: BoolArray) -> IntArray:
    """Faces (k, 3) turned so that the ``odd`` corner of each comes first."""
    at = np.argmax(odd, axis=1)[:, None]
    return np.take_along_axis(faces, (at + np.arange(3)) % 3, axis=1)


def _on_sphere(vertices: FloatArray, a: IntArray, b: IntArray, cut: Cut) -> FloatArray:
    """Where the edges from a to b cross the sphere."""
    start, way = vertices[a] - cut.pole, vertices[b] - vertices[a]
    square, half = (way**2).sum(axis=1), (start * way).sum(axis=1)
    excess = (start**2).sum(axis=1) - cut.radius**2
    root = np.sqrt(np.maximum(half**2 - square * excess, 0.0))
    at = np.where(excess > 0, -half - root, -half + root) / square
    return cut.pole + start + at[:, None] * way
