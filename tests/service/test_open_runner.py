"""Processes that are kept open: their children start where they are, and harm nobody."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import psutil
import pytest

from service.origin import Origin, OriginLostError
from service.runner import Call, Runner
from tests.service.core import eventually, gone, kill

JOBS = "tests.service.fake_jobs:"
MIB = 1024**2


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    made = Runner(("engine", "tests.service.fake_jobs"))
    made.wait_until_ready()
    yield made
    made.close()


@contextmanager
def opened(
    runner: Runner, name: str, payload: object = None, seconds: float = 30.0
) -> Iterator[tuple[Origin, dict[str, object]]]:
    memory_bytes = 300 * MIB
    origin = runner.open(JOBS + name, payload, seconds=seconds, memory_bytes=memory_bytes)
    yield origin, origin.wait_until_ready(30.0)
    origin.close()


def start(origin: Origin, payload: object = None, seconds: float = 30.0) -> Call:
    return origin.start("", payload, seconds=seconds, memory_bytes=300 * MIB)


def test_children_start_from_what_was_opened_and_not_from_each_other(runner: Runner) -> None:
    with opened(runner, "keep_counting", 1) as (origin, answer):
        assert answer["bytes"]
        answers = [start(origin, payload).result().value for payload in (2, 3)]
        assert [seen for _, seen in answers] == [[1, 2], [1, 3]]
        (holder,) = {parent for parent, _ in answers}
    eventually(lambda: gone(holder), 5.0)


@pytest.mark.parametrize(
    ("action", "ending"),
    [
        ("segfault", "crashed"),
        ("eat_memory", "memory_limit"),
        ("eat_memory_at_once", "memory_limit"),
        ("bug", "raised"),
        ("hang", "time_limit"),
    ],
)
def test_a_child_that_misbehaves_takes_nothing_with_it(
    runner: Runner, action: str, ending: str
) -> None:
    with opened(runner, "keep_obeying") as (origin, _):
        holder = start(origin, "parent_pid").result().value
        neighbour = start(origin, "hang")
        outcome = start(origin, action, seconds=0.5 if action == "hang" else 20.0).result()
        assert outcome.ending == ending
        assert outcome.peak_bytes < 600 * MIB
        assert start(origin, "parent_pid").result().value == holder
        neighbour.cancel()
        assert neighbour.result().ending == "canceled"


def test_what_a_child_leaves_behind_goes_with_it(runner: Runner) -> None:
    with opened(runner, "keep_obeying") as (origin, _):
        left = start(origin, "leave_a_grandchild").result().value
        eventually(lambda: gone(left), 5.0)


def test_a_killed_one_loses_its_children_only_and_can_not_be_asked_again(runner: Runner) -> None:
    with (
        opened(runner, "keep_obeying") as (origin, _),
        opened(runner, "keep_obeying") as (other, _),
    ):
        holder = start(origin, "parent_pid").result().value
        lost, kept = start(origin, "hang"), start(other, "hang")
        kill(holder)
        assert lost.result().ending == "lost"
        with pytest.raises(OriginLostError):
            start(origin, "own_pid")
        kept.cancel()
        assert kept.result().ending == "canceled"
        assert start(other, "own_pid").result().ending == "returned"


def test_what_cannot_be_opened_is_told(runner: Runner) -> None:
    with opened(runner, "keep_refusing") as (_, answer):
        assert answer == {"failed": "TopologyError: no surface"}
    with opened(runner, "keep_hanging", seconds=0.3) as (_, answer):
        assert answer == {}
    with opened(runner, "keep_eating", 64 * 1024 * MIB) as (_, answer):
        assert "MemoryError" in str(answer["failed"])


def test_nothing_stays_open_when_the_zygote_goes() -> None:
    before = set(psutil.Process().children())
    runner = Runner(("tests.service.fake_jobs",))
    runner.wait_until_ready()
    (zygote,) = set(psutil.Process().children()) - before
    with opened(runner, "keep_obeying") as (origin, _):
        running = start(origin, "hang")
        eventually(lambda: len(zygote.children(recursive=True)) == 2)
        family = zygote.children(recursive=True)
        kill(zygote.pid)
        assert running.result().ending == "lost"
        eventually(lambda: all(gone(one.pid) for one in family), 5.0)
    runner.close()
