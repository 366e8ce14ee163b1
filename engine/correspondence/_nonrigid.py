"""The default correspondence: coarse-to-fine non-rigid registration, then projection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from engine.correspondence._aligned import AlignedPair
from engine.correspondence._colours import Colours, compare_colours
from engine.correspondence._confidence import confidence, existence
from engine.correspondence._expressions import Expressions
from engine.correspondence._fitting import Displacement, Fitting, Source, Target, Weights
from engine.correspondence._frame import Frame
from engine.correspondence._heights import heights, hidden_by_edges
from engine.correspondence._inside import fit_inside
from engine.correspondence._levels import Level
from engine.correspondence._loops import LoopPair, pair_loops
from engine.correspondence._marks import NO_MARKS, Marks
from engine.correspondence._openings import Outsides, cut_cavities
from engine.correspondence._plan import Plan, choose_plan
from engine.correspondence._projection import project
from engine.correspondence._pyramid import Pyramid
from engine.correspondence._refined import Refined
from engine.correspondence._rounded import RoundedTarget, is_coarse
from engine.correspondence._shown import exposed_share, is_one_view
from engine.correspondence._smoothing import Steadied, steadied
from engine.correspondence._unfolding import unfolded
from engine.operators import vertex_normals
from engine.types import (
    Correspondence,
    FloatArray,
    Mesh,
    Registration,
    Surface,
    SurfacePoints,
)

_COARSE_SAMPLES = 2000, 2000, 2000  # of the source's and the target's vertices at a time
_INERT = 3e-4  # where landmarks lead, skin far from them rather rests
_EXACTING = 5.0  # landmarks weigh this much more once the surfaces nearly coincide
_THERE = 0.1  # existence from which on faces are laid out where much has none
_SURE = 0.5  # existence from which on faces are laid out at the expense of others


def nonrigid_correspondence(
    source: Surface,
    target: Surface,
    registration: Registration,
    landmarks: tuple[SurfacePoints, SurfacePoints] | None,
    visibility: tuple[FloatArray, FloatArray],
    expressions: Expressions | None,
    colours: tuple[FloatArray, FloatArray] | None,
) -> Correspondence:
    """See :func:`engine.correspondence.correspond`."""
    frame = Frame.of(source.mesh)
    rest = source.mesh.moved(frame(source.mesh.vertices))
    aligned = target.mesh.moved(frame(registration.source_from_target(target.mesh.vertices)))
    outsides = cut_cavities(
        (rest, source.loops, visibility[0]), (aligned, target.loops, visibility[1])
    )
    ours, theirs = outsides.source, outsides.target
    steady = steadied(theirs.mesh, coarse=is_coarse(theirs.mesh))
    cut = all(outsides.cavities)
    skin = Refined(ours.mesh, ours.loops)
    if not outsides.cavities[0]:
        skin = skin.finer()
    edges = outsides.edges if skin.mesh is ours.mesh else None
    loops = pair_loops(skin.mesh, skin.loops, steady.mesh, theirs.loops, rims=cut, edges=edges)
    marks = NO_MARKS
    if landmarks is not None:
        marks = Marks.of(rest, landmarks[0], landmarks[1].on(aligned))
    led = marks.touching(skin.mesh)
    exposed = None
    if steady.noisy or is_one_view(steady.mesh):
        exposed = exposed_share(rest, visibility[0])
    pair = replace(
        _compared(outsides, steady, skin, loops, exposed),
        led=len(led.points) > 0,
        known=expressions is not None and expressions.count > 0,
    )
    goal = pair.target
    plan = choose_plan(pair)
    loops = [whole for whole, one in zip(loops, pair.loop_pairs, strict=True) if one in plan.loops]
    tint = None
    if colours is not None:
        both = skin.spread(colours[0][ours.vertex]), colours[1][theirs.vertex]
        tint = compare_colours(skin.mesh, goal.mesh, goal.index(0.1), both)
    used = tint if tint is not None and tint.agree else None
    shape = RoundedTarget(steady.mesh) if steady.coarse else goal
    x = FitTask(pair.pyramid, shape, plan, led, frame, expressions, used).deform()
    x, loops = x[: len(ours.vertex)], skin.undivided(loops)
    if any(outsides.cavities):
        goal = Target(steadied(aligned).mesh if steady.blurred > 0 else aligned)
        loops = pair_loops(rest, source.loops, aligned, target.loops)
        fitted = outsides.fitted
        x = fit_inside(rest, ours.vertex[fitted], x[fitted], goal, marks)
    points, sure, above, laid = _landed(
        (rest, x), goal, aligned, loops, landmarks, (plan.whole, steady.noisy, steady.off)
    )
    up = registration.target_from_source.ways(frame.unit * above)
    tinted = "" if tint is None else f"; {tint}"
    mode = f"{plan.mode}{_taken(pair)}{_said(expressions)}{tinted}; {laid}"
    return Correspondence(points, sure, up, mode)


def _compared(
    outsides: Outsides,
    steady: Steadied,
    skin: Refined,
    loops: Sequence[LoopPair],
    exposed: FloatArray | None,
) -> AlignedPair:
    """The outsides as they are compared: of the source its ``skin``, the target ``steady``.

    ``exposed`` (n,) is of all vertices of the source, and given for what a sensor saw.
    """
    pyramid = Pyramid.of(skin.mesh, skin.loops)
    if exposed is not None:
        exposed = skin.spread(exposed[outsides.source.vertex])[pyramid.seen.kept]
    return AlignedPair(
        pyramid,
        Target(steady.mesh, None if steady.noisy else steady.rough),
        tuple(pair.restricted(pyramid.seen.number) for pair in loops),
        outsides.target.loops,
        outsides.cavities,
        outsides.target.fresh,
        exposed,
        coarse=steady.coarse,
        blurred=steady.blurred,
        refined=skin.mesh is not outsides.source.mesh,
    )


def _landed(
    displaced: tuple[Mesh, FloatArray],
    goal: Target,
    aligned: Mesh,
    loops: Sequence[LoopPair],
    landmarks: tuple[SurfacePoints, SurfacePoints] | None,
    kind: tuple[bool, bool, float],
) -> tuple[SurfacePoints, FloatArray, FloatArray, str]:
    """Points of the target, confidences (n,), heights (n, 3), and what was done, in words.

    Of a source at rest and its displaced vertices; ``kind``: whether the target is complete, noisy,
    and how far off its vertices are.
    """
    (rest, x), (whole, noisy, off) = displaced, kind
    projection = project(rest.moved(x), goal, loops, landmarks, rest, noisy=noisy)
    share = existence(projection)
    exists = ~projection.beyond if whole else share > _THERE
    sure = share > _SURE
    laid = unfolded(rest, projection.points, goal, projection.freedom, exists, sure, noisy=noisy)
    projection = replace(projection, points=laid.points)
    given = Target(aligned) if goal.mesh is not aligned else goal
    most = np.maximum(hidden_by_edges(laid.points, aligned), off)
    lies = exists & (projection.freedom.kind >= 0)
    above = heights(rest, x, laid.points, (goal, given), lies, most)
    return laid.points, confidence(rest, projection, given), above, str(laid)


def _taken(pair: AlignedPair) -> str:
    """How both surfaces' faces are taken, if not as they are."""
    ours = "; the source's coarse faces taken as round" if pair.refined else ""
    if pair.coarse:
        return f"; its coarse faces taken as round{ours}"
    return f"; its noise smoothed{ours}" if pair.blurred > 0 else ours


def _said(expressions: Expressions | None) -> str:
    if expressions is None:
        return ""
    if not expressions.count:
        return "; the face model does not fit the source: its expressions are not used"
    return f"; {expressions.count} known expressions help"


@dataclass(frozen=True, slots=True)
class FitTask:
    """One pair of aligned surfaces in ``frame``, the source to be displaced onto ``goal``."""

    pyramid: Pyramid
    goal: Target
    plan: Plan
    marks: Marks
    frame: Frame
    expressions: Expressions | None
    colours: Colours | None

    def deform(self) -> FloatArray:
        """Positions (n, 3) of the source's vertices on the target's shape."""
        seen = self.pyramid.seen
        source = Source(seen.mesh, self._fields(seen.mesh))
        current = Displacement.none(source)
        leading, weights = self.plan.weights, self.plan.fine_weights
        exact = replace(weights, landmark=_EXACTING * weights.landmark)
        for level, samples, level_weights, steps, momentum in (
            (self.pyramid.coarse, _COARSE_SAMPLES, leading, self.plan.coarse, 0.0),
            (self.pyramid.fine, self.plan.samples, exact, self.plan.fine, self.plan.momentum),
        ):
            fitting = self._fitting(source, level, samples, level_weights)
            current = fitting.run(current, steps, momentum)
        change = current.moved(source).vertices - source.mesh.vertices
        return self.pyramid.mesh.vertices + seen.prolonged(change)

    def _fields(self, mesh: Mesh) -> FloatArray:
        """The known expressions' fields (n, 3, k) at the vertices of ``mesh``; k may be 0."""
        if self.expressions is None:
            return np.zeros((len(mesh.vertices), 3, 0))
        points = self.frame.back(mesh.vertices)
        return self.expressions.at(points, vertex_normals(mesh)) / self.frame.unit

    def _fitting(
        self,
        source: Source,
        level: Level,
        samples: tuple[int, int, int],
        weights: Weights,
    ) -> Fitting:
        led = _INERT if len(self.marks.points) else 0.0
        return Fitting(
            source,
            level,
            self.goal,
            self.plan.loops,
            self.marks,
            weights,
            self.plan.static,
            np.zeros_like(source.mesh.vertices),
            self.plan.shown,
            self.plan.own,
            self.plan.inert + led,
            samples,
            None if self.colours is None else self.colours.restricted(self.pyramid.seen.kept),
        )
