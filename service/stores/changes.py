"""Being told of changes to an edit, instead of asking again and again."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Generator
from contextlib import contextmanager, suppress

import psycopg
from psycopg import sql

from service.stores.database import CHANGED

_RECONNECT_SECONDS = 0.2
_STOP_SECONDS = 0.5


class Watch:
    """One listener's bell: it rings for every change since it was last waited for."""

    def __init__(self) -> None:
        self._rung = threading.Event()
        self._waiter: tuple[asyncio.AbstractEventLoop, asyncio.Event] | None = None
        self._guard = threading.Lock()

    def ring(self) -> None:
        """Wake whoever waits, or else the next who does."""
        with self._guard:
            self._rung.set()
            if self._waiter is not None:
                loop, event = self._waiter
                with suppress(RuntimeError):  # the loop has ended, and the waiter with it
                    loop.call_soon_threadsafe(event.set)

    def wait(self, seconds: float) -> bool:
        """Block until it rings; False when it did not."""
        rung = self._rung.wait(seconds)
        self._rung.clear()
        return rung

    async def wait_async(self, seconds: float) -> bool:
        """The same without blocking the event loop."""
        event = asyncio.Event()
        with self._guard:
            self._waiter = (asyncio.get_running_loop(), event)
            if self._rung.is_set():
                event.set()
        try:
            await asyncio.wait_for(event.wait(), seconds)
        except TimeoutError:
            return False
        finally:
            with self._guard:
                self._waiter = None
                self._rung.clear()
        return True


class Changes:
    """Listens to the database in a thread of its own, from the first watch until ``close``.

    After a lost connection every watch rings, for something may have been missed.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._watches: dict[str, set[Watch]] = {}
        self._guard = threading.Lock()
        self._stopping = threading.Event()
        self._listening = threading.Event()
        self._thread: threading.Thread | None = None

    @contextmanager
    def watch(self, edit_id: str) -> Generator[Watch]:
        """A watch on one edit. Read the edit inside, then wait: nothing is missed in between."""
        watch = Watch()
        with self._guard:
            self._watches.setdefault(edit_id, set()).add(watch)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="changes", daemon=True)
                self._thread.start()
        if not self._listening.is_set():
            watch.ring()
        try:
            yield watch
        finally:
            with self._guard:
                left = self._watches[edit_id]
                left.discard(watch)
                if not left:
                    del self._watches[edit_id]

    def close(self) -> None:
        """Stop listening."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                with psycopg.connect(self._url, autocommit=True, connect_timeout=5) as connection:
                    connection.execute(sql.SQL("LISTEN {}").format(sql.Identifier(CHANGED)))
                    self._listening.set()
                    self._ring(None)
                    self._listen(connection)
            except psycopg.OperationalError:
                self._listening.clear()
                self._stopping.wait(_RECONNECT_SECONDS)

    def _listen(self, connection: psycopg.Connection[tuple[object, ...]]) -> None:
        while not self._stopping.is_set():
            for notification in connection.notifies(timeout=_STOP_SECONDS):
                self._ring(notification.payload)

    def _ring(self, edit_id: str | None) -> None:
        with self._guard:
            watched = self._watches if edit_id is None else (edit_id,)
            for name in list(watched):
                for watch in self._watches.get(name, ()):
                    watch.ring()
