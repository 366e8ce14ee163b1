"""One attempt at one edit: fetch its files, run it in a child, publish what it made."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import structlog
from obstore.exceptions import BaseError as BlobStoreError

from service.domain import EditRecord, NotFound, Unavailable
from service.failures import attempts_exhausted, failure_of, refusal
from service.jobtypes import EditJob, Event
from service.openings import Openings
from service.runner import Call, Limits, Outcome, Runner
from service.stores.blobs import Blobs
from service.stores.records import Records
from service.storing import Storing

_FLUSH_SECONDS = 0.1
_LIFE_SECONDS = 1.0
_log = structlog.stdlib.get_logger("service.worker")


@dataclass(frozen=True, slots=True)
class Workshop:
    """What all attempts of a worker share. ``function`` is the job's ``module:function``."""

    records: Records
    blobs: Blobs
    runner: Runner
    openings: Openings
    limits: Limits
    scratch: Path
    cache: Path
    function: str


class Attempt:
    """Runs in a thread of its own; ``interrupt`` comes from another one."""

    def __init__(self, workshop: Workshop, edit_id: str, job_id: int) -> None:
        self._shop = workshop
        self._edit_id = edit_id
        self._job_id = job_id
        self._call: Call | None = None
        self._interrupted = threading.Event()

    def interrupt(self) -> None:
        """Kill the child and give the edit back to the queue."""
        self._interrupted.set()
        if self._call is not None:
            self._call.cancel()

    def run(self) -> None:
        """Claim, run, settle. Does nothing when the job is no longer the edit's own."""
        edit = self._shop.records.claim_attempt(self._edit_id, self._job_id)
        if edit is None:
            return
        log = _log.bind(edit=edit.id, attempt=edit.attempt)
        log.info("edit started")
        vigil = _Vigil(self._shop.records, edit)
        try:
            with (
                vigil,
                tempfile.TemporaryDirectory(dir=self._shop.scratch) as folder,
                Storing(self._shop.blobs) as storing,
            ):
                outcome = self._compute(self._job(edit, Path(folder)), vigil, storing)
                log.info(
                    "edit ended",
                    ending=outcome.ending,
                    detail=outcome.detail,
                    seconds=round(outcome.seconds, 3),
                    peak_bytes=outcome.peak_bytes,
                    notes=getattr(outcome.error, "__notes__", None),
                )
                self._settle(edit, outcome, vigil, storing)
        except NotFound as error:  # a mesh's bytes are gone: no other attempt would find them
            self._shop.records.fail(edit.id, edit.attempt, refusal(error))
        except BlobStoreError as error:
            log.error("blob store failed", error=str(error))
            self._shop.records.lose(edit.id, edit.attempt, attempts_exhausted())

    def _job(self, edit: EditRecord, folder: Path) -> EditJob:
        """The edit's job, its files in ``folder`` or where the blob store has them."""
        inputs, out = folder / "in", folder / "out"
        inputs.mkdir()
        out.mkdir()
        found = self._shop.records.find_meshes(edit.meshes)
        meshes = {
            mesh.id: self._shop.blobs.local_path(mesh.blob_key, inputs) for mesh in found.values()
        }
        return EditJob(edit.id, edit.document, meshes, out, self._shop.cache)

    def _compute(self, job: EditJob, vigil: _Vigil, storing: Storing) -> Outcome:
        """In a child of an open edit like it, if there is one; anew if that one was lost."""

        def hear(event: Event) -> None:
            if event["type"] == "result":
                storing.put(event["path"])
            else:
                vigil.note(event)

        with self._shop.openings.started(job, hear) as started:
            outcome = None if started is None else self._awaited(started, vigil)
        if outcome is not None and outcome.ending != "lost":
            return outcome
        storing.forget()
        return self._awaited(self._started(job, hear), vigil)

    def _started(self, job: EditJob, hear: Callable[[Event], None]) -> Call:
        shop = self._shop
        return shop.runner.start(shop.function, job, shop.limits, on_event=hear)

    def _awaited(self, call: Call, vigil: _Vigil) -> Outcome:
        self._call = vigil.call = call
        if self._interrupted.is_set():
            call.cancel()
        return call.result()

    def _settle(self, edit: EditRecord, outcome: Outcome, vigil: _Vigil, storing: Storing) -> None:
        records = self._shop.records
        if outcome.ending == "returned":
            self._publish(edit, outcome, vigil, storing)
            return
        vigil.flush()
        if outcome.ending == "canceled" and self._interrupted.is_set():
            records.release(edit.id, edit.attempt)
        elif outcome.ending == "canceled":
            records.finish_cancel(edit.id, edit.attempt)
        elif outcome.ending == "lost":
            records.lose(edit.id, edit.attempt, attempts_exhausted())
        else:
            records.fail(edit.id, edit.attempt, failure_of(outcome))

    def _publish(self, edit: EditRecord, outcome: Outcome, vigil: _Vigil, storing: Storing) -> None:
        """Blobs first; then, in one transaction, the records that name them."""
        results = storing.stored(edit.id, outcome.value)
        used = {"seconds": round(outcome.seconds, 3), "peak_bytes": outcome.peak_bytes}
        storing.published = True  # if the answer is lost: upkeep deletes what no record names
        storing.published = self._shop.records.publish(
            edit.id, edit.attempt, results, used, vigil.taken()
        )
        self._shop.openings.keep(edit.document, outcome.peak_bytes, partial(self._job, edit))


class _Vigil:
    """Beside an attempt, from claim to end: shows that it lives, keeps its progress, and kills
    its child when nobody wants it any more.
    """

    def __init__(self, records: Records, edit: EditRecord) -> None:
        self._records = records
        self._edit = edit
        self._noted: list[Event] = []
        self._guard = threading.Lock()
        self._writing = threading.Lock()
        self._seen = time.monotonic()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name=f"vigil {edit.id}", daemon=True)
        self.call: Call | None = None

    def note(self, event: Event) -> None:
        """Keep an event; one that only updates the one before takes its place."""
        with self._guard:
            if self._noted and _same_state(self._noted[-1], event):
                self._noted.pop()
            self._noted.append(event)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *exception: object) -> None:
        self._over.set()
        self._thread.join()

    def flush(self) -> None:
        """Write down what was noted."""
        with self._writing:
            noted = self._noted_so_far()
            if noted:
                self._records.record_progress(self._edit.id, self._edit.attempt, noted)

    def taken(self) -> list[Event]:
        """What was noted and is not written down, for the caller to do that."""
        with self._writing:
            return self._noted_so_far()

    def _noted_so_far(self) -> list[Event]:
        with self._guard:
            noted, self._noted = self._noted, []
            return noted

    def _watch(self) -> None:
        while not self._over.wait(_FLUSH_SECONDS):
            try:
                self._look()
            except Unavailable:
                continue  # whether the attempt still counts is decided when it publishes

    def _look(self) -> None:
        self.flush()
        if time.monotonic() - self._seen > _LIFE_SECONDS:
            self._records.show_life(self._edit.id, self._edit.attempt)
            self._seen = time.monotonic()
        wanted = self._records.is_wanted(self._edit.id, self._edit.attempt)
        if not wanted and self.call is not None:
            self.call.cancel()


def _same_state(before: Event, after: Event) -> bool:
    return all(before.get(key) == after.get(key) for key in ("type", "name", "status"))
