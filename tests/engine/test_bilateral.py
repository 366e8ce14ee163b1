"""Noise is averaged out within smooth parts of a surface, not across its creases."""

import numpy as np

from engine.correspondence._bilateral import denoised
from engine.types import FloatArray, Mesh
from tests.engine.test_smoothing import COUNT, bowl

EDGE = 1 / (COUNT - 1)


def roof() -> Mesh:
    """Two planes that meet at right angles over the line x = 0.5."""
    flat = bowl(0.0)
    x = flat.vertices[:, 0]
    return flat.moved(flat.vertices + np.abs(x - 0.5)[:, None] * [0, 0, -1])


def noise(seed: int, share: float) -> FloatArray:
    return share * EDGE * np.random.default_rng(seed).normal(size=(COUNT**2, 3))


def height(mesh: Mesh) -> FloatArray:
    """How far vertices are above the roof (n,)."""
    x = mesh.vertices
    return (x[:, 2] + np.abs(x[:, 0] - 0.5)) * np.sqrt(0.5)


def test_noise_is_averaged_out_and_a_crease_stays_sharp() -> None:
    mesh = roof()
    ridge = np.abs(mesh.vertices[:, 0] - 0.5) < 0.1 * EDGE
    inside = (np.abs(mesh.vertices[:, :2] - 0.5) < 0.4).all(axis=1)
    before = mesh.moved(mesh.vertices + noise(0, 0.06))
    kept, levelled = denoised(before, 0.15), denoised(before, 100.0)
    slope = inside & ~ridge
    assert height(kept)[slope].std() < 0.75 * height(before)[slope].std()
    sunk, sunk_by_all = (height(one)[inside & ridge].mean() for one in (kept, levelled))
    assert abs(sunk) < 0.03 * EDGE
    assert sunk_by_all < -0.08 * EDGE


def test_a_plane_stays_a_plane() -> None:
    mesh = bowl(0.0)
    assert np.abs(denoised(mesh, 0.15).vertices - mesh.vertices).max() < 1e-12


def test_only_like_normals_are_averaged() -> None:
    mesh = roof()
    rough = mesh.moved(mesh.vertices + noise(1, 0.06))
    assert np.abs(denoised(rough, 1e-4).vertices - rough.vertices).max() < 1e-3 * EDGE


def test_vertices_without_faces_stay() -> None:
    mesh = roof()
    lone = Mesh(np.vstack((mesh.vertices + noise(2, 0.06), [[7.0, 8.0, 9.0]])), mesh.faces)
    assert np.array_equal(denoised(lone, 0.15).vertices[-1], [7.0, 8.0, 9.0])
