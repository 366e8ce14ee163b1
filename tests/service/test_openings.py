"""Edits that are kept open: which are alike, and how many stay."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from service.jobtypes import EditJob, Json
from service.openings import Openings, Room, alike
from service.runner import Limits, Runner
from service.schemas import EditDocument
from tests.service.core import eventually, gone, kill

MIB = 1024**2
LIMITS = Limits(30.0, 500 * MIB)


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    made = Runner(("tests.service.fake_jobs",))
    made.wait_until_ready()
    yield made
    made.close()


def document(**changed: object) -> Json:
    whole = {
        "source": "msh_a",
        "targets": [{"mesh": "msh_b", "name": "smile"}],
        "control_points": {
            "points": [
                {"name": "chin", "at": {"vertex": 3}, "to": {"smile": {"vertex": 3}}},
                {"name": "brow", "at": {"vertex": 7}, "move": [0.0, 0.0, 1.0]},
            ]
        },
    }
    return EditDocument.model_validate(whole | changed).model_dump(mode="json")


def points(**changed: object) -> Json:
    first, brow = document()["control_points"]["points"]
    return {"points": [first, brow | changed]}


def test_edits_are_alike_that_differ_in_weights_moves_and_output() -> None:
    key = alike(document())
    for same in (
        document(weights={"smile": 0.3}),
        document(distance={"smile": 0.3}, frames=7),
        document(output={"formats": ["obj", "glb"]}),
        document(output={"figures": False}),
        document(keyframes=[{"time": 0, "weights": {}}, {"time": 1, "weights": {"smile": 1}}]),
        document(control_points=points(move=[1.0, 0.0, 0.0])),
        document(control_points=points(move=None, fixed=True)),
        document(control_points=points(move=None, weights={"smile": 0.2})),
    ):
        assert alike(same) == key
    chin, brow = document()["control_points"]["points"]
    moved = chin | {"moved_to": {"smile": {"vertex": 5}}}
    assert alike(document(control_points={"points": [moved, brow]})) == key
    for other in (
        document(source="msh_b"),
        document(targets=[{"mesh": "msh_c", "name": "smile"}]),
        document(control_points=points(at={"vertex": 8})),
        document(control_points=points(move=None, to={"smile": {"vertex": 4}})),
        document(control_points=points() | {"auto": 30}),
        document(options={"iteration": "paper"}),
        document(output={"histogram_bins": 9}),
    ):
        assert alike(other) != key


class Kept:
    """Openings of documents that are only a number, each holding so much memory."""

    def __init__(self, runner: Runner, scratch: Path, room: Room, each: int) -> None:
        self.openings = Openings(
            runner,
            "tests.service.fake_jobs:keep_holding",
            LIMITS,
            room,
            folder=scratch / "open",
            scratch=scratch,
        )
        self._each, self._scratch = each, scratch

    def job(self, number: int) -> EditJob:
        held = {"number": number, "frames": self._each}
        return EditJob("edt_x", held, {}, self._scratch, self._scratch)

    def keep(self, number: int) -> int:
        self.openings.keep(self.job(number).document, 0, lambda folder: self.job(number))
        eventually(lambda: self.holder(number) is not None)
        holder = self.holder(number)
        assert holder is not None
        return holder

    def job_of_nothing(self, folder: Path) -> EditJob:
        raise AssertionError("not to be opened")

    def holder(self, number: int) -> int | None:
        """The process that holds the edit open; using it so is a use."""
        with self.openings.started(self.job(number), lambda event: None) as call:
            return None if call is None else call.result().value


Keeping = Callable[..., Kept]


@pytest.fixture
def keeping(runner: Runner, tmp_path: Path) -> Iterator[Keeping]:
    made: list[Kept] = []

    def make(room: Room, each: int = MIB) -> Kept:
        made.append(Kept(runner, tmp_path, room, each))
        return made[-1]

    yield make
    for kept in made:
        kept.openings.close()


def test_those_unused_for_longest_make_room(keeping: Keeping) -> None:
    kept = keeping(Room(2, 10**12))
    first, second = kept.keep(1), kept.keep(2)
    assert kept.holder(1) == first
    third = kept.keep(3)
    assert kept.holder(2) is None
    eventually(lambda: gone(second))
    assert (kept.holder(1), kept.holder(3)) == (first, third)
    assert len({first, second, third, os.getpid()}) == 4


def test_memory_is_bounded(keeping: Keeping) -> None:
    kept = keeping(Room(10, 100 * MIB), 40 * MIB)
    holders = [kept.keep(number) for number in range(4)]
    assert [kept.holder(number) is None for number in range(4)] == [True, True, False, False]
    eventually(lambda: all(gone(pid) for pid in holders[:2]))


def test_what_could_not_stay_is_not_opened(keeping: Keeping) -> None:
    small = keeping(Room(10, 100 * MIB))
    small.openings.keep(small.job(1).document, 101 * MIB, small.job_of_nothing)
    none = keeping(Room(0, 10**12))
    none.openings.keep(none.job(1).document, 0, none.job_of_nothing)


def test_a_killed_one_is_missed_once_and_opened_again(keeping: Keeping) -> None:
    kept = keeping(Room(2, 10**12))
    first = kept.keep(1)
    kill(first)
    eventually(lambda: gone(first))
    assert kept.holder(1) is None
    assert kept.keep(1) != first


def test_workers_of_a_machine_start_from_each_others(keeping: Keeping) -> None:
    one, other = keeping(Room(2, 10**12)), keeping(Room(2, 10**12))
    holder = one.keep(1)
    assert other.holder(1) == holder
    other.openings.keep(other.job(1).document, 0, other.job_of_nothing)
    second = one.keep(2)
    assert other.holder(1) == holder
    one.keep(3)
    assert (other.holder(1), other.holder(2)) == (holder, None)
    eventually(lambda: gone(second))
    one.openings.close()
    assert other.holder(1) is None
    assert other.keep(1) not in {holder, None}
