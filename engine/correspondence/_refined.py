"""Sources so coarse that their flat faces say little: divided, their edges raised onto the skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.correspondence._loops import LoopPair
from engine.correspondence._rounded import is_coarse, rounded
from engine.types import FloatArray, IntArray, Mesh

_ROUNDS = 2


@dataclass(frozen=True, slots=True)
class Refined:
    """A source's surface ``mesh`` with its ``loops``, as fine as it is to be compared.

    The vertices of the surface that it was made from come first. ``ends``: of each division those
    (k, 2) of the edges in the middle of which a vertex has been put.
    """

    mesh: Mesh
    loops: tuple[IntArray, ...]
    ends: tuple[IntArray, ...] = ()

    def finer(self) -> Refined:
        """This surface, divided until it is not coarse, or twice."""
        if len(self.ends) == _ROUNDS or not is_coarse(self.mesh):
            return self
        mesh, ends = rounded(self.mesh)
        return Refined(
            mesh,
            tuple(_divided(loop, ends, len(self.mesh.vertices)) for loop in self.loops),
            (*self.ends, ends),
        ).finer()

    def spread(self, values: FloatArray) -> FloatArray:
        """``values`` (n, …) of the vertices that it was made from, at all of its own."""
        for ends in self.ends:
            values = np.concatenate([values, values[ends].mean(axis=1)])
        return values

    def undivided(self, pairs: Sequence[LoopPair]) -> list[LoopPair]:
        """Its loops' ``pairs`` as those of the surface that it was made from."""
        if not self.ends:
            return list(pairs)
        number = np.arange(len(self.mesh.vertices))
        number[number >= len(self.mesh.vertices) - sum(map(len, self.ends))] = -1
        return [pair.restricted(number) for pair in pairs]


def _divided(loop: IntArray, ends: IntArray, count: int) -> IntArray:
    """A ``loop`` (k,) with the middles of its edges; these follow the ``count`` old vertices."""
    edges = np.sort(np.stack([loop, np.roll(loop, -1)], axis=1), axis=1)
    middles = np.searchsorted(_keys(ends, count), _keys(edges, count)) + count
    return np.stack([loop, middles], axis=1).ravel()


def _keys(edges: IntArray, count: int) -> IntArray:
    return edges[:, 0] * count + edges[:, 1]
