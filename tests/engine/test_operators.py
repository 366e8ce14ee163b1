import numpy as np
import pytest

from engine.nearest import vertex_stars
from engine.operators import (
    Rings,
    adjacency,
    cotangent_laplacian,
    edges,
    face_areas,
    face_normals,
    interior_edges,
    vertex_areas,
    vertex_normals,
)
from engine.types import Mesh


def grid(n: int = 8) -> Mesh:
    """A planar grid of n x n vertices over the unit square, slightly irregular inside."""
    y, x = np.mgrid[:n, :n] / (n - 1)
    inside = (x > 0) & (x < 1) & (y > 0) & (y < 1)
    x = x + inside * 0.3 / n * np.sin(17 * x + 5 * y)
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1), faces)


OCTAHEDRON = Mesh(
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]],
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
)


def test_areas_add_up():
    mesh = grid()
    assert face_areas(mesh).sum() == pytest.approx(1)
    assert vertex_areas(mesh).sum() == pytest.approx(1)


def test_normals_point_outwards_from_a_convex_body():
    centre = OCTAHEDRON.vertices[OCTAHEDRON.faces].mean(axis=1)
    np.testing.assert_allclose(face_normals(OCTAHEDRON), centre * np.sqrt(3), atol=1e-14)
    np.testing.assert_allclose(vertex_normals(OCTAHEDRON), OCTAHEDRON.vertices, atol=1e-14)


def test_euler_formula_and_edge_faces():
    mesh = grid()
    e = edges(mesh.faces)
    assert len(mesh.vertices) - len(e) + len(mesh.faces) == 1
    assert adjacency(mesh.faces, 64).sum() == 2 * len(e)
    inner, sides = interior_edges(mesh.faces)
    assert len(e) - len(inner) == 4 * 7
    for edge, pair in zip(inner, sides, strict=True):
        assert all(set(edge) <= set(mesh.faces[face]) for face in pair) and pair[0] != pair[1]
    assert len(interior_edges(OCTAHEDRON.faces)[0]) == 12


def test_edges_are_sorted_and_of_crowded_ones_every_pair_of_faces_is_told():
    fan = np.array([[5, 2, 0], [2, 5, 1], [5, 2, 3], [4, 3, 5]])
    rim = [[0, 2], [0, 5], [1, 2], [1, 5], [2, 3]]
    assert edges(fan).tolist() == [*rim, [2, 5], [3, 4], [3, 5], [4, 5]]
    inner, sides = interior_edges(fan)
    assert inner.tolist() == [[2, 5], [2, 5], [3, 5]]
    assert sides.tolist() == [[0, 1], [1, 2], [2, 3]]
    assert edges(np.empty((0, 3), dtype=np.int64)).shape == (0, 2)


def test_stars_list_the_faces_around_each_vertex_and_tell_the_border():
    mesh = grid()
    stars = vertex_stars(mesh.faces, 65)
    for vertex in (0, 9, 63, 64):
        around = stars.face[stars.start[vertex] : stars.start[vertex + 1]]
        assert around.tolist() == np.flatnonzero((mesh.faces == vertex).any(axis=1)).tolist()
    x, y, _ = mesh.vertices.T
    rim = (x == 0) | (x == 1) | (y == 0) | (y == 1)
    assert stars.border.tolist() == [*rim.tolist(), False]


def test_laplacian_kills_linear_functions_inside_and_measures_dirichlet_energy():
    mesh = grid()
    L = cotangent_laplacian(mesh)
    inside = (np.abs(mesh.vertices[:, :2] - 0.5) < 0.49).all(axis=1)
    linear = mesh.vertices @ [2.0, -3.0, 0]
    np.testing.assert_allclose((L @ linear)[inside], 0, atol=1e-12)
    assert linear @ (L @ linear) == pytest.approx(13)
    np.testing.assert_allclose(L.sum(axis=1), 0, atol=1e-12)
    assert np.linalg.eigvalsh(L.toarray()).min() > -1e-12


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_degenerate_faces_stay_finite_at_any_scale(scale):
    flat = [[0, 0, 0], [1, 0, 0], [0.3, 0, 0], [0.3, 1, 0]]
    mesh = Mesh(np.array(flat) * scale, [[0, 1, 2], [0, 2, 3], [2, 1, 3], [2, 2, 2]])
    L = cotangent_laplacian(mesh).toarray()
    assert np.isfinite(L).all() and np.linalg.eigvalsh(L).min() > -1e-6 * np.abs(L).max()
    np.testing.assert_allclose(
        L, cotangent_laplacian(Mesh(flat, mesh.faces)).toarray(), rtol=1e-6, atol=1e-6
    )
    np.testing.assert_array_equal(face_normals(mesh)[0], 0)


def test_rings_are_the_adjacency():
    mesh = grid()
    rings = Rings.of(mesh.faces, 64)
    matrix = adjacency(mesh.faces, 64).toarray()
    values = np.random.default_rng(0).random((64, 2))
    np.testing.assert_allclose(rings.sums(values), values + matrix @ values, atol=1e-14)
    one = np.arange(64) == 20
    np.testing.assert_array_equal(
        rings.grown(one, 2), np.linalg.matrix_power(np.eye(64) + matrix, 2)[20] > 0
    )


def test_a_face_with_equal_corners_makes_nobody_its_own_neighbour():
    rings = Rings.of(np.array([[0, 0, 1], [1, 2, 3]]), 4)
    assert rings.start.tolist() == [0, 1, 4, 6, 8]
    assert rings.neighbour.tolist() == [1, 0, 2, 3, 1, 3, 1, 2]
