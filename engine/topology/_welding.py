"""Vertices that lie at exactly the same place: which they are, and which to join."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from engine.topology import _welding_kernels as kernels
from engine.topology._halfedges import EqualRuns, edge_runs, origins, targets
from engine.types import BoolArray, FloatArray, IntArray


def position_classes(vertices: FloatArray) -> IntArray:
    """For each vertex the lowest vertex with exactly the same coordinates (n,).

    Takes any rows (n, c) of numbers; one with NaN is like no other.
    """
    rows = np.ascontiguousarray(vertices) + 0.0  # -0 becomes 0
    return _row_classes(rows.view(np.int64), np.any(np.isnan(rows), axis=1, keepdims=False))


def repeated_rows(rows: IntArray) -> BoolArray:
    """(n,) whether a row (n, c) is there already, before it."""
    first = _row_classes(np.ascontiguousarray(rows), np.zeros(len(rows), np.bool_))
    return first != np.arange(len(rows))


def _row_classes(rows: IntArray, alone: BoolArray) -> IntArray:
    table = np.full(1 << (2 * len(rows)).bit_length(), -1, dtype=np.int64)
    first = np.empty(len(rows), dtype=np.int64)
    kernels.first_rows(rows, alone, table, first)
    return first


def stitch(faces: IntArray, position: IntArray) -> IntArray:
    """Join vertices along boundary edges that coincide; the lowest of those joined, (n,).

    Both ends of the edges must agree in ``position``. So seams and triangle soup close, while
    sheets that merely touch at a point, or whose interiors coincide, stay apart.
    """
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


def lowest_in_component(count: int, a: IntArray, b: IntArray) -> IntArray:
    """For each of ``count`` nodes the lowest node that the links a-b connect it to."""
    links = sparse.coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(count, count))
    label = connected_components(links, directed=False)[1]
    lowest = np.full(int(label.max(initial=-1)) + 1, count, dtype=np.int64)
    np.minimum.at(lowest, label, np.arange(count))
    return lowest[label]
