import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from engine.insertion import insert_points
from engine.types import SurfacePoints


def signed_areas(z: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = z[faces].T
    return 0.5 * ((b - a).conj() * (c - a)).imag


@given(seed=st.integers(0, 10**6), count=st.integers(1, 40))
@settings(max_examples=30, deadline=None)
def test_inserted_points_are_vertices_of_an_upright_triangulation(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    at = random.uniform(-1, 1, (30, 2))
    z = at[:, 0] + 1j * at[:, 1]
    faces = Delaunay(at).simplices.astype(np.int64)
    upright = signed_areas(z, faces) > 0
    faces = np.where(upright[:, None], faces, faces[:, ::-1])
    faces = faces[signed_areas(z, faces) > 1e-4]
    weights = random.dirichlet([0.4, 0.4, 0.4], count)
    points = SurfacePoints(random.integers(0, len(faces), count), weights)
    wanted = (z[faces[points.face]] * weights).sum(axis=1)

    plane = insert_points(z, faces, points)

    assert np.allclose(plane.z[plane.vertices], wanted, atol=1e-7)
    assert np.array_equal(plane.z[: len(z)], z)
    areas = signed_areas(plane.z, plane.faces)
    assert areas.min() > 0
    assert np.isclose(areas.sum(), signed_areas(z, faces).sum())


def test_a_corner_needs_no_new_vertex() -> None:
    z = np.array([0, 1, 1j])
    faces = np.array([[0, 1, 2]])
    plane = insert_points(z, faces, SurfacePoints(np.array([0]), np.array([[0.0, 1.0, 0.0]])))
    assert plane.vertices.tolist() == [1]
    assert len(plane.z) == 3
