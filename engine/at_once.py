"""Independent pieces of work side by side in threads.

Kernels and linear algebra leave the interpreter to others. Tasks must share nothing that one of
them changes, but for dictionaries in which each has keys of its own; of those that raise, the first
one's exception is raised when all have ended.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

First = TypeVar("First")
Second = TypeVar("Second")


def both(first: Callable[[], First], second: Callable[[], Second]) -> tuple[First, Second]:
    """What two tasks return."""
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(second)
        return first(), other.result()


def each(tasks: Sequence[Callable[[], First]]) -> list[First]:
    """What any number of tasks return, in their order; as many at once as there are cores."""
    threads = min(len(tasks), os.cpu_count() or 1)
    if threads < 2:
        return [task() for task in tasks]
    with ThreadPoolExecutor(threads) as pool:
        return [future.result() for future in [pool.submit(task) for task in tasks]]
