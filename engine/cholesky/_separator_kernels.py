"""Vertex separators of a graph: a first cut, and moves that make it lighter.

Nodes of the separator move to either side and pull neighbours in (Fiduccia and Mattheyses 1982;
Ashcraft and Liu 1997). A graph is ``start`` (n+1,) and ``neighbours`` (e,) in CSR form, with the
``weight`` (n,) of its nodes; ``side`` (n,) is A, B or S.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.cholesky._links import Links
from engine.types import IntArray

A, B, S = 0, 1, 2  # the sides of a cut, and its separator

_TRIES = 2  # cuts of a graph
_PASSES = 6  # of moving a separator's nodes
_BALANCE = 0.6  # of the weight that one side may have


@kernel
def cut(start: IntArray, neighbours: Links, weight: IntArray) -> IntArray:
    """The best of some separators where two far nodes are equally many steps away."""
    n = len(weight)
    near = np.empty(n, np.int64)
    far = np.empty(n, np.int64)
    queue = np.empty(n, np.int64)
    best = np.zeros(n, np.int64)
    lightest = -1
    for attempt in range(_TRIES):
        count = _distances(start, neighbours, (attempt * n) // _TRIES, near, queue)
        if count < n:
            best[:] = B
            best[queue[:count]] = A
            return best
        if attempt % 2:
            far[:] = 0
        else:
            _distances(start, neighbours, queue[count - 1], near, queue)
            _distances(start, neighbours, queue[count - 1], far, queue)
        side = _halves(near - far, weight)
        for v in range(n):
            if side[v] == B:
                for e in range(start[v], start[v + 1]):
                    if side[neighbours[e]] == A:
                        side[v] = S
                        break
        shorten(start, neighbours, weight, side)
        heavy = weight[side == S].sum()
        if lightest < 0 or heavy < lightest:
            lightest = heavy
            best[:] = side
    return best


@kernel
def _distances(
    start: IntArray, neighbours: Links, root: int, distance: IntArray, queue: IntArray
) -> int:
    """Steps from ``root``; the nodes reached, how many is returned, are the first in ``queue``."""
    distance[:] = -1
    queue[0] = root
    distance[root] = 0
    head, tail = 0, 1
    while head < tail:
        v = queue[head]
        head += 1
        for e in range(start[v], start[v + 1]):
            w = neighbours[e]
            if distance[w] < 0:
                distance[w] = distance[v] + 1
                queue[tail] = w
                tail += 1
    return tail


@kernel
def _halves(key: IntArray, weight: IntArray) -> IntArray:
    """Side A has the smaller keys, side B the greater ones, both about the same weight."""
    side = np.full(len(key), B, np.int64)
    total, passed = weight.sum(), 0
    for v in np.argsort(key):
        if 2 * passed >= total:
            break
        side[v] = A
        passed += weight[v]
    return side


@kernel
def _enter(
    start: IntArray, neighbours: Links, weight: IntArray, side: IntArray, pull: IntArray, v: int
) -> None:
    """Note what ``v``, new in the separator, would pull into it when it left for A or B."""
    pull[0, v] = pull[1, v] = 0
    for e in range(start[v], start[v + 1]):
        w = neighbours[e]
        if side[w] != S:
            pull[1 - side[w], v] += weight[w]


@kernel
def _turn(
    start: IntArray,
    neighbours: Links,
    weight: IntArray,
    side: IntArray,
    pull: IntArray,
    v: int,
    to: int,
) -> None:
    """Change the side of ``v`` and what its neighbours in the separator would pull."""
    old = side[v]
    side[v] = to
    for e in range(start[v], start[v + 1]):
        w = neighbours[e]
        if side[w] == S:
            if old != S:
                pull[1 - old, w] -= weight[v]
            if to != S:
                pull[1 - to, w] += weight[v]
    if to == S:
        _enter(start, neighbours, weight, side, pull, v)


@kernel
def shorten(start: IntArray, neighbours: Links, weight: IntArray, side: IntArray) -> None:
    """Make the separator of ``side`` lighter, in place."""
    n = len(weight)
    heavy = np.zeros(3, np.int64)
    for v in range(n):
        heavy[side[v]] += weight[v]
    locked = np.zeros(n, np.int64)
    line = np.empty(n, np.int64)
    pull = np.empty((2, n), np.int64)
    turned = np.empty((3 * n, 2), np.int64)  # a node leaves once, after and before it may enter
    for round_ in range(1, _PASSES + 1):
        count = 0
        for v in range(n):
            if side[v] == S:
                _enter(start, neighbours, weight, side, pull, v)
                line[count] = v
                count += 1
        turns, kept = _moved(
            start, neighbours, weight, side, pull, line, count, locked, round_, heavy, turned
        )
        for i in range(turns - 1, kept - 1, -1):
            v = turned[i, 0]
            heavy[side[v]] -= weight[v]
            side[v] = turned[i, 1]
            heavy[side[v]] += weight[v]
        if kept == 0:
            break


@kernel
def _moved(
    start: IntArray,
    neighbours: Links,
    weight: IntArray,
    side: IntArray,
    pull: IntArray,
    line: IntArray,
    count: int,
    locked: IntArray,
    round_: int,
    heavy: IntArray,
    turned: IntArray,
) -> tuple[int, int]:
    """Move nodes out of the separator while that may pay, each at most once a round.

    ``turned`` notes every node that changed sides, with its side before. Returns how many, and how
    many of them led to the lightest separator.
    """
    most = int(_BALANCE * heavy.sum())
    best, balance = heavy[S], abs(heavy[A] - heavy[B])
    idle, turns, kept = 0, 0, 0
    while idle < 15 + count // 16:
        chosen, to = _best_move(line[:count], locked, round_, weight, pull, heavy, most)
        if chosen < 0:
            break
        v = line[chosen]
        count -= 1
        line[chosen] = line[count]
        locked[v] = round_
        turned[turns, 0], turned[turns, 1] = v, S
        turns += 1
        heavy[S] -= weight[v]
        heavy[to] += weight[v]
        _turn(start, neighbours, weight, side, pull, v, to)
        for e in range(start[v], start[v + 1]):
            w = neighbours[e]
            if side[w] == 1 - to:
                turned[turns, 0], turned[turns, 1] = w, 1 - to
                turns += 1
                heavy[1 - to] -= weight[w]
                heavy[S] += weight[w]
                _turn(start, neighbours, weight, side, pull, w, S)
                line[count] = w
                count += 1
        now = abs(heavy[A] - heavy[B])
        if heavy[S] < best or (heavy[S] == best and now < balance):
            best, balance, kept, idle = heavy[S], now, turns, 0
        else:
            idle += 1
    return turns, kept


@kernel
def _best_move(
    line: IntArray,
    locked: IntArray,
    round_: int,
    weight: IntArray,
    pull: IntArray,
    heavy: IntArray,
    most: int,
) -> tuple[int, int]:
    """The place in ``line`` and the side of the move that lightens the separator most, or -1."""
    chosen, to, gain = -1, 0, -(1 << 60)
    for i in range(len(line)):
        v = line[i]
        if locked[v] == round_:
            continue
        for x in range(2):
            if heavy[x] + weight[v] <= most:
                value = 2 * (weight[v] - pull[x, v]) + (heavy[x] < heavy[1 - x])
                if value > gain:
                    chosen, to, gain = i, x, value
    return chosen, to
