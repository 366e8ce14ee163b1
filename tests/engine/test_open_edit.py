from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from engine import (
    ControlPoint,
    EditPlan,
    EngineError,
    MeshFile,
    PositionAddress,
    VertexAddress,
    edit,
    read_mesh,
)
from engine.pipeline import EditedMeshes, OpenEdit, open_edit
from engine.restoration import turned_faces
from engine.types import FloatArray
from tests.engine.keeping import KEEPING
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE

MOUTH_LEFT, CHIN, NOSE_TIP = 5708, 3924, 1514
UPPER_LIP, LOWER_LIP = 5533, 5517
POINTS = (
    ControlPoint("mouth", VertexAddress(MOUTH_LEFT)),
    ControlPoint("chin", VertexAddress(CHIN), move=(0.0, -0.3, 0.0)),
    ControlPoint("nose", VertexAddress(NOSE_TIP), fixed=True),
)
FIRST = EditPlan(points=POINTS, auto=30, weights={"smile": 0.4, "jaw": 0.2})


@pytest.fixture(scope="module")
def files() -> tuple[MeshFile, dict[str, MeshFile]]:
    return read_mesh(ICT_NEUTRAL), {"smile": read_mesh(ICT_SMILE), "jaw": read_mesh(ICT_JAW_OPEN)}


@pytest.fixture(scope="module")
def opened(files: tuple[MeshFile, dict[str, MeshFile]]) -> OpenEdit:
    return open_edit(*files, FIRST, stages=KEEPING)


def only(meshes: EditedMeshes) -> FloatArray:
    (mesh,) = meshes.frames
    return mesh.vertices


def test_other_weights_moves_and_frames_give_what_a_new_edit_gives(
    opened: OpenEdit, files: tuple[MeshFile, dict[str, MeshFile]]
) -> None:
    mouth, chin, nose = POINTS
    points = (
        replace(mouth, weights={"smile": 0.9}),
        replace(chin, move=(0.1, -0.5, 0.2)),
        replace(nose, fixed=False, move=(0.0, 0.0, 0.3)),
    )
    plan = replace(FIRST, points=points, weights={"smile": -0.2, "jaw": 0.7}, frames=3)
    fresh = edit(*files, plan, stages=KEEPING)
    meshes = opened.meshes(plan)
    assert len(meshes.frames) == 3
    for mesh, frame in zip(meshes.frames, fresh.frames, strict=True):
        assert (mesh.index, mesh.time, mesh.weights) == (frame.index, frame.time, frame.weights)
        np.testing.assert_array_equal(mesh.vertices, frame.vertices)
        np.testing.assert_array_equal(mesh.turned_faces, frame.turned_faces)
    for mesh, target in zip(meshes.targets, fresh.targets, strict=True):
        assert mesh.name == target.name
        np.testing.assert_array_equal(mesh.vertices, target.vertices)
    assert not np.array_equal(only(opened.meshes()), meshes.frames[-1].vertices)


def test_weights_below_zero_turn_no_face_over(
    opened: OpenEdit, files: tuple[MeshFile, dict[str, MeshFile]]
) -> None:
    still = tuple(ControlPoint(point.name, point.at) for point in POINTS)
    mesh = only(opened.meshes(replace(FIRST, points=still, weights={"jaw": -0.5})))
    face = files[0].mesh
    assert not len(turned_faces(face, face.vertices, mesh))
    assert np.abs(mesh - face.vertices).max() > 0.5


def test_an_open_edit_comes_back_to_the_source_and_its_targets_bit_for_bit(
    opened: OpenEdit, files: tuple[MeshFile, dict[str, MeshFile]]
) -> None:
    still = tuple(replace(point, move=None, fixed=False) for point in POINTS)
    plan = replace(FIRST, points=still)
    source = only(opened.meshes(replace(plan, weights={})))
    np.testing.assert_array_equal(source, files[0].mesh.vertices)
    done = opened.edit(replace(plan, weights={"jaw": 1.0}))
    np.testing.assert_array_equal(done.frames[0].vertices, done.targets[1].vertices)


def test_points_go_elsewhere_on_a_target_at_once_and_back(
    files: tuple[MeshFile, dict[str, MeshFile]],
) -> None:
    place = files[1]["smile"].mesh.vertices[MOUTH_LEFT]
    there = ControlPoint("mouth", VertexAddress(MOUTH_LEFT), to={"smile": at(place)})
    first = EditPlan(points=(there,), auto=30, weights={"smile": 1.0})
    opened = open_edit(*files, first, stages=KEEPING)
    before = only(opened.meshes())
    aside = replace(there, to={"smile": at(place + np.array((0.15, 0.1, 0.0)))})
    other = replace(first, points=(aside,))
    after = only(opened.meshes(other))
    fresh = edit(*files, other, stages=KEEPING).frames[0].vertices
    np.testing.assert_allclose(after[MOUTH_LEFT], fresh[MOUTH_LEFT], rtol=0, atol=1e-6)
    change = np.linalg.norm(fresh - before, axis=1)
    assert change[MOUTH_LEFT] > 0.1
    assert np.linalg.norm(after - fresh, axis=1).mean() < 0.7 * change.mean()
    assert not len(opened.edit(other).frames[0].turned_faces)
    np.testing.assert_array_equal(only(opened.meshes(first)), before)


def test_a_point_sent_across_the_mouth_drags_nothing_along(
    files: tuple[MeshFile, dict[str, MeshFile]],
) -> None:
    upper, lower = VertexAddress(UPPER_LIP), VertexAddress(LOWER_LIP)
    first = EditPlan(
        points=(ControlPoint("lip", upper, to={"smile": upper}),), auto=30, weights={"smile": 1.0}
    )
    smile = {"smile": files[1]["smile"]}
    opened = open_edit(files[0], smile, first, stages=KEEPING)
    before = only(opened.meshes())
    across = replace(first, points=(ControlPoint("lip", upper, to={"smile": lower}),))
    after = only(opened.meshes(across))
    goal = np.linalg.norm(
        smile["smile"].mesh.vertices[LOWER_LIP] - smile["smile"].mesh.vertices[UPPER_LIP]
    )
    moved = np.linalg.norm(after - before, axis=1)
    assert 0.5 * goal < moved[UPPER_LIP] <= moved.max() < 1.5 * goal


def at(position: Any) -> PositionAddress:
    return PositionAddress((float(position[0]), float(position[1]), float(position[2])))


@pytest.mark.parametrize(
    "other",
    [
        replace(FIRST, points=POINTS[:2]),
        replace(FIRST, points=(replace(POINTS[0], at=VertexAddress(CHIN + 1)), *POINTS[1:])),
        replace(FIRST, auto=31),
        replace(FIRST, histogram_bins=10),
    ],
)
def test_what_an_open_edit_cannot_change_is_refused(opened: OpenEdit, other: EditPlan) -> None:
    with pytest.raises(EngineError) as refused:
        opened.meshes(other)
    assert refused.value.code == "other_edit"
