"""Independent pieces of work side by side."""

from __future__ import annotations

import threading

import pytest

from engine.at_once import both, each


def test_both_run_at_the_same_time() -> None:
    meet = threading.Barrier(2, timeout=10.0)
    assert {str(place) for place in both(meet.wait, meet.wait)} == {"0", "1"}


def test_answers_come_in_the_order_of_the_tasks() -> None:
    assert each([lambda number=number: number**2 for number in range(20)]) == [
        number**2 for number in range(20)
    ]
    assert each([]) == []


def test_the_first_task_that_raises_is_heard_when_all_have_ended() -> None:
    ended: list[int] = []

    def work(number: int) -> None:
        if number in (1, 3):
            raise ValueError(f"task {number}")
        ended.append(number)

    with pytest.raises(ValueError, match="task 1"):
        each([lambda number=number: work(number) for number in range(5)])
    assert sorted(ended) == [0, 2, 4]
    with pytest.raises(ValueError, match="task 3"):
        both(lambda: work(3), lambda: work(5))
    assert sorted(ended) == [0, 2, 4, 5]
