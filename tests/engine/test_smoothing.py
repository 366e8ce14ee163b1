"""A sensor's noise is taken out of a target, its shape is not."""

import numpy as np
import pytest

from engine.correspondence._smoothing import roughness, steadied
from engine.types import FloatArray, Mesh

COUNT = 41


def bowl(height: float) -> Mesh:
    """A grid over [0, 1]² in a bowl so deep."""
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(0, 1, COUNT)] * 2))
    z = height * ((x - 0.5) ** 2 + (y - 0.5) ** 2)
    corner = np.arange(COUNT**2).reshape(COUNT, COUNT)
    a, b, c, d = (
        part.ravel()
        for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1])
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh(np.stack([x, y, z], axis=1), faces)


def inner(heights: FloatArray) -> FloatArray:
    return heights.reshape(COUNT, COUNT)[6:-6, 6:-6]


@pytest.mark.parametrize("depth", [0.5, 1.0])
def test_noise_is_halved_and_a_bowl_stays_as_deep(depth: float) -> None:
    mesh = bowl(depth)
    noise = 0.2 / (COUNT - 1) * np.random.default_rng(0).normal(size=COUNT**2)
    rough = mesh.moved(mesh.vertices + noise[:, None] * [0, 0, 1])
    steady = steadied(rough)
    off = inner((steady.mesh.vertices - mesh.vertices)[:, 2])
    assert steady.noisy
    assert off.std() < 0.6 * noise.std()
    assert abs(off.mean() - inner(noise).mean()) < 0.05 * noise.std()


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_roughness_is_that_of_the_noise_in_any_unit(unit: float) -> None:
    mesh = bowl(0.5)
    noise = np.random.default_rng(1).normal(size=COUNT**2)[:, None] * [0, 0, 1]
    part, all_of_it = (
        roughness(Mesh(unit * (mesh.vertices + share / (COUNT - 1) * noise), mesh.faces))
        for share in (0.05, 0.1)
    )
    assert roughness(mesh) < 0.01
    assert 0.03 < part < 0.07
    assert all_of_it == pytest.approx(2 * part, rel=0.1)


def test_what_is_not_rough_stays() -> None:
    mesh = bowl(2.0)
    steady = steadied(mesh)
    assert steady.mesh is mesh
    assert not steady.noisy
    assert steady.blurred == steady.off == 0


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_a_little_noise_is_told_and_taken_out(unit: float) -> None:
    """Few vertices are off by more than about twice the deviation."""
    mesh, deviation = bowl(0.5), 0.1 / (COUNT - 1)
    noise = deviation * np.random.default_rng(2).normal(size=COUNT**2)
    rough = Mesh(unit * (mesh.vertices + noise[:, None] * [0, 0, 1]), mesh.faces)
    steady = steadied(rough)
    off = inner((steady.mesh.vertices / unit - mesh.vertices)[:, 2])
    assert not steady.noisy
    assert 0 < steady.blurred < 1
    assert off.std() < 0.85 * inner(noise).std()
    assert 0.5 * deviation < steady.off / unit < 2 * deviation


def test_the_rougher_the_more_is_smoothed() -> None:
    """Without a jump: what is hardly rough hardly moves."""
    mesh = bowl(0.5)
    noise = np.random.default_rng(3).normal(size=COUNT**2)[:, None] * [0, 0, 1 / (COUNT - 1)]
    moved = []
    for share in (0.06, 0.07, 0.085, 0.1):
        rough = mesh.moved(mesh.vertices + share * noise)
        moved.append(np.linalg.norm(steadied(rough).mesh.vertices - rough.vertices))
    assert moved == sorted(moved)
    assert moved[0] < 0.3 * moved[-1]
