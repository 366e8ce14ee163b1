"""Reading and changing rows of edits: shared by those who order them and those who run them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import Connection, Row, Select, and_, bindparam, func, insert, or_, select, update

from service.domain import EditRecord, Json
from service.stores import tables
from service.stores.database import announce, row_values

EDITS = tables.edits


def _edit_rows() -> Select[Any]:
    used = (
        select(func.coalesce(func.array_agg(tables.edit_meshes.c.mesh_id), []))
        .where(tables.edit_meshes.c.edit_id == EDITS.c.id)
        .scalar_subquery()
    )
    other = EDITS.alias("other")
    ahead = (
        select(func.count())
        .where(
            other.c.status == "queued",
            or_(
                and_(other.c.attempt > 0, EDITS.c.attempt == 0),
                and_(
                    (other.c.attempt > 0) == (EDITS.c.attempt > 0), other.c.job_id < EDITS.c.job_id
                ),
            ),
        )
        .scalar_subquery()
    )
    return select(EDITS, used.label("meshes"), ahead.label("ahead"))


EDIT_ROWS = _edit_rows()
"""Edits with what ``read_edit`` needs: their meshes and their place in the queue."""

ONE_EDIT = EDIT_ROWS.where(EDITS.c.id == bindparam("edit_id"))


def read_edit(row: Row[Any]) -> EditRecord:
    """An edit from a row of ``EDIT_ROWS``."""
    values = row_values(row)
    ahead = values.pop("ahead")
    for internal in ("job_id", "losses", "seen_at"):
        values.pop(internal)
    values["meshes"] = tuple(values["meshes"])
    return EditRecord(**values, queue_position=ahead + 1 if row.status == "queued" else None)


def change_edit(connection: Connection, edit_id: str, values: Mapping[str, Any]) -> None:
    """Set columns of an edit whose row this transaction has locked, and tell its watchers."""
    connection.execute(update(EDITS).where(EDITS.c.id == edit_id).values(values))
    announce(connection, edit_id)


def append_events(connection: Connection, row: Row[Any], happened: list[tuple[str, Json]]) -> int:
    """Number and keep events of an edit whose row is locked; returns the last number."""
    last = row.last_seq
    if happened:
        numbered = [
            {"edit_id": row.id, "seq": last + 1 + i, "type": kind, "data": data}
            for i, (kind, data) in enumerate(happened)
        ]
        connection.execute(insert(tables.events), numbered)
    return last + len(happened)


def change_status(
    connection: Connection,
    row: Row[Any],
    status: str,
    values: Mapping[str, Any],
    *,
    before: Sequence[tuple[str, Json]] = (),
    **told: Any,
) -> None:
    """Move a locked edit to another status, with its event; ``told`` is added to the event.

    Events that came ``before`` and are not kept yet are kept with it.
    """
    last = append_events(connection, row, [*before, ("status", {"status": status, **told})])
    change_edit(connection, row.id, {"status": status, "last_seq": last, **values})
