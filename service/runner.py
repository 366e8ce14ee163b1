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
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from resource import getpagesize
from typing import Any, Literal

from service.child import LENGTH, ChildError
from service.jobtypes import Event

__all__ = ["Call", "ChildError", "Ending", "Outcome", "Runner", "RunnerError"]

Ending = Literal["returned", "raised", "crashed", "time_limit", "memory_limit", "canceled", "lost"]

_TICK_SECONDS = 0.05
_READY_SECONDS = 120.0
_STOP_SECONDS = 5.0
_RECEIVE = 256 * 1024


class RunnerError(RuntimeError):
    """The process that children come from cannot be started."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a call ended.

    ``value`` is what the function returned; ``error`` the exception that it raised (an
    ``EngineError`` or ``DomainError`` as itself, anything else as a ``ChildError`` that has the
    child's traceback as its note); ``detail`` says for a person how it crashed or which limit it
    met. ``lost`` says nothing against the function: the process that children come from was
    killed, and the child with it.
    """

    ending: Ending
    value: Any = None
    error: Exception | None = None
    detail: str = ""
    seconds: float = 0.0
    peak_bytes: int = 0


@dataclass(slots=True)
class _Fate:
    """What the zygote tells of the child."""

    pid: int | None = None
    status: int | None = None
    peak_bytes: int = 0
    _text: bytes = b""

    def read(self, data: bytes) -> None:
        *lines, self._text = (self._text + data).split(b"\n")
        for line in lines:
            for name, value in json.loads(line).items():
                setattr(self, name, value)


@dataclass(slots=True)
class _Answers:
    """What the child tells of itself."""

    final: tuple[str, Any] | None = None
    _data: bytearray = field(default_factory=bytearray)

    def read(self, data: bytes) -> Iterator[Event]:
        self._data += data
        while len(self._data) >= LENGTH.size:
            end = LENGTH.size + LENGTH.unpack_from(self._data)[0]
            if len(self._data) < end:
                return
            kind, value = pickle.loads(self._data[LENGTH.size : end])
            del self._data[:end]
            if kind == "event":
                yield value
            else:
                self.final = (kind, value)


class Call:
    """A function that runs in its own process. Made by ``Runner.start``."""

    def __init__(
        self,
        stream: socket.socket,
        fate: int,
        kill: Callable[[], None],
        *,
        seconds: float,
        memory_bytes: int,
        on_event: Callable[[Event], None] | None,
    ) -> None:
        self._stream = stream
        self._fate_pipe = fate
        self._kill = kill
        self._seconds = seconds
        self._memory_bytes = memory_bytes
        self._on_event = on_event
        self._started = time.monotonic()
        self._fate = _Fate()
        self._answers = _Answers()
        self._verdict: tuple[Ending, str] | None = None
        self._canceled = threading.Event()
        self._listening = True

    def cancel(self) -> None:
        """Kill the child; from any thread, any number of times."""
        self._canceled.set()
        self._kill()

    def result(self) -> Outcome:
        """Wait for the end and say what it was; once, from one thread."""
        try:
            while self._pump():
                self._judge()
        finally:
            self._kill()
            self._stream.close()
            os.close(self._fate_pipe)
        return self._outcome()

    def _pump(self) -> bool:
        """Take in what there is; False once the child is dead and all is read."""
        handles: list[Any] = [self._fate_pipe]
        if self._listening:
            handles.append(self._stream)
        ready, _, _ = select.select(handles, [], [], _TICK_SECONDS)
        if self._stream in ready:
            self._receive()
        if self._fate_pipe not in ready:
            return True
        data = os.read(self._fate_pipe, 4096)
        self._fate.read(data)
        if data:
            return True
        while self._listening:
            self._receive()
        return False

    def _receive(self) -> None:
        try:
            data = self._stream.recv(_RECEIVE)
        except (BlockingIOError, ConnectionResetError):
            data = b""
        for event in self._answers.read(data):
            if self._on_event is not None:
                self._on_event(event)
        self._listening = bool(data) and self._answers.final is None

    def _judge(self) -> None:
        """Kill a child that has had too much time or memory."""
        if self._verdict is not None:
            return
        if time.monotonic() - self._started > self._seconds:
            self._verdict = "time_limit", f"it took longer than {self._seconds:g} s"
        elif self._fate.pid is not None and _resident(self._fate.pid) > self._memory_bytes:
            self._verdict = "memory_limit", _memory_detail(self._memory_bytes)
        if self._verdict is not None:
            self._kill()

    def _outcome(self) -> Outcome:
        value: Any = None
        error: Exception | None = None
        match self._answers.final:
            case ("returned", answer):
                ending, detail, value = "returned", "", answer
            case ("raised", raised):
                ending, detail, error = "raised", str(raised), raised
            case ("memory", _):
                ending, detail = "memory_limit", _memory_detail(self._memory_bytes)
            case _:
                ending, detail = self._death()
        seconds = time.monotonic() - self._started
        return Outcome(ending, value, error, detail, seconds, self._fate.peak_bytes)

    def _death(self) -> tuple[Ending, str]:
        """Why there was no answer."""
        if self._canceled.is_set():
            return "canceled", "it was canceled"
        if self._verdict is not None:
            return self._verdict
        if self._fate.status is None:
            return "lost", "its process was lost"
        return "crashed", _describe_death(self._fate.status)


class Runner:
    """Starts children from a zygote that has ``preload`` imported already; thread-safe.

    ``preload`` names modules, or ``module:function`` for a function to call once after import.
    """

    def __init__(self, preload: Sequence[str] = ("engine", "service.jobs")) -> None:
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


def _resident(pid: int) -> int:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * getpagesize()
    except (FileNotFoundError, ProcessLookupError):
        return 0


def _memory_detail(memory_bytes: int) -> str:
    return f"it needed more than {memory_bytes / 1024**2:.0f} MiB of memory"


def _describe_death(status: int) -> str:
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        return f"its process was ended by {signal.Signals(-code).name}"
    return f"its process exited with code {code} and without an answer"
