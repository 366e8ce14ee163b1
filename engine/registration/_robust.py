"""Registration from any pose and power-of-ten unit, by the part of the face that did not move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.errors import RegistrationError
from engine.nearest import NormalAwareIndex
from engine.numbering import Numbering
from engine.operators import face_areas
from engine.registration._iterative import matching_rate
from engine.registration._poses import Poses, starting_poses
from engine.registration._refinement import Fit, Refinement
from engine.registration._samples import Samples, fair_areas, surface_samples
from engine.types import FloatArray, Mesh, Registration, Similarity

_SAMPLES = 2000  # per area of the source
_FEWEST, _MOST = 500, 6000
_REFINED = 1500
_TRIED = 500
_TRIAL_STEPS = 8
_RIVAL = 0.8  # poses with this share of the best one's overlap are tried as well
_TRIALS = 4
_LEAST_SHARE = 0.1  # of the smaller surface's area that must match
_FREE_SCALES = 1.2 ** np.arange(-4.0, 5.0)


def robust_registration(
    source: Mesh, target: Mesh, free_scale: bool, tolerance: float, max_iterations: int
) -> Registration:
    """See :func:`engine.registration.register`."""
    target = Numbering(target).mesh
    ours, theirs = _Sized.of(source, "source"), _Sized.of(target, "target")
    starts = [_Start.of(ours, theirs, scale) for scale in _scales(ours, theirs, free_scale)]
    start = max(starts, key=lambda start: start.poses.overlap[0])
    scaled = target.moved(start.target(target.vertices))
    refinement = Refinement(
        NormalAwareIndex(scaled, 0.1), start.samples.every(_REFINED), free_scale=free_scale
    )
    fit = refinement.run(
        _best_start(start, refinement), tolerance=tolerance, iterations=max_iterations
    )
    area = (start.target.scale * theirs.unit) ** 2  # of the target per the source's
    share = float(fit.met.mean()) / min(area, 1.0)
    if share < _LEAST_SHARE:
        raise RegistrationError(
            "the target does not fit the source in any pose; check that both show the same face, "
            "that their units differ by a power of ten (else allow a free scale), and that "
            "neither is inside out",
            code="no_fit",
            elements={"matched_share": share},
        )
    motion = _after(start.target.inverse(), _after(fit.motion, start.source))
    unturned = refinement.distances(Similarity(np.eye(3), np.zeros(3)))
    distances = np.array([unturned, *fit.distances])[:, fit.met]
    rms = ours.unit * np.sqrt((distances**2).mean(axis=1))
    return Registration(motion.inverse(), rms, matching_rate(rms), len(rms), fit.converged)


@dataclass(frozen=True, slots=True)
class _Sized:
    """A mesh with its centre, the square root of its area and its spread about the centre."""

    mesh: Mesh
    centre: FloatArray
    unit: float
    spread: float

    @classmethod
    def of(cls, mesh: Mesh, name: str) -> _Sized:
        if not face_areas(mesh).sum() > 0:
            raise RegistrationError(
                f"the {name} has no surface; register bare points with method='paper'",
                code="no_surface",
                elements={"face_count": len(mesh.faces)},
            )
        weights = fair_areas(mesh)
        places = mesh.vertices[mesh.faces].mean(axis=1)
        centre = np.average(places, axis=0, weights=weights)
        spread = float(np.sqrt(np.average(((places - centre) ** 2).sum(axis=1), weights=weights)))
        return cls(mesh, centre, float(np.sqrt(weights.sum())), spread)


@dataclass(frozen=True, slots=True)
class _Start:
    """Coarse poses between two meshes brought to unit size, and how each was brought there."""

    source: Similarity
    target: Similarity
    samples: Samples
    poses: Poses

    @classmethod
    def of(cls, ours: _Sized, theirs: _Sized, scale: float) -> _Start:
        source, target = _centred(ours, 1 / ours.unit), _centred(theirs, scale / ours.unit)
        area = (scale * theirs.unit / ours.unit) ** 2
        samples = surface_samples(ours.mesh.moved(source(ours.mesh.vertices)), _SAMPLES)
        count = int(np.clip(_SAMPLES * area, _FEWEST, _MOST))
        others = surface_samples(theirs.mesh.moved(target(theirs.mesh.vertices)), count)
        return cls(source, target, samples, starting_poses(samples, others, (1.0, area)))


def _centred(sized: _Sized, scale: float) -> Similarity:
    return Similarity(np.eye(3), -scale * sized.centre, scale)


def _after(second: Similarity, first: Similarity) -> Similarity:
    return Similarity(
        second.rotation @ first.rotation, second(first.translation), second.scale * first.scale
    )


def _scales(source: _Sized, target: _Sized, free_scale: bool) -> list[float]:
    """Factors from the target's unit to the source's that are worth trying."""
    ratio = source.spread / target.spread
    if free_scale:
        return [float(ratio * factor) for factor in _FREE_SCALES]
    exponent = np.log10(ratio)
    nearest = np.round(exponent)
    scales = [float(10.0**nearest)]
    if abs(exponent - nearest) > 0.35:  # the extents differ: a neighbouring unit is as likely
        scales.append(float(10.0 ** (nearest + np.sign(exponent - nearest))))
    return scales


def _best_start(start: _Start, refinement: Refinement) -> Similarity:
    """The most promising of the coarse poses, after a few trial steps where there are rivals."""
    rivals: list[Similarity] = []
    poses = start.poses
    for R, t, overlap in zip(poses.rotation, poses.translation, poses.overlap, strict=True):
        new = all(np.abs(R - other.rotation).max() > 0.1 for other in rivals)
        if new and overlap > _RIVAL * poses.overlap[0] and len(rivals) < _TRIALS:
            rivals.append(Similarity(R, t))
    if len(rivals) == 1:
        return rivals[0]
    trial = refinement.with_samples(start.samples.every(_TRIED))
    fits = [trial.run(pose, tolerance=0.0, iterations=_TRIAL_STEPS) for pose in rivals]
    return min(fits, key=_misfit).motion


def _misfit(fit: Fit) -> float:
    return fit.misfit
