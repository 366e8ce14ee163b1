import numpy as np
import pytest

from engine.correspondence._corners import opened_corners
from engine.correspondence._curves import ClosedCurve
from engine.correspondence._projection import in_order
from engine.types import FloatArray

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


def test_a_rims_vertices_slide_without_passing_each_other() -> None:
    parameters = np.mod(np.linspace(0.3, 1.3, 40, endpoint=False), 1.0)
    calm = 0.005 * np.sin(4 * np.pi * parameters)
    np.testing.assert_allclose(in_order(parameters, calm, 1.0) % 1, (parameters + calm) % 1)
    wild = calm + 0.1 * np.sin(np.arange(40))
    after = in_order(parameters, wild, 1.0)
    gaps = np.mod(np.diff(after, append=after[:1]), 1.0)
    assert gaps.min() > 0.001
    np.testing.assert_allclose(gaps.sum(), 1.0)
