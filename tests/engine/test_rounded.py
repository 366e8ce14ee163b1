import numpy as np

from engine.correspondence._rounded import RoundedTarget, angle_normals, is_coarse, rounded
from engine.operators import face_areas, vertex_normals
from engine.types import Mesh
from tests.engine.shapes import sheet, sphere


def test_normals_do_not_depend_on_how_flat_faces_are_divided() -> None:
    """A corner of a cube, one of its three squares cut through the corner."""
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1]], dtype=np.float64)
    corner = Mesh(x, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 4], [0, 4, 2]]))
    assert np.allclose(angle_normals(corner)[0], -np.ones(3) / np.sqrt(3))
    assert not np.allclose(vertex_normals(corner)[0], -np.ones(3) / np.sqrt(3), atol=0.1)


def test_a_coarse_ball_becomes_round() -> None:
    coarse = sphere(2)
    flat = np.linalg.norm(coarse.vertices[coarse.faces].mean(axis=1), axis=1)
    finer = rounded(coarse)[0]
    assert len(finer.faces) == 4 * len(coarse.faces)
    assert np.array_equal(finer.vertices[: len(coarse.vertices)], coarse.vertices)
    raised = np.linalg.norm(finer.vertices, axis=1)
    assert np.abs(raised - 1).max() < 0.15 * np.abs(flat - 1).max()
    assert face_areas(finer).sum() > face_areas(coarse).sum()


def test_a_plane_stays_plane() -> None:
    plane = sheet()
    plane = plane.moved(plane.vertices * [1.0, 1.0, 0.0])
    finer = rounded(plane)[0]
    assert np.abs(finer.vertices[:, 2]).max() == 0
    assert np.isclose(face_areas(finer).sum(), face_areas(plane).sum())


def test_feet_lie_on_the_round_and_are_told_on_the_flat_faces() -> None:
    coarse = sphere(2)
    random = np.random.default_rng(0).normal(size=(200, 3))
    normals = random / np.linalg.norm(random, axis=1)[:, None]
    target = RoundedTarget(coarse)
    feet = target.index(0.1).feet(1.1 * normals, normals)
    own = coarse.vertices[coarse.faces[feet.face]]
    flat = np.einsum("ki,kij->kj", feet.barycentric, own)
    on_flat = np.linalg.norm(flat, axis=1)
    assert np.linalg.norm(feet.position, axis=1).min() > on_flat.min() + 0.5 * (1 - on_flat.min())
    assert np.abs(np.linalg.norm(feet.position - flat, axis=1)).max() < 2 * (1 - on_flat.min())
    assert np.allclose(flat / on_flat[:, None], normals, atol=0.05)


def test_what_is_coarse_is_told_by_its_size() -> None:
    fine = Mesh(sphere(2).vertices * 0.01, sphere(2).faces)
    assert is_coarse(sphere(2))
    assert not is_coarse(fine)
    assert is_coarse(
        Mesh(np.concatenate([sphere(2).vertices, np.zeros((10**5, 3))]), sphere(2).faces)
    )
