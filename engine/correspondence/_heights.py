"""How far the skin that a target stands for lies off its faces, flat ones or rough ones.

The displaced source went by the target's vertices, bent as it is itself: between them it is nearer
to that skin than flat faces are, and than what these can be rounded to; and it is smooth where
noise is not. Where it passed over them or under, though, it only did not come as near as it should.
"""

from __future__ import annotations

import numpy as np

from engine.correspondence._fitting import Target
from engine.correspondence._rounded import angle_normals
from engine.correspondence._unfolding import turned_faces
from engine.nearest import NormalAwareIndex
from engine.operators import Rings, face_normals
from engine.types import BoolArray, FloatArray, Mesh, SurfacePoints

_HIDDEN = 0.2  # of an edge's length: how far its middle may lie off the skin
_NORMALS, _AGREE = 0.1, 0.5  # what a normal weighs in finding feet, least cosine of matching ones
_ROUNDS = 3  # of neighbours over whose vertices what they tell is averaged


def heights(
    source: Mesh,
    deformed: FloatArray,
    points: SurfacePoints,
    targets: tuple[Target, Target],
    lies: BoolArray,
    most: FloatArray,
) -> FloatArray:
    """From the ``points`` of the source's vertices the ways (n, 3) up to the ``deformed`` (n, 3).

    The ``targets`` have the same faces: the surface that was fitted, above which they lead, at
    ``most`` (n,) along its normals, and the one that was given, from which they do. What the
    ``deformed`` passed over the corners of a face is taken off, and where they lie beside the
    points rather than over them, less of the way is gone. Only for what ``lies`` (n,) on the
    target, and where no face is turned over by it.
    """
    mesh, given = targets[0].mesh, targets[1]
    normals = angle_normals(mesh)
    normal = points.on(mesh.moved(normals))
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    fitted = points.on(mesh)
    gap = deformed - fitted
    passed = _passed(source.moved(deformed), mesh, normals, smoothed=mesh is not given.mesh)
    below = np.einsum("nc,nc->n", points.barycentric, passed[mesh.faces[points.face]])
    way = gap - below[:, None] * normal
    height = np.abs(np.einsum("ni,ni->n", way, normal))
    share = np.minimum(most / np.maximum(height, 1e-300), 1)
    share *= 1 - np.minimum(_aside(gap, mesh, points) / np.maximum(most, 1e-300), 1) ** 2
    up = fitted + share[:, None] * way - points.on(given.mesh)
    up[~lies] = 0.0
    before = turned_faces(source, points, given)
    turned = np.flatnonzero(turned_faces(source, points, given, up) & ~before)
    while len(turned):
        flat = np.zeros(len(up), dtype=np.bool_)
        flat[source.faces[turned]] = True
        up[flat] = 0.0
        beside = np.flatnonzero(flat[source.faces].any(axis=1) & ~before)
        kept, corners = np.unique(source.faces[beside], return_inverse=True)
        part = Mesh(source.vertices[kept], corners.reshape(-1, 3))
        there = SurfacePoints(points.face[kept], points.barycentric[kept])
        turned = beside[turned_faces(part, there, given, up[kept])]
    return up


def _aside(gap: FloatArray, mesh: Mesh, points: SurfacePoints) -> FloatArray:
    """How far (n,) a ``gap`` (n, 3) leads along the faces it starts from, not away from them."""
    normal = face_normals(mesh)[points.face]
    away = np.einsum("ni,ni->n", gap, normal)
    aside: FloatArray = np.linalg.norm(gap - away[:, None] * normal, axis=1)
    return aside


def _passed(source: Mesh, mesh: Mesh, normals: FloatArray, *, smoothed: bool) -> FloatArray:
    """How far (n,) a displaced ``source`` passes over the vertices of ``mesh``, noise left aside.

    Noise is what neighbours do not share: a vertex counts by the share of the variance around it
    that its neighbours tell (a local Wiener filter), the rest is their mean; all of it where the
    mesh was ``smoothed``, since noise is shared then.
    """
    feet = NormalAwareIndex(source, _NORMALS).feet(mesh.vertices, normals)
    over = np.einsum("ni,ni->n", feet.position - mesh.vertices, normals)
    known = (np.einsum("ni,ni->n", feet.normal, normals) > _AGREE) & ~feet.on_border
    told = np.stack([known, known * over], axis=1)
    rings = Rings.of(mesh.faces, len(over))
    count, total = (rings.sums(told) - told).T
    beside = known * total / np.maximum(count, 1.0)
    told = np.column_stack([told, over * beside, np.where(count > 0, told[:, 1] ** 2, 0.0)])
    count, total, shared, squares = rings.sums(told, _ROUNDS).T
    mean = total / np.maximum(count, 1.0)
    if smoothed:
        return mean
    share = known * np.clip(shared / np.maximum(squares, 1e-300), 0, 1)
    return share * over + (1 - share) * mean


def hidden_by_edges(points: SurfacePoints, mesh: Mesh) -> FloatArray:
    """How far (n,) the skin may lie off a ``mesh`` at ``points``.

    That is as far over the middle of every edge as it can hide, over its ends not at all, and over
    a face what its edges hide together.
    """
    corner, weight = mesh.vertices[mesh.faces[points.face]], points.barycentric
    lengths = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2)
    return 4 * _HIDDEN * np.einsum("ni,ni,ni->n", weight, np.roll(weight, -1, axis=1), lengths)
