"""Faces that a move turned over or crushed, opened again as near to the move as they can be.

Around such faces, minimise over displacements u from the linear answer, points kept,

    1/2 u' K u + sum_f w A_f s_f^2 / (s_f + b),

K the skin's stiffness and s_f the distortion of face f above what is bearable, b. Distortion is
measured with the signed area that a face shows along its old normal, turned with the
neighbourhood: it grows without bound as the face closes, and a face that is turned over is opened
little by little (Garanzha et al., "Foldover-free maps in 50 lines of code", 2021).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import scipy.sparse as sp

from engine.linalg import Factor, SymmetricPattern
from engine.restoration._constraints import ExactPoints
from engine.restoration._frames import frames_of
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

_RINGS = (8, 12, 16)  # around faces turned over, one after the other while some are left
_ROUNDS = (2, 3, 4)  # and rings whose common rotation then says what is up
_INERTIA = (0.5, 0.75, 0.35, 0.0)  # of what is up: an attempt each, until one succeeds
_LARGEST = 20_000  # vertices of a patch: beyond, seconds a step
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


class Untangler:
    """A mesh whose vertices are held by ``stiffness`` (n, n), its lower half, and exact points.

    ``points`` (k, n) are the points that keep their places; ``stretching`` is what the skin's
    resistance to stretching counts for in ``stiffness``; ``rest`` (n, 3), by default the mesh
    itself, is where faces count as undistorted; ``widths`` are the rings around faces turned over
    that may move, one after the other while some are left.
    """

    def __init__(
        self,
        mesh: Mesh,
        orientation: Orientation,
        stiffness: sp.csc_array,
        points: sp.csr_array,
        stretching: float,
        rest: FloatArray | None = None,
        widths: tuple[int, ...] = _RINGS,
    ) -> None:
        self.mesh, self.rest, self._widths = mesh, rest, widths
        self.stiffness, self.points, self.stretching = stiffness, points, stretching
        self.rings = orientation.rings
        self._orientation = orientation

    def untangled(
        self,
        moved: FloatArray,
        before: FloatArray,
        begin: FloatArray | None = None,
        effort: Effort | None = None,
    ) -> FloatArray:
        """``moved`` (n, 3) with fewer faces inverted or collapsed than it has, if it has any.

        ``moved`` minimises the stiffness's energy; ``begin`` (n, 3) is where to start if no more
        faces are so there. Faces that are so in ``before`` (n, 3) already are left alone; faces
        for which no room is found, with the ``effort`` that there is, stay as they are.
        """
        effort = effort or Effort()
        best, turned = moved, self._orientation.turned(moved)
        if begin is None and not len(turned):
            return moved
        already = self._orientation.turned(before)
        turned = np.setdiff1d(turned, already)
        if begin is not None:
            ahead = np.setdiff1d(self._orientation.turned(begin), already)
            if len(ahead) <= len(turned):
                best, turned = begin, ahead
        if not len(turned):
            return best
        start, first = best, turned
        for inertia in _INERTIA:
            x, left = self._attempted(moved, start, first, already, inertia, effort)
            if len(left) < len(turned):
                best, turned = x, left
            if not len(turned):
                break
        return best

    def _attempted(
        self,
        moved: FloatArray,
        x: FloatArray,
        turned: IntArray,
        already: IntArray,
        inertia: float,
        effort: Effort,
    ) -> tuple[FloatArray, IntArray]:
        """``x`` near ``moved`` opened in ever larger patches, and the faces that are left then."""
        near = (x != moved).any(axis=1)
        for rings, rounds in zip(self._widths, _ROUNDS, strict=False):
            near |= self._grown(turned, rings)
            count = np.count_nonzero(near)
            if not len(turned) or count > _LARGEST or effort.left < count:
                break
            x = _Patch(self, near, already, rounds).relaxed(moved, x, inertia, effort)
            turned = np.setdiff1d(self._orientation.turned(x), already)
        return x, turned

    def _grown(self, faces: IntArray, rings: int) -> BoolArray:
        near = np.zeros(len(self.mesh.vertices), dtype=np.bool_)
        near[self.mesh.faces[faces]] = True
        return self.rings.grown(near, rings)


class _Patch:
    """The part of a mesh that may move, with two rings of faces around it that say what is up."""

    def __init__(self, whole: Untangler, near: BoolArray, already: IntArray, rounds: int) -> None:
        self._rounds = rounds
        mesh, self._near = whole.mesh, near
        around = whole.rings.grown(near, 2)
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
        frames = frames_of(patch if whole.rest is None else patch.moved(whole.rest[self._used]))
        self._hats = np.ascontiguousarray(frames.hats[:count])
        self._weight = _STIFF * whole.stretching * frames.areas[:count]
        self._place_unknowns(whole)

    def _place_unknowns(self, whole: Untangler) -> None:
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
        way = self._kept_points(self._pattern.factor(data), -slope.reshape(-1, 1))
        descent, now = float((slope * way).sum()), energy(y)

        def at(size: float) -> tuple[float, FloatArray]:
            there = y.copy()
            there[self._free] += size * way
            return energy(there), there

        size, (least, best) = 1.0, at(1.0)
        while least > now + _ENOUGH * size * descent:
            size *= 0.5
            if size < _SHORTEST:
                return y, False
            least, best = at(size)
        while 1.0 <= size < _LONGEST:
            size *= 2.0
            farther, there = at(size)
            if farther >= least:
                break
            least, best = farther, there
        return best, True

    def _kept_points(self, factor: Factor, right: FloatArray) -> FloatArray:
        """The step (free, 3) that ``right`` asks for and that moves no exact point."""
        step = factor.solve(right)
        if self._held:
            exact = ExactPoints(factor, self._points, tolerance=np.inf)
            step = exact.correct(step, np.zeros((3 * self._held, 1)))
        return step.reshape(-1, 3)
