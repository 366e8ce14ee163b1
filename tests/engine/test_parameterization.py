from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from engine.errors import EngineError, NumericalError, ParameterizationError
from engine.io import read_mesh
from engine.operators import cotangent_laplacian, face_areas, vertex_areas
from engine.parameterization import DiskAutomorphism, align_disk, disk_map
from engine.parameterization._certificate import runs_clockwise
from engine.parameterization._conformal import arc_length_disk
from engine.parameterization._frame import Frame
from engine.topology import boundary_loops, disk_surface, editable_surface
from engine.types import DiskMap, DiskSurface, Mesh
from tests.engine import remeshed
from tests.engine.rough import (
    random_disk,
    with_ears,
    with_pinholes,
    with_slivers,
    with_touching_holes,
    with_whisker,
)
from tests.engine.shapes import sphere
from tests.faces import (
    HEAD_MOUTH_OPEN,
    HEAD_NEUTRAL,
    HEAD_SMILE,
    ICT_JAW_OPEN,
    ICT_NEUTRAL,
    ICT_SMILE,
)

WAYS = [("filled", {}), ("filled", {"polish": True}), ("filled", {"method": "paper"})]
WAYS += [("kept", {}), ("kept", {"method": "paper"})]


def face(path, holes="filled") -> DiskSurface:
    return disk_surface(editable_surface(read_mesh(path).mesh)[0], holes=holes)


def whole(mesh: Mesh) -> DiskSurface:
    """A disk that is all surface."""
    (loop,) = boundary_loops(mesh.faces, len(mesh.vertices))
    every = np.arange(len(mesh.vertices))
    return DiskSurface(mesh, loop, every, np.arange(len(mesh.faces)))


def flat_disk(rings: int) -> Mesh:
    """Points on concentric circles and their Delaunay triangles, counter-clockwise from above."""
    points = [0j] + [
        r / rings * np.exp(2j * np.pi * (np.arange(6 * r) + 0.3 * (r % 3)) / (6 * r))
        for r in range(1, rings + 1)
    ]
    z = np.concatenate([np.atleast_1d(p) for p in points])
    faces = Delaunay(np.stack([z.real, z.imag], 1)).simplices.astype(np.int64)
    corner = z[faces]
    area = ((corner[:, 1] - corner[:, 0]).conj() * (corner[:, 2] - corner[:, 0])).imag
    faces = faces[np.abs(area) > 1e-9]
    faces[area[np.abs(area) > 1e-9] < 0] = faces[area[np.abs(area) > 1e-9] < 0][:, ::-1]
    return Mesh(np.stack([z.real, z.imag, 0 * z.real], 1), faces)


def hill(rings: int = 12) -> Mesh:
    mesh = flat_disk(rings)
    x, y, _ = mesh.vertices.T
    return mesh.moved(np.stack([x, 1.3 * y, 0.8 * np.exp(-3 * ((x - 0.3) ** 2 + y**2))], axis=1))


def assert_bijective(found: DiskMap) -> None:
    """Positive faces over a boundary once around, with holes that are simple, are a bijection."""
    a, b, c = found.z[found.surface.mesh.faces].T
    area = (b - a).real * (c - a).imag - (b - a).imag * (c - a).real
    for k in np.flatnonzero(np.abs(area) <= 1e-14 * np.abs(b - a) * np.abs(c - a)):
        (p, q), (r, s), (u, v) = (
            (Fraction(float(w.real)), Fraction(float(w.imag))) for w in (a[k], b[k], c[k])
        )
        area[k] = 1.0 if (r - p) * (v - q) > (s - q) * (u - p) else -1.0
    assert (area > 0).all()
    rim = found.z[found.surface.boundary]
    np.testing.assert_allclose(np.abs(rim), 1, atol=1e-15)
    turns = np.angle(np.roll(rim, -1) / rim) % (2 * np.pi)
    assert (turns > 0).all() and turns.sum() == pytest.approx(2 * np.pi)
    assert all(runs_clockwise(found.z[loop]) for loop in found.surface.holes)


def faces_over(found: DiskMap, points: np.ndarray) -> np.ndarray:
    """How many faces of the plane hold each of the points (k,)."""
    corner = found.z[found.surface.mesh.faces][:, :, None]
    side = (np.roll(corner, -1, 1) - corner).conj() * (points - corner)
    return (side.imag >= 0).all(axis=1).sum(axis=0)


def angle_distortion(found: DiskMap) -> float:
    """Mean change, in degrees, of the angles of the surface's own faces."""
    faces = found.surface.mesh.faces[: len(found.surface.face)]
    plane = np.stack([found.z.real, found.z.imag, 0 * found.z.real], axis=1)
    angles = []
    for points in (found.surface.mesh.vertices, plane):
        corner = points[faces]
        ahead, back = np.roll(corner, -1, 1) - corner, np.roll(corner, 1, 1) - corner
        size = np.linalg.norm(np.cross(ahead, back), axis=2)
        angles.append(np.degrees(np.arctan2(size, (ahead * back).sum(axis=2))))
    return float(np.abs(angles[0] - angles[1]).mean())


# automorphisms


def test_an_automorphism_keeps_the_circle_and_sends_a_to_the_centre():
    phi = DiskAutomorphism(0.4 - 0.5j, np.exp(0.7j))
    circle = np.exp(1j * np.linspace(0, 6, 50))
    np.testing.assert_allclose(np.abs(phi(circle)), 1, atol=1e-14)
    assert abs(phi(np.array([0.4 - 0.5j]))[0]) < 1e-16


def test_inverse_and_composition():
    phi, psi = DiskAutomorphism(0.4 - 0.5j, np.exp(0.7j)), DiskAutomorphism(-0.8j, np.exp(-2j))
    z = 0.9 * np.exp(1j * np.arange(20.0)) * np.linspace(0, 1, 20)
    np.testing.assert_allclose(phi.inverse()(phi(z)), z, atol=1e-14)
    np.testing.assert_allclose(phi.then(psi)(z), psi(phi(z)), atol=1e-14)


def test_what_is_no_automorphism_is_refused():
    for a, rotation in ((1.0 + 0j, 1 + 0j), (0j, 2 + 0j), (complex("nan"), 1 + 0j)):
        with pytest.raises(NumericalError):
            DiskAutomorphism(a, rotation)


@pytest.mark.parametrize("a", [0j, 0.3 - 0.2j, 0.85j])
def test_alignment_recovers_a_known_automorphism(a):
    rng = np.random.default_rng(0)
    z = np.sqrt(rng.random(30)) * np.exp(2j * np.pi * rng.random(30))
    phi = DiskAutomorphism(a, np.exp(2.5j))
    found = align_disk(z, phi(z), rng.random(30))
    assert abs(found.a - phi.a) < 1e-7 and abs(found.rotation - phi.rotation) < 1e-7


def test_alignment_is_a_minimum():
    rng = np.random.default_rng(1)
    z, onto = 0.8 * np.exp(2j * np.pi * rng.random((2, 12))) * rng.random((2, 12))
    weights = rng.random(12)
    found = align_disk(z, onto, weights)
    best = weights @ np.abs(found(z) - onto) ** 2
    for a, angle in ((1e-3, 0), (1e-3j, 0), (-1e-3, 0), (-1e-3j, 0), (0, 1e-3), (0, -1e-3)):
        near = found.then(DiskAutomorphism(complex(a), complex(np.exp(1j * angle))))
        assert weights @ np.abs(near(z) - onto) ** 2 >= best


def test_alignment_without_weight_changes_nothing():
    z = np.array([0.1 + 0.2j])
    assert align_disk(z, z + 0.1, np.zeros(1)) == DiskAutomorphism()


# disk maps


def test_a_flat_disk_is_mapped_to_itself_up_to_an_automorphism():
    errors = []
    for rings in (8, 16):
        mesh = flat_disk(rings)
        z = mesh.vertices[:, 0] + 1j * mesh.vertices[:, 1]
        found = disk_map(whole(mesh))
        assert_bijective(found)
        phi = align_disk(found.z, z, vertex_areas(mesh))
        errors.append(np.abs(phi(found.z) - z).max())
    assert errors[0] < 0.03 and errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("polish", [False, True])
def test_a_cap_of_a_sphere_converges_to_its_stereographic_projection(polish):
    errors, angles = [], []
    for rings in (8, 16, 32):
        flat = flat_disk(rings)
        z = flat.vertices[:, 0] + 1j * flat.vertices[:, 1]
        z = DiskAutomorphism(0.3 + 0.2j)(z)
        w = 1.5 * z  # the cap of all points within 2 atan 1.5 (113 degrees) of the south pole
        height = 1 + np.abs(w) ** 2
        cap = np.stack([2 * w.real / height, 2 * w.imag / height, 1 - 2 / height], axis=1)
        found = disk_map(whole(flat.moved(cap)), polish=polish)
        phi = align_disk(found.z, z, vertex_areas(flat))
        errors.append(np.abs(phi(found.z) - z).max())
        angles.append(angle_distortion(found))
    assert errors[2] < (0.25 if polish else 0.08) * errors[0]
    assert angles[2] < 0.55 * angles[1] < 0.3 * angles[0]


@pytest.mark.parametrize("path", [ICT_NEUTRAL, ICT_SMILE, ICT_JAW_OPEN])
def test_faces_with_holes_are_mapped_bijectively_and_nearly_conformally(path):
    plain, polished = disk_map(face(path)), disk_map(face(path), polish=True)
    kept = disk_map(face(path, "kept"))
    for found in (plain, polished, kept):
        assert_bijective(found)
    assert angle_distortion(plain) < 1.6
    assert angle_distortion(polished) < 0.93 * angle_distortion(plain)
    assert angle_distortion(kept) < 0.97 * angle_distortion(polished)


def test_every_point_of_the_disk_lies_under_one_face_except_in_holes():
    random = np.random.default_rng(4)
    points = 0.99 * np.sqrt(random.random(400)) * np.exp(2j * np.pi * random.random(400))
    assert (faces_over(disk_map(face(ICT_SMILE)), points) == 1).all()
    kept = disk_map(face(ICT_JAW_OPEN, "kept"))
    mouth = max((kept.z[loop] for loop in kept.surface.holes), key=np.ptp)
    inside = mouth.mean() + 0.001 * points
    assert (faces_over(kept, points) <= 1).all()
    assert (faces_over(kept, inside) == 0).all()


@pytest.mark.parametrize(("holes", "options"), WAYS)
def test_nothing_that_files_bring_folds(holes, options):
    mesh = read_mesh(ICT_SMILE).mesh
    for rough in (
        with_slivers(mesh, 300, 0.01),
        with_ears(with_pinholes(mesh, 250), 3),
        with_touching_holes(mesh, 20),
    ):
        surface, _ = editable_surface(rough)
        disk = disk_surface(surface, holes=holes)
        assert bool(disk.holes) == (holes == "kept")
        assert_bijective(disk_map(disk, **options))


@pytest.mark.parametrize(("holes", "options"), WAYS)
def test_whiskers_are_drawn_that_harmonic_maps_shrink_to_nothing(holes, options):
    mesh = read_mesh(ICT_SMILE).mesh
    beside = np.flatnonzero(np.isin(mesh.faces, mesh.faces[7000]).sum(axis=1) == 2)[0]
    rough = with_whisker(with_whisker(mesh, 7000, 60), beside, 40)
    surface, _ = editable_surface(rough)
    assert len(surface.mesh.vertices) > len(mesh.vertices) + 290
    assert_bijective(disk_map(disk_surface(surface, holes=holes), **options))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_random_disks_are_mapped_bijectively_in_every_way(seed):
    try:
        surface, _ = editable_surface(random_disk(seed))
        disks = {holes: disk_surface(surface, holes=holes) for holes in ("filled", "kept")}
    except EngineError:
        return
    for holes, options in WAYS:
        assert_bijective(disk_map(disks[holes], **options))


def test_closed_surfaces_are_opened():
    surface, _ = editable_surface(sphere(4))
    assert_bijective(disk_map(disk_surface(surface)))


@pytest.mark.parametrize("path", [HEAD_SMILE, HEAD_MOUTH_OPEN])
@pytest.mark.parametrize("method", ["default", "paper"])
def test_heads_with_pockets_are_mapped_bijectively(path, method):
    assert_bijective(disk_map(face(path), method=method))


def file_plane(mesh: Mesh, holes: str = "filled", **options) -> np.ndarray:
    """Where each vertex of a file lands."""
    surface, _ = editable_surface(mesh)
    found = disk_map(disk_surface(surface, holes=holes), **options)
    z = np.full(len(surface.mesh.vertices), np.nan + 0j)
    z[found.surface.vertex] = found.z[: len(found.surface.vertex)]
    return z[surface.vertex_of]


def test_the_same_face_lands_in_nearly_the_same_frame_whatever_its_expression():
    neutral, smile = (file_plane(read_mesh(path).mesh) for path in (ICT_NEUTRAL, ICT_SMILE))
    assert np.abs(neutral - smile).mean() < 0.02


@pytest.mark.parametrize(("holes", "options"), WAYS)
def test_the_frame_is_the_surfaces_own(holes, options):
    mesh = read_mesh(ICT_NEUTRAL).mesh
    z = file_plane(mesh, holes, **options)
    turn = remeshed.motion(70.0, np.array([40.0, -3.0, 8.0]), 0.01)
    moved = mesh.moved(turn(mesh.vertices))
    np.testing.assert_allclose(file_plane(moved, holes, **options), z, rtol=0, atol=1e-9)
    mixed, number = remeshed.relabelled(moved)
    np.testing.assert_allclose(file_plane(mixed, holes, **options)[number], z, rtol=0, atol=1e-9)
    finer = np.abs(file_plane(remeshed.subdivided(moved), holes, **options)[: len(z)] - z)
    assert finer.mean() < 2e-3 and finer.max() < 0.02
    coarser, kept = remeshed.coarser(moved, 4000)
    apart = np.abs(file_plane(coarser, holes, **options) - z[kept])
    assert apart.mean() < 5e-3 and apart.max() < 0.04


def test_the_papers_map_of_slivers_does_not_depend_on_labels():
    mesh = with_slivers(read_mesh(ICT_NEUTRAL).mesh, 300, 1e-5)
    mixed, number = remeshed.relabelled(mesh)
    planes = []
    for one in (mesh, mixed):
        surface, _ = editable_surface(one)
        disk = disk_surface(surface)
        planes.append(Frame.of(disk).turned(arc_length_disk(disk))[surface.vertex_of])
    np.testing.assert_allclose(planes[1][number], planes[0], rtol=0, atol=2e-10)


def closed_head() -> Mesh:
    return remeshed.closed(editable_surface(read_mesh(HEAD_NEUTRAL).mesh)[0].mesh)


def off_the_edge(mesh: Mesh) -> np.ndarray:
    """Vertices of the disk whose faces do not touch its boundary."""
    found = disk_surface(editable_surface(mesh)[0])
    at_edge = np.isin(found.mesh.faces, found.boundary).any(axis=1)
    return np.setdiff1d(found.vertex, found.vertex[found.mesh.faces[at_edge]])


@pytest.mark.parametrize("options", [{}, {"polish": True}, {"method": "paper"}])
def test_the_frame_of_an_opened_head_depends_neither_on_pose_nor_on_labels(options):
    mesh = closed_head()
    z = file_plane(mesh, **options)
    turn = remeshed.motion(70.0, np.array([40.0, -3.0, 8.0]), 0.01)
    moved = mesh.moved(turn(mesh.vertices))
    np.testing.assert_allclose(file_plane(moved, **options), z, rtol=0, atol=1e-9)
    mixed, number = remeshed.relabelled(moved)
    np.testing.assert_allclose(file_plane(mixed, **options)[number], z, rtol=0, atol=1e-9)


def test_an_opened_head_lands_in_the_same_frame_however_it_is_triangulated():
    mesh = closed_head()
    z, inner = file_plane(mesh), off_the_edge(mesh)
    finer = np.abs(file_plane(remeshed.subdivided(mesh))[: len(z)] - z)
    assert np.nanmean(finer) < 5e-3 and np.nanmax(finer[inner]) < 0.015
    mixed, kept = remeshed.coarser(mesh, 2200)
    apart = np.abs(file_plane(mixed) - z[kept])
    assert np.nanmean(apart) < 0.01
    both = np.intersect1d(off_the_edge(mixed), np.flatnonzero(np.isin(kept, inner)))
    assert np.nanmax(apart[both]) < 0.03
    noise = 0.02 * np.random.default_rng(8).normal(size=mesh.vertices.shape)
    rough = np.abs(file_plane(mesh.moved(mesh.vertices + noise)) - z)
    assert np.nanmean(rough) < 3e-3 and np.nanmax(rough[inner]) < 0.05


def test_expressions_do_not_move_the_frame_of_an_opened_head():
    z = file_plane(closed_head())
    smile = remeshed.closed(editable_surface(read_mesh(HEAD_SMILE).mesh)[0].mesh)
    assert np.nanmean(np.abs(file_plane(smile) - z)) < 0.01


def test_an_opened_head_is_mapped_about_as_conformally_as_an_open_one():
    found = disk_map(disk_surface(editable_surface(closed_head())[0]))
    assert_bijective(found)
    assert angle_distortion(found) < 1.1 * angle_distortion(disk_map(face(HEAD_NEUTRAL)))


@pytest.mark.parametrize(("holes", "options"), WAYS)
def test_noise_moves_the_plane_in_proportion(holes, options):
    mesh = read_mesh(ICT_NEUTRAL).mesh
    z = file_plane(mesh, holes, **options)
    noise = 0.2 * np.random.default_rng(8).normal(size=mesh.vertices.shape)
    for size in (1e-9, 1e-6, 1e-3):
        moved = file_plane(mesh.moved(mesh.vertices + size * noise), holes, **options)
        assert np.abs(moved - z).max() < 3 * size


def test_the_means_by_area_and_by_boundary_length_are_opposite():
    found = disk_map(face(ICT_SMILE))
    mesh, rim = found.surface.mesh, found.z[found.surface.boundary]
    area = face_areas(mesh)[: len(found.surface.face)]
    centre = found.z[mesh.faces[: len(area)]].mean(axis=1)
    loop = mesh.vertices[found.surface.boundary]
    length = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)
    by_area = area @ centre / area.sum()
    by_length = length @ (rim + np.roll(rim, -1)) / 2 / length.sum()
    assert by_area == pytest.approx(-by_length, abs=1e-4)
    assert by_area.real < -0.01 and abs(by_area.imag) < 1e-4


def test_the_papers_map_is_harmonic_inside_and_by_arc_length_on_the_boundary():
    disk = whole(hill())
    found = disk_map(disk, method="paper")
    residual = cotangent_laplacian(disk.mesh) @ found.z
    residual[disk.boundary] = 0
    np.testing.assert_allclose(residual, 0, atol=1e-12)
    rim, loop = found.z[disk.boundary], disk.mesh.vertices[disk.boundary]
    length = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)
    turned = np.angle(np.roll(rim, -1) / rim)
    np.testing.assert_allclose(turned, 2 * np.pi * length / length.sum(), atol=1e-12)


@pytest.mark.parametrize("method", ["default", "paper"])
def test_pose_scale_and_labels_do_not_matter(method):
    mesh = hill()
    z = disk_map(whole(mesh), method=method).z
    rng = np.random.default_rng(2)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    moved = mesh.moved(1e-6 * mesh.vertices @ turn.T + [3e-6, 1e-6, 0])
    np.testing.assert_allclose(disk_map(whole(moved), method=method).z, z, rtol=0, atol=1e-9)
    label = rng.permutation(len(z))
    faces = np.roll(label[mesh.faces], 1, axis=1)[rng.permutation(len(mesh.faces))]
    vertices = np.empty_like(mesh.vertices)
    vertices[label] = mesh.vertices
    relabelled = disk_map(whole(Mesh(vertices, faces)), method=method).z
    np.testing.assert_allclose(relabelled[label], z, rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", ["default", "paper"])
def test_slivers_do_not_fold(method):
    mesh = hill()
    vertices = mesh.vertices.copy()
    inside = np.flatnonzero((mesh.faces < 300).all(axis=1))
    for a, b, c in mesh.faces[np.random.default_rng(3).choice(inside, 25, replace=False)]:
        vertices[a] = (1 - 1e-9) * vertices[b] + 1e-9 * vertices[c]
    assert_bijective(disk_map(whole(mesh.moved(vertices)), method=method))


@pytest.mark.parametrize("method", ["default", "paper"])
def test_ears_chains_of_ears_and_disks_without_inside(method):
    mesh = hill(6)
    vertices, faces = list(mesh.vertices), list(mesh.faces)
    rim = boundary_loops(mesh.faces, len(vertices))[0]
    for a, b in ((rim[0], rim[1]), (rim[10], rim[11]), (rim[11], rim[12])):
        last = b
        for step in range(4):  # a strip of triangles that hangs on one boundary edge
            vertices.append(1.3 ** (step + 1) * (vertices[a] + vertices[b]) / 2 + [0, 0, 0.1])
            faces.append(np.array([a, len(vertices) - 1, last]))
            last = len(vertices) - 1
    assert_bijective(disk_map(whole(Mesh(np.array(vertices), np.array(faces))), method=method))
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]], [[0, 1, 2], [0, 2, 3]])
    assert_bijective(disk_map(whole(square), method=method))


def refusal(disk: DiskSurface) -> ParameterizationError:
    with pytest.raises(ParameterizationError) as caught:
        disk_map(disk)
    return caught.value


def test_triangulations_without_an_embedding_name_their_faces():
    disk = whole(hill(4))
    mesh = disk.mesh
    turned = mesh.faces.copy()
    turned[7] = turned[7, ::-1]
    found = refusal(replace(disk, mesh=Mesh(mesh.vertices, turned)))
    assert found.code == "not_a_disk" and 7 in found.elements["faces"]
    repeated = np.concatenate([mesh.faces, mesh.faces[3:4]])
    found = refusal(replace(disk, mesh=Mesh(mesh.vertices, repeated)))
    assert {3, len(mesh.faces)} <= set(found.elements["faces"])
    found = refusal(replace(disk, boundary=disk.boundary[::-1]))
    at_rim = np.flatnonzero(np.isin(mesh.faces, disk.boundary).sum(axis=1) > 1)
    assert found.elements["faces"] == at_rim.tolist()
    pierced = Mesh(mesh.vertices, np.delete(mesh.faces, 9, axis=0))
    found = refusal(replace(disk, mesh=pierced, face=disk.face[:-1]))
    assert found.code == "not_a_disk" and found.elements["faces"]


def test_faces_that_hang_at_a_point_or_not_at_all_are_named():
    disk = whole(hill(4))
    count = len(disk.mesh.vertices)
    vertices = np.concatenate([disk.mesh.vertices, 5 + np.eye(3)])
    for extra in ([count, count + 1, count + 2], [disk.boundary[0], count + 1, count + 2]):
        mesh = Mesh(vertices, np.concatenate([disk.mesh.faces, [extra]]))
        found = refusal(replace(disk, mesh=mesh, vertex=np.arange(len(vertices))))
        assert found.elements["faces"] == [len(disk.mesh.faces)]


def test_a_surface_without_area_is_refused():
    mesh = hill(4)
    assert refusal(whole(mesh.moved(np.zeros_like(mesh.vertices)))).code == "no_area"


@pytest.mark.parametrize(
    ("corners", "expected"),
    [
        ([0, 1j, 1 + 1j, 1], True),
        ([0, 1, 1 + 1j, 1j], False),  # counter-clockwise
        ([0, 1j, 2 + 1j, 1 + 1j, 1], False),  # turns back along an edge
        ([0, 1 + 1j, 1j, 1], False),  # crosses itself
        ([0, 1j, 0.5, 1 + 1j, 1], False),  # touches itself
        ([0, 1j, 0.5 + 1e-16j, 1 + 1j, 1], True),  # nearly does
        ([0, 1j, 1j, 1], False),  # a side without length
    ],
)
def test_holes_are_told_from_loops_that_meet_themselves(corners, expected):
    for start in range(len(corners)):
        assert runs_clockwise(np.roll(np.array(corners, dtype=complex), start)) == expected
