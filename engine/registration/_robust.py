"""Registration from any pose and power-of-ten unit, by the part of the face that did not move."""

from __future__ import annotations

import numpy as np

from engine.errors import RegistrationError
from engine.nearest import NormalAwareIndex
from engine.operators import face_areas
from engine.registration._iterative import matching_rate
from engine.registration._poses import Poses, starting_poses
from engine.registration._refinement import Fit, Refinement
from engine.registration._samples import surface_samples
from engine.types import Mesh, Registration, Similarity

_SAMPLES = 1500
_TRIAL_STEPS = 8
_LEAST_SHARE = 0.1


def robust_registration(
    source: Mesh, target: Mesh, free_scale: bool, tolerance: float, max_iterations: int
) -> Registration:
    """See :func:`engine.registration.register`."""
    unit = _size(source, "source")
    _size(target, "target")
    fits: list[Fit] = []
    for scale in _scales(source, target, free_scale):
        start, refinement = _best_start(source, target, scale, unit, free_scale)
        fit = refinement.run(start, tolerance=tolerance, iterations=max_iterations)
        fits.append(_unscaled(fit, scale, refinement.rms(_centring(source, target, scale))))
    best = min(fits, key=lambda fit: fit.misfit)
    if best.share < _LEAST_SHARE:
        raise RegistrationError(
            "the target does not fit the source in any pose; check that both show the same face, "
            "that their units differ by a power of ten (else allow a free scale), and that "
            "neither is inside out",
            code="no_fit",
            elements={"matched_share": best.share},
        )
    rms = np.array(best.rms)
    return Registration(best.motion.inverse(), rms, matching_rate(rms), len(rms), best.converged)


def _size(mesh: Mesh, name: str) -> float:
    area = float(face_areas(mesh).sum())
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
    if abs(exponent - nearest) > 0.35:  # the extents differ: a neighbouring unit is as likely
        scales.append(10.0 ** (nearest + np.sign(exponent - nearest)))
    if free_scale:
        scales.append(ratio)
    return [float(scale) for scale in scales]


def _centring(source: Mesh, target: Mesh, scale: float) -> Similarity:
    shift = scale * target.vertices.mean(axis=0) - source.vertices.mean(axis=0)
    return Similarity(np.eye(3), shift)


def _best_start(
    source: Mesh, target: Mesh, scale: float, unit: float, free_scale: bool
) -> tuple[Similarity, Refinement]:
    """The most promising pose of the source on the scaled target after a few trial steps."""
    scaled = target.moved(target.vertices * scale)
    samples = surface_samples(source, _SAMPLES)
    poses = starting_poses(samples, surface_samples(scaled, 2500), _spread(source))
    index = NormalAwareIndex(scaled, 0.1 * unit)
    refinement = Refinement(index, samples, unit, free_scale=free_scale)
    starts = _distinct(poses)
    if len(starts) == 1:
        return starts[0], refinement
    coarse = Refinement(index, samples.every(_SAMPLES // 3), unit, free_scale=False)
    trials = [coarse.run(s, tolerance=0.0, iterations=_TRIAL_STEPS) for s in starts]
    return min(trials, key=lambda fit: fit.misfit).motion, refinement


def _distinct(poses: Poses) -> list[Similarity]:
    """The best pose and up to two others that differ from it and fit nearly as well."""
    chosen: list[Similarity] = []
    for R, t, misfit in zip(poses.rotation, poses.translation, poses.misfit, strict=True):
        new = all(np.abs(R - other.rotation).max() > 0.1 for other in chosen)
        if new and misfit < 1.3 * poses.misfit[0] and len(chosen) < 3:
            chosen.append(Similarity(R, t))
    return chosen


def _unscaled(fit: Fit, scale: float, first_rms: float) -> Fit:
    """The fit to the target in its own unit; E_R(1) is that of the centred, unturned source."""
    motion = Similarity(
        fit.motion.rotation, fit.motion.translation / scale, fit.motion.scale / scale
    )
    return Fit(motion, (first_rms, *fit.rms), fit.misfit, fit.share, fit.converged)
