"""Correspondences whose answer is known, from generated faces to somebody else's."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from engine.correspondence import correspond
from engine.io import read_mesh
from engine.registration import register
from engine.topology import editable_surface
from engine.types import FloatArray, Mesh
from tests.engine.generated import generated_face, jaw_open, smile
from tests.engine.remeshed import coarser, face, relabelled, surface_of
from tests.faces import HEAD_NEUTRAL, ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE


@pytest.mark.parametrize("holes", [True, False])
@pytest.mark.parametrize(("expression", "most"), [(smile, 0.7), (jaw_open, 0.45)])
def test_blendshapes_of_generated_faces_are_followed(
    expression: Callable[[Mesh], FloatArray], most: float, holes: bool
) -> None:
    rest = generated_face(holes=holes)
    wide = rest.moved(expression(rest))
    source, kept = coarser(rest, 5000)
    target = relabelled(coarser(wide, 6000)[0])[0]
    pose = register(source, target)
    truth = wide.vertices[kept]
    still = np.linalg.norm(source.vertices - truth, axis=1).mean()
    found, closest = (
        correspond(surface_of(source), surface_of(target), pose, method=method)
        for method in ("default", "paper")
    )
    off = [np.linalg.norm(one.points.on(target) - truth, axis=1).mean() for one in (found, closest)]
    assert f"{3 if holes else 0} inner loops paired" in found.mode
    assert off[0] < most * still
    assert off[1] > 0.8 * still


@pytest.mark.parametrize("expression", [ICT_NEUTRAL, ICT_SMILE])
def test_left_stays_left_on_a_mirrored_face(expression: Path) -> None:
    source, _ = coarser(face(ICT_NEUTRAL), 3000)
    mesh = coarser(face(expression), 4000)[0]
    mirrored = Mesh(mesh.vertices * [-1.0, 1.0, 1.0], mesh.faces[:, ::-1])
    found = correspond(surface_of(source), surface_of(mirrored), register(source, mirrored))
    x, there = source.vertices[:, 0], found.points.on(mirrored)[:, 0]
    beside = np.abs(x) > 0.05 * np.ptp(x)
    assert (np.sign(x) == np.sign(there))[beside].all()


def test_of_somebody_else_less_is_believed() -> None:
    source, _ = coarser(face(ICT_NEUTRAL), 3000)
    own = surface_of(coarser(face(ICT_JAW_OPEN), 5000)[0])
    other = editable_surface(read_mesh(HEAD_NEUTRAL).mesh)[0]
    same, else_ = (
        correspond(surface_of(source), target, register(source, target.mesh)).confidence
        for target in (own, other)
    )
    assert same.mean() > 0.98
    assert else_.mean() < 0.95
    assert np.quantile(else_, 0.1) < 0.95 < np.quantile(same, 0.1)
