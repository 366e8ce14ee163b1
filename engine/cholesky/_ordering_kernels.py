"""Nested dissection (George 1973) of a graph: an order of elimination that fills little.

Separators are found as in METIS (Karypis and Kumar 1998): the graph is coarsened, cut where it is
small, and the separator shortened at every size on the way back. A graph is ``start`` (n+1,) and
``neighbours`` (e,) in CSR form, with the ``weight`` (n,) of its nodes.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.cholesky._coarsening_kernels import COARSE, back, coarsened
from engine.cholesky._links import Links
from engine.cholesky._separator_kernels import A, B, S, cut
from engine.types import IntArray

_LEAF = 60  # nodes that minimum degree orders; their neighbours are the bits of a word
_REPEATED = (1000, 2000)  # nodes between which cutting again pays and does not take long


@kernel
def nested_dissection(start: IntArray, neighbours: Links, weight: IntArray, seeds: int) -> IntArray:
    """The nodes (n,) in the order of their elimination, separators after what they separate.

    Long separators are the best of ``seeds`` ways to coarsen.
    """
    n = len(weight)
    order = np.empty(n, np.int64)
    place = np.full(n, -1, np.int64)
    starts, links = [start.astype(np.int64)], [neighbours.astype(np.int32)]
    weights, names, begins = [weight.astype(np.int64)], [np.arange(n)], [0]
    while names:
        here, edges, heavy = starts.pop(), links.pop(), weights.pop()
        name, begin = names.pop(), begins.pop()
        n = len(name)
        if n <= _LEAF:
            order[begin : begin + n] = name[_minimum_degree(start, neighbours, name, place)]
            continue
        side = _bisected(here, edges, np.ones(len(edges), np.int32), heavy, seeds)
        count = np.bincount(side, minlength=3)
        if count.max() == n:
            order[begin : begin + n] = name
            continue
        order[begin + count[A] + count[B] : begin + n] = name[side == S]
        for x in range(2):
            if count[x]:
                inner_start, inner = _piece(here, edges, side, x)
                starts.append(inner_start)
                links.append(inner)
                weights.append(heavy[side == x])
                names.append(name[side == x])
                begins.append(begin)
                begin += count[x]
    return order


@kernel
def _minimum_degree(
    start: IntArray, neighbours: Links, names: IntArray, place: IntArray
) -> IntArray:
    """Minimum degree order of up to 64 nodes; what they touch outside is eliminated later.

    ``place`` (n,) is scratch, -1 everywhere. A set of nodes is a word of bits.
    """
    n = len(names)
    inside = np.zeros(n, np.uint64)
    outside = np.zeros(n, np.uint64)
    for i in range(n):
        place[names[i]] = i
    halo = 0
    touched = np.empty(64, np.int64)
    for i in range(n):
        for e in range(start[names[i]], start[names[i] + 1]):
            w = neighbours[e]
            if place[w] < 0 and halo < 64:
                place[w] = 64 + halo
                touched[halo] = w
                halo += 1
            if 0 <= place[w] < 64:
                inside[i] |= np.uint64(1) << np.uint64(place[w])
            elif place[w] >= 64:
                outside[i] |= np.uint64(1) << np.uint64(place[w] - 64)
    for i in range(n):
        place[names[i]] = -1
    for i in range(halo):
        place[touched[i]] = -1
    order = np.empty(n, np.int64)
    done = np.zeros(n, np.bool_)
    for step in range(n):
        chosen, least = -1, 1 << 30
        for i in range(n):
            if not done[i]:
                degree = _bits(inside[i]) + _bits(outside[i])
                if degree < least:
                    chosen, least = i, degree
        order[step] = chosen
        done[chosen] = True
        own = np.uint64(1) << np.uint64(chosen)
        for i in range(n):
            if inside[i] & own:
                inside[i] = (inside[i] | inside[chosen]) & ~own
                inside[i] &= ~(np.uint64(1) << np.uint64(i))
                outside[i] |= outside[chosen]
    return order


@kernel
def _bits(word: np.uint64) -> int:
    """How many bits are set in 64."""
    pairs = word - ((word >> np.uint64(1)) & np.uint64(0x5555555555555555))
    low = np.uint64(0x3333333333333333)
    fours = (pairs & low) + ((pairs >> np.uint64(2)) & low)
    eights = (fours + (fours >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return int((eights * np.uint64(0x0101010101010101)) >> np.uint64(56))


@kernel
def _piece(start: IntArray, neighbours: Links, side: IntArray, x: int) -> tuple[IntArray, Links]:
    """The graph of the nodes of one side."""
    number = np.cumsum(side == x) - 1
    begin = np.zeros(number[-1] + 2, np.int64)
    inner = np.empty(len(neighbours), np.int32)
    at = 0
    for v in range(len(side)):
        if side[v] == x:
            for e in range(start[v], start[v + 1]):
                if side[neighbours[e]] == x:
                    inner[at] = number[neighbours[e]]
                    at += 1
            begin[number[v] + 1] = at
    return begin, inner[:at]


@kernel
def _bisected(
    start: IntArray, neighbours: Links, strength: Links, weight: IntArray, seeds: int
) -> IntArray:
    """The side (n,) of each node: A, B, or the separator between them.

    The graph is coarsened to a middling size, cut there in the best of some ways if that may pay,
    and the separator is shortened at every size on the way back.
    """
    starts, links, strengths, weights, pairs = coarsened(
        start, neighbours, strength, weight, 0, _REPEATED[1]
    )
    here, edges, strong, heavy = starts[-1], links[-1], strengths[-1], weights[-1]
    best = _cut_coarsely(here, edges, strong, heavy, 0)
    lightest = heavy[best == S].sum()
    for seed in range(1, seeds if len(heavy) > _REPEATED[0] else 1):
        side = _cut_coarsely(here, edges, strong, heavy, seed)
        separator = heavy[side == S].sum()
        if separator < lightest:
            best, lightest = side, separator
    return back(starts, links, weights, pairs, best)


@kernel
def _cut_coarsely(
    start: IntArray, neighbours: Links, strength: Links, weight: IntArray, seed: int
) -> IntArray:
    """The side (n,) of each node by one way to coarsen the graph."""
    starts, links, _, weights, pairs = coarsened(start, neighbours, strength, weight, seed, COARSE)
    return back(starts, links, weights, pairs, cut(starts[-1], links[-1], weights[-1]))
