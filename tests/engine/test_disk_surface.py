import numpy as np
import pytest
from scipy.spatial import KDTree

from engine.io import read_mesh
from engine.topology import disk_surface, editable_surface, filled_disk, with_collar
from engine.types import DiskSurface, Mesh, Surface
from tests.engine import remeshed
from tests.engine.shapes import grid_faces, sheet, sphere, without_faces
from tests.engine.test_topology import euler
from tests.faces import HEAD_NEUTRAL, ICT_NEUTRAL


@pytest.fixture(scope="module")
def face() -> Surface:
    return editable_surface(read_mesh(ICT_NEUTRAL).mesh)[0]


def assert_disk(disk: DiskSurface) -> None:
    sides = np.sort(disk.mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    faces_at = np.unique(sides, axis=0, return_counts=True)[1]
    assert faces_at.max() == 2
    assert euler(disk.mesh) == 1
    assert len(disk.boundary) == (faces_at == 1).sum()
    assert len(set(disk.boundary.tolist())) == len(disk.boundary)
    assert len(np.unique(disk.mesh.faces)) == len(disk.mesh.vertices)


def area(mesh: Mesh, faces: slice | np.ndarray) -> float:
    a, b, c = (mesh.vertices[mesh.faces[faces][:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_holes_of_a_face_are_closed_after_its_own_faces(face: Surface) -> None:
    disk = disk_surface(face)
    assert_disk(disk)
    own = len(disk.face)
    assert np.array_equal(disk.mesh.faces[:own], face.mesh.faces)
    assert np.array_equal(disk.vertex, np.arange(len(face.mesh.vertices)))
    assert len(disk.mesh.faces) - own == 72 + 40 + 40
    assert set(disk.boundary.tolist()) == set(face.loops[0].tolist())


def test_holes_that_are_kept_are_loops_of_the_disk(face: Surface) -> None:
    kept, filled = disk_surface(face, holes="kept"), disk_surface(face)
    assert np.array_equal(kept.mesh.faces, face.mesh.faces)
    assert [loop.tolist() for loop in kept.holes] == [loop.tolist() for loop in face.loops[1:]]
    assert np.array_equal(kept.boundary, filled.boundary)
    again = filled_disk(kept)
    assert not again.holes
    assert np.array_equal(again.mesh.faces, filled.mesh.faces)
    assert filled_disk(filled) is filled


def test_of_an_opened_surface_the_holes_away_from_the_patch_are_kept() -> None:
    ball = sphere(4)
    holes = [int(np.argmax(ball.vertices[ball.faces].mean(axis=1) @ axis)) for axis in np.eye(3)]
    surface, _ = editable_surface(without_faces(ball, np.array(holes)))
    keep = surface.loops[0]
    disk = disk_surface(surface, keep=keep, holes="kept")
    assert len(disk.holes) in (2, 3)
    assert any(np.isin(disk.vertex[loop], keep).all() for loop in disk.holes)
    assert_disk(filled_disk(disk))


def test_fills_have_minimal_area_and_add_nothing_to_a_flat_hole() -> None:
    flat = sheet(9, 9)
    flat = Mesh(flat.vertices * [1, 1, 0], flat.faces)
    centre = flat.vertices[flat.faces].mean(axis=1)
    inner = np.flatnonzero((np.abs(centre - [4, 4, 0]) < 2.1).all(axis=1))
    surface, _ = editable_surface(without_faces(flat, inner))
    disk = disk_surface(surface)
    assert_disk(disk)
    assert area(disk.mesh, slice(None)) == pytest.approx(64.0, rel=1e-12)


def test_a_fill_makes_no_edge_that_exists() -> None:
    """The short chord 0-2 of the hole 0-1-2-3 is taken by the flap 0-1-2: the fill uses 1-3."""
    hole = [[1, 0, 0], [0, 3, 0], [-1, 0, 0], [0, -3, 0]]
    rim = [[9, 0, 5], [-9, 0, 5], [0, -9, 5]]
    walls = [[0, 1, 2], [0, 2, 5], [0, 5, 4], [2, 3, 6], [2, 6, 5], [3, 0, 4], [3, 4, 6]]
    surface, _ = editable_surface(Mesh(np.array(hole + rim, dtype=float), np.array(walls)))
    assert [len(loop) for loop in surface.loops] == [3, 4]
    disk = disk_surface(surface)
    assert_disk(disk)
    assert all({1, 3} <= set(face) for face in disk.mesh.faces[len(walls) :].tolist())


def test_pinholes_and_bow_ties(face: Surface) -> None:
    rng = np.random.default_rng(5)
    holes = rng.permutation(len(face.mesh.faces))[:250]
    surface, warnings = editable_surface(without_faces(face.mesh, holes))
    assert any(warning.code == "pinholes" for warning in warnings)
    disk = disk_surface(surface)
    assert_disk(disk)


@pytest.mark.parametrize("corners", [100, 500, 3000])
def test_long_ragged_holes_close(corners: int) -> None:
    angle = np.arange(corners) * 2 * np.pi / corners
    radius = np.array([1.0, 1.3, 3.0])[:, None] * (1 + 0.2 * np.sin(7 * angle))
    height = 0.3 * np.cos(5 * angle) * np.ones((3, 1))
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    faces = grid_faces(3, corners, (False, True))[:, ::-1]
    surface, _ = editable_surface(Mesh(vertices.reshape(-1, 3), faces))
    disk = disk_surface(surface)
    assert_disk(disk)
    fill = area(disk.mesh, slice(len(disk.face), None))
    assert fill < 1.6 * np.pi


def test_a_closed_surface_is_opened_away_from_what_is_kept() -> None:
    surface, _ = editable_surface(sphere(4))
    keep = np.flatnonzero(surface.mesh.vertices[:, 2] > 0.5)
    disk = disk_surface(surface, keep=keep)
    assert_disk(disk)
    assert np.isin(keep, disk.vertex).all()
    assert disk.mesh.vertices[disk.boundary][:, 2].max() < -0.5
    lost = 1 - area(disk.mesh, slice(None)) / area(surface.mesh, slice(None))
    assert 0.04 < lost < 0.08
    assert np.array_equal(disk.mesh.vertices, surface.mesh.vertices[disk.vertex])


@pytest.fixture(scope="module")
def head() -> Mesh:
    return remeshed.closed(editable_surface(read_mesh(HEAD_NEUTRAL).mesh)[0].mesh)


def curve(mesh: Mesh, keep: np.ndarray | None = None) -> np.ndarray:
    """The curve on which a closed surface is opened."""
    disk = disk_surface(editable_surface(mesh)[0], keep=keep)
    assert_disk(disk)
    assert_disk(with_collar(disk))
    wide = with_collar(disk)
    return wide.mesh.vertices[wide.boundary]


@pytest.mark.parametrize("kept", [0, 30])
def test_the_curve_on_which_a_head_is_opened_is_the_same_whatever_its_triangles(
    head: Mesh, kept: int
) -> None:
    """With some vertices to keep on the crown, where it would be opened else, and on the face."""
    size = np.sqrt(area(head, slice(None)))
    coarse, number = remeshed.coarser(head, 3000)
    order = [number[np.argsort(-head.vertices[number, axis])[:kept]] for axis in (1, 2)]
    keep = np.concatenate(order)
    along = densely(curve(head, keep))
    for mesh, own in (
        (remeshed.subdivided(head), keep),
        (coarse, np.flatnonzero(np.isin(number, keep))),
    ):
        there = densely(curve(mesh, own))
        assert KDTree(along).query(there)[0].max() < 0.03 * size
        assert KDTree(there).query(along)[0].max() < 0.03 * size
    assert not kept or KDTree(head.vertices[keep]).query(along)[0].min() > 0.1 * size


def densely(loop: np.ndarray) -> np.ndarray:
    share = np.linspace(0, 1, 50)[:, None, None]
    return ((1 - share) * loop + share * np.roll(loop, -1, axis=0)).reshape(-1, 3)


def test_a_head_is_opened_at_the_crown_however_it_lies(head: Mesh) -> None:
    along = curve(head)
    assert along[:, 1].min() > np.quantile(head.vertices[:, 1], 0.9)
    turn = remeshed.motion(120.0, np.array([3.0, 0.0, -40.0]), 7.0)
    np.testing.assert_allclose(
        curve(head.moved(turn(head.vertices))), turn(along), rtol=0, atol=1e-9
    )


def test_a_surface_without_volume_or_direction_is_opened_too() -> None:
    ball = sphere(3)
    flat = ball.moved(ball.vertices * [1.0, 0.6, 0.0])
    for mesh in (ball, flat, Mesh(ball.vertices[:6], sphere(0).faces)):
        assert_disk(disk_surface(editable_surface(mesh)[0]))


def test_nothing_that_is_kept_is_lost_even_if_that_is_everything() -> None:
    surface, _ = editable_surface(sphere(2))
    disk = disk_surface(surface, keep=np.arange(len(surface.mesh.vertices)))
    assert_disk(disk)
    assert len(disk.mesh.vertices) == len(surface.mesh.vertices)


def test_without_keep_the_plainest_part_is_opened() -> None:
    ball = sphere(4)
    front = ball.vertices[:, 2] > -0.3
    rough = 1 + 0.05 * front * np.sin(25 * ball.vertices[:, 0]) * np.sin(25 * ball.vertices[:, 1])
    surface, _ = editable_surface(Mesh(ball.vertices * rough[:, None], ball.faces))
    disk = disk_surface(surface)
    assert_disk(disk)
    assert disk.mesh.vertices[disk.boundary][:, 2].mean() < -0.3


def test_a_puncture_is_not_taken_for_the_outer_boundary() -> None:
    surface, _ = editable_surface(without_faces(sphere(4), np.array([100])))
    disk = disk_surface(surface, keep=surface.loops[0])
    assert_disk(disk)
    assert len(disk.boundary) > 20
    assert len(disk.mesh.faces) == len(disk.face) + 1


def test_a_head_with_pockets_is_a_disk_already() -> None:
    surface, _ = editable_surface(read_mesh(HEAD_NEUTRAL).mesh)
    disk = disk_surface(surface)
    assert_disk(disk)
    assert len(disk.mesh.faces) == len(surface.mesh.faces)
