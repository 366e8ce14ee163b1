"""Edits as clients see them: accepted, listed, canceled, their results and events."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection, Row, delete, func, insert, select, text

from service import queue
from service.domain import (
    Conflict,
    EditRecord,
    EditStatus,
    EventRecord,
    Gone,
    IdempotencyMismatch,
    Json,
    NotFound,
    Page,
    QueueFull,
    ResultRecord,
)
from service.stores import tables
from service.stores._pages import fetch_page
from service.stores._rows import (
    EDIT_ROWS,
    EDITS,
    ONE_EDIT,
    change_edit,
    change_status,
    read_edit,
)
from service.stores.database import Database, row_values

_ADMISSION = 0x5155_4144_4D49
_UNFINISHED = ("queued", "running")


class EditStore:
    """Orders for edits; every one that is accepted has its job in the queue."""

    def __init__(self, database: Database, *, queue_limit: int) -> None:
        self._database = database
        self._queue_limit = queue_limit

    def create_edit(
        self,
        *,
        document: Json,
        meshes: Sequence[str],
        fingerprint: str,
        idempotency_key: str | None = None,
        tenant: str = "",
        summary: Json | None = None,
    ) -> tuple[EditRecord, bool]:
        """Accept and enqueue an edit, or return the first one with this idempotency key.

        Raises NotFound for an unknown mesh, IdempotencyMismatch, QueueFull.
        """
        edit_id = f"edt_{secrets.token_hex(10)}"
        used = sorted(set(meshes))
        values = {
            **{"id": edit_id, "tenant": tenant, "status": "queued", "document": document},
            **{"fingerprint": fingerprint, "idempotency_key": idempotency_key},
            **{"summary": summary or {}, "last_seq": 1},
        }

        def work(connection: Connection) -> tuple[EditRecord, bool]:
            lock = text("SELECT pg_advisory_xact_lock(:key)")
            connection.execute(lock, {"key": _ADMISSION})
            earlier = _find_earlier(connection, edit_id, tenant, idempotency_key)
            if earlier is not None:
                if earlier.fingerprint != fingerprint:
                    raise IdempotencyMismatch("this idempotency key came with another edit before")
                return read_edit(earlier), earlier.id == edit_id
            _require_meshes(connection, used)
            self._require_room(connection)
            job_id = queue.enqueue(connection, edit_id)
            connection.execute(insert(EDITS).values(**values, job_id=job_id))
            links = [{"edit_id": edit_id, "mesh_id": mesh} for mesh in used]
            if links:
                connection.execute(insert(tables.edit_meshes), links)
            first = {"edit_id": edit_id, "seq": 1, "type": "status", "data": {"status": "queued"}}
            connection.execute(insert(tables.events).values(first))
            return read_edit(_require_edit(connection, edit_id)), True

        return self._database.run(work)

    def _require_room(self, connection: Connection) -> None:
        waiting = select(func.count()).select_from(EDITS).where(EDITS.c.status == "queued")
        if connection.execute(waiting).scalar_one() >= self._queue_limit:
            raise QueueFull(f"{self._queue_limit} edits are waiting already")

    def get_edit(self, edit_id: str) -> EditRecord:
        """One edit, or NotFound."""
        return self._database.run(lambda connection: read_edit(_require_edit(connection, edit_id)))

    def list_edits(
        self, limit: int = 50, cursor: str | None = None, status: EditStatus | None = None
    ) -> Page[EditRecord]:
        """Edits, newest first; InvalidCursor for a cursor that is none."""
        query = EDIT_ROWS
        if status is not None:
            query = query.where(EDITS.c.status == status)
        return self._database.run(
            lambda connection: fetch_page(
                connection, query, EDITS, limit=limit, cursor=cursor, read=read_edit
            )
        )

    def request_cancel(self, edit_id: str) -> EditRecord:
        """Cancel a queued edit at once and a running one soon; finished ones stay as they are."""

        def work(connection: Connection) -> EditRecord:
            row = _lock_edit(connection, edit_id)
            if row.status == "queued":
                queue.withdraw(connection, row.job_id)
                change_status(connection, row, "canceled", {"finished_at": func.now()})
            elif row.status == "running" and not row.cancel_requested:
                change_edit(connection, edit_id, {"cancel_requested": True})
            return read_edit(_require_edit(connection, edit_id))

        return self._database.run(work)

    def delete_edit(self, edit_id: str) -> list[str]:
        """Forget a finished edit; returns the blobs to delete. Conflict while unfinished."""

        def work(connection: Connection) -> list[str]:
            row = _lock_edit(connection, edit_id)
            if row.status in _UNFINISHED:
                raise Conflict(f"{edit_id} is {row.status}: cancel it first", "edit_unfinished")
            keys = select(tables.results.c.blob_key).where(tables.results.c.edit_id == edit_id)
            blobs = list(connection.execute(keys).scalars())
            connection.execute(delete(EDITS).where(EDITS.c.id == edit_id))
            return blobs

        return self._database.run(work)

    def list_results(self, edit_id: str) -> list[ResultRecord]:
        """All results in their own order.

        Raises Conflict (``not_ready``) before success, Gone once they have expired.
        """
        return self._database.run(lambda connection: _results(connection, edit_id))

    def published(self, edit_id: str) -> list[ResultRecord]:
        """The results that there are of an edit, whatever has become of it."""
        return self._database.run(lambda connection: _read_results(connection, edit_id))

    def get_result(self, edit_id: str, name: str) -> ResultRecord:
        """One result; raises as ``list_results`` does, and NotFound for an unknown name."""
        for result in self.list_results(edit_id):
            if result.name == name:
                return result
        raise NotFound(f"{edit_id} has no result {name}")

    def events_after(self, edit_id: str, seq: int = 0) -> list[EventRecord]:
        """What happened to the edit after event ``seq``, in order; NotFound without the edit."""
        table = tables.events
        query = select(table.c.seq, table.c.type, table.c.data, table.c.at).where(
            table.c.edit_id == edit_id, table.c.seq > seq
        )

        def work(connection: Connection) -> list[EventRecord]:
            found = connection.execute(query.order_by(table.c.seq)).mappings().all()
            if not found:
                _require_edit(connection, edit_id)
            return [EventRecord(**row) for row in found]

        return self._database.run(work)

    def queue_counts(self) -> dict[str, int]:
        """How many edits there are in each status that any edit has."""
        query = select(EDITS.c.status, func.count()).group_by(EDITS.c.status)
        rows = self._database.run(lambda connection: connection.execute(query).all())
        return {row[0]: row[1] for row in rows}


def _find_earlier(
    connection: Connection, edit_id: str, tenant: str, idempotency_key: str | None
) -> Row[Any] | None:
    """This edit itself (its commit's answer was lost), or the first with the same key."""
    same = EDITS.c.id == edit_id
    if idempotency_key is not None:
        same = same | ((EDITS.c.tenant == tenant) & (EDITS.c.idempotency_key == idempotency_key))
    return connection.execute(EDIT_ROWS.where(same)).one_or_none()


def _require_meshes(connection: Connection, mesh_ids: Sequence[str]) -> None:
    """All of them exist, and none can be deleted before this transaction ends."""
    table = tables.meshes
    query = select(table.c.id).where(table.c.id.in_(mesh_ids)).with_for_update(key_share=True)
    missing = set(mesh_ids) - set(connection.execute(query).scalars())
    if missing:
        raise NotFound(f"there is no mesh {sorted(missing)[0]}")


def _require_edit(connection: Connection, edit_id: str) -> Row[Any]:
    row = connection.execute(ONE_EDIT, {"edit_id": edit_id}).one_or_none()
    if row is None:
        raise NotFound(f"there is no edit {edit_id}")
    return row


def _lock_edit(connection: Connection, edit_id: str) -> Row[Any]:
    query = select(EDITS).where(EDITS.c.id == edit_id).with_for_update()
    row = connection.execute(query).one_or_none()
    if row is None:
        raise NotFound(f"there is no edit {edit_id}")
    return row


def _results(connection: Connection, edit_id: str) -> list[ResultRecord]:
    edit = _require_edit(connection, edit_id)
    if edit.status != "succeeded":
        raise Conflict(f"{edit_id} is {edit.status}: it has no results", "not_ready")
    if edit.results_expired:
        raise Gone(f"the results of {edit_id} have expired")
    return _read_results(connection, edit_id)


def _read_results(connection: Connection, edit_id: str) -> list[ResultRecord]:
    table = tables.results
    columns = [column for column in table.c if column.name != "position"]
    query = select(*columns).where(table.c.edit_id == edit_id).order_by(table.c.position)
    return [ResultRecord(**row_values(row)) for row in connection.execute(query)]
