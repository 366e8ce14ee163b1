"""Registration from any pose and power-of-ten unit, by the part of the face that did not move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from engine.errors import RegistrationError
from engine.nearest import Feet, NormalAwareIndex
from engine.registration._iterative import matching_rate
from engine.registration._poses import Poses, starting_poses
from engine.registration._samples import Samples, face_areas, surface_samples
from engine.types import FloatArray, Mesh, Registration, Similarity

_KEEP = 0.6  # share of the samples trusted to be rigid
_WIDTHS = (0.03, 0.0015)  # Geman-McClure kernel, in square roots of the source's area
_COOLING = 24
_AGREE = 0.6  # cosine between normals
_LEAST_FIT = 0.1


def robust_registration(
    source: Mesh, target: Mesh, free_scale: bool, tolerance: float, max_iterations: int
) -> Registration:
    """See :func:`engine.registration.register`."""
    unit = _size(source, "source")
    _size(target, "target")
    best: _Fit | None = None
    for scale in _scales(source, target, free_scale):
        fit = _fit(source, target, scale, unit, free_scale, tolerance, max_iterations)
        if best is None or fit.misfit < best.misfit:
            best = fit
    if best is None or best.share < _LEAST_FIT:
        raise RegistrationError(
            "the target does not fit the source in any pose; check that both show the same face, "
            "that their units differ by a power of ten at most (else allow a free scale), and "
            "that neither is inside out",
            code="no_fit",
            elements={"matched_share": best.share if best else 0.0},
        )
    rms = np.array(best.rms)
    return Registration(
        best.target_from_source.inverse(),
        rms,
        matching_rate(rms),
        len(rms),
        best.converged,
    )


def _size(mesh: Mesh, name: str) -> float:
    area = float(face_areas(mesh).sum()) if len(mesh.faces) else 0.0
    if area <= 0:
        raise RegistrationError(
            f"the {name} has no surface; register bare points with method='paper'",
            code="no_surface",
            elements={"face_count": len(mesh.faces)},
        )
    return float(np.sqrt(area))


def _spread(mesh: Mesh) -> float:
    """Root mean square distance of the surface from its centroid."""
    weights = face_areas(mesh)
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    centred = centres - np.average(centres, axis=0, weights=weights)
    return float(np.sqrt(np.average((centred**2).sum(axis=1), weights=weights)))


def _scales(source: Mesh, target: Mesh, free_scale: bool) -> list[float]:
    """Factors from the target's unit to the source's that are worth trying."""
    ratio = _spread(source) / _spread(target)
    exponent = np.log10(ratio)
    nearest = np.round(exponent)
    scales = [10.0**nearest]
    if abs(exponent - nearest) > 0.35:  # extents differ: a neighbouring unit is as likely
        scales.append(10.0 ** (nearest + np.sign(exponent - nearest)))
    if free_scale:
        scales.append(ratio)
    return [float(s) for s in scales]


@dataclass(frozen=True, slots=True)
class _Fit:
    """One refined alignment; ``misfit`` compares fits, ``share`` of samples that found a foot."""

    target_from_source: Similarity
    rms: tuple[float, ...]
    misfit: float
    share: float
    converged: bool


def _fit(
    source: Mesh,
    target: Mesh,
    scale: float,
    unit: float,
    free_scale: bool,
    tolerance: float,
    max_iterations: int,
) -> _Fit:
    scaled = target.moved(target.vertices * scale)
    moving = surface_samples(source, 1500)
    poses = starting_poses(moving, surface_samples(scaled, 2500), _spread(source))
    index = NormalAwareIndex(scaled, 0.1 * unit)
    centred = Similarity(
        np.eye(3), scaled.vertices.mean(axis=0) - source.vertices.mean(axis=0)
    )
    first = _rms(index, moving, centred)
    best: _Fit | None = None
    for start in _distinct(poses):
        refinement = _Refinement(index, moving, unit, free_scale)
        fit = refinement.run(start, tolerance, max_iterations)
        if best is None or fit.misfit < best.misfit:
            best = fit
    assert best is not None
    motion = best.target_from_source
    unscaled = Similarity(motion.rotation, motion.translation / scale, motion.scale / scale)
    return _Fit(unscaled, (first, *best.rms), best.misfit, best.share, best.converged)


def _distinct(poses: Poses) -> list[Similarity]:
    """The best pose and up to two others that differ from it and nearly fit as well."""
    chosen: list[Similarity] = []
    for R, t, misfit in zip(poses.rotation, poses.translation, poses.misfit, strict=True):
        new = all(np.abs(R - c.rotation).max() > 0.1 for c in chosen)
        if new and misfit < 1.3 * poses.misfit[0] and len(chosen) < 3:
            chosen.append(Similarity(R, t))
    return chosen


def _rms(index: NormalAwareIndex, moving: Samples, motion: Similarity) -> float:
    feet = index.feet(motion(moving.points), moving.normals @ motion.rotation.T)
    return float(np.sqrt((feet.distance**2).mean())) / motion.scale


class _Refinement:
    """Trimmed Geman-McClure point-to-plane steps with a shrinking kernel."""

    def __init__(
        self, index: NormalAwareIndex, moving: Samples, unit: float, free_scale: bool
    ) -> None:
        self.index = index
        self.moving = moving
        self.unit = unit
        self.free_scale = free_scale

    def run(self, start: Similarity, tolerance: float, max_iterations: int) -> _Fit:
        motion, rms, converged = start, [], False
        wide, narrow = (w * self.unit for w in _WIDTHS)
        while len(rms) < max_iterations and not converged:
            width = wide * (narrow / wide) ** min(len(rms) / (_COOLING - 1), 1.0)
            X, feet, weights = self._weigh(motion, width)
            if np.count_nonzero(weights) < 6:
                break
            step = _point_to_plane(X, feet, weights, self.free_scale)
            motion = Similarity(
                step.rotation @ motion.rotation, step(motion.translation), step.scale * motion.scale
            )
            rms.append(float(np.sqrt((feet.distance**2).mean())) / motion.scale)
            moved = float(np.linalg.norm(step(X) - X, axis=1).max())
            converged = len(rms) >= _COOLING and moved < tolerance * narrow
        X, feet, weights = self._weigh(motion, narrow)
        rms.append(float(np.sqrt((feet.distance**2).mean())) / motion.scale)
        found = self._compatible(motion, feet)
        share = float(found.mean())
        robust = np.where(found, np.minimum(feet.distance, wide), wide).mean()
        return _Fit(motion, tuple(rms), float(robust), share, converged)

    def _compatible(self, motion: Similarity, feet: Feet) -> np.ndarray:
        normals = self.moving.normals @ motion.rotation.T
        agree = np.einsum("ki,ki->k", normals, feet.normal) > _AGREE
        return agree & ~feet.on_border & (feet.distance < 0.1 * self.unit)

    def _weigh(self, motion: Similarity, width: float) -> tuple[FloatArray, Feet, FloatArray]:
        X = motion(self.moving.points)
        feet = self.index.feet(X, self.moving.normals @ motion.rotation.T)
        normals = self.moving.normals @ motion.rotation.T
        agree = np.einsum("ki,ki->k", normals, feet.normal) > _AGREE
        trusted = agree & ~feet.on_border
        if not trusted.any():
            return X, feet, np.zeros(len(X))
        limit = np.quantile(feet.distance[trusted], _KEEP)
        r = np.einsum("ki,ki->k", X - feet.position, feet.normal)
        return X, feet, trusted * (feet.distance <= limit) / (1 + (r / width) ** 2) ** 2


def _point_to_plane(
    X: FloatArray, feet: Feet, weights: FloatArray, free_scale: bool
) -> Similarity:
    """The small motion that best brings ``X`` onto the planes at its feet (linearised)."""
    n = feet.normal
    origin = np.average(X, axis=0, weights=weights)
    columns = [np.cross(X - origin, n), n]
    if free_scale:
        columns.append(np.einsum("ki,ki->k", X - origin, n)[:, None])
    J = np.hstack(columns)
    r = np.einsum("ki,ki->k", feet.position - X, n)
    H = (J * weights[:, None]).T @ J
    # scaled by the diagonal so that the damping means the same in every unit
    D = np.sqrt(np.maximum(np.diag(H), 1e-300))
    step = np.linalg.solve(H / np.outer(D, D) + 1e-9 * np.eye(len(H)), (J * weights[:, None]).T @ r / D) / D
    R = Rotation.from_rotvec(step[:3]).as_matrix()
    scale = float(np.exp(step[6])) if free_scale else 1.0
    return Similarity(R, origin + step[3:6] - scale * (R @ origin), scale)
