import numpy as np

from engine.numbering import Numbering
from engine.types import Mesh, Surface, SurfacePoints
from tests.engine.remeshed import face, relabelled, surface_of
from tests.faces import ICT_NEUTRAL


def shuffled() -> Mesh:
    return relabelled(face(ICT_NEUTRAL), 3)[0]


def sides(mesh: Mesh) -> float:
    """How far apart in memory the ends of a side are, on average."""
    ends = mesh.faces[:, :2]
    return float(np.abs(ends[:, 0] - ends[:, 1]).mean())


def test_neighbours_are_near_each_other_in_memory() -> None:
    mesh = shuffled()
    assert sides(Numbering(mesh).mesh) < 0.1 * sides(mesh)


def test_no_order_of_vertices_and_faces_makes_a_difference() -> None:
    one, other = (Numbering(relabelled(face(ICT_NEUTRAL), seed)[0]).mesh for seed in (3, 4))
    assert np.array_equal(one.vertices, other.vertices)
    assert np.array_equal(one.faces, other.faces)


def test_a_surface_keeps_its_vertices_faces_and_loops() -> None:
    before = surface_of(shuffled())
    with_gap = Surface(
        before.mesh, np.append(before.vertex_of, -1), before.face_of + 5, before.loops
    )
    numbering = Numbering(before.mesh)
    after = numbering.surface(with_gap)
    assert np.array_equal(after.vertex_of == -1, with_gap.vertex_of == -1)
    number = after.vertex_of[:-1]
    assert np.array_equal(after.mesh.vertices[number], before.mesh.vertices)
    for old, new in zip(before.loops, after.loops, strict=True):
        assert new[0] == new.min()
        first = int(np.flatnonzero(number[old] == new[0])[0])
        assert np.array_equal(new, number[np.roll(old, -first)])
    corners = before.mesh.vertices[before.mesh.faces[after.face_of - 5]]
    assert np.array_equal(after.mesh.vertices[after.mesh.faces], corners)
    values = np.arange(len(before.mesh.vertices))
    assert np.array_equal(numbering.outside(numbering.inside(values)), values)


def test_points_are_the_same_on_either_mesh() -> None:
    mesh, random = shuffled(), np.random.default_rng(0)
    numbering = Numbering(mesh)
    face_ = random.integers(0, len(mesh.faces), 50)
    points = SurfacePoints(face_, random.dirichlet(np.ones(3), 50))
    inside = numbering.points_inside(points)
    assert np.array_equal(inside.on(numbering.mesh), points.on(mesh))
    assert np.array_equal(numbering.points_outside(inside).face, points.face)
