"""Edits that are kept open: the next one like them starts where they begin to differ.

Each is a process of its own (``Origin``) that has the files read and everything solved that edits
of the same meshes, control points and options share. An edit like it runs in a child of that
process, as killable and limited as any, whichever worker of the machine it belongs to. Nothing
depends on them: an edit that finds none, or whose process is lost, does everything itself, with
the same result.
"""

from __future__ import annotations

import hashlib
import json
import socket
import tempfile
import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import structlog
from obstore.exceptions import BaseError as BlobStoreError

from service.domain import NotFound, Unavailable
from service.doors import Doors
from service.jobtypes import EditJob, Event, Json
from service.origin import Origin, OriginLostError
from service.runner import Call, Limits, Runner, RunnerError

_OWN = ("weights", "distance", "frames", "keyframes")
_OWN_OF_POINT = ("weights", "distance", "move", "fixed", "moved_to")
_GRACE_SECONDS = 5.0
_log = structlog.stdlib.get_logger("service.worker")


@dataclass(frozen=True, slots=True)
class Room:
    """How many edits may be open at once, and how much memory they may hold together."""

    edits: int
    bytes: int


def alike(document: Mapping[str, Any]) -> str:
    """Equal for edits that differ in weights, distances, moves, frames and output at most.

    Where points are on targets tells them apart; where they are moved to there does not.
    """
    shared: Json = {key: value for key, value in document.items() if key not in _OWN}
    if "output" in shared:
        shared["output"] = {**shared["output"], "formats": None, "figures": None}
    if "control_points" in shared:
        points = [
            {key: value for key, value in point.items() if key not in _OWN_OF_POINT}
            for point in shared["control_points"]["points"]
        ]
        shared["control_points"] = {**shared["control_points"], "points": points}
    return hashlib.sha256(json.dumps(shared, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class _Opened:
    origin: Origin
    bytes: int


class Openings:
    """Edits that are open on this machine, and those that this worker keeps so; thread-safe.

    ``function`` is the ``module:function`` that opens an ``EditJob``. Workers that share the
    ``folder`` start from each other's.
    """

    def __init__(
        self,
        runner: Runner,
        function: str,
        limits: Limits,
        room: Room,
        *,
        folder: Path,
        scratch: Path,
    ) -> None:
        self._runner = runner
        self._function = function
        self._limits = limits
        self._room = room
        self._doors = Doors(folder)
        self._scratch = scratch
        self._guard = threading.Lock()
        self._kept: dict[str, _Opened] = {}
        self._opener: threading.Thread | None = None

    @contextmanager
    def started(self, job: EditJob, on_event: Callable[[Event], None]) -> Generator[Call | None]:
        """``job``, started from an open edit like it; None if there is none, or none any more."""
        connection = self._doors.enter(alike(job.document))
        if connection is None:
            yield None
            return
        with closing(Origin(connection)) as origin:
            try:
                call = origin.start("", job, self._limits, on_event=on_event)
            except OriginLostError:
                call = None
            yield call

    def close(self) -> None:
        """Let go of all."""
        with self._guard:
            for key in list(self._kept):
                self._let_go(key)

    def keep(self, document: Json, peak_bytes: int, job_in: Callable[[Path], EditJob]) -> None:
        """Open an edit in the background, unless one like it is open.

        ``peak_bytes`` is the memory that it took itself: nothing is opened that could not stay.
        ``job_in`` gives its job, with the files in a folder. One edit is opened at a time; those
        that come meanwhile are not.
        """
        if not self._room.edits or peak_bytes > self._room.bytes:
            return
        key = alike(document)
        with self._guard:
            opening = self._opener is not None and self._opener.is_alive()
            if opening or self._doors.last_use(key):
                return
            self._opener = threading.Thread(
                target=self._open, args=(key, job_in), name="opening", daemon=True
            )
            self._opener.start()

    def _open(self, key: str, job_in: Callable[[Path], EditJob]) -> None:
        door, name = self._doors.make()
        with door:
            opened = self._opened(door, job_in)
        if opened is None:
            self._doors.remove(name)
            return
        with self._guard:
            self._let_go(key)  # one that was killed
            if self._doors.rename(name, key):
                self._kept[key] = opened
                self._make_room()
            else:
                opened.origin.close()

    def _opened(self, door: socket.socket, job_in: Callable[[Path], EditJob]) -> _Opened | None:
        with tempfile.TemporaryDirectory(dir=self._scratch, ignore_cleanup_errors=True) as folder:
            try:
                job = job_in(Path(folder))
                origin = self._runner.open(self._function, job, door, self._limits)
            except (NotFound, Unavailable, BlobStoreError, RunnerError, OriginLostError) as error:
                _log.warning("an edit was not kept open", reason=str(error))
                return None
            answer = origin.wait_until_ready(self._limits.seconds + _GRACE_SECONDS)
        if "bytes" in answer:
            return _Opened(origin, answer["bytes"])
        origin.close()
        reason = answer.get("failed", "its process ended")
        _log.warning("an edit was not kept open", edit=job.edit_id, reason=reason)
        return None

    def _make_room(self) -> None:
        """Let go of those unused for longest, as many as it takes."""
        while len(self._kept) > self._room.edits or self._bytes() > self._room.bytes:
            self._let_go(min(self._kept, key=self._doors.last_use))

    def _let_go(self, key: str) -> None:
        opened = self._kept.pop(key, None)
        if opened is not None:
            self._doors.remove(key)
            opened.origin.close()

    def _bytes(self) -> int:
        return sum(opened.bytes for opened in self._kept.values())
