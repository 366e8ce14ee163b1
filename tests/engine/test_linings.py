"""The backs of lips and lids of a patch whose mouth and eyes are holes."""

import numpy as np
import pytest

from engine.correspondence import correspond
from engine.correspondence._cavities import find_cavities, find_linings
from engine.correspondence._completed import completed_visibility
from engine.correspondence._frame import Frame
from engine.io import read_mesh
from engine.operators import face_areas
from engine.topology import editable_surface
from engine.types import BoolArray, IntArray, Mesh, Registration, Similarity
from engine.visibility import ambient_visibility
from tests.engine.remeshed import coarser, subdivided, surface_of
from tests.engine.shapes import sphere
from tests.faces import HEAD_MOUTH_OPEN, HEAD_NEUTRAL

ALIGNED = Registration(
    Similarity(np.eye(3), np.zeros(3)), np.zeros(1), 1.0, iterations=0, converged=True
)
RINGS = 3  # of a cavity's faces that a patch keeps behind its edge


@pytest.fixture(scope="module")
def head() -> Mesh:
    return editable_surface(read_mesh(HEAD_NEUTRAL).mesh)[0].mesh


@pytest.fixture(scope="module")
def patch(head: Mesh) -> tuple[Mesh, IntArray, BoolArray]:
    """A face in front of a head whose cavities end behind their edges.

    Its mesh, the head's vertex for each of its own, and its faces behind those edges.
    """
    inside = np.zeros(len(head.faces), dtype=np.bool_)
    for cavity in find_cavities(head, ambient_visibility(head)):
        inside |= cavity
    kept = ~inside
    for _ in range(RINGS):
        touched = np.zeros(len(head.vertices), dtype=np.bool_)
        touched[head.faces[kept]] = True
        kept |= touched[head.faces].any(axis=1)
    z = head.vertices[:, 2]
    kept &= (z > np.median(z))[head.faces].all(axis=1)
    vertex, flat = np.unique(head.faces[kept], return_inverse=True)
    mesh = Mesh(head.vertices[vertex], flat.reshape(-1, 3))
    return mesh, vertex, inside[kept]


def in_frame(mesh: Mesh, of: Mesh) -> Mesh:
    frame = Frame.of(of)
    return mesh.moved(frame(mesh.vertices))


def test_what_lies_behind_the_edges_of_holes_is_lining(
    head: Mesh, patch: tuple[Mesh, IntArray, BoolArray]
) -> None:
    mesh, _, behind = patch
    holes = surface_of(mesh).loops[1:]
    front = in_frame(mesh, mesh)
    seen = completed_visibility(in_frame(head, mesh), front, ambient_visibility(front))
    found = find_linings(front, holes, seen)
    areas = face_areas(front)
    assert areas[found & behind].sum() > 0.7 * areas[behind].sum()
    assert areas[found & behind].sum() > 0.7 * areas[found].sum()
    assert not find_linings(front, (), seen).any()
    assert not find_linings(front, holes, np.zeros(len(front.faces))).any()
    assert not find_linings(sphere(3), (), np.ones(len(sphere(3).faces))).any()


def test_the_backs_of_lips_follow_an_opening_mouth(
    head: Mesh, patch: tuple[Mesh, IntArray, BoolArray]
) -> None:
    mesh, vertex, behind = patch
    wide = editable_surface(read_mesh(HEAD_MOUTH_OPEN).mesh)[0].mesh
    truth = wide.vertices[vertex]
    target = subdivided(coarser(wide, 5000)[0])
    found = correspond(surface_of(mesh), surface_of(target), ALIGNED)
    error = np.linalg.norm(found.points.on(target) - truth, axis=1)
    moved = np.linalg.norm(mesh.vertices - truth, axis=1)
    lining = np.unique(mesh.faces[behind])
    assert "cavities cut: 0 of the source, 3 of the target" in found.mode
    assert error[lining].mean() < 0.4 * moved[lining].mean()
