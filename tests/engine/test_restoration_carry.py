import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.errors import RestorationError
from engine.io import read_mesh
from engine.restoration import Restorer, restore, restore_paper, turned_faces
from engine.types import Mesh, SurfacePoints
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE

TURN = Rotation.from_rotvec([0.9, -1.8, 0.7]).as_matrix()


def grid(count, height=lambda x, y: 0 * x, width=1.0):
    x, y = (a.ravel() for a in np.meshgrid(*2 * [np.linspace(0, width, count)], indexing="ij"))
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    a, b, c, d = corner, corner + count, corner + count + 1, corner + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(np.stack([x, y, height(x, y)], 1), faces)


@pytest.fixture(scope="module")
def face():
    return read_mesh(ICT_NEUTRAL).mesh


@pytest.fixture(scope="module")
def restorer(face):
    return Restorer(face)


@pytest.fixture(scope="module")
def smile(face):
    return read_mesh(ICT_SMILE).mesh.vertices


def size(mesh):
    return np.linalg.norm(np.ptp(mesh.vertices, axis=0))


def at_vertices(mesh, vertices):
    first = np.full(len(mesh.vertices), -1)
    first[mesh.faces.ravel()] = np.arange(mesh.faces.size) // 3
    hit = first[vertices]
    return SurfacePoints(hit, (mesh.faces[hit] == np.asarray(vertices)[:, None]).astype(float))


def test_the_source_itself_is_returned(face, restorer):
    x = restorer.carry(face.vertices, np.ones(len(face.vertices)))
    assert np.abs(x - face.vertices).max() < 1e-10 * size(face)


@pytest.mark.parametrize("scale", [1.0, 0.01, 30.0])
def test_a_similar_copy_is_returned_even_where_half_of_it_is_unknown(face, restorer, scale):
    moved = scale * face.vertices @ TURN.T + [3.0, -20.0, 5.0]
    known = (face.vertices[:, 0] > 0).astype(float)
    seen = np.where(known[:, None] > 0, moved, np.nan)
    assert np.abs(restorer.carry(seen, known) - moved).max() < 1e-7 * scale * size(face)


def test_clean_data_are_followed_without_turning_a_triangle(face, restorer, smile):
    x = restorer.carry(smile, np.ones(len(smile)))
    off = np.linalg.norm(x - smile, axis=1) / size(face)
    assert off.mean() < 2.5e-4 and off.max() < 5e-3
    assert not len(turned_faces(face, face.vertices, x))


def test_noise_of_a_scan_is_not_copied(face, restorer, smile):
    noise = 1e-3 * size(face) * np.random.default_rng(0).normal(size=smile.shape)
    x = restorer.carry(smile + noise, np.ones(len(smile)))
    off = np.linalg.norm(x - smile, axis=1)
    assert off.mean() < 0.45 * np.linalg.norm(noise, axis=1).mean()
    assert not len(turned_faces(face, face.vertices, x))


@pytest.mark.parametrize("exact", [False, True])
def test_what_wild_data_turn_over_is_opened(face, restorer, smile, exact):
    rng, nose = np.random.default_rng(1), face.vertices[1514]
    near = np.linalg.norm(face.vertices - nose, axis=1) < 0.1 * size(face)
    wild = smile + 0.02 * size(face) * near[:, None] * rng.normal(size=smile.shape)
    points, goal = at_vertices(face, [1514, 3924]), smile[[1514, 3924]]
    x = restorer.carry(wild, np.ones(len(smile)), (points, goal) if exact else None)
    assert not len(turned_faces(face, face.vertices, x))
    if exact:
        assert np.abs(points.on(face.moved(x)) - goal).max() < 1e-9 * size(face)


def test_missing_parts_continue_smoothly(face, restorer, smile):
    x, y, _ = (face.vertices / size(face)).T
    middle = y[np.argmax(face.vertices[:, 2])]
    missing = (x > 0.02) & (np.abs(y - middle) < 0.08)
    seen = np.where(missing[:, None], 1e3, smile)
    off = np.linalg.norm(restorer.carry(seen, (~missing).astype(float)) - smile, axis=1)
    stayed = np.linalg.norm(face.vertices - smile, axis=1)
    assert off[missing].mean() < 0.5 * stayed[missing].mean()


def test_details_survive_on_a_smooth_bent_target():
    wave, depth, radius = 2 * np.pi / 0.03, 0.002, 0.6

    def bumps(x, y):
        return depth * np.sin(wave * x) * np.sin(wave * y)

    source = grid(130, bumps)
    x, y, height = source.vertices.T
    angle = (x - 0.5) / radius
    smooth = np.stack([radius * np.sin(angle), y, radius * np.cos(angle)], 1)
    carried = Restorer(source).carry(smooth, np.ones(len(smooth)))
    inside = (np.abs(x - 0.5) < 0.4) & (np.abs(y - 0.5) < 0.4)
    raised = np.hypot(carried[:, 0], carried[:, 2]) - radius
    kept = raised[inside] @ height[inside] / (height[inside] @ height[inside])
    assert 0.9 < kept < 1.1


def test_exact_points_are_exact_and_data_around_them_follow(face, restorer, smile):
    rng = np.random.default_rng(1)
    points = SurfacePoints(rng.integers(0, len(face.faces), 60), rng.dirichlet(np.ones(3), 60))
    wrong = smile + 0.02 * size(face) * np.sin(20 * face.vertices / size(face))
    goal = points.on(face.moved(smile))
    plain = restorer.carry(wrong, np.ones(len(smile)))
    x = restorer.carry(wrong, np.ones(len(smile)), (points, goal))
    assert np.abs(points.on(face.moved(x)) - goal).max() < 1e-9 * size(face)
    error = [np.linalg.norm(carried - smile, axis=1).mean() for carried in (plain, x)]
    assert error[1] < 0.8 * error[0]


def test_the_answer_does_not_depend_on_how_the_file_numbers(face, restorer, smile):
    random = np.random.default_rng(5)
    order, faces = random.permutation(len(face.vertices)), random.permutation(len(face.faces))
    other = Restorer(Mesh(face.vertices[order], np.argsort(order)[face.faces[faces]]))
    points = at_vertices(face, [8000, 1200, 4400])
    there = SurfacePoints(np.argsort(faces)[points.face], points.barycentric)
    goals = points.on(face) + np.array([0.1, 0.3, 0.2])
    known = random.random(len(face.vertices))
    for one, same in (
        (restorer.deform(points, goals), other.deform(there, goals)),
        (
            restorer.carry(smile, known, (points, goals)),
            other.carry(smile[order], known[order], (there, goals)),
        ),
    ):
        np.testing.assert_allclose(same, one[order], atol=1e-8 * size(face))


def test_points_that_contradict_each_other_are_named(face, restorer, smile):
    points = at_vertices(face, [100, 2000, 100])
    goal = points.on(face)
    goal[2, 2] += 0.1 * size(face)
    with pytest.raises(RestorationError) as caught:
        restorer.carry(smile, np.ones(len(smile)), (points, goal))
    assert caught.value.code == "contradictory_points"
    assert caught.value.elements["points"] == [0, 2]
    assert pickle.loads(pickle.dumps(caught.value)).elements == caught.value.elements
    same = points.on(face.moved(smile))
    x = restorer.carry(smile, np.ones(len(smile)), (points, same))
    assert np.abs(x[[100, 2000]] - same[:2]).max() < 1e-9 * size(face)


def test_nothing_known_is_refused(face, restorer):
    with pytest.raises(RestorationError) as caught:
        restorer.carry(face.vertices, np.zeros(len(face.vertices)))
    assert caught.value.code == "nothing_known"


def test_handles_and_fixed_points_are_met_and_skin_is_pulled_along(face, restorer):
    handles, fixed = at_vertices(face, [1401, 3272]), at_vertices(face, [1225, 5708])
    goal = handles.on(face) + np.array([[0, 0.02, 0.05], [0.0, -0.02, 0.03]]) * size(face)
    x = restorer.deform(handles, goal, fixed=fixed)
    moved = face.moved(x)
    assert np.abs(handles.on(moved) - goal).max() < 1e-9 * size(face)
    assert np.abs(fixed.on(moved) - fixed.on(face)).max() < 1e-9 * size(face)
    assert not len(turned_faces(face, face.vertices, x))
    shift = np.linalg.norm(x - face.vertices, axis=1)
    near = np.linalg.norm(face.vertices[:, None] - handles.on(face), axis=2).min(axis=1)
    assert shift[near > 0.4 * size(face)].max() < 0.02 * shift.max()
    assert shift[near < 0.03 * size(face)].min() > 0.3 * shift.max()


def test_far_moves_leave_no_face_turned_over_and_are_met_exactly(face, restorer):
    rng = np.random.default_rng(2)
    for _ in range(3):
        corners = rng.choice(np.unique(face.faces), 8, replace=False)
        points = SurfacePoints(
            at_vertices(face, corners).face, rng.dirichlet(np.ones(3), len(corners))
        )
        goal = points.on(face)
        way = rng.normal(size=(4, 3))
        goal[:4] += 0.08 * size(face) * way / np.linalg.norm(way, axis=1, keepdims=True)
        x = restorer.deform(points, goal)
        assert not len(turned_faces(face, face.vertices, x))
        assert np.abs(points.on(face.moved(x)) - goal).max() < 1e-9 * size(face)


def test_a_point_may_be_pushed_past_a_fixed_neighbour():
    plate = grid(41)
    pushed, fixed = at_vertices(plate, [20 * 41 + 16]), at_vertices(plate, [20 * 41 + 20])
    goal = pushed.on(plate) + np.array([0.0, 0.2, 0.0])
    x = Restorer(plate).deform(pushed, goal, fixed=fixed)
    assert not len(turned_faces(plate, plate.vertices, x))
    assert np.abs(pushed.on(plate.moved(x)) - goal).max() < 1e-9
    assert np.abs(fixed.on(plate.moved(x)) - fixed.on(plate)).max() < 1e-9


def test_faces_that_the_base_turned_over_are_left_as_they_are():
    plate = grid(41)
    base = plate.vertices.copy()
    base[210, :2] += 1.6 / 40
    already = turned_faces(plate, plate.vertices, base)
    assert len(already)
    points = at_vertices(plate, [30 * 41 + 30])
    x = Restorer(plate).deform(points, points.on(plate) + np.array([0.1, 0.1, 0.0]), base=base)
    np.testing.assert_array_equal(turned_faces(plate, plate.vertices, x), already)


def test_unused_vertices_and_faces_without_area_do_no_harm():
    plain = grid(15, lambda x, y: 0.1 * x * y)
    middle = 0.5 * (plain.vertices[0] + plain.vertices[1])
    vertices = np.vstack([plain.vertices, middle, [0.5, 0.5, 1.0]])
    mesh = Mesh(vertices, np.vstack([plain.faces, [0, 1, len(plain.vertices)]]))
    moved = vertices @ TURN.T
    carried = Restorer(mesh).carry(moved, np.ones(len(moved)))
    assert np.abs(carried - moved).max() < 1e-8
    assert not len(turned_faces(mesh, vertices, carried))
    half = Restorer(mesh).blend([vertices + np.array([0, 0, 1.0])], np.array([0.5]))
    assert np.abs(half - vertices - np.array([0, 0, 0.5])).max() < 1e-8


def test_handles_act_on_an_already_edited_base(face, restorer, smile):
    handles = at_vertices(face, [1401])
    still = restorer.deform(handles, handles.on(face.moved(smile)), base=smile)
    assert np.abs(still - smile).max() < 1e-9 * size(face)
    goal = handles.on(face.moved(smile)) + 0.03 * size(face)
    x = restorer.deform(handles, goal, base=smile)
    assert np.abs(handles.on(face.moved(x)) - goal).max() < 1e-9 * size(face)


def test_without_handles_nothing_moves(face, restorer):
    none = SurfacePoints(np.zeros(0, np.int64), np.zeros((0, 3)))
    np.testing.assert_array_equal(restorer.deform(none, np.zeros((0, 3))), face.vertices)


@pytest.mark.parametrize("detail", [False, True])
def test_algorithm_5_is_the_least_squares_solution_of_its_system(detail):
    mesh = grid(9, lambda x, y: 0.2 * np.sin(5 * x) * y)
    n, known = len(mesh.vertices), np.array([0, 11, 40, 63, 80])
    goal = mesh.vertices[known] + np.random.default_rng(2).normal(size=(5, 3))
    W = np.zeros((n, n))
    for i, j, k in (np.roll(t, -s) for t in mesh.faces for s in range(3)):
        a, b = mesh.vertices[[i, j]] - mesh.vertices[k]
        half = 0.5 * (a @ b) / np.linalg.norm(np.cross(a, b))
        W[[i, j], [j, i]] -= half
        W[[i, j], [i, j]] += half
    A = np.vstack([W, np.eye(n)[known]])
    b = np.vstack([W @ mesh.vertices if detail else np.zeros((n, 3)), goal])
    expected = np.linalg.lstsq(A, b)[0]
    np.testing.assert_allclose(restore_paper(mesh, known, goal, detail=detail), expected, atol=1e-9)


def test_restore_serves_both_methods(face, smile):
    sure = np.ones(len(smile))
    np.testing.assert_array_equal(restore(face, smile, sure), Restorer(face).carry(smile, sure))
    some = (np.arange(len(smile)) % 7 == 0).astype(float)
    known = np.flatnonzero(some)
    np.testing.assert_array_equal(
        restore(face, smile, some, method="paper"), restore_paper(face, known, smile[known])
    )


def test_turned_faces_ignore_motion_and_bending_but_see_flips_and_collapse(face):
    moved = 3 * face.vertices @ TURN.T + 7
    assert not len(turned_faces(face, face.vertices, moved))
    opened = read_mesh(ICT_JAW_OPEN).mesh.vertices
    assert not len(turned_faces(face, face.vertices, opened))
    flat = grid(20)
    rolled = flat.vertices.copy()
    rolled[:, 0], rolled[:, 2] = np.sin(5 * flat.vertices[:, 0]), np.cos(5 * flat.vertices[:, 0])
    assert not len(turned_faces(flat, flat.vertices, rolled))
    flipped = flat.vertices.copy()
    flipped[210, :2] += 1.6 / 19
    found = turned_faces(flat, flat.vertices, flipped)
    assert len(found) and (flat.faces[found] == 210).any(axis=1).all()
    crushed = flat.vertices.copy()
    crushed[210] = crushed[211]
    found = turned_faces(flat, flat.vertices, crushed)
    assert set(np.flatnonzero(np.isin(flat.faces, [210, 211]).sum(axis=1) == 2)) <= set(found)
