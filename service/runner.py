"""Run a function in a fresh child process that can be limited, watched and killed.

Children are forked from a zygote, a process of its own that has the engine imported, so a start
takes milliseconds and the caller may have threads. A child that crashes, hangs or eats memory
ends its own call and nothing else.
"""

from __future__ import annotations

import itertools
import json
import os
import pickle
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from functools import partial

from service.calls import Call, Ending, Outcome
from service.child import ChildError
from service.jobtypes import Event

__all__ = ["Call", "ChildError", "Ending", "Outcome", "Runner", "RunnerError"]

_READY_SECONDS = 120.0
_STOP_SECONDS = 5.0


class RunnerError(RuntimeError):
    """The process that children come from cannot be started."""


class Runner:
    """Starts children from a zygote that has ``preload`` imported already; thread-safe.

    ``preload`` names modules, or ``module:function`` for a function to call once after import.
    """

    def __init__(self, preload: Sequence[str] = ("service.jobs:load_kept_kernels",)) -> None:
        self._preload = tuple(preload)
        self._guard = threading.Lock()
        self._numbers = itertools.count()
        self._ready = False
        self._closed = False
        self._control, self._zygote = self._spawn()

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
        request = os.memfd_create("request")
        ours, theirs = socket.socketpair()
        fate, fate_of_child = os.pipe()
        try:
            with os.fdopen(request, "wb", closefd=False) as file:
                pickle.dump((function, payload), file)
            number, control = self._send(memory_bytes, (request, theirs.fileno(), fate_of_child))
        except BaseException:
            ours.close()
            os.close(fate)
            raise
        finally:
            os.close(request)
            theirs.close()
            os.close(fate_of_child)
        ours.setblocking(False)
        return Call(
            ours,
            fate,
            lambda: self._kill(control, number),
            seconds=seconds,
            memory_bytes=memory_bytes,
            on_event=on_event,
        )

    def call(
        self,
        function: str,
        payload: object,
        *,
        seconds: float,
        memory_bytes: int,
        on_event: Callable[[Event], None] | None = None,
    ) -> Outcome:
        """``start`` and wait for the end; once more if the child was lost.

        For functions without effects. ``on_event`` is called on the calling thread.
        """
        start = partial(self.start, function, payload, seconds=seconds, memory_bytes=memory_bytes)
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
            self._control.close()
            try:
                self._zygote.wait(_STOP_SECONDS)
            except subprocess.TimeoutExpired:
                self._zygote.kill()
                self._zygote.wait()

    def _spawn(self) -> tuple[socket.socket, subprocess.Popen[bytes]]:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "service.zygote", str(theirs.fileno()), *self._preload]
        with theirs:
            zygote = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        return ours, zygote

    def _await_zygote(self) -> None:
        """A living zygote that answers; a new one if the last was killed."""
        if self._closed:
            raise RunnerError("the runner is closed")
        if self._zygote.poll() is not None and self._ready:
            self._control.close()
            self._ready = False
            self._control, self._zygote = self._spawn()
        if not self._ready:
            self._control.settimeout(_READY_SECONDS)
            if self._control.recv(16) != b"ready":
                raise RunnerError(f"a process with {', '.join(self._preload)} cannot be started")
            self._control.settimeout(None)
            self._ready = True

    def _send(self, memory_bytes: int, handles: Sequence[int]) -> tuple[int, socket.socket]:
        with self._guard:
            self._await_zygote()
            number = next(self._numbers)
            message = json.dumps({"run": number, "memory_bytes": memory_bytes}).encode()
            try:
                socket.send_fds(self._control, [message], handles)
            except BrokenPipeError:  # killed this very moment: once more, with its successor
                self._zygote.wait(_STOP_SECONDS)
                self._await_zygote()
                socket.send_fds(self._control, [message], handles)
            return number, self._control

    def _kill(self, control: socket.socket, number: int) -> None:
        with self._guard:
            if control is not self._control or self._closed:
                return  # the child went with its zygote
            try:
                control.send(json.dumps({"kill": number}).encode())
            except (BrokenPipeError, ConnectionResetError):
                return
