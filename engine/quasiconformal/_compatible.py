"""A cheap check, before any map, for control points whose targets contradict their neighbours'."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, QhullError

from engine.beltrami import orientations
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray

_LEAST_RATIO = 0.02  # of a triangle's area that must be left, relative to the median ratio
_FLAT = 1e-3  # doubled area over longest edge squared below which three points are on a line


def compatible_points(points: ComplexArray, targets: ComplexArray, trusted: BoolArray) -> BoolArray:
    """Which control points (c,) to keep so that their Delaunay triangles stay upright.

    ``points`` and ``targets`` (c,) are plane positions, those of a constrained boundary among
    them; ``trusted`` (c,) points are never dropped. A triangle of the Delaunay triangulation of
    ``points`` that the targets turn over, or shrink to less than 1/50 of what is usual, is a
    contradiction, unless it ends up nearly on a line, where a curved map may well bring it; the
    point in most of them goes first, of equals the one whose displacement
    differs most from its neighbours', until none is left that an untrusted point could end.

    It is neither necessary nor sufficient for a fold-free map: a hint for noisy correspondences.
    """
    keep = np.ones(len(points), np.bool_)
    while True:
        at = np.flatnonzero(keep)
        triangles = _triangles(points[at])
        bad = triangles[_contradicts(points[at], targets[at], triangles)]
        votes = np.bincount(bad.ravel(), minlength=len(at))
        votes[trusted[at]] = 0
        if not votes.any():
            return keep
        oddness = _oddness(targets[at] - points[at], triangles)
        candidates = np.lexsort((oddness, votes))[::-1]
        blocked = np.zeros(len(at), np.bool_)
        for point in candidates[votes[candidates] > 0]:
            if not blocked[point]:
                keep[at[point]] = False
                touched = triangles[(triangles == point).any(axis=1)]
                blocked[touched.ravel()] = True


def _triangles(points: ComplexArray) -> IntArray:
    """Delaunay triangles, counter-clockwise; none when there is no triangulation."""
    if len(points) < 3:
        return np.zeros((0, 3), np.int64)
    try:
        simplices = Delaunay(np.stack([points.real, points.imag], axis=1)).simplices
    except QhullError:  # all points on a line
        return np.zeros((0, 3), np.int64)
    triangles = simplices.astype(np.int64)
    sign = orientations(points[triangles])
    triangles[sign < 0] = triangles[sign < 0][:, ::-1]
    return triangles[sign != 0]


def _contradicts(points: ComplexArray, targets: ComplexArray, triangles: IntArray) -> BoolArray:
    if not len(triangles):
        return np.zeros(0, np.bool_)
    corners = targets[triangles]
    after = _doubled_areas(corners)
    ratio = after / _doubled_areas(points[triangles])
    shrunk = ratio <= _LEAST_RATIO * max(float(np.median(ratio)), 0.0)
    longest = np.abs(corners - np.roll(corners, 1, axis=1)).max(axis=1)
    return shrunk & (np.abs(after) >= _FLAT * longest**2)


def _doubled_areas(corners: ComplexArray) -> FloatArray:
    return np.imag(np.conj(corners[:, 1] - corners[:, 0]) * (corners[:, 2] - corners[:, 0]))


def _oddness(displacement: ComplexArray, triangles: IntArray) -> FloatArray:
    """How far each point's displacement is from the mean of its neighbours'."""
    one = triangles[:, [0, 1, 2, 0, 1, 2]].ravel()
    other = triangles[:, [1, 2, 0, 2, 0, 1]].ravel()
    count = np.maximum(np.bincount(one, minlength=len(displacement)), 1)
    real = np.bincount(one, displacement[other].real, len(displacement)) / count
    imaginary = np.bincount(one, displacement[other].imag, len(displacement)) / count
    return np.abs(displacement - (real + 1j * imaginary))
