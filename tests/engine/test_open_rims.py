"""Rims of cavities that a part of a head was cut through."""

import numpy as np
import pytest

from engine.correspondence._cavities import find_cavities
from engine.correspondence._corners import lengthened
from engine.correspondence._cutting import Part, part_without
from engine.correspondence._frame import Frame
from engine.correspondence._open_rims import open_rims
from engine.io import read_mesh
from engine.topology import boundary_loops, editable_surface
from engine.types import BoolArray, FloatArray, Mesh
from engine.visibility import ambient_visibility
from tests.engine.remeshed import coarser, part_of
from tests.faces import HEAD_MOUTH_OPEN, HEAD_NEUTRAL


@pytest.fixture(scope="module")
def heads() -> tuple[Mesh, Mesh, BoolArray]:
    """A head at rest and with its mouth open, in one frame, and the faces inside its mouth."""
    rest = editable_surface(read_mesh(HEAD_NEUTRAL).mesh)[0].mesh
    wide = editable_surface(read_mesh(HEAD_MOUTH_OPEN).mesh)[0].mesh
    mesh, kept = coarser(rest, 3000)
    frame = Frame.of(mesh)
    mouth = find_cavities(mesh, ambient_visibility(mesh))[0]
    return mesh.moved(frame(mesh.vertices)), mesh.moved(frame(wide.vertices[kept])), mouth


def without(mesh: Mesh, mouth: BoolArray) -> Part:
    return part_without(mesh, mouth, boundary_loops(mesh.faces, len(mesh.vertices)))


def rim_of(part: Part) -> FloatArray:
    """The loop of a part that the cut has made."""
    (rim,) = (loop for loop in part.loops if part.fresh[loop].all())
    return rim


@pytest.mark.parametrize("degrees", [0, 20, 160, 200])
def test_what_is_left_of_an_open_mouth_s_rim_goes_where_it_went(
    heads: tuple[Mesh, Mesh, BoolArray], degrees: float
) -> None:
    rest, wide, mouth = heads
    ours = without(rest, mouth)
    rim = rim_of(ours)
    side = np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees)), 0.0])
    along = (wide.vertices - wide.vertices[ours.vertex[rim]].mean(axis=0)) @ side
    keep = along < 0
    theirs = without(part_of(wide, keep), mouth[keep[wide.faces].all(axis=1)])
    (pair,) = open_rims(ours.mesh, [rim], theirs.mesh, theirs.loops, theirs.fresh)
    assert pair.parameters is not None
    truth = wide.vertices[ours.vertex[pair.vertices]]
    gap = np.linalg.norm(pair.curve.at(pair.parameters) - truth, axis=1)
    moved = np.linalg.norm(ours.mesh.vertices[pair.vertices] - truth, axis=1)
    left = along[ours.vertex[rim]] < 0
    assert len(pair.vertices) > 0.7 * left.sum()
    assert gap.mean() < 0.25 * moved.mean()


def test_whole_rims_and_borders_without_any_are_not_open(
    heads: tuple[Mesh, Mesh, BoolArray],
) -> None:
    rest, wide, mouth = heads
    ours, theirs = without(rest, mouth), without(wide, mouth)
    rim = rim_of(ours)
    assert not open_rims(ours.mesh, [rim], theirs.mesh, theirs.loops, theirs.fresh)
    none = np.zeros_like(theirs.fresh)
    assert not open_rims(ours.mesh, [rim], theirs.mesh, theirs.loops, none)


@pytest.mark.parametrize("count", [8, 12, 20])
def test_a_piece_with_hardly_a_vertex_of_the_rim_leads_nothing(
    heads: tuple[Mesh, Mesh, BoolArray], count: int
) -> None:
    rest, wide, mouth = heads
    ours, theirs = without(rest, mouth), without(wide, mouth)
    few = rim_of(ours)[::4]
    fresh = np.isin(np.arange(len(theirs.fresh)), rim_of(theirs)[:count])
    pairs = open_rims(ours.mesh, [few], theirs.mesh, theirs.loops, fresh)
    assert all(len(pair.vertices) >= 3 for pair in pairs)
    assert not open_rims(ours.mesh, [few[:4]], theirs.mesh, theirs.loops, fresh)


def test_a_longer_rim_keeps_its_length_but_at_its_corners() -> None:
    at = np.linspace(0.0, 4.0, 41)
    for corners in ([1.0], [1.0, 3.0]):
        moved = lengthened(at, np.array(corners), (4.0, 6.0), power=8.0)
        steps = np.diff(moved) / np.diff(at)
        assert moved[0] == 0
        assert moved[-1] == pytest.approx(6.0)
        assert steps.min() > 0.99
        assert np.isin(np.round(at[steps.argmax() + np.array([0, 1])], 9), corners).any()
        assert steps[[0, -1]] == pytest.approx(1.0, abs=0.01)
    assert lengthened(at, np.zeros(0), (4.0, 6.0), power=8.0) == pytest.approx(1.5 * at)
    shorter = lengthened(at, np.array([1.0]), (4.0, 2.0), power=8.0)
    assert shorter == pytest.approx(0.5 * at)
