"""Cavities that both surfaces open to: cut away, their rims correspond like the loops of holes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.correspondence._cavities import find_cavities
from engine.correspondence._cutting import Part, part_without
from engine.operators import face_areas, interior_edges
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_LEAST_AREA = 0.012  # of the source's: rims of smaller cavities (nostrils) are too uncertain
_GAP = 0.15  # between openings that correspond, in square roots of the source's area


@dataclass(frozen=True, slots=True)
class Outsides:
    """Both surfaces without the cavities that correspond.

    ``cavities`` counts those cut from the source and from the target.
    """

    source: Part
    target: Part
    cavities: tuple[int, int]


Side = tuple[Mesh, Sequence[IntArray], FloatArray]  # mesh, its loops, ambient visibility (m,)


def cut_cavities(source: Side, target: Side) -> Outsides:
    """Cut the cavities that have an opening, a cavity or a hole, in their place on the other side.

    Both meshes are aligned, in square roots of the source's area.
    """
    sides = (source, target)
    area = float(face_areas(source[0]).sum())
    found = [_large_cavities(mesh, seen, _LEAST_AREA * area) for mesh, _, seen in sides]
    centres = [
        np.array([_rim_centre(mesh, cavity) for cavity in cavities]).reshape(-1, 3)
        for (mesh, _, _), cavities in zip(sides, found, strict=True)
    ]
    holes = [_hole_centres(mesh, loops) for mesh, loops, _ in sides]
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
    return Outsides(parts[0], parts[1], (counts[0], counts[1]))


def _large_cavities(mesh: Mesh, visibility: FloatArray, least: float) -> list[BoolArray]:
    areas = face_areas(mesh)
    return [cavity for cavity in find_cavities(mesh, visibility) if areas[cavity].sum() >= least]


def _rim_centre(mesh: Mesh, cavity: BoolArray) -> FloatArray:
    ends, pairs = interior_edges(mesh.faces)
    rim = ends[cavity[pairs[:, 0]] != cavity[pairs[:, 1]]]
    return mesh.vertices[rim if len(rim) else mesh.faces[cavity]].mean(axis=(0, 1))


def _hole_centres(mesh: Mesh, loops: Sequence[IntArray]) -> FloatArray:
    """Mean vertices (k, 3) of the loops but for the outer one."""
    return np.array([mesh.vertices[loop].mean(axis=0) for loop in loops[1:]]).reshape(-1, 3)
