"""The process that jobs are forked from: everything imported, one thread, never runs a job itself.

Started by ``service.runner`` with one end of a control socket. Requests on it are

``{"do": "run", "id": n, "memory_bytes": n}``, with three file descriptors: the request in a memory
file, a stream for what the child reports, a pipe for what becomes of the child. On the pipe it
writes the child's pid, then its wait status and peak memory.

``{"do": "open", "id": n, "memory_bytes": n, "seconds": s}``, likewise, with a listening socket as
the fourth: forks a process that calls the function in the request, keeps what that returns, and is
then such a process itself, whose children do with their payloads what was returned. In place of the
stream it has a control socket of its own; on it answers ``{"bytes": memory that it shares with no
other}`` when it is ready, or ``{"failed": why}``. Its requests come over connections to the fourth.

``{"do": "kill", "id": n}``. When a connection closes, its caller is gone, and its children are
killed; when the control socket does, all children are killed and the process ends.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import itertools
import json
import os
import select
import signal
import socket
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from service.child import isolate, named, read_request, run_child
from service.jobtypes import Work
from service.processes import die_with_parent

_LONGEST_REQUEST = 4096
_THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True, slots=True)
class _Child:
    pid: int
    fate: int


class _Zygote:
    def __init__(
        self,
        control: socket.socket,
        opened: Work | None = None,
        door: socket.socket | None = None,
    ) -> None:
        self._control = control
        self._opened = opened
        self._doors = () if door is None else (door,)
        self._numbers = itertools.count()
        self._callers = {control: next(self._numbers)}
        self._children: dict[tuple[int, int], _Child] = {}
        self._deaths, wakeup = os.pipe()
        for end in (self._deaths, wakeup):
            os.set_blocking(end, False)
        signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, _noticed)

    def serve(self) -> None:
        """Until the control socket closes."""
        while self._control in self._callers:
            ready, _, _ = select.select([self._deaths, *self._doors, *self._callers], [], [])
            if self._deaths in ready:
                os.read(self._deaths, 4096)
                self._bury()
            for door in self._doors:
                if door in ready:
                    self._callers[door.accept()[0]] = next(self._numbers)
            for caller in [one for one in self._callers if one in ready]:
                self._hear(caller)
        for whose in self._children:
            self._kill(whose)

    def _hear(self, caller: socket.socket) -> None:
        try:
            message, handles, _, _ = socket.recv_fds(caller, _LONGEST_REQUEST, 4)
        except ConnectionResetError:
            message, handles = b"", []
        number = self._callers[caller]
        if not message:
            del self._callers[caller]
            caller.close()
            for whose in [one for one in self._children if one[0] == number]:
                self._kill(whose)
            return
        asked = json.loads(message)
        if asked["do"] == "kill":
            self._kill((number, asked["id"]))
        else:
            self._fork((number, asked["id"]), asked, *handles)

    def _fork(
        self,
        whose: tuple[int, int],
        asked: dict[str, Any],
        request: int,
        stream: int,
        fate: int,
        *door: int,
    ) -> None:
        me = os.getpid()
        pid = os.fork()
        if pid == 0:
            die_with_parent(me)
            signal.set_wakeup_fd(-1)
            for one in (*self._doors, *self._callers):
                one.close()
            for handle in (fate, self._deaths, *(child.fate for child in self._children.values())):
                os.close(handle)
            if asked["do"] == "open":
                _serve_opened(request, stream, door[0], asked["memory_bytes"], asked["seconds"])
            run_child(request, stream, asked["memory_bytes"], self._opened)
        for handle in (request, stream, *door):
            os.close(handle)
        self._children[whose] = _Child(pid, fate)
        _tell(fate, {"pid": pid})

    def _kill(self, whose: tuple[int, int]) -> None:
        child = self._children.get(whose)
        if child is None:
            return  # it ended by itself meanwhile
        os.kill(child.pid, signal.SIGKILL)
        with contextlib.suppress(ProcessLookupError):  # it had not made its group yet
            os.killpg(child.pid, signal.SIGKILL)

    def _bury(self) -> None:
        """Reap the dead, take their own children along, and tell their callers."""
        for whose, child in list(self._children.items()):
            if os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
                continue
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)
            _, status, usage = os.wait4(child.pid, 0)
            _tell(child.fate, {"status": status, "peak_bytes": usage.ru_maxrss * 1024})
            os.close(child.fate)
            del self._children[whose]


def _serve_opened(
    request: int, control: int, door: int, memory_bytes: int, seconds: float
) -> NoReturn:
    """Open what ``request`` asks for and be what its children are forked from."""
    isolate(memory_bytes)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    function, payload = read_request(request)
    with socket.socket(fileno=control) as owner:
        try:
            opened = named(function)(payload)
        except BaseException as error:  # the border of the process: nothing lies above
            owner.send(json.dumps({"failed": f"{type(error).__name__}: {error}"[:2000]}).encode())
            os._exit(1)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        with socket.socket(fileno=door) as listening:
            zygote = _Zygote(owner, opened, listening)
            _freeze()
            owner.send(json.dumps({"bytes": _private_bytes()}).encode())
            zygote.serve()
    os._exit(0)


def _private_bytes() -> int:
    """Memory of this process that no other one shares."""
    lines = Path("/proc/self/smaps_rollup").read_text().splitlines()
    return sum(int(line.split()[1]) for line in lines if line.startswith("Private_")) * 1024


def _freeze() -> None:
    """Keep the collector from writing to what children are to share."""
    gc.collect()
    gc.freeze()


def _noticed(number: int, frame: object) -> None:
    """Only wakes ``select``, by the pipe that ``set_wakeup_fd`` names."""


def _tell(fate: int, message: dict[str, int]) -> None:
    with contextlib.suppress(BrokenPipeError):  # the caller has lost interest
        os.write(fate, json.dumps(message).encode() + b"\n")


def _preload(names: list[str]) -> None:
    """Import modules; ``module:function`` is called as well, to warm what imports leave cold."""
    gc.disable()  # nearly all of what is made here is to stay
    for name in names:
        module, _, function = name.partition(":")
        loaded = importlib.import_module(module)
        if function:
            getattr(loaded, function)()
    _freeze()
    gc.enable()


def main() -> None:
    """``python -m service.zygote <control fd> <preload>…``."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in _THREAD_COUNTS:
        os.environ[name] = "1"
    _preload(sys.argv[2:])
    with socket.socket(fileno=int(sys.argv[1])) as control:
        zygote = _Zygote(control)
        control.send(json.dumps({"bytes": _private_bytes()}).encode())
        zygote.serve()


if __name__ == "__main__":
    main()
