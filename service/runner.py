"""Run a function in a fresh child process that can be limited, watched and killed.

Children are forked from a zygote, a process of its own that has the engine imported, so a start
takes milliseconds and the caller may have threads. A child that crashes, hangs or eats memory
ends its own call and nothing else.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

from service.calls import Call, Ending, Limits, Outcome
from service.child import ChildError
from service.jobtypes import Event
from service.origin import Origin, OriginLostError

__all__ = ["Call", "ChildError", "Ending", "Limits", "Outcome", "Runner", "RunnerError"]

_READY_SECONDS = 120.0
_STOP_SECONDS = 5.0
_HUGE_PAGES = {"GLIBC_TUNABLES": "glibc.malloc.hugetlb=1"}
"""A fork copies the table of a process' pages: the fewer they are, the sooner a child starts."""
Value = TypeVar("Value")


class RunnerError(RuntimeError):
    """The process that children come from cannot be started."""


class Runner:
    """Starts children from a zygote that has ``preload`` imported already; thread-safe.

    ``preload`` names modules, or ``module:function`` for a function to call once after import.
    """

    def __init__(self, preload: Sequence[str] = ("service.jobs:load_kept_kernels",)) -> None:
        self._preload = tuple(preload)
        self._guard = threading.Lock()
        self._ready = False
        self._closed = False
        self._origin, self._zygote = self._spawn()

    def start(
        self,
        function: str,
        payload: object,
        limits: Limits,
        *,
        on_event: Callable[[Event], None] | None = None,
    ) -> Call:
        """Start ``module:function(payload, report)`` in a fresh child."""
        return self._asked(
            lambda origin: origin.start(function, payload, limits, on_event=on_event)
        )

    def open(
        self,
        function: str,
        payload: object,
        door: socket.socket,
        limits: Limits,
    ) -> Origin:
        """A process whose children do what ``module:function(payload)`` returns; see ``Origin``.

        It goes with the zygote.
        """
        return self._asked(lambda origin: origin.open(function, payload, door, limits))

    def call(
        self,
        function: str,
        payload: object,
        limits: Limits,
        *,
        on_event: Callable[[Event], None] | None = None,
    ) -> Outcome:
        """``start`` and wait for the end; once more if the child was lost.

        For functions without effects. ``on_event`` is called on the calling thread.
        """
        start = partial(self.start, function, payload, limits)
        outcome = start(on_event=on_event).result()
        return start(on_event=on_event).result() if outcome.ending == "lost" else outcome

    def wait_until_ready(self) -> None:
        """Until everything is imported; RunnerError when that fails."""
        with self._guard:
            self._await_zygote()

    def close(self) -> None:
        """Kill all children and the process that they come from."""
        with self._guard:
            self._closed = True
            self._origin.close()
            if not self._ready:  # it has no children, and hears nothing while it imports
                self._zygote.kill()
            try:
                self._zygote.wait(_STOP_SECONDS)
            except subprocess.TimeoutExpired:
                self._zygote.kill()
                self._zygote.wait()

    def _spawn(self) -> tuple[Origin, subprocess.Popen[bytes]]:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "service.zygote", str(theirs.fileno()), *self._preload]
        with theirs:
            zygote = subprocess.Popen(
                command,
                env={**os.environ, **_HUGE_PAGES},
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        return Origin(ours), zygote

    def _await_zygote(self) -> None:
        """A living zygote that answers; a new one if the last was killed."""
        if self._closed:
            raise RunnerError("the runner is closed")
        if self._zygote.poll() is not None and self._ready:
            self._origin.close()
            self._ready = False
            self._origin, self._zygote = self._spawn()
        if not self._ready:
            if "bytes" not in self._origin.wait_until_ready(_READY_SECONDS):
                raise RunnerError(f"a process with {', '.join(self._preload)} cannot be started")
            self._ready = True

    def _asked(self, ask: Callable[[Origin], Value]) -> Value:
        with self._guard:
            self._await_zygote()
            try:
                return ask(self._origin)
            except OriginLostError:  # killed this very moment: once more, with its successor
                self._zygote.wait(_STOP_SECONDS)
                self._await_zygote()
                return ask(self._origin)
