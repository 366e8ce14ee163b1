"""Which two points of a loop are the corners that a slit had before it opened."""

from __future__ import annotations

import numpy as np

from engine.correspondence._curves import ClosedCurve
from engine.types import FloatArray

_SAMPLES = 300
_REACH = 0.12  # of the length: over how much a turn is measured, longer than a rim's jags
_TURN = 0.3  # weight of the turning: round mouths have sharper turns elsewhere
_BALANCE = 0.5  # weight against a change of the two lips' shares of the length


def opened_corners(goal: ClosedCurve, axis: FloatArray, share: float) -> tuple[float, float]:
    """Arc lengths of both corners on ``goal``, that along ``axis`` first.

    Among all pairs the one that lies farthest out along the axis in both directions, where the
    curve turns, and that leaves the way from the first to the second near the ``share`` of the
    length that it had: squared change of its log-odds.
    """
    t, extent, turning = goal.slit_evidence(axis, _SAMPLES, _REACH)
    between = np.mod(t[None, :] - t[:, None], goal.length) / goal.length
    change = _log_odds(between) - _log_odds(np.array(share))
    single = extent + _TURN * turning, _TURN * turning - extent
    score = single[0][:, None] + single[1][None, :] - _BALANCE * change**2
    first, second = np.unravel_index(int(np.argmax(score)), score.shape)
    return float(t[first]), float(t[second])


def _log_odds(share: FloatArray) -> FloatArray:
    kept = np.clip(share, 1e-3, 1 - 1e-3)
    return np.log(kept / (1 - kept))


def slit_parameters(source: ClosedCurve, target: ClosedCurve, at: FloatArray) -> FloatArray:
    """The target's arc lengths for the source's ``at`` (m,): corner to corner, evenly between."""
    axis = source.principal_axis()
    s1, s2 = source.corners(axis)
    s2 += source.length * (s2 < s1)
    t1, t2 = opened_corners(target, axis, (s2 - s1) / source.length)
    t2 += target.length * (t2 < t1)
    turned = np.mod(at - s1, source.length) + s1
    return np.interp(turned, [s1, s2, s1 + source.length], [t1, t2, t1 + target.length])
