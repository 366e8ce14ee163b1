import json
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.errors import RestorationError
from engine.io import read_mesh
from engine.restoration import Blender, PointWeights, blend, turned_faces, vertex_weights
from engine.types import Mesh, SurfacePoints
from tests.faces import DATA, ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE

LANDMARKS = json.loads((DATA / "ict_face" / "landmarks.json").read_text())["multi_pie_68"]


@pytest.fixture(scope="module")
def face():
    return read_mesh(ICT_NEUTRAL).mesh


@pytest.fixture(scope="module")
def shapes():
    return [read_mesh(path).mesh.vertices for path in (ICT_JAW_OPEN, ICT_SMILE)]


@pytest.fixture(scope="module")
def blender(face, shapes):
    return Blender(face, shapes)


def size(mesh):
    return np.linalg.norm(np.ptp(mesh.vertices, axis=0))


def at_landmark(face, *landmarks):
    vertices = [LANDMARKS[i] for i in landmarks]
    hit = [np.flatnonzero((face.faces == v).any(axis=1))[0] for v in vertices]
    weights = (face.faces[hit] == np.array(vertices)[:, None]).astype(float)
    return SurfacePoints(np.array(hit), weights)


def test_pure_weights_give_the_source_and_the_shapes_bit_for_bit(face, blender, shapes):
    n = len(face.vertices)
    for shape, weights in [(face.vertices, [0, 0]), (shapes[0], [1, 0]), (shapes[1], [0, 1])]:
        np.testing.assert_array_equal(blender.at(np.array(weights, float)), shape)
        field = np.repeat(np.array(weights, float)[:, None], n, axis=1)
        np.testing.assert_array_equal(blender.at(field), shape)


@pytest.mark.parametrize("field", [False, True])
def test_blends_tend_to_the_pure_ones(face, blender, shapes, field):
    for shape, limit in [(face.vertices, [0, 0]), (shapes[0], [1, 0]), (shapes[1], [0, 1])]:
        for step in (1e-3, 1e-6):
            weights = np.add(limit, [-step, step])
            if field:
                weights = weights[:, None] * np.linspace(1, 1 + step, len(shape))
            off = np.abs(blender.at(weights) - shape).max()
            assert off < step * size(face)


def test_even_steps_in_the_weight_are_even_steps_of_the_surface(face, blender):
    path = [blender.at(np.array([a, 0.4 * a])) for a in np.linspace(-0.5, 1.5, 41)]
    steps = np.array([np.abs(b - a).max() for a, b in pairwise(path)])
    assert steps.max() < 1.5 * np.median(steps)


@pytest.mark.parametrize("weight", [-0.5, 0.5, 1.5])
def test_faces_stay_upright_within_and_beyond_the_shapes(face, blender, weight):
    x = blender.at(np.array([weight, 0.0]))
    assert len(turned_faces(face, face.vertices, x)) <= 2e-3 * len(face.faces)
    assert np.abs(x - face.vertices).max() < 0.3 * size(face)


def hinged_plate(angle):
    """A plate whose half x > 0 turned about the y axis."""
    x, y = (
        a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 41), np.linspace(0, 1, 21), indexing="ij")
    )
    corner = (np.arange(40)[:, None] * 21 + np.arange(20)).ravel()
    a, b, c, d = corner, corner + 21, corner + 22, corner + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    right = np.maximum(x, 0)
    turned = np.stack([x - right + right * np.cos(angle), y, right * np.sin(angle)], 1)
    return Mesh(np.stack([x, y, 0 * x], 1), faces), turned


def edge_lengths(vertices, faces):
    return np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2)


@pytest.mark.parametrize("degrees", [40, 120, -170])
def test_a_jaw_swings_on_an_arc(degrees):
    plate, turned = hinged_plate(np.radians(degrees))
    before = edge_lengths(plate.vertices, plate.faces)
    half = blend(plate, [turned], np.array([0.5]))
    expected = hinged_plate(np.radians(degrees / 2))[1]
    assert np.abs(half - expected).max() < 0.01
    assert (edge_lengths(half, plate.faces) / before).min() > 0.99
    chord = 0.5 * (plate.vertices + turned)
    assert (edge_lengths(chord, plate.faces) / before).min() < 0.95


def test_a_jaw_keeps_its_size_halfway(face, shapes, blender):
    moved = np.linalg.norm(shapes[0] - face.vertices, axis=1)
    jaw = face.faces[(moved[face.faces] > 0.6 * moved.max()).all(axis=1)]
    half = blender.at(np.array([0.5, 0.0]))
    usual = edge_lengths(face.vertices, jaw).sum() + edge_lengths(shapes[0], jaw).sum()
    assert 2 * edge_lengths(half, jaw).sum() > 0.992 * usual
    chord = 0.5 * (face.vertices + shapes[0])
    assert 2 * edge_lengths(chord, jaw).sum() < 0.98 * usual


def test_a_wholly_turned_shape_turns_as_a_whole(face):
    turn = Rotation.from_rotvec([0, np.radians(150), 0])
    half = blend(face, [turn.apply(face.vertices.copy())], np.array([0.5]))
    expected = Rotation.from_rotvec([0, np.radians(75), 0]).apply(face.vertices.copy())
    off = (half - half.mean(axis=0)) - (expected - expected.mean(axis=0))
    assert np.abs(off).max() < 1e-3 * size(face)


def test_faces_crushed_to_lines_beyond_the_shape_lie_where_they_are_turned_to():
    plate, _ = hinged_plate(0.0)
    along = np.array([0.6, 0.8, 0.0])
    place = plate.vertices @ along
    squeezed = plate.vertices - 0.99 * place[:, None] * along
    turn, farther = (Rotation.from_rotvec([0, np.radians(60 * w), 0]) for w in (1.0, 1.4))
    x = blend(plate, [turn.apply(squeezed)], np.array([1.4]))
    line = farther.apply(plate.vertices - place[:, None] * along)
    off = (x - x.mean(axis=0)) - (line - line.mean(axis=0))
    assert np.abs(off).max() < 1e-4


def test_a_local_field_leaves_the_rest_in_place(face, blender, shapes):
    field = vertex_weights(face, at_landmark(face, 48), np.ones(1), 0.0)
    x = blender.at(np.stack([0 * field, field]))
    moved = np.linalg.norm(x - face.vertices, axis=1)
    corner = LANDMARKS[48]
    assert moved[field == 0].max() < 2e-4 * size(face)
    np.testing.assert_allclose(x[corner], shapes[1][corner], atol=5e-3 * size(face))


def test_weights_of_another_shape_are_refused(blender):
    with pytest.raises(RestorationError) as caught:
        blender.at(np.ones(3))
    assert caught.value.code == "shape"


def test_shapes_of_another_mesh_are_named(face, shapes):
    with pytest.raises(RestorationError) as caught:
        Blender(face, [shapes[0], shapes[1][:-1]])
    assert caught.value.elements["shapes"] == [1]
    with pytest.raises(RestorationError):
        Blender(face, [])


def test_fields_are_bounded_and_exact_at_their_points(face):
    rng = np.random.default_rng(0)
    values = rng.uniform(-1, 2, 51)
    points = at_landmark(face, *range(17, 68))
    field = vertex_weights(face, points, values, 0.5)
    assert field.min() >= values.min() and field.max() <= values.max()
    at_points = (field[face.faces[points.face]] * points.barycentric).sum(axis=1)
    np.testing.assert_allclose(at_points, values, atol=1e-9)
    apart = SurfacePoints(np.array([100, 9000]), np.array([[0.2, 0.3, 0.5], [0.6, 0.1, 0.3]]))
    field = vertex_weights(face, apart, np.array([1.0, 0.3]), 0.0)
    inside = (field[face.faces[apart.face]] * apart.barycentric).sum(axis=1)
    np.testing.assert_allclose(inside, [1.0, 0.3], atol=1e-9)
    assert field.min() == 0.0 and field.max() <= 1.0


def test_fields_follow_the_surface_around_the_mouth(face):
    upper, lower = 62, 66  # the lips' inner middles, on either side of the closed mouth
    a, b = face.vertices[[LANDMARKS[upper], LANDMARKS[lower]]]
    assert np.linalg.norm(a - b) < 0.01 * size(face)
    field = vertex_weights(face, at_landmark(face, upper), np.ones(1), 0.0)
    assert field[LANDMARKS[upper]] == pytest.approx(1.0)
    assert field[LANDMARKS[lower]] < 0.03
    assert (field == 0).mean() > 0.3


@pytest.mark.parametrize(("here", "across"), [(31, 35), (39, 42), (48, 54), (41, 46)])
def test_a_point_beside_the_nose_says_next_to_nothing_on_its_other_side(face, here, across):
    field = vertex_weights(face, at_landmark(face, here), np.ones(1), 0.0)
    assert field[LANDMARKS[across]] < 0.08


def test_many_points_reach_no_farther_than_the_nearest_of_them(face):
    alone = vertex_weights(face, at_landmark(face, 31), np.ones(1), 0.0)
    same = at_landmark(face, *[31] * 20)
    np.testing.assert_allclose(vertex_weights(face, same, np.ones(20), 0.0), alone, atol=0.2)
    left = [i for i in range(17, 68) if face.vertices[LANDMARKS[i], 0] < -0.1]
    field = vertex_weights(face, at_landmark(face, *left), np.ones(len(left)), 0.0)
    corners = sorted((48, 54), key=lambda i: i not in left)
    assert field[LANDMARKS[corners[0]]] == pytest.approx(1.0)
    assert field[LANDMARKS[corners[1]]] < 0.12


def test_shares_of_points_and_background_are_a_partition_of_unity(face):
    weights = PointWeights(face, at_landmark(face, *range(17, 68)))
    whole = weights.shares.sum(axis=1) + weights.background
    np.testing.assert_allclose(whole, 1.0, atol=1e-12)
    assert weights.shares.min() >= 0.0 and weights.background.min() >= 0.0
    field = weights.field(np.full(51, 0.7), 0.7)
    np.testing.assert_allclose(field, 0.7, atol=1e-12)


def test_without_points_a_field_is_its_background(face):
    none = SurfacePoints(np.zeros(0, np.int64), np.zeros((0, 3)))
    assert (vertex_weights(face, none, np.zeros(0), 0.7) == 0.7).all()


def test_a_lid_travels_over_its_eyeball():
    plate, _ = hinged_plate(0.0)
    across, up = plate.vertices[:, 0], 0.2 + plate.vertices[:, 1]
    share = np.clip((1.2 - up) / 0.9, 0, 1)[:, None] * np.radians([60.0, 0.0, 0.0])
    ball = Rotation.from_euler("xy", np.stack([-up, across], 1)).apply([0.0, 0.0, 1.0])
    end = Rotation.from_rotvec(share).apply(ball)
    half = blend(Mesh(ball, plate.faces), [end], np.array([0.5]))
    assert np.linalg.norm(half, axis=1).min() > 0.99
    assert np.linalg.norm(0.5 * (ball + end), axis=1).min() < 0.9
    expected = Rotation.from_rotvec(share / 2).apply(ball)
    assert np.linalg.norm(half - expected, axis=1).max() < 0.02
