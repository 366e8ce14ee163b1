"""Which two points of a loop are the corners that a slit had before it opened."""

from __future__ import annotations

import numpy as np

from engine.correspondence._curves import ClosedCurve
from engine.types import FloatArray

_SAMPLES = 300
_REACH = 0.12  # of the length: over how much a turn is measured, longer than a rim's jags
_TURN = 0.3  # weight of the turning: round mouths have sharper turns elsewhere
_BALANCE = 0.5  # weight against a change of the two lips' shares of the length
_ALIKE = 0.05  # difference of scores by which one pair hardly stands out against another


def opened_corners(goal: ClosedCurve, axis: FloatArray, share: float) -> tuple[float, float]:
    """Arc lengths of both corners on ``goal``, that along ``axis`` first.

    A pair is the better the farther out it lies along the axis in both directions, the more the
    curve turns there, and the nearer the way from the first to the second is to the ``share`` of
    the length that it had: squared change of its log-odds. On the round end of a mouth many pairs
    are nearly as good as the best, and jags of the rim pick one: the mean of the good ones stays.
    """
    t, extent, turning = goal.slit_evidence(axis, _SAMPLES, _REACH)
    between = np.mod(t[None, :] - t[:, None], goal.length) / goal.length
    change = _log_odds(between) - _log_odds(np.array(share))
    single = extent + _TURN * turning, _TURN * turning - extent
    score = single[0][:, None] + single[1][None, :] - _BALANCE * change**2
    likely = np.exp((score - score.max()) / _ALIKE)
    return _mean_along(goal, t, likely.sum(axis=1)), _mean_along(goal, t, likely.sum(axis=0))


def _mean_along(curve: ClosedCurve, t: FloatArray, weight: FloatArray) -> float:
    """The mean of arc lengths ``t`` (k,) on a closed curve, as directions are averaged."""
    turn = 2 * np.pi / curve.length
    return float(np.angle(weight @ np.exp(1j * turn * t)) / turn % curve.length)


def _log_odds(share: FloatArray) -> FloatArray:
    kept = np.clip(share, 1e-3, 1 - 1e-3)
    return np.log(kept / (1 - kept))


def slit_parameters(
    source: ClosedCurve, target: ClosedCurve, at: FloatArray, *, power: float = 1.0
) -> FloatArray:
    """The target's arc lengths for the source's ``at`` (m,): corner to corner.

    What a lip has become longer by goes with the ``power`` of the way from its middle to its
    corners: 1 stretches it evenly.
    """
    axis = source.principal_axis()
    s1, s2 = source.corners(axis)
    s2 += source.length * (s2 < s1)
    t1, t2 = opened_corners(target, axis, (s2 - s1) / source.length)
    t2 += target.length * (t2 < t1)
    turned = np.mod(at - s1, source.length) + s1
    lip = (turned > s2).astype(np.int64)
    start, end = np.array([s1, s2]), np.array([s2, s1 + source.length])
    begin, stop = np.array([t1, t2]), np.array([t2, t1 + target.length])
    before, after = (end - start)[lip], (stop - begin)[lip]
    x = 2 * (turned - start[lip]) / before - 1
    y = _towards_corners(x, np.maximum(1 - before / after, 0.0), power)
    parameters: FloatArray = begin[lip] + (y + 1) / 2 * after
    return parameters


def lengthened(
    at: FloatArray, corners: FloatArray, lengths: tuple[float, float], *, power: float
) -> FloatArray:
    """Where arc lengths ``at`` (m,) of a piece of a rim go as its length goes from one to another.

    What it has become longer by goes with the ``power`` of the way to its ``corners`` (k,), from
    the middle between two of them or from where the piece ends.
    """
    before, after = lengths
    if not len(corners):
        return at * (after / before)
    knots = np.concatenate(([0.0], corners, [before]))
    low = np.concatenate(([0.0], np.full(len(corners), -1.0)))
    high = np.concatenate((np.full(len(corners), 1.0), [0.0]))
    part = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(corners))
    least, most = low[part], high[part]
    gap = np.maximum(np.diff(knots)[part], 1e-300)
    x = least + (at - knots[part]) / gap * (most - least)
    y = _towards_corners(x, max(1 - before / after, 0.0), power)
    moved: FloatArray = (knots[part] + (y - least) / (most - least) * gap) * (after / before)
    return moved


def _towards_corners(x: FloatArray, longer: FloatArray | float, power: float) -> FloatArray:
    """Where ``x`` (m,) goes, 0 in the middle of a lip and -1 and 1 at its corners.

    ``longer`` is the share of the new length that was not there.
    """
    y: FloatArray = (1 - longer) * x + longer * np.sign(x) * np.abs(x) ** power
    return y
