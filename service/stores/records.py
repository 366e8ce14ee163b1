"""Meshes, edits, results and events in Postgres; an edit and its job in one transaction.

Every method is synchronous and safe to call from any thread. A lost connection is retried for
``patience`` seconds and then raises ``Unavailable``.
"""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import contextmanager

from sqlalchemy import text

from service.domain import EditRecord
from service.stores.attempts import AttemptStore
from service.stores.changes import Changes, Watch
from service.stores.database import Database
from service.stores.edits import EditStore
from service.stores.meshes import MeshStore
from service.stores.migrations import migrate


class Records(MeshStore, EditStore, AttemptStore):
    """The database, as intentions: meshes and edits for clients, attempts for workers."""

    def __init__(
        self,
        url: str,
        *,
        queue_limit: int = 1000,
        result_ttl: float = 604800.0,
        max_attempts: int = 3,
        patience: float = 15.0,
    ) -> None:
        database = Database(url, patience=patience)
        MeshStore.__init__(self, database)
        EditStore.__init__(self, database, queue_limit=queue_limit)
        AttemptStore.__init__(self, database, result_ttl=result_ttl, max_attempts=max_attempts)
        self._changes = Changes(url)

    def migrate(self) -> None:
        """Bring the database to the newest schema; safe from many processes at once."""
        self._database.run(lambda connection: None)
        migrate(self._database.engine)

    def ping(self) -> None:
        """Raise Unavailable unless the database answers now."""
        self._database.run(lambda connection: connection.execute(text("SELECT 1")), patience=0.0)

    def close(self) -> None:
        """Give back all connections."""
        self._changes.close()
        self._database.close()

    @contextmanager
    def watch(self, edit_id: str) -> Generator[Watch]:
        """Watch one edit: read it inside, then ``wait`` or ``await wait_async``, and repeat."""
        with self._changes.watch(edit_id) as watch:
            yield watch

    def wait_for_change(self, edit_id: str, seq: int, seconds: float) -> EditRecord:
        """The edit as soon as ``last_seq > seq`` or it is finished, else as it is in the end."""
        deadline = time.monotonic() + seconds
        with self.watch(edit_id) as watch:
            while True:
                edit = self.get_edit(edit_id)
                left = deadline - time.monotonic()
                if edit.last_seq > seq or edit.finished or left <= 0:
                    return edit
                watch.wait(left)
