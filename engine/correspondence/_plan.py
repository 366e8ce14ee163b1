"""Which terms and which schedule a pair of aligned surfaces calls for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from engine.correspondence._aligned import AlignedPair
from engine.correspondence._fitting import Step, Target, Weights
from engine.correspondence._holding import held_firmly
from engine.correspondence._loops import LoopPair
from engine.correspondence._open_rims import open_rims
from engine.correspondence._remnants import corners_on_border
from engine.correspondence._schedule import fetching_steps, geometric_steps, leading_steps
from engine.correspondence._shown import own_share, within_share
from engine.correspondence._static import Nearby, edge_share, remote_share, static_share
from engine.correspondence._trusted import is_likely, rests, unpaired
from engine.operators import vertex_areas
from engine.types import FloatArray, Mesh

_STIFF = 10.0  # how many times as much bending costs where a displacement hardly bends
_GRADUAL = 0.5  # share of the fine level's smoothness that is asked of each step's own motion
_LESS_GRADUAL, _LONGER = 0.4, 0.125  # the less of that, and longer last steps, on a blurred target
_CLEAR, _BLURRED = 0.3, 0.6  # doubt in a target's normals up to which, from which none is fetched
_COMPLETE = 0.85  # share of the source's area that a complete target shows
_NEAR = 0.1
_HOLD = 0.3
_REMOTE = 3e-3  # how inert skin is far from eyes and mouth
# steps on the fine level where a sensor's noise holds skin back, and what each goes on by
_PATIENCE, _MOMENTUM = 12, 0.7
# vertices of the source and of the target at a time, and of the target in the last step, whose
# noise averages out; where landmarks lead; those of a sensor's view; the more of a complete one
# the more of what a vertex tells is noise
_SAMPLES, _LED_SAMPLES, _SENSED_SAMPLES, _MORE_SAMPLES = (
    (4000, 4000, 12_000),
    (5000, 5000, 5000),
    (5000, 12_000, 12_000),
    (1000, 8000, 8000),
)
_LEADING_LENGTHS = (0.1, 0.02), (0.15, 0.03)
_SENSED_LENGTHS = (0.02, 0.0125), (0.03, 0.014), (0.1, 0.1)
_SENSED_BACK = 12.0  # a sensor's many vertices tell more than the source's few
# on a complete target: the last length, and how much of their pull rims feel along themselves
_LED, _FREE = (0.009, 0.03), (0.01, 0.007)  # with landmarks, and without
_BETWEEN = 0.0125  # the last length where a target's vertices lie farther apart
_HELD_SLIDE = Weights().slit_slide  # where rims are but cavities' or foreign
_AGREE = 0.6  # least cosine of matching normals where much of the source has no match
_RIM = 0.1  # rims of cavities lead, but are known to a few millimetres only
_FOREIGN_RIM = 0.01  # least of all where a hole meets a cavity, or the edge of what was seen


@dataclass(frozen=True, slots=True)
class Plan:
    """Steps on the coarse and the fine level, weights, and the reason in a few words.

    ``static`` (n,): how surely, in [0, 1], each vertex that is compared has not moved, times how
    firmly it is held for it; ``own`` (n,) in [0, 1]: how surely what the target may have there is
    that vertex's own skin; ``shown`` (n,): how surely the target has it and shows it; ``inert``
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
    own: FloatArray
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


def choose_plan(pair: AlignedPair) -> Plan:
    """The plan for a rigidly aligned pair.

    Where a cavity of the target has no counterpart but a hole, a whole head is the target of a face
    patch: nothing ties the patch's border, so it is held where it rests. Landmarks, where they have
    ``led``, leave finer detail to be told from noise, a ``coarse`` target has none between its
    vertices, a ``refined`` source none within its own faces. What smoothness keeps back is fetched,
    unless the face's expressions are ``known`` (it is little); less where noise cannot be told from
    shape, on a sensor's view and on a coarse target, the rougher it is.
    """
    nearby = Nearby.of(pair.mesh, pair.target)
    overlap = shown_share(pair.mesh, nearby)
    if overlap < _COMPLETE and pair.exposed is not None:
        return _sensed(pair, within_share(nearby, pair.pyramid.spread), overlap)
    static = static_share(nearby, pair.pyramid.spread)
    if overlap < _COMPLETE:
        return _partial(pair, static, within_share(nearby, pair.pyramid.spread), overlap)
    return _complete(pair, static, overlap)


def _sensed(pair: AlignedPair, within: FloatArray, overlap: float) -> Plan:
    mesh = pair.mesh
    loops = tuple(one for one in pair.loop_pairs if is_likely(mesh, one, seen=True))
    own = _own(pair, loops, whole=False)
    fetched = 0.0 if pair.known else _told(pair.target)
    return Plan(
        leading_steps(*_LEADING_LENGTHS),
        fetching_steps(geometric_steps(_PATIENCE, *_SENSED_LENGTHS), fetched),
        Weights(back=_SENSED_BACK, agree=_AGREE, mixed=not pair.led),
        _FOREIGN_RIM,
        _HELD_SLIDE,
        _GRADUAL * fetched,
        1.0,
        _MOMENTUM,
        _SENSED_SAMPLES,
        np.zeros(len(mesh.vertices)),
        np.minimum(own, within),
        own,
        _REMOTE * remote_share(mesh, pair.loops),
        f"partial target, a sensor's view: {_reasons(loops, overlap, pair.cavities)}; "
        "pulled both ways",
        loops,
        whole=False,
    )


def _partial(pair: AlignedPair, static: FloatArray, within: FloatArray, overlap: float) -> Plan:
    mesh = pair.mesh
    loops = tuple(one for one in pair.loop_pairs if is_likely(mesh, one, seen=False))
    own = _own(pair, loops, whole=False)
    shown = np.minimum(own, within)
    static, trust, held = held_firmly(mesh, loops, static, shown, pair.blurred)
    rims = _RIM if pair.cavities[0] else _FOREIGN_RIM
    remnants, cut = _remnants(pair, loops, within, rims)
    weights = Weights(static=_HOLD * trust, agree=_AGREE, mixed=not pair.led)
    why = _reasons(loops, overlap, pair.cavities)
    why = f"partial target: {why}{cut}; pulled both ways{held}"
    return _paced(pair, weights, rims, (static, shown, own), (*loops, *remnants), why)


def _complete(pair: AlignedPair, static: FloatArray, overlap: float) -> Plan:
    mesh, cavities, loops = pair.mesh, pair.cavities, pair.loop_pairs
    own = _own(pair, loops, whole=True)
    if all(cavities):
        loops = tuple(one for one in loops if one.lid or not rests(mesh, one, static))
    static, trust, held = held_firmly(mesh, loops, static, own, pair.blurred)
    rims = _RIM if any(cavities) else 1.0
    if cavities[1] > cavities[0]:
        edge = edge_share(mesh, pair.loops[0])
        static, rims, trust = static * np.maximum(edge, trust), _FOREIGN_RIM, 1.0
        held = held or "; its border held where it rests"
    weights = Weights(static=_HOLD * trust, mixed=not pair.led)
    why = f"complete target: {_reasons(loops, overlap, cavities)}; pulled both ways{held}"
    return replace(_paced(pair, weights, rims, (static, own, own), loops, why), whole=True)


def _paced(
    pair: AlignedPair,
    weights: Weights,
    rims: float,
    shares: tuple[FloatArray, FloatArray, FloatArray],
    loops: tuple[LoopPair, ...],
    why: str,
) -> Plan:
    """The plan for a surface whose vertices tell shape, with these terms."""
    told = _told(pair.target) if pair.coarse else 1.0
    fetched = 0.0 if pair.known else told
    last, slide = _LED if pair.led else _FREE
    last = _BETWEEN if pair.coarse or pair.refined else last * (1 + _LONGER * pair.blurred)
    gradual = 0.0 if pair.refined else _GRADUAL * fetched * (1 - _LESS_GRADUAL * pair.blurred)
    return Plan(
        leading_steps(*_LEADING_LENGTHS),
        fetching_steps(geometric_steps(5, (0.015, last), (0.025, 0.02), (0.1, 0.1)), fetched),
        weights,
        rims,
        slide if rims == 1.0 else _HELD_SLIDE,
        gradual,
        _STIFF,
        0.0,
        _samples(pair),
        *shares,
        _REMOTE * remote_share(pair.mesh, pair.loops),
        why,
        loops,
        whole=False,
    )


def _samples(pair: AlignedPair) -> tuple[int, int, int]:
    if pair.led:
        return _LED_SAMPLES
    a, b, c = (
        few + round(pair.blurred * more) for few, more in zip(_SAMPLES, _MORE_SAMPLES, strict=True)
    )
    return a, b, c


def _told(target: Target) -> float:
    """How much, in [0, 1], a target tells of what smoothness keeps back, by its roughness."""
    return float(np.clip((_BLURRED - target.doubt) / (_BLURRED - _CLEAR), 0, 1))


def _own(pair: AlignedPair, paired: tuple[LoopPair, ...], *, whole: bool) -> FloatArray:
    """(n,) how surely what a target has in the place of each source vertex is that vertex's own.

    A hole without a partner is filled where the target is ``whole`` or a sensor's view; elsewhere
    it may just as well be missing.
    """
    alone = unpaired(pair.loops, paired)
    if pair.exposed is not None:
        return np.minimum(own_share(pair.mesh, alone), pair.exposed)
    return own_share(pair.mesh, alone if whole else [])


def _remnants(
    pair: AlignedPair, paired: tuple[LoopPair, ...], within: FloatArray, rims: float
) -> tuple[tuple[LoopPair, ...], str]:
    """What a part's border has of those of the source's holes that it was cut through, in words.

    Rims of cavities as far as they are left, of other holes the corners: these may be foreign,
    whatever is left of the weight of ``rims``.
    """
    if not pair.borders:
        return (), ""
    target, cut = pair.target.mesh, unpaired(pair.loops, paired)
    opened: tuple[LoopPair, ...] = ()
    if pair.fresh is not None:
        opened = open_rims(pair.mesh, cut, target, pair.borders, pair.fresh)
    others = [hole for hole in cut if not any(np.isin(one.vertices, hole).all() for one in opened)]
    corners = [
        replace(one, trust=one.trust * (_FOREIGN_RIM / rims))
        for one in corners_on_border(pair.mesh, others, within, target, pair.borders[0])
    ]
    why = f", {len(opened)} rims of cavities cut through" if opened else ""
    why += f", {len(corners)} corners of holes on its border" if corners else ""
    return (*opened, *corners), why


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


def shown_share(source: Mesh, nearby: Nearby) -> float:
    """The share of the source's area that finds a compatible foot nearby on the target."""
    areas, feet = vertex_areas(source), nearby.feet
    found = (nearby.cosine > 0.5) & ~feet.on_border & (feet.distance < _NEAR)
    return float(areas[found].sum() / areas.sum())
