"""Which terms and which schedule a pair of aligned surfaces calls for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.correspondence._fitting import Step, Target, Weights
from engine.correspondence._loops import LoopPair
from engine.correspondence._static import static_share
from engine.operators import vertex_areas, vertex_normals
from engine.types import FloatArray, Mesh

_COMPLETE = 0.85  # share of the source's area that a complete target shows
_NEAR = 0.1
_RESTING, _RAMP = 0.7, 0.05  # share of the area at rest from which resting is the likely story
_HOLD = 0.3


@dataclass(frozen=True, slots=True)
class Plan:
    """Steps on the coarse and the fine level, weights, and the reason in a few words.

    ``static`` (n,) in [0, 1]: how surely each source vertex has not moved.
    """

    coarse: tuple[Step, ...]
    fine: tuple[Step, ...]
    weights: Weights
    static: FloatArray
    mode: str


def geometric_steps(
    count: int,
    smooth: tuple[float, float],
    reach: tuple[float, float],
    normal_weight: tuple[float, float],
) -> tuple[Step, ...]:
    """``count`` steps whose lengths go from the first to the second value of each pair."""
    lengths = [np.geomspace(a, b, count) for a, b in (smooth, reach, normal_weight)]
    return tuple(Step(*map(float, values)) for values in zip(*lengths, strict=True))


def choose_plan(source: Mesh, target: Target, loops: tuple[LoopPair, ...]) -> Plan:
    """The plan for a rigidly aligned pair."""
    overlap = shown_share(source, target)
    outer = any(pair.slides for pair in loops)
    inner = len(loops) - outer
    why = (
        f"{'outer loop' if outer else 'no outer loop'} and {inner} inner loops paired, "
        f"target shows {overlap:.0%} of the source"
    )
    if overlap < _COMPLETE:
        return Plan(
            geometric_steps(15, (0.05, 0.025), (0.1, 0.04), (0.2, 0.1)),
            geometric_steps(4, (0.02, 0.015), (0.03, 0.02), (0.1, 0.1)),
            Weights(back=0.0),
            np.zeros(len(source.vertices)),
            f"partial target: {why}; pulled by the source's points only",
        )
    static = static_share(source, target)
    areas = vertex_areas(source)
    resting = float((areas * static).sum() / areas.sum())
    trust = float(np.clip((resting - _RESTING) / _RAMP, 0, 1))
    held = f"; held where it rests ({resting:.0%})" if trust > 0 else ""
    return Plan(
        geometric_steps(15, (0.1, 0.02), (0.15, 0.03), (0.2, 0.1)),
        geometric_steps(5, (0.015, 0.009), (0.025, 0.02), (0.1, 0.1)),
        Weights(static=_HOLD * trust),
        static,
        f"complete target: {why}; pulled both ways{held}",
    )


def shown_share(source: Mesh, target: Target) -> float:
    """The share of the source's area that finds a compatible foot nearby on the target."""
    normals = vertex_normals(source)
    feet = target.index(0.1).feet(source.vertices, normals)
    agree = np.einsum("ni,ni->n", normals, feet.normal) > 0.5
    areas = vertex_areas(source)
    found = agree & ~feet.on_border & (feet.distance < _NEAR)
    return float(areas[found].sum() / areas.sum())
