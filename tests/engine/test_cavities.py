import numpy as np
import pytest

from engine.correspondence import correspond
from engine.correspondence._cavities import find_cavities
from engine.correspondence._cutting import part_without
from engine.correspondence._fitting import Target
from engine.correspondence._frame import Frame
from engine.correspondence._static import Nearby, calm_share
from engine.io import read_mesh
from engine.operators import face_areas
from engine.topology import boundary_loops, editable_surface
from engine.types import FloatArray, Mesh, Registration, Similarity, Surface
from engine.visibility import ambient_visibility
from tests.engine.remeshed import coarser, part_of, relabelled, subdivided, surface_of
from tests.engine.shapes import sphere
from tests.faces import HEAD_MOUTH_OPEN, HEAD_NEUTRAL

ALIGNED = Registration(
    Similarity(np.eye(3), np.zeros(3)), np.zeros(1), 1.0, iterations=0, converged=True
)


@pytest.fixture(scope="module")
def neutral() -> Surface:
    return editable_surface(read_mesh(HEAD_NEUTRAL).mesh)[0]


@pytest.fixture(scope="module")
def mouth_open() -> Surface:
    return editable_surface(read_mesh(HEAD_MOUTH_OPEN).mesh)[0]


def cavities_of(surface: Surface) -> tuple[Mesh, list[FloatArray]]:
    """The surface's mesh, and the centres of its cavities."""
    mesh = surface.mesh
    found = find_cavities(mesh, ambient_visibility(mesh))
    areas = face_areas(mesh)
    return mesh, [
        np.average(mesh.vertices[mesh.faces[c]].mean(axis=1), axis=0, weights=areas[c])
        for c in found
    ]


@pytest.mark.parametrize("which", ["neutral", "mouth_open"])
def test_a_head_has_a_mouth_and_two_eyes(which: str, request: pytest.FixtureRequest) -> None:
    mesh, centres = cavities_of(request.getfixturevalue(which))
    assert len(centres) == 3
    mouth, *eyes = centres
    width = np.ptp(mesh.vertices[:, 0])
    assert abs(mouth[0]) < 0.02 * width
    assert all(eye[1] > mouth[1] + 0.2 * width for eye in eyes)
    assert abs(eyes[0][0] + eyes[1][0]) < 0.02 * width


def test_the_same_skin_is_the_inside_of_a_closed_and_of_an_open_mouth(
    neutral: Surface, mouth_open: Surface
) -> None:
    closed, wide = (
        find_cavities(s.mesh, ambient_visibility(s.mesh))[0] for s in (neutral, mouth_open)
    )
    areas = face_areas(neutral.mesh)
    assert areas[closed & wide].sum() > 0.95 * areas[closed | wide].sum()


def test_a_ball_has_no_cavity() -> None:
    ball = sphere(3)
    assert find_cavities(ball, ambient_visibility(ball)) == ()


def test_a_part_has_the_rim_of_what_was_cut(neutral: Surface) -> None:
    mesh = neutral.mesh
    mouth = find_cavities(mesh, ambient_visibility(mesh))[0]
    part = part_without(mesh, mouth, neutral.loops)
    assert len(part.loops) == 2
    assert len(boundary_loops(part.mesh.faces, len(part.mesh.vertices))) == 2
    rest = face_areas(mesh)[~mouth].sum()
    assert 0.98 * rest < face_areas(part.mesh).sum() < 1.001 * rest
    whole = part_without(mesh, np.zeros(len(mesh.faces), dtype=np.bool_), neutral.loops)
    assert whole.mesh is mesh


def test_an_opening_mouth_is_followed_inside_and_outside(
    neutral: Surface, mouth_open: Surface
) -> None:
    source, kept = coarser(neutral.mesh, 3000)
    target = relabelled(subdivided(coarser(mouth_open.mesh, 3500)[0]))[0]
    found = correspond(surface_of(source), surface_of(target), ALIGNED)
    truth = mouth_open.mesh.vertices[kept]
    error = np.linalg.norm(found.points.on(target) - truth, axis=1)
    moved = np.linalg.norm(source.vertices - truth, axis=1)
    assert "cavities cut: 3 of the source, 3 of the target" in found.mode
    assert "and 1 inner loops paired" in found.mode  # the lids rest
    assert error.mean() < 0.4 * moved.mean()
    inside = np.unique(source.faces[find_cavities(source, ambient_visibility(source))[0]])
    assert error[inside].mean() < 0.5 * moved[inside].mean()


@pytest.mark.parametrize("angle", [15, 40, 130])
def test_a_mouth_that_a_part_was_cut_through_is_no_skin(
    neutral: Surface, mouth_open: Surface, angle: float
) -> None:
    source, kept = coarser(neutral.mesh, 3000)
    truth = mouth_open.mesh.vertices[kept]
    side = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle)), 0.0])
    middle = np.median(truth @ side)
    dense = subdivided(coarser(mouth_open.mesh, 3500)[0])
    half = part_of(dense, dense.vertices @ side < middle)
    found = correspond(surface_of(source), surface_of(half), ALIGNED)
    there = truth @ side < middle
    there[source.faces[find_cavities(source, ambient_visibility(source))[0]]] = False
    error = np.linalg.norm(found.points.on(half) - truth, axis=1)
    moved = np.linalg.norm(source.vertices - truth, axis=1)
    assert error[there].mean() < 0.4 * moved[there].mean()


def test_sockets_are_calm_while_a_mouth_opens_and_a_closed_mouth_is(
    neutral: Surface, mouth_open: Surface
) -> None:
    source, kept = coarser(neutral.mesh, 3000)
    frame = Frame.of(source)
    mouth, *sockets = (
        np.isin(np.arange(len(source.vertices)), source.faces[c])
        for c in find_cavities(source, ambient_visibility(source))
    )
    inside, unit = mouth | sockets[0] | sockets[1], source.moved(frame(source.vertices))
    opened = source.moved(frame(mouth_open.mesh.vertices[kept]))
    calm = calm_share(unit, inside, Nearby.of(unit, Target(subdivided(opened))))
    assert not calm[mouth].any()
    assert all(calm[socket].mean() > 0.8 for socket in sockets)
    calm = calm_share(unit, inside, Nearby.of(unit, Target(subdivided(unit))))
    assert calm[inside].min() > 0.99
    assert not calm[~inside].any()


def test_lids_that_close_leave_their_sockets(neutral: Surface) -> None:
    source, _ = coarser(neutral.mesh, 3000)
    _, *sockets = find_cavities(source, ambient_visibility(source))
    inside = np.unique(source.faces[sockets[0] | sockets[1]])
    truth = source.vertices.copy()
    for socket in sockets:
        centre = source.vertices[source.faces[socket]].mean(axis=(0, 1))
        offset = source.vertices - centre
        size = np.ptp(source.vertices[source.faces[socket].ravel()], axis=0)
        near = np.exp(-((offset[:, :2] / (0.6 * size[:2])) ** 2).sum(axis=1))
        near *= offset[:, 2] > 0.3 * size[2]
        near[np.unique(source.faces[socket])] = 0
        truth[:, 1] -= 0.3 * near * size[1]
    target = relabelled(subdivided(source.moved(truth)))[0]
    found = correspond(surface_of(source), surface_of(target), ALIGNED)
    error = np.linalg.norm(found.points.on(target) - truth, axis=1)
    moved = np.linalg.norm(source.vertices - truth, axis=1)
    assert error[inside].mean() < 0.11 * moved.max()


def test_a_patch_without_cavities_finds_itself_on_a_whole_head(neutral: Surface) -> None:
    mesh = coarser(neutral.mesh, 3000)[0]
    inside = np.zeros(len(mesh.vertices), dtype=np.bool_)
    for cavity in find_cavities(mesh, ambient_visibility(mesh)):
        inside[mesh.faces[cavity]] = True
    front = mesh.vertices[:, 2] > np.quantile(mesh.vertices[:, 2], 0.4)
    patch = part_of(mesh, front & ~inside)
    head, _ = relabelled(subdivided(mesh))
    found = correspond(surface_of(patch), surface_of(head), ALIGNED)
    size = np.linalg.norm(np.ptp(patch.vertices, axis=0))
    error = np.linalg.norm(found.points.on(head) - patch.vertices, axis=1)
    assert "cavities cut: 0 of the source, 3 of the target" in found.mode
    assert error.mean() < 0.005 * size
