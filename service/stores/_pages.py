"""Cursors of lists that run from the newest to the oldest."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from datetime import datetime
from typing import Any, TypeVar

from sqlalchemy import Connection, Row, Select, Table, tuple_

from service.domain import InvalidCursor, Page

Item = TypeVar("Item")


def fetch_page(
    connection: Connection,
    query: Select[Any],
    table: Table,
    *,
    limit: int,
    cursor: str | None,
    read: Callable[[Row[Any]], Item],
) -> Page[Item]:
    """At most ``limit`` rows of ``query`` after ``cursor``, newest first."""
    order = tuple_(table.c.created_at, table.c.id)
    if cursor is not None:
        query = query.where(order < tuple_(*_decode(cursor)))
    query = query.order_by(table.c.created_at.desc(), table.c.id.desc()).limit(limit + 1)
    rows = connection.execute(query).all()
    more = len(rows) > limit
    following = _encode(rows[limit - 1]) if more else None
    return Page(tuple(read(row) for row in rows[:limit]), following)


def _encode(row: Row[Any]) -> str:
    text = f"{row.created_at.isoformat()}|{row.id}"
    return base64.urlsafe_b64encode(text.encode()).decode().rstrip("=")


def _decode(cursor: str) -> tuple[datetime, str]:
    try:
        padded = cursor.encode("ascii") + b"=" * (-len(cursor) % 4)
        text = base64.b64decode(padded, altchars=b"-_", validate=True).decode()
        at, identifier = text.split("|")
        moment = datetime.fromisoformat(at)
    except (ValueError, binascii.Error) as error:
        raise InvalidCursor("the cursor is not one that this service gave") from error
    if moment.tzinfo is None or "\0" in identifier:
        raise InvalidCursor("the cursor is not one that this service gave")
    return moment, identifier
