"""What a target shows where the source has nothing, and hides where it has something."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from engine.correspondence import correspond
from engine.correspondence._curves import ClosedCurve
from engine.correspondence._shown import is_one_view, own_share
from engine.correspondence._static import remote_share
from engine.operators import face_areas, face_normals
from engine.registration import register
from engine.types import FloatArray, IntArray, Mesh
from tests.engine.remeshed import coarser, face, part_of, relabelled, subdivided, surface_of
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE

UP = np.array([0.0, 0.0, 1.0])


def circle(count: int = 60) -> FloatArray:
    angle = np.arange(count) * 2 * np.pi / count
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


@pytest.fixture(scope="module")
def neutral() -> tuple[Mesh, IntArray]:
    return coarser(face(ICT_NEUTRAL), 2200)


def expression(path: Path) -> Mesh:
    return relabelled(subdivided(coarser(face(path), 3500)[0]))[0]


def test_a_ring_surrounds_what_a_crescent_does_not() -> None:
    ring = circle()
    crescent = np.concatenate([ring[:30], 0.8 * ring[:30][::-1]])
    assert ClosedCurve(ring).winding(UP, np.zeros(3)) == 1
    assert ClosedCurve(ring[::-1]).winding(UP, np.zeros(3)) == -1
    assert ClosedCurve(crescent).winding(UP, np.zeros(3)) == 0
    assert ClosedCurve(ring).winding(UP, np.array([2.0, 0, 0])) == 0


def test_the_area_within_a_curve_is_measured_along_its_normal() -> None:
    count = 60
    area = count / 2 * np.sin(2 * np.pi / count)
    np.testing.assert_allclose(ClosedCurve(circle(count)).vector_area, area * UP, atol=1e-12)


@pytest.mark.parametrize("half", [False, True])
def test_an_opening_jaw_does_not_carry_neck_and_scalp_along(
    neutral: tuple[Mesh, IntArray], half: bool
) -> None:
    source, kept = neutral
    truth, target = face(ICT_JAW_OPEN).vertices[kept], expression(ICT_JAW_OPEN)
    shown = np.ones(len(truth), dtype=np.bool_)
    if half:
        middle = np.median(truth[:, 0])
        shown = truth[:, 0] < middle
        target = part_of(target, target.vertices[:, 0] < middle)
    found = correspond(surface_of(source), surface_of(target), register(source, target))
    unit = np.sqrt(face_areas(source).sum())
    remote = remote_share(source.moved(source.vertices / unit), surface_of(source).loops) > 0.5
    off = np.linalg.norm(found.points.on(target) - truth, axis=1)
    still = np.linalg.norm(source.vertices - truth, axis=1)
    assert off[remote & shown].mean() < still[remote & shown].mean()


def test_skin_is_remote_far_from_holes_and_nowhere_without_them(
    neutral: tuple[Mesh, IntArray],
) -> None:
    surface = surface_of(neutral[0])
    unit = np.sqrt(face_areas(surface.mesh).sum())
    mesh = surface.mesh.moved(surface.mesh.vertices / unit)
    remote = remote_share(mesh, surface.loops)
    assert (remote[np.concatenate(surface.loops[1:])] == 0).all()
    low = mesh.vertices[:, 1] < np.quantile(mesh.vertices[:, 1], 0.02)
    assert remote[low].min() > 0.9
    assert not remote_share(mesh, surface.loops[:1]).any()


@pytest.mark.parametrize("draw", [None, 0, 2])
def test_an_opening_jaw_does_not_draw_the_missing_half_in(
    neutral: tuple[Mesh, IntArray], draw: int | None
) -> None:
    source, kept = neutral
    truth, whole = face(ICT_JAW_OPEN).vertices[kept], expression(ICT_JAW_OPEN)
    if draw is not None:
        tremor = np.random.default_rng(draw).normal(scale=1e-9, size=whole.vertices.shape)
        whole = whole.moved(whole.vertices + tremor)
    middle = np.median(truth[:, 0])
    shown = truth[:, 0] < middle
    target = part_of(whole, whole.vertices[:, 0] < middle)
    found = correspond(surface_of(source), surface_of(target), register(source, target))
    off = np.linalg.norm(found.points.on(target) - truth, axis=1)[shown]
    still = np.linalg.norm(source.vertices - truth, axis=1)[shown]
    assert "partial" in found.mode
    assert "none left so" in found.mode
    assert off.mean() < 0.35 * still.mean()
    assert found.confidence[~shown].mean() < 0.2


def with_eyeballs(mesh: Mesh) -> Mesh:
    """``mesh`` with domes in the holes of its eyes: two rings and a pole each."""
    vertices, faces = list(mesh.vertices), list(mesh.faces)
    for loop in eyes_of(mesh):
        rim = mesh.vertices[loop]
        rings = [loop]
        for part in (0.6, 0.3):
            ring = rim.mean(axis=0) + part * (rim - rim.mean(axis=0))
            ring[:, 2] += 0.1 * (1 - part)
            rings.append(np.arange(len(vertices), len(vertices) + len(loop)))
            vertices.extend(ring)
        pole = len(vertices)
        vertices.append(rim.mean(axis=0) + 0.1 * UP)
        for k in range(len(loop)):
            after = (k + 1) % len(loop)
            for outer, inner in pairwise(rings):
                faces.append(np.array([outer[after], outer[k], inner[k]]))
                faces.append(np.array([outer[after], inner[k], inner[after]]))
            faces.append(np.array([rings[-1][after], rings[-1][k], pole]))
    return Mesh(np.array(vertices), np.array(faces))


def eyes_of(mesh: Mesh) -> list[IntArray]:
    """The two inner loops that lie highest."""
    inner = surface_of(mesh).loops[1:]
    return sorted(inner, key=lambda loop: mesh.vertices[loop, 1].mean())[-2:]


def test_lids_are_not_drawn_over_eyeballs(neutral: tuple[Mesh, IntArray]) -> None:
    source, kept = neutral
    truth, open_eyes = face(ICT_SMILE).vertices[kept], expression(ICT_SMILE)
    target = with_eyeballs(open_eyes)
    rims = np.concatenate(eyes_of(source))
    near = KDTree(source.vertices[rims]).query(source.vertices)[0] < 1.0
    off = {}
    for name, goal in (("holes", open_eyes), ("eyeballs", target)):
        found = correspond(surface_of(source), surface_of(goal), register(source, goal))
        off[name] = np.linalg.norm(found.points.on(goal) - truth, axis=1)[near].mean()
    assert off["eyeballs"] < 2.0 * off["holes"]


def view_of(mesh: Mesh, view: FloatArray) -> Mesh:
    """What a distant camera sees of ``mesh`` along -``view``: what faces it and is not hidden."""
    across = np.linalg.svd(view[None])[2][1:]
    depth = mesh.vertices @ view
    cell = np.unique(np.floor(mesh.vertices @ across.T / 0.5), axis=0, return_inverse=True)[1]
    nearest = np.full(cell.max() + 1, -np.inf)
    np.maximum.at(nearest, cell, depth)
    seen = depth > nearest[cell] - 1.0
    faces = mesh.faces[seen[mesh.faces].all(axis=1) & (face_normals(mesh) @ view > 0.2)]
    used, flat = np.unique(faces, return_inverse=True)
    return Mesh(mesh.vertices[used], flat.reshape(-1, 3))


def test_one_view_is_told_from_a_part(neutral: tuple[Mesh, IntArray]) -> None:
    source = neutral[0]
    for view in ([0.0, 0.0, 1.0], [0.5, -0.2, 0.84]):
        assert is_one_view(view_of(source, np.array(view)))
    assert not is_one_view(source)
    x = source.vertices[:, 0]
    assert not is_one_view(part_of(source, x < np.median(x)))


def test_lids_are_not_drawn_over_eyeballs_that_a_smooth_view_shows(
    neutral: tuple[Mesh, IntArray],
) -> None:
    source, kept = neutral
    truth = face(ICT_SMILE).vertices[kept]
    view = np.array([0.34, 0.0, 0.94])
    target = view_of(with_eyeballs(expression(ICT_SMILE)), view)
    found = correspond(surface_of(source), surface_of(target), register(source, target))
    rims = np.concatenate(eyes_of(source))
    near = KDTree(source.vertices[rims]).query(source.vertices)[0] < 1.5
    near &= KDTree(target.vertices).query(truth)[0] < 0.3
    off = np.linalg.norm(found.points.on(target) - truth, axis=1)[near]
    still = np.linalg.norm(source.vertices - truth, axis=1)[near]
    assert "a sensor's view" in found.mode
    assert off.mean() < still.mean()


def test_skin_is_doubted_beside_round_holes_and_not_beside_slits() -> None:
    ring = circle()
    for flat, doubted in ((0.9, True), (0.15, False)):
        rim = ring * [1.0, flat, 0.0]
        beside = np.concatenate([rim, 1.2 * rim, 10.0 * ring])
        mesh = Mesh(beside, np.array([[0, 1, 60], [60, 1, 61], [120, 140, 160]]))
        share = own_share(mesh, [np.arange(60)])
        assert (share[60:120].max() < 0.5) == doubted
        assert share[120:].min() > 0.9
