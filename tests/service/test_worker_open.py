"""Workers that keep edits open: what starts from one is as any other, and harms it as little."""

from __future__ import annotations

from collections.abc import Iterator

import psutil
import pytest

from service.stores.records import Records
from tests.service.core import (
    Workers,
    eventually,
    finished,
    gone,
    holder,
    kill,
    new_edit,
    until_running,
    written,
    zygote_of,
)

pytest_plugins = ["tests.service.core_fixtures"]


@pytest.fixture(scope="module")
def shared(migrated: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workers]:
    made = Workers(migrated, tmp_path_factory.mktemp("worker with open edits"))
    made.start(open_edits=2, job_memory_bytes=300 * 1024**2, job_seconds=5.0)
    yield made
    made.end()


def test_what_starts_from_an_open_edit_harms_neither_it_nor_others(
    records: Records, shared: Workers
) -> None:
    first, other = holder(records, shared, "first"), holder(records, shared, "other")
    assert first != other
    for action, code in (("segfault", "worker_crashed"), ("hang", "time_limit")):
        broken = finished(records, new_edit(records, {"name": "first", "weights": {"do": action}}))
        assert broken.error is not None
        assert (broken.attempt, broken.error["errors"][0]["code"]) == (1, code)
    canceled = new_edit(records, {"name": "first", "weights": {"do": "hang"}})
    until_running(records, canceled)
    records.request_cancel(canceled)
    assert finished(records, canceled).status == "canceled"
    for name, pid in (("other", other), ("first", first)):
        assert written(records, shared, new_edit(records, {"name": name})) == f"from {pid} []"
    assert psutil.Process(first).parent() == zygote_of(shared.running[0])


def test_an_edit_whose_open_one_is_killed_does_everything_itself(
    records: Records, shared: Workers
) -> None:
    killed = holder(records, shared, "killed")
    running = new_edit(records, {"name": "killed", "weights": {"seconds": 2.0}})
    until_running(records, running)
    eventually(lambda: bool(psutil.Process(killed).children()))
    kill(killed)
    assert written(records, shared, running) == " []"
    eventually(lambda: gone(killed))
    eventually(
        lambda: written(records, shared, new_edit(records, {"name": "killed"})).startswith("from ")
    )
