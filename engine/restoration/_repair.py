"""Faces that a weight beyond turns over, opened where they are.

At some weights beyond, patches around the faces that are turned over are untangled. What that moved
is kept, in the patch's own frame, and interpolated: the repair is continuous in the weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from engine.operators import adjacency
from engine.restoration._elastic import Elastic
from engine.restoration._rotation_kernels import nearest_rotations
from engine.restoration._turned import Orientation
from engine.restoration._untangled import Effort, Untangler
from engine.types import FloatArray, IntArray, Mesh

_REACH = 0.004  # of the diagonal: how far an opened face takes its surroundings along
_DAMPED = 2.0  # stretching, for which a bump does not overshoot
_WIDTHS = (4, 5, 6)  # rings around faces turned over that may move
_EFFORT = 120_000, 6  # moving vertices times steps, at least, and for each vertex of the mesh
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
    already = orientation.turned(within)
    turned = np.concatenate([orientation.turned(x) for x in surfaces])
    turned = np.setdiff1d(turned, already)
    near = np.zeros(len(mesh.vertices), dtype=np.bool_)
    near[mesh.faces[turned]] = True
    near = orientation.rings.grown(near, _AROUND)
    faces = mesh.faces[near[mesh.faces].all(axis=1)]
    if not len(turned):
        return []
    used, corners = np.unique(faces, return_inverse=True)
    corners = corners.reshape(-1, 3)
    count, label = connected_components(adjacency(corners, len(used)), directed=False)
    made: list[Repair] = []
    effort = Effort(max(_EFFORT[0], _EFFORT[1] * len(mesh.vertices)))
    for which in range(count):
        inside = label[corners[:, 0]] == which
        here, own = np.unique(corners[inside], return_inverse=True)
        if len(here) > _LARGEST:
            continue
        here = used[here]
        patch = Mesh(mesh.vertices[here], own.reshape(-1, 3))
        parts = [x[here] for x in surfaces]
        moves = _moves(patch, within[here], parts, effort, count - which)
        made.append(Repair(here, patch.vertices, np.array([0.0, *excesses]), moves))
    return made


def _moves(
    patch: Mesh, within: FloatArray, surfaces: list[FloatArray], effort: Effort, among: int
) -> FloatArray:
    """What opens a ``patch`` on each of the ``surfaces`` (p, 3), in its own frame (1 + k, p, 3).

    It takes no more than its share of the ``effort`` that is left ``among`` so many patches.
    """
    elastic = Elastic(patch)
    reach, n = _REACH * elastic.size, len(patch.vertices)
    data = elastic.stiffness(bend=reach**4, stretch=_DAMPED * reach**2, hold=elastic.areas)
    pattern = elastic.pattern
    lower = sp.csc_array((data, pattern.indices, pattern.indptr), shape=(n, n))
    untangler = Untangler(
        patch, elastic.orientation, lower, sp.csr_array((0, n)), reach**2, within, _WIDTHS
    )
    moves = [np.zeros_like(within)]
    for k, x in enumerate(surfaces):
        frame = turn(patch.vertices, x)
        share = effort.left / (among * len(surfaces) - k)
        own = Effort(share)
        opened = untangler.untangled(x, within, x + moves[-1] @ frame.T, own)
        effort.left -= share - own.left
        moves.append((opened - x) @ frame)
    return np.stack(moves)
