"""Part of a mesh, of which faces that are turned over or crushed are opened by Newton's method.

Minimised over displacements u from the linear answer, points kept, is

    1/2 u' K u + sum_f w A_f s_f^2 / (s_f + b),

K the skin's stiffness and s_f the distortion of face f above what is bearable, b. Distortion is
measured with the signed area that a face shows along its old normal, turned with the
neighbourhood: it grows without bound as the face closes, and a face that is turned over is opened
little by little (Garanzha et al., "Foldover-free maps in 50 lines of code", 2021).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import scipy.sparse as sp

from engine.linalg import Factor, SymmetricPattern
from engine.restoration._constraints import ExactPoints
from engine.restoration._frames import frames_of
from engine.restoration._skin import HeldSkin
from engine.restoration._turned import Orientation
from engine.restoration._untangling_kernels import (
    barrier,
    barrier_model,
    entries_of,
    regularisation,
    signed_areas,
    spatial_data,
    spatial_pattern,
)
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_STEPS = 30
_PATIENCE = 15  # steps after which faces weigh more and more
_GROWTH = 1.2
_STIFF = 20.0  # of faces, relative to the skin's resistance to stretching
_BEARABLE = 4.0  # distortion; 2 is none, and a face of a sixth of its old area has 4
_CRUSHED = 1e-2  # stricter than what counts as crushed in the end, for a patch is not the whole
_ENOUGH = 1e-4
_SHORTEST = 1e-6  # of a step of Newton's method
_LONGEST = 4.0  # likewise: the convex model's steps open a face by half


@dataclass(slots=True)
class Effort:
    """How much may be tried: vertices that move, times steps, that are ``left``."""

    left: float = np.inf


class Patch:
    """The part of a mesh that may move, with two rings of faces around it that say what is up."""

    def __init__(self, whole: HeldSkin, near: BoolArray, already: IntArray, rounds: int) -> None:
        self._rounds = rounds
        mesh, self._near = whole.mesh, near
        around = whole.orientation.rings.grown(near, 2)
        judged = np.ones(len(mesh.faces), dtype=np.bool_)
        judged[already] = False
        moving = near[mesh.faces].any(axis=1)
        beside = around[mesh.faces].any(axis=1) & ~(moving & judged)
        order = np.concatenate([np.flatnonzero(moving & judged), np.flatnonzero(beside)])
        self._used, corners = np.unique(mesh.faces[order], return_inverse=True)
        patch = Mesh(mesh.vertices[self._used], corners.reshape(-1, 3))
        self._orientation = Orientation(patch)
        count = len(order) - int(beside.sum())
        self._faces = np.ascontiguousarray(patch.faces[:count])
        frames = frames_of(patch.moved(whole.rest[self._used]))
        self._hats = np.ascontiguousarray(frames.hats[:count])
        self._weight = _STIFF * whole.stretching * frames.areas[:count]
        self._place_unknowns(whole)

    def _place_unknowns(self, whole: HeldSkin) -> None:
        free = np.flatnonzero(self._near)
        self._free = np.flatnonzero(self._near[self._used])
        number = np.full(len(self._used), -1, dtype=np.int64)
        number[self._free] = np.arange(len(free))
        self._unknowns = number[self._faces]
        lower = cast(Any, whole.stiffness)[free][:, free].tocsc()
        lower.sort_indices()
        self._stiffness = lower + sp.tril(lower, -1).T
        self._values = lower.data
        self._indptr, indices = lower.indptr.astype(np.int64), lower.indices.astype(np.int64)
        self._entries = entries_of(self._indptr, indices, self._unknowns)
        self._pattern = SymmetricPattern(*spatial_pattern(self._indptr, indices))
        points = cast(Any, whole.points)[:, free]
        here = points[abs(points).sum(axis=1) > 0]
        self._points = sp.csr_array(sp.kron(here, sp.eye_array(3)))
        self._held = int(here.shape[0])

    def relaxed(
        self, begin: FloatArray, x: FloatArray, inertia: float, effort: Effort
    ) -> FloatArray:
        """``x`` (n, 3) with the patch near ``begin`` (n, 3) and its faces open, as far as found.

        What is up follows with ``inertia``: where faces are crushed, it flickers.
        """
        start, y, weight = begin[self._used], x[self._used], self._weight
        up = self._up(y)
        for step in range(_STEPS):
            if not self._any_turned(y) or effort.left < len(self._free):
                break
            effort.left -= len(self._free)
            if step >= _PATIENCE:
                weight = weight * _GROWTH
            up = inertia * up + (1.0 - inertia) * self._up(y)
            up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), _SHORTEST)
            y, moved = self._stepped(start, y, up, weight)
            if not moved:
                break
        out = x.copy()
        out[self._used] = y
        return out

    def _up(self, y: FloatArray) -> FloatArray:
        return self._orientation.up(y, rounds=self._rounds)[: len(self._faces)]

    def _any_turned(self, y: FloatArray) -> bool:
        turned = self._orientation.turned(y, least_area_ratio=_CRUSHED)
        return bool((turned < len(self._faces)).any())

    def _stepped(
        self, start: FloatArray, y: FloatArray, up: FloatArray, weight: FloatArray
    ) -> tuple[FloatArray, bool]:
        """One damped step of Newton's method from ``y``, and whether there was one."""
        regular = regularisation(signed_areas(y, self._faces, self._hats, up))
        terms = (self._faces, self._hats, up, weight, regular, _BEARABLE)

        def energy(at: FloatArray) -> float:
            away = (at - start)[self._free]
            return barrier(at, *terms) + 0.5 * float((away * (self._stiffness @ away)).sum())

        gradient, blocks = barrier_model(y, *terms)
        slope = gradient[self._free] + self._stiffness @ (y - start)[self._free]
        data = spatial_data(self._indptr, self._values, self._unknowns, self._entries, blocks)
        way = np.zeros_like(y)
        way[self._free] = self._kept_points(self._pattern.factor(data), -slope.reshape(-1, 1))
        return _searched(energy, y, way, float((slope * way[self._free]).sum()))

    def _kept_points(self, factor: Factor, right: FloatArray) -> FloatArray:
        """The step (free, 3) that ``right`` asks for and that moves no exact point."""
        step = factor.solve(right)
        if self._held:
            exact = ExactPoints(factor, self._points, tolerance=np.inf)
            step = exact.correct(step, np.zeros((3 * self._held, 1)))
        return step.reshape(-1, 3)


def _searched(
    energy: Callable[[FloatArray], float], y: FloatArray, way: FloatArray, descent: float
) -> tuple[FloatArray, bool]:
    """``y`` with as much of ``way`` as lowers the energy enough, and whether any does.

    The size of the step is halved until it does, or else doubled while that lowers it further.
    """
    now, size = energy(y), 1.0
    best = y + way
    least = energy(best)
    while least > now + _ENOUGH * size * descent:
        size *= 0.5
        if size < _SHORTEST:
            return y, False
        best = y + size * way
        least = energy(best)
    while 1.0 <= size < _LONGEST:
        size *= 2.0
        there = y + size * way
        farther = energy(there)
        if farther >= least:
            break
        least, best = farther, there
    return best, True
