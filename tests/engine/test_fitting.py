"""How a surface is displaced onto a rough one along which nothing but its marks leads it."""

from dataclasses import replace

import numpy as np
import pytest

from engine.correspondence._aligned import AlignedPair
from engine.correspondence._fitting import (
    Displacement,
    Fitting,
    Source,
    Step,
    Target,
    Weights,
)
from engine.correspondence._levels import build_level
from engine.correspondence._marks import NO_MARKS, Marks
from engine.correspondence._plan import choose_plan
from engine.correspondence._pyramid import Pyramid
from engine.operators import face_areas
from engine.types import FloatArray, IntArray, Mesh
from tests.engine.remeshed import coarser, face, part_of, surface_of
from tests.engine.shapes import grid_faces
from tests.faces import ICT_NEUTRAL

COUNT = 31
STEPS = (Step(0.03, 0.05, 0.1),) * 6
SLIDE = np.array([0.05, 0.0, 0.0])


@pytest.fixture(scope="module")
def fitting() -> Fitting:
    """A flat sheet over [0, 1]²; marks at both ends slide along a target of rough heights."""
    y, x = (axis.ravel() for axis in np.meshgrid(*[np.linspace(0, 1, COUNT)] * 2, indexing="ij"))
    source = Mesh(np.stack([x, y, np.zeros_like(x)], axis=1), grid_faces(COUNT, COUNT))
    heights = np.random.default_rng(0).normal(0, 0.1 / COUNT, len(x))
    target = source.moved(source.vertices + heights[:, None] * [0, 0, 1])
    ends = source.vertices[np.abs(x - 0.5) > 0.45]
    n = len(x)
    return Fitting(
        Source(source, np.zeros((n, 3, 0))),
        build_level(source, (), n),
        Target(target),
        (),
        Marks(ends, np.tile([0.0, 0, 1], (len(ends), 1)), ends + SLIDE),
        Weights(),
        np.zeros(n),
        np.zeros((n, 3)),
        np.ones(n),
        np.ones(n),
        np.zeros(n),
        (n, n, n),
    )


def slid(fitting: Fitting, momentum: float, start: FloatArray) -> float:
    """The way that the middle has come along the target, in that of the marks."""
    begin = Displacement(start, np.zeros(0))
    moved = fitting.run(begin, STEPS, momentum).free[:, 0]
    middle = np.abs(fitting.source.mesh.vertices[:, 0] - 0.5) < 0.2
    return float(moved[middle].mean() / SLIDE[0])


def test_momentum_carries_skin_on_that_roughness_holds_back(fitting: Fitting) -> None:
    rest = np.zeros_like(fitting.source.mesh.vertices)
    slow, fast = (slid(fitting, momentum, rest) for momentum in (0.0, 0.7))
    assert slow < 0.6
    assert slow + 0.1 < fast < 1


def test_momentum_does_not_leave_the_answer(fitting: Fitting) -> None:
    there = np.tile(SLIDE, (len(fitting.source.mesh.vertices), 1))
    assert abs(slid(fitting, 0.7, there) - slid(fitting, 0.0, there)) < 0.1


def test_a_rough_target_s_planes_hold_skin_back_by_less(fitting: Fitting) -> None:
    rest = np.zeros_like(fitting.source.mesh.vertices)
    own, mixed = (
        replace(fitting, weights=replace(fitting.weights, mixed=mixed)) for mixed in (False, True)
    )
    assert slid(mixed, 0.0, rest) > 1.2 * slid(own, 0.0, rest)


def test_planes_are_a_target_s_own_unless_it_is_rough(fitting: Fitting) -> None:
    every, up = np.arange(COUNT**2), np.tile([0.0, 0, 1], (COUNT**2, 1))
    rough, flat = fitting.target, Target(fitting.source.mesh)
    leaning = np.tile([0.6, 0, 0.8], (COUNT**2, 1))
    assert np.allclose(flat.planes(every, leaning), up)
    tilts = [np.linalg.norm((n - up)[:, :2]) for n in (rough.planes(every, up), rough.normals)]
    assert tilts[0] < 0.7 * tilts[1]


class Counting(Target):
    """A target that notes how many samples were asked of it."""

    def __init__(self, mesh: Mesh) -> None:
        super().__init__(mesh)
        self.asked: list[int] = []

    def samples(self, count: int, turn: int) -> tuple[IntArray, FloatArray]:
        self.asked.append(count)
        return super().samples(count, turn)


def test_the_last_step_compares_more_of_a_target(fitting: Fitting) -> None:
    target = Counting(fitting.target.mesh)
    counted = replace(fitting, target=target, samples=(100, 100, 300))
    counted.run(Displacement.none(fitting.source), STEPS)
    assert target.asked == [100] * (len(STEPS) - 1) + [300]


def test_a_sensor_s_view_is_fitted_for_longer_and_by_more_of_its_vertices() -> None:
    surface = surface_of(coarser(face(ICT_NEUTRAL), 2200)[0])
    mesh = surface.mesh.moved(surface.mesh.vertices / np.sqrt(face_areas(surface.mesh).sum()))
    x = mesh.vertices[:, 0]
    half = Target(part_of(mesh, x < np.quantile(x, 0.5)))
    pair = AlignedPair(Pyramid.of(mesh, surface.loops), half, (), (), (0, 0))
    exposed = np.ones(len(mesh.vertices))
    clean, view, led = (
        choose_plan(one) for one in (pair, replace(pair, exposed=exposed), replace(pair, led=True))
    )
    assert len(view.fine) > len(clean.fine)
    assert view.fine[-1].smooth > clean.fine[-1].smooth
    assert view.weights.back > clean.weights.back
    assert view.fine_weights.stiff == 1
    assert view.momentum > clean.momentum == 0
    assert view.samples[1] > clean.samples[1]
    assert view.samples[2] == clean.samples[2] > clean.samples[1]
    assert clean.weights.mixed
    assert not led.weights.mixed
    assert led.samples[2] == led.samples[1]


@pytest.fixture(scope="module")
def bumped(fitting: Fitting) -> Fitting:
    """The sheet, without marks, and a smooth target that rises to 0.05 along its middle."""
    sheet = fitting.source.mesh
    rise = 0.05 * np.sin(np.pi * sheet.vertices[:, 0]) ** 2
    target = Target(sheet.moved(sheet.vertices + rise[:, None] * [0, 0, 1]))
    return replace(fitting, target=target, marks=NO_MARKS)


def risen(fitting: Fitting, start: Displacement, steps: tuple[Step, ...]) -> float:
    """How high the middle comes, in what it should."""
    moved = fitting.run(start, steps).free[:, 2]
    middle = np.abs(fitting.source.mesh.vertices[:, 0] - 0.5) < 0.05
    return float(moved[middle].mean() / 0.05)


def test_gradual_smoothness_keeps_less_of_a_displacement_back(bumped: Fitting) -> None:
    rest, steps = Displacement.none(bumped.source), (Step(0.25, 0.1, 0.1),) * 6
    gradual = replace(bumped, weights=replace(bumped.weights, gradual=0.5))
    plain, nearer = risen(bumped, rest, steps), risen(gradual, rest, steps)
    assert plain < 0.95
    assert 0 < 1 - nearer < 0.7 * (1 - plain)


def test_steps_that_begin_beyond_come_back_to_where_data_tell(bumped: Fitting) -> None:
    begin = bumped.run(Displacement.none(bumped.source), STEPS)
    beyond = (replace(STEPS[0], beyond=0.2), *STEPS[1:])
    assert risen(bumped, begin, STEPS) == pytest.approx(1, abs=0.02)
    assert risen(bumped, begin, beyond) == pytest.approx(1, abs=0.02)
    taken = bumped.run(begin.beyond(np.full(len(begin.free), 0.2)), STEPS)
    assert np.array_equal(bumped.run(begin, beyond).free, taken.free)


def test_no_motion_goes_on_where_what_pulls_is_other_skin(bumped: Fitting) -> None:
    foreign = np.abs(bumped.source.mesh.vertices[:, 0] - 0.5) < 0.1
    hidden = np.where(foreign, 0.0, 1.0)
    sheet = bumped.source.mesh
    lost = replace(
        bumped,
        shown=hidden,
        weights=replace(bumped.weights, gradual=0.5),
        target=Target(sheet.moved(sheet.vertices + np.array([0, 0, 0.05]))),
    )
    steps = tuple(replace(step, beyond=0.2) for step in STEPS)
    start = replace(Displacement.none(lost.source), free=0.2 * foreign[:, None] * [0, 1, 0])
    runs_on, comes_back = (
        np.abs(replace(lost, own=own).run(start, steps, 0.7).free[foreign, 1]).mean()
        for own in (np.ones(len(hidden)), hidden)
    )
    assert comes_back < 0.5 * runs_on


def test_a_complete_target_s_steps_begin_beyond_early_and_twice_late() -> None:
    surface = surface_of(coarser(face(ICT_NEUTRAL), 2200)[0])
    mesh = surface.mesh.moved(surface.mesh.vertices / np.sqrt(face_areas(surface.mesh).sum()))
    pair = AlignedPair(Pyramid.of(mesh, surface.loops), Target(mesh), (), (), (0, 0))
    half = Target(part_of(mesh, mesh.vertices[:, 0] < np.median(mesh.vertices[:, 0])))
    others = {"known": True}, {"target": half}, {"coarse": True}, {"refined": True}
    plan = choose_plan(pair)
    known, part, coarse, refined = (choose_plan(replace(pair, **other)) for other in others)
    assert [step.beyond > 0 for step in plan.fine] == [True, *[False] * 4, True, False, False]
    assert [step.beyond > 0 for step in plan.coarse] == [False, *[True] * 5, *[False] * 9]
    assert plan.fine_weights.gradual > plan.weights.gradual == 0
    assert plan.fine_weights.stiff > plan.weights.stiff == 1
    assert not any(step.beyond for step in known.fine)
    assert known.fine_weights.gradual == 0
    assert (part.coarse, part.fine) == (plan.coarse, plan.fine)
    assert not part.whole
    for other in (coarse, refined):
        assert other.fine[-1].smooth > plan.fine[-1].smooth
    assert refined.fine_weights.gradual == 0


def test_skin_is_held_that_rests_only_if_nearly_all_of_what_is_shown_does() -> None:
    surface = surface_of(coarser(face(ICT_NEUTRAL), 2200)[0])
    mesh = surface.mesh.moved(surface.mesh.vertices / np.sqrt(face_areas(surface.mesh).sum()))
    low = mesh.vertices[:, 1] < np.quantile(mesh.vertices[:, 1], 0.4)
    moved = mesh.moved(mesh.vertices + 0.02 * low[:, None] * np.array([0.0, 0.0, 1.0]))
    upper = mesh.vertices[:, 1] > np.quantile(mesh.vertices[:, 1], 0.45)
    same, other, part = (
        choose_plan(AlignedPair(Pyramid.of(mesh, surface.loops), Target(one), (), (), (0, 0)))
        for one in (mesh, moved, part_of(moved, upper))
    )
    assert same.weights.static > 0
    assert other.weights.static == 0
    assert part.weights.static > 0
    assert "held where it rests" in part.mode


def test_bending_costs_more_where_a_displacement_hardly_bends(fitting: Fitting) -> None:
    surface = fitting.level.surface
    across = np.abs(fitting.source.mesh.vertices[:, 0] - 0.5)
    tent = np.maximum(0.2 - across, 0)[:, None] * [0, 0, 1]
    stiffness = surface.stiffness(tent, 10.0)
    assert np.all(stiffness[across > 0.4] == 10)
    assert np.all(stiffness[across < 0.02] == 1)
    half = surface.stiffness(tent / 2, 10.0)
    assert np.all((half >= stiffness) & (half <= 10)) and np.any(half > stiffness)


def test_stiff_skin_keeps_noise_out_and_a_ridge_in(fitting: Fitting) -> None:
    sheet = fitting.source.mesh
    across, along = np.abs(sheet.vertices[:, :2] - 0.5).T
    ridge = np.maximum(0.1 - across, 0)
    heights = ridge + 0.2 * fitting.target.mesh.vertices[:, 2]
    target = Target(sheet.moved(sheet.vertices + heights[:, None] * [0, 0, 1]))
    both = replace(fitting, target=target, marks=NO_MARKS)
    rest = Displacement.none(fitting.source)
    steps = (Step(0.03, 0.1, 0.1),) * 6
    plain, stiff = (
        replace(both, weights=replace(Weights(), stiff=most)).run(rest, steps).free[:, 2] - ridge
        for most in (1.0, 10.0)
    )
    top, beside = across < 0.02, (across > 0.2) & (across < 0.4) & (along < 0.4)
    assert np.std(stiff[beside]) < 0.8 * np.std(plain[beside])
    assert abs(stiff[top].mean()) < 1.1 * abs(plain[top].mean()) + 0.002


def test_skin_at_rest_far_from_what_moves_is_held_where_vertices_tell_but_noise() -> None:
    surface = surface_of(coarser(face(ICT_NEUTRAL), 2200)[0])
    mesh = surface.mesh.moved(surface.mesh.vertices / np.sqrt(face_areas(surface.mesh).sum()))
    chin = np.linalg.norm(mesh.vertices - mesh.vertices[mesh.vertices[:, 2].argmax()], axis=1)
    bump = 0.03 * np.exp(-((chin / 0.05) ** 2))[:, None] * np.array([0.0, 0.0, 1.0])
    target = Target(mesh.moved(mesh.vertices + bump))
    clear = AlignedPair(Pyramid.of(mesh, surface.loops), target, (), (), (0, 0))
    plain, noisy = choose_plan(clear), choose_plan(replace(clear, blurred=1.0))
    far, beside = chin > 0.25, chin < 0.05
    assert plain.static[far].max() <= 1
    assert np.median(noisy.static[far]) > 20
    assert np.allclose(noisy.static[beside], plain.static[beside])
