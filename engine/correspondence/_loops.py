"""Which boundary loops of two surfaces correspond, and where their points go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from engine.correspondence._corners import slit_parameters
from engine.correspondence._curves import ClosedCurve
from engine.correspondence._lids import across_parameters
from engine.types import BoolArray, FloatArray, IntArray, Mesh

LEAST_VERTICES = 8  # of a loop that may be an opening of the face
_INNER_GAP = 0.15  # centroids of paired inner loops are at most this far apart
_INNER_RATIO = (0.5, 2.4)
_OUTER_GAP = 0.15  # paired outer loops are nowhere (95 %) farther apart
_OUTER_RATIO = (0.75, 1.35)
# Power of the way to a corner with which a cavity's rim gets longer: a sharp one, and others.
_AT_CORNERS, BEYOND_CORNERS = 3.0, 8.0
_SLIT = 0.2  # openness below which a cavity's lips touch


@dataclass(frozen=True, slots=True, eq=False)
class LoopPair:
    """A source loop ``vertices`` (k,) that follows the ``curve`` of the target's loop ``goal``.

    ``parameters`` (k,) fix where each vertex goes; None lets the loop slide to closest points.
    A ``sharp`` one is a line where lips touch on both sides, known better than other rims.
    ``trust`` (k,) in [0, 1] falls where the rim of a cavity got longer. That of a ``lid`` that
    closes has only the vertices on the lid's edge.
    """

    vertices: IntArray
    goal: IntArray
    curve: ClosedCurve
    parameters: FloatArray | None
    sharp: bool
    trust: FloatArray
    lid: bool = False

    @property
    def slides(self) -> bool:
        """Whether its vertices go to closest points of the curve instead of fixed ones."""
        return self.parameters is None

    def goals(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (k, 3) on the curve for the loop at ``positions`` (k, 3), and tangents there."""
        t = self.curve.project(positions) if self.parameters is None else self.parameters
        return self.curve.at(t), self.curve.tangent(t)

    def restricted(self, number: IntArray) -> LoopPair:
        """The same pair on a mesh where vertex v is called ``number``[v], or -1 if it is gone."""
        kept = number[self.vertices] >= 0
        t = None if self.parameters is None else self.parameters[kept]
        vertices, trust = number[self.vertices[kept]], self.trust[kept]
        return LoopPair(vertices, self.goal, self.curve, t, self.sharp, trust, self.lid)


def pair_loops(
    source: Mesh,
    source_loops: Sequence[IntArray],
    target: Mesh,
    target_loops: Sequence[IntArray],
    *,
    rims: bool = False,
    edges: BoolArray | None = None,
) -> tuple[LoopPair, ...]:
    """Corresponding loops of two aligned surfaces; lengths in square roots of the source's area.

    The outer loops (first) slide along each other where they nearly coincide; inner loops are
    paired by their centroids and matched from corner to corner. ``rims`` of cavities are no lines
    of the skin: where one gets longer it goes on into what was the fold of its corners, so the
    middle keeps its length, and the more a part has to stretch the less it is trusted. ``edges``
    (n,) are the source's vertices on the edges of lids that close.
    """
    ours = [loop for loop in source_loops if len(loop) >= LEAST_VERTICES]
    theirs = [loop for loop in target_loops if len(loop) >= LEAST_VERTICES]
    if not ours or not theirs:
        return ()
    curves = [ClosedCurve(source.vertices[loop]) for loop in ours]
    goals = [ClosedCurve(target.vertices[loop]) for loop in theirs]
    a = int(np.argmax([curve.length for curve in curves]))
    b = int(np.argmax([curve.length for curve in goals]))
    pairs: list[LoopPair] = []
    if _coincide(curves[a], goals[b]):
        pairs.append(LoopPair(ours[a], theirs[b], goals[b], None, False, np.ones(len(ours[a]))))
    inner = [k for k in range(len(ours)) if k != a]
    holes = [k for k in range(len(theirs)) if k != b]
    for i, j in _closest_pairs([curves[k] for k in inner], [goals[k] for k in holes]):
        curve, goal = curves[inner[i]], goals[holes[j]]
        if edges is not None and edges[ours[inner[i]]].any():
            pairs.append(_lid_pair(ours[inner[i]], curve, edges, theirs[holes[j]], goal))
            continue
        sharp = rims and max(curve.openness, goal.openness) < _SLIT
        power = (_AT_CORNERS if sharp else BEYOND_CORNERS) if rims else 1.0
        at = curve.parameters[:-1]
        t = slit_parameters(curve, goal, at, power=power)
        trust = np.ones(len(t))
        if rims and not sharp:
            stretched = _gaps(t, goal.length) / np.maximum(_gaps(at, curve.length), 1e-300)
            trust = np.maximum(stretched, 1.0) ** -2.0
        pairs.append(LoopPair(ours[inner[i]], theirs[holes[j]], goal, t, sharp, trust))
    return tuple(pairs)


def _lid_pair(
    rim: IntArray, curve: ClosedCurve, edges: BoolArray, other: IntArray, goal: ClosedCurve
) -> LoopPair:
    """Where the ``rim`` of a source's cavity is the edge of lids, these meet on the target's."""
    kept = edges[rim]
    t = across_parameters(curve, goal)[kept]
    return LoopPair(rim[kept], other, goal, t, True, np.ones(len(t)), lid=True)


def _gaps(parameters: FloatArray, length: float) -> FloatArray:
    """The length (k,) from the point before each of those at ``parameters`` to the one after."""
    return np.mod(np.roll(parameters, -1) - np.roll(parameters, 1), length)


def _coincide(curve: ClosedCurve, goal: ClosedCurve) -> bool:
    low, high = _OUTER_RATIO
    gaps = [
        np.linalg.norm(b.at(b.project(a.points)) - a.points, axis=1)
        for a, b in ((curve, goal), (goal, curve))
    ]
    near = max(float(np.quantile(gap, 0.95)) for gap in gaps) < _OUTER_GAP
    return low < goal.length / curve.length < high and near


def _closest_pairs(
    curves: Sequence[ClosedCurve], goals: Sequence[ClosedCurve]
) -> list[tuple[int, int]]:
    if not curves or not goals:
        return []
    apart = np.array([[np.linalg.norm(c.centroid - g.centroid) for g in goals] for c in curves])
    ratio = np.array([[g.length / c.length for g in goals] for c in curves])
    cost = apart + 0.05 * np.abs(np.log(ratio))
    likely = (apart < _INNER_GAP) & (ratio > _INNER_RATIO[0]) & (ratio < _INNER_RATIO[1])
    rows, columns = linear_sum_assignment(np.where(likely, cost, 1.0))
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if likely[i, j]]
