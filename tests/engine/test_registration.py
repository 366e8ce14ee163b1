import numpy as np
import pytest

from engine.errors import RegistrationError
from engine.registration import register
from engine.types import Mesh, Similarity
from tests.engine.remeshed import coarser, face, motion, part_of, relabelled
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL

SHIFT = np.array([40.0, -7.0, 3.0])


@pytest.fixture(scope="module")
def neutral() -> Mesh:
    return face(ICT_NEUTRAL)


@pytest.fixture(scope="module")
def jaw_open() -> Mesh:
    return relabelled(coarser(face(ICT_JAW_OPEN), 5000)[0])[0]


def degrees_off(found: Similarity, true: Similarity) -> float:
    cosine = (np.trace(found.rotation @ true.rotation) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def diagonal(mesh: Mesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def test_a_mesh_registers_with_itself_as_it_is(neutral: Mesh) -> None:
    found = register(neutral, neutral)
    moved = found.source_from_target(neutral.vertices) - neutral.vertices
    assert np.abs(moved).max() < 1e-5 * diagonal(neutral)
    assert found.converged


@pytest.mark.parametrize(("degrees", "unit"), [(25, 1.0), (180, 10.0), (110, 0.01), (180, 1000.0)])
def test_pose_and_unit_are_found_under_an_expression(
    neutral: Mesh, jaw_open: Mesh, degrees: float, unit: float
) -> None:
    true = motion(degrees, SHIFT, unit)
    found = register(neutral, jaw_open.moved(true(jaw_open.vertices)))
    assert found.source_from_target.scale == pytest.approx(1 / unit, rel=1e-12)
    assert degrees_off(found.source_from_target, true) < 0.5
    assert found.matching_rate > 0.3


def test_half_a_face_in_another_pose_is_placed_on_the_whole(neutral: Mesh) -> None:
    half = part_of(neutral, neutral.vertices[:, 0] < np.median(neutral.vertices[:, 0]))
    true = motion(60, SHIFT)
    found = register(neutral, half.moved(true(half.vertices)))
    back = found.source_from_target(true(half.vertices))
    assert np.linalg.norm(back - half.vertices, axis=1).max() < 1e-3 * diagonal(neutral)


def test_any_scale_is_found_where_scale_is_free(neutral: Mesh) -> None:
    true = motion(30, SHIFT, 2.54)
    found = register(neutral, neutral.moved(true(neutral.vertices)), free_scale=True)
    assert found.source_from_target.scale == pytest.approx(1 / 2.54, rel=1e-4)


def test_the_answer_moves_with_the_target_and_repeats(neutral: Mesh, jaw_open: Mesh) -> None:
    first, again = register(neutral, jaw_open), register(neutral, jaw_open)
    assert np.array_equal(first.source_from_target.rotation, again.source_from_target.rotation)
    there = first.target_from_source(first.source_from_target(jaw_open.vertices))
    assert np.allclose(there, jaw_open.vertices, atol=1e-9)


def test_the_paper_method_reports_its_own_error_and_rate(neutral: Mesh) -> None:
    true = motion(5, np.array([0.5, 0.2, -0.3]))
    found = register(neutral, neutral.moved(true(neutral.vertices)), method="paper")
    assert np.all(np.diff(found.rms) <= 1e-9 * found.rms[0])  # ICP never gets worse
    assert found.matching_rate == pytest.approx((found.rms[0] - found.rms[-1]) / found.rms[0])
    assert found.iterations == len(found.rms)
    assert found.rms[-1] < 1e-3 * diagonal(neutral)


def test_the_paper_method_stops_at_the_given_number_of_iterations(neutral: Mesh) -> None:
    turned = neutral.moved(motion(15, SHIFT)(neutral.vertices))
    found = register(neutral, turned, method="paper", tolerance=1e-9, max_iterations=3)
    assert found.iterations == 3
    assert not found.converged


def test_one_step_of_the_paper_method_is_procrustes() -> None:
    # far apart points keep their partners, so one step solves eq. (1)
    corners = np.array([[0, 0, 0], [10, 0, 0], [0, 20, 0], [0, 0, 40.0]])
    source = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    true = motion(4, np.array([0.3, -0.2, 0.1]))
    found = register(source, source.moved(true(corners)), method="paper")
    assert np.allclose(found.source_from_target(true(corners)), corners, atol=1e-9)
    assert found.rms[0] < 1e-9


@pytest.mark.parametrize(
    ("vertices", "code"),
    [
        (np.zeros((2, 3)), "too_few_points"),
        (np.outer(np.arange(5.0), [1, 2, 3]), "degenerate"),
        (np.zeros((4, 3)), "degenerate"),
    ],
)
def test_points_without_a_pose_are_refused(neutral: Mesh, vertices: np.ndarray, code: str) -> None:
    with pytest.raises(RegistrationError) as refusal:
        register(neutral, Mesh(vertices, np.zeros((0, 3), dtype=int)))
    assert refusal.value.code == code


def test_a_point_cloud_is_refused_unless_the_method_needs_no_surface(neutral: Mesh) -> None:
    cloud = Mesh(neutral.vertices, np.zeros((0, 3), dtype=int))
    with pytest.raises(RegistrationError, match="paper"):
        register(neutral, cloud)
    assert register(neutral, cloud, method="paper").rms[-1] < 1e-9
