"""Faces that a weight beyond turns over, opened where they are.

At some weights beyond, patches around the faces that are turned over are untangled. What that moved
is kept, in the patch's own frame, and interpolated: the repair is continuous in the weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from engine.operators import adjacency
from engine.restoration._elastic import Elastic
from engine.restoration._patch import Effort
from engine.restoration._rotation_kernels import nearest_rotations
from engine.restoration._turned import Orientation
from engine.restoration._untangled import Untangler
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_EFFORT = 120_000, 6  # moving vertices times steps, at least, and for each vertex of the mesh
_FIRST = 0.7  # of that, before what is left turned over is opened alone
_AROUND = 18  # rings of faces around those turned over: more than untangling moves
_LARGEST = 10_000  # vertices of a patch: beyond, minutes; what is turned over there stays so


@dataclass(frozen=True, slots=True)
class Repair:
    """One patch's ``moves`` (k, p, 3), in the frame of ``rest`` (p, 3), at ``excesses`` (k,)."""

    used: IntArray  # (p,) vertices of the whole
    rest: FloatArray
    excesses: FloatArray  # ascending, the first one 0
    moves: FloatArray

    def at(self, x: FloatArray, excess: FloatArray) -> FloatArray:
        """The move (p, 3) of the patch on the surface ``x`` (n, 3) at ``excess`` (), or (n,)."""
        own = np.broadcast_to(excess, (len(x),))[self.used]
        k = np.clip(np.searchsorted(self.excesses, own, side="right") - 1, 0, len(self.moves) - 2)
        first, second = self.excesses[k], self.excesses[k + 1]
        t = np.clip((own - first) / (second - first), 0.0, 1.0)[:, None]
        every = np.arange(len(own))
        local = (1.0 - t) * self.moves[k, every] + t * self.moves[k + 1, every]
        return local @ turn(self.rest, x[self.used]).T


def turn(rest: FloatArray, x: FloatArray) -> FloatArray:
    """The rotation (3, 3) that takes ``rest`` (p, 3) nearest to ``x`` (p, 3), but for a shift."""
    covariance = (x - x.mean(axis=0)).T @ (rest - rest.mean(axis=0))
    return nearest_rotations(covariance[None])[0]


def repairs(
    mesh: Mesh,
    orientation: Orientation,
    within: FloatArray,
    surfaces: Sequence[FloatArray],
    excesses: Sequence[float],
) -> list[Repair]:
    """What opens the faces turned over on ``surfaces`` (n, 3), away from ``within`` (n, 3).

    Each surface is what the shape ``within`` becomes at one of the ascending ``excesses``. Faces
    that are turned over there already stay so.
    """
    turned = np.concatenate([orientation.turned(x) for x in surfaces])
    turned = np.setdiff1d(turned, orientation.turned(within))
    if not len(turned):
        return []
    patches = _patches(mesh, orientation.around(turned, _AROUND))
    effort = Effort(max(_EFFORT[0], _EFFORT[1] * len(mesh.vertices)))
    at = np.array([0.0, *excesses])
    made: list[Repair] = []
    for done, (used, patch) in enumerate(patches):
        parts = [x[used] for x in surfaces]
        moves = _moves(patch, within[used], parts, effort, len(patches) - done)
        made.append(Repair(used, patch.vertices, at, moves))
    return made


def _patches(mesh: Mesh, near: BoolArray) -> list[tuple[IntArray, Mesh]]:
    """The pieces of what is ``near`` (n,) that are not too large: their vertices, and meshes."""
    used, corners = np.unique(mesh.faces[near[mesh.faces].all(axis=1)], return_inverse=True)
    corners = corners.reshape(-1, 3)
    count, label = connected_components(adjacency(corners, len(used)), directed=False)
    made: list[tuple[IntArray, Mesh]] = []
    for which in range(count):
        own, faces = np.unique(corners[label[corners[:, 0]] == which], return_inverse=True)
        if len(own) <= _LARGEST:
            made.append((used[own], Mesh(mesh.vertices[used[own]], faces.reshape(-1, 3))))
    return made


def _moves(
    patch: Mesh, within: FloatArray, surfaces: list[FloatArray], effort: Effort, among: int
) -> FloatArray:
    """What opens a ``patch`` on each of the ``surfaces`` (p, 3), in its own frame (1 + k, p, 3).

    It takes no more than its share of the ``effort`` that is left ``among`` so many patches.
    """
    untangler = Untangler.in_place(Elastic(patch), within)
    moves = [np.zeros_like(within)]
    for k, x in enumerate(surfaces):
        frame = turn(patch.vertices, x)
        share = effort.left / (among * len(surfaces) - k)
        opened, left = _opened(untangler, within, x, x + moves[-1] @ frame.T, share)
        effort.left -= share - left
        moves.append((opened - x) @ frame)
    return np.stack(moves)


def _opened(
    untangler: Untangler, within: FloatArray, x: FloatArray, begin: FloatArray, effort: float
) -> tuple[FloatArray, float]:
    """``x`` (p, 3) opened from ``begin`` (p, 3), and the ``effort`` that is left.

    All that was moved before may move back towards ``x`` at first, which gives up less but takes
    many steps. Faces that these leave are opened where they are, while the rest keeps its place.
    """
    own = Effort(_FIRST * effort)
    opened = untangler.untangled(x, within, begin, own)
    own.left += (1.0 - _FIRST) * effort
    return untangler.untangled(opened, within, effort=own), own.left
