from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from engine.errors import RegistrationError
from engine.nearest import NormalAwareIndex
from engine.operators import face_areas, vertex_normals
from engine.registration import register
from engine.registration._lattice import lattice_of
from engine.registration._poses import starting_poses
from engine.registration._poses_kernels import named_sample, solve_positive, turn
from engine.registration._samples import fair_areas, surface_samples
from engine.topology import editable_surface
from engine.types import Mesh, Similarity
from tests.engine.remeshed import coarser, face, motion, part_of, relabelled
from tests.faces import HEAD_MOUTH_OPEN, HEAD_NEUTRAL, ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE

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


def skin(path: Path) -> Mesh:
    return editable_surface(face(path))[0].mesh


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


@pytest.mark.parametrize("degrees", [0, 70, 180])
def test_a_mask_a_tenth_of_a_head_finds_its_face(degrees: float) -> None:
    head, opened = (skin(path) for path in (HEAD_NEUTRAL, HEAD_MOUTH_OPEN))
    _, y, z = opened.vertices.T
    front = (z > np.quantile(z, 0.6)) & (y > 0.65 * y.min() + 0.35 * y.max())
    mask = editable_surface(part_of(opened, front))[0].mesh
    assert face_areas(mask).sum() < 0.11 * face_areas(head).sum()
    true = motion(degrees, SHIFT)
    found = register(head, mask.moved(true(mask.vertices)))
    assert degrees_off(found.source_from_target, true) < 2


def test_the_lower_half_of_a_face_is_found_under_an_expression(neutral: Mesh) -> None:
    smile = face(ICT_SMILE)
    low = part_of(smile, smile.vertices[:, 1] < np.median(smile.vertices[:, 1]))
    true = motion(150, SHIFT, 0.1)
    found = register(neutral, low.moved(true(low.vertices)))
    assert found.source_from_target.scale == pytest.approx(10, rel=1e-12)
    assert degrees_off(found.source_from_target, true) < 2
    assert 0.3 < found.matching_rate < 1


def beside(mesh: Mesh) -> Mesh:
    """The mesh with shoulders below and a turned copy of its upper third next to it."""
    third = part_of(mesh, mesh.vertices[:, 1] > np.quantile(mesh.vertices[:, 1], 2 / 3))
    size = np.ptp(mesh.vertices, axis=0)
    x, z = np.meshgrid(np.linspace(-1.5, 1.5, 20), np.linspace(-1, 1, 20), indexing="ij")
    sheet = np.stack([x * size[0], -0.8 * size[1] - x**2 * size[1] / 4, z * size[2]], axis=-1)
    corner = (np.arange(19)[:, None] * 20 + np.arange(19)).ravel()
    half = np.stack([corner, corner + 1, corner + 21], axis=1)
    other = np.stack([corner, corner + 21, corner + 20], axis=1)
    parts = [
        (mesh.vertices, mesh.faces),
        (motion(100, 1.5 * size)(third.vertices), third.faces),
        (sheet.reshape(-1, 3), np.concatenate([half, other])),
    ]
    first = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    faces = [faces + start for (_, faces), start in zip(parts, first, strict=False)]
    return Mesh(np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces))


@pytest.mark.parametrize("swapped", [False, True])
def test_parts_on_one_side_only_do_not_matter(neutral: Mesh, jaw_open: Mesh, swapped: bool) -> None:
    true = motion(140, SHIFT)
    first, second = (beside(jaw_open), neutral) if swapped else (neutral, beside(jaw_open))
    found = register(first, second.moved(true(second.vertices)))
    assert degrees_off(found.source_from_target, true) < 0.5


def test_spikes_and_noise_do_not_matter(neutral: Mesh, jaw_open: Mesh) -> None:
    random = np.random.default_rng(3)
    size = diagonal(neutral)
    vertices = jaw_open.vertices + 5e-4 * size * random.normal(size=jaw_open.vertices.shape)
    few = random.choice(len(vertices), len(vertices) // 20, replace=False)
    vertices[few] += 0.1 * size * random.normal(size=(len(few), 3))
    true = motion(170, SHIFT, 0.001)
    for source, target in ((neutral, vertices), (jaw_open.moved(vertices), neutral.vertices)):
        mesh = (jaw_open if source is neutral else neutral).moved(true(target))
        found = register(source, mesh).source_from_target
        assert degrees_off(found, true) < 0.5
        assert found.scale == pytest.approx(1000, rel=1e-12)


def test_the_scale_of_a_part_is_found_where_scale_is_free(neutral: Mesh) -> None:
    half = part_of(neutral, neutral.vertices[:, 0] < np.median(neutral.vertices[:, 0]))
    true = motion(120, SHIFT, 0.4)
    found = register(neutral, half.moved(true(half.vertices)), free_scale=True)
    assert found.source_from_target.scale == pytest.approx(2.5, rel=1e-3)


def test_a_wider_tolerance_takes_fewer_iterations(neutral: Mesh, jaw_open: Mesh) -> None:
    for method in ("default", "paper"):
        taken = [
            register(neutral, jaw_open, method=method, tolerance=tau).iterations
            for tau in (0.1, 1e-2, 1e-7)
        ]
        assert taken[0] <= taken[1] < taken[2]


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


def test_a_lattice_names_a_sample_about_as_near_as_the_nearest() -> None:
    random = np.random.default_rng(1)
    points = random.normal(size=(500, 3)) * [1, 2, 0.5]
    lattice = lattice_of(points, 0.1, 0.3)
    low, cell, shape, _ = lattice
    queries = low + random.uniform(size=(300, 3)) * shape * cell * 0.999
    named = np.array([named_sample(*q, lattice) for q in queries])
    inside = named >= 0
    assert inside.all()
    there = np.linalg.norm(queries - points[named], axis=1)
    boxed = points[((points >= low) & (points < low + shape * cell)).all(axis=1)]
    assert (there <= KDTree(boxed).query(queries)[0] + 2 * np.sqrt(3) * cell).all()
    assert named_sample(*(low - 1), lattice) == -1


def test_few_far_points_do_not_coarsen_a_lattice() -> None:
    points = np.random.default_rng(1).uniform(size=(1000, 3))
    points[::200] += 1e4
    assert lattice_of(points, 0.05, 0.1)[1] == pytest.approx(0.05)


def test_needles_do_not_count_as_surface() -> None:
    flat = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.9, 0], [0.5, 40, 0]])
    mesh = Mesh(flat, np.array([[0, 1, 2], [0, 2, 1], [0, 1, 3]]))
    assert face_areas(mesh)[2] == pytest.approx(20)
    assert np.allclose(fair_areas(mesh), 0.45)


def test_overlap_is_one_sided_where_a_half_lies_on_its_whole(neutral: Mesh) -> None:
    size = np.sqrt(face_areas(neutral).sum())
    whole = neutral.moved((neutral.vertices - neutral.vertices.mean(axis=0)) / size)
    half = part_of(whole, whole.vertices[:, 0] < 0)
    area = float(face_areas(half).sum())
    samples = surface_samples(whole, 1000), surface_samples(half, 500)
    there, back = starting_poses(*samples, (1.0, area)), starting_poses(*samples[::-1], (area, 1.0))
    assert 0.5 * area < there.overlap[0] <= area + 0.02
    assert back.overlap[0] == pytest.approx(there.overlap[0], rel=0.05)
    assert np.allclose(there.rotation[0], np.eye(3), atol=0.1)
    assert np.allclose(back.rotation[0], np.eye(3), atol=0.1)


def test_starting_poses_that_settle_in_one_place_count_once(neutral: Mesh) -> None:
    half = part_of(neutral, neutral.vertices[:, 0] < np.median(neutral.vertices[:, 0]))
    size = np.sqrt(face_areas(neutral).sum())
    samples = [surface_samples(mesh.moved(mesh.vertices / size), 1000) for mesh in (neutral, half)]
    share = float(face_areas(half).sum() / size**2)
    poses = starting_poses(samples[0], samples[1], (1.0, share))
    every = np.concatenate([poses.rotation.reshape(-1, 9), poses.translation], axis=1)
    assert len(every) > 4
    assert pdist(every, "sqeuclidean").min() > 0.04
    assert np.abs(poses.rotation[0] - np.eye(3)).max() < 0.1


def test_feet_beside_the_last_ones_are_the_closest_after_a_small_move(neutral: Mesh) -> None:
    index = NormalAwareIndex(neutral, 0.1 * diagonal(neutral))
    normals = vertex_normals(neutral)
    points = neutral.vertices + 0.003 * diagonal(neutral) * normals
    before = index.feet(points, normals)
    moved = points + 0.001 * diagonal(neutral)
    again, beside_them = index.feet(moved, normals), index.feet_beside(moved, before)
    same = np.isclose(again.distance, beside_them.distance)
    assert same.mean() > 0.98


def test_the_kernels_solve_and_turn_as_linear_algebra_does() -> None:
    random = np.random.default_rng(2)
    J, g = random.normal(size=(9, 6)), random.normal(size=6)
    x = g.copy()
    solve_positive(J.T @ J, x)
    assert np.allclose(J.T @ J @ x, g)
    step, before = random.normal(size=6), random.normal(size=(3, 4))
    after = before.copy()
    turn(after, step)
    expected = Rotation.from_rotvec(step[:3]).as_matrix() @ before
    expected[:, 3] += step[3:]
    assert np.allclose(after, expected)
