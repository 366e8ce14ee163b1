"""A generated eye: a sheet with a pocket whose lids close by a known displacement."""

import numpy as np
import pytest

from engine.correspondence import correspond
from engine.correspondence._cavities import find_cavities
from engine.correspondence._curves import ClosedCurve
from engine.correspondence._frame import Frame
from engine.correspondence._lids import across_parameters
from engine.correspondence._ridges import sharpness, up_to_ridge
from engine.types import BoolArray, FloatArray, IntArray, Mesh, Registration, Similarity
from engine.visibility import ambient_visibility
from tests.engine.remeshed import relabelled, subdivided, surface_of
from tests.engine.shapes import grid_faces

ALIGNED = Registration(
    Similarity(np.eye(3), np.zeros(3)), np.zeros(1), 1.0, iterations=0, converged=True
)
AROUND = 40
OUTSIDE = np.geomspace(6, 1, 20)  # of the lids' edge, the last ring
INSIDE = (
    *((1.1, -0.15), (1.5, -0.35), (1.8, -0.8), (1.8, -1.4)),
    *((1.5, -2.0), (1.0, -2.4), (0.6, -2.6), (0.3, -2.65)),
)
EDGE = len(OUTSIDE) - 1
HEIGHT = 0.6  # of the opening's half width


def eye() -> Mesh:
    """Rings around an almond, from the border of a bent sheet to the back of a socket."""
    scale = np.append(OUTSIDE, [s for s, _ in INSIDE])
    depth = np.append(-0.03 * OUTSIDE**2, [z for _, z in INSIDE])
    angle = np.arange(AROUND) / AROUND * 2 * np.pi
    x, y = np.outer(scale, np.cos(angle)), np.outer(scale, HEIGHT * np.sin(angle))
    rings = np.stack((x, y, np.broadcast_to(depth[:, None], x.shape)), axis=2).reshape(-1, 3)
    last = (len(scale) - 1) * AROUND + np.arange(AROUND)
    back = np.stack((last, np.roll(last, -1), np.full(AROUND, len(rings))), axis=1)
    faces = np.vstack((grid_faces(len(scale), AROUND, (False, True)), back))
    mesh = Mesh(np.vstack((rings, [[0.0, 0.0, -2.7]])), faces)
    normal = np.cross(*(mesh.vertices[faces[0, 1:]] - mesh.vertices[faces[0, 0]]))
    return mesh if normal[2] > 0 else Mesh(mesh.vertices, faces[:, ::-1].copy())


def rings(mesh: Mesh) -> IntArray:
    """The number (n,) of the ring that each vertex is on."""
    return np.arange(len(mesh.vertices)) // AROUND


def closed(mesh: Mesh, share: float) -> FloatArray:
    """Positions (n, 3) when lids have gone a ``share`` of the way to a line below the middle."""
    fade = np.zeros(int(rings(mesh).max()) + 1)
    fade[: EDGE + 1] = np.clip(1 - (OUTSIDE - 1) / 0.7, 0, 1) ** 2
    fade[EDGE + 1] = 0.7
    x, y, _ = mesh.vertices.T
    line = -0.5 * HEIGHT * np.sqrt(np.maximum(1 - x**2, 0))
    moved = mesh.vertices.copy()
    moved[:, 1] += share * fade[rings(mesh)] * (line - y)
    return moved


def pocket(mesh: Mesh) -> BoolArray:
    return find_cavities(mesh, ambient_visibility(mesh))[0]


def test_a_pocket_is_cut_at_the_edge_of_its_lids() -> None:
    mesh = eye()
    mesh = mesh.moved(Frame.of(mesh)(mesh.vertices))
    sharp = sharpness(mesh)
    ring = rings(mesh)
    assert sharp[ring == EDGE].min() > 0.5
    assert sharp[ring < EDGE - 3].max() < 0.2
    behind = (ring[mesh.faces] >= EDGE).all(axis=1)
    cavity = pocket(mesh)
    assert cavity.sum() < behind.sum()
    np.testing.assert_array_equal(up_to_ridge(mesh, cavity, sharp), behind)


def test_lids_close_across_the_eye() -> None:
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False) + 0.3
    x, y, none = np.cos(angle), np.sin(angle), 0 * angle
    goal = ClosedCurve(np.stack((x, -0.3 * (1 - x**2) + 0.02 * y, none), axis=1))
    edge = ClosedCurve(np.roll(np.stack((x, 0.6 * y, none), axis=1), 17, axis=0))
    there = goal.at(across_parameters(edge, goal))
    np.testing.assert_allclose(there[:, 0], edge.points[:, 0], atol=0.02)
    upper = np.abs(edge.points[:, 1]) > 0.2
    middle = there[:, 1] + 0.3 * (1 - there[:, 0] ** 2)
    np.testing.assert_array_equal(np.sign(middle)[upper], np.sign(edge.points[:, 1])[upper])


@pytest.mark.parametrize("share", [0.6, 0.95])
def test_lids_that_close_are_followed(share: float) -> None:
    source = eye()
    truth = closed(source, share)
    target = relabelled(subdivided(source.moved(truth)))[0]
    found = correspond(surface_of(source), surface_of(target), ALIGNED)
    assert "1 of them lids that close" in found.mode
    error = np.linalg.norm(found.points.on(target) - truth, axis=1)
    moved = np.linalg.norm(source.vertices - truth, axis=1)
    edge = rings(source) == EDGE
    assert error[edge].mean() < 0.25 * moved[edge].mean()
    assert error.mean() < 0.55 * moved.mean()


def test_an_opening_that_stays_open_is_no_lid_that_closes() -> None:
    source = eye()
    target = relabelled(subdivided(source))[0]
    found = correspond(surface_of(source), surface_of(target), ALIGNED)
    assert "cavities cut: 1 of the source, 1 of the target" in found.mode
    assert "lids" not in found.mode
