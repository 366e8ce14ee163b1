import numpy as np
import pytest
from scipy.spatial import Delaunay

from engine.errors import EngineError
from engine.io import read_mesh
from engine.locate import PlaneLocator, PointLocator, closest_points, locate_in_plane
from engine.types import ComplexArray, FloatArray, IntArray, Mesh
from tests.engine.shapes import sheet
from tests.faces import ICT_NEUTRAL


@pytest.fixture(scope="module")
def face() -> Mesh:
    return read_mesh(ICT_NEUTRAL).mesh


@pytest.fixture(scope="module")
def plane() -> tuple[ComplexArray, IntArray]:
    """A convex triangulation whose density varies over three orders of magnitude."""
    rng = np.random.default_rng(4)
    radius, angle = rng.random(4000) ** 3, rng.random(4000) * 2 * np.pi
    z = np.concatenate([radius * np.exp(1j * angle), np.exp(2j * np.pi * np.arange(200) / 200)])
    return z, Delaunay(np.stack([z.real, z.imag], axis=1)).simplices.astype(np.int64)


def by_sampling(triangle: FloatArray, point: FloatArray, steps: int = 400) -> float:
    i, j = np.triu_indices(steps + 1)
    weights = np.stack([i, j - i, steps - j], axis=1) / steps
    return float(np.linalg.norm(weights @ triangle - point, axis=1).min())


def test_vertices_are_found_exactly(face: Mesh) -> None:
    points, distance = closest_points(face, face.vertices)
    assert distance.max() <= 1e-14
    assert np.abs(points.barycentric.max(axis=1) - 1).max() <= 1e-12
    corner = face.faces[points.face, points.barycentric.argmax(axis=1)]
    assert np.array_equal(corner, np.arange(len(face.vertices)))


def test_one_triangle_against_sampling() -> None:
    triangle = np.array([[0, 0, 0], [3, 0, 0.5], [0.4, 0.2, 1]])
    queries = np.random.default_rng(0).normal(size=(60, 3)) * 3
    points, distance = closest_points(Mesh(triangle, np.array([[0, 1, 2]])), queries)
    sampled = [by_sampling(triangle, query) for query in queries]
    assert np.all(distance <= np.array(sampled) + 1e-12)
    assert np.allclose(distance, sampled, atol=1e-3)
    assert points.barycentric.min() >= 0


def test_the_tree_agrees_with_asking_every_face(face: Mesh) -> None:
    rng = np.random.default_rng(1)
    queries = face.vertices[rng.integers(0, len(face.vertices), 40)] + rng.normal(size=(40, 3))
    points, distance = closest_points(face, queries)
    single = [
        closest_points(Mesh(face.vertices, face.faces[i : i + 1]), queries)[1]
        for i in range(0, len(face.faces), 7)
    ]
    assert np.all(distance <= np.min(single, axis=0))
    assert np.allclose(np.linalg.norm(points.on(face) - queries, axis=1), distance, atol=1e-12)
    own = [
        closest_points(Mesh(face.vertices, face.faces[[f]]), q[None])[1][0]
        for f, q in zip(points.face, queries, strict=True)
    ]
    assert np.array_equal(own, distance)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_units_do_not_matter(face: Mesh, scale: float) -> None:
    queries = face.vertices[::50] + 0.3
    points, distance = closest_points(face, queries)
    scaled, far = closest_points(Mesh(face.vertices * scale, face.faces), queries * scale)
    assert np.allclose(far, distance * scale, rtol=1e-9)
    assert np.allclose(scaled.on(face), points.on(face), atol=1e-9)


def test_the_answer_does_not_depend_on_the_other_queries(face: Mesh) -> None:
    queries = face.vertices[::40] * 1.02
    locator = PointLocator(face)
    together, _ = locator.nearest(queries)
    alone = [locator.nearest(query[None])[0].face[0] for query in queries]
    assert np.array_equal(together.face, alone)


def test_faces_without_area_are_points_and_segments() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]])
    mesh = Mesh(vertices, np.array([[0, 1, 2], [0, 0, 0]]))
    points, distance = closest_points(mesh, np.array([[1.5, 2, 0], [-1, 0, 0]]))
    assert distance.tolist() == [2, 1]
    assert np.allclose(points.on(mesh), [[1.5, 0, 0], [0, 0, 0]])


def test_a_mesh_without_faces_is_refused() -> None:
    with pytest.raises(EngineError) as refused:
        closest_points(Mesh(np.zeros((3, 3)), np.zeros((0, 3))), np.zeros((1, 3)))
    assert refused.value.code == "no_faces"


def test_plane_points_inside_have_distance_zero(plane: tuple[ComplexArray, IntArray]) -> None:
    z, faces = plane
    rng = np.random.default_rng(2)
    inside = rng.random(3000) ** 2 * 0.99 * np.exp(2j * np.pi * rng.random(3000))
    points, distance = locate_in_plane(z, faces, inside)
    assert not distance.any()
    found = (points.barycentric * z[faces[points.face]]).sum(axis=1)
    assert np.abs(found - inside).max() <= 1e-12


def test_plane_vertices_are_found_exactly(plane: tuple[ComplexArray, IntArray]) -> None:
    z, faces = plane
    used = np.unique(faces)
    points, distance = locate_in_plane(z, faces, z[used])
    assert not distance.any()
    assert np.array_equal(faces[points.face, points.barycentric.argmax(axis=1)], used)
    assert np.abs(points.barycentric.max(axis=1) - 1).max() <= 1e-12


def test_points_outside_get_the_boundary(plane: tuple[ComplexArray, IntArray]) -> None:
    z, faces = plane
    corners = np.exp(2j * np.pi * np.arange(200) / 200)
    between = (corners + np.roll(corners, -1)) / 2
    points, distance = locate_in_plane(z, faces, np.concatenate([1.5 * corners, 2 * between]))
    found = (points.barycentric * z[faces[points.face]]).sum(axis=1)
    assert np.allclose(found, np.concatenate([corners, between]), atol=1e-9)
    assert np.allclose(distance, np.concatenate([np.full(200, 0.5), np.abs(between)]), atol=1e-9)


def test_what_is_near_is_found_on_foot_and_what_is_outside_too(
    plane: tuple[ComplexArray, IntArray],
) -> None:
    z, faces = plane
    rng = np.random.default_rng(3)
    queries = 1.1 * np.sqrt(rng.random(500)) * np.exp(2j * np.pi * rng.random(500))
    queries = np.concatenate([queries, z[np.unique(faces)][:50]])
    locator = PlaneLocator(z, faces)
    points, distance = locator.locate(queries)
    near, there = locator.locate_near(queries, np.roll(points.face, 1))
    np.testing.assert_array_equal(near.face, points.face)
    np.testing.assert_allclose(near.barycentric, points.barycentric, atol=1e-9)
    np.testing.assert_array_equal(there, distance)


def test_a_hole_in_the_plane_is_outside() -> None:
    flat = sheet(7, 7)
    z = flat.vertices[:, 0] + 1j * flat.vertices[:, 1]
    centre = z[flat.faces].mean(axis=1)
    faces = flat.faces[np.maximum(abs(centre.real - 3), abs(centre.imag - 3)) > 1]
    points, distance = locate_in_plane(z, faces, np.array([3.25 + 3j]))
    assert distance[0] == pytest.approx(0.75)
    assert (points.barycentric * z[faces[points.face]]).sum() == pytest.approx(4 + 3j)
