"""What guides each part of a file that is not on the edited surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from engine.operators import edges
from engine.passengers._bodies import bodies, rigid_groups
from engine.passengers._soft import Soft, bind
from engine.types import FloatArray, IntArray, Mesh, Surface

REACH = 0.02
"""Width of the Gaussian weights in surface diagonals, on top of the body's distance."""

REACH_OF_SIZE = 0.3
"""The same as a share of the body's own root mean square radius, if that is more."""

SUPPORT = 2048
"""At most so many skin vertices guide one body."""

NEXT_TO = 0.01
"""Width in surface diagonals of the skin that says which bone a body is on."""

AROUND = 0.06
"""The same of the skin in which the jaw's motion is looked for."""


@dataclass(frozen=True, slots=True)
class Bones:
    """Skin vertices ``sample`` (k,) that show what skull and jaw do.

    ``weight`` (k,) are their areas, ``near`` (k,) from 0 to 1 how near the rigid bodies they are.
    """

    sample: IntArray
    weight: FloatArray
    near: FloatArray


@dataclass(frozen=True, slots=True)
class Passengers:
    """How every file vertex goes with the surface.

    ``vertices`` (n, 3) of the file, ``vertex_of`` (n,) its surface vertices; ``body`` (n,) numbers
    the rigid bodies, -1 elsewhere. Body b is guided by the surface vertices
    ``support[start[b] : start[b + 1]]`` with ``weight``; ``closeness`` weighs those right next to
    it. ``bones`` show what skull and jaw do; sheets are ``soft``. ``loose`` vertices belong to no
    face and move like the surface vertices ``beside``. ``edges`` (e, 2) show the skin's stretch.
    """

    vertices: FloatArray
    vertex_of: IntArray
    body: IntArray
    support: IntArray
    weight: FloatArray
    closeness: FloatArray
    start: IntArray
    bones: Bones
    soft: Soft | None
    loose: IntArray
    beside: IntArray
    edges: IntArray


def attach(mesh: Mesh, surface: Surface, *, rigid: bool = False) -> Passengers:
    """Find the parts of ``mesh`` that are not on ``surface`` and what guides each.

    ``rigid``: sheets do not bend either.
    """
    off = surface.vertex_of < 0
    used = np.zeros(len(off), dtype=np.bool_)
    used[mesh.faces] = True
    parts = bodies(mesh, off & used)
    group = rigid_groups(parts)
    if rigid:
        group[group < 0] = group.max(initial=-1) + 1 + np.arange(np.count_nonzero(group < 0))
    body = np.full(len(off), -1, dtype=np.int64)
    for part, number in zip(parts, group, strict=True):
        body[part.vertices] = number
    skin = KDTree(surface.mesh.vertices)
    area = _vertex_areas(surface.mesh)
    diagonal = float(np.linalg.norm(np.ptp(surface.mesh.vertices, axis=0)))
    guides = [
        _guides(mesh.vertices[body == number], surface.mesh, skin, area)
        for number in range(int(group.max(initial=-1)) + 1)
    ]
    loose = np.flatnonzero(off & ~used)
    return Passengers(
        vertices=mesh.vertices,
        vertex_of=surface.vertex_of,
        body=body,
        support=np.concatenate([surface.face_of[:0], *(near for near, _, _ in guides)]),
        weight=np.concatenate([area[:0], *(weight for _, weight, _ in guides)]),
        closeness=np.concatenate([area[:0], *(close for _, _, close in guides)]),
        start=np.cumsum([0, *(len(near) for near, _, _ in guides)]),
        bones=_bones(mesh.vertices[body >= 0], surface.mesh, area, diagonal),
        soft=bind(mesh, off & used & (body < 0), body, skin, diagonal),
        loose=loose,
        beside=np.asarray(skin.query(mesh.vertices[loose])[1], dtype=np.int64),
        edges=edges(surface.mesh.faces),
    )


def _guides(
    points: FloatArray, surface: Mesh, skin: KDTree, area: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """The surface vertices near a body, their areas weighted down with distance, and steeply so."""
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
    beyond = distance[every] - gap
    weight = area[near[every]] * np.exp(-0.5 * (beyond / reach) ** 2)
    close = area[near[every]] * np.exp(-0.5 * (beyond / (NEXT_TO * diagonal)) ** 2)
    return near[every], weight / weight.sum(), close


def _bones(points: FloatArray, surface: Mesh, area: FloatArray, diagonal: float) -> Bones:
    every = slice(None, None, -(-len(area) // SUPPORT))
    sample = np.arange(len(area))[every]
    if not len(points):
        return Bones(sample[:0], area[:0], area[:0])
    distance = np.asarray(KDTree(points).query(surface.vertices[sample])[0], dtype=np.float64)
    return Bones(sample, area[sample], np.exp(-0.5 * (distance / (AROUND * diagonal)) ** 2))


def _vertex_areas(mesh: Mesh) -> FloatArray:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    sums = np.bincount(mesh.faces.reshape(-1), np.repeat(area, 3), len(mesh.vertices))
    return np.maximum(sums.astype(np.float64), np.finfo(np.float64).tiny)
