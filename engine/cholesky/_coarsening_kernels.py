"""Ever coarser graphs by pairing neighbours (Karypis and Kumar 1998), and the way back.

A graph is ``start`` (n+1,) and ``neighbours`` (e,) in CSR form, with the ``strength`` (e,) of its
edges and the ``weight`` (n,) of its nodes.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.cholesky._links import Links
from engine.cholesky._separator_kernels import shorten
from engine.types import IntArray

COARSE = 80  # nodes of a graph that is cut as it is

_SHRINK = 0.95  # pairing that leaves more than this share of the nodes leads nowhere


@kernel
def coarsened(
    start: IntArray, neighbours: Links, strength: Links, weight: IntArray, seed: int, until: int
) -> tuple[list[IntArray], list[Links], list[Links], list[IntArray], list[Links]]:
    """The graph and ever coarser ones, to at most ``until`` nodes if pairing goes that far.

    Lists of starts, neighbours, strengths, weights, and of each graph's pairs in the next.
    """
    starts, links, strengths, weights = [start], [neighbours], [strength], [weight]
    pairs = [np.empty(0, np.int32)]
    pairs.pop()
    while len(weights[-1]) > until:
        pair, size = _matched(starts[-1], links[-1], strengths[-1], weights[-1], seed)
        if size > _SHRINK * len(pair):
            break
        coarse = _contracted(starts[-1], links[-1], strengths[-1], weights[-1], pair, size)
        starts.append(coarse[0])
        links.append(coarse[1])
        strengths.append(coarse[2])
        weights.append(coarse[3])
        pairs.append(pair)
    return starts, links, strengths, weights, pairs


@kernel
def back(
    starts: list[IntArray],
    links: list[Links],
    weights: list[IntArray],
    pairs: list[Links],
    side: IntArray,
) -> IntArray:
    """The ``side`` of the coarsest graph's nodes brought to the finest, shortened on the way."""
    for level in range(len(pairs) - 1, -1, -1):
        side = side[pairs[level]]
        shorten(starts[level], links[level], weights[level], side)
    return side


@kernel
def _matched(
    start: IntArray, neighbours: Links, strength: Links, weight: IntArray, seed: int
) -> tuple[Links, int]:
    """Number of the pair of each node (n,), partners by the strongest edge; how many pairs.

    Other values of ``seed`` begin at other nodes.
    """
    n = len(weight)
    most = max(1, int(1.5 * weight.sum() / COARSE))
    pair = np.full(n, -1, np.int32)
    size = 0
    for step in range(n):
        v = (step + seed * n // 7) % n
        if pair[v] >= 0:
            continue
        partner, strongest = -1, 0
        for e in range(start[v], start[v + 1]):
            w = neighbours[e]
            if pair[w] < 0 and strength[e] > strongest and weight[v] + weight[w] <= most:
                partner, strongest = w, strength[e]
        pair[v] = size
        if partner >= 0:
            pair[partner] = size
        size += 1
    return pair, size


@kernel
def _contracted(
    start: IntArray,
    neighbours: Links,
    strength: Links,
    weight: IntArray,
    coarse: Links,
    size: int,
) -> tuple[IntArray, Links, Links, IntArray]:
    """The graph of pairs, strengths and weights summed."""
    n = len(weight)
    one = np.full(size, -1, np.int64)
    two = np.full(size, -1, np.int64)
    heavy = np.zeros(size, np.int64)
    for v in range(n):
        heavy[coarse[v]] += weight[v]
        if one[coarse[v]] < 0:
            one[coarse[v]] = v
        else:
            two[coarse[v]] = v
    begin = np.zeros(size + 1, np.int64)
    inner = np.empty(len(neighbours), np.int32)
    strong = np.empty(len(neighbours), np.int32)
    seen = np.full(size, -1, np.int32)
    at = 0
    for c in range(size):
        for v in (one[c], two[c]):
            if v < 0:
                continue
            for e in range(start[v], start[v + 1]):
                other = coarse[neighbours[e]]
                if other == c:
                    continue
                if seen[other] >= begin[c]:
                    strong[seen[other]] += strength[e]
                else:
                    seen[other] = at
                    inner[at] = other
                    strong[at] = strength[e]
                    at += 1
        begin[c + 1] = at
    return begin, inner[:at], strong[:at], heavy
