"""What is in the file but not on the edited surface: eyeballs, teeth, tongue, lashes, debris.

Each connected body rides rigidly on the skin near it. Soft skin is a poor guide to the bone
beneath: lids close over an eye that stays, lips part from teeth that stay. So the fit of the
motion is robust, and skin that stretches counts little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from engine.topology import lowest_in_component, position_classes
from engine.types import BoolArray, FloatArray, IntArray, Mesh, Surface

REACH = 0.02
"""Width of the Gaussian weights in surface diagonals, on top of the body's distance."""

REACH_OF_SIZE = 0.3
"""The same as a share of the body's own root mean square radius, if that is more."""

SUPPORT = 512
"""At most so many skin vertices guide one body."""

SOFT_STRETCH = 0.1
"""Relative change of length at which skin counts half."""

ROUNDS = 10

FIRMNESS = 1e-12
"""Relative resistance to turns: decides only where the skin points leave a turn open."""


@dataclass(frozen=True, slots=True)
class Passengers:
    """How every file vertex goes with the surface.

    ``vertices`` (n, 3) of the file, ``vertex_of`` (n,) its surface vertices; ``body`` (n,) numbers
    the rigid bodies, -1 elsewhere. Body b is guided by the surface vertices
    ``support[start[b] : start[b + 1]]`` with ``weight``. ``loose`` vertices belong to no face and
    move like the surface vertices ``beside``. ``edges`` (e, 2) of the surface show its stretch.
    """

    vertices: FloatArray
    vertex_of: IntArray
    body: IntArray
    support: IntArray
    weight: FloatArray
    start: IntArray
    loose: IntArray
    beside: IntArray
    edges: IntArray


def attach(mesh: Mesh, surface: Surface) -> Passengers:
    """Find the bodies of ``mesh`` that are not on ``surface`` and the skin that guides each."""
    off = surface.vertex_of < 0
    used = np.zeros(len(off), dtype=np.bool_)
    used[mesh.faces] = True
    body = _bodies(mesh, off & used)
    loose = np.flatnonzero(off & ~used)
    skin = KDTree(surface.mesh.vertices)
    area = _vertex_areas(surface.mesh)
    members = np.argsort(body, kind="stable")[np.count_nonzero(body < 0) :]
    groups = np.split(members, np.flatnonzero(np.diff(body[members])) + 1) if len(members) else []
    guides = [_guides(mesh.vertices[group], surface.mesh, skin, area) for group in groups]
    return Passengers(
        vertices=mesh.vertices,
        vertex_of=surface.vertex_of,
        body=body,
        support=np.concatenate([surface.face_of[:0], *(near for near, _ in guides)]),
        weight=np.concatenate([area[:0], *(weight for _, weight in guides)]),
        start=np.cumsum([0, *(len(near) for near, _ in guides)]),
        loose=loose,
        beside=np.asarray(skin.query(mesh.vertices[loose])[1], dtype=np.int64),
        edges=_edges(surface.mesh.faces),
    )


def carry(passengers: Passengers, before: FloatArray, after: FloatArray) -> FloatArray:
    """New positions (n, 3) of all file vertices when the surface moves ``before`` -> ``after``.

    Vertices on the surface take its new positions, bodies move by a rotation and a translation
    each, loose vertices by their neighbour's displacement. Whatever rides on skin that did not
    move keeps its coordinates bit for bit. Continuous in ``after``.
    """
    moved = (before != after).any(axis=1)
    result = passengers.vertices.copy()
    on = np.flatnonzero(passengers.vertex_of >= 0)
    on = on[moved[passengers.vertex_of[on]]]
    result[on] = after[passengers.vertex_of[on]]
    drawn = moved[passengers.beside]
    loose, beside = passengers.loose[drawn], passengers.beside[drawn]
    result[loose] += after[beside] - before[beside]
    if len(passengers.start) > 1 and moved.any():
        _carry_bodies(passengers, before, after, result)
    return result


def _carry_bodies(p: Passengers, before: FloatArray, after: FloatArray, result: FloatArray) -> None:
    moved = (before != after).any(axis=1)
    weight = p.weight / (1 + (_stretch(p.edges, before, after) / SOFT_STRETCH) ** 2)[p.support]
    rotation, old, new = _robust_motions(before[p.support], after[p.support], weight, p.start[:-1])
    drawn = np.add.reduceat(moved[p.support].astype(np.int64), p.start[:-1]) > 0
    riders = np.flatnonzero(p.body >= 0)
    riders = riders[drawn[p.body[riders]]]
    b = p.body[riders]
    offset = p.vertices[riders] - old[b]
    result[riders] = np.einsum("vij,vj->vi", rotation[b], offset) + new[b]


def _robust_motions(
    old: FloatArray, new: FloatArray, weight: FloatArray, start: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rotations (b, 3, 3) and centroids before and after, by reweighting (Geman and McClure).

    The points of body i begin at ``start[i]``. The scale of the residuals that count is their own
    weighted root mean square, so nothing depends on units and everything on ``new`` smoothly.
    """
    owner = np.repeat(np.arange(len(start)), np.diff(start, append=len(old)))
    robust = weight
    for _ in range(ROUNDS):
        rotation, centre_old, centre_new = _motions(old, new, robust, start, owner)
        turned = np.einsum("pij,pj->pi", rotation[owner], old - centre_old[owner])
        square = ((turned + centre_new[owner] - new) ** 2).sum(axis=1)
        total = np.add.reduceat(robust, start)
        scale = np.add.reduceat(robust * square, start) / total
        spread = np.where(scale > 0, scale, 1)[owner]
        robust = weight / (1 + square / spread) ** 2
    return _motions(old, new, robust, start, owner)


def _motions(
    old: FloatArray, new: FloatArray, weight: FloatArray, start: IntArray, owner: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weighted Procrustes fits (Kabsch 1976); turns that the points leave open are not made."""
    total = np.add.reduceat(weight, start)[:, None]
    centre_old = np.add.reduceat(weight[:, None] * old, start) / total
    centre_new = np.add.reduceat(weight[:, None] * new, start) / total
    x, y = old - centre_old[owner], new - centre_new[owner]
    products = (weight[:, None] * y)[:, :, None] * x[:, None, :]
    covariance = np.add.reduceat(products, start)
    size = np.add.reduceat(weight * (x**2).sum(axis=1), start)
    covariance += FIRMNESS * np.where(size > 0, size, 1)[:, None, None] * np.eye(3)
    u, _, vt = np.linalg.svd(covariance)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return u @ vt, centre_old, centre_new


def _bodies(mesh: Mesh, riding: BoolArray) -> IntArray:
    """Number the parts that hang together by faces or exact places; -1 for other vertices."""
    sides = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    sides = sides[riding[sides].all(axis=1)]
    own = np.flatnonzero(riding)
    place = own[position_classes(mesh.vertices[own])]
    a, b = np.concatenate([sides[:, 0], own]), np.concatenate([sides[:, 1], place])
    part = lowest_in_component(len(riding), a, b)
    body = np.full(len(riding), -1, dtype=np.int64)
    body[own] = np.unique(part[own], return_inverse=True)[1]
    return body


def _guides(
    points: FloatArray, surface: Mesh, skin: KDTree, area: FloatArray
) -> tuple[IntArray, FloatArray]:
    """The surface vertices near a body, and their areas weighted down with distance."""
    centre = points.mean(axis=0)
    radius = float(np.sqrt(((points - centre) ** 2).sum(axis=1).mean()))
    diagonal = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    reach = max(REACH * diagonal, REACH_OF_SIZE * radius)
    gap = float(np.min(skin.query(points)[0]))
    outermost = float(np.sqrt(((points - centre) ** 2).sum(axis=1).max()))
    inside = skin.query_ball_point(centre, outermost + gap + 3 * reach, return_sorted=True)
    near = np.asarray(inside, dtype=np.int64)
    distance = np.asarray(KDTree(points).query(surface.vertices[near])[0], dtype=np.float64)
    close = distance <= gap + 3 * reach
    near, distance = near[close], distance[close]
    every = slice(None, None, -(-len(near) // SUPPORT))
    weight = area[near[every]] * np.exp(-0.5 * ((distance[every] - gap) / reach) ** 2)
    return near[every], weight / weight.sum()


def _vertex_areas(mesh: Mesh) -> FloatArray:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    sums = np.bincount(mesh.faces.reshape(-1), np.repeat(area, 3), len(mesh.vertices))
    return np.maximum(sums.astype(np.float64), np.finfo(np.float64).tiny)


def _edges(faces: IntArray) -> IntArray:
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(sides, axis=0)


def _stretch(edges: IntArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Per surface vertex, the root mean square relative change of length of its edges."""
    old = np.linalg.norm(before[edges[:, 0]] - before[edges[:, 1]], axis=1)
    new = np.linalg.norm(after[edges[:, 0]] - after[edges[:, 1]], axis=1)
    ends = edges.reshape(-1)
    change = np.bincount(ends, np.repeat((new - old) ** 2, 2), len(before))
    length = np.bincount(ends, np.repeat(old**2, 2), len(before))
    return np.sqrt(change / np.where(length > 0, length, 1))
