"""Workers: edits run, misbehave, are canceled, and survive the death of what runs them."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import psutil
import pytest

from service.domain import EditRecord, Json
from service.embedded import EmbeddedPostgres
from service.stores.blobs import Blobs
from service.stores.records import Records
from tests.service.core import (
    Workers,
    child_of,
    eventually,
    gone,
    kill,
    new_edit,
    new_mesh,
    zygote_of,
)

pytest_plugins = ["tests.service.core_fixtures"]


def finished(records: Records, edit_id: str, seconds: float = 60.0) -> EditRecord:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        edit = records.wait_for_change(edit_id, 10**9, deadline - time.monotonic())
        if edit.finished:
            return edit
    raise AssertionError(f"not finished within {seconds} s")


def until_running(records: Records, edit_id: str) -> None:
    eventually(lambda: records.get_edit(edit_id).status == "running", 60.0)


def test_an_edit_runs_and_its_files_are_published(
    records: Records, blobs: Blobs, workers: Workers
) -> None:
    workers.start()
    mesh = new_mesh(records, blobs, b"12345")
    edit_id = new_edit(records, {"text": "hello", "seconds": 0.5}, (mesh.id,))
    edit = finished(records, edit_id)
    assert (edit.status, edit.attempt, edit.error) == ("succeeded", 1, None)
    assert edit.summary["seconds"] >= 0.5
    assert [(stage["name"], stage["status"]) for stage in edit.stages] == [
        ("read", "done"),
        ("sleep", "running"),
    ]
    progress = [e.data["progress"] for e in records.events_after(edit_id) if e.type == "progress"]
    assert len(progress) >= 2
    (result,) = records.list_results(edit_id)
    assert (result.name, result.role, result.meta) == ("edited.txt", "mesh", {"frame": 0})
    assert blobs.get_range(result.blob_key, 0, result.bytes) == b"hello [5]"


BROKEN: list[tuple[str, Json, str]] = [
    ("segfault", {}, "worker_crashed"),
    ("hang", {"job_seconds": 0.5}, "time_limit"),
    ("eat_memory", {"job_memory_bytes": 200 * 1024**2}, "memory_limit"),
    ("refuse", {}, "no_surface"),
]


@pytest.mark.parametrize(("action", "settings", "code"), BROKEN)
def test_a_broken_edit_fails_alone_and_with_a_reason(
    records: Records, workers: Workers, action: str, settings: Json, code: str
) -> None:
    broken = new_edit(records, {"do": action})
    sound = new_edit(records, {"text": "sound"})
    workers.start(**settings)
    failed = finished(records, broken)
    assert (failed.status, failed.attempt) == ("failed", 1)
    assert failed.error is not None
    assert failed.error["errors"][0]["code"] == code
    assert {"type", "title", "status", "detail"} <= failed.error.keys()
    assert finished(records, sound).status == "succeeded"


def test_a_running_edit_is_canceled_within_a_second(records: Records, workers: Workers) -> None:
    edit_id = new_edit(records, {"do": "hang"})
    worker = workers.start()
    child = child_of(worker)
    until_running(records, edit_id)
    records.request_cancel(edit_id)
    took = eventually(lambda: records.get_edit(edit_id).status == "canceled", 5.0)
    assert took < 1.0
    assert gone(child.pid)
    assert finished(records, new_edit(records)).status == "succeeded"


def test_a_killed_child_fails_its_edit(records: Records, workers: Workers) -> None:
    edit_id = new_edit(records, {"do": "hang"})
    kill(child_of(workers.start()).pid)
    edit = finished(records, edit_id)
    assert edit.error is not None
    assert (edit.attempt, edit.error["errors"][0]["code"]) == (1, "worker_crashed")


def test_a_killed_worker_loses_its_edit_to_another(records: Records, workers: Workers) -> None:
    edit_id = new_edit(records, {"seconds": 1.5})
    first = workers.start()
    child, zygote = child_of(first), zygote_of(first)
    until_running(records, edit_id)
    workers.start()
    first.kill()
    first.wait()
    edit = finished(records, edit_id, 30.0)
    assert (edit.status, edit.attempt) == ("succeeded", 2)
    eventually(lambda: gone(child.pid) and gone(zygote.pid), 5.0)


def test_a_killed_zygote_costs_an_attempt_only(records: Records, workers: Workers) -> None:
    edit_id = new_edit(records, {"seconds": 1.0})
    worker = workers.start()
    child_of(worker)
    until_running(records, edit_id)
    kill(zygote_of(worker).pid)
    edit = finished(records, edit_id)
    assert (edit.status, edit.attempt) == ("succeeded", 2)


def test_an_edit_runs_through_a_restart_of_the_database(
    records: Records, workers: Workers, postgres: EmbeddedPostgres
) -> None:
    edit_id = new_edit(records, {"seconds": 3.0})
    workers.start()
    until_running(records, edit_id)
    assert postgres.pid is not None
    kill(postgres.pid)
    eventually(lambda: not postgres.alive)
    postgres.start()
    edit = finished(records, edit_id)
    assert (edit.status, edit.attempt) == ("succeeded", 1)
    assert finished(records, new_edit(records)).status == "succeeded"


def test_sigterm_lets_the_running_edit_finish(records: Records, workers: Workers) -> None:
    edit_id = new_edit(records, {"seconds": 1.0})
    worker = workers.start()
    until_running(records, edit_id)
    waiting = new_edit(records)
    family = psutil.Process(worker.pid).children(recursive=True)
    worker.send_signal(signal.SIGTERM)
    assert worker.wait(30) == 0
    assert records.get_edit(edit_id).status == "succeeded"
    assert records.get_edit(waiting).status == "queued"
    assert all(gone(one.pid) for one in family)


def test_an_edit_that_takes_too_long_to_drain_is_queued_again(
    records: Records, workers: Workers
) -> None:
    edit_id = new_edit(records, {"do": "hang"})
    worker = workers.start(drain_seconds=0.3)
    child_of(worker)
    until_running(records, edit_id)
    worker.send_signal(signal.SIGTERM)
    assert worker.wait(30) == 0
    edit = records.get_edit(edit_id)
    assert (edit.status, edit.attempt, edit.queue_position) == ("queued", 1, 1)


def test_scratch_is_empty_afterwards(records: Records, workers: Workers, tmp_path: Path) -> None:
    workers.start()
    for action in ("", "segfault"):
        finished(records, new_edit(records, {"do": action}))
    eventually(lambda: not list((tmp_path / "scratch").iterdir()), 5.0)
