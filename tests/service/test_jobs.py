import json
from dataclasses import make_dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from engine import Stopwatch, edit, read_mesh
from engine.pipeline import EditPlan
from engine.topology import disk_surface, editable_surface
from engine.types import DiskMap, MeshWarning
from service.jobs.cache import StageCache, decode, encode
from service.jobs.findings import unit_guess
from service.jobs.outputs import Outputs
from service.jobs.plans import engine_plan
from service.jobs.reports import (
    Inputs,
    histogram_document,
    report_document,
    source_places,
    unit_note,
)
from service.jobs.stages import NAMES, JobStages
from service.jobtypes import Event
from service.schemas import EditDocument
from tests.acceptance.files import ply
from tests.faces import ICT_NEUTRAL


def test_engine_values_survive_the_cache_exactly(tmp_path: Path) -> None:
    surface, _ = editable_surface(read_mesh(ICT_NEUTRAL).mesh)
    disk = disk_surface(surface)
    kept = DiskMap(disk, np.exp(1j * np.arange(len(disk.mesh.vertices))))
    warnings = (MeshWarning("flipped_faces", "3 faces were turned", "faces", 3, (1, 2, 5)),)
    value = (surface, kept, 0.25, warnings)

    again = decode(encode(value))

    assert isinstance(again, tuple)
    assert np.array_equal(again[0].mesh.vertices, surface.mesh.vertices)
    assert [loop.tolist() for loop in again[0].loops] == [loop.tolist() for loop in surface.loops]
    assert np.array_equal(again[1].z, kept.z)
    assert not again[1].z.flags.writeable
    assert again[2:] == (0.25, (warnings[0],))


def test_a_kept_stage_is_told_from_others_and_a_broken_file_is_made_anew(tmp_path: Path) -> None:
    cache = StageCache(tmp_path, "1")
    cache.put("topology", "a", (1, 2))
    assert cache.get("topology", "a") == (1, 2)
    assert cache.get("topology", "b") is None
    assert cache.get("registration", "a") is None
    assert StageCache(tmp_path, "2").get("topology", "a") is None
    for path in tmp_path.rglob("*.kept"):
        path.write_bytes(path.read_bytes()[:-1])
    assert cache.get("topology", "a") is None


@pytest.mark.parametrize("figure", [float("nan"), float("inf"), -float("inf")])
def test_a_document_with_a_figure_that_is_not_finite_is_not_written(
    tmp_path: Path, figure: float
) -> None:
    outputs = Outputs(tmp_path, lambda event: None)
    outputs.write_document("fine.json", "report", {"NaN": [1e-7, "Infinity", None]})
    assert json.loads((tmp_path / "fine.json").read_bytes()) == {"NaN": [1e-7, "Infinity", None]}
    with pytest.raises(ValueError, match="line 1"):
        outputs.write_document("broken.json", "report", {"figures": [1.0, figure]})
    assert not (tmp_path / "broken.json").exists()


def test_what_another_build_kept_without_a_field_is_made_anew(tmp_path: Path) -> None:
    before = make_dataclass("MeshWarning", ["code"])
    cache = StageCache(tmp_path, "1")
    cache.put("topology", "a", before("flipped_faces"))
    assert any(tmp_path.rglob("*.kept"))
    assert cache.get("topology", "a") is None


def test_stages_tell_what_runs_and_are_cached_only_as_a_whole(tmp_path: Path) -> None:
    told: list[Event] = []
    cache = StageCache(tmp_path, "1")
    cache.put("topology", "old", 1)
    stages = JobStages(told.append, cache)
    assert stages.run("topology", "old", lambda: 0) == 1
    assert stages.run("topology", "new", lambda: 2) == 2
    stages.progress("topology", 0.5)
    stages.run("write", "", lambda: None)
    stages.finish_all()
    names = [event["name"] for event in told]
    assert names[0] == "topology"
    assert set(names) <= set(NAMES)
    last = {event["name"]: event for event in told}
    assert last["topology"]["status"] == last["write"]["status"] == "done"
    assert not last["topology"]["cached"]


def test_a_document_becomes_the_same_plan() -> None:
    document = EditDocument.model_validate(
        {
            "source": "msh_a",
            "targets": [{"mesh": "msh_b", "name": "smile"}, {"mesh": "msh_c", "name": "jaw"}],
            "control_points": {"points": [{"name": "chin", "at": {"vertex": 3}, "fixed": True}]},
            "weights": {"smile": 0.7},
            "frames": 4,
            "keyframes": [{"time": 0, "weights": {}}, {"time": 1, "weights": {"jaw": 1}}],
            "options": {"iteration": "paper"},
        }
    )
    plan = engine_plan(document)
    assert plan.weights == {"smile": 0.7, "jaw": 0.0}
    assert [key.weights for key in plan.keyframes] == [
        {"smile": 0.7, "jaw": 0.0},
        {"smile": 0.7, "jaw": 1},
    ]
    assert plan.points[0].fixed
    assert plan.options.iteration == "paper"


def test_histograms_are_as_the_contract_gives_them() -> None:
    face = read_mesh(ICT_NEUTRAL)
    done = edit(face, {"same": face}, EditPlan(auto=20), stages=Stopwatch())
    document = histogram_document(done)
    assert [shown["name"] for shown in document["maps"]] == [
        "source_to_disk",
        "edited_to_disk",
        "plane",
        "surface",
    ]
    for shown in document["maps"]:
        assert sum(shown["counts"]) == len(face.mesh.faces)
        assert np.isclose(sum(shown["area_weights"]), 1.0)
        assert len(shown["counts"]) == len(document["edges"]) - 1
    assert document["similarity"][0]["wasserstein_1"] >= 0.0


def test_a_report_names_the_triangles_that_an_edit_turned_over() -> None:
    face = read_mesh(ICT_NEUTRAL)
    plan = EditPlan(auto=20)
    done = edit(face, plan=plan, stages=Stopwatch())
    (frame,) = done.frames
    turned = replace(done, frames=(replace(frame, turned_faces=np.array([3, 5])),))
    of_file = done.source.surface.face_of[[3, 5]].tolist()
    places, inputs = source_places(done, face), Inputs(face, {}, {})
    for shown, faces in ((done, []), (turned, [of_file])):
        (told,) = report_document(shown, plan, inputs, places, [], "1")["frames"]
        assert [warning["first"] for warning in told["warnings"]] == faces
        assert told["turned_faces"] == sum(warning["count"] for warning in told["warnings"])


def test_a_report_says_which_unit_a_target_has() -> None:
    assert unit_note(1.0) == "the same as the source's"
    assert unit_note(0.1) == "0.1 of the source's, as the sizes tell"
    assert "1.7" in unit_note(1.7)


@pytest.mark.parametrize("size", 10.0 ** np.arange(-9, 10))
def test_every_size_has_a_unit_or_is_said_to_have_none(size: float) -> None:
    mesh = read_mesh(ICT_NEUTRAL).mesh
    diagonal = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    guess = unit_guess(read_mesh(ply(mesh.vertices * (size / diagonal), mesh.faces, real="f8")))
    expected = {0.1: "m", 1.0: "m", 10.0: "cm", 100.0: "cm", 1e3: "mm", 1e5: "µm", 1e6: "µm"}
    assert guess == expected.get(float(size), "unknown")
