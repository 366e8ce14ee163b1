"""Trimmed Geman-McClure point-to-plane steps with a shrinking kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from engine.nearest import Feet, NormalAwareIndex
from engine.registration._samples import Samples
from engine.types import BoolArray, FloatArray, Similarity

_KEEP = 0.6  # share of the samples trusted to be rigid
_WIDE, _NARROW = 0.03, 0.0015  # robust kernel, in square roots of the source's area
_COOLING = 24
_AGREE = 0.6  # cosine between normals
_DRIFT = 1.3  # a refinement that fits this much worse than its start is dropped
_REACH = 0.1  # beyond this many square roots of the area a foot is no match


@dataclass(frozen=True, slots=True)
class Fit:
    """An alignment ``motion`` of samples with a surface.

    ``rms`` per iteration over all samples; ``misfit``, robust, compares alignments; ``share`` of
    the samples that found a compatible foot.
    """

    motion: Similarity
    rms: tuple[float, ...]
    misfit: float
    share: float
    converged: bool


@dataclass(frozen=True, slots=True)
class _State:
    """The moved samples, their feet, and which of these are compatible."""

    points: FloatArray
    feet: Feet
    compatible: BoolArray
    rms: float


class Refinement:
    """``samples`` of a surface with area ``unit``² on the surface behind ``index``."""

    def __init__(
        self, index: NormalAwareIndex, samples: Samples, unit: float, *, free_scale: bool
    ) -> None:
        self._index = index
        self._samples = samples
        self._unit = unit
        self._free_scale = free_scale

    def rms(self, motion: Similarity) -> float:
        """E_R, eq. (4), of the samples under ``motion``, in their own unit."""
        return self._state(motion).rms

    def run(self, start: Similarity, *, tolerance: float, iterations: int) -> Fit:
        """Refine ``start``; ends when a step is shorter than ``tolerance`` narrow kernels."""
        motion, converged, rms = start, False, list[float]()
        state = self._state(motion)
        first = self._misfit(state)
        while len(rms) < iterations and not converged:
            cooled = min(len(rms) / (_COOLING - 1), 1.0)
            weights = self._weights(state, self._unit * _WIDE * (_NARROW / _WIDE) ** cooled)
            if np.count_nonzero(weights) < 6:
                break
            step = point_to_plane_step(state.points, state.feet, weights, self._free_scale)
            shift = np.linalg.norm(step(state.points) - state.points, axis=1).max()
            motion = _after(step, motion)
            converged = cooled == 1.0 and bool(shift < tolerance * _NARROW * self._unit)
            state = self._state(motion)
            rms.append(state.rms)
        if self._misfit(state) > _DRIFT * first:  # the trimmed steps ran off along the surface
            motion, state, converged = start, self._state(start), False
            rms.append(state.rms)
        share = float(state.compatible.mean())
        return Fit(motion, tuple(rms), self._misfit(state), share, converged)

    def _misfit(self, state: _State) -> float:
        far = _WIDE * self._unit
        return float(np.where(state.compatible, np.minimum(state.feet.distance, far), far).mean())

    def _state(self, motion: Similarity) -> _State:
        points = motion(self._samples.points)
        normals = self._samples.normals @ motion.rotation.T
        feet = self._index.feet(points, normals)
        agree = np.einsum("ki,ki->k", normals, feet.normal) > _AGREE
        near = feet.distance < _REACH * self._unit
        rms = float(np.sqrt((feet.distance**2).mean())) / motion.scale
        return _State(points, feet, agree & ~feet.on_border & near, rms)

    def _weights(self, state: _State, width: float) -> FloatArray:
        if not state.compatible.any():
            return np.zeros(len(state.points))
        distance = state.feet.distance
        trusted = state.compatible & (distance <= np.quantile(distance[state.compatible], _KEEP))
        r = np.einsum("ki,ki->k", state.points - state.feet.position, state.feet.normal)
        return trusted / (1 + (r / width) ** 2) ** 2


def _after(second: Similarity, first: Similarity) -> Similarity:
    return Similarity(
        second.rotation @ first.rotation, second(first.translation), second.scale * first.scale
    )


def point_to_plane_step(
    points: FloatArray, feet: Feet, weights: FloatArray, free_scale: bool
) -> Similarity:
    """The small motion that best brings ``points`` onto the planes at their feet (linearised)."""
    origin = np.average(points, axis=0, weights=weights)
    arm, n = points - origin, feet.normal
    columns = [np.cross(arm, n), n]
    if free_scale:
        columns.append(np.einsum("ki,ki->k", arm, n)[:, None])
    J = np.hstack(columns)
    r = np.einsum("ki,ki->k", feet.position - points, n)
    H, g = (J * weights[:, None]).T @ J, (J * weights[:, None]).T @ r
    # scaled by the diagonal, so that the damping means the same in every unit
    d = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    step = d * np.linalg.solve(H * np.outer(d, d) + 1e-9 * np.eye(len(H)), d * g)
    R = Rotation.from_rotvec(step[:3]).as_matrix()
    scale = float(np.exp(step[6])) if free_scale else 1.0
    return Similarity(R, origin + step[3:6] - scale * (R @ origin), scale)
