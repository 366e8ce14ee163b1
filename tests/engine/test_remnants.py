"""Corners of a mouth that a face was cut through."""

import numpy as np
import pytest

from engine.correspondence import correspond
from engine.correspondence._curves import ClosedCurve
from engine.correspondence._remnants import corners_on_border
from engine.operators import face_areas
from engine.registration import register
from engine.types import FloatArray, IntArray, Mesh
from tests.engine.remeshed import coarser, face, part_of, relabelled, subdivided, surface_of
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL


def opened(amount: float) -> Mesh:
    """The bundled face with its jaw opened by ``amount`` of the expression."""
    rest, wide = face(ICT_NEUTRAL), face(ICT_JAW_OPEN)
    return rest.moved(rest.vertices + amount * (wide.vertices - rest.vertices))


@pytest.fixture(scope="module")
def neutral() -> tuple[Mesh, IntArray]:
    return coarser(face(ICT_NEUTRAL), 2200)


def mouth_of(mesh: Mesh) -> IntArray:
    inner = surface_of(mesh).loops[1:]
    return min(inner, key=lambda loop: float(mesh.vertices[loop, 1].mean()))


def in_units(mesh: Mesh, unit: float) -> Mesh:
    return mesh.moved(mesh.vertices / unit)


def test_the_corner_of_a_cut_mouth_is_found_where_it_went(neutral: tuple[Mesh, IntArray]) -> None:
    source, kept = neutral
    unit = float(np.sqrt(face_areas(source).sum()))
    wide = opened(1.0).vertices[kept]
    mouth = mouth_of(source)
    left = source.vertices[:, 0] < np.median(source.vertices[:, 0])
    part, _ = coarser(opened(1.0), 3500)
    target = in_units(part_of(part, part.vertices[:, 0] < np.median(source.vertices[:, 0])), unit)
    border = surface_of(target).loops[0]
    (pair,) = corners_on_border(
        in_units(source, unit), [mouth], left.astype(np.float64), target, border
    )
    assert pair.parameters is not None
    goals = ClosedCurve(target.vertices[border]).at(pair.parameters)
    corner = mouth[wide[mouth, 0].argmin()]
    place = np.flatnonzero(pair.vertices == corner)
    assert len(place) == 1
    moved = np.linalg.norm(wide[corner] - source.vertices[corner]) / unit
    assert np.linalg.norm(goals[place] - wide[corner] / unit) < 0.5 * moved


def test_corners_beyond_the_border_and_straight_cuts_are_none(
    neutral: tuple[Mesh, IntArray],
) -> None:
    source, _ = neutral
    unit = float(np.sqrt(face_areas(source).sum()))
    mouth, rest = mouth_of(source), in_units(source, unit)
    half = part_of(rest, rest.vertices[:, 0] < 0)
    outside, within = np.zeros(len(rest.vertices)), np.ones(len(rest.vertices))
    assert not corners_on_border(rest, [mouth], outside, half, surface_of(half).loops[0])
    assert not corners_on_border(rest, [mouth[:5]], within, half, surface_of(half).loops[0])
    brow = part_of(rest, rest.vertices[:, 1] > rest.vertices[mouth, 1].max() + 0.02)
    assert not corners_on_border(rest, [mouth], within, brow, surface_of(brow).loops[0])


@pytest.mark.parametrize(("amount", "turn"), [(1.0, 0.0), (1.0, -0.3), (1.3, 0.0)])
def test_a_chin_follows_what_is_left_of_the_mouth(
    neutral: tuple[Mesh, IntArray], amount: float, turn: float
) -> None:
    source, kept = neutral
    wide = opened(amount)
    whole = relabelled(subdivided(coarser(wide, 3500)[0]))[0]
    side: FloatArray = np.array([np.cos(turn), np.sin(turn), 0.0])
    truth = wide.vertices[kept]
    middle = float(np.median(truth @ side))
    shown = truth @ side < middle
    target = part_of(whole, whole.vertices @ side < middle)
    found = correspond(surface_of(source), surface_of(target), register(source, target))
    off = np.linalg.norm(found.points.on(target) - truth, axis=1)[shown]
    still = np.linalg.norm(source.vertices - truth, axis=1)[shown]
    assert "corners of holes on its border" in found.mode
    assert off.mean() < 0.4 * still.mean()
