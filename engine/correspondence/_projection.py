"""From a deformed source to points of the target's surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression

from engine.correspondence._fitting import Target
from engine.correspondence._loops import LoopPair
from engine.nearest import Feet
from engine.operators import vertex_normals
from engine.types import BoolArray, FloatArray, IntArray, Mesh, SurfacePoints

_NORMALS, _NOISY_NORMALS = 0.05, 0.02  # weights of normals when feet are sought
_GAP = 0.1  # of the mean one: the least gap between a loop's vertices
_STAYS = 1e6  # weight of the vertex that a loop's order begins with
_SLIDE = 0.1  # of the loop's length: how far a loop vertex may leave its parameter


@dataclass(frozen=True, slots=True)
class Freedom:
    """Where the image of each source vertex may be moved.

    ``kind`` (n,): 0 anywhere inside the target, k > 0 along ``rims``[k - 1], a loop of the
    target's vertices, -1 nowhere.
    """

    kind: IntArray
    rims: tuple[IntArray, ...]


@dataclass(frozen=True, slots=True)
class Projection:
    """Where each source vertex landed: ``points``, the ``feet`` they came from.

    ``cosine`` (n,) between the normals of the deformed source and of the target; ``freedom`` of
    the points: loops put vertices on rims, landmarks where they stay; ``beyond`` (n,) tells
    vertices that landed on the target's border, where nothing says that they belong.
    """

    points: SurfacePoints
    feet: Feet
    cosine: FloatArray
    freedom: Freedom
    beyond: BoolArray


def project(
    deformed: Mesh,
    target: Target,
    loops: Sequence[LoopPair],
    landmarks: tuple[SurfacePoints, SurfacePoints] | None,
    source: Mesh,
    *,
    noisy: bool = False,
) -> Projection:
    """Closest points with compatible normals; loops onto their loops; landmarks exactly.

    A foot on the rim of a loop that has a counterpart is a small overshoot: the target ends there
    because the source does. Of a ``noisy`` target normals say less.
    """
    normals = vertex_normals(deformed)
    weight = _NOISY_NORMALS if noisy else _NORMALS
    feet = target.index(weight).feet(deformed.vertices, normals)
    face, barycentric = feet.face.copy(), feet.barycentric.copy()
    kind = np.zeros(len(face), dtype=np.int64)
    ours = np.zeros(len(target.mesh.vertices), dtype=np.bool_)
    for k, pair in enumerate(loops, start=1):
        on_loop = loop_points(pair, deformed.vertices[pair.vertices], target.mesh)
        face[pair.vertices] = on_loop.face
        barycentric[pair.vertices] = on_loop.barycentric
        kind[pair.vertices] = k
        ours[pair.goal] = True
    if landmarks is not None:
        given, meant = landmarks
        corner = given.barycentric.argmax(axis=1)
        exact = given.barycentric.max(axis=1) > 1 - 1e-9
        vertex = source.faces[given.face, corner][exact]
        face[vertex], barycentric[vertex] = meant.face[exact], meant.barycentric[exact]
        kind[vertex] = -1
    cosine = np.einsum("ni,ni->n", normals, feet.normal)
    nearest = target.mesh.faces[feet.face, feet.barycentric.argmax(axis=1)]
    return Projection(
        SurfacePoints(face, barycentric),
        feet,
        cosine,
        Freedom(kind, tuple(pair.goal for pair in loops)),
        feet.on_border & (kind == 0) & ~ours[nearest],
    )


def loop_points(pair: LoopPair, positions: FloatArray, mesh: Mesh) -> SurfacePoints:
    """The points of the target's loop that the loop at ``positions`` (k, 3) belongs to."""
    curve = pair.curve
    if pair.parameters is None:
        t = curve.project(positions)
    else:
        gap = positions - curve.at(pair.parameters)
        along = np.einsum("ki,ki->k", gap, curve.tangent(pair.parameters))
        limit = _SLIDE * curve.length
        t = in_order(pair.parameters, np.clip(along, -limit, limit), curve.length)
    segment, part = curve.segment(t)
    a, b = pair.goal[segment], np.roll(pair.goal, -1)[segment]
    face, corner = _border_faces(mesh, a, b)
    barycentric = np.zeros((len(t), 3))
    barycentric[np.arange(len(t)), corner] = 1 - part
    barycentric[np.arange(len(t)), (corner + 1) % 3] = part
    return SurfacePoints(face, barycentric)


def in_order(parameters: FloatArray, slides: FloatArray, length: float) -> FloatArray:
    """``parameters`` (k,) moved by ``slides`` (k,), or nearly: none comes to lie before another.

    Least squares with a least gap, from the vertex on that slides least.
    """
    first, count = int(np.abs(slides).argmin()), len(slides)
    fixed, moves = np.roll(parameters, -first), np.roll(slides, -first)
    turns = np.cumsum(np.diff(fixed, prepend=fixed[0]) < -length / 2)
    around = fixed + length * turns + moves
    even = _GAP * length / count * np.arange(count + 1)
    weights = np.ones(count + 1)
    weights[[0, -1]] = _STAYS
    closed = np.append(around, around[0] + length)
    ordered = isotonic_regression(closed - even, weights=weights).x + even
    return np.roll(ordered[:-1], first)


def _border_faces(mesh: Mesh, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The face with the directed edge from a to b, and its corner at a."""
    n = len(mesh.vertices)
    on = np.zeros(n, dtype=np.bool_)
    on[a] = on[b] = True
    beside = np.flatnonzero(on[mesh.faces].sum(axis=1) > 1)
    faces = mesh.faces[beside]
    keys = (faces * n + np.roll(faces, -1, axis=1)).ravel()
    order = np.argsort(keys)
    place = order[np.searchsorted(keys[order], a * n + b)]
    return beside[place // 3], place % 3
