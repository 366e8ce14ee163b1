"""Edits that start from an open one answer as those that do everything themselves."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from engine.errors import EngineError
from engine.io import read_mesh
from engine.pipeline.frames import Setting
from engine.pipeline.retargeting import Retargeting
from service.doors import Doors
from service.jobs import run_edit
from service.jobtypes import EditJob, Event, Json
from service.origin import Origin
from service.runner import Call, Limits, Runner
from service.schemas import EditDocument
from tests.acceptance.files import ply, small
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE

SECONDS, MEMORY = 300.0, 2 * 1024**3
FACES = {"rest": ICT_NEUTRAL, "smile": ICT_SMILE, "jaw": ICT_JAW_OPEN}


@dataclass(frozen=True)
class Bench:
    """Jobs on three small faces."""

    runner: Runner
    folder: Path

    def job(self, name: str, document: Json) -> EditJob:
        out = self.folder / name
        out.mkdir(parents=True)
        whole = EditDocument.model_validate(document).model_dump(mode="json")
        meshes = {face: self.folder / face for face in FACES}
        return EditJob(name, whole, meshes, out, self.folder / "cache")

    @contextmanager
    def opened(self, document: Json) -> Iterator[Origin]:
        job, doors = self.job("opened", document), Doors(self.folder / "open")
        door, name = doors.make()
        with door:
            owner = self.runner.open("service.jobs:keep_open", job, door, Limits(SECONDS, MEMORY))
        assert "bytes" in owner.wait_until_ready(SECONDS)
        connection = doors.enter(name)
        assert connection is not None
        with closing(owner), closing(Origin(connection)) as origin:
            yield origin

    def start(self, origin: Origin | Runner, job: EditJob, told: list[Event]) -> Call:
        limits = Limits(SECONDS, MEMORY)
        return origin.start("service.jobs:run_edit", job, limits, on_event=told.append)


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    made = Runner(("service.jobs",))
    yield made
    made.close()


@pytest.fixture
def bench(runner: Runner, tmp_path: Path) -> Bench:
    for name, path in FACES.items():
        face = small(path, 700)
        (tmp_path / name).write_bytes(ply(face.vertices, face.faces))
    return Bench(runner, tmp_path)


def towards(**changed: object) -> Json:
    targets = [{"mesh": name, "name": name} for name in ("smile", "jaw")]
    points = {"points": [{"at": {"vertex": 40}}, {"at": {"vertex": 350}}], "auto": 20}
    return {"source": "rest", "targets": targets, "control_points": points} | changed


def moving(**changed: object) -> Json:
    points = [{"at": {"vertex": 350}, "move": [0.0, 0.2, 0.1]}, {"at": {"vertex": 40}, **changed}]
    return {"source": "rest", "control_points": {"points": points}}


def placed(moved_to: Json | None = None, **changed: object) -> Json:
    to = {"smile": {"vertex": 350}, "jaw": {"vertex": 350}}
    point = {"at": {"vertex": 350}, "to": to, "moved_to": moved_to or {}}
    return towards(control_points={"points": [{"at": {"vertex": 40}}, point], "auto": 20}) | changed


TOWARDS = {
    "others": towards(weights={"smile": 0.7, "jaw": -0.2}),
    "beside what was solved": towards(weights={"smile": 0.26, "jaw": 0.23}),
    "alone": towards(weights={"jaw": 1.0}),
    "at rest": towards(weights={"smile": 0.0}),
    "far": towards(distance={"smile": 0.4}),
    "frames": towards(weights={"jaw": 0.6}, frames=3, output={"formats": ["obj", "glb"]}),
    "by points": towards(
        weights={"smile": 0.3},
        control_points={
            "points": [
                {"at": {"vertex": 40}, "weights": {"jaw": 0.8}},
                {"at": {"vertex": 350}, "move": [0.0, 0.1, 0.0]},
            ],
            "auto": 20,
        },
    ),
}
PLACED = {
    "not at all": placed(weights={"smile": 0.5}),
    "on one": placed({"smile": {"vertex": 352}}),
    "on both": placed({"smile": {"vertex": 352}, "jaw": {"vertex": 349}}, weights={"jaw": 0.4}),
}
MOVING = {
    "elsewhere": moving(move=[0.1, 0.0, 0.1]),
    "held": moving(fixed=True),
    "on the way": moving(fixed=True) | {"frames": 2},
}


def stages_last(events: list[Event]) -> dict[str, Event]:
    return {event["name"]: event for event in events if event["type"] == "stage"}


def results_told(events: list[Event]) -> list[Path]:
    return [event["path"] for event in events if event["type"] == "result"]


@pytest.mark.parametrize(
    ("first", "others"), [(towards(), TOWARDS), (placed(), PLACED), (moving(fixed=True), MOVING)]
)
def test_answers_are_the_same_to_the_bit(
    bench: Bench, first: Json, others: dict[str, Json]
) -> None:
    with bench.opened(first) as origin:
        for name, document in others.items():
            warm, cold = bench.job(f"{name}/warm", document), bench.job(f"{name}/cold", document)
            told: dict[str, list[Event]] = {"warm": [], "cold": []}
            from_open = bench.start(origin, warm, told["warm"]).result()
            by_itself = bench.start(bench.runner, cold, told["cold"]).result()
            assert from_open.ending == by_itself.ending == "returned", from_open.detail
            for ours, theirs in zip(from_open.value, by_itself.value, strict=True):
                assert (ours.name, ours.role, ours.meta) == (theirs.name, theirs.role, theirs.meta)
                assert content(ours.path) == content(theirs.path), (name, ours.name)
            last = {key: stages_last(events) for key, events in told.items()}
            results = {key: results_told(events) for key, events in told.items()}
            assert results == {
                key: [file.path for file in outcome.value]
                for key, outcome in (("warm", from_open), ("cold", by_itself))
            }
            assert set(last["warm"]) == set(last["cold"])
            assert all(event["status"] == "done" for event in last["warm"].values())
            assert last["warm"]["topology"]["cached"]


def test_a_point_that_is_moved_on_a_target_ends_there(bench: Bench) -> None:
    document = placed({"smile": {"vertex": 352}}, weights={"smile": 1.0})
    outcome = bench.start(bench.runner, bench.job("moved", document), []).result()
    assert outcome.ending == "returned", outcome.detail
    edited, smile = (
        read_mesh(path).mesh.vertices for path in (outcome.value[0].path, bench.folder / "smile")
    )
    way = np.linalg.norm(smile[352] - smile[350])
    assert np.linalg.norm(edited[350] - smile[352]) < 0.05 * way


def test_what_an_open_edit_cannot_follow_is_done_from_the_beginning(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(own: Retargeting, setting: Setting) -> Setting:
        if setting.problem is own._setting.problem:
            return setting
        raise EngineError("the planes cannot follow", code="other_edit")

    monkeypatch.setattr(Retargeting, "mapped", refuse)
    moved = placed({"smile": {"vertex": 352}})
    to = placed()
    to["control_points"]["points"][1]["to"]["smile"] = {"vertex": 352}
    ours, theirs = (
        run_edit(bench.job(name, document), lambda _: None)[0]
        for name, document in (("moved", moved), ("to", to))
    )
    assert content(ours.path) == content(theirs.path)


def content(path: Path) -> object:
    """What a result says, apart from how its stages went."""
    if path.suffix == ".zip":
        with zipfile.ZipFile(path) as archive:
            return {
                name: archive.getinfo(name).CRC
                for name in archive.namelist()
                if name != "report.json"
            }
    if path.name != "report.json":
        return path.read_bytes()
    report = json.loads(path.read_bytes())
    changing = ("seconds", "cached", "status", "progress")
    stages = [{k: v for k, v in one.items() if k not in changing} for one in report["stages"]]
    return report | {"stages": stages}
