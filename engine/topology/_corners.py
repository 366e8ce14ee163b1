"""Vertices where several fans of faces meet: which fans are one sheet, which only touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.topology._component_kernels import lowest_in_component
from engine.topology._halfedges import origins, targets
from engine.topology._loop_kernels import fans_of_corners
from engine.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class SeparateCorners:
    """Faces over vertices of their own, numbered without gaps.

    ``source`` gives the former vertex of each, ``vertex_of`` (n,) the new vertex of each former
    one (-1: unused; where it was divided that of the sheet with most faces, then of the sheet that
    reaches the first place). Vertices from ``extra`` on are the
    further copies of divided ones; the others keep their order.
    """

    faces: IntArray
    source: IntArray
    vertex_of: IntArray
    extra: int


def separate_corners(
    vertices: FloatArray, faces: IntArray, twin: IntArray, loops: list[IntArray]
) -> SeparateCorners:
    """Give each sheet at a vertex its own vertex.

    Fans of faces around a vertex are one sheet if boundary loops lead from one to the next: then
    closing the holes closes the ring around the vertex. Otherwise they only touch there.
    """
    fan, fan_count = fans_of_corners(twin)
    arriving = np.concatenate([_arriving(fan, loop) for loop in loops]) if loops else fan[:0]
    leaving = np.concatenate([fan[loop] for loop in loops]) if loops else fan[:0]
    sheet = lowest_in_component(fan_count, arriving, leaving)[fan]
    size_of = np.bincount(sheet, minlength=fan_count)
    first_of = np.zeros(fan_count, dtype=np.int64)
    first_of[sheet[::-1]] = np.arange(len(sheet))[::-1]
    label = np.flatnonzero(size_of)
    first, size = first_of[label], size_of[label]
    vertex = origins(faces)[first]
    reach = _first_neighbours(vertices, faces, sheet, vertex)[label]
    order = np.lexsort((first, *reach.T, -size, vertex))
    leads = np.ones(len(order), dtype=np.bool_)
    leads[1:] = vertex[order[1:]] != vertex[order[:-1]]
    numbered = np.concatenate([order[leads], order[~leads]])
    number = np.empty(fan_count, dtype=np.int64)
    number[label[numbered]] = np.arange(len(label))
    vertex_of = np.full(len(vertices), -1, dtype=np.int64)
    vertex_of[vertex[order[leads]]] = np.arange(int(leads.sum()))
    return SeparateCorners(
        number[sheet].reshape(faces.shape), vertex[numbered], vertex_of, int(leads.sum())
    )


def _first_neighbours(
    vertices: FloatArray, faces: IntArray, sheet: IntArray, vertex_of_sheet: IntArray
) -> FloatArray:
    """For each sheet at a divided vertex the first by position of the corners that follow there."""
    divided = np.bincount(vertex_of_sheet, minlength=len(vertices)) > 1
    corner = np.flatnonzero(divided[origins(faces)])
    place = vertices[targets(faces)[corner]]
    order = np.lexsort((*place.T, sheet[corner]))[::-1]
    first = np.zeros((len(sheet), 3))
    first[sheet[corner[order]]] = place[order]
    return first


def _arriving(fan: IntArray, loop: IntArray) -> IntArray:
    """The fan that each half-edge of a loop arrives in, aligned with where the next one leaves."""
    end = loop - loop % 3 + (loop % 3 + 1) % 3
    return np.roll(fan[end], 1)
