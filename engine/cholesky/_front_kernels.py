"""Index lists of a supernodal factor: rows of fronts, and where numbers go."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import IntArray


@kernel
def front_rows(
    start: IntArray, neighbours: IntArray, order: IntArray, first: IntArray, parent: IntArray
) -> tuple[IntArray, IntArray]:
    """Rows below each supernode's own columns, ascending: bounds (s+1,) and rows."""
    n, total = len(order), len(parent)
    place = np.empty(n, np.int64)
    for k in range(n):
        place[order[k]] = k
    child = np.full(total, -1, np.int64)
    following = np.full(total, -1, np.int64)
    bound = np.zeros(total + 1, np.int64)
    rows = np.empty(4 * n + 64, np.int64)
    seen = np.full(n, -1, np.int64)
    for s in range(total):
        at = bound[s]
        if at + n - first[s + 1] > len(rows):
            longer = np.empty(2 * len(rows) + n, np.int64)
            longer[:at] = rows[:at]
            rows = longer
        end = first[s + 1]
        for k in range(first[s], end):
            for e in range(start[order[k]], start[order[k] + 1]):
                i = place[neighbours[e]]
                if i >= end and seen[i] != s:
                    seen[i] = s
                    rows[at] = i
                    at += 1
        c = child[s]
        while c >= 0:
            for e in range(bound[c], bound[c + 1]):
                i = rows[e]
                if i >= end and seen[i] != s:
                    seen[i] = s
                    rows[at] = i
                    at += 1
            c = following[c]
        rows[bound[s] : at].sort()
        bound[s + 1] = at
        if parent[s] >= 0:
            following[s] = child[parent[s]]
            child[parent[s]] = s
    return bound, rows[: bound[total]].copy()


@kernel
def places_in_parents(
    first: IntArray, parent: IntArray, bound: IntArray, rows: IntArray
) -> tuple[IntArray, IntArray]:
    """Where each row below a supernode stands in its parent's front; how many in its columns."""
    places = np.empty(len(rows), np.int64)
    inside = np.zeros(len(parent), np.int64)
    for s in range(len(parent)):
        p = parent[s]
        if p < 0:
            continue
        wide = first[p + 1] - first[p]
        e = bound[p]
        for at in range(bound[s], bound[s + 1]):
            if rows[at] < first[p + 1]:
                places[at] = rows[at] - first[p]
                inside[s] += 1
            else:
                while rows[e] != rows[at]:
                    e += 1
                places[at] = wide + e - bound[p]
    return places, inside


@kernel
def entry_targets(
    indptr: IntArray,
    indices: IntArray,
    order: IntArray,
    first: IntArray,
    bound: IntArray,
    rows: IntArray,
) -> tuple[IntArray, IntArray, IntArray]:
    """Where the matrix's entries go: grouped by supernode, and their place in its panel.

    Returns bounds (s+1,) of the groups, the ``entry`` (nnz,) and its ``target`` (nnz,), counted
    from the panel's start; a panel holds its columns one after another.
    """
    n, total = len(order), len(first) - 1
    place = np.empty(n, np.int64)
    of = np.empty(n, np.int64)
    for s in range(total):
        for k in range(first[s], first[s + 1]):
            place[order[k]] = k
            of[k] = s
    group = np.zeros(total + 1, np.int64)
    for column in range(n):
        for at in range(indptr[column], indptr[column + 1]):
            group[of[min(place[column], place[indices[at]])] + 1] += 1
    for s in range(total):
        group[s + 1] += group[s]
    fill = group[:-1].copy()
    entry = np.empty(len(indices), np.int64)
    target = np.empty(len(indices), np.int64)
    for column in range(n):
        for at in range(indptr[column], indptr[column + 1]):
            k, i = place[column], place[indices[at]]
            k, i = min(k, i), max(k, i)
            s = of[k]
            entry[fill[s]] = at
            wide = first[s + 1] - first[s]
            if i < first[s + 1]:
                row = i - first[s]
            else:
                row = wide + np.searchsorted(rows[bound[s] : bound[s + 1]], i)
            target[fill[s]] = (k - first[s]) * (wide + bound[s + 1] - bound[s]) + row
            fill[s] += 1
    return group, entry, target


@kernel
def update_places(parent: IntArray, depth: IntArray, bound: IntArray) -> tuple[IntArray, int]:
    """Where each supernode's update matrix lies in the workspace, and the workspace's length.

    Updates of even and odd depth lie on two stacks, so a supernode's own never covers its
    children's, which it reads.
    """
    total = len(parent)
    top = np.zeros(2, np.int64)
    most = np.zeros(2, np.int64)
    offset = np.empty(total, np.int64)
    waiting = np.zeros(total, np.int64)
    for s in range(total):
        size = (bound[s + 1] - bound[s]) ** 2
        side = depth[s] % 2
        top[1 - side] -= waiting[s]
        offset[s] = top[side]
        top[side] += size
        most[side] = max(most[side], top[side])
        if parent[s] >= 0:
            waiting[parent[s]] += size
    for s in range(total):
        if depth[s] % 2:
            offset[s] += most[0]
    return offset, most[0] + most[1]
