"""Half-edges of a triangle list: number 3 f + k runs from corner k of face f to corner k + 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine import _edge_kernels as kernels
from engine.errors import TopologyError
from engine.halfedges import edge_keys
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


def edge_count(faces: IntArray) -> int:
    """How many undirected edges there are."""
    return sum(kernels.edge_counts(*edge_keys(faces)))


def edge_runs(faces: IntArray) -> EqualRuns:
    """The half-edges that lie on each undirected edge."""
    keys, bounds = edge_keys(faces)
    start = np.empty(sum(kernels.edge_counts(keys, bounds)), dtype=np.int64)
    kernels.half_edges_of(keys, bounds, start)
    return EqualRuns(keys, start, np.diff(start, append=len(keys)))


def twins(faces: IntArray) -> IntArray:
    """The opposite half-edge of each (3m,), -1 on the boundary.

    Raises ``TopologyError`` where an edge has three faces, or two that run the same way along it.
    """
    twin, paired = kernels.twins_of_keys(faces, *edge_keys(faces))
    if not paired:
        raise _crowded(faces)
    return twin


def _crowded(faces: IntArray) -> TopologyError:
    runs, start = edge_runs(faces), origins(faces)
    pairs = runs.start[runs.size == 2]
    wrong = runs.order[pairs][start[runs.order[pairs]] == start[runs.order[pairs + 1]]]
    crowded, _ = runs.members(runs.size > 2)
    bad = np.unique(np.concatenate([wrong, crowded]) // 3)
    return TopologyError(
        f"{len(bad)} faces are not consistently oriented or share an edge with more than one "
        f"other, first face {bad[0]}: make an editable surface of the mesh first",
        code="not_an_oriented_manifold",
        elements={"faces": bad[:100].tolist()},
    )
