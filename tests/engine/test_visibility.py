import numpy as np

from engine.io import read_mesh
from engine.operators import face_areas, face_normals
from engine.topology import editable_surface
from engine.types import Mesh
from engine.visibility import ambient_visibility
from tests.engine.shapes import sphere, together, without_faces
from tests.faces import HEAD_MOUTH_OPEN


def turned_inside_out(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1])


def test_a_convex_surface_sees_all_of_its_sky() -> None:
    assert ambient_visibility(sphere(4)).min() > 0.99


def test_inside_a_closed_surface_nothing_is_seen() -> None:
    assert ambient_visibility(turned_inside_out(sphere(4))).max() < 0.02


def test_inside_a_sphere_all_see_the_opening_alike() -> None:
    """The form factor from any point of a sphere to a part of it is that part's share of it."""
    ball = turned_inside_out(sphere(5))
    height = ball.vertices[ball.faces].mean(axis=1)[:, 2]
    cap = np.flatnonzero(height > 0.5)
    areas = face_areas(ball)
    share = areas[cap].sum() / areas.sum()
    bowl = without_faces(ball, cap)
    seen = ambient_visibility(bowl)
    below = height[height <= 0.5] < 0.2  # near the rim a pixel matters
    assert abs(seen[below].mean() - share) < 0.02
    assert seen[below].std() < 0.05


def test_other_parts_of_the_file_block_the_view() -> None:
    floor = Mesh(
        np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    lid = floor.moved(10 * floor.vertices + [0, 0, 0.3])
    assert ambient_visibility(floor).min() == 1
    assert ambient_visibility(floor, together(floor, lid)).max() < 0.1
    below = floor.moved(floor.vertices - [0, 0, 1])
    assert ambient_visibility(floor, together(floor, below)).min() == 1


def test_a_mouth_is_dark_and_a_forehead_is_not() -> None:
    file = read_mesh(HEAD_MOUTH_OPEN).mesh
    surface = editable_surface(file)[0].mesh
    seen = ambient_visibility(surface, file)
    areas = face_areas(surface)
    assert 0.1 < areas[seen < 0.2].sum() / areas.sum() < 0.3
    high = np.quantile(surface.vertices[:, 1], 0.9)
    forehead = (surface.vertices[surface.faces][:, :, 1].min(axis=1) > high) & (
        face_normals(surface)[:, 2] > 0.5
    )
    assert forehead.any()
    assert seen[forehead].min() > 0.6


def test_visibility_does_not_depend_on_unit_and_place() -> None:
    surface = editable_surface(read_mesh(HEAD_MOUTH_OPEN).mesh)[0].mesh
    far = surface.moved(1e-3 * surface.vertices + 5)
    assert np.abs(ambient_visibility(surface) - ambient_visibility(far)).max() < 0.2
    assert np.abs(ambient_visibility(surface) - ambient_visibility(far)).mean() < 1e-3
