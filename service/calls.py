"""A function that runs in a child: what it says, what becomes of it, and how it ended."""

from __future__ import annotations

import json
import os
import pickle
import select
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from resource import getpagesize
from typing import Any, Literal

from service.child import LENGTH
from service.jobtypes import Event

Ending = Literal["returned", "raised", "crashed", "time_limit", "memory_limit", "canceled", "lost"]

_TICK_SECONDS = 0.05
_RECEIVE = 256 * 1024


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
    peak_bytes: int = 0
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
            elif kind == "peak_bytes":
                self.peak_bytes = value
            else:
                self.final = (kind, value)


@dataclass(frozen=True, slots=True)
class Limits:
    """What one call may take, or all that is called in an opened process together."""

    seconds: float
    memory_bytes: int


class Call:
    """A function that runs in its own process. Made by ``Runner.start``."""

    def __init__(
        self,
        stream: socket.socket,
        fate: int,
        kill: Callable[[], None],
        limits: Limits,
        *,
        on_event: Callable[[Event], None] | None,
    ) -> None:
        self._stream = stream
        self._fate_pipe = fate
        self._kill = kill
        self._limits = limits
        self._on_event = on_event
        self._started = self._look_at = time.monotonic()
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
        """Wait for the answer or the death, and say what it was; once, from one thread.

        A child that has answered has nothing more to do: its process ends behind our back.
        """
        try:
            while self._answers.final is None and self._pump():
                if time.monotonic() >= self._look_at:
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
        self._look_at = time.monotonic() + _TICK_SECONDS
        if self._verdict is not None:
            return
        if time.monotonic() - self._started > self._limits.seconds:
            self._verdict = "time_limit", f"it took longer than {self._limits.seconds:g} s"
        elif self._fate.pid is not None and _resident(self._fate.pid) > self._limits.memory_bytes:
            self._verdict = "memory_limit", _memory_detail(self._limits.memory_bytes)
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
                ending, detail = "memory_limit", _memory_detail(self._limits.memory_bytes)
            case _:
                ending, detail = self._death()
        seconds = time.monotonic() - self._started
        peak_bytes = self._fate.peak_bytes or self._answers.peak_bytes
        return Outcome(ending, value, error, detail, seconds, peak_bytes)

    def _death(self) -> tuple[Ending, str]:
        """Why there was no answer."""
        if self._canceled.is_set():
            return "canceled", "it was canceled"
        if self._verdict is not None:
            return self._verdict
        if self._fate.status is None:
            return "lost", "its process was lost"
        return "crashed", _describe_death(self._fate.status)


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
