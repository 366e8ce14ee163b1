"""The queue: which tasks there are and how they are put in and taken back."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any, LiteralString, cast

import psycopg
from procrastinate import App, PsycopgConnector, SyncPsycopgConnector
from procrastinate.connector import Notify
from procrastinate.exceptions import ConnectorException
from sqlalchemy import Connection

QUEUE = "edits"
RUN_EDIT = "run_edit"
_RERUN_PRIORITY = 1
_RECONNECT_SECONDS = 0.2

_deferrer = App(connector=SyncPsycopgConnector())


def enqueue(connection: Connection, edit_id: str, *, rerun: bool = False) -> int:
    """Queue the edit in the connection's transaction; returns the job's id.

    An edit that lost its worker goes before those that never ran.
    """
    task = _deferrer.configure_task(
        RUN_EDIT,
        queue=QUEUE,
        priority=_RERUN_PRIORITY if rerun else 0,
        allow_unknown=True,
        connection=_driver_connection(connection),
    )
    return task.defer(edit_id=edit_id)


def withdraw(connection: Connection, job_id: int) -> None:
    """Take a job out of the queue, whatever has become of it."""
    connection.exec_driver_sql("DELETE FROM procrastinate_jobs WHERE id = %s", (job_id,))


def _driver_connection(connection: Connection) -> psycopg.Connection[Any]:
    return cast("psycopg.Connection[Any]", connection.connection.driver_connection)


class PatientConnector(PsycopgConnector):
    """Outlives restarts of the database where repeating is harmless.

    Listening and statements without an answer (heartbeats, a job's end) wait for the database
    to come back. Fetching a job is not repeated: whether the lost answer held a job is unknown,
    so the worker registers anew and the job of the old registration counts as stalled.
    """

    async def listen_notify(self, on_notification: Notify, channels: Iterable[str]) -> None:
        """Listen on ``channels``, reconnecting as long as it takes."""
        names = list(channels)
        while True:
            try:
                await super().listen_notify(on_notification, names)
            except ConnectorException as error:
                _raise_unless_disconnected(error)
                await asyncio.sleep(_RECONNECT_SECONDS)

    async def execute_query_async(self, query: LiteralString, **arguments: Any) -> None:
        """Execute ``query``, as often as it takes to be sure that it was executed."""
        while True:
            try:
                return await super().execute_query_async(query, **arguments)
            except ConnectorException as error:
                if _withdrawn(error):
                    return None
                _raise_unless_disconnected(error)
                await asyncio.sleep(_RECONNECT_SECONDS)


def _withdrawn(error: ConnectorException) -> bool:
    """Whether the end of a job was reported that had been taken out of the queue meanwhile."""
    cause = error.__cause__
    return isinstance(cause, psycopg.errors.RaiseException) and "was not found" in str(cause)


def _raise_unless_disconnected(error: ConnectorException) -> None:
    if not isinstance(error.__cause__, psycopg.OperationalError):
        raise error
