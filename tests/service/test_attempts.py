"""Attempts: every change has one winner, and what loses its worker runs again."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import text

from service.domain import NotFound, ResultRecord
from service.stores.records import Records
from tests.service.core import claim, job_of, new_edit

pytest_plugins = ["tests.service.core_fixtures"]
EXHAUSTED = {"title": "lost", "errors": [{"code": "attempts_exhausted"}]}


def run_sql(records: Records, statement: str) -> None:
    records._database.run(lambda connection: connection.execute(text(statement)))


def result(edit_id: str, name: str = "edited.obj") -> ResultRecord:
    return ResultRecord(edit_id, name, "mesh", {"frame": 3}, "model/obj", 3, "abc", "results/x")


def statuses(records: Records, edit_id: str) -> list[str]:
    return [
        event.data["status"] for event in records.events_after(edit_id) if event.type == "status"
    ]


def test_progress_becomes_stages_and_events(records: Records) -> None:
    edit_id = new_edit(records)
    attempt = claim(records, edit_id).attempt
    for status, progress in (("running", 0.0), ("running", 0.5), ("done", 1.0)):
        event = {"type": "stage", "name": "read", "status": status, "progress": progress}
        assert records.record_progress(edit_id, attempt, [event])
    assert records.get_edit(edit_id).stages == [{"name": "read", "status": "done", "progress": 1.0}]
    events = records.events_after(edit_id, 2)
    assert [event.seq for event in events] == [3, 4, 5]
    assert [event.type for event in events] == ["stage", "progress", "stage"]
    assert records.events_after(edit_id, 4) == events[2:]
    with pytest.raises(NotFound):
        records.events_after("edt_none")


def test_only_the_current_attempt_counts(records: Records) -> None:
    edit_id = new_edit(records)
    stale = claim(records, edit_id).attempt
    stale_job = job_of(records, edit_id)
    assert records.recover_all() == [edit_id]
    assert records.claim_attempt(edit_id, stale_job) is None
    event = {"type": "stage", "name": "read", "status": "running", "progress": 0.0}

    def refused_to_the_stale_one() -> None:
        assert not records.is_wanted(edit_id, stale)
        assert not records.record_progress(edit_id, stale, [event])
        assert not records.publish(edit_id, stale, [result(edit_id)], {})
        assert not records.fail(edit_id, stale, {})
        assert not records.finish_cancel(edit_id, stale)
        assert not records.release(edit_id, stale)
        assert not records.lose(edit_id, stale, EXHAUSTED)

    refused_to_the_stale_one()
    current = claim(records, edit_id).attempt
    refused_to_the_stale_one()
    assert records.get_edit(edit_id).status == "running"
    assert records.publish(edit_id, current, [result(edit_id)], {"a": 1})
    refused_to_the_stale_one()
    assert records.list_results(edit_id) == [result(edit_id)]
    assert statuses(records, edit_id) == ["queued", "running", "queued", "running", "succeeded"]


def test_of_many_who_publish_one_does(records: Records) -> None:
    edit_id = new_edit(records)
    attempt = claim(records, edit_id).attempt
    with ThreadPoolExecutor(8) as pool:
        said = list(
            pool.map(
                lambda n: records.publish(edit_id, attempt, [result(edit_id, f"{n}")], {}), range(8)
            )
        )
    assert all(said)  # a repetition whose first answer was lost is told of its success
    assert len(records.list_results(edit_id)) == 1
    assert statuses(records, edit_id).count("succeeded") == 1


def fetch(records: Records, edit_id: str, heartbeat: str) -> None:
    """As if a worker with such a heartbeat had fetched the edit's job, and not begun with it."""
    job = job_of(records, edit_id)
    run_sql(
        records,
        "WITH w AS (INSERT INTO procrastinate_workers (last_heartbeat)"
        f" VALUES (clock_timestamp() - interval '{heartbeat}') RETURNING id)"
        f" UPDATE procrastinate_jobs SET status = 'doing', worker_id = (SELECT id FROM w)"
        f" WHERE id = {job}",
    )


def test_only_those_of_silent_workers_are_lost(records: Records) -> None:
    working, silent, fetched, stuck, waiting = (new_edit(records) for _ in range(5))
    claim(records, silent)
    fetch(records, fetched, "-60 seconds")
    fetch(records, stuck, "10 seconds")
    time.sleep(0.6)
    attempt = claim(records, working).attempt
    time.sleep(0.2)
    records.show_life(working, attempt)
    assert set(records.recover_lost(0.5, EXHAUSTED)) == {silent, stuck}
    states = [records.get_edit(edit).status for edit in (working, silent, fetched, stuck, waiting)]
    assert states == ["running", "queued", "queued", "queued", "queued"]
    assert records.recover_lost(0.5, EXHAUSTED) == []


def test_an_edit_that_loses_every_worker_is_given_up(migrated: str, records: Records) -> None:
    edit_id = new_edit(records)
    for attempt in (1, 2, 3):
        assert claim(records, edit_id).attempt == attempt
        time.sleep(0.01)
        assert records.recover_lost(0.0, EXHAUSTED) == [edit_id]
    edit = records.get_edit(edit_id)
    assert (edit.status, edit.error) == ("failed", EXHAUSTED)
    assert records.recover_lost(0.0, EXHAUSTED) == []


def test_a_stop_of_everything_is_not_held_against_an_edit(records: Records) -> None:
    edit_id = new_edit(records)
    for _ in range(5):
        claim(records, edit_id)
        assert records.recover_all() == [edit_id]
    assert records.get_edit(edit_id).status == "queued"


def test_a_lost_edit_that_was_to_be_canceled_is_canceled(records: Records) -> None:
    edit_id = new_edit(records)
    attempt = claim(records, edit_id).attempt
    assert records.is_wanted(edit_id, attempt)
    assert records.request_cancel(edit_id).status == "running"
    assert not records.is_wanted(edit_id, attempt)
    records.recover_all()
    assert records.get_edit(edit_id).status == "canceled"
