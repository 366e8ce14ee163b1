"""Coarse sources are divided and rounded before they are compared with a target."""

import numpy as np

from engine.correspondence import correspond
from engine.correspondence._loops import pair_loops
from engine.correspondence._refined import Refined
from engine.operators import face_areas
from engine.registration import register
from engine.topology import boundary_loops
from engine.types import Mesh
from tests.engine.remeshed import coarser, face, relabelled, subdivided, surface_of
from tests.faces import ICT_NEUTRAL, ICT_SMILE


def in_units(mesh: Mesh) -> Mesh:
    return mesh.moved(mesh.vertices / np.sqrt(face_areas(mesh).sum()))


def test_a_coarse_surface_is_divided_with_its_loops_and_values() -> None:
    mesh = in_units(coarser(face(ICT_NEUTRAL), 1000)[0])
    loops = surface_of(mesh).loops
    skin = Refined(mesh, loops).finer()
    assert len(skin.ends) == 2
    assert np.array_equal(skin.mesh.vertices[: len(mesh.vertices)], mesh.vertices)
    true = boundary_loops(skin.mesh.faces, len(skin.mesh.vertices))
    assert {frozenset(loop.tolist()) for loop in skin.loops} == {
        frozenset(loop.tolist()) for loop in true
    }
    assert [len(loop) for loop in skin.loops] == [4 * len(loop) for loop in loops]
    spread = skin.spread(mesh.vertices)
    off = np.linalg.norm(spread - skin.mesh.vertices, axis=1)
    assert 0 < off.max() < 0.02
    pairs = pair_loops(skin.mesh, skin.loops, mesh, loops)
    for pair, loop in zip(skin.undivided(pairs), loops, strict=True):
        assert set(pair.vertices.tolist()) == set(loop.tolist())


def test_a_fine_surface_stays_as_it_is() -> None:
    mesh = in_units(face(ICT_NEUTRAL))
    skin = Refined(mesh, surface_of(mesh).loops)
    assert skin.finer() is skin


def test_a_coarse_source_follows_a_smile() -> None:
    source, kept = coarser(face(ICT_NEUTRAL), 1500)
    target = relabelled(subdivided(face(ICT_SMILE)))[0]
    truth = face(ICT_SMILE).vertices[kept]
    found = correspond(surface_of(source), surface_of(target), register(source, target))
    assert "the source's coarse faces taken as round" in found.mode
    off = np.linalg.norm(found.points.on(target) - truth, axis=1)
    assert off.mean() < 0.5 * np.linalg.norm(source.vertices - truth, axis=1).mean()
