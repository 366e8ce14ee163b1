"""Processes that are kept open: their children start where they are, and harm nobody."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from service.doors import Doors
from service.origin import Origin, OriginLostError
from service.runner import Call, Limits, Runner
from tests.service.core import eventually, gone, kill

JOBS = "tests.service.fake_jobs:"
MIB = 1024**2


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    made = Runner(("tests.service.fake_jobs",))
    made.wait_until_ready()
    yield made
    made.close()


class Opened:
    """A process that is kept open, and connections to it."""

    def __init__(self, runner: Runner, doors: Doors, name: str, payload: object, seconds: float):
        door, self._name = doors.make()
        limits = Limits(seconds, 300 * MIB)
        with door:
            self.owner = runner.open(JOBS + name, payload, door, limits)
        self.answer = self.owner.wait_until_ready(30.0)
        self._doors = doors
        self._connections: list[Origin] = []

    def connect(self) -> Origin:
        connection = self._doors.enter(self._name)
        assert connection is not None
        self._connections.append(Origin(connection))
        return self._connections[-1]

    def close(self) -> None:
        self.owner.close()
        for connection in self._connections:
            connection.close()


Opening = Callable[..., Opened]


@pytest.fixture
def opening(runner: Runner, tmp_path: Path) -> Iterator[Opening]:
    made: list[Opened] = []
    doors = Doors(tmp_path / ("a long name " * 12))

    def open_(name: str, payload: object = None, seconds: float = 30.0) -> Opened:
        made.append(Opened(runner, doors, name, payload, seconds))
        return made[-1]

    yield open_
    for one in made:
        one.close()


def start(origin: Origin, payload: object = None, seconds: float = 30.0) -> Call:
    return origin.start("", payload, Limits(seconds, 300 * MIB))


def refuses(origin: Origin) -> bool:
    """Whether it can not be asked any more; what it is asked while it dies is lost with it."""
    try:
        asked = start(origin, "own_pid")
    except OriginLostError:
        return True
    assert asked.result().ending == "lost"
    return False


def test_children_start_from_what_was_opened_and_not_from_each_other(opening: Opening) -> None:
    opened = opening("keep_counting", 1)
    assert opened.answer["bytes"]
    answers = [start(opened.connect(), payload).result().value for payload in (2, 3)]
    assert [seen for _, seen in answers] == [[1, 2], [1, 3]]
    (holder,) = {parent for parent, _ in answers}
    opened.close()
    eventually(lambda: gone(holder))


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
    opening: Opening, action: str, ending: str
) -> None:
    opened = opening("keep_obeying")
    origin = opened.connect()
    holder = start(origin, "parent_pid").result().value
    neighbours = [start(origin, "hang"), start(opened.connect(), "hang")]
    outcome = start(origin, action, seconds=0.5 if action == "hang" else 20.0).result()
    assert outcome.ending == ending
    assert outcome.peak_bytes < 600 * MIB
    assert start(origin, "parent_pid").result().value == holder
    for neighbour in neighbours:
        neighbour.cancel()
        assert neighbour.result().ending == "canceled"


def test_what_a_child_leaves_behind_goes_with_it(opening: Opening) -> None:
    left = start(opening("keep_obeying").connect(), "leave_a_grandchild").result().value
    eventually(lambda: gone(left))


def test_a_caller_that_goes_takes_its_own_children_along(opening: Opening) -> None:
    opened = opening("keep_obeying")
    first, other = opened.connect(), opened.connect()
    holder = psutil.Process(start(first, "parent_pid").result().value)
    kept = start(other, "hang")
    eventually(lambda: len(holder.children()) == 1)
    left = start(first, "hang")
    eventually(lambda: len(holder.children()) == 2)
    first.close()
    assert left.result().ending == "crashed"
    eventually(lambda: len(holder.children()) == 1)
    kept.cancel()
    assert kept.result().ending == "canceled"


def test_a_killed_one_loses_its_children_only_and_can_not_be_asked_again(opening: Opening) -> None:
    origin, other = opening("keep_obeying").connect(), opening("keep_obeying").connect()
    holder = start(origin, "parent_pid").result().value
    lost, kept = start(origin, "hang"), start(other, "hang")
    kill(holder)
    assert lost.result().ending == "lost"
    eventually(lambda: refuses(origin))
    kept.cancel()
    assert kept.result().ending == "canceled"
    assert start(other, "own_pid").result().ending == "returned"


def test_what_cannot_be_opened_is_told(opening: Opening) -> None:
    assert opening("keep_refusing").answer == {"failed": "TopologyError: no surface"}
    assert opening("keep_hanging", seconds=0.3).answer == {}
    assert "MemoryError" in str(opening("keep_eating", 64 * 1024 * MIB).answer["failed"])


def test_nothing_stays_open_when_the_zygote_goes(tmp_path: Path) -> None:
    before = set(psutil.Process().children())
    runner = Runner(("tests.service.fake_jobs",))
    runner.wait_until_ready()
    (zygote,) = set(psutil.Process().children()) - before
    opened = Opened(runner, Doors(tmp_path), "keep_obeying", None, 30.0)
    running = start(opened.connect(), "hang")
    eventually(lambda: len(zygote.children(recursive=True)) == 2)
    family = zygote.children(recursive=True)
    kill(zygote.pid)
    assert running.result().ending == "lost"
    eventually(lambda: all(gone(one.pid) for one in family))
    opened.close()
    runner.close()
