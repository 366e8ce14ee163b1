from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.beltrami import (
    BeltramiSolver,
    beltrami_coefficient,
    composed_coefficient,
    flat_triangles,
    folds,
    linear_beltrami_solve,
    orientations,
    triangle_areas,
)
from engine.errors import NumericalError
from engine.io import read_mesh
from engine.operators import face_areas
from tests.engine.planes import square, square_boundary
from tests.faces import ICT_NEUTRAL

unit = st.floats(0.0, 0.95)
angle = st.floats(-np.pi, np.pi)


@settings(max_examples=30, deadline=None)
@given(unit, angle, st.floats(0.1, 10.0), angle)
def test_affine_maps_have_the_coefficient_that_made_them(size, turn, scale, rotation):
    z, faces = square(7, shake=0.3)
    mu = size * np.exp(1j * turn)
    image = scale * np.exp(1j * rotation) * (z + mu * z.conj()) + 3 - 2j
    found = beltrami_coefficient(z[faces], faces, image)
    np.testing.assert_allclose(found, mu, atol=1e-12)


def test_an_orientation_reversing_map_has_infinite_or_large_coefficients():
    z, faces = square(5)
    assert np.isinf(beltrami_coefficient(z[faces], faces, z.conj())).all()
    assert (np.abs(beltrami_coefficient(z[faces], faces, z.conj() + 0.2 * z)) > 1).all()
    assert len(folds(z[faces], faces, z.conj())) == len(faces)


def test_moebius_maps_become_conformal_under_refinement():
    errors = []
    for side in (11, 21, 41):
        z, faces = square(side)
        w = 0.6 * z
        mu = beltrami_coefficient(w[faces], faces, (w - 0.3) / (1 - 0.3 * w))
        errors.append(np.abs(mu).max())
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


def test_a_smooth_quasiconformal_map_is_recovered_to_first_order():
    errors = []
    for side in (11, 21, 41):
        z, faces = square(side)
        image = z + 0.15 * np.sin(2 * z.real) * np.exp(0.5j * z.imag)
        x, y = z[faces].mean(axis=1).real, z[faces].mean(axis=1).imag
        f_x = 1 + 0.3 * np.cos(2 * x) * np.exp(0.5j * y)
        f_y = 1j + 0.075j * np.sin(2 * x) * np.exp(0.5j * y)
        exact = (f_x + 1j * f_y) / (f_x - 1j * f_y)
        errors.append(np.abs(beltrami_coefficient(z[faces], faces, image) - exact).max())
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


def test_flat_triangles_are_isometric_and_counter_clockwise():
    mesh = read_mesh(ICT_NEUTRAL).mesh
    corners = flat_triangles(mesh)
    space = mesh.vertices[mesh.faces]
    for i in range(3):
        length = np.linalg.norm(space[:, i] - space[:, i - 1], axis=1)
        np.testing.assert_allclose(np.abs(corners[:, i] - corners[:, i - 1]), length, rtol=1e-9)
    areas = triangle_areas(corners)
    np.testing.assert_allclose(areas, face_areas(mesh), rtol=1e-6, atol=1e-12)


def test_orientation_is_exact_where_doubles_are_not():
    step = 2.0**-53
    base = np.array([0.5 + 0.5j, 12 + 12j, 24 + 24j])
    above = base + np.array([step * 2j, 0, 0])
    below = base - np.array([step * 1j, 0, 0])
    assert orientations(np.array([base, above, below])).tolist() == [0, 1, -1]


def test_folds_are_relative_to_the_domain_and_name_the_faces():
    z, faces = square(4)
    image = z.copy()
    image[5] += 1.5
    turned = folds(z[faces], faces, image)
    assert len(turned) > 0
    assert (faces[turned] == 5).any(axis=1).all()
    assert len(folds(z[faces].conj(), faces, image.conj())) == len(turned)
    flat = np.zeros_like(z)
    assert len(folds(z[faces], faces, flat)) == len(faces)


@pytest.mark.parametrize("mu", [0.3 - 0.4j, -0.5j, 0.8 + 0j])
def test_solving_for_a_constant_coefficient_gives_it_back(mu):
    z, faces = square(25, shake=0.25)
    rim = square_boundary(25)
    image = linear_beltrami_solve(
        z[faces], faces, np.full(len(faces), mu), rim, (z + mu * z.conj())[rim]
    )
    np.testing.assert_allclose(image, z + mu * z.conj(), atol=1e-10)
    np.testing.assert_allclose(beltrami_coefficient(z[faces], faces, image), mu, atol=1e-4)


def test_one_analysis_serves_every_coefficient():
    z, faces = square(9, shake=0.2)
    rim = square_boundary(9)
    solver = BeltramiSolver(z[faces], faces, rim)
    for mu in (0.2j, 0.1 + 0j, 0.2j):
        values = (z + mu * z.conj())[rim]
        once = linear_beltrami_solve(z[faces], faces, np.full(len(faces), mu), rim, values)
        np.testing.assert_array_equal(solver.solve(np.full(len(faces), mu), values), once)


def test_with_a_free_boundary_no_flux_leaves_a_constant_map():
    z, faces = square(9, shake=0.2)
    mu = np.full(len(faces), 0.4 - 0.1j)
    image = linear_beltrami_solve(z[faces], faces, mu, np.array([0, 40]), np.full(2, 3 - 1j))
    np.testing.assert_allclose(image, 3 - 1j, atol=1e-12)


def test_coefficients_compose():
    z, faces = square(9, shake=0.2)
    f = z + 0.2 * np.sin(z.real) + 0.1j * z.imag**2
    g = f + 0.3 * f.conj() + 0.05 * f * f.conj()
    mu_f = beltrami_coefficient(z[faces], faces, f)
    mu_g = beltrami_coefficient(f[faces], faces, g)
    whole = beltrami_coefficient(z[faces], faces, g)
    np.testing.assert_allclose(
        composed_coefficient(mu_f, mu_g, z[faces], faces, f), whole, atol=1e-12
    )


def test_the_solver_refuses_what_is_not_elliptic_and_names_it():
    z, faces = square(5)
    mu = np.zeros(len(faces), complex)
    mu[3] = 1.0
    with pytest.raises(NumericalError) as caught:
        linear_beltrami_solve(z[faces], faces, mu, np.array([0, 1]), z[:2])
    assert caught.value.elements["faces"] == [3]


def test_the_solver_refuses_a_folded_domain_and_names_the_faces():
    z, faces = square(5)
    corners = z[faces]
    corners[2] = corners[2][::-1]
    with pytest.raises(NumericalError) as caught:
        BeltramiSolver(corners, faces, np.array([0, 1]))
    assert caught.value.elements["faces"] == [2]


def bent(z, mu):
    """A conformal map after an affine one of coefficient ``mu``: not affine, coefficient ``mu``."""
    return np.exp(0.4 * (z + mu * z.conj()))


@pytest.mark.parametrize("mu", [0.3 - 0.4j, 0.5j, 0.7 + 0j])
def test_a_constant_coefficient_of_a_map_that_is_not_affine_is_recovered_in_the_right_order(mu):
    places, coefficients = [], []
    for side in (11, 21, 41):
        z, faces = square(side, shake=0.1)
        rim = square_boundary(side)
        found = linear_beltrami_solve(
            z[faces], faces, np.full(len(faces), mu), rim, bent(z[rim], mu)
        )
        measured = beltrami_coefficient(z[faces], faces, bent(z, mu))
        places.append(np.abs(found - bent(z, mu)).mean())
        coefficients.append(np.abs(measured - mu).mean())
    assert np.log2(places[0] / places[-1]) / 2 > 1.5
    assert np.log2(coefficients[0] / coefficients[-1]) / 2 > 0.8
