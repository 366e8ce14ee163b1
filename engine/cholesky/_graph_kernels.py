"""The graph of a symmetric pattern, and of its unknowns that are alike."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import IntArray


@kernel
def adjacency(indptr: IntArray, indices: IntArray) -> tuple[IntArray, IntArray]:
    """Neighbours of each unknown, without itself, from a lower triangle in CSC form."""
    n = len(indptr) - 1
    start = np.zeros(n + 1, np.int64)
    for column in range(n):
        for at in range(indptr[column], indptr[column + 1]):
            if indices[at] != column:
                start[column + 1] += 1
                start[indices[at] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    neighbours = np.empty(start[n], np.int64)
    for column in range(n):
        for at in range(indptr[column], indptr[column + 1]):
            row = indices[at]
            if row != column:
                neighbours[fill[column]] = row
                fill[column] += 1
                neighbours[fill[row]] = column
                fill[row] += 1
    return start, neighbours


@kernel
def compressed(start: IntArray, neighbours: IntArray) -> tuple[IntArray, IntArray]:
    """Group (n,) of each unknown, those alike in their neighbours together, and one of each group.

    Alike is told by a sum of scrambled names: what is joined wrongly costs fill, nothing else.
    """
    n = len(start) - 1
    sums = np.empty(n, np.uint64)
    for v in range(n):
        total = _scrambled(v)
        for e in range(start[v], start[v + 1]):
            total += _scrambled(neighbours[e])
        sums[v] = total
    group = np.empty(n, np.int64)
    one = np.empty(n, np.int64)
    count = 0
    for v in range(n):
        group[v] = -1
        for e in range(start[v], start[v + 1]):
            w = neighbours[e]
            if w < v and sums[w] == sums[v]:
                group[v] = group[w]
                break
        if group[v] < 0:
            group[v] = count
            one[count] = v
            count += 1
    return group, one[:count].copy()


@kernel
def _scrambled(name: int) -> np.uint64:
    word = (np.uint64(name) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    word = (word ^ (word >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    return word ^ (word >> np.uint64(32))


@kernel
def quotient(
    start: IntArray, neighbours: IntArray, group: IntArray, one: IntArray
) -> tuple[IntArray, IntArray]:
    """The graph of groups, from the neighbours of ``one`` of each."""
    seen = np.full(len(one), -1, np.int64)
    begin = np.zeros(len(one) + 1, np.int64)
    inner = np.empty(len(neighbours), np.int64)
    at = 0
    for g in range(len(one)):
        seen[g] = g
        for e in range(start[one[g]], start[one[g] + 1]):
            other = group[neighbours[e]]
            if seen[other] != g:
                seen[other] = g
                inner[at] = other
                at += 1
        begin[g + 1] = at
    return begin, inner[:at].copy()
