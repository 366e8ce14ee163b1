"""Run a function in a fresh child process that can be limited, watched and killed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from service.jobtypes import Event

Ending = Literal["returned", "raised", "crashed", "time_limit", "memory_limit", "canceled"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a call ended.

    ``value`` is what the function returned; ``error`` the exception that it raised (an
    ``EngineError`` or ``DomainError`` as itself, anything else as a ``ChildError`` with the
    child's traceback); ``detail`` says for a person how it crashed or which limit it met.
    """

    ending: Ending
    value: Any = None
    error: Exception | None = None
    detail: str = ""
    seconds: float = 0.0
    peak_bytes: int = 0


class ChildError(Exception):
    """An exception of the child that is none of ours: its text, type and traceback."""


class Call:
    """A function that runs in its own process."""

    def result(self) -> Outcome:
        """Wait for the end; call it once, from one thread."""
        raise NotImplementedError

    def cancel(self) -> None:
        """Kill the process; from any thread, any number of times."""
        raise NotImplementedError


class Runner:
    """Starts children from a process that has ``preload`` imported already."""

    def __init__(self, preload: Sequence[str] = ("engine", "service.jobs")) -> None:
        raise NotImplementedError

    def start(
        self,
        function: str,
        payload: object,
        *,
        seconds: float,
        memory_bytes: int,
        on_event: Callable[[Event], None] | None = None,
    ) -> Call:
        """Start ``module:function(payload, report)`` in a fresh child."""
        raise NotImplementedError

    def call(
        self,
        function: str,
        payload: object,
        *,
        seconds: float,
        memory_bytes: int,
        on_event: Callable[[Event], None] | None = None,
    ) -> Outcome:
        """``start`` and wait; thread-safe. ``on_event`` is called on the calling thread."""
        return self.start(
            function, payload, seconds=seconds, memory_bytes=memory_bytes, on_event=on_event
        ).result()

    def close(self) -> None:
        """Kill all children and the process that they come from."""
        raise NotImplementedError
