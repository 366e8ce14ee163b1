"""Compiled sorting of half-edges by the edge that they lie on."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import IntArray

SHORT = 64
"""So many half-edges at one vertex are sorted by insertion, more are left to numpy."""


@kernel
def by_lower_end(faces: IntArray, place: IntArray) -> tuple[IntArray, IntArray]:
    """The half-edges (3m,) as keys ``higher end << 32 | half-edge``, grouped by their lower end.

    Those of vertex v are ``keys[bounds[v] : bounds[v + 1]]``. ``place`` (n,) renames the vertices
    before.
    """
    bounds = np.zeros(len(place) + 1, dtype=np.int64)
    for face in range(len(faces)):
        b = place[faces[face, 2]]
        for k in range(3):
            a, b = b, place[faces[face, k]]
            bounds[min(a, b)] += 1
    total = 0
    for vertex in range(len(bounds)):
        total += bounds[vertex]
        bounds[vertex] = total
    keys = np.empty(3 * len(faces), dtype=np.int64)
    for face in range(len(faces) - 1, -1, -1):
        b = place[faces[face, 0]]
        for k in range(2, -1, -1):
            a = place[faces[face, k]]
            low = min(a, b)
            bounds[low] -= 1
            keys[bounds[low]] = (max(a, b) << 32) | (3 * face + k)
            b = a
    return keys, bounds


@kernel
def sort_short_groups(keys: IntArray, bounds: IntArray) -> IntArray:
    """Sort the groups of at most ``SHORT`` keys; the numbers of the others."""
    long = 0
    for group in range(len(bounds) - 1):
        long += bounds[group + 1] - bounds[group] > SHORT
    unsorted = np.empty(long, dtype=np.int64)
    long = 0
    for group in range(len(bounds) - 1):
        begin, end = bounds[group], bounds[group + 1]
        if end - begin > SHORT:
            unsorted[long] = group
            long += 1
            continue
        for i in range(begin + 1, end):
            key, at = keys[i], i
            while at > begin and keys[at - 1] > key:
                keys[at] = keys[at - 1]
                at -= 1
            keys[at] = key
    return unsorted


@kernel
def edge_counts(keys: IntArray, bounds: IntArray) -> tuple[int, int, int]:
    """How many edges have one half-edge, two, and more; the groups are sorted."""
    counts = np.zeros(3, dtype=np.int64)
    for group in range(len(bounds) - 1):
        at = bounds[group]
        while at < bounds[group + 1]:
            begin = at
            while at < bounds[group + 1] and keys[at] >> 32 == keys[begin] >> 32:
                at += 1
            counts[min(at - begin, 3) - 1] += 1
    return counts[0], counts[1], counts[2]


@kernel
def half_edges_of(keys: IntArray, bounds: IntArray, starts: IntArray) -> None:
    """The sorted keys become the half-edges alone, ``starts`` (one per edge) where they begin."""
    found = 0
    for group in range(len(bounds) - 1):
        before = -1
        for at in range(bounds[group], bounds[group + 1]):
            if keys[at] >> 32 != before:
                before = keys[at] >> 32
                starts[found] = at
                found += 1
            keys[at] &= 0xFFFFFFFF


@kernel
def edges_and_uses(keys: IntArray, bounds: IntArray) -> tuple[IntArray, IntArray]:
    """The edges (e, 2), smaller vertex first, and how many half-edges (e,) each has; the groups
    are sorted."""
    ends = np.empty((len(keys), 2), dtype=np.int64)
    uses = np.empty(len(keys), dtype=np.int64)
    count = 0
    for group in range(len(bounds) - 1):
        before = -1
        for at in range(bounds[group], bounds[group + 1]):
            if keys[at] >> 32 != before:
                before = keys[at] >> 32
                ends[count, 0], ends[count, 1], uses[count] = group, before, 0
                count += 1
            uses[count - 1] += 1
    return ends[:count], uses[:count]


@kernel
def faces_at_edges(keys: IntArray, bounds: IntArray) -> tuple[IntArray, IntArray]:
    """Edges with two faces: the ends (k, 2), smaller first, and the faces (k, 2); the groups are
    sorted. An edge with more is there for each two that follow each other."""
    ends = np.empty((len(keys), 2), dtype=np.int64)
    faces = np.empty((len(keys), 2), dtype=np.int64)
    count = 0
    for group in range(len(bounds) - 1):
        for at in range(bounds[group] + 1, bounds[group + 1]):
            if keys[at] >> 32 == keys[at - 1] >> 32:
                ends[count, 0], ends[count, 1] = group, keys[at] >> 32
                faces[count, 0] = (keys[at - 1] & 0xFFFFFFFF) // 3
                faces[count, 1] = (keys[at] & 0xFFFFFFFF) // 3
                count += 1
    return ends[:count], faces[:count]


@kernel
def twins_of_keys(faces: IntArray, keys: IntArray, bounds: IntArray) -> tuple[IntArray, bool]:
    """The other half-edge of each (3m,), -1 on the boundary, and whether there are no others.

    That is, no edge has three half-edges, or two that start at the same vertex.
    """
    twin = np.full(len(keys), -1, dtype=np.int64)
    paired = True
    for group in range(len(bounds) - 1):
        for at in range(bounds[group] + 1, bounds[group + 1]):
            if keys[at] >> 32 == keys[at - 1] >> 32:
                one, other = keys[at - 1] & 0xFFFFFFFF, keys[at] & 0xFFFFFFFF
                alike = faces[one // 3, one % 3] == faces[other // 3, other % 3]
                if twin[one] >= 0 or alike:
                    paired = False
                twin[one], twin[other] = other, one
    return twin, paired
