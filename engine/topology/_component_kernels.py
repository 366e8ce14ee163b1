"""Compiled search for what hangs together."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import IntArray


@kernel
def join(parent: IntArray, one: int, other: int) -> None:
    """Unite the components of two nodes, by Rem's algorithm (Dijkstra 1976).

    A node's parent is never above it.
    """
    while parent[one] != parent[other]:
        if parent[one] < parent[other]:
            one, other = other, one
        above = parent[one]
        parent[one] = parent[other]
        if above == one:
            break
        one = above


@kernel
def flatten(parent: IntArray) -> None:
    """Let every node's parent be the lowest node of its component."""
    for node in range(len(parent)):
        parent[node] = parent[parent[node]]


@kernel
def lowest_in_component(count: int, a: IntArray, b: IntArray) -> IntArray:
    """For each of ``count`` nodes the lowest node that the links a-b connect it to."""
    parent = np.arange(count)
    for link in range(len(a)):
        join(parent, a[link], b[link])
    flatten(parent)
    return parent


@kernel
def lowest_face(keys: IntArray, bounds: IntArray) -> IntArray:
    """For each face the lowest one that edges connect it to, of any number of faces each.

    ``keys`` and ``bounds`` as :func:`engine.halfedges.edge_keys` gives them.
    """
    parent = np.arange(len(keys) // 3)
    for group in range(len(bounds) - 1):
        for at in range(bounds[group] + 1, bounds[group + 1]):
            if keys[at] >> 32 == keys[at - 1] >> 32:
                join(parent, (keys[at] & 0xFFFFFFFF) // 3, (keys[at - 1] & 0xFFFFFFFF) // 3)
    flatten(parent)
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
