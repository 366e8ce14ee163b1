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


def test_at_vertices_nothing_is_hidden_and_elsewhere_little() -> None:
    up = heights(BALL, 3 * BALL.vertices, FLAT, BOTH, EVERY, HIDDEN)
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


def test_a_rough_ball_is_left_for_the_smooth_one_within_its_noise() -> None:
    smooth = sphere(4)
    noise = np.random.default_rng(1).normal(0, 0.01, smooth.vertices.shape)
    rough = smooth.moved(smooth.vertices + noise)
    inner = sphere(4).moved(0.97 * smooth.vertices)
    points = PointLocator(rough).nearest(BALL.vertices)[0]
    for goal, most, radius in ((smooth, 0.02, 1.0), (inner, 0.01, 0.98)):
        limit = np.full(len(BALL.vertices), most)
        up = heights(BALL, BALL.vertices, points, (Target(goal), Target(rough)), EVERY, limit)
        length = np.linalg.norm(points.on(rough) + up, axis=1)
        assert np.abs(length - radius).max() < 0.002
