"""Which terms and which schedule a pair of aligned surfaces calls for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from engine.correspondence._curves import ClosedCurve
from engine.correspondence._fitting import Step, Target, Weights
from engine.correspondence._loops import LoopPair
from engine.correspondence._static import static_share
from engine.operators import vertex_areas, vertex_normals
from engine.types import FloatArray, Mesh

_COMPLETE = 0.85  # share of the source's area that a complete target shows
_NEAR = 0.1
_RESTING, _RAMP = 0.7, 0.05  # share of the area at rest from which resting is the likely story
_HOLD = 0.3
_INSIDE = 0.8  # of a loop's radius: how far its centre may move in a partial target
_RIM = 0.1  # rims of cavities lead, but are known to a few millimetres only


@dataclass(frozen=True, slots=True)
class Plan:
    """Steps on the coarse and the fine level, weights, and the reason in a few words.

    ``static`` (n,) in [0, 1]: how surely each source vertex has not moved. ``loops``
    are the pairs to trust, ``rims`` is what is left of their weight on the fine level.
    """

    coarse: tuple[Step, ...]
    fine: tuple[Step, ...]
    weights: Weights
    rims: float
    static: FloatArray
    mode: str
    loops: tuple[LoopPair, ...]

    @property
    def fine_weights(self) -> Weights:
        """The weights on the fine level."""
        return replace(self.weights, loop=self.rims * self.weights.loop)


def geometric_steps(
    count: int,
    smooth: tuple[float, float],
    reach: tuple[float, float],
    normal_weight: tuple[float, float],
) -> tuple[Step, ...]:
    """``count`` steps whose lengths go from the first to the second value of each pair."""
    lengths = [np.geomspace(a, b, count) for a, b in (smooth, reach, normal_weight)]
    return tuple(Step(*map(float, values)) for values in zip(*lengths, strict=True))


def choose_plan(
    source: Mesh, target: Target, loops: tuple[LoopPair, ...], cavities: tuple[int, int]
) -> Plan:
    """The plan for a rigidly aligned pair, from which so many ``cavities`` have been cut.

    Where a cavity of the target has no counterpart but a hole, a whole head is the target of a
    face patch: nothing ties the patch's border, so it is held where it rests in any case.
    """
    overlap = shown_share(source, target)
    if overlap < _COMPLETE:
        loops = tuple(pair for pair in loops if _near(source, pair))
    outer = any(pair.slides for pair in loops)
    inner = len(loops) - outer
    why = (
        f"{'outer loop' if outer else 'no outer loop'} and {inner} inner loops paired, "
        f"target shows {overlap:.0%} of the source"
    )
    if any(cavities):
        why += f", cavities cut: {cavities[0]} of the source, {cavities[1]} of the target"
    if overlap < _COMPLETE:
        return Plan(
            geometric_steps(15, (0.05, 0.025), (0.1, 0.04), (0.2, 0.1)),
            geometric_steps(4, (0.02, 0.015), (0.03, 0.02), (0.1, 0.1)),
            Weights(static=_HOLD),
            1.0,
            static_share(source, target),
            f"partial target: {why}; pulled both ways, held where it rests",
            loops,
        )
    static = static_share(source, target)
    areas = vertex_areas(source)
    resting = float((areas * static).sum() / areas.sum())
    trust = float(np.clip((resting - _RESTING) / _RAMP, 0, 1))
    if cavities[1] > cavities[0]:
        trust = 1.0
    held = f"; held where it rests ({resting:.0%})" if trust > 0 else ""
    return Plan(
        geometric_steps(15, (0.1, 0.02), (0.15, 0.03), (0.2, 0.1)),
        geometric_steps(5, (0.015, 0.009), (0.025, 0.02), (0.1, 0.1)),
        Weights(static=_HOLD * trust),
        _RIM if any(cavities) else 1.0,
        static,
        f"complete target: {why}; pulled both ways{held}",
        loops,
    )


def _near(source: Mesh, pair: LoopPair) -> bool:
    """Whether the centre of a loop stays inside the loop: a scan has many holes to be mistaken."""
    curve = ClosedCurve(source.vertices[pair.vertices])
    radius = max(curve.length, pair.curve.length) / (2 * np.pi)
    return bool(np.linalg.norm(curve.centroid - pair.curve.centroid) < _INSIDE * radius)


def shown_share(source: Mesh, target: Target) -> float:
    """The share of the source's area that finds a compatible foot nearby on the target."""
    normals = vertex_normals(source)
    feet = target.index(0.1).feet(source.vertices, normals)
    agree = np.einsum("ni,ni->n", normals, feet.normal) > 0.5
    areas = vertex_areas(source)
    found = agree & ~feet.on_border & (feet.distance < _NEAR)
    return float(areas[found].sum() / areas.sum())
