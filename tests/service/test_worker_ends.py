"""The ends of workers: killed, told to stop, or stopped with an edit that does not end."""

from __future__ import annotations

import signal

import psutil

from service.stores.records import Records
from tests.service.core import (
    Workers,
    child_of,
    eventually,
    finished,
    gone,
    holder,
    new_edit,
    until_running,
    written,
    zygote_of,
)

pytest_plugins = ["tests.service.core_fixtures"]


def test_a_killed_worker_loses_its_edit_to_another(records: Records, workers: Workers) -> None:
    edit_id = new_edit(records, {"seconds": 1.5})
    first = workers.start()
    child, zygote = child_of(first), zygote_of(first)
    until_running(records, edit_id)
    workers.start()
    first.kill()
    first.wait()
    edit = finished(records, edit_id)
    assert (edit.status, edit.attempt) == ("succeeded", 2)
    eventually(lambda: gone(child.pid) and gone(zygote.pid))


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


def test_a_stopped_worker_leaves_nothing_open(records: Records, workers: Workers) -> None:
    worker = workers.start(open_edits=1)
    pid = holder(records, workers, "stopped")
    worker.terminate()
    assert worker.wait(30) == 0
    eventually(lambda: gone(pid))


def test_workers_of_a_machine_share_what_is_open(records: Records, workers: Workers) -> None:
    first, second = workers.start(open_edits=2), workers.start(open_edits=2)
    holder(records, workers, "shared")
    slow = {"name": "shared", "weights": {"seconds": 0.5}}
    edits = [new_edit(records, slow) for _ in range(6)]
    eventually(lambda: records.queue_counts().get("running") == 2)
    pids = {written(records, workers, edit_id) for edit_id in edits}
    assert len(pids) == 1
    (pid,) = {int(text.split()[1]) for text in pids}
    keeper = next(one for one in (first, second) if pid in descendants(one.pid))
    for worker in (keeper, first, second):
        worker.kill()
        worker.wait()
    eventually(lambda: gone(pid))


def descendants(pid: int) -> set[int]:
    return {one.pid for one in psutil.Process(pid).children(recursive=True)}
