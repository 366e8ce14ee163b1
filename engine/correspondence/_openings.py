"""Cavities that both surfaces open to: cut away, their rims correspond like the loops of holes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.correspondence._cavities import find_cavities, find_linings
from engine.correspondence._completed import completed_visibility
from engine.correspondence._cutting import Part, part_without
from engine.correspondence._fitting import Target
from engine.correspondence._ridges import sharpness, up_to_ridge
from engine.correspondence._spreading import Spreading
from engine.correspondence._static import AROUND, Nearby, rests_beside, static_share
from engine.operators import face_areas, face_normals, interior_edges
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_LEAST_AREA = 0.012  # of the source's: rims of smaller cavities (nostrils) are too uncertain
_CLOSING = 0.7  # of an opening's area: what is left of it when lids close
_OPEN = 0.1  # openness of a rim, jagged as it is, from which on its lips do not touch
_SHARP = 0.5  # sharpness from which on a rim is a lid's edge
_GAP = 0.15  # between openings that correspond, in square roots of the source's area


@dataclass(frozen=True, slots=True)
class Outsides:
    """Both surfaces without the cavities that correspond.

    ``cavities`` counts those cut from the source and from the target; ``edges`` (k,) are the
    source part's vertices on edges of lids that close, ``fitted`` (l,) those of its vertices that
    say where the others go: not those behind lips and lids where only the target goes on.
    """

    source: Part
    target: Part
    cavities: tuple[int, int]
    edges: BoolArray
    fitted: IntArray


Side = tuple[Mesh, Sequence[IntArray], FloatArray]  # mesh, its loops, ambient visibility (m,)


def cut_cavities(source: Side, target: Side) -> Outsides:
    """Cut the cavities that have an opening, a cavity or a hole, in their place on the other side.

    Both meshes are aligned, in square roots of the source's area. Where lids close the source is
    cut at their edge, since this is what the target's rim is then.
    """
    sides = (source, target)
    least = _LEAST_AREA * float(face_areas(source[0]).sum())
    found = [_large_cavities(source[0], source[2], least)]
    seen = completed_visibility(source[0], target[0], target[2]) if found[0] else target[2]
    found.append(_large_cavities(target[0], seen, least))
    centres = [
        np.array([_rim_centre(mesh, cavity) for cavity in cavities]).reshape(-1, 3)
        for (mesh, _, _), cavities in zip(sides, found, strict=True)
    ]
    holes = [_hole_centres(mesh, loops) for mesh, loops, _ in sides]
    edges = _cut_at_lids(source[0], found[0], target[0], found[1], centres)
    parts: list[Part] = []
    counts: list[int] = []
    for k, (mesh, loops, _) in enumerate(sides):
        others = np.concatenate([centres[1 - k], holes[1 - k]])
        gap = np.linalg.norm(centres[k][:, None] - others[None], axis=2)
        cut = np.flatnonzero(gap.min(axis=1, initial=np.inf) < _GAP)
        gone = np.zeros(len(mesh.faces), dtype=np.bool_)
        for index in cut:
            gone |= found[k][index]
        parts.append(part_without(mesh, gone, tuple(loops)))
        counts.append(len(cut))
    fitted = np.arange(len(parts[0].vertex))
    if counts[1] and not counts[0]:
        fitted = _in_front(source, target[0])
    return Outsides(parts[0], parts[1], (counts[0], counts[1]), edges[parts[0].vertex], fitted)


def _in_front(source: Side, target: Mesh) -> IntArray:
    """The vertices of a ``source`` that do not lie behind the edges of its holes.

    A patch of a face is open at its back, so what the target has there is put in the light's way.
    """
    mesh, loops, visibility = source
    seen = completed_visibility(target, mesh, visibility)
    lining = find_linings(mesh, loops[1:], seen)
    behind = np.zeros(len(mesh.vertices), dtype=np.bool_)
    behind[mesh.faces[lining]] = True
    behind[mesh.faces[~lining]] = False
    return np.flatnonzero(~behind)


def _large_cavities(mesh: Mesh, visibility: FloatArray, least: float) -> list[BoolArray]:
    areas = face_areas(mesh)
    return [cavity for cavity in find_cavities(mesh, visibility) if areas[cavity].sum() >= least]


def _cut_at_lids(
    source: Mesh,
    cavities: list[BoolArray],
    target: Mesh,
    others: list[BoolArray],
    centres: Sequence[FloatArray],
) -> BoolArray:
    """The vertices (n,) of ``source`` on edges of lids that close.

    Their ``cavities``, which have ``centres``, are replaced by ones that reach up to these edges.
    """
    edges = np.zeros(len(source.vertices), dtype=np.bool_)
    gap = np.linalg.norm(centres[0][:, None] - centres[1][None], axis=2)
    near = [(k, int(row.argmin())) for k, row in enumerate(gap) if row.min(initial=np.inf) < _GAP]
    narrowed = [k for k, j in near if _narrowed(source, cavities[k], target, others[j])]
    if not narrowed:
        return edges
    static, sharp = _static(source, target), sharpness(source)
    for k in narrowed:
        if _rests(source, cavities[k], static):
            cavities[k] = up_to_ridge(source, cavities[k], sharp)
            edges[source.faces[cavities[k]]] = True
    return edges & (sharp > _SHARP)


def _static(source: Mesh, target: Mesh) -> FloatArray:
    return static_share(Nearby.of(source, Target(target)), Spreading.over(source, AROUND))


def _narrowed(source: Mesh, cavity: BoolArray, target: Mesh, other: BoolArray) -> bool:
    """Whether the opening of a ``cavity`` is open, and that of the ``other`` clearly smaller."""
    opening, length = _opening(source, cavity), _rim_length(source, cavity)
    open_ = 4 * np.pi * opening > _OPEN * length**2
    return open_ and _opening(target, other) < _CLOSING * opening


def _opening(mesh: Mesh, cavity: BoolArray) -> float:
    """The area that a cavity's rim surrounds: by Stokes that of its faces' sum of area vectors."""
    areas = face_areas(mesh)[cavity, None] * face_normals(mesh)[cavity]
    return float(np.linalg.norm(areas.sum(axis=0)))


def _rests(mesh: Mesh, cavity: BoolArray, static: FloatArray) -> bool:
    """Whether the skin around a cavity rests: lids close while it does, lips do not."""
    rim = _rim(mesh, cavity).ravel()
    outside = np.ones(len(mesh.vertices), dtype=np.bool_)
    outside[mesh.faces[cavity]] = False
    outside[rim] = True
    return rests_beside(mesh.vertices[outside], mesh.vertices[rim], static[outside])


def _rim(mesh: Mesh, cavity: BoolArray) -> IntArray:
    """The ends (e, 2) of the edges between a cavity and what is around it."""
    ends, pairs = interior_edges(mesh.faces)
    return ends[cavity[pairs[:, 0]] != cavity[pairs[:, 1]]]


def _rim_length(mesh: Mesh, cavity: BoolArray) -> float:
    ends = mesh.vertices[_rim(mesh, cavity)]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())


def _rim_centre(mesh: Mesh, cavity: BoolArray) -> FloatArray:
    rim = _rim(mesh, cavity)
    return mesh.vertices[rim if len(rim) else mesh.faces[cavity]].mean(axis=(0, 1))


def _hole_centres(mesh: Mesh, loops: Sequence[IntArray]) -> FloatArray:
    """Mean vertices (k, 3) of the loops but for the outer one."""
    return np.array([mesh.vertices[loop].mean(axis=0) for loop in loops[1:]]).reshape(-1, 3)
