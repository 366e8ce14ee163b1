from pathlib import Path

import numpy as np
import pytest

from engine.io import read_mesh
from engine.passengers import attach, carry
from engine.passengers._soft import follow
from engine.topology import editable_surface
from engine.types import FloatArray, IntArray, Mesh, Surface
from tests.engine.shapes import grid_faces, soup, sphere, together
from tests.faces import HEAD_MOUTH_OPEN, HEAD_NEUTRAL, HEAD_SMILE, ICT_JAW_OPEN, ICT_NEUTRAL


@pytest.fixture(scope="module")
def head() -> Mesh:
    return read_mesh(HEAD_NEUTRAL).mesh


@pytest.fixture(scope="module")
def skin(head: Mesh) -> Surface:
    return editable_surface(head)[0]


def on_surface(surface: Surface, vertices: FloatArray) -> FloatArray:
    """The positions that file ``vertices`` give the surface."""
    moved = surface.mesh.vertices.copy()
    known = np.flatnonzero(surface.vertex_of >= 0)
    moved[surface.vertex_of[known]] = vertices[known]
    return moved


def rotation_about(axis: int, angle: float) -> FloatArray:
    turn = np.roll(np.arange(3), axis)
    matrix = np.eye(3)
    c, s = np.cos(angle), np.sin(angle)
    matrix[np.ix_(turn[1:], turn[1:])] = [[c, -s], [s, c]]
    return matrix


def riders(surface: Surface) -> IntArray:
    return np.flatnonzero(surface.vertex_of < 0)


def shape_change(before: FloatArray, after: FloatArray, body: IntArray) -> float:
    """Largest relative change of the distances within a body."""
    change = 0.0
    for b in np.unique(body[body >= 0]):
        members = np.flatnonzero(body == b)
        other = np.roll(members, len(members) // 2)
        old = np.linalg.norm(before[members] - before[other], axis=1)
        new = np.linalg.norm(after[members] - after[other], axis=1)
        change = max(change, float(np.abs(new - old).max() / old.max()))
    return change


def test_nothing_moves_bit_for_bit(head: Mesh, skin: Surface) -> None:
    same = carry(attach(head, skin), skin.mesh.vertices, skin.mesh.vertices.copy())
    assert np.array_equal(same, head.vertices)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_a_rigid_motion_moves_everything_with_it(head: Mesh, scale: float) -> None:
    mesh = Mesh(head.vertices * scale, head.faces)
    surface, _ = editable_surface(mesh)
    turn, shift = rotation_about(2, 0.7) @ rotation_about(0, 2.5), np.array([3, -1, 2]) * scale
    moved = carry(
        attach(mesh, surface), surface.mesh.vertices, surface.mesh.vertices @ turn + shift
    )
    assert np.abs(moved - (mesh.vertices @ turn + shift)).max() <= 1e-10 * scale


def test_surface_vertices_take_their_positions_and_others_stay_exact(
    head: Mesh, skin: Surface
) -> None:
    chin = skin.mesh.vertices[:, 1] < np.quantile(skin.mesh.vertices[:, 1], 0.01)
    after = skin.mesh.vertices + chin[:, None] * [0, -0.01, 0.0]
    moved = carry(attach(head, skin), skin.mesh.vertices, after)
    known = np.flatnonzero(skin.vertex_of >= 0)
    assert np.array_equal(moved[known], after[skin.vertex_of[known]])
    assert np.array_equal(moved[riders(skin)], head.vertices[riders(skin)])


def test_bodies_keep_their_shape(head: Mesh, skin: Surface) -> None:
    passengers = attach(head, skin)
    assert passengers.body.max() + 1 == 5
    opened = on_surface(skin, read_mesh(HEAD_MOUTH_OPEN).mesh.vertices)
    moved = carry(passengers, skin.mesh.vertices, opened)
    assert shape_change(head.vertices, moved, passengers.body) <= 1e-12


@pytest.mark.parametrize("expression", [HEAD_SMILE, HEAD_MOUTH_OPEN])
def test_eyes_stay_in_their_sockets(head: Mesh, skin: Surface, expression: Path) -> None:
    truth = read_mesh(expression).mesh.vertices
    moved = carry(attach(head, skin), skin.mesh.vertices, on_surface(skin, truth))
    skin_moved = np.linalg.norm(truth - head.vertices, axis=1)[skin.vertex_of >= 0].max()
    eyes = [v for v in riders(skin) if head.vertices[v, 1] > skin.mesh.vertices[:, 1].mean()]
    assert len(eyes) > 50
    assert np.linalg.norm(moved - truth, axis=1)[eyes].max() < 0.05 * skin_moved


def test_seams_of_a_body_do_not_take_it_apart() -> None:
    face = read_mesh(ICT_NEUTRAL).mesh
    centre = face.vertices.mean(axis=0)
    ball = sphere(2)
    mesh = together(face, soup(Mesh(ball.vertices + centre, ball.faces)))
    surface, _ = editable_surface(mesh)
    passengers = attach(mesh, surface)
    assert passengers.body.max() == 0
    opened = on_surface(
        surface,
        np.concatenate(
            [read_mesh(ICT_JAW_OPEN).mesh.vertices, mesh.vertices[len(face.vertices) :]]
        ),
    )
    moved = carry(passengers, surface.mesh.vertices, opened)
    assert shape_change(mesh.vertices, moved, passengers.body) <= 1e-12


def test_debris_and_unused_vertices_ride_along() -> None:
    face = read_mesh(ICT_NEUTRAL).mesh
    crumb = Mesh(face.vertices[face.faces[100]] + 0.05, np.array([[0, 1, 2]]))
    point = Mesh(face.vertices[[2000]] + 0.01, np.zeros((0, 3), dtype=np.int64))
    mesh = together(face, crumb, point)
    surface, _ = editable_surface(mesh)
    after = read_mesh(ICT_JAW_OPEN).mesh.vertices
    moved = carry(attach(mesh, surface), surface.mesh.vertices, after)
    step = after[face.faces[100]] - face.vertices[face.faces[100]]
    assert np.abs(moved[-4:-1] - mesh.vertices[-4:-1] - step).max() < 0.5
    assert np.allclose(moved[-1] - mesh.vertices[-1], (after - face.vertices)[2000], atol=1e-12)


def test_small_changes_of_the_skin_make_small_changes(head: Mesh, skin: Surface) -> None:
    passengers, rest = attach(head, skin), skin.mesh.vertices
    opened = on_surface(skin, read_mesh(HEAD_MOUTH_OPEN).mesh.vertices)
    amounts = np.linspace(0, 1, 41)
    frames = np.stack([carry(passengers, rest, rest + a * (opened - rest)) for a in amounts])
    steps = np.linalg.norm(np.diff(frames, axis=0), axis=2).max(axis=1)
    whole = np.linalg.norm(opened - rest, axis=1).max()
    assert steps.max() < 3 * whole / 40


def carried_mouth(head: Mesh, skin: Surface) -> tuple[FloatArray, FloatArray]:
    """All vertices with the skin's mouth open, and where they truly are."""
    truth = read_mesh(HEAD_MOUTH_OPEN).mesh.vertices
    made = carry(attach(head, skin), skin.mesh.vertices, on_surface(skin, truth))
    return made, truth


def test_lower_teeth_go_with_the_jaw_and_upper_ones_stay(head: Mesh, skin: Surface) -> None:
    made, truth = carried_mouth(head, skin)
    passengers = attach(head, skin)
    moved = np.linalg.norm(truth - head.vertices, axis=1)
    error = np.linalg.norm(made - truth, axis=1)
    of_body = [passengers.body == number for number in range(passengers.body.max() + 1)]
    lower = max(of_body, key=lambda mine: moved[mine].mean())
    assert moved[lower].mean() > 2.0
    assert error[lower].mean() < 0.35 * moved[lower].mean()
    upper = max(of_body, key=lambda mine: (moved[mine].mean() < 1e-6) * np.sum(mine) - 1)
    assert error[upper].mean() < 0.05


def box(centre: tuple[float, float, float], size: tuple[float, float, float]) -> Mesh:
    """A closed box of 8 vertices."""
    corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return Mesh(corner * np.array(size) / 2 + centre, np.array(faces))


def joined(*parts: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)]),
    )


def test_teeth_of_one_row_move_as_one_and_rows_apart() -> None:
    tooth = (0.3, 1.0, 0.3)
    rows = [box((0.32 * k, y, 0.5), tooth) for y in (0.52, -0.52) for k in range(4)]
    side = np.linspace(-3.0, 3.0, 25)
    x, y = (values.ravel() for values in np.meshgrid(side, side))
    quad = np.arange(24 * 25).reshape(24, 25)[:, :24].ravel()
    sheet = Mesh(
        np.stack([x, y, 0 * x], axis=1),
        np.concatenate(
            [np.stack([quad, quad + 1, quad + 26], 1), np.stack([quad, quad + 26, quad + 25], 1)]
        ),
    )
    whole = joined(sheet, *rows)
    count = len(sheet.vertices)
    on = np.where(np.arange(len(whole.vertices)) < count, np.arange(len(whole.vertices)), -1)
    skin = Surface(sheet, on, np.arange(len(sheet.faces)), ())
    body = attach(whole, skin).body[count:].reshape(2, 4, 8)
    assert [len(np.unique(row)) for row in body] == [1, 1]
    assert body[0, 0, 0] != body[1, 0, 0]


def test_a_sheet_bends_between_what_it_is_attached_to() -> None:
    count = 21
    x = np.linspace(0.0, 1.0, count)
    strip = Mesh(
        np.concatenate([np.stack([x, 0 * x + y, 0 * x + 0.5], axis=1) for y in (0.5, 0.45)]),
        np.concatenate(
            [[(k, k + 1, k + count), (k + 1, k + count + 1, k + count)] for k in range(count - 1)]
        ),
    )
    skins = joined(
        box((-0.5, 0.0, 0.0), (1.0, 1.0, 1.0)),
        box((1.5, 0.0, 0.0), (1.0, 1.0, 1.0)),
    )
    whole = joined(skins, strip)
    on = np.where(np.arange(len(whole.vertices)) < 16, np.arange(len(whole.vertices)), -1)
    skin = Surface(skins, on, np.arange(len(skins.faces)), ())
    after = skins.vertices.copy()
    after[8:] += (0.0, 0.3, 0.0)
    rigid = carry(attach(whole, skin, rigid=True), skins.vertices, after)
    stiff = attach(whole, skin, rigid=True).body
    assert shape_change(whole.vertices, rigid, stiff) < 1e-9
    rise = (carry(attach(whole, skin), skins.vertices, after) - whole.vertices)[16:, 1]
    rows = rise.reshape(2, count)
    assert rows[0, 0] < 0.03
    assert rows[0, -1] > 0.27
    assert (np.diff(rows[0]) >= 0).all()
    assert np.abs(np.diff(rows[0])).max() < 0.1


def test_a_sheet_that_is_sewn_to_a_lid_leaves_the_eye_behind() -> None:
    lids = joined(
        box((0.0, 1.0, 0.0), (2.0, 1.0, 1.0)),
        box((0.0, -1.0, 0.0), (2.0, 1.0, 1.0)),
        box((0.0, 0.0, -2.0), (2.0, 3.0, 1.0)),
    )
    eye = box((0.0, 0.2, 0.0), (0.5, 0.5, 0.98))
    x = np.linspace(-1.0, 1.0, 9)
    rows = [np.stack([x, 0 * x + y, 0 * x + 0.5], axis=1) for y in (0.5, 0.47, 0.44)]
    lash = Mesh(np.concatenate(rows), grid_faces(3, 9))
    whole = joined(lids, eye, lash)
    on = np.where(np.arange(len(whole.vertices)) < 24, np.arange(len(whole.vertices)), -1)
    skin = Surface(lids, on, np.arange(len(lids.faces)), ())
    soft = attach(whole, skin).soft
    assert soft is not None
    still, fall = np.zeros((27, 3)), np.tile([0.0, -0.4, 0.0], (27, 1))
    assert np.allclose(follow(soft, by_body=still, by_skin=fall), fall, atol=1e-6)
