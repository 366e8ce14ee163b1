import numpy as np
import pytest
from scipy.spatial import Delaunay

from engine.errors import NumericalError, ParameterizationError
from engine.io import read_mesh
from engine.operators import cotangent_laplacian, vertex_areas
from engine.parameterization import DiskAutomorphism, align_disk, disk_map
from engine.topology import boundary_loops, disk_surface, editable_surface
from engine.types import DiskMap, DiskSurface, Mesh
from tests.faces import HEAD_MOUTH_OPEN, HEAD_SMILE, ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE


def face(path) -> DiskSurface:
    return disk_surface(editable_surface(read_mesh(path).mesh)[0])


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


def doubled_areas(disk_map_: DiskMap) -> np.ndarray:
    a, b, c = disk_map_.z[disk_map_.surface.mesh.faces].T
    return ((b - a).conj() * (c - a)).imag


def assert_bijective(found: DiskMap) -> None:
    assert (doubled_areas(found) > 0).all()
    rim = found.z[found.surface.boundary]
    np.testing.assert_allclose(np.abs(rim), 1, atol=1e-15)
    turns = np.angle(np.roll(rim, -1) / rim)
    assert (turns > 0).all() and turns.sum() == pytest.approx(2 * np.pi)


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


@pytest.mark.parametrize("path", [ICT_NEUTRAL, ICT_SMILE, ICT_JAW_OPEN])
def test_faces_with_holes_are_mapped_bijectively_and_nearly_conformally(path):
    plain, polished = disk_map(face(path)), disk_map(face(path), polish=True)
    for found in (plain, polished):
        assert_bijective(found)
    assert angle_distortion(polished) < angle_distortion(plain) < 1.6


@pytest.mark.parametrize("path", [HEAD_SMILE, HEAD_MOUTH_OPEN])
@pytest.mark.parametrize("method", ["default", "paper"])
def test_heads_with_pockets_are_mapped_bijectively(path, method):
    assert_bijective(disk_map(face(path), method=method))


def test_the_same_face_lands_in_nearly_the_same_frame_whatever_its_expression():
    neutral, smile = disk_map(face(ICT_NEUTRAL)), disk_map(face(ICT_SMILE))
    count = min((neutral.surface.vertex >= 0).sum(), (smile.surface.vertex >= 0).sum())
    assert np.abs(neutral.z[:count] - smile.z[:count]).mean() < 0.02


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
    np.testing.assert_allclose(disk_map(whole(moved), method=method).z, z, atol=1e-9)
    label = rng.permutation(len(z))
    faces = np.roll(label[mesh.faces], 1, axis=1)[rng.permutation(len(mesh.faces))]
    vertices = np.empty_like(mesh.vertices)
    vertices[label] = mesh.vertices
    relabelled = disk_map(whole(Mesh(vertices, faces)), method=method).z
    np.testing.assert_allclose(relabelled[label], z, atol=1e-9)


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


def test_a_surface_that_cannot_be_laid_out_names_its_faces():
    disk = whole(hill(4))
    backwards = DiskSurface(disk.mesh, disk.boundary[::-1], disk.vertex, disk.face)
    with pytest.raises(ParameterizationError) as caught:
        disk_map(backwards, method="paper")
    assert caught.value.code == "not_a_disk"
    outermost = np.flatnonzero((np.isin(disk.mesh.faces, disk.boundary)).sum(axis=1) > 1)
    assert caught.value.elements["faces"] == outermost.tolist()


def test_a_surface_without_area_is_refused():
    mesh = hill(4)
    with pytest.raises(ParameterizationError) as caught:
        disk_map(whole(mesh.moved(np.zeros_like(mesh.vertices))))
    assert caught.value.code == "no_area"
