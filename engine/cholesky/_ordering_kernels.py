"""Nested dissection (George 1973) of a graph: an order of elimination that fills little.

Separators are found as in METIS (Karypis and Kumar 1998): the graph is coarsened by matching
neighbours, cut where it is small, and the separator shortened at every size on the way back by
moving its vertices to either side (Fiduccia and Mattheyses 1982; Ashcraft and Liu 1997).

A graph is ``start`` (n+1,) and ``neighbours`` (e,) in CSR form, with the ``strength`` (e,) of its
edges and the ``weight`` (n,) of its nodes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engine._jit import kernel
from engine.types import IntArray

Links = NDArray[np.int32]

_LEAF = 60  # nodes that minimum degree orders; their neighbours are the bits of a word
_COARSE = 80  # nodes of a graph that is cut as it is
_REPEATED = (1000, 2000)  # nodes between which cutting again pays and does not take long
_TRIES = 2  # cuts of a coarse graph
_PASSES = 6  # of moving a separator's nodes
_SHRINK = 0.95  # pairing that leaves more than this share of the nodes leads nowhere
_BALANCE = 0.6  # of the weight that one side may have
_A, _B, _S = 0, 1, 2  # the sides of a cut, and its separator


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
        order[begin + count[_A] + count[_B] : begin + n] = name[side == _S]
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
    starts, links, strengths, weights, pairs = _coarsened(
        start, neighbours, strength, weight, 0, _REPEATED[1]
    )
    here, edges, strong, heavy = starts[-1], links[-1], strengths[-1], weights[-1]
    best = _cut_coarsely(here, edges, strong, heavy, 0)
    lightest = heavy[best == _S].sum()
    for seed in range(1, seeds if len(heavy) > _REPEATED[0] else 1):
        side = _cut_coarsely(here, edges, strong, heavy, seed)
        separator = heavy[side == _S].sum()
        if separator < lightest:
            best, lightest = side, separator
    return _back(starts, links, weights, pairs, best)


@kernel
def _cut_coarsely(
    start: IntArray, neighbours: Links, strength: Links, weight: IntArray, seed: int
) -> IntArray:
    """The side (n,) of each node by one way to coarsen the graph."""
    starts, links, _, weights, pairs = _coarsened(
        start, neighbours, strength, weight, seed, _COARSE
    )
    return _back(starts, links, weights, pairs, _cut(starts[-1], links[-1], weights[-1]))


@kernel
def _coarsened(
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
def _back(
    starts: list[IntArray],
    links: list[Links],
    weights: list[IntArray],
    pairs: list[Links],
    side: IntArray,
) -> IntArray:
    """The ``side`` of the coarsest graph's nodes brought to the finest, shortened on the way."""
    for level in range(len(pairs) - 1, -1, -1):
        side = side[pairs[level]]
        _shorten(starts[level], links[level], weights[level], side)
    return side


@kernel
def _matched(
    start: IntArray, neighbours: Links, strength: Links, weight: IntArray, seed: int
) -> tuple[Links, int]:
    """Number of the pair of each node (n,), partners by the strongest edge; how many pairs.

    Other values of ``seed`` begin at other nodes.
    """
    n = len(weight)
    most = max(1, int(1.5 * weight.sum() / _COARSE))
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


@kernel
def _cut(start: IntArray, neighbours: Links, weight: IntArray) -> IntArray:
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
            best[:] = _B
            best[queue[:count]] = _A
            return best
        if attempt % 2:
            far[:] = 0
        else:
            _distances(start, neighbours, queue[count - 1], near, queue)
            _distances(start, neighbours, queue[count - 1], far, queue)
        side = _halves(near - far, weight)
        for v in range(n):
            if side[v] == _B:
                for e in range(start[v], start[v + 1]):
                    if side[neighbours[e]] == _A:
                        side[v] = _S
                        break
        _shorten(start, neighbours, weight, side)
        heavy = weight[side == _S].sum()
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
    side = np.full(len(key), _B, np.int64)
    total, passed = weight.sum(), 0
    for v in np.argsort(key):
        if 2 * passed >= total:
            break
        side[v] = _A
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
        if side[w] != _S:
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
        if side[w] == _S:
            if old != _S:
                pull[1 - old, w] -= weight[v]
            if to != _S:
                pull[1 - to, w] += weight[v]
    if to == _S:
        _enter(start, neighbours, weight, side, pull, v)


@kernel
def _shorten(start: IntArray, neighbours: Links, weight: IntArray, side: IntArray) -> None:
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
            if side[v] == _S:
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
    best, balance = heavy[_S], abs(heavy[_A] - heavy[_B])
    idle, turns, kept = 0, 0, 0
    while idle < 15 + count // 16:
        chosen, to = _best_move(line[:count], locked, round_, weight, pull, heavy, most)
        if chosen < 0:
            break
        v = line[chosen]
        count -= 1
        line[chosen] = line[count]
        locked[v] = round_
        turned[turns, 0], turned[turns, 1] = v, _S
        turns += 1
        heavy[_S] -= weight[v]
        heavy[to] += weight[v]
        _turn(start, neighbours, weight, side, pull, v, to)
        for e in range(start[v], start[v + 1]):
            w = neighbours[e]
            if side[w] == 1 - to:
                turned[turns, 0], turned[turns, 1] = w, 1 - to
                turns += 1
                heavy[1 - to] -= weight[w]
                heavy[_S] += weight[w]
                _turn(start, neighbours, weight, side, pull, w, _S)
                line[count] = w
                count += 1
        now = abs(heavy[_A] - heavy[_B])
        if heavy[_S] < best or (heavy[_S] == best and now < balance):
            best, balance, kept, idle = heavy[_S], now, turns, 0
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
