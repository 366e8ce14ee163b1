"""Records: an edit and its job are one; every state change has one winner."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import text

from service import queue
from service.domain import (
    Conflict,
    EditRecord,
    Gone,
    IdempotencyMismatch,
    InvalidCursor,
    NotFound,
    QueueFull,
    ResultRecord,
    Unavailable,
)
from service.embedded import EmbeddedPostgres
from service.stores import tables
from service.stores.blobs import Blobs
from service.stores.records import Records
from tests.service.core import claim, job_of, kill, new_edit, new_mesh

pytest_plugins = ["tests.service.core_fixtures"]


def count(records: Records, table: str) -> int:
    query = text(f"SELECT count(*) FROM {table}")
    return records._database.run(lambda connection: connection.execute(query).scalar_one())


def result(edit_id: str, name: str = "edited.obj") -> ResultRecord:
    return ResultRecord(edit_id, name, "mesh", {"frame": 3}, "model/obj", 3, "abc", "results/x")


def statuses(records: Records, edit_id: str) -> list[str]:
    return [
        event.data["status"] for event in records.events_after(edit_id) if event.type == "status"
    ]


def test_the_migrated_schema_is_the_one_the_tables_describe(records: Records) -> None:
    with records._database.engine.connect() as connection:
        context = MigrationContext.configure(
            connection,
            opts={
                "include_name": lambda name, kind, _: (
                    kind != "table" or name in tables.metadata.tables
                ),
                "compare_type": True,
            },
        )
        assert compare_metadata(context, tables.metadata) == []


def test_many_processes_may_migrate_at_once(records: Records) -> None:
    with ThreadPoolExecutor(4) as pool:
        for done in [pool.submit(records.migrate) for _ in range(4)]:
            done.result()


def test_an_accepted_edit_has_its_job(records: Records) -> None:
    edit_id = new_edit(records, {"source": "x"})
    edit = records.get_edit(edit_id)
    assert (edit.status, edit.queue_position, edit.document) == ("queued", 1, {"source": "x"})
    assert count(records, "procrastinate_jobs") == 1
    assert statuses(records, edit_id) == ["queued"]


def test_neither_edit_nor_job_survive_a_rollback(
    records: Records, monkeypatch: pytest.MonkeyPatch
) -> None:
    enqueue = queue.enqueue

    def enqueue_and_break(*arguments: Any, **options: Any) -> int:
        enqueue(*arguments, **options)
        raise RuntimeError("the process ends here")

    monkeypatch.setattr("service.stores.edits.queue.enqueue", enqueue_and_break)
    with pytest.raises(RuntimeError):
        new_edit(records)
    assert count(records, "edits") == count(records, "procrastinate_jobs") == 0


def test_an_idempotency_key_gives_the_first_answer_however_many_ask(records: Records) -> None:
    def create(number: int) -> tuple[EditRecord, bool]:
        return records.create_edit(
            document={"n": number}, meshes=(), fingerprint="same", idempotency_key="key"
        )

    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(create, range(16)))
    assert len({edit.id for edit, _ in answers}) == 1
    assert sum(new for _, new in answers) == 1
    assert count(records, "procrastinate_jobs") == 1
    with pytest.raises(IdempotencyMismatch):
        records.create_edit(document={}, meshes=(), fingerprint="other", idempotency_key="key")
    _, new = records.create_edit(
        document={}, meshes=(), fingerprint="other", idempotency_key="key", tenant="else"
    )
    assert new


def test_the_queue_takes_exactly_as_many_as_it_may(migrated: str, records: Records) -> None:
    limited = Records(migrated, queue_limit=5)

    def create(_: int) -> bool:
        try:
            new_edit(limited)
        except QueueFull:
            return False
        return True

    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(create, range(12))) == 5
    limited.close()


def test_equal_bytes_are_one_mesh(records: Records, blobs: Blobs) -> None:
    first = new_mesh(records, blobs)
    again = new_mesh(records, blobs)
    assert again == first == records.get_mesh(first.id) == records.find_mesh_by_sha(first.sha256)
    assert records.find_mesh_by_sha("none") is None


def test_a_mesh_in_use_stays(records: Records, blobs: Blobs) -> None:
    mesh = new_mesh(records, blobs)
    edit_id = new_edit(records, meshes=(mesh.id, mesh.id))
    with pytest.raises(Conflict) as refused:
        records.delete_mesh(mesh.id)
    assert refused.value.code == "mesh_in_use"
    records.request_cancel(edit_id)
    assert records.delete_mesh(mesh.id) == mesh
    assert records.get_edit(edit_id).meshes == ()
    with pytest.raises(NotFound):
        records.delete_mesh(mesh.id)
    with pytest.raises(NotFound):
        new_edit(records, meshes=(mesh.id,))
    assert count(records, "procrastinate_jobs") == 0


def test_lists_go_from_new_to_old_in_pages_without_gaps(records: Records, blobs: Blobs) -> None:
    edits = [new_edit(records, {"n": n}) for n in range(7)]
    seen: list[str] = []
    cursor = None
    while True:
        page = records.list_edits(3, cursor)
        seen += [edit.id for edit in page.items]
        new_edit(records)  # what comes meanwhile does not disturb
        cursor = page.next_cursor
        if cursor is None:
            break
    assert seen == edits[::-1]
    assert {edit.id for edit in records.list_edits(50, status="canceled").items} == set()
    meshes = [new_mesh(records, blobs, bytes([n])).id for n in range(3)]
    assert [mesh.id for mesh in records.list_meshes(2).items] == meshes[:0:-1]


@pytest.mark.parametrize("cursor", ["", "!", "YWJj", "MjAyNnw=", "x" * 500, "é"])
def test_a_made_up_cursor_is_refused(records: Records, cursor: str) -> None:
    with pytest.raises(InvalidCursor):
        records.list_edits(3, cursor)


def test_positions_in_the_queue_follow_arrival_and_reruns_go_first(records: Records) -> None:
    first, second, third = (new_edit(records) for _ in range(3))
    assert [records.get_edit(e).queue_position for e in (first, second, third)] == [1, 2, 3]
    rerun = claim(records, third)
    assert records.get_edit(third).queue_position is None
    assert records.release(third, rerun.attempt)
    assert [records.get_edit(e).queue_position for e in (third, first, second)] == [1, 2, 3]


def test_a_queued_edit_is_canceled_at_once_and_for_good(records: Records) -> None:
    edit_id = new_edit(records)
    job = job_of(records, edit_id)
    assert records.request_cancel(edit_id).status == "canceled"
    assert records.request_cancel(edit_id).status == "canceled"
    assert records.claim_attempt(edit_id, job) is None
    assert count(records, "procrastinate_jobs") == 0


def test_results_come_in_order_and_in_time_only(migrated: str, records: Records) -> None:
    short = Records(migrated, result_ttl=0.2)
    edit_id = new_edit(short)
    with pytest.raises(Conflict) as early:
        short.list_results(edit_id)
    assert early.value.code == "not_ready"
    attempt = claim(short, edit_id).attempt
    results = [result(edit_id, name) for name in ("b.obj", "a.obj")]
    assert short.publish(edit_id, attempt, results, {})
    assert short.list_results(edit_id) == results
    assert short.get_result(edit_id, "a.obj") == results[1]
    with pytest.raises(NotFound):
        short.get_result(edit_id, "c.obj")
    assert short.expire_results() == []
    time.sleep(0.3)
    assert short.expire_results() == ["results/x"] * 2
    with pytest.raises(Gone):
        short.list_results(edit_id)
    assert short.expire_results() == []
    short.close()


def test_a_finished_edit_can_be_forgotten(records: Records) -> None:
    edit_id = new_edit(records)
    with pytest.raises(Conflict):
        records.delete_edit(edit_id)
    attempt = claim(records, edit_id).attempt
    records.publish(edit_id, attempt, [result(edit_id)], {})
    assert records.unnamed_blobs(["results/x", "results/y"]) == ["results/y"]
    assert records.delete_edit(edit_id) == ["results/x"]
    with pytest.raises(NotFound):
        records.get_edit(edit_id)
    assert count(records, "events") == count(records, "results") == 0


def heard_after(records: Records) -> tuple[float, float]:
    """Seconds from a change until who waits for it hears, and those of asking once it is done."""
    edit_id = new_edit(records)
    attempt = claim(records, edit_id).attempt
    told: list[float] = []

    def publish() -> None:
        time.sleep(0.2)
        told.append(time.monotonic())
        records.publish(edit_id, attempt, [], {})

    thread = threading.Thread(target=publish)
    thread.start()
    edit = records.wait_for_change(edit_id, records.get_edit(edit_id).last_seq, 10.0)
    heard = time.monotonic()
    thread.join()
    assert edit.status == "succeeded"
    began = time.monotonic()
    assert records.wait_for_change(edit_id, 0, 10.0).finished
    return heard - told[0], time.monotonic() - began


def test_watchers_hear_of_changes_soon(records: Records) -> None:
    """Once in five at least: a busy machine delays some, who is not told never hears so soon."""
    told, asked = zip(*(heard_after(records) for _ in range(5)), strict=True)
    assert min(told) < 0.5
    assert min(asked) < 1.0


def test_a_restart_of_the_database_only_delays(tmp_path: Path) -> None:
    server = EmbeddedPostgres(tmp_path)
    server.start()
    records = Records(server.url, patience=20.0)
    records.migrate()
    edit_id = new_edit(records)
    with records.watch(edit_id) as watch:
        assert server.pid is not None
        kill(server.pid)
        answers: list[EditRecord] = []
        asking = threading.Thread(target=lambda: answers.append(records.get_edit(edit_id)))
        asking.start()
        time.sleep(0.3)
        server.start()
        asking.join(20.0)
        assert answers[0].status == "queued"
        while watch.wait(0.5):
            pass
        records.request_cancel(edit_id)
        assert watch.wait(5.0)
    server.stop()
    with pytest.raises(Unavailable):
        records.ping()
    records.close()
