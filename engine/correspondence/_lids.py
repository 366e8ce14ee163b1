"""Where the edges of lids go when they close."""

from __future__ import annotations

import numpy as np

from engine.correspondence._curves import ClosedCurve
from engine.types import FloatArray, IntArray


def across_parameters(edge: ClosedCurve, goal: ClosedCurve) -> FloatArray:
    """The arc lengths (k,) on ``goal`` to which the points of an ``edge`` go.

    Lids close across the eye: each point of either lid goes to where the goal's same lid is as far
    along the axis of the eye. Both curves run the same way around, aligned.
    """
    axis = edge.principal_axis()
    ours, theirs = edge.points @ axis, goal.points @ axis
    ends = int(ours.argmin()), int(ours.argmax())
    goals = int(theirs.argmin()), int(theirs.argmax())
    parameters = np.empty(len(ours))
    for sign, here, there in ((1.0, ends, goals), (-1.0, ends[::-1], goals[::-1])):
        lid, arc = _arc(len(ours), *here), _arc(len(theirs), *there)
        along = np.maximum.accumulate(sign * theirs[arc])
        t = goal.parameters[arc] + goal.length * (arc < arc[0])
        parameters[lid] = np.interp(sign * ours[lid], along, t)
    return parameters


def _arc(count: int, first: int, last: int) -> IntArray:
    """The points of a closed curve of ``count`` from the ``first`` to the ``last``."""
    return np.arange(first, last + count * (last <= first) + 1) % count
