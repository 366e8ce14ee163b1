"""What happens inside a forked child: limits, the function, and its answer on a stream."""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import os
import pickle
import resource
import signal
import socket
import struct
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from engine.errors import EngineError
from service.domain import DomainError
from service.jobtypes import Event, Work

LENGTH = struct.Struct(">I")
"""Each message on the stream is its length and a pickled ``(kind, value)``; the answer is last."""

_MORE_EXPENDABLE = 100
"""Added to a process' OOM score: when memory runs out, what was forked goes before its parent."""

_VIRTUAL_ALLOWANCE = 512 * 1024**2
"""Address space beyond the limit on real memory: stacks, arenas and mapped files are not used."""


class ChildError(Exception):
    """An exception that is none of ours, with the child's traceback as its notes."""


def run_child(request: int, stream: int, memory_bytes: int, opened: Work | None) -> NoReturn:
    """Do what the memory file ``request`` asks for, answer on ``stream``, and exit.

    ``opened``: what to do with the payload in place of the function that the request names.
    """
    isolate(memory_bytes)
    function, payload = read_request(request)
    with socket.socket(fileno=stream) as answers:
        send = _sender(answers)
        kind, value = _perform(opened or function, payload, send)
        send("peak_bytes", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
        send(kind, value)
    os._exit(0)


def read_request(request: int) -> tuple[str, Any]:
    """The ``module:function`` and the payload in the memory file ``request``."""
    with os.fdopen(request, "rb") as file:
        file.seek(0)
        return pickle.load(file)


def named(name: str) -> Callable[..., Any]:
    """``module:function``."""
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(module), function)


def isolate(memory_bytes: int) -> None:
    """A session of its own, and limits: what this process does, it does to itself."""
    os.setsid()
    for number in (signal.SIGCHLD, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    os.dup2(2, 1)
    faulthandler.enable()
    score = Path("/proc/self/oom_score_adj")
    with contextlib.suppress(PermissionError):  # where the process may not be inspected either
        score.write_text(str(min(int(score.read_text()) + _MORE_EXPENDABLE, 1000)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    space = used + memory_bytes + _VIRTUAL_ALLOWANCE
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    if most != resource.RLIM_INFINITY:
        space = min(space, most)
    resource.setrlimit(resource.RLIMIT_AS, (space, space))


def _sender(stream: socket.socket) -> Callable[[str, Any], None]:
    guard = threading.Lock()

    def send(kind: str, value: Any) -> None:
        message = pickle.dumps((kind, value))
        with guard, contextlib.suppress(BrokenPipeError):  # the caller is gone, we are soon
            stream.sendall(LENGTH.pack(len(message)) + message)

    return send


def _perform(work: Work | str, payload: Any, send: Callable[[str, Any], None]) -> tuple[str, Any]:
    def report(event: Event) -> None:
        send("event", event)

    try:
        perform = named(work) if isinstance(work, str) else work
        return "returned", perform(payload, report)
    except MemoryError:
        return "memory", None
    except (EngineError, DomainError) as error:
        return "raised", error
    except BaseException as error:  # the border of the process: nothing lies above
        unknown = ChildError(f"{type(error).__name__}: {error}")
        unknown.add_note(traceback.format_exc())
        return "raised", unknown
