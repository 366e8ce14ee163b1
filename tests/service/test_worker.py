"""Workers: edits run, misbehave, are canceled, and survive the death of what runs them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from service.embedded import EmbeddedPostgres
from service.stores.blobs import Blobs
from service.stores.records import Records
from tests.service.core import (
    Workers,
    child_of,
    eventually,
    finished,
    gone,
    kill,
    new_edit,
    new_mesh,
    until_running,
    zygote_of,
)

pytest_plugins = ["tests.service.core_fixtures"]


@pytest.fixture(scope="module")
def shared(migrated: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workers]:
    """One worker for all tests that leave it alive."""
    made = Workers(migrated, tmp_path_factory.mktemp("shared worker"))
    made.start(job_memory_bytes=300 * 1024**2, job_seconds=5.0)
    yield made
    made.end()


def test_an_edit_runs_and_its_files_are_published(records: Records, shared: Workers) -> None:
    blobs = Blobs(str(shared.data / "blobs"))
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


BROKEN = [
    ("segfault", "worker_crashed"),
    ("hang", "time_limit"),
    ("eat_memory", "memory_limit"),
    ("refuse", "no_surface"),
]


@pytest.mark.parametrize(("action", "code"), BROKEN)
def test_a_broken_edit_fails_alone_and_with_a_reason(
    records: Records, shared: Workers, action: str, code: str
) -> None:
    broken = new_edit(records, {"do": action})
    sound = new_edit(records, {"text": "sound"})
    failed = finished(records, broken)
    assert (failed.status, failed.attempt) == ("failed", 1)
    assert failed.error is not None
    assert failed.error["errors"][0]["code"] == code
    assert {"type", "title", "status", "detail"} <= failed.error.keys()
    assert finished(records, sound).status == "succeeded"


def test_a_running_edit_is_canceled_within_a_second(records: Records, shared: Workers) -> None:
    edit_id = new_edit(records, {"do": "hang"})
    child = child_of(shared.running[0])
    until_running(records, edit_id)
    records.request_cancel(edit_id)
    took = eventually(lambda: records.get_edit(edit_id).status == "canceled")
    assert took < 1.0
    assert gone(child.pid)
    assert finished(records, new_edit(records)).status == "succeeded"


def test_a_killed_child_fails_its_edit(records: Records, shared: Workers) -> None:
    edit_id = new_edit(records, {"do": "hang"})
    kill(child_of(shared.running[0]).pid)
    edit = finished(records, edit_id)
    assert edit.error is not None
    assert (edit.attempt, edit.error["errors"][0]["code"]) == (1, "worker_crashed")


def test_a_killed_zygote_costs_an_attempt_only(records: Records, shared: Workers) -> None:
    edit_id = new_edit(records, {"seconds": 1.0})
    child_of(shared.running[0])
    until_running(records, edit_id)
    kill(zygote_of(shared.running[0]).pid)
    edit = finished(records, edit_id)
    assert (edit.status, edit.attempt) == ("succeeded", 2)


def test_an_edit_runs_through_a_restart_of_the_database(
    records: Records, shared: Workers, postgres: EmbeddedPostgres
) -> None:
    edit_id = new_edit(records, {"seconds": 3.0})
    until_running(records, edit_id)
    assert postgres.pid is not None
    kill(postgres.pid)
    eventually(lambda: not postgres.alive)
    postgres.start()
    edit = finished(records, edit_id)
    assert (edit.status, edit.attempt) == ("succeeded", 1)
    assert finished(records, new_edit(records)).status == "succeeded"


def test_scratch_is_empty_afterwards(records: Records, shared: Workers) -> None:
    for action in ("", "segfault"):
        finished(records, new_edit(records, {"do": action}))
    eventually(lambda: not list((shared.data / "scratch").iterdir()))
