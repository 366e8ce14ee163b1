"""Edits that are kept open: the next one like them starts where they begin to differ.

Each is a process of its own (``Origin``) that has the files read and everything solved that edits
of the same meshes, control points and options share. An edit like it runs in a child of that
process, as killable and limited as any. Nothing depends on them: an edit that finds none, or whose
process is lost, does everything itself, with the same result.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import structlog
from obstore.exceptions import BaseError as BlobStoreError

from service.domain import NotFound, Unavailable
from service.jobtypes import EditJob, Event, Json
from service.origin import Origin, OriginLostError
from service.runner import Call, Runner, RunnerError

_OWN = ("weights", "distance", "frames", "keyframes")
_OWN_OF_POINT = ("weights", "distance", "move", "fixed")
_GRACE_SECONDS = 5.0
_log = structlog.stdlib.get_logger("service.worker")


@dataclass(frozen=True, slots=True)
class Limits:
    """What one edit may take."""

    seconds: float
    memory_bytes: int


@dataclass(frozen=True, slots=True)
class Room:
    """How many edits may be open at once, and how much memory they may hold together."""

    edits: int
    bytes: int


def alike(document: Mapping[str, Any]) -> str:
    """Equal for edits that differ in weights, distances, moves, frames and formats at most."""
    shared: Json = {key: value for key, value in document.items() if key not in _OWN}
    if "output" in shared:
        shared["output"] = {**shared["output"], "formats": None}
    if "control_points" in shared:
        points = [
            {key: value for key, value in point.items() if key not in _OWN_OF_POINT}
            for point in shared["control_points"]["points"]
        ]
        shared["control_points"] = {**shared["control_points"], "points": points}
    return hashlib.sha256(json.dumps(shared, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class _Opening:
    origin: Origin
    bytes: int


class Openings:
    """The open edits of one worker, in the order of their last use; thread-safe.

    ``function`` is the ``module:function`` that opens an ``EditJob``.
    """

    def __init__(
        self, runner: Runner, function: str, limits: Limits, room: Room, scratch: Path
    ) -> None:
        self._runner = runner
        self._function = function
        self._limits = limits
        self._room = room
        self._scratch = scratch
        self._guard = threading.Lock()
        self._open: OrderedDict[str, _Opening] = OrderedDict()
        self._opener: threading.Thread | None = None

    def start(self, job: EditJob, on_event: Callable[[Event], None]) -> Call | None:
        """Start ``job`` from an open edit like it; None if there is none."""
        key = alike(job.document)
        with self._guard:
            found = self._open.get(key)
            if found is None:
                return None
            self._open.move_to_end(key)
        try:
            return found.origin.start(
                "",
                job,
                seconds=self._limits.seconds,
                memory_bytes=self._limits.memory_bytes,
                on_event=on_event,
            )
        except OriginLostError:
            self.drop(job)
            return None

    def close(self) -> None:
        """Let go of all."""
        with self._guard:
            closed = list(self._open.values())
            self._open.clear()
        for one in closed:
            one.origin.close()

    def drop(self, job: EditJob) -> None:
        """Close the open edit that ``job`` is like, whose process may be gone."""
        with self._guard:
            found = self._open.pop(alike(job.document), None)
        if found is not None:
            found.origin.close()

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
            if key in self._open or (self._opener is not None and self._opener.is_alive()):
                return
            self._opener = threading.Thread(
                target=lambda: self._add(key, self._opened(job_in)),
                name="opening",
                daemon=True,
            )
            self._opener.start()

    def _opened(self, job_in: Callable[[Path], EditJob]) -> _Opening | None:
        seconds, memory_bytes = self._limits.seconds, self._limits.memory_bytes
        with tempfile.TemporaryDirectory(dir=self._scratch, ignore_cleanup_errors=True) as folder:
            try:
                job = job_in(Path(folder))
                origin = self._runner.open(
                    self._function, job, seconds=seconds, memory_bytes=memory_bytes
                )
            except (NotFound, Unavailable, BlobStoreError, RunnerError, OriginLostError) as error:
                _log.warning("an edit was not kept open", reason=str(error))
                return None
            answer = origin.wait_until_ready(seconds + _GRACE_SECONDS)
        if "bytes" in answer:
            return _Opening(origin, answer["bytes"])
        origin.close()
        reason = answer.get("failed", "its process ended")
        _log.warning("an edit was not kept open", edit=job.edit_id, reason=reason)
        return None

    def _add(self, key: str, opening: _Opening | None) -> None:
        """Keep it, and let go of those unused for longest, as many as it takes to make room."""
        if opening is None:
            return
        closed: list[_Opening] = []
        with self._guard:
            self._open[key] = opening
            while len(self._open) > self._room.edits or self._bytes() > self._room.bytes:
                closed.append(self._open.popitem(last=False)[1])
        for one in closed:
            one.origin.close()

    def _bytes(self) -> int:
        return sum(opening.bytes for opening in self._open.values())
