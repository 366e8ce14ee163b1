import tracemalloc

import numpy as np
import pytest

from engine.errors import TopologyError
from engine.io import read_mesh
from engine.topology import (
    TopologyCounts,
    boundary_loops,
    editable_surface,
    position_classes,
    topology_counts,
)
from engine.types import Mesh, MeshWarning
from tests.engine.shapes import moebius_strip, sheet, soup, sphere, together, torus, without_faces
from tests.faces import HEAD_NEUTRAL, ICT_NEUTRAL


@pytest.fixture(scope="module")
def face() -> Mesh:
    return read_mesh(ICT_NEUTRAL).mesh


def counts(warnings: tuple[MeshWarning, ...]) -> dict[str, int]:
    return {warning.code: warning.count for warning in warnings}


def euler(mesh: Mesh) -> int:
    sides = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return len(np.unique(mesh.faces)) - len(np.unique(sides, axis=0)) + len(mesh.faces)


def directed(faces: np.ndarray) -> set[tuple[int, int]]:
    return {tuple(e) for e in faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()}


def test_loops_keep_the_surface_on_their_left(face: Mesh) -> None:
    sides = directed(face.faces)
    loops = boundary_loops(face.faces, len(face.vertices))
    assert [len(loop) for loop in loops] == [204, 74, 42, 42]
    along = [
        (int(a), int(b)) for loop in loops for a, b in zip(loop, np.roll(loop, -1), strict=True)
    ]
    assert set(along) == {(a, b) for a, b in sides if (b, a) not in sides}


def test_a_loop_that_touches_itself_becomes_simple_loops() -> None:
    whole = sheet(5, 5)
    holes = [i for i, f in enumerate(whole.faces.tolist()) if {12} & set(f)]
    opposite = [
        holes[0],
        next(i for i in holes if len(set(whole.faces[i]) & set(whole.faces[holes[0]])) == 1),
    ]
    loops = boundary_loops(without_faces(whole, np.array(opposite)).faces, 25)
    assert sorted(len(loop) for loop in loops) == [3, 3, 16]
    assert all(len(set(loop.tolist())) == len(loop) for loop in loops)


def test_loops_of_a_crowded_edge_are_refused() -> None:
    book = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    with pytest.raises(TopologyError) as refused:
        boundary_loops(book, 5)
    assert refused.value.elements["faces"] == [0, 1, 2]


def test_a_clean_face_is_its_own_surface(face: Mesh) -> None:
    surface, warnings = editable_surface(face)
    assert warnings == ()
    assert np.array_equal(surface.mesh.vertices, face.vertices)
    assert np.array_equal(surface.mesh.faces, face.faces)
    assert np.array_equal(surface.vertex_of, np.arange(len(face.vertices)))
    assert [len(loop) for loop in surface.loops] == [204, 74, 42, 42]


def test_the_head_leaves_eyes_teeth_and_tongue_aside() -> None:
    head = read_mesh(HEAD_NEUTRAL).mesh
    surface, warnings = editable_surface(head)
    assert counts(warnings) == {"other_components": 5}
    assert [len(loop) for loop in surface.loops] == [50]
    assert (surface.vertex_of < 0).sum() == len(head.vertices) - len(surface.mesh.vertices)


def test_near_and_outer_choose_component_and_boundary(face: Mesh) -> None:
    head = read_mesh(HEAD_NEUTRAL).mesh
    aside = np.flatnonzero(editable_surface(head)[0].vertex_of < 0)
    eye, _ = editable_surface(Mesh(head.vertices, head.faces), near=aside[:5])
    assert (eye.vertex_of[aside[:5]] >= 0).all()
    mouth = boundary_loops(face.faces, len(face.vertices))[1]
    surface, _ = editable_surface(face, outer=mouth[::7])
    assert np.array_equal(surface.loops[0], mouth)


def test_triangle_soup_becomes_the_face_again(face: Mesh) -> None:
    scattered = soup(face)
    surface, warnings = editable_surface(scattered)
    assert counts(warnings) == {"welded_vertices": len(scattered.vertices) - len(face.vertices)}
    assert sorted(len(loop) for loop in surface.loops) == [42, 42, 74, 204]
    assert len(surface.mesh.vertices) == len(face.vertices)
    assert np.array_equal(surface.mesh.vertices[surface.vertex_of], scattered.vertices)


def test_a_seam_closes_but_sheets_that_only_cross_at_a_vertex_stay_apart() -> None:
    left, right = sheet(4, 4), sheet(4, 4)
    shifted = Mesh(right.vertices * [-1, 1, 1], right.faces[:, ::-1])
    surface, warnings = editable_surface(together(left, shifted))
    assert counts(warnings) == {"welded_vertices": 4}
    assert len(surface.loops) == 1
    corner = Mesh(right.vertices * [-1, -1, 1], right.faces)
    first = np.arange(len(left.vertices))
    touching, warnings = editable_surface(together(left, corner), near=first)
    assert counts(warnings) == {"other_components": 1}
    assert len(touching.mesh.faces) == len(left.faces)


def test_two_discs_of_one_size_are_refused_unless_the_request_says_which() -> None:
    disc, other = sheet(4, 4), sheet(4, 4)
    moved = Mesh(other.vertices + 20.0, other.faces)
    larger = Mesh(other.vertices * 1.1 + 20.0, other.faces)
    with pytest.raises(TopologyError) as refused:
        editable_surface(together(disc, moved))
    assert refused.value.code == "ambiguous"
    assert refused.value.elements["faces"] == [0, len(disc.faces)]
    chosen, _ = editable_surface(together(disc, moved), near=np.array([0]))
    assert chosen.face_of.max() < len(disc.faces)
    surface, warnings = editable_surface(together(disc, larger))
    assert surface.face_of.min() == len(disc.faces)
    assert counts(warnings) == {"other_components": 1}


def test_the_counts_of_soup_are_those_of_the_face(face: Mesh) -> None:
    degenerate = Mesh(face.vertices, np.concatenate([face.faces, face.faces[:5, [0, 0, 1]]]))
    for mesh in (face, soup(face), degenerate):
        assert topology_counts(mesh) == TopologyCounts(1, 4, -2)
    two = together(torus(), sphere(2))
    assert topology_counts(two) == TopologyCounts(2, 0, 2)


def test_reversed_faces_are_turned_to_the_larger_side(face: Mesh) -> None:
    faces = face.faces.copy()
    some = np.random.default_rng(3).permutation(len(faces))[: len(faces) * 3 // 10]
    faces[some] = faces[some][:, ::-1]
    surface, warnings = editable_surface(Mesh(face.vertices, faces))
    assert counts(warnings) == {"flipped_faces": len(some)}
    assert directed(surface.mesh.faces) == directed(face.faces)


def test_fins_repetitions_and_needles_are_left_out(face: Mesh) -> None:
    tip = len(face.vertices)
    a, b, c = face.faces[5000]
    extra = [[b, a, tip], [a, tip, c], face.faces[7][::-1], face.faces[9], [a, a, b]]
    vertices = np.concatenate([face.vertices, face.vertices[[a]] * 1.1])
    dirty = Mesh(vertices, np.concatenate([face.faces, np.array(extra)]))
    surface, warnings = editable_surface(dirty)
    found = counts(warnings)
    assert found["duplicate_faces"] == 2
    assert found["degenerate_faces"] == 1
    assert found["nonmanifold_edges"] == 2
    (crowded,) = (each.first for each in warnings if each.code == "nonmanifold_edges")
    assert all({a, b} <= set(dirty.faces[f]) or {a, c} <= set(dirty.faces[f]) for f in crowded)
    assert len(crowded) == 2
    assert np.array_equal(surface.mesh.faces, face.faces)
    assert surface.vertex_of[tip] == -1


def test_repeated_faces_take_little_memory(face: Mesh) -> None:
    copies = np.concatenate([face.faces, np.repeat(face.faces[:20], 20_000, axis=0)])
    editable_surface(Mesh(face.vertices, copies))
    tracemalloc.start()
    surface, warnings = editable_surface(Mesh(face.vertices, copies))
    counted = topology_counts(Mesh(face.vertices, copies))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2 * copies.nbytes
    assert counts(warnings) == {"duplicate_faces": 400_000}
    assert np.array_equal(surface.mesh.faces, face.faces)
    assert counted == topology_counts(face)


def test_islands_and_unused_vertices_are_counted(face: Mesh) -> None:
    rng = np.random.default_rng(0)
    debris = [Mesh(rng.normal(size=(3, 3)) + 50 + 9 * i, np.array([[0, 1, 2]])) for i in range(30)]
    points = Mesh(rng.normal(size=(7, 3)), np.zeros((0, 3), dtype=np.int64))
    surface, warnings = editable_surface(together(face, *debris, points))
    assert counts(warnings) == {"unreferenced_vertices": 7, "other_components": 30}
    assert len(surface.mesh.faces) == len(face.faces)


def test_touching_spheres_are_divided_and_touching_holes_are_not() -> None:
    ball = sphere(2)
    pinched = ball.faces.copy()
    pinched[pinched == 3] = 0
    surface, warnings = editable_surface(Mesh(ball.vertices, pinched))
    assert counts(warnings)["split_vertices"] == 1
    assert euler(surface.mesh) == 2
    assert surface.closed


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_one_sided_and_handled_surfaces_are_refused(scale: float) -> None:
    for shape, code in ((moebius_strip(), "not_orientable"), (torus(), "handles")):
        with pytest.raises(TopologyError) as refused:
            editable_surface(Mesh(shape.vertices * scale, shape.faces))
        assert refused.value.code == code


def test_a_punctured_torus_is_refused_with_a_path_around_the_handle() -> None:
    shape = without_faces(torus(), np.array([3, 40]))
    with pytest.raises(TopologyError) as refused:
        editable_surface(shape)
    assert refused.value.elements["handles"] == 1
    path = refused.value.elements["vertices"]
    assert isinstance(path, list)
    assert 6 <= len(path) <= 20


@pytest.mark.parametrize("seed", [11, 13, 14])
def test_a_torus_of_many_holes_is_refused_with_a_path_around_the_handle(seed: int) -> None:
    random, whole = np.random.default_rng(seed), torus(4, 4)
    gone = random.permutation(len(whole.faces))[: int(len(whole.faces) * random.uniform(0, 0.5))]
    with pytest.raises(TopologyError) as refused:
        editable_surface(without_faces(whole, gone))
    path = refused.value.elements["vertices"]
    assert isinstance(path, list)
    row, column = np.divmod(path, 4)
    turns = [np.round(_steps(along).sum() / 4) for along in (row, column)]
    assert any(turns)


def _steps(along: np.ndarray) -> np.ndarray:
    """Of a closed path on a ring of four, each to the nearest."""
    return (np.roll(along, -1) - along + 1) % 4 - 1


def test_the_inside_of_a_solid_is_refused(face: Mesh) -> None:
    corners = np.random.default_rng(3).integers(0, 60, (400, 3))
    corners = np.unique(np.sort(corners, axis=1), axis=0)
    corners = corners[(np.diff(corners) > 0).all(axis=1)]
    with pytest.raises(TopologyError, match="outside") as refused:
        editable_surface(Mesh(face.vertices[:60], corners))
    assert refused.value.code == "not_a_surface"
    assert refused.value.elements["face_count"] == len(corners)


def debris(count: int, corners: int = 3) -> Mesh:
    """Small strips of two triangles (four corners) or of one, at random in the unit cube."""
    random = np.random.default_rng(count)
    middle = random.uniform(0, 1, (count, 1, 3))
    vertices = middle + random.uniform(-0.01, 0.01, (count, corners, 3))
    first = corners * np.arange(count)[:, None]
    strips = np.array([[0, 1, 2], [1, 3, 2]])[: corners - 2].reshape(1, -1)
    return Mesh(vertices.reshape(-1, 3), (first + strips).reshape(-1, 3))


def pages(count: int) -> Mesh:
    """Triangles at one edge."""
    angle = np.linspace(0, 6, count)
    outer = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    hinge = np.tile([0, 1], (count, 1))
    faces = np.column_stack([hinge, np.arange(count) + 2])
    return Mesh(np.concatenate([[[0, 0, 0], [0, 0, 1]], outer]), faces)


@pytest.mark.parametrize("chaos", [debris(4000), debris(4000, 4), pages(4000)])
def test_faces_that_make_no_surface_are_refused_until_there_is_one_among_them(
    face: Mesh, chaos: Mesh
) -> None:
    with pytest.raises(TopologyError, match="no surface") as refused:
        editable_surface(chaos)
    assert refused.value.code == "not_a_surface"
    surface, _ = editable_surface(together(chaos, face))
    assert np.array_equal(surface.mesh.vertices, face.vertices)
    assert np.array_equal(surface.mesh.faces, face.faces)


def test_a_vertex_may_have_hundreds_of_faces() -> None:
    count = 300
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    around = np.arange(count)
    order = np.random.default_rng(0).permutation(count)
    wheel = np.stack([np.zeros(count, int), 1 + around, 1 + (around + 1) % count], axis=1)[order]
    surface, warnings = editable_surface(Mesh(np.concatenate([[[0, 0, 0.5]], rim]), wheel))
    assert not warnings
    assert np.array_equal(surface.mesh.faces, wheel)
    assert [loop.tolist() for loop in surface.loops] == [list(range(1, count + 1))]


def test_meshes_without_area_are_refused() -> None:
    points = Mesh(np.random.default_rng(0).normal(size=(5, 3)), np.zeros((0, 3), dtype=np.int64))
    line = Mesh(np.arange(4.0)[:, None] * np.ones(3), np.array([[0, 1, 2], [1, 2, 3]]))
    for mesh, code in ((points, "no_faces"), (line, "degenerate")):
        with pytest.raises(TopologyError) as refused:
            editable_surface(mesh)
        assert refused.value.code == code


def test_relabelling_relabels_the_surface(face: Mesh) -> None:
    rng = np.random.default_rng(1)
    new = rng.permutation(len(face.vertices))
    vertices = np.empty_like(face.vertices)
    vertices[new] = face.vertices
    surface, _ = editable_surface(Mesh(vertices, new[face.faces][rng.permutation(len(face.faces))]))
    back = np.argsort(new)
    assert directed(back[surface.mesh.faces]) == directed(face.faces)
    straight, _ = editable_surface(face)
    assert [set(back[loop]) for loop in surface.loops[:1]] == [set(straight.loops[0])]


def relabelled(mesh: Mesh, random: np.random.Generator) -> tuple[Mesh, np.ndarray]:
    """The same mesh with its vertices, faces and first corners in another order."""
    new = random.permutation(len(mesh.vertices))
    first = random.integers(0, 3, (len(mesh.faces), 1))
    faces = np.take_along_axis(new[mesh.faces], (first + np.arange(3)) % 3, axis=1)
    return Mesh(mesh.vertices[np.argsort(new)], random.permutation(faces)), new


def cleaned(mesh: Mesh, new: np.ndarray, places: np.ndarray) -> tuple[object, ...]:
    """What is left of ``mesh``, by places: vertices, directed faces, loops, outer loop, and which
    faces every vertex ``new`` of the file goes with."""
    surface, _ = editable_surface(mesh)
    vertices = surface.mesh.vertices
    at = position_classes(np.concatenate([places, vertices]))[len(places) :]
    faces = [min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in at[surface.mesh.faces].tolist()]
    around: list[set[tuple[int, int, int]]] = [set() for _ in vertices]
    for corners, face in zip(surface.mesh.faces.tolist(), faces, strict=True):
        for corner in corners:
            around[corner].add(face)
    loops = [tuple(np.roll(loop, -np.argmin(loop))) for loop in (at[x] for x in surface.loops)]
    goes_with = [around[v] if v >= 0 else None for v in surface.vertex_of[new]]
    return len(vertices), sorted(faces), set(loops), loops[:1], goes_with


def with_symmetric_faults(mesh: Mesh) -> Mesh:
    """Fins to both sides, faces that are there twice over other vertices, and a pinched vertex."""
    vertices, faces = list(mesh.vertices), mesh.faces.tolist()
    for face in (20, 60, 90):
        a, b, _ = faces[face]
        for side in (1, -1):
            vertices.append((vertices[a] + vertices[b]) / 2 + [0, 0, side / 2])
            faces.append([a, b, len(vertices) - 1])
            faces.append([b, faces[face][2], len(vertices) - 1])
    for face in (40, len(faces) - 1):
        faces.append([len(vertices), len(vertices) + 1, faces[face][2]])
        vertices += [vertices[faces[face][0]], vertices[faces[face][1]]]
    faces = [[100 if corner == 30 else corner for corner in face] for face in faces]
    return Mesh(np.array(vertices), np.array(faces))


@pytest.mark.parametrize("shape", [sheet(9, 13), sphere(3)], ids=["sheet", "sphere"])
def test_cleaning_does_not_depend_on_the_order_of_vertices_and_faces(shape: Mesh) -> None:
    holed = without_faces(shape, np.array([10, 11, 70, 71, 72]))
    for mesh in (with_symmetric_faults(holed), with_symmetric_faults(soup(holed))):
        same = cleaned(mesh, np.arange(len(mesh.vertices)), mesh.vertices)
        for seed in range(6):
            other, new = relabelled(mesh, np.random.default_rng(seed))
            assert cleaned(other, new, mesh.vertices) == same


def test_a_fin_that_is_there_twice_leaves_no_slit(face: Mesh) -> None:
    """On a seam of two edges, each copy with the middle vertex of another side."""
    faces, tip, other = face.faces.copy(), len(face.vertices), len(face.vertices) + 1
    middle, start, end = faces[5000]
    beside = next(i for i, f in enumerate(faces.tolist()) if {middle, end} < set(f) and i != 5000)
    (end,) = set(faces[beside].tolist()) - {middle, end}
    faces[[5000, beside]] = np.where(faces == middle, other, faces)[[5000, beside]]
    fins = np.array([[middle, start, tip], [middle, tip, end]])
    copies = np.where(fins == middle, other, fins)[:, ::-1]
    vertices = np.concatenate([face.vertices, face.vertices[[middle]] * [[1.1], [1]]])
    for order in ([*fins, *copies], [*copies, *fins]):
        surface, _ = editable_surface(Mesh(vertices, np.concatenate([faces, order])))
        assert [len(loop) for loop in surface.loops] == [204, 74, 42, 42]
        assert len(surface.mesh.vertices) == len(face.vertices)


def test_many_faces_at_one_corner_are_refused_as_degenerate():
    mesh = Mesh(np.eye(3), np.zeros((5, 3), dtype=np.int64))
    with pytest.raises(TopologyError) as refused:
        editable_surface(mesh)
    assert refused.value.code == "degenerate"


def test_faces_that_meet_in_threes_at_every_edge_are_refused():
    vertices = np.array([[0, 0, 1], [2, 1, 1], [1, 1, 0], [2, 2, 1], [2, 2, 2]], dtype=float)
    wound = "122 143 214 314 213 403 412 042 243 014 241 402 311 231"
    faces = np.array([[int(corner) for corner in face] for face in wound.split()])
    with pytest.raises(TopologyError) as refused:
        editable_surface(Mesh(vertices, faces))
    assert refused.value.code == "not_a_surface"
