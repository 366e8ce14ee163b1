"""From a deformed source to points of the target's surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.correspondence._fitting import Target
from engine.correspondence._loops import LoopPair
from engine.nearest import Feet
from engine.operators import vertex_normals
from engine.types import BoolArray, FloatArray, Mesh, SurfacePoints

_SLIDE = 0.02  # of the loop's length: how far a loop vertex may leave its parameter


@dataclass(frozen=True, slots=True)
class Projection:
    """Where each source vertex landed: ``points``, the ``feet`` they came from.

    ``cosine`` (n,) between the normals of the deformed source and of the target; ``settled`` (n,)
    tells vertices placed by a loop or a landmark, for which a border is where they belong.
    """

    points: SurfacePoints
    feet: Feet
    cosine: FloatArray
    settled: BoolArray

    @property
    def beyond(self) -> BoolArray:
        """(n,) vertices that landed on the target's border, where they do not belong."""
        return self.feet.on_border & ~self.settled


def project(
    deformed: Mesh,
    target: Target,
    loops: Sequence[LoopPair],
    landmarks: tuple[SurfacePoints, SurfacePoints] | None,
    source: Mesh,
) -> Projection:
    """Closest points with compatible normals; loops onto their loops; landmarks exactly."""
    normals = vertex_normals(deformed)
    feet = target.index(0.05).feet(deformed.vertices, normals)
    face, barycentric = feet.face.copy(), feet.barycentric.copy()
    settled = np.zeros(len(face), dtype=np.bool_)
    for pair in loops:
        on_loop = loop_points(pair, deformed.vertices[pair.vertices], target.mesh)
        face[pair.vertices] = on_loop.face
        barycentric[pair.vertices] = on_loop.barycentric
        settled[pair.vertices] = True
    if landmarks is not None:
        ours, theirs = landmarks
        corner = ours.barycentric.argmax(axis=1)
        exact = ours.barycentric.max(axis=1) > 1 - 1e-9
        vertex = source.faces[ours.face, corner][exact]
        face[vertex], barycentric[vertex] = theirs.face[exact], theirs.barycentric[exact]
        settled[vertex] = True
    cosine = np.einsum("ni,ni->n", normals, feet.normal)
    return Projection(SurfacePoints(face, barycentric), feet, cosine, settled)


def loop_points(pair: LoopPair, positions: FloatArray, mesh: Mesh) -> SurfacePoints:
    """The points of the target's loop that the loop at ``positions`` (k, 3) belongs to."""
    curve = pair.curve
    if pair.parameters is None:
        t = curve.project(positions)
    else:
        gap = positions - curve.at(pair.parameters)
        along = np.einsum("ki,ki->k", gap, curve.tangent(pair.parameters))
        limit = _SLIDE * curve.length
        t = pair.parameters + np.clip(along, -limit, limit)
    segment, part = curve.segment(t)
    a, b = pair.goal[segment], np.roll(pair.goal, -1)[segment]
    face, corner = _border_faces(mesh, a, b)
    barycentric = np.zeros((len(t), 3))
    barycentric[np.arange(len(t)), corner] = 1 - part
    barycentric[np.arange(len(t)), (corner + 1) % 3] = part
    return SurfacePoints(face, barycentric)


def _border_faces(mesh: Mesh, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The face with the directed edge from a to b, and its corner at a."""
    n = len(mesh.vertices)
    keys = (mesh.faces * n + np.roll(mesh.faces, -1, axis=1)).ravel()
    order = np.argsort(keys)
    place = order[np.searchsorted(keys[order], a * n + b)]
    return place // 3, place % 3
