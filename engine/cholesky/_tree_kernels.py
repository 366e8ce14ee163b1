"""The elimination tree of an ordered pattern, and its supernodes."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import IntArray


@kernel
def elimination_tree(start: IntArray, neighbours: IntArray, order: IntArray) -> IntArray:
    """Parent (n,) of each position of ``order`` in the elimination tree, -1 for a root (Liu)."""
    n = len(order)
    place = np.empty(n, np.int64)
    for k in range(n):
        place[order[k]] = k
    parent = np.full(n, -1, np.int64)
    ancestor = np.full(n, -1, np.int64)
    for k in range(n):
        for at in range(start[order[k]], start[order[k] + 1]):
            i = place[neighbours[at]]
            while i != -1 and i < k:
                above = ancestor[i]
                ancestor[i] = k
                if above == -1:
                    parent[i] = k
                i = above
    return parent


@kernel
def postorder(parent: IntArray) -> IntArray:
    """The nodes of a forest (n,), every one after its children, subtrees contiguous."""
    n = len(parent)
    first = np.full(n + 1, -1, np.int64)
    following = np.empty(n, np.int64)
    for node in range(n - 1, -1, -1):
        above = parent[node] if parent[node] >= 0 else n
        following[node] = first[above]
        first[above] = node
    order = np.empty(n, np.int64)
    stack = np.empty(n + 1, np.int64)
    stack[0] = n
    depth, count = 1, 0
    while depth:
        node = stack[depth - 1]
        child = first[node]
        if child >= 0:
            first[node] = following[child]
            stack[depth] = child
            depth += 1
        else:
            depth -= 1
            if node < n:
                order[count] = node
                count += 1
    return order


@kernel
def column_counts(
    start: IntArray, neighbours: IntArray, order: IntArray, parent: IntArray
) -> IntArray:
    """Entries (n,) of each column of the factor, the diagonal included, by row subtrees."""
    n = len(order)
    place = np.empty(n, np.int64)
    for k in range(n):
        place[order[k]] = k
    count = np.ones(n, np.int64)
    seen = np.full(n, -1, np.int64)
    for k in range(n):
        seen[k] = k
        for at in range(start[order[k]], start[order[k] + 1]):
            i = place[neighbours[at]]
            while i < k and seen[i] != k:
                seen[i] = k
                count[i] += 1
                i = parent[i]
    return count


@kernel
def supernodes(parent: IntArray, count: IntArray) -> tuple[IntArray, IntArray]:
    """The relaxed supernode (n,) of each column of a postordered tree, and their parents.

    Neighbouring columns of one structure join; then a child joins its parent where that
    stores few explicit zeros (Ashcraft and Grimes 1989), however many other children there are.
    Supernodes that joined others leave their names unused: their parent is -2.
    """
    n = len(parent)
    of = np.empty(n, np.int64)
    last = np.empty(n, np.int64)
    wide = np.zeros(n, np.int64)
    high = np.empty(n, np.int64)
    total = 0
    for j in range(n):
        if j == 0 or parent[j - 1] != j or count[j - 1] != count[j] + 1:
            high[total] = count[j]
            total += 1
        of[j] = total - 1
        last[total - 1] = j
        wide[total - 1] += 1
    above = np.full(total, -1, np.int64)
    for s in range(total):
        if parent[last[s]] >= 0:
            above[s] = of[parent[last[s]]]
    into = _joined(above, wide[:total], high[:total])
    for j in range(n):
        of[j] = into[of[j]]
    for s in range(total):
        above[s] = -2 if into[s] != s else into[above[s]] if above[s] >= 0 else -1
    return of, above


@kernel
def _joined(above: IntArray, wide: IntArray, high: IntArray) -> IntArray:
    """Which supernode each one joins, itself if none; ``wide`` and ``high`` become the sizes."""
    total = len(above)
    into = np.arange(total)
    zeros = np.zeros(total, np.int64)
    first = np.full(total, -1, np.int64)
    following = np.full(total, -1, np.int64)
    for s in range(total):
        child = first[s]
        while child >= 0:
            columns = wide[s] + wide[child]
            more = wide[child] * (wide[child] + high[s] - high[child])
            empty = zeros[s] + zeros[child] + more
            size = columns * (wide[child] + high[s]) - columns * (columns - 1) // 2
            if _worth_joining(columns, empty / size):
                into[child] = s
                zeros[s] = empty
                wide[s] = columns
                high[s] += wide[child]
            child = following[child]
        if above[s] >= 0:
            following[s] = first[above[s]]
            first[above[s]] = s
    for s in range(total - 1, -1, -1):
        into[s] = into[into[s]]
    return into


@kernel
def _worth_joining(columns: int, empty: float) -> bool:
    return (
        columns <= 4
        or (columns <= 16 and empty < 0.5)
        or (columns <= 48 and empty < 0.15)
        or empty < 0.05
    )


@kernel
def supernode_columns(
    of: IntArray, above: IntArray
) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """The columns in the order of their supernodes, children first.

    Returns ``columns`` (n,), the bounds ``first`` (s+1,) of each supernode's columns in it,
    the supernodes' ``parent`` (s,) in their new numbering, and ``depth`` (s,) below the roots.
    """
    n = len(of)
    used = np.flatnonzero(above > -2)
    number = np.full(len(above), -1, np.int64)
    for i in range(len(used)):
        number[used[i]] = i
    tree = np.empty(len(used), np.int64)
    for i in range(len(used)):
        tree[i] = number[above[used[i]]] if above[used[i]] >= 0 else -1
    order = postorder(tree)
    rank = np.empty(len(used), np.int64)
    for i in range(len(used)):
        rank[order[i]] = i
    parent = np.full(len(used), -1, np.int64)
    for i in range(len(used)):
        if tree[i] >= 0:
            parent[rank[i]] = rank[tree[i]]
    depth = np.zeros(len(used), np.int64)
    for s in range(len(used) - 1, -1, -1):
        if parent[s] >= 0:
            depth[s] = depth[parent[s]] + 1
    first = np.zeros(len(used) + 1, np.int64)
    for j in range(n):
        first[rank[number[of[j]]] + 1] += 1
    for s in range(len(used)):
        first[s + 1] += first[s]
    fill = first[:-1].copy()
    columns = np.empty(n, np.int64)
    for j in range(n):
        s = rank[number[of[j]]]
        columns[fill[s]] = j
        fill[s] += 1
    return columns, first, parent, depth
