"""Rigid motions of the skin: one around each body, and the two of skull and jaw.

Rotations (b, 3, 3) come with centroids before and after, (b, 3) each.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from engine.types import FloatArray, IntArray

Motions = tuple[FloatArray, FloatArray, FloatArray]

ROUNDS = 10

FIRMNESS = 1e-12
"""Relative resistance to turns: decides only where the skin points leave a turn open."""

EXACT = 1e-9
"""Residuals, as a share of the extent, below which a fit is exact."""

COARSE, FINE = 1.0, 0.3
"""Residuals that count half in the first and last round for a second motion, as shares of how far
skin moves."""

EXPLAINED = 0.2
"""The same for what says that a motion is a body's own."""

DOUBTFUL, SURE = 0.02, 0.08
"""Shares of the skin next to a body that must follow the second motion: none of it is believed
below the one, all above the other."""


def moved(motions: Motions, body: IntArray, points: FloatArray) -> FloatArray:
    """``points`` (n, 3) moved by the motions of their ``body`` (n,)."""
    rotation, old, new = motions
    return np.einsum("vij,vj->vi", rotation[body], points - old[body]) + new[body]


def robust_motions(
    old: FloatArray, new: FloatArray, weight: FloatArray, start: IntArray
) -> Motions:
    """One motion for each run of points, by reweighting (Geman and McClure).

    The points of body i begin at ``start[i]``. The scale of the residuals that count is their own
    weighted root mean square, so nothing depends on units and everything on ``new`` smoothly.
    """
    owner = np.repeat(np.arange(len(start)), np.diff(start, append=len(old)))
    least = EXACT**2 * max(float((np.ptp(old, axis=0) ** 2).sum()), np.finfo(float).tiny)
    robust = weight
    for _ in range(ROUNDS):
        motions = _fitted(old, new, robust, start, owner)
        square = ((moved(motions, owner, old) - new) ** 2).sum(axis=1)
        total = np.add.reduceat(robust, start)
        scale = np.add.reduceat(robust * square, start) / total
        robust = weight / (1 + square / np.maximum(scale, least)[owner]) ** 2
    return _fitted(old, new, robust, start, owner)


def _fitted(
    old: FloatArray, new: FloatArray, weight: FloatArray, start: IntArray, owner: IntArray
) -> Motions:
    """Weighted Procrustes fits (Kabsch 1976); turns that the points leave open are not made."""
    total = np.add.reduceat(weight, start)[:, None]
    centre_old = np.add.reduceat(weight[:, None] * old, start) / total
    centre_new = np.add.reduceat(weight[:, None] * new, start) / total
    x, y = old - centre_old[owner], new - centre_new[owner]
    products = (weight[:, None] * y)[:, :, None] * x[:, None, :]
    covariance = np.add.reduceat(products, start)
    size = np.add.reduceat(weight * (x**2).sum(axis=1), start)
    covariance += FIRMNESS * np.where(size > 0, size, 1)[:, None, None] * np.eye(3)
    u, _, vt = np.linalg.svd(covariance)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return u @ vt, centre_old, centre_new


def two_motions(
    old: FloatArray, new: FloatArray, weight: FloatArray, near: FloatArray
) -> tuple[Motions, Motions, float] | None:
    """What most of the skin does, and what moves most of the rest ``near`` (k,) the bodies.

    With them how far the rest moves, root mean square; None when there is no rest.
    """
    start, owner = np.zeros(1, dtype=np.int64), np.zeros(len(old), dtype=np.int64)
    first = robust_motions(old, new, weight, start)
    square = ((moved(first, owner, old) - new) ** 2).sum(axis=1)
    beside = weight * near
    total = float(beside @ square) / float(beside.sum())
    if total <= np.finfo(float).eps * float((np.ptp(old, axis=0) ** 2).sum()):
        return None
    rest = beside * square**2 / (square**2 + (4 * total) ** 2)
    second, robust = first, rest
    for share in np.geomspace(COARSE, FINE, ROUNDS):
        second = _fitted(old, new, robust, start, owner)
        off = ((moved(second, owner, old) - new) ** 2).sum(axis=1)
        robust = rest / (1 + off / (share**2 * total)) ** 2
    return first, second, float(np.sqrt(total))


def belongs(
    first: FloatArray, second: FloatArray, reach: float, closeness: FloatArray, start: IntArray
) -> FloatArray:
    """How far (b,), from 0 to 1, the skin next to each body says that the second motion is its own.

    ``first``, ``second`` (k,) are the motions' residuals, ``closeness`` (k,) sums to 1 per body.
    """
    by_first, by_second = (
        np.add.reduceat(closeness / (1 + (off / (EXPLAINED * reach)) ** 2) ** 2, start)
        for off in (first, second)
    )
    share = np.clip((by_second - DOUBTFUL) / (SURE - DOUBTFUL), 0.0, 1.0)
    both = by_first**2 + by_second**2
    ratio = np.divide(by_second**2, both, out=np.zeros_like(both), where=both > 0)
    return share**2 * (3 - 2 * share) * ratio


def between(motions: Motions, other: Motions, share: FloatArray) -> Motions:
    """Motions (b,) on the way to the one ``other``, ``share`` (b,) of it."""
    rotation, old, new = motions
    ends = moved(other, np.zeros(len(old), dtype=np.int64), old)
    turn = Rotation.from_matrix(np.swapaxes(rotation, 1, 2) @ other[0]).as_rotvec()
    partly = Rotation.from_rotvec(share[:, None] * turn).as_matrix()
    return rotation @ partly, old, new + share[:, None] * (ends - new)
