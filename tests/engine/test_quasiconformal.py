from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.beltrami import folds, triangle_areas
from engine.errors import EngineError, QuasiconformalError
from engine.quasiconformal import (
    PreparedPlane,
    QuasiconformalSolver,
    compatible_points,
    quasiconformal_map,
)
from tests.engine.planes import (
    FacePlane,
    face_landmarks,
    face_plane,
    random_disk,
    square,
    square_boundary,
)
from tests.faces import (
    HEAD_MOUTH_OPEN,
    HEAD_NEUTRAL,
    ICT_JAW_OPEN,
    ICT_NEUTRAL,
)

SIDE = 21
METHODS = ["default", "minimal", "teichmueller", "paper", "paper_teichmueller"]


def spread_points(plane: FacePlane, count: int):
    """Inner vertices, each next one farthest from those before."""
    away = np.abs(plane.z[:, None] - plane.z[plane.boundary]).min(axis=1)
    chosen = []
    for _ in range(count):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.abs(plane.z - plane.z[chosen[-1]]))
    return np.array(chosen)


def with_boundary(plane: FacePlane, inner):
    inner = np.setdiff1d(inner, plane.boundary)
    return np.concatenate([plane.boundary, inner])


def inner_ring(z, count=8, radius=0.4):
    return np.array(
        [np.abs(z - radius * np.exp(2j * np.pi * k / count)).argmin() for k in range(count)]
    )


def square_problem(side=SIDE):
    z, faces = square(side, shake=0.2)
    ring = inner_ring(z)
    return z, faces, np.concatenate([square_boundary(side), ring]), ring


@pytest.fixture(scope="module")
def jaw():
    return face_plane(ICT_NEUTRAL, ICT_JAW_OPEN)


@pytest.fixture(scope="module")
def jaw_points(jaw):
    return with_boundary(jaw, jaw.surface_of[face_landmarks()])


@pytest.fixture(scope="module")
def jaw_solver(jaw, jaw_points):
    return QuasiconformalSolver(PreparedPlane(jaw.z, jaw.faces), jaw_points)


@pytest.mark.parametrize("method", METHODS)
def test_points_that_stay_give_the_identity_bit_for_bit(method):
    z, faces, points, _ = square_problem()
    found = quasiconformal_map(z, faces, points, z[points], method=method)
    assert found.z.tobytes() == z.tobytes()
    assert (found.solves, found.converged, len(found.folds)) == (0, True, 0)
    assert np.abs(found.mu).max() < 1e-12


def test_jaw_open_meets_every_landmark_without_folds_and_comes_near_the_truth(
    jaw, jaw_points, jaw_solver
):
    points = jaw_points
    found = jaw_solver.map(jaw.expressed[points])
    np.testing.assert_array_equal(found.z[points], jaw.expressed[points])
    assert len(found.folds) == 0
    assert found.converged
    assert found.residuals[-1] < 1e-3
    assert found.solves <= 8
    assert np.abs(found.mu).max() < 0.65
    moved = np.abs(jaw.expressed - jaw.z).mean()
    assert np.abs(found.z - jaw.expressed).mean() < 0.2 * moved


def test_a_frame_begun_at_its_neighbour_is_the_same_frame(jaw, jaw_points, jaw_solver):
    points, solver = jaw_points, jaw_solver
    aim = jaw.z[points] + np.multiply.outer([0.8, 0.9], jaw.expressed[points] - jaw.z[points])
    before = solver.map(aim[0])
    cold, warm = solver.map(aim[1]), solver.map(aim[1], start=before.z)
    np.testing.assert_allclose(warm.z, cold.z, atol=2e-3)
    assert warm.converged
    assert warm.solves <= cold.solves


def test_a_free_boundary_follows_its_landmarks(jaw):
    inner = np.setdiff1d(jaw.surface_of[face_landmarks()], jaw.boundary)
    found = quasiconformal_map(jaw.z, jaw.faces, inner, jaw.expressed[inner])
    np.testing.assert_array_equal(found.z[inner], jaw.expressed[inner])
    assert len(found.folds) == 0
    assert np.abs(found.mu).max() < 0.65


def test_pockets_with_triangles_of_a_billionth_of_the_disk_stay_unfolded():
    head = face_plane(HEAD_NEUTRAL, HEAD_MOUTH_OPEN)
    points = with_boundary(head, spread_points(head, 150))
    found = quasiconformal_map(head.z, head.faces, points, head.expressed[points])
    np.testing.assert_array_equal(found.z[points], head.expressed[points])
    assert len(found.folds) == 0


def test_noisy_points_are_met_once_the_contradictory_ones_are_dropped():
    z, faces = square(SIDE, shake=0.2)
    rim = square_boundary(SIDE)
    random = np.random.default_rng(3)
    inner = random.choice(np.setdiff1d(np.arange(len(z)), rim), 60, replace=False)
    points = np.concatenate([rim, inner])
    targets = z[points].copy()
    targets[len(rim) :] *= np.exp(0.2j)
    targets[len(rim) :] += 0.1 * random.normal(size=60) + 0.1j * random.normal(size=60)
    trusted = np.arange(len(points)) < len(rim)
    keep = compatible_points(z[points], targets, trusted)
    assert keep[trusted].all()
    assert 0 < np.count_nonzero(~keep) < 40
    found = quasiconformal_map(z, faces, points[keep], targets[keep])
    np.testing.assert_array_equal(found.z[points[keep]], targets[keep])
    assert len(found.folds) == 0


def test_true_positions_contradict_nothing(jaw, jaw_points):
    points = jaw_points
    nobody = np.zeros(len(points), bool)
    assert compatible_points(jaw.z[points], jaw.expressed[points], nobody).all()


def test_of_two_points_that_pass_each_other_the_trusted_one_stays():
    z, _, points, ring = square_problem()
    targets = z[points].copy()
    first, second = len(points) - len(ring), len(points) - len(ring) + 1
    targets[first] = z[ring[0]] + 1.6 * (z[ring[1]] - z[ring[0]])
    trusted = np.ones(len(points), bool)
    trusted[second:] = False
    keep = compatible_points(z[points], targets, trusted)
    assert keep[first]
    assert not keep[second]


def test_one_point_moves_everything_and_two_fix_a_similarity():
    z, faces = square(9, shake=0.2)
    shifted = quasiconformal_map(z, faces, np.array([3]), z[[3]] + 2 - 1j)
    np.testing.assert_allclose(shifted.z, z + 2 - 1j, atol=1e-14)
    two = np.array([0, 80])
    turned = quasiconformal_map(z, faces, two, 2j * z[two], tolerance=1e-9)
    np.testing.assert_allclose(turned.z, 2j * z, atol=1e-6)
    assert np.abs(turned.mu).max() < 1e-6


def test_where_every_vertex_is_constrained_nothing_is_left_to_solve():
    z, faces = square(5, shake=0.2)
    targets = z + 0.3 * z.conj()
    found = quasiconformal_map(z, faces, np.arange(len(z)), targets)
    np.testing.assert_array_equal(found.z, targets)
    assert found.solves == 0


def test_affine_boundary_values_nearly_give_the_affine_map():
    z, faces, points, _ = square_problem()
    affine = 1.3 * z + 0.25j * z.conj()
    found = quasiconformal_map(z, faces, points, affine[points], tolerance=1e-10)
    np.testing.assert_allclose(found.z, affine, atol=5e-4)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.1, 10.0), st.floats(-np.pi, np.pi), st.integers(0, 10**6))
def test_similarities_of_domain_and_targets_change_nothing(scale, turn, seed):
    z, faces, points, ring = square_problem(11)
    random = np.random.default_rng(seed)
    targets = z[points].copy()
    moves = random.uniform(-0.08, 0.08, (2, len(ring)))
    targets[-len(ring) :] += moves[0] + 1j * moves[1]
    found = quasiconformal_map(z, faces, points, targets, tolerance=1e-8)
    a = scale * np.exp(1j * turn)
    same = quasiconformal_map(a * z + 5, faces, points, a * targets + 5, tolerance=1e-8)
    np.testing.assert_allclose(same.z, a * found.z + 5, atol=1e-5 * scale)
    assert len(same.folds) == 0


def test_relabelling_vertices_and_faces_relabels_the_map():
    z, faces, points, ring = square_problem(13)
    targets = z[points].copy()
    targets[-len(ring) :] *= np.exp(0.5j)
    found = quasiconformal_map(z, faces, points, targets, tolerance=1e-9)
    random = np.random.default_rng(5)
    order = random.permutation(len(z))
    label = np.argsort(order)
    shuffled = np.roll(label[faces][random.permutation(len(faces))], 1, axis=1)
    same = quasiconformal_map(z[order], shuffled, label[points], targets, tolerance=1e-9)
    np.testing.assert_allclose(same.z, found.z[order], atol=1e-6)


@pytest.mark.parametrize("degrees", [60, 120])
def test_twists_of_the_inner_points_do_not_fold(degrees):
    z, faces, points, ring = square_problem()
    targets = z[points].copy()
    targets[-len(ring) :] *= np.exp(1j * np.radians(degrees))
    found = quasiconformal_map(z, faces, points, targets)
    np.testing.assert_array_equal(found.z[points], targets)
    assert len(folds(z[faces], faces, found.z)) == 0


def test_two_points_with_one_target_are_refused_by_index():
    z, faces, points, _ = square_problem()
    targets = z[points].copy()
    targets[-1] = targets[-3]
    with pytest.raises(QuasiconformalError) as caught:
        quasiconformal_map(z, faces, points, targets)
    assert caught.value.code == "impossible"
    assert caught.value.elements["points"] == [len(points) - 3, len(points) - 1]


def test_a_fully_constrained_face_that_is_turned_over_is_refused_by_index():
    z, faces = square(9, shake=0.2)
    points = faces[60]
    with pytest.raises(QuasiconformalError) as caught:
        quasiconformal_map(z, faces, points, z[points].conj())
    assert caught.value.code == "impossible"
    assert caught.value.elements["points"] == [0, 1, 2]


def test_targets_outside_a_fixed_boundary_are_refused_by_index():
    z, faces, points, ring = square_problem()
    targets = z[points].copy()
    targets[-2] = 1.05 + 0.2j
    with pytest.raises(QuasiconformalError) as caught:
        quasiconformal_map(z, faces, points, targets)
    assert caught.value.code == "impossible"
    assert caught.value.elements["points"] == [len(points) - 2]
    assert len(ring) > 2


def test_a_boundary_that_crosses_itself_is_refused():
    z, faces, points, _ = square_problem()
    targets = z[points].copy()
    targets[[3, 4]] = targets[[4, 3]]
    with pytest.raises(QuasiconformalError) as caught:
        quasiconformal_map(z, faces, points, targets)
    assert caught.value.code == "impossible"
    assert {3, 4} <= set(caught.value.elements["points"])


def test_what_is_not_reached_is_refused_within_the_budget_and_names_inner_points():
    z, faces, points, ring = square_problem()
    targets = z[points].copy()
    targets[-len(ring) :] = targets[-len(ring) :].conj()
    with pytest.raises(QuasiconformalError) as caught:
        quasiconformal_map(z, faces, points, targets, max_solves=40)
    assert caught.value.code == "not_reached"
    named = caught.value.elements["points"]
    assert named
    assert min(named) >= len(points) - len(ring)


def test_a_folded_domain_is_refused():
    z, faces = square(9)
    z[40] += 1
    with pytest.raises(QuasiconformalError) as caught:
        PreparedPlane(z, faces)
    assert caught.value.code == "domain_folded"


def test_the_literal_iteration_reports_its_history(jaw, jaw_points):
    points = jaw_points
    found = quasiconformal_map(
        jaw.z, jaw.faces, points, jaw.expressed[points], method="paper", max_solves=40
    )
    assert found.solves == len(found.residuals) + 1
    assert found.solves <= 40
    assert found.converged == (found.residuals[-1] < 0.01)
    np.testing.assert_array_equal(found.folds, folds(jaw.z[jaw.faces], jaw.faces, found.z))


def spread(domain, faces, mu):
    """Standard deviation over mean of |μ|, weighted by area: 0 for a Teichmüller map."""
    area, size = triangle_areas(domain[faces]), np.abs(mu)
    mean = np.average(size, weights=area)
    return np.sqrt(np.average((size - mean) ** 2, weights=area)) / mean


def test_the_literal_teichmueller_form_evens_out_the_coefficient():
    z, faces, points, ring = square_problem()
    targets = z[points].copy()
    targets[-len(ring) :] *= np.exp(0.3j)
    paper, even = (
        quasiconformal_map(z, faces, points, targets, method=method)
        for method in ("paper", "paper_teichmueller")
    )
    assert spread(z, faces, even.mu) < 0.5 * spread(z, faces, paper.mu)


def test_a_teichmueller_map_has_an_even_coefficient_and_no_folds(jaw, jaw_points):
    found = quasiconformal_map(
        jaw.z, jaw.faces, jaw_points, jaw.expressed[jaw_points], method="teichmueller"
    )
    assert found.converged
    assert found.residuals[-1] < 1e-3
    assert found.solves <= 60
    assert len(found.folds) == 0
    assert spread(jaw.z, jaw.faces, found.mu) <= 0.3
    np.testing.assert_array_equal(found.z[jaw_points], jaw.expressed[jaw_points])


def test_minimal_maps_have_the_lower_maximum(jaw, jaw_points, jaw_solver):
    targets = jaw.expressed[jaw_points]
    smooth = np.abs(jaw_solver.map(targets).mu)
    found = quasiconformal_map(
        jaw.z, jaw.faces, jaw_points, targets, method="minimal", max_solves=60
    )
    assert np.abs(found.mu).max() < 0.9 * smooth.max()
    assert len(found.folds) == 0
    np.testing.assert_array_equal(found.z[jaw_points], targets)


@pytest.mark.parametrize("method", METHODS)
def test_no_control_points_give_the_identity(method):
    z, faces = random_disk(60, 20, seed=1)
    nothing = np.zeros(0, np.int64)
    found = quasiconformal_map(z, faces, nothing, np.zeros(0, complex), method=method)
    assert found.z.tobytes() == z.tobytes()


@settings(max_examples=25, deadline=None)
@given(
    st.integers(20, 200),
    st.integers(8, 40),
    st.integers(1, 12),
    st.floats(0.0, 0.15),
    st.sampled_from(["fixed", "sliding", "free"]),
    st.integers(0, 10**6),
)
def test_random_meshes_meet_random_points_exactly_without_folds(
    count, rim, chosen, far, edge, seed
):
    z, faces = random_disk(count, rim, seed)
    random = np.random.default_rng(seed)
    inner = rim + random.choice(count, chosen, replace=False)
    turned = z[inner] * (1 - far * (1 - np.abs(z[inner])) * np.exp(2j * random.normal()))
    points, targets = inner, turned
    if edge == "fixed":
        points = np.concatenate([np.arange(rim), inner])
        targets = np.concatenate([z[:rim], turned])
    boundary = "sliding" if edge == "sliding" else "free"
    found = quasiconformal_map(z, faces, points, targets, boundary=boundary)
    np.testing.assert_array_equal(found.z[points], targets)
    assert len(found.folds) == 0
    assert np.abs(found.mu).max() < 1
    if edge != "free":
        assert np.abs(np.abs(found.z[:rim]) - 1).max() < 1e-12
        assert (np.angle(np.roll(found.z[:rim], -1) / found.z[:rim]) > 0).all()


def test_a_sliding_boundary_lets_rotations_and_disk_automorphisms_be_themselves():
    z, faces = random_disk(400, 60, seed=2)
    inner = np.array([np.abs(z - 0.5 * np.exp(2j * np.pi * k / 7)).argmin() for k in range(7)])
    turned = quasiconformal_map(
        z, faces, inner, z[inner] * np.exp(0.8j), boundary="sliding", tolerance=1e-9
    )
    np.testing.assert_allclose(turned.z, z * np.exp(0.8j), atol=1e-6)
    moebius = (z - 0.3j) / (1 + 0.3j * z)
    carried = quasiconformal_map(z, faces, inner, moebius[inner], boundary="sliding")
    held = quasiconformal_map(
        z,
        faces,
        np.concatenate([np.arange(60), inner]),
        np.concatenate([z[:60], moebius[inner]]),
    )
    assert np.abs(carried.z - moebius).mean() < 0.02
    assert np.abs(carried.z - moebius).mean() < 0.2 * np.abs(held.z - moebius).mean()
    assert np.abs(carried.mu).mean() < 0.3 * np.abs(held.mu).mean()


def test_targets_beyond_a_sliding_boundary_are_refused_by_index():
    z, faces = random_disk(100, 30, seed=3)
    inner = np.array([40, 50, 60])
    targets = z[inner].copy()
    targets[1] = 1.01j
    with pytest.raises(QuasiconformalError) as caught:
        quasiconformal_map(z, faces, inner, targets, boundary="sliding")
    assert caught.value.code == "impossible"
    assert caught.value.elements["points"] == [1]


@pytest.mark.parametrize("method", ["paper", "paper_teichmueller"])
def test_literal_methods_have_no_sliding_boundary(method):
    z, faces = random_disk(30, 10, seed=4)
    with pytest.raises(EngineError) as caught:
        quasiconformal_map(z, faces, np.array([15]), z[[15]], method=method, boundary="sliding")
    assert caught.value.code == "options"


def test_a_finer_mesh_takes_no_more_solves_and_gives_the_same_map():
    maps = []
    places = square(21)[0][inner_ring(square(21)[0])]
    for side in (21, 41, 81):
        z, faces = square(side)
        ring = np.abs(z[:, None] - places).argmin(axis=0)
        points = np.concatenate([square_boundary(side), ring])
        targets = z[points].copy()
        targets[-len(ring) :] *= np.exp(0.3j)
        found = quasiconformal_map(z, faces, points, targets)
        assert found.converged
        assert found.solves <= 6
        maps.append(found.z.reshape(side, side)[:: (side - 1) // 20, :: (side - 1) // 20])
    coarse, middle, fine = maps
    assert np.abs(fine - middle).mean() < 0.6 * np.abs(middle - coarse).mean()


def test_a_small_new_move_of_the_same_points_takes_two_solves(jaw, jaw_points, jaw_solver):
    here, there = jaw.z[jaw_points], jaw.expressed[jaw_points]
    first = jaw_solver.map(here + 0.5 * (there - here))
    second = jaw_solver.map(here + 0.51 * (there - here), start=first.z)
    assert second.converged
    assert second.solves <= 3
    assert len(second.folds) == 0


@pytest.mark.parametrize(("degrees", "most"), [(30, 0.9), (60, 0.9), (90, 0.9), (120, 0.92)])
def test_twisted_landmarks_of_a_face_arrive_without_folds(jaw, degrees, most):
    inner = np.setdiff1d(jaw.surface_of[face_landmarks()[17:]], jaw.boundary)
    points = np.concatenate([jaw.boundary, inner])
    middle = jaw.z[inner].mean()
    turned = (jaw.z[inner] - middle) * np.exp(1j * np.radians(degrees)) + middle
    targets = np.concatenate([jaw.z[jaw.boundary], turned])
    found = quasiconformal_map(jaw.z, jaw.faces, points, targets)
    np.testing.assert_array_equal(found.z[points], targets)
    assert len(found.folds) == 0
    assert np.abs(found.mu).max() <= most
