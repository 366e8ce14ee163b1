"""Compiled search for what hangs together."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import IntArray


@kernel
def lowest_in_component(count: int, a: IntArray, b: IntArray) -> IntArray:
    """For each of ``count`` nodes the lowest node that the links a-b connect it to.

    Rem's algorithm (Dijkstra 1976): a node's parent is never above it.
    """
    parent = np.arange(count)
    for link in range(len(a)):
        one, other = a[link], b[link]
        while parent[one] != parent[other]:
            if parent[one] < parent[other]:
                one, other = other, one
            above = parent[one]
            parent[one] = parent[other]
            if above == one:
                break
            one = above
    for node in range(count):
        parent[node] = parent[parent[node]]
    return parent


@kernel
def numbered(lowest: IntArray) -> tuple[IntArray, int]:
    """Components numbered in the order of their lowest nodes, and how many there are."""
    label = np.empty(len(lowest), dtype=np.int64)
    count = 0
    for node in range(len(lowest)):
        if lowest[node] == node:
            label[node] = count
            count += 1
        else:
            label[node] = label[lowest[node]]
    return label, count
