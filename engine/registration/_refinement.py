"""Trimmed Geman-McClure point-to-plane steps with a shrinking kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from engine.nearest import Feet, NormalAwareIndex
from engine.registration._samples import Samples
from engine.types import BoolArray, FloatArray, Similarity

_KEEP = 0.6  # share of the samples trusted to be rigid
# lengths are in square roots of the source's area
_WIDE, _NARROW = 0.03, 0.0015  # robust kernel
_COOLING = 16
_AGREE = 0.6  # cosine between normals
_DRIFT = 1.1  # a refinement that fits this much worse than its start is dropped
_SMALL = 0.005  # after shorter steps the feet are looked for beside the last ones
_STEP = 0.01  # a step shorter than the tolerance times this is the last
_REACH = 0.1  # farther feet are no match


@dataclass(frozen=True, slots=True)
class Fit:
    """An alignment ``motion`` of samples with a surface.

    ``distances`` (k,) of the samples from their feet after each iteration, in the samples' unit;
    ``met`` (k,): which samples found a compatible foot; ``misfit``, robust, compares alignments.
    """

    motion: Similarity
    distances: tuple[FloatArray, ...]
    met: BoolArray
    misfit: float
    converged: bool


@dataclass(frozen=True, slots=True)
class _State:
    """The moved samples, their feet, and which of these are compatible."""

    points: FloatArray
    feet: Feet
    compatible: BoolArray


class Refinement:
    """``samples`` of a surface of unit area on the surface behind ``index``."""

    def __init__(self, index: NormalAwareIndex, samples: Samples, *, free_scale: bool) -> None:
        self._index = index
        self._samples = samples
        self._free_scale = free_scale

    def with_samples(self, samples: Samples) -> Refinement:
        """The same task on other samples, at a fixed scale."""
        return Refinement(self._index, samples, free_scale=False)

    def distances(self, motion: Similarity) -> FloatArray:
        """How far the samples (k,) are from their feet under ``motion``, in their own unit."""
        return self._state(motion).feet.distance / motion.scale

    def run(self, start: Similarity, *, tolerance: float, iterations: int) -> Fit:
        """Refine ``start``; ends when a step is shorter than ``tolerance`` / 100."""
        motion, converged, steps = start, False, 0
        state = self._state(motion)
        first = self._misfit(state)
        distances: list[FloatArray] = []
        while steps < iterations and not converged:
            cooled = min(steps / (_COOLING - 1), 1.0)
            weights = self._weights(state, _WIDE * (_NARROW / _WIDE) ** cooled)
            if np.count_nonzero(weights) < 6:
                break
            step = point_to_plane_step(state.points, state.feet, weights, self._free_scale)
            shift = np.linalg.norm(step(state.points) - state.points, axis=1).max()
            motion = _after(step, motion)
            converged = cooled == 1.0 and bool(shift < tolerance * _STEP)
            state = self._state(motion, state if shift < _SMALL else None)
            distances.append(state.feet.distance / motion.scale)
            steps += 1
        if self._misfit(state) > _DRIFT * first:  # the trimmed steps ran off along the surface
            motion, state, converged = start, self._state(start), False
            distances.append(state.feet.distance / motion.scale)
        return Fit(motion, tuple(distances), state.compatible, self._misfit(state), converged)

    def _misfit(self, state: _State) -> float:
        near = np.minimum(state.feet.distance, _WIDE)
        return float(np.where(state.compatible, near, _WIDE).mean())

    def _state(self, motion: Similarity, before: _State | None = None) -> _State:
        points = motion(self._samples.points)
        normals = self._samples.normals @ motion.rotation.T
        if before is None:
            feet = self._index.feet(points, normals)
        else:
            feet = self._index.feet_beside(points, before.feet)
        agree = np.einsum("ki,ki->k", normals, feet.normal) > _AGREE
        near = feet.distance < _REACH
        return _State(points, feet, agree & ~feet.on_border & near)

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
