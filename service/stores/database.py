"""Transactions that survive a restart of the database."""

from __future__ import annotations

import time
from collections.abc import Callable
from operator import methodcaller
from typing import Any, TypeVar

import psycopg
from sqlalchemy import Connection, Row, create_engine, text
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import DBAPIError

from service.domain import Unavailable

Value = TypeVar("Value")

row_values: Callable[[Row[Any]], dict[str, Any]] = methodcaller("_asdict")
"""A row's values by column; the underscore only keeps the method apart from column names."""

_REPEATABLE = ("08", "57P", "40001", "40P01")
"""SQLSTATEs (prefixes): connection lost, server stopping or starting, serialisation, deadlock."""

_PAUSE_SECONDS = 0.1
CHANGED = "quasiface_edits"
_NOTIFY = text("SELECT pg_notify(:channel, :edit)")


def sqlalchemy_url(url: str) -> URL:
    """The same database for SQLAlchemy's psycopg driver."""
    return make_url(url).set(drivername="postgresql+psycopg")


class Database:
    """A pool of connections to one Postgres, safe for many threads."""

    def __init__(self, url: str, *, pool_size: int = 10, patience: float = 15.0) -> None:
        self.url = url
        self.patience = patience
        self.engine = create_engine(
            sqlalchemy_url(url),
            pool_size=pool_size,
            max_overflow=pool_size,
            connect_args={"connect_timeout": 5},
        )

    def run(self, work: Callable[[Connection], Value], *, patience: float | None = None) -> Value:
        """``work`` in one transaction; from the start again when the connection is lost.

        ``work`` may therefore run after a commit whose answer was lost: it must notice its own
        effects. Raises Unavailable after ``patience`` seconds without the database.

        A connection is not tested before it is used: that would cost every transaction a round
        trip, and it may break right after.
        """
        deadline = time.monotonic() + (self.patience if patience is None else patience)
        while True:
            try:
                with self.engine.begin() as connection:
                    return work(connection)
            except DBAPIError as error:
                if not _repeatable(error):
                    raise
                if time.monotonic() > deadline:
                    raise Unavailable("the database does not answer") from error
                time.sleep(_PAUSE_SECONDS)

    def close(self) -> None:
        """Close all idle connections."""
        self.engine.dispose()


def _repeatable(error: DBAPIError) -> bool:
    if error.connection_invalidated:
        return True
    original = error.orig
    if not isinstance(original, psycopg.Error):
        return False
    state: str | None = original.sqlstate
    if state is None:
        return isinstance(original, psycopg.OperationalError)
    return state.startswith(_REPEATABLE)


def announce(connection: Connection, edit_id: str) -> None:
    """Tell everyone who watches this edit, once the transaction is committed."""
    connection.execute(_NOTIFY, {"channel": CHANGED, "edit": edit_id})
