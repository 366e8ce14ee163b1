from itertools import pairwise

import numpy as np
import pytest

from engine.io import read_mesh
from engine.restoration import Blender, Contacts, Extrapolator, turned_faces
from engine.restoration._opening import Opening
from engine.restoration._repair import repairs
from engine.restoration._turned import Orientation
from engine.types import Mesh
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE


@pytest.fixture(scope="module")
def face():
    return read_mesh(ICT_NEUTRAL).mesh


@pytest.fixture(scope="module")
def blender(face):
    return Blender(face, [read_mesh(path).mesh.vertices for path in (ICT_JAW_OPEN, ICT_SMILE)])


@pytest.fixture(scope="module")
def sane(blender):
    return Extrapolator(blender)


def newly_turned(face, x, within):
    turned = turned_faces(face, face.vertices, x)
    return np.setdiff1d(turned, turned_faces(face, face.vertices, within))


def test_within_zero_and_one_nothing_changes(blender, sane):
    left = np.linspace(0.0, 1.0, len(blender.mesh.vertices))
    for weights in ([0.0, 1.0], [0.3, 0.9], [1.0, 1.0], [left, 1.0 - left]):
        np.testing.assert_array_equal(sane.at(np.array(weights)), blender.at(np.array(weights)))


@pytest.mark.parametrize(
    "weights", [[-0.5, 0.0], [0.0, -0.5], [-0.4, -0.3], [1.5, 0.0], [0.0, 1.5]]
)
def test_faces_that_the_blend_turns_over_beyond_stay_open(face, blender, sane, weights):
    weights = np.array(weights)
    within = blender.at(np.clip(weights, 0.0, 1.0))
    plain, x = blender.at(weights), sane.at(weights)
    assert len(newly_turned(face, plain, within))
    assert not len(newly_turned(face, x, within))
    lost, way = (np.linalg.norm(x - end, axis=1).mean() for end in (plain, within))
    assert lost < 0.4 * way


def test_lips_do_not_pass_through_each_other(face, blender, sane):
    contacts = Contacts(face, blender.shapes, blender.moves.sum(axis=0))
    for weights in ([-0.5, 0.0], [-0.25, 0.0], [-0.5, 0.3]):
        within = blender.at(np.clip(weights, 0.0, 1.0))
        plain = contacts.depths(blender.at(np.array(weights)), within)
        parted = contacts.depths(sane.at(np.array(weights)), within)
        assert plain.max() > 0.01 * blender.size
        assert parted.max() < 2e-4 * blender.size


def test_even_steps_beyond_are_even_steps_of_the_surface(sane):
    path = [sane.at(np.array([a, 0.2])) for a in np.linspace(-0.5, 1.5, 41)]
    steps = np.array([np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(path)])
    assert steps.max() < 1.5 * steps.mean()


def test_nothing_jumps_at_the_source_and_at_the_shapes(face, blender, sane):
    for shape, weight, step in ((face.vertices, 0.0, -1e-5), (blender.shapes[0], 1.0, 1e-5)):
        x = sane.at(np.array([weight + step, 0.0]))
        assert np.linalg.norm(x - shape, axis=1).max() < 1e-4 * blender.size


def test_one_half_of_a_face_goes_beyond(face, blender, sane):
    side = 0.75 + 0.75 * np.tanh(face.vertices[:, 0])
    field = np.stack([np.zeros(len(side)), side])
    x = sane.at(field)
    left, right = face.vertices[:, 0] < -3.0, face.vertices[:, 0] > 3.0
    plain, within = blender.at(field), blender.at(np.clip(field, 0.0, 1.0))
    far, moved = (np.linalg.norm(end - face.vertices, axis=1) for end in (plain, x))
    assert moved[right].max() > 0.8 * far[right].max()
    assert moved[left].max() < 0.05 * far.max()
    assert 2 * len(newly_turned(face, x, within)) < len(newly_turned(face, plain, within))


def test_other_shapes_have_their_own_limits(face, blender, sane):
    other = sane.with_shapes({0: blender.shapes[1]})
    alone = Extrapolator(Blender(face, [blender.shapes[1], blender.shapes[1]]))
    weights = np.array([-0.5, 0.0])
    np.testing.assert_array_equal(other.at(weights), alone.at(weights))


def test_between_the_weights_of_the_repairs_hardly_a_face_turns_over(face, blender, sane):
    for weights in ([1.44, 0.0], [0.0, 1.31], [-0.31, 0.0]):
        within = blender.at(np.clip(weights, 0.0, 1.0))
        plain, x = blender.at(np.array(weights)), sane.at(np.array(weights))
        assert 4 * len(newly_turned(face, x, within)) < len(newly_turned(face, plain, within))


@pytest.mark.parametrize("weights", [[-0.5, -0.5], [1.5, 0.5], [1.4, 1.3], [-0.5, 1.5]])
def test_in_mixtures_far_fewer_faces_turn_over(face, blender, sane, weights):
    within = blender.at(np.clip(weights, 0.0, 1.0))
    plain, x = blender.at(np.array(weights)), sane.at(np.array(weights))
    assert 2 * len(newly_turned(face, x, within)) < len(newly_turned(face, plain, within))


def test_even_steps_between_mixtures_are_even_steps_of_the_surface(sane):
    begin, end = np.array([-0.5, 1.5]), np.array([1.5, -0.3])
    path = [sane.at((1.0 - t) * begin + t * end) for t in np.linspace(0.0, 1.0, 21)]
    steps = np.array([np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(path)])
    assert steps.max() < 2.0 * steps.mean()


def test_on_large_meshes_too_faces_stay_open_and_lips_apart(face, blender, monkeypatch):
    monkeypatch.setattr("engine.restoration._beyond._LARGE", 7000)
    monkeypatch.setattr("engine.restoration._thinned._COUNT", 7000)
    weights = np.array([-0.5, 0.0])
    plain, x = blender.at(weights), Extrapolator(blender).at(weights)
    contacts = Contacts(face, blender.shapes, blender.moves.sum(axis=0))
    deep, left = (contacts.depths(end, face.vertices).max() for end in (plain, x))
    assert 4 * left < deep
    turned, kept = (len(newly_turned(face, end, face.vertices)) for end in (plain, x))
    assert 4 * kept < turned


def grid(count):
    """A flat square of ``count`` x ``count`` vertices."""
    x, y = (values.ravel() for values in np.meshgrid(np.arange(count), np.arange(count)))
    k = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    first, second = (
        np.stack([k, k + 1, k + count + 1], 1),
        np.stack([k, k + count + 1, k + count], 1),
    )
    return Mesh(np.stack([x, y, 0.0 * x], 1).astype(np.float64), np.concatenate([first, second]))


def folded(mesh, excess):
    """One vertex of the middle pushed over its neighbours."""
    x = mesh.vertices.copy()
    x[12 * 25 + 12, :2] += 6.0 * excess
    return x


def test_repairs_open_what_is_turned_over_and_turn_with_the_surface():
    mesh, excesses = grid(25), (0.25, 0.5)
    surfaces = [folded(mesh, excess) for excess in excesses]
    assert len(turned_faces(mesh, mesh.vertices, surfaces[0]))
    (repair,) = repairs(mesh, Orientation(mesh), mesh.vertices, surfaces, excesses)
    for excess, x in zip(excesses, surfaces, strict=True):
        opened = x.copy()
        opened[repair.used] += repair.at(x, np.array(excess))
        assert not len(turned_faces(mesh, mesh.vertices, opened))
        turned = x[:, [1, 2, 0]]
        moves = repair.at(x, np.array(excess))
        np.testing.assert_allclose(
            repair.at(turned, np.array(excess)), moves[:, [1, 2, 0]], atol=1e-9
        )
    assert not repair.at(mesh.vertices, np.array(0.0)).any()
    first, half = (repair.at(surfaces[0], np.array(e)) for e in (0.25, 0.125))
    np.testing.assert_allclose(2.0 * half, first, atol=1e-12)
    assert not repairs(mesh, Orientation(mesh), mesh.vertices, [mesh.vertices], (0.5,))


def test_what_a_first_attempt_leaves_is_opened_where_it_is(monkeypatch):
    monkeypatch.setattr("engine.restoration._repair._FIRST", 0.0)
    mesh, x = grid(25), folded(grid(25), 0.5)
    (repair,) = repairs(mesh, Orientation(mesh), mesh.vertices, [x], (0.5,))
    opened = x.copy()
    opened[repair.used] += repair.at(x, np.array(0.5))
    assert not len(turned_faces(mesh, mesh.vertices, opened))


def test_what_opens_faces_changes_little_as_they_close_within():
    mesh, middle = grid(25), 12 * 25 + 12

    def pushed(way):
        x = mesh.vertices.copy()
        x[middle, 0] += way
        return x

    opening = Opening(Blender(mesh, [pushed(0.5)]), Orientation(mesh))
    x = pushed(1.1)
    assert len(turned_faces(mesh, mesh.vertices, x))
    opened = {way: opening.opened(x, pushed(way)) for way in (0.5, 0.999, 1.001)}
    assert not len(turned_faces(mesh, mesh.vertices, opened[0.5]))
    np.testing.assert_array_equal(opened[1.001], x)
    assert np.abs(opened[0.999] - x).max() < 0.05 * np.abs(opened[0.5] - x).max()


def plates(gap):
    """Two square plates (centre at 0) that face each other, the second one above."""
    side = np.linspace(-1.0, 1.0, 15)
    x, y = (values.ravel() for values in np.meshgrid(side, side))
    k = (np.arange(14)[:, None] * 15 + np.arange(14)).ravel()
    below = np.concatenate([np.stack([k, k + 1, k + 16], 1), np.stack([k, k + 16, k + 15], 1)])
    vertices = [np.stack([x, y, np.full_like(x, z)], 1) for z in (0.0, gap)]
    return Mesh(np.concatenate(vertices), np.concatenate([below, below[:, ::-1] + len(x)]))


def test_what_moves_makes_way_for_what_is_still():
    mesh, count = plates(0.02), 225
    upper = np.arange(2 * count) >= count
    moves = np.where(upper, 1.0, 0.0)
    contacts = Contacts(mesh, [], moves)
    assert set(map(tuple, contacts.pairs)) >= {(v, v + count) for v in range(count)}
    sunk = mesh.vertices - 0.1 * upper[:, None] * [0.0, 0.0, 1.0]
    parted = contacts.parted(sunk, mesh.vertices)
    gap = parted[count:, 2] - parted[:count, 2]
    assert contacts.depths(sunk, mesh.vertices).max() == pytest.approx(0.1 - 0.02, rel=1e-6)
    assert gap.min() > 0.0
    assert np.abs(parted[:count] - mesh.vertices[:count]).max() < 0.02 * 0.1


def test_what_does_not_touch_is_left_alone():
    mesh = plates(0.02)
    contacts = Contacts(mesh, [], np.ones(len(mesh.vertices)))
    lifted = mesh.vertices + (mesh.vertices[:, 2:] > 0.01) * [0.1, 0.0, 0.3]
    assert contacts.parted(lifted, mesh.vertices) is lifted
    far = Contacts(plates(0.5), [], np.ones(len(mesh.vertices)))
    assert not len(far.pairs)
    assert far.parted(lifted, mesh.vertices) is lifted
