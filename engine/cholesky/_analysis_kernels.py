"""Symbolic analysis of a sparse Cholesky factor: elimination tree, supernodes, index lists."""

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
