"""Connected parts of a file, and which of them are solid and belong together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from engine.topology import lowest_in_component, position_classes
from engine.types import BoolArray, FloatArray, IntArray, Mesh

SOLID = 0.1
"""Isoperimetric quotient (1 for a ball) from which a part is solid; sheets are near 0."""

TOUCHING = 0.25
"""Gap, as a share of the smaller one's radius, up to which two solids touch."""

SIDEWAYS = 0.6
"""Cosine between the way to a neighbour and the long axis, below which it stands beside, as teeth
of one row do; teeth of the other row stand end to end with them."""

CONCENTRIC = 0.15
"""Distance of centres, as a share of the smaller radius, up to which one lies within the other."""

_SLENDER = 1.5  # longest over second axis from which a solid has a long axis
_FLAT = 2.0  # second over third axis up to which it is no arch, as whole rows of teeth are


@dataclass(frozen=True, slots=True)
class Body:
    """One connected part of a file.

    ``vertices`` (k,) and their ``points`` (k, 3); ``radius`` is root mean square; ``axis`` (3,)
    the direction in which it is long, if it is.
    """

    vertices: IntArray
    points: FloatArray
    centre: FloatArray
    radius: float
    axis: FloatArray | None
    solid: bool


def bodies(mesh: Mesh, riding: BoolArray) -> list[Body]:
    """The parts of ``mesh`` made of ``riding`` (n,) vertices that hang together.

    They do by faces or exact places, so that seams take nothing apart.
    """
    sides = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    sides = sides[riding[sides].all(axis=1)]
    own = np.flatnonzero(riding)
    place = own[position_classes(mesh.vertices[own])]
    a, b = np.concatenate([sides[:, 0], own]), np.concatenate([sides[:, 1], place])
    part = lowest_in_component(len(riding), a, b)
    order = own[np.argsort(part[own], kind="stable")]
    groups = np.split(order, np.flatnonzero(np.diff(part[order])) + 1) if len(order) else []
    inside = mesh.faces[riding[mesh.faces].all(axis=1)]
    inside = inside[np.argsort(part[inside[:, 0]], kind="stable")]
    of_face = part[inside[:, 0]]
    first, last = (
        np.searchsorted(of_face, [part[group[0]] for group in groups], side)
        for side in ("left", "right")
    )
    return [
        _body(mesh, group, inside[a:b]) for group, a, b in zip(groups, first, last, strict=True)
    ]


def _body(mesh: Mesh, vertices: IntArray, faces: IntArray) -> Body:
    points = mesh.vertices[vertices]
    centre = points.mean(axis=0)
    offset = points - centre
    radius = float(np.sqrt((offset**2).sum(axis=1).mean()))
    lengths, axes = np.linalg.eigh(offset.T @ offset)
    slender = lengths[2] > _SLENDER**2 * lengths[1] and lengths[1] < _FLAT**2 * lengths[0]
    corner = mesh.vertices[faces] - centre
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = float(np.linalg.norm(cross, axis=1).sum()) / 2
    volume = float(np.einsum("fi,fi->", corner[:, 0], cross)) / 6
    solid = area > 0 and 36 * np.pi * volume**2 >= SOLID * area**3
    return Body(vertices, points, centre, radius, axes[:, 2] if slender else None, solid)


def rigid_groups(parts: list[Body]) -> IntArray:
    """The group (p,) of each part that moves rigidly; -1 for soft ones.

    Solids are rigid, and so is what lies in the middle of a solid (an iris in its eyeball).
    Solids that stand side by side, as the teeth of a jaw, are one group; so are concentric ones.
    """
    if not parts:
        return np.zeros(0, dtype=np.int64)
    centre = np.array([part.centre for part in parts])
    radius = np.array([part.radius for part in parts])
    solids = np.flatnonzero([part.solid for part in parts])
    around = KDTree(centre)
    pairs = [
        (int(i), j)
        for i in solids
        for j in around.query_ball_point(centre[i], 2 * (radius[i] + radius[solids].max()))
        if i != j and (_concentric(parts[i], parts[j]) or _beside(parts[i], parts[j]))
    ]
    joined = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    rigid = np.zeros(len(parts), dtype=np.bool_)
    rigid[solids] = True
    rigid[joined[:, 1]] = True
    lowest = lowest_in_component(len(parts), joined[:, 0], joined[:, 1])
    group = np.full(len(parts), -1, dtype=np.int64)
    group[rigid] = np.unique(lowest[rigid], return_inverse=True)[1]
    return group


def _concentric(solid: Body, part: Body) -> bool:
    apart = float(np.linalg.norm(part.centre - solid.centre))
    return apart < CONCENTRIC * min(part.radius, solid.radius)


def _beside(one: Body, other: Body) -> bool:
    if not other.solid or one.axis is None or other.axis is None:
        return False
    way = other.centre - one.centre
    apart = float(np.linalg.norm(way))
    if apart > 2 * (one.radius + other.radius):
        return False
    along = max(abs(float(way @ one.axis)), abs(float(way @ other.axis)))
    if along > SIDEWAYS * apart:
        return False
    gap = float(np.min(KDTree(one.points).query(other.points)[0]))
    return gap <= TOUCHING * min(one.radius, other.radius)
