"""Which terms and which schedule a pair of aligned surfaces calls for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from engine.correspondence._curves import ClosedCurve
from engine.correspondence._fitting import Step, Target, Weights
from engine.correspondence._loops import LoopPair
from engine.correspondence._pyramid import Pyramid
from engine.correspondence._remnants import corners_on_border
from engine.correspondence._shown import own_share, within_share
from engine.correspondence._static import (
    Nearby,
    apart_share,
    edge_share,
    remote_share,
    rests_beside,
    static_share,
)
from engine.operators import vertex_areas
from engine.types import FloatArray, IntArray, Mesh

_STIFF = 10.0  # how many times as much bending costs where a displacement hardly bends
_LEADING = 15  # coarse steps
# skin follows a wide mouth but slowly: the second coarse step and those after it begin beyond
_AHEAD, _HURRIED = 0.2, 5  # by that share, and how many do
# smoothness keeps a fifth of the displacement back: fine steps start beyond it, the last ones twice
_BEYOND, _TWICE = 0.2, 3
_GRADUAL = 0.5  # share of the fine level's smoothness that is asked of each step's own motion
_LESS_GRADUAL, _LONGER = 0.4, 0.125  # the less of that, and longer last steps, on a blurred target
_CLEAR, _BLURRED = 0.3, 0.6  # doubt in a target's normals up to which, from which none is fetched
_COMPLETE = 0.85  # share of the source's area that a complete target shows
_NEAR = 0.1
_RESTING, _RAMP = 0.7, 0.05  # share of the area at rest from which resting is the likely story
_HOLD = 0.3
_REMOTE, _REMOTE_PARTIAL = 3e-3, 1e-2  # how inert skin is far from eyes and mouth
# steps on the fine level where a sensor's noise holds skin back, and what each goes on by
_PATIENCE, _MOMENTUM = 10, 0.7
# vertices of the source and of the target at a time, and of the target in the last step, whose
# noise averages out; where landmarks lead; those of a sensor's view; the more of a complete one
# the more of what a vertex tells is noise
_SAMPLES, _LED_SAMPLES, _NOISY_SAMPLES, _MORE_SAMPLES = (
    (4000, 4000, 12_000),
    (5000, 5000, 5000),
    (5000, 12_000, 12_000),
    (1000, 8000, 8000),
)
_PARTIAL_LENGTHS = (0.02, 0.015), (0.03, 0.02), (0.1, 0.1)
_INSIDE = 0.8  # of a loop's radius: how far its centre may move in a partial target
_CLOSED = 0.3  # of a hole's area: what is left of it when it closes
# on a complete target: the last length, and how much of their pull rims feel along themselves
_LED, _FREE = (0.009, 0.03), (0.01, 0.007)  # with landmarks, and without
_BETWEEN = 0.0125  # the last length where a target's vertices lie farther apart
_HELD_SLIDE = Weights().slit_slide  # where rims are but cavities' or foreign
_AGREE = 0.6  # least cosine of matching normals where much of the source has no match
_RIM = 0.1  # rims of cavities lead, but are known to a few millimetres only
_FIRM, _BESIDE_LID = 5.0, 0.06  # how much firmer skin at rest is held beside a lid that closes
_CALMED = 40.0  # and far from what moves, where a vertex tells but noise
_FOREIGN_RIM = 0.01  # least of all where a hole meets a cavity, or the edge of what was seen


@dataclass(frozen=True, slots=True)
class Plan:
    """Steps on the coarse and the fine level, weights, and the reason in a few words.

    ``static`` (n,): how surely, in [0, 1], each vertex that is compared has not moved, times how
    firmly it is held for it; ``shown`` (n,) in [0, 1]: how surely the target shows it; ``inert``
    (n,): how much its displacement is pulled towards none. ``loops`` are the pairs to trust,
    ``rims`` is what is left of their weight on the fine level, ``slide`` the tangential part of it
    there, ``gradual`` the share of smoothness that is asked of each step's own motion there,
    ``stiff`` how many times as much bending costs there where little of it is, ``momentum`` how
    much of a step's motion the next one begins with, ``samples`` how many of the source's and of
    the target's vertices are compared at a time there, and of the target's in the last step.
    ``whole``: the target shows all of the source.
    """

    coarse: tuple[Step, ...]
    fine: tuple[Step, ...]
    weights: Weights
    rims: float
    slide: float
    gradual: float
    stiff: float
    momentum: float
    samples: tuple[int, int, int]
    static: FloatArray
    shown: FloatArray
    inert: FloatArray
    mode: str
    loops: tuple[LoopPair, ...]
    whole: bool

    @property
    def fine_weights(self) -> Weights:
        """The weights on the fine level.

        Where loops are borders of both surfaces, the skin around them says there how they stretched
        between their corners: an opening mouth does so at its corners most. A cavity's rim is
        doubted where it got longer.
        """
        return replace(
            self.weights,
            rim=self.rims,
            doubt=1.0,
            slit_slide=self.slide,
            gradual=self.gradual,
            stiff=self.stiff,
        )


@dataclass(frozen=True, slots=True)
class AlignedPair:
    """What is known of a rigidly aligned pair before it is fitted.

    ``pyramid`` is the source's surface, ``mesh`` what is compared of it, ``loops`` its own there,
    the outer one first; ``loop_pairs`` are those that the target has as well, ``borders`` all of
    the target's. So many ``cavities`` have been cut from the source and from the target.
    ``exposed`` (n,) is given for what a sensor saw: how surely each source vertex can be seen at
    all. ``led``: by landmarks; ``known``: how such a face moves; ``coarse``: the target.
    """

    pyramid: Pyramid
    target: Target
    loop_pairs: tuple[LoopPair, ...]
    borders: tuple[IntArray, ...]
    cavities: tuple[int, int]
    exposed: FloatArray | None = None
    led: bool = False
    known: bool = False
    coarse: bool = False
    blurred: float = 0.0

    @property
    def mesh(self) -> Mesh:
        """What is compared of the source."""
        return self.pyramid.seen.mesh

    @property
    def loops(self) -> tuple[IntArray, ...]:
        """Its loops."""
        return self.pyramid.seen_loops


def geometric_steps(
    count: int,
    smooth: tuple[float, float],
    reach: tuple[float, float],
    normal_weight: tuple[float, float],
) -> tuple[Step, ...]:
    """``count`` steps whose lengths go from the first to the second value of each pair."""
    lengths = [np.geomspace(a, b, count) for a, b in (smooth, reach, normal_weight)]
    return tuple(Step(*map(float, values)) for values in zip(*lengths, strict=True))


def _leading(smooth: tuple[float, float], reach: tuple[float, float]) -> tuple[Step, ...]:
    """Coarse steps; those after the first begin beyond where the last one ended."""
    return tuple(
        replace(step, beyond=_AHEAD if 0 < turn <= _HURRIED else 0.0)
        for turn, step in enumerate(geometric_steps(_LEADING, smooth, reach, (0.2, 0.1)))
    )


def _fetching(steps: tuple[Step, ...], fetched: float) -> tuple[Step, ...]:
    """``steps``, the last ones twice, begun beyond either time: by the share to be ``fetched``."""
    if fetched == 0:
        return steps
    share = _BEYOND * fetched
    first, last = steps, steps[-_TWICE:]
    return tuple(
        replace(step, beyond=share if turn == 0 else 0.0)
        for part in (first, last)
        for turn, step in enumerate(part)
    )


def choose_plan(pair: AlignedPair) -> Plan:
    """The plan for a rigidly aligned pair.

    Where a cavity of the target has no counterpart but a hole, a whole head is the target of a face
    patch: nothing ties the patch's border, so it is held where it rests. Landmarks, where they have
    ``led``, leave finer detail to be told from noise, a ``coarse`` target has none between its
    vertices. What smoothness keeps back is fetched, unless the face's expressions are ``known`` (it
    is little) or a part is cut off (nothing there takes back what is too much); less where noise
    cannot be told from shape, on a sensor's view and on a coarse target, the rougher it is.
    """
    nearby = Nearby.of(pair.mesh, pair.target)
    overlap = shown_share(pair.mesh, nearby)
    static = static_share(nearby, pair.pyramid.spread)
    if overlap >= _COMPLETE:
        return _complete(pair, static, overlap)
    within = within_share(nearby, pair.pyramid.spread)
    return _partial(pair, static, within, overlap)


def _partial(pair: AlignedPair, static: FloatArray, within: FloatArray, overlap: float) -> Plan:
    mesh, seen = pair.mesh, pair.exposed is not None
    loops = tuple(one for one in pair.loop_pairs if _likely(mesh, one, seen=seen))
    fetched = _told(pair.target) if seen and not pair.known else 0.0
    shown = _shown(pair, loops, whole=False)
    why = _reasons(loops, overlap, pair.cavities)
    samples = _LED_SAMPLES if pair.led else _SAMPLES
    remnants = () if seen else _remnants(pair, loops, within)
    if remnants:
        why += f", {len(remnants)} corners of holes on its border"
    return Plan(
        _leading((0.1, 0.025), (0.15, 0.04)),
        _fetching(geometric_steps(_PATIENCE if seen else 4, *_PARTIAL_LENGTHS), fetched),
        Weights(static=0.0 if seen else _HOLD, agree=_AGREE, mixed=not pair.led),
        _FOREIGN_RIM,
        _HELD_SLIDE,
        _GRADUAL * fetched,
        1.0,
        _MOMENTUM if seen else 0.0,
        _NOISY_SAMPLES if seen else samples,
        static,
        np.minimum(shown, within),
        _REMOTE_PARTIAL * remote_share(mesh, pair.loops),
        f"partial target: {why}; pulled both ways{'' if seen else ', held where it rests'}",
        (*loops, *remnants),
        whole=False,
    )


def _complete(pair: AlignedPair, static: FloatArray, overlap: float) -> Plan:
    mesh, cavities, loops = pair.mesh, pair.cavities, pair.loop_pairs
    shown = _shown(pair, loops, whole=True)
    if all(cavities):
        loops = tuple(one for one in loops if one.lid or not _rests(mesh, one, static))
    told = _told(pair.target) if pair.coarse else 1.0
    fetched = 0.0 if pair.known else told
    last, slide = _LED if pair.led else _FREE
    last = _BETWEEN if pair.coarse else last * (1 + _LONGER * pair.blurred)
    static, trust, held = _held(pair, loops, static)
    rims = _RIM if any(cavities) else 1.0
    if cavities[1] > cavities[0]:
        static, rims, trust = static * edge_share(mesh, pair.loops[0]), _FOREIGN_RIM, 1.0
        held = "; its border held where it rests"
    return Plan(
        _leading((0.1, 0.02), (0.15, 0.03)),
        _fetching(geometric_steps(5, (0.015, last), (0.025, 0.02), (0.1, 0.1)), fetched),
        Weights(static=_HOLD * trust, mixed=not pair.led),
        rims,
        slide if rims == 1.0 else _HELD_SLIDE,
        _GRADUAL * fetched * (1 - _LESS_GRADUAL * pair.blurred),
        _STIFF,
        0.0,
        _complete_samples(pair),
        static,
        shown,
        _REMOTE * remote_share(mesh, pair.loops),
        f"complete target: {_reasons(loops, overlap, cavities)}; pulled both ways{held}",
        loops,
        whole=True,
    )


def _complete_samples(pair: AlignedPair) -> tuple[int, int, int]:
    if pair.led:
        return _LED_SAMPLES
    a, b, c = (
        few + round(pair.blurred * more) for few, more in zip(_SAMPLES, _MORE_SAMPLES, strict=True)
    )
    return a, b, c


def _told(target: Target) -> float:
    """How much, in [0, 1], a target tells of what smoothness keeps back, by its roughness."""
    return float(np.clip((_BLURRED - target.doubt) / (_BLURRED - _CLEAR), 0, 1))


def _held(
    pair: AlignedPair, loops: tuple[LoopPair, ...], static: FloatArray
) -> tuple[FloatArray, float, str]:
    """How firmly vertices (n,) are held that rest, in [0, 1] how far this is trusted, and why."""
    areas = vertex_areas(pair.mesh)
    resting = float((areas * static).sum() / areas.sum())
    trust = float(np.clip((resting - _RESTING) / _RAMP, 0, 1))
    why = f"; held where it rests ({resting:.0%})" if trust > 0 else ""
    firm = _firmness(pair.mesh, loops)
    if trust > 0 and pair.blurred > 0:
        firm *= 1 + _CALMED * pair.blurred * apart_share(pair.mesh, static)
    return static * firm, trust, why


def _shown(pair: AlignedPair, paired: tuple[LoopPair, ...], *, whole: bool) -> FloatArray:
    """(n,) how surely the target shows each source vertex, its borders left aside.

    A hole without a partner is filled where the target is ``whole`` or a sensor's view; elsewhere
    it may just as well be missing.
    """
    unpaired = _unpaired(pair.loops, paired)
    if pair.exposed is not None:
        return np.minimum(own_share(pair.mesh, unpaired), pair.exposed)
    return own_share(pair.mesh, unpaired if whole else [])


def _remnants(
    pair: AlignedPair, paired: tuple[LoopPair, ...], within: FloatArray
) -> tuple[LoopPair, ...]:
    """The corners on a part's border of those of the source's holes that it was cut through."""
    if not pair.borders:
        return ()
    cut = _unpaired(pair.loops, paired)
    return corners_on_border(pair.mesh, cut, within, pair.target.mesh, pair.borders[0])


def _unpaired(loops: tuple[IntArray, ...], pairs: tuple[LoopPair, ...]) -> list[IntArray]:
    """The inner ``loops`` of a source that are in none of ``pairs``."""
    paired = {int(pair.vertices.min()) for pair in pairs}
    return [loop for loop in loops[1:] if int(loop.min()) not in paired]


def _reasons(pairs: tuple[LoopPair, ...], overlap: float, cavities: tuple[int, int]) -> str:
    outer = any(pair.slides for pair in pairs)
    why = (
        f"{'outer loop' if outer else 'no outer loop'} and {len(pairs) - outer} inner loops "
        f"paired, target shows {overlap:.0%} of the source"
    )
    lids = sum(pair.lid for pair in pairs)
    if lids:
        why += f", {lids} of them lids that close"
    if any(cavities):
        why += f", cavities cut: {cavities[0]} of the source, {cavities[1]} of the target"
    return why


def _likely(source: Mesh, pair: LoopPair, *, seen: bool) -> bool:
    """Whether a partial target's hole may be the source's: scans have many to be mistaken.

    Its centre stays inside the source's, and it surrounds it; what lies beside the line of sight
    of an eye is a crescent around the lid. Only lids of a mesh not ``seen`` by a sensor may close.
    """
    curve = ClosedCurve(source.vertices[pair.vertices])
    radius = max(curve.length, pair.curve.length) / (2 * np.pi)
    near = np.linalg.norm(curve.centroid - pair.curve.centroid) < _INSIDE * radius
    axis, opening = curve.vector_area, np.linalg.norm(pair.curve.vector_area)
    closed = not seen and opening < _CLOSED * np.linalg.norm(axis)
    around = pair.slides or closed or pair.curve.winding(axis, curve.centroid) != 0
    return bool(near and around)


def _rests(source: Mesh, pair: LoopPair, static: FloatArray) -> bool:
    """Whether the skin around a cavity's rim rests."""
    return not pair.slides and rests_beside(source.vertices, source.vertices[pair.vertices], static)


def _firmness(source: Mesh, pairs: tuple[LoopPair, ...]) -> FloatArray:
    """(n,) at least 1: bending would pull skin along that lies beside lids that close."""
    lids = [source.vertices[pair.vertices] for pair in pairs if pair.lid]
    if not lids:
        return np.ones(len(source.vertices))
    distance = KDTree(np.concatenate(lids)).query(source.vertices)[0]
    return 1 + (_FIRM - 1) * np.exp(-((distance / _BESIDE_LID) ** 2))


def shown_share(source: Mesh, nearby: Nearby) -> float:
    """The share of the source's area that finds a compatible foot nearby on the target."""
    areas, feet = vertex_areas(source), nearby.feet
    found = (nearby.cosine > 0.5) & ~feet.on_border & (feet.distance < _NEAR)
    return float(areas[found].sum() / areas.sum())
