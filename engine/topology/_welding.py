"""Vertices that lie at exactly the same place: which they are, and which to join."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from engine.topology._halfedges import EqualRuns, edge_runs, origins, targets
from engine.types import FloatArray, IntArray


def position_classes(vertices: FloatArray) -> IntArray:
    """For each vertex the lowest vertex with exactly the same coordinates (n,)."""
    x, y, z = vertices.T
    order = np.lexsort((z, y, x))
    ordered = vertices[order]
    first = np.ones(len(vertices), dtype=np.bool_)
    first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    result = np.empty(len(vertices), dtype=np.int64)
    result[order] = order[first][np.cumsum(first) - 1]
    return result


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
