"""The caller's end of a process that children are forked from."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import pickle
import socket
import threading
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from service.calls import Call, Limits
from service.jobtypes import Event

_LONGEST_ANSWER = 4096


class OriginLostError(RuntimeError):
    """The process that children come from has ended."""


class Origin:
    """Asks the process behind ``control`` (see ``service.zygote``) for children; thread-safe.

    ``start`` and ``open`` raise ``OriginLostError`` once that process is gone.
    """

    def __init__(self, control: socket.socket) -> None:
        self._control = control
        self._guard = threading.Lock()
        self._numbers = itertools.count()
        self._closed = False

    def wait_until_ready(self, seconds: float) -> dict[str, Any]:
        """What the process says when it is ready, or fails to be.

        {} if it has ended, or says nothing for so many seconds.
        """
        self._control.settimeout(seconds)
        try:
            answer = self._control.recv(_LONGEST_ANSWER)
        except (ConnectionResetError, TimeoutError):
            answer = b""
        self._control.settimeout(None)
        return json.loads(answer or b"{}")

    def start(
        self,
        function: str,
        payload: object,
        limits: Limits,
        *,
        on_event: Callable[[Event], None] | None = None,
    ) -> Call:
        """Start ``module:function(payload, report)`` in a fresh child.

        In a process that was opened it is what it keeps that is called, whatever the name.
        """
        ours, theirs = socket.socketpair()
        try:
            own = {"memory_bytes": limits.memory_bytes}
            number, fate = self._send("run", own, (function, payload), theirs)
        except BaseException:
            ours.close()
            raise
        ours.setblocking(False)
        return Call(ours, fate, lambda: self._kill(number), limits, on_event=on_event)

    def open(
        self,
        function: str,
        payload: object,
        door: socket.socket,
        limits: Limits,
    ) -> Origin:
        """A process whose children do what ``module:function(payload)`` returns.

        Children are asked for over connections to the listening socket ``door``. The process is
        forked from this one and ends with it, or when what is returned is closed. Its seconds are
        those until it is ready, its memory is its children's, too.
        """
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            _, fate = self._send("open", asdict(limits), (function, payload), theirs, door)
        except BaseException:
            ours.close()
            raise
        os.close(fate)
        return Origin(ours)

    def close(self) -> None:
        """Kill all children and the process that they come from."""
        with self._guard:
            self._closed = True
            with contextlib.suppress(OSError):  # it has gone before
                self._control.shutdown(socket.SHUT_RDWR)
            self._control.close()

    def _send(
        self,
        verb: str,
        limits: dict[str, Any],
        asked: tuple[str, object],
        end: socket.socket,
        *doors: socket.socket,
    ) -> tuple[int, int]:
        """Send a request with the child's ``end`` of a socket, which is closed here.

        Returns its number and the pipe that tells the child's fate.
        """
        request = os.memfd_create("request")
        fate, fate_of_child = os.pipe()
        try:
            with os.fdopen(request, "wb", closefd=False) as file:
                pickle.dump(asked, file)
            with self._guard:
                if self._closed:
                    raise OriginLostError("it was closed")
                number = next(self._numbers)
                message = json.dumps({"do": verb, "id": number, **limits}).encode()
                others = (door.fileno() for door in doors)
                handles = (request, end.fileno(), fate_of_child, *others)
                socket.send_fds(self._control, [message], handles)
        except BaseException as error:
            os.close(fate)
            if isinstance(error, (BrokenPipeError, ConnectionResetError)):
                raise OriginLostError("it has ended") from error
            raise
        finally:
            os.close(request)
            end.close()
            os.close(fate_of_child)
        return number, fate

    def _kill(self, number: int) -> None:
        with self._guard:
            if self._closed:
                return  # the child went with its origin
            try:
                self._control.send(json.dumps({"do": "kill", "id": number}).encode())
            except (BrokenPipeError, ConnectionResetError):
                return
