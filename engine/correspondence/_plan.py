"""Which terms and which schedule a pair of aligned surfaces calls for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from engine.correspondence._curves import ClosedCurve
from engine.correspondence._fitting import Step, Target, Weights
from engine.correspondence._loops import LoopPair
from engine.correspondence._static import edge_share, static_share
from engine.operators import vertex_areas, vertex_normals
from engine.types import FloatArray, IntArray, Mesh

_COMPLETE = 0.85  # share of the source's area that a complete target shows
_NEAR = 0.1
_RESTING, _RAMP = 0.7, 0.05  # share of the area at rest from which resting is the likely story
_HOLD = 0.3
_INSIDE = 0.8  # of a loop's radius: how far its centre may move in a partial target
_RIM = 0.1  # rims of cavities lead, but are known to a few millimetres only
_FOREIGN_RIM = 0.01  # least of all where a hole meets a cavity, or the edge of what was seen


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
    source: tuple[Mesh, tuple[IntArray, ...]],
    target: Target,
    pairs: tuple[LoopPair, ...],
    cavities: tuple[int, int],
) -> Plan:
    """The plan for a rigidly aligned pair, from which so many ``cavities`` have been cut.

    ``source``: the surface and its loops, the outer one first. Where a cavity of the target has
    no counterpart but a hole, a whole head is the target of a face patch: nothing ties the patch's
    border, so it is held where it rests.
    """
    mesh, loops = source
    overlap = shown_share(mesh, target)
    partial = overlap < _COMPLETE
    if partial:
        pairs = tuple(pair for pair in pairs if _near(mesh, pair))
    why = _reasons(pairs, overlap, cavities)
    static = static_share(mesh, target)
    if partial:
        return Plan(
            geometric_steps(15, (0.05, 0.025), (0.1, 0.04), (0.2, 0.1)),
            geometric_steps(4, (0.02, 0.015), (0.03, 0.02), (0.1, 0.1)),
            Weights(static=_HOLD),
            _FOREIGN_RIM,
            static,
            f"partial target: {why}; pulled both ways, held where it rests",
            pairs,
        )
    rims = _RIM if any(cavities) else 1.0
    areas = vertex_areas(mesh)
    resting = float((areas * static).sum() / areas.sum())
    trust = float(np.clip((resting - _RESTING) / _RAMP, 0, 1))
    held = f"; held where it rests ({resting:.0%})" if trust > 0 else ""
    if cavities[1] > cavities[0]:
        static, rims, trust = static * edge_share(mesh, loops[0]), _FOREIGN_RIM, 1.0
        held = "; its border held where it rests"
    return Plan(
        geometric_steps(15, (0.1, 0.02), (0.15, 0.03), (0.2, 0.1)),
        geometric_steps(5, (0.015, 0.009), (0.025, 0.02), (0.1, 0.1)),
        Weights(static=_HOLD * trust),
        rims,
        static,
        f"complete target: {why}; pulled both ways{held}",
        pairs,
    )


def _reasons(pairs: tuple[LoopPair, ...], overlap: float, cavities: tuple[int, int]) -> str:
    outer = any(pair.slides for pair in pairs)
    why = (
        f"{'outer loop' if outer else 'no outer loop'} and {len(pairs) - outer} inner loops "
        f"paired, target shows {overlap:.0%} of the source"
    )
    if any(cavities):
        why += f", cavities cut: {cavities[0]} of the source, {cavities[1]} of the target"
    return why


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
