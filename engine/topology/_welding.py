"""Vertices that lie at exactly the same place: which they are, and which to join."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engine.topology import _welding_kernels as kernels
from engine.topology._component_kernels import lowest_in_component
from engine.topology._halfedges import EqualRuns, edge_runs, origins, targets
from engine.types import FloatArray, IntArray


def position_classes(vertices: FloatArray) -> IntArray:
    """For each vertex the lowest vertex with exactly the same coordinates (n,).

    Takes any rows (n, c) of numbers; one with NaN is like no other.
    """
    rows = np.ascontiguousarray(vertices)
    alone = np.logical_or.reduce([np.isnan(column) for column in rows.T])
    first = np.empty(len(rows), dtype=np.int64)
    kernels.first_rows(rows.view(np.int64), alone, _table(len(rows)), first)
    return first


def face_kinds(faces: IntArray, position: IntArray) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """What each face is over the places ``position`` (n,), and the first that it is like, (m,).

    PROPER, DEGENERATE, REPEATED (the vertices of one before it) or COINCIDENT (others, in the
    places of one before it).
    """
    kinds, like = np.empty(len(faces), dtype=np.uint8), np.empty(len(faces), dtype=np.int32)
    kernels.classify_faces(faces, position, _table(len(faces)), kinds, like)
    return kinds, like


def _table(count: int) -> NDArray[np.int32]:
    """An empty hash table of half as many entries as slots, or fewer."""
    return np.full(1 << (2 * count).bit_length(), -1, dtype=np.int32)


def stitch(faces: IntArray, position: IntArray) -> IntArray:
    """Join vertices along boundary edges that coincide; the lowest of those joined, (n,).

    Both ends of the edges must agree in ``position``. So seams and triangle soup close, while
    sheets that merely touch at a point, or whose interiors coincide, stay apart.
    """
    if (position == np.arange(len(position))).all():
        return position
    runs = edge_runs(faces)
    rim = runs.order[runs.start[runs.size == 1]]
    a, b = origins(faces)[rim], targets(faces)[rim]
    swap = position[a] > position[b]
    low, high = np.where(swap, b, a), np.where(swap, a, b)
    meeting = EqualRuns.of(position[low] * np.int64(len(position)) + position[high])
    inside, owner = meeting.members(meeting.size > 1)
    head = meeting.order[meeting.start[meeting.size > 1]][owner]
    left = np.concatenate([low[inside], high[inside]])
    right = np.concatenate([low[head], high[head]])
    return lowest_in_component(len(position), left, right)
