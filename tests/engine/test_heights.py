import numpy as np

from engine.correspondence._fitting import Target
from engine.correspondence._heights import heights, hidden_by_edges
from engine.correspondence._unfolding import turned_faces
from engine.locate import PointLocator
from engine.types import FloatArray, IntArray, SurfacePoints
from tests.engine.shapes import sphere

BALL, COARSE = sphere(4), sphere(2)
EVERY = np.ones(len(BALL.vertices), dtype=np.bool_)
FLAT = PointLocator(COARSE).nearest(BALL.vertices)[0]
BOTH = Target(COARSE), Target(COARSE)
HIDDEN = hidden_by_edges(FLAT, COARSE)


def test_a_ball_lies_round_over_the_flat_faces_of_a_coarse_one() -> None:
    up = heights(BALL, BALL.vertices, FLAT, BOTH, EVERY, HIDDEN)
    flat, round_ = (np.linalg.norm(FLAT.on(COARSE) + way, axis=1) for way in (np.zeros(3), up))
    assert np.abs(flat - 1).max() > 0.03
    assert np.abs(round_ - 1).max() < 1e-3


def test_what_lies_over_its_own_feet_is_the_answer() -> None:
    up = heights(BALL, BALL.vertices, FLAT, BOTH, EVERY, HIDDEN)
    off = np.linalg.norm(FLAT.on(COARSE) + up - BALL.vertices, axis=1)
    inside = FLAT.barycentric.min(axis=1) > 0.05
    assert inside.sum() > 300
    assert off[inside].max() < 1e-6


def test_at_vertices_nothing_is_hidden_and_elsewhere_little() -> None:
    bulging = 1 + (1 - FLAT.barycentric.max(axis=1, keepdims=True))
    up = heights(BALL, bulging * BALL.vertices, FLAT, BOTH, EVERY, HIDDEN)
    length = np.linalg.norm(up, axis=1)
    at_vertex = FLAT.barycentric.max(axis=1) > 1 - 1e-9
    assert at_vertex.any()
    assert length[at_vertex].max() < 1e-9
    corner = COARSE.vertices[COARSE.faces]
    longest = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2).max()
    assert 0.1 * longest < length.max() < 0.3 * longest


def test_a_place_on_an_edge_hides_as_much_in_either_face() -> None:
    mesh = COARSE.moved(COARSE.vertices * [1, 0.6, 0.3])
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    here, there = np.lexsort((end, start)), np.lexsort((start, end))

    def hidden(half_edges: IntArray, share: float) -> FloatArray:
        face, corner = half_edges // 3, half_edges % 3
        barycentric = np.zeros((len(face), 3))
        barycentric[np.arange(len(face)), corner] = share
        barycentric[np.arange(len(face)), (corner + 1) % 3] = 1 - share
        return hidden_by_edges(SurfacePoints(face, barycentric), mesh)

    assert hidden(here, 0.3).min() > 0
    assert np.allclose(hidden(here, 0.3), hidden(there, 0.7), rtol=1e-12)


def test_what_does_not_lie_on_the_target_stays_on_its_faces() -> None:
    lies = BALL.vertices[:, 2] > 0
    up = heights(BALL, BALL.vertices, FLAT, BOTH, lies, HIDDEN)
    assert not up[~lies].any()
    assert up[lies].any()


def test_no_face_is_turned_over() -> None:
    """Images of faces are needles here and there, places thrown up and down on a sharp edge."""
    random, target = np.random.default_rng(0), Target(COARSE.moved(COARSE.vertices * [1, 1, 0.1]))
    fine = sphere(5)
    near = fine.vertices * [1, 1, 0.1] + random.normal(0, 0.01, fine.vertices.shape)
    points = PointLocator(target.mesh).nearest(near)[0]
    thrown = random.normal(0, 0.05, near.shape)
    before = turned_faces(fine, points, target)
    every, most = np.ones(len(near), dtype=np.bool_), hidden_by_edges(points, target.mesh)
    up = heights(fine, near + thrown, points, (target, target), every, most)
    assert np.linalg.norm(up, axis=1).mean() > 0.005
    assert not (turned_faces(fine, points, target, up) & ~before).any()


def test_a_rough_ball_is_left_for_the_smooth_one_that_was_fitted() -> None:
    smooth = sphere(4)
    noise = np.random.default_rng(1).normal(0, 0.01, smooth.vertices.shape)
    rough = smooth.moved(smooth.vertices + noise)
    inner = sphere(4).moved(0.97 * smooth.vertices)
    points = PointLocator(rough).nearest(BALL.vertices)[0]
    limit = np.full(len(BALL.vertices), 0.02)
    for goal, radius in ((smooth, 1.0), (inner, 0.97)):
        up = heights(BALL, BALL.vertices, points, (Target(goal), Target(rough)), EVERY, limit)
        length = np.linalg.norm(points.on(rough) + up, axis=1)
        assert np.abs(length - radius).max() < 0.002


def test_what_a_fit_passes_over_the_vertices_of_a_fine_ball_is_taken_off() -> None:
    source = sphere(5)
    wave = 1 + 0.005 * np.sin(10 * source.vertices[:, :1])
    points = PointLocator(BALL).nearest(source.vertices)[0]
    every, most = np.ones(len(wave), dtype=np.bool_), hidden_by_edges(points, BALL)
    target = Target(BALL)
    up = heights(source, wave * source.vertices, points, (target, target), every, most)
    off = np.abs(np.linalg.norm(points.on(BALL) + up, axis=1) - 1)
    between = points.barycentric.max(axis=1) < 0.9
    assert between.sum() > 1000
    assert np.abs(wave - 1)[between].mean() > 0.0025
    assert off[between].mean() < 0.001


def test_noise_of_a_target_is_not_taken_for_what_a_fit_passes_over() -> None:
    random = np.random.default_rng(2)
    noisy = BALL.moved(BALL.vertices * random.normal(1, 0.005, (len(BALL.vertices), 1)))
    source = sphere(5)
    points = PointLocator(noisy).nearest(source.vertices)[0]
    every, most = np.ones(len(points.face), dtype=np.bool_), np.full(len(points.face), 0.02)
    target = Target(noisy)
    up = heights(source, source.vertices, points, (target, target), every, most)
    flat, risen = (
        np.abs(np.linalg.norm(points.on(noisy) + way, axis=1) - 1).mean() for way in (0 * up, up)
    )
    assert risen < 0.5 * flat


def test_places_that_the_fit_does_not_lie_over_stay_on_their_faces() -> None:
    turned = BALL.vertices[:, [1, 2, 0]]
    beside = np.linalg.norm(turned - BALL.vertices, axis=1) > 0.5
    up = heights(BALL, turned, FLAT, BOTH, EVERY, HIDDEN)
    assert beside.sum() > 900
    assert not up[beside].any()
