"""How far the skin that a target stands for lies off its faces, flat ones or rough ones.

The displaced source went through the target's vertices, bent as it is itself: between them it is
nearer to that skin than flat faces are, and than what these can be rounded to; and it is smooth
where noise is not.
"""

from __future__ import annotations

import numpy as np

from engine.correspondence._fitting import Target
from engine.correspondence._rounded import angle_normals
from engine.correspondence._unfolding import turned_faces
from engine.types import BoolArray, FloatArray, Mesh, SurfacePoints

_HIDDEN = 0.2  # of an edge's length: how far its middle may lie off the skin


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
    ``most`` (n,) along its normals, and the one that was given, from which they do. Only for what
    ``lies`` (n,) on the target, and where no face is turned over by it.
    """
    mesh, given = targets[0].mesh, targets[1]
    normal = points.on(mesh.moved(angle_normals(mesh)))
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    fitted = points.on(mesh)
    height = np.clip(np.einsum("ni,ni->n", deformed - fitted, normal), -most, most)
    up = fitted + height[:, None] * normal - points.on(given.mesh)
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


def hidden_by_edges(points: SurfacePoints, mesh: Mesh) -> FloatArray:
    """How far (n,) the skin may lie off a ``mesh`` at ``points``.

    That is as far over the middle of every edge as it can hide, over its ends not at all, and over
    a face what its edges hide together.
    """
    corner, weight = mesh.vertices[mesh.faces[points.face]], points.barycentric
    lengths = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2)
    return 4 * _HIDDEN * np.einsum("ni,ni,ni->n", weight, np.roll(weight, -1, axis=1), lengths)
