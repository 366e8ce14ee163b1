import numpy as np
import pytest

from engine.correspondence._corners import opened_corners, slit_parameters
from engine.correspondence._curves import ClosedCurve
from engine.correspondence._loops import pair_loops
from engine.correspondence._projection import in_order
from engine.types import FloatArray, IntArray, Mesh

ANGLES = np.arange(400) * 2 * np.pi / 400
AXIS = np.array([1.0, 0.0, 0.0])


def opened_mouth(random: np.random.Generator, count: int, jags: float) -> ClosedCurve:
    """A mouth opened to a rounded box, 1.2 times as wide as high, with a jagged rim."""
    angle = np.arange(count) * 2 * np.pi / count + random.uniform(0, 0.1)
    x, y = (np.sign(s) * np.abs(s) ** 0.8 for s in (np.cos(angle), np.sin(angle)))
    flat = np.stack([1.2 * x, y, np.zeros(count)], axis=1)
    return ClosedCurve(flat + jags * random.normal(size=flat.shape))


def ends(curve: ClosedCurve) -> FloatArray:
    return curve.at(np.array(opened_corners(curve, AXIS, 0.5)))


@pytest.mark.parametrize("count", [50, 200])
def test_corners_stay_whatever_the_jags_of_the_rim(count: int) -> None:
    random = np.random.default_rng(3)
    found = np.array([ends(opened_mouth(random, count, 0.02)) for _ in range(20)])
    assert (found[:, 0, 0] > 1.0).all() and (found[:, 1, 0] < -1.0).all()
    assert np.abs(found[:, :, 1]).max() < 0.25


def test_the_corners_of_a_slit_are_its_ends() -> None:
    angle = np.arange(80) * 2 * np.pi / 80
    slit = np.stack([np.cos(angle), 0.05 * np.sin(angle), 0.1 * np.cos(2 * angle)], axis=1)
    np.testing.assert_allclose(ends(ClosedCurve(slit))[:, 0], [1, -1], atol=0.01)


def slit(width: float) -> ClosedCurve:
    return ellipse(width, 0.04)


def opened(width: float) -> ClosedCurve:
    return ellipse(width, width)


def ellipse(width: float, height: float) -> ClosedCurve:
    flat = np.stack([width * np.cos(ANGLES), height * np.sin(ANGLES), 0 * ANGLES], axis=1)
    return ClosedCurve(flat)


def test_a_lip_stretches_evenly_or_at_its_corners() -> None:
    ours, theirs = slit(1.0), slit(1.5)
    at = ours.parameters[:-1]
    x = ours.points[:, 0]
    evenly, by_power = (
        theirs.at(slit_parameters(ours, theirs, at, power=power))[:, 0] for power in (1.0, 3.0)
    )
    np.testing.assert_allclose(evenly, 1.5 * x, atol=0.02)
    np.testing.assert_allclose(by_power, x + 0.5 * x**3, atol=0.02)
    shorter = theirs.parameters[:-1]
    np.testing.assert_allclose(
        ours.at(slit_parameters(theirs, ours, shorter, power=3.0))[:, 0],
        theirs.points[:, 0] / 1.5,
        atol=0.02,
    )


def ring(rim: ClosedCurve) -> tuple[Mesh, list[IntArray]]:
    """A flat annulus around a rim of 400 points, and its loops, the outer one first."""
    n = len(rim.points)
    outer = 4 * np.stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES], axis=1)
    ahead = np.roll(np.arange(n), -1)
    inward = np.stack([np.arange(n), n + np.arange(n), n + ahead], axis=1)
    outward = np.stack([np.arange(n), n + ahead, ahead], axis=1)
    faces = np.concatenate([inward, outward])
    mesh = Mesh(np.concatenate([rim.points, outer]) / 7, faces)
    return mesh, [n + np.arange(n), np.arange(n)]


def test_a_line_where_lips_touch_is_sharp_and_an_open_rim_is_not() -> None:
    closed, smiling, wide = (ring(curve) for curve in (slit(1.0), slit(1.2), opened(1.2)))
    for goal, sharp in ((smiling, True), (wide, False)):
        outer, inner = pair_loops(*closed, *goal, rims=True)
        assert outer.slides and not outer.sharp
        assert inner.sharp == sharp
        assert inner.restricted(np.arange(len(closed[0].vertices))).sharp == sharp
    assert not any(pair.sharp for pair in pair_loops(*closed, *smiling))


def test_an_opening_rim_keeps_its_middle_and_is_doubted_where_it_got_longer() -> None:
    closed, smiling, wide = (ring(curve) for curve in (slit(1.0), slit(1.2), opened(1.2)))
    rim = pair_loops(*closed, *wide, rims=True)[1]
    source = slit(1.0)
    stretched = 2 * np.pi * 1.2 / source.length
    middle, corner = 100, 0
    assert rim.trust[middle] == pytest.approx(1.0, abs=0.02)
    assert rim.trust[corner] < 1 / stretched**2
    assert rim.trust[corner] == pytest.approx(rim.trust.min())
    near = np.arange(middle - 30, middle + 31)
    kept = np.diff(np.unwrap(rim.parameters[near], period=rim.curve.length))
    np.testing.assert_allclose(kept, np.diff(source.parameters[near]) / 7, rtol=0.05)
    chosen = np.full(len(closed[0].vertices), -1)
    chosen[:400:4] = np.arange(100)
    np.testing.assert_array_equal(rim.restricted(chosen).trust, rim.trust[::4])
    for pair in (pair_loops(*closed, *smiling, rims=True)[1], pair_loops(*closed, *wide)[1]):
        assert (pair.trust == 1).all()


def test_a_slit_is_hardly_open_and_a_circle_is() -> None:
    assert slit(1.0).openness < 0.1
    assert abs(opened(1.0).openness - 1) < 1e-3


def test_a_rims_vertices_slide_without_passing_each_other() -> None:
    parameters = np.mod(np.linspace(0.3, 1.3, 40, endpoint=False), 1.0)
    calm = 0.005 * np.sin(4 * np.pi * parameters)
    np.testing.assert_allclose(in_order(parameters, calm, 1.0) % 1, (parameters + calm) % 1)
    wild = calm + 0.1 * np.sin(np.arange(40))
    after = in_order(parameters, wild, 1.0)
    gaps = np.mod(np.diff(after, append=after[:1]), 1.0)
    assert gaps.min() > 0.001
    np.testing.assert_allclose(gaps.sum(), 1.0)
