"""Half-edges of a triangle list: number 3 f + k runs from corner k of face f to corner k + 1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from engine.errors import TopologyError
from engine.topology import _edge_kernels as kernels
from engine.types import BoolArray, IntArray


def origins(faces: IntArray) -> IntArray:
    """Start vertex of every half-edge (3m,)."""
    return faces.reshape(-1)


def targets(faces: IntArray) -> IntArray:
    """End vertex of every half-edge (3m,)."""
    return faces[:, [1, 2, 0]].reshape(-1)


@dataclass(frozen=True, slots=True)
class EqualRuns:
    """``order`` sorts the keys (stably); run i is ``order[start[i] : start[i] + size[i]]``."""

    order: IntArray
    start: IntArray
    size: IntArray

    @classmethod
    def of(cls, keys: IntArray) -> EqualRuns:
        """The runs of equal keys."""
        order = np.argsort(keys, kind="stable")
        ordered = keys[order]
        first = np.ones(len(keys), dtype=np.bool_)
        first[1:] = ordered[1:] != ordered[:-1]
        start = np.flatnonzero(first)
        return cls(order, start, np.diff(start, append=len(keys)))

    def members(self, runs: BoolArray | IntArray) -> tuple[IntArray, IntArray]:
        """What the chosen runs hold: positions in the keys, and which chosen run each is in."""
        start, size = self.start[runs], self.size[runs]
        owner = np.repeat(np.arange(len(start)), size)
        within = np.arange(len(owner)) - np.repeat(np.cumsum(size) - size, size)
        return self.order[start[owner] + within], owner


class EdgeCounts(NamedTuple):
    """How many edges have one face, two, and more."""

    lone: int
    joining: int
    crowded: int


def edge_counts(faces: IntArray, place: IntArray | None = None) -> EdgeCounts:
    """The edges of ``faces`` between vertices, or between the ``place`` (n,) of each."""
    return EdgeCounts(*kernels.edge_counts(*_sorted_keys(faces, place)))


def edge_runs(faces: IntArray, place: IntArray | None = None) -> EqualRuns:
    """The half-edges that lie on each undirected edge (as ``edge_counts`` has them)."""
    keys, bounds = _sorted_keys(faces, place)
    start = np.empty(sum(kernels.edge_counts(keys, bounds)), dtype=np.int64)
    kernels.half_edges_of(keys, bounds, start)
    return EqualRuns(keys, start, np.diff(start, append=len(keys)))


def _sorted_keys(faces: IntArray, place: IntArray | None) -> tuple[IntArray, IntArray]:
    if place is None:
        place = np.arange(int(faces.max(initial=-1)) + 1)
    keys, bounds = kernels.by_lower_end(faces, place)
    for group in kernels.sort_short_groups(keys, bounds).tolist():
        keys[bounds[group] : bounds[group + 1]].sort()
    return keys, bounds


def twins(faces: IntArray) -> IntArray:
    """The opposite half-edge of each (3m,), -1 on the boundary.

    Raises ``TopologyError`` where an edge has three faces, or two that run the same way along it.
    """
    runs, start = edge_runs(faces), origins(faces)
    single = runs.order[runs.start[runs.size == 2]]
    partner = runs.order[runs.start[runs.size == 2] + 1]
    wrong = single[start[single] == start[partner]]
    if len(wrong) or (runs.size > 2).any():
        crowded, _ = runs.members(runs.size > 2)
        bad = np.unique(np.concatenate([wrong, crowded]) // 3)
        raise TopologyError(
            f"{len(bad)} faces are not consistently oriented or share an edge with more than one "
            f"other, first face {bad[0]}: make an editable surface of the mesh first",
            code="not_an_oriented_manifold",
            elements={"faces": bad[:100].tolist()},
        )
    twin = np.full(len(start), -1, dtype=np.int64)
    twin[single], twin[partner] = partner, single
    return twin
