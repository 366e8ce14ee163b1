"""Attempts at edits as workers see them.

Every change names the attempt that makes it and happens only while that attempt is the current
one: of two workers that believe they run the same edit, one is refused (fencing).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import (
    Connection,
    Row,
    Select,
    delete,
    func,
    insert,
    literal,
    select,
    text,
    union_all,
    update,
)

from service import queue
from service.domain import EditRecord, Json, ResultRecord
from service.stores import tables
from service.stores._rows import (
    EDITS,
    ONE_EDIT,
    append_events,
    change_edit,
    change_status,
    read_edit,
)
from service.stores.database import Database

_LOST = text(
    """
    SELECT edits.* FROM edits
    LEFT JOIN procrastinate_jobs jobs ON jobs.id = edits.job_id
    LEFT JOIN procrastinate_workers workers ON workers.id = jobs.worker_id
    WHERE (edits.status = 'running'
        AND edits.seen_at < clock_timestamp() - make_interval(secs => :seconds)
      OR edits.status = 'queued'
        AND NOT coalesce(jobs.status = 'todo', false)
        AND NOT coalesce(jobs.status = 'doing'
          AND workers.last_heartbeat > clock_timestamp() - make_interval(secs => :seconds), false))
    FOR UPDATE OF edits SKIP LOCKED
    """
)

_RELAXED = text("SET LOCAL synchronous_commit TO OFF")
"""For what a power failure may take away: the next attempt reports it again."""


class AttemptStore:
    """The workers' side of edits."""

    def __init__(self, database: Database, *, result_ttl: float, max_attempts: int) -> None:
        self._database = database
        self._result_ttl = result_ttl
        self._max_attempts = max_attempts

    def claim_attempt(self, edit_id: str, job_id: int) -> EditRecord | None:
        """Begin the next attempt; None when the job is not (or no longer) the edit's own."""

        def work(connection: Connection) -> EditRecord | None:
            mine = (EDITS.c.id == edit_id) & (EDITS.c.job_id == job_id)
            row = _lock(connection, select(EDITS).where(mine, EDITS.c.status == "queued"))
            if row is None:
                return None
            begun = {"attempt": row.attempt + 1, "stages": [], "started_at": func.now()}
            begun["seen_at"] = func.clock_timestamp()
            change_status(connection, row, "running", begun, attempt=row.attempt + 1)
            return read_edit(connection.execute(ONE_EDIT, {"edit_id": edit_id}).one())

        return self._database.run(work)

    def is_wanted(self, edit_id: str, attempt: int) -> bool:
        """Whether the attempt is still the current one and nobody asked to cancel it."""
        query = _current(edit_id, attempt).where(~EDITS.c.cancel_requested)
        return self._database.run(lambda connection: connection.execute(query).first()) is not None

    def show_life(self, edit_id: str, attempt: int) -> None:
        """Say that the attempt's worker is alive; to be repeated while it is."""
        seen = (
            update(EDITS)
            .where(EDITS.c.id == edit_id, EDITS.c.attempt == attempt, EDITS.c.status == "running")
            .values(seen_at=func.clock_timestamp())
        )

        def work(connection: Connection) -> None:
            connection.execute(_RELAXED)
            connection.execute(seen)

        self._database.run(work)

    def record_progress(self, edit_id: str, attempt: int, reported: Sequence[Json]) -> bool:
        """Keep what a job reported, as stages and as events; False when fenced off."""

        def work(connection: Connection) -> bool:
            connection.execute(_RELAXED)
            row = _lock(connection, _current(edit_id, attempt))
            if row is None:
                return False
            stages, happened = _brought_forward(row.stages, reported)
            last = append_events(connection, row, happened)
            change_edit(connection, edit_id, {"stages": stages, "last_seq": last})
            return True

        return self._database.run(work)

    def publish(
        self,
        edit_id: str,
        attempt: int,
        results: Sequence[ResultRecord],
        summary: Json,
        reported: Sequence[Json] = (),
    ) -> bool:
        """Make an attempt's results the edit's; False, and nothing done, when fenced off.

        ``reported``: what the job has reported last, as in ``record_progress``.
        """

        def work(connection: Connection) -> bool:
            row = _lock(connection, _current(edit_id, attempt))
            if row is None:
                return self._published_before(connection, edit_id, attempt)
            rows = [
                {name: getattr(result, name) for name in ResultRecord.__slots__}
                | {"position": position}
                for position, result in enumerate(results)
            ]
            if rows:
                connection.execute(insert(tables.results), rows)
            expires = func.now() + func.make_interval(0, 0, 0, 0, 0, 0, literal(self._result_ttl))
            stages, happened = _brought_forward(row.stages, reported)
            done: Json = {"finished_at": func.now(), "expires_at": expires}
            done |= {"summary": row.summary | summary, "stages": stages}
            change_status(connection, row, "succeeded", done, before=happened)
            return True

        return self._database.run(work)

    @staticmethod
    def _published_before(connection: Connection, edit_id: str, attempt: int) -> bool:
        """Whether this very attempt was published by a commit whose answer was lost."""
        query = select(EDITS.c.id).where(EDITS.c.id == edit_id, EDITS.c.attempt == attempt)
        return connection.execute(query.where(EDITS.c.status == "succeeded")).first() is not None

    def fail(self, edit_id: str, attempt: int, error: Json) -> bool:
        """End the edit with a problem; False when fenced off."""
        return self._finish(edit_id, attempt, "failed", {"error": error})

    def finish_cancel(self, edit_id: str, attempt: int) -> bool:
        """End the edit as canceled, its child being dead; False when fenced off."""
        return self._finish(edit_id, attempt, "canceled", {})

    def _finish(self, edit_id: str, attempt: int, status: str, values: Json) -> bool:
        def work(connection: Connection) -> bool:
            row = _lock(connection, _current(edit_id, attempt))
            if row is None:
                return False
            done = {"finished_at": func.now(), **values}
            change_status(connection, row, status, done, **values)
            return True

        return self._database.run(work)

    def release(self, edit_id: str, attempt: int) -> bool:
        """Give an edit back to the queue because its worker stops; no loss is counted."""

        def work(connection: Connection) -> bool:
            row = _lock(connection, _current(edit_id, attempt))
            if row is None:
                return False
            _requeue(connection, row, losses=row.losses)
            return True

        return self._database.run(work)

    def lose(self, edit_id: str, attempt: int, exhausted: Json) -> bool:
        """Give an edit back because its child was lost, up to the cap; False when fenced off.

        Beyond the cap the edit fails with the problem ``exhausted``.
        """

        def work(connection: Connection) -> bool:
            row = _lock(connection, _current(edit_id, attempt))
            if row is None:
                return False
            self._put_back(connection, row, row.losses + 1, exhausted)
            return True

        return self._database.run(work)

    def recover_lost(self, stalled_seconds: float, exhausted: Json) -> list[str]:
        """Put edits back whose worker fell silent, as ``lose`` does; returns which.

        Raises Unavailable at once if the database does not answer: after an outage, silence
        means nothing until workers have had time to show that they live.
        """

        def work(connection: Connection) -> list[str]:
            rows = connection.execute(_LOST, {"seconds": stalled_seconds}).all()
            for row in rows:
                lost = row.losses + (1 if row.status == "running" else 0)
                self._put_back(connection, row, lost, exhausted)
            return [row.id for row in rows]

        return self._database.run(work, patience=0.0)

    def recover_all(self) -> list[str]:
        """Put all back that runs; returns which. Only for whoever knows that no worker is alive.

        No loss is counted: edits that run when everything is killed are not to blame.
        """
        query = select(EDITS).where(EDITS.c.status == "running").with_for_update()

        def work(connection: Connection) -> list[str]:
            rows = connection.execute(query).all()
            for row in rows:
                self._put_back(connection, row, row.losses, {})
            return [row.id for row in rows]

        return self._database.run(work)

    def _put_back(
        self, connection: Connection, row: Row[Any], losses: int, exhausted: Json
    ) -> None:
        """To the queue; or to its end, if it was to be canceled or was lost too often."""
        if row.cancel_requested:
            queue.withdraw(connection, row.job_id)
            change_status(connection, row, "canceled", {"finished_at": func.now()})
        elif losses >= self._max_attempts > row.losses:
            queue.withdraw(connection, row.job_id)
            ended = {"finished_at": func.now(), "error": exhausted}
            change_status(connection, row, "failed", ended, error=exhausted)
        else:
            _requeue(connection, row, losses=losses)

    def expire_results(self) -> list[str]:
        """Drop the results whose time is over; returns the blobs to delete."""

        def work(connection: Connection) -> list[str]:
            due = (
                update(EDITS)
                .where(EDITS.c.expires_at < func.now(), ~EDITS.c.results_expired)
                .values(results_expired=True)
                .returning(EDITS.c.id)
            )
            expired = list(connection.execute(due).scalars())
            dropped = delete(tables.results).where(tables.results.c.edit_id.in_(expired))
            return list(connection.execute(dropped.returning(tables.results.c.blob_key)).scalars())

        return self._database.run(work)

    def unnamed_blobs(self, keys: Sequence[str]) -> list[str]:
        """Those of ``keys`` that neither a mesh nor a result names."""
        named = union_all(
            select(tables.meshes.c.blob_key).where(tables.meshes.c.blob_key.in_(keys)),
            select(tables.results.c.blob_key).where(tables.results.c.blob_key.in_(keys)),
        )
        known = self._database.run(lambda connection: set(connection.execute(named).scalars()))
        return [key for key in keys if key not in known]


def _brought_forward(
    stages: Sequence[Json], reported: Sequence[Json]
) -> tuple[list[Json], list[tuple[str, Json]]]:
    """An edit's ``stages`` after what its job ``reported``, and that as events."""
    after: dict[str, Json] = {stage["name"]: stage for stage in stages}
    happened: list[tuple[str, Json]] = []
    for report in reported:
        stage = {key: value for key, value in report.items() if key != "type"}
        before = after.get(stage["name"], {})
        kind = "progress" if before.get("status") == stage["status"] else "stage"
        after[stage["name"]] = before | stage
        happened.append((kind, after[stage["name"]]))
    return list(after.values()), happened


def _current(edit_id: str, attempt: int) -> Select[Any]:
    return select(EDITS).where(
        EDITS.c.id == edit_id, EDITS.c.attempt == attempt, EDITS.c.status == "running"
    )


def _lock(connection: Connection, query: Select[Any]) -> Row[Any] | None:
    return connection.execute(query.with_for_update()).one_or_none()


def _requeue(connection: Connection, row: Row[Any], *, losses: int) -> None:
    """A new job for the edit: whoever holds the old one can neither finish nor re-run it."""
    queue.withdraw(connection, row.job_id)
    job_id = queue.enqueue(connection, row.id, rerun=True)
    waiting = {"job_id": job_id, "losses": losses, "queued_at": func.now(), "stages": []}
    change_status(connection, row, "queued", waiting, attempt=row.attempt)
