import numpy as np
import pytest

from engine import (
    ControlPoint,
    EditPlan,
    EngineError,
    Keyframe,
    MeshFile,
    Options,
    PositionAddress,
    VertexAddress,
    edit,
    read_mesh,
    write_mesh,
)
from engine.pipeline import Edit, Stopwatch, prepare
from engine.pipeline.values import Controls
from engine.pipeline.weighting import Spreading, final_weights
from engine.types import FloatArray, SurfacePoints
from tests.acceptance.files import ply, small
from tests.engine.keeping import KEEPING
from tests.faces import HEAD_NEUTRAL, HEAD_SMILE, ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE

MOUTH_LEFT, CHIN, NOSE_TIP = 5708, 3924, 1514


@pytest.fixture(scope="module")
def neutral() -> MeshFile:
    return read_mesh(ICT_NEUTRAL)


@pytest.fixture(scope="module")
def smile() -> MeshFile:
    return read_mesh(ICT_SMILE)


@pytest.fixture(scope="module")
def smiled(neutral: MeshFile, smile: MeshFile) -> Edit:
    return edit(neutral, {"smile": smile}, EditPlan(frames=3, auto=120), stages=KEEPING)


def test_a_face_smiles(smiled: Edit, neutral: MeshFile, smile: MeshFile) -> None:
    carried = smiled.targets[0]
    error = np.linalg.norm(carried.vertices - smile.mesh.vertices, axis=1).mean()
    still = np.linalg.norm(neutral.mesh.vertices - smile.mesh.vertices, axis=1).mean()
    assert error < 0.5 * still
    assert carried.distance.to_target.mean < 0.02 * np.ptp(neutral.mesh.vertices, axis=0).max()


def test_nothing_folds_and_control_points_are_met(smiled: Edit) -> None:
    assert smiled.source_to_disk.folds == 0
    for frame in smiled.frames:
        assert len(frame.plane.folds) == 0
        assert frame.plane_to_plane.folds == 0
        assert frame.control_residual < 1e-9
        assert frame.plane_to_plane.counts.sum() == len(smiled.source.surface.mesh.faces)


def test_kept_holes_give_the_same_edit(smiled: Edit, neutral: MeshFile, smile: MeshFile) -> None:
    plan = EditPlan(auto=120, options=Options(holes="kept"))
    kept = edit(neutral, {"smile": smile}, plan, stages=KEEPING)
    disk = kept.source.disk.surface
    assert len(disk.holes) == 3
    assert len(disk.mesh.faces) == len(neutral.mesh.faces)
    errors = [
        np.linalg.norm(done.targets[0].vertices - smile.mesh.vertices, axis=1).mean()
        for done in (kept, smiled)
    ]
    assert errors[0] < 1.1 * errors[1]
    (frame,) = kept.frames
    assert kept.source_to_disk.folds == frame.edited_to_disk.folds == len(frame.plane.folds) == 0
    assert frame.control_residual < 1e-9
    for shown in (kept.source_to_disk, frame.edited_to_disk, frame.plane_to_plane):
        assert shown.counts.sum() == len(neutral.mesh.faces)


def test_kept_holes_follow_direct_moves(neutral: MeshFile) -> None:
    move = (0.0, -0.6, 0.2)
    points = (ControlPoint("chin", VertexAddress(CHIN), move=move),)
    (frame,) = edit(neutral, {}, EditPlan(points=points, options=Options(holes="kept"))).frames
    assert np.allclose(frame.vertices[CHIN] - neutral.mesh.vertices[CHIN], move, atol=1e-6)
    assert len(frame.plane.folds) == 0


def test_a_stage_that_was_kept_for_other_holes_is_not_taken(neutral: MeshFile) -> None:
    class Keys(Stopwatch):
        def run(self, name, key, work):
            seen.append((name, key))
            return super().run(name, key, work)

    seen: list[tuple[str, str]] = []
    for options in (Options(), Options(holes="kept")):
        prepare(neutral, options, Keys())
    topology, filled, again, kept = seen
    assert topology == again
    assert filled[0] == kept[0] == "parameterization"
    assert filled[1] != kept[1]


@pytest.mark.parametrize("excluded", [{"holes": "kept"}, {"outer_boundary": "sliding"}])
def test_choices_that_exclude_the_papers_iteration_are_refused(excluded: dict[str, str]) -> None:
    for iteration in ("paper", "paper_teichmueller"):
        with pytest.raises(EngineError, match=iteration) as caught:
            Options(iteration=iteration, **excluded)
        assert caught.value.code == "options"


def test_weights_0_is_the_file_and_weight_1_the_target_mesh(
    smiled: Edit, neutral: MeshFile
) -> None:
    first, _, last = smiled.frames
    assert np.array_equal(first.vertices, neutral.mesh.vertices)
    assert write_mesh(neutral, first.vertices) == ICT_NEUTRAL.read_bytes()
    assert np.array_equal(last.vertices, smiled.targets[0].vertices)


def test_quads_uvs_and_groups_come_back_with_eyes_that_stay_round() -> None:
    head, smile = read_mesh(HEAD_NEUTRAL), read_mesh(HEAD_SMILE)
    done = edit(head, {"smile": smile}, EditPlan(weights={"smile": 0.0}, auto=60))
    assert write_mesh(head, done.frames[0].vertices) == HEAD_NEUTRAL.read_bytes()
    passengers = done.source.surface.vertex_of < 0
    before = head.mesh.vertices[passengers][:40]
    after = done.targets[0].vertices[passengers][:40]
    lengths = [np.linalg.norm(x[1:] - x[0], axis=1) for x in (before, after)]
    assert np.allclose(*lengths, rtol=1e-6)


def test_points_that_the_request_places_are_met(neutral: MeshFile, smile: MeshFile) -> None:
    goal = smile.mesh.vertices[MOUTH_LEFT]
    point = ControlPoint(
        "mouth_left", VertexAddress(MOUTH_LEFT), to={"smile": PositionAddress(tuple(goal))}
    )
    done = edit(neutral, {"smile": smile}, EditPlan(points=(point,), auto=60), stages=KEEPING)
    carried = done.targets[0]
    pose = carried.match.registration.target_from_source
    at = carried.surface[done.source.surface.vertex_of[MOUTH_LEFT]]
    there = pose(at) * done.source.diagonal + carried.centre
    assert np.linalg.norm(there - goal) < 1e-6 * done.source.diagonal


def test_a_direct_move_ends_exactly_there_and_fixed_points_stay(neutral: MeshFile) -> None:
    move = (0.0, -0.6, 0.2)
    points = (
        ControlPoint("chin", VertexAddress(CHIN), move=move),
        ControlPoint("nose", VertexAddress(NOSE_TIP), fixed=True),
    )
    done = edit(neutral, {}, EditPlan(points=points, frames=2))
    first, last = done.frames
    assert np.array_equal(first.vertices, neutral.mesh.vertices)
    moved = last.vertices - neutral.mesh.vertices
    assert np.allclose(moved[CHIN], move, atol=1e-6)
    assert np.linalg.norm(moved[NOSE_TIP]) < 1e-6
    assert len(last.turned_faces) == 0
    assert len(last.plane.folds) == 0


def test_own_weights_win_near_their_points_only(neutral: MeshFile, smile: MeshFile) -> None:
    left, right = 5533, 6216
    points = (
        ControlPoint("on", VertexAddress(left), weights={"smile": 1.0}),
        ControlPoint("off", VertexAddress(right), weights={"smile": 0.0}),
    )
    plan = EditPlan(points=points, weights={"smile": 0.0}, auto=60)
    done = edit(neutral, {"smile": smile}, plan, stages=KEEPING)
    moved = np.linalg.norm(done.frames[0].vertices - neutral.mesh.vertices, axis=1)
    full = np.linalg.norm(done.targets[0].vertices - neutral.mesh.vertices, axis=1)
    assert moved[left] > 0.6 * full[left]
    assert moved[right] < 0.2 * full[right]


def test_requested_points_hold_their_targets_weight_beside_ones_with_their_own() -> None:
    mesh = read_mesh(ICT_NEUTRAL).mesh
    own, beside, automatic = 5533, 5708, 1225
    corners = [own, beside, automatic]
    faces = np.array([np.flatnonzero((mesh.faces == v).any(axis=1))[0] for v in corners])
    where = (mesh.faces[faces] == np.array(corners)[:, None]).astype(float)
    points = SurfacePoints(faces, where)
    plane = np.zeros(3, dtype=np.complex128)
    controls = Controls(
        ("own", "beside", "auto_1"), 2, points, np.zeros(3), plane, plane[None], (), ()
    )
    asked = (
        ControlPoint("own", VertexAddress(own), weights={"smile": 1.0}),
        ControlPoint("beside", VertexAddress(beside)),
    )
    plan = EditPlan(points=asked, weights={"smile": 0.3}, auto=1)
    found = final_weights(
        plan, ["smile"], {"smile": 0.3}, controls, np.ones((1, 3)), Spreading(mesh, points)
    )
    assert found.points[0, :2].tolist() == [1.0, 0.3]
    np.testing.assert_allclose(found.surface[0, corners], found.points[0], atol=1e-9)
    assert found.surface.min() >= 0.3 and found.surface.max() <= 1.0


def test_keyframes_lead_through_their_weights(neutral: MeshFile, smile: MeshFile) -> None:
    path = (Keyframe(0.0, {}), Keyframe(1.0, {"smile": 1.0}), Keyframe(2.0, {}))
    plan = EditPlan(keyframes=path, frames=3, auto=40)
    done = edit(neutral, {"smile": smile}, plan, stages=KEEPING)
    assert [frame.weights["smile"] for frame in done.frames] == [0.0, 1.0, 0.0]
    assert np.array_equal(done.frames[1].vertices, done.targets[0].vertices)
    assert np.array_equal(done.frames[2].vertices, neutral.mesh.vertices)


def test_the_papers_way_runs_literally_and_is_no_better_than_doing_little(
    neutral: MeshFile,
) -> None:
    jaw = read_mesh(ICT_JAW_OPEN)
    paper = Options(
        registration="paper",
        correspondence="paper",
        parameterization="paper",
        iteration="paper",
        restoration="paper",
        outer_boundary="paper",
        passengers="paper",
    )
    points = tuple(ControlPoint(f"p{v}", VertexAddress(v)) for v in range(5500, 5710, 7))
    done = edit(neutral, {"jaw": jaw}, EditPlan(points=points, auto=0, options=paper))
    error = np.linalg.norm(done.targets[0].vertices - jaw.mesh.vertices, axis=1).mean()
    still = np.linalg.norm(neutral.mesh.vertices - jaw.mesh.vertices, axis=1).mean()
    assert error > 0.5 * still


@pytest.mark.parametrize("targeted", [False, True])
def test_the_answer_does_not_depend_on_unit_and_offset(targeted: bool) -> None:
    face, smiling = small(), small(ICT_SMILE)
    diagonal = float(np.linalg.norm(np.ptp(face.vertices, axis=0)))

    def edited(scale: float, shift: float) -> FloatArray:
        source, smile = (
            read_mesh(ply(mesh.vertices * scale + shift, mesh.faces, real="f8"))
            for mesh in (face, smiling)
        )
        if targeted:
            result = edit(source, {"smile": smile}, EditPlan(auto=40))
        else:
            move = (0.0, 0.4 * scale, 0.3 * scale)
            result = edit(source, {}, EditPlan((ControlPoint("a", VertexAddress(700), move=move),)))
        return (result.frames[-1].vertices - shift) / scale

    plain = edited(1.0, 0.0)
    assert np.linalg.norm(plain - face.vertices, axis=1).max() > 0.3
    changes = [(1e-6, 0.0), (1.0, 5e6), (1e6, 0.0), (0.01, 3.0)]
    for scale, shift in changes[: 3 if targeted else 4]:
        assert np.abs(edited(scale, shift) - plain).max() < 1e-8 * diagonal


def test_two_points_at_one_place_are_named(neutral: MeshFile) -> None:
    points = tuple(ControlPoint(n, VertexAddress(CHIN), move=(0.0, 0.1, 0.0)) for n in ("a", "b"))
    with pytest.raises(EngineError, match="same place") as caught:
        edit(neutral, {}, EditPlan(points=points))
    assert caught.value.elements["points"] == ["a", "b"]
