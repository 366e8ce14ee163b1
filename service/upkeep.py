"""What has to be done again and again: find lost edits, drop what has expired, tidy the cache."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from pathlib import Path

import structlog
from obstore.exceptions import BaseError as BlobStoreError

from service.domain import Unavailable
from service.failures import attempts_exhausted
from service.stores.blobs import Blobs
from service.stores.records import Records

_ORPHAN_SECONDS = 24 * 3600.0
_RECOVER_EVERY = 1.0
_TIDY_EVERY = 300.0
_log = structlog.stdlib.get_logger("service.upkeep")


class Upkeep:
    """Every worker does it; doing it twice at once does no harm."""

    def __init__(
        self,
        records: Records,
        blobs: Blobs,
        *,
        cache: Path,
        cache_bytes: int,
        stalled_seconds: float,
    ) -> None:
        self._records = records
        self._blobs = blobs
        self._cache = cache
        self._cache_bytes = cache_bytes
        self._stalled_seconds = stalled_seconds
        self._answering_since: float | None = None

    async def run(self) -> None:
        """For ever, until canceled."""
        await asyncio.gather(
            _repeat(self.recover_lost, _RECOVER_EVERY),
            _repeat(self.drop_expired, _TIDY_EVERY),
            _repeat(self.drop_orphans, _ORPHAN_SECONDS),
            _repeat(self.trim_cache, _TIDY_EVERY),
        )

    def recover_lost(self) -> None:
        """Put edits back into the queue whose worker fell silent.

        Only while the database has answered for as long as that silence: in an outage all
        workers seem lost.
        """
        try:
            self._records.ping()
            now = time.monotonic()
            self._answering_since = self._answering_since or now
            if now - self._answering_since < self._stalled_seconds:
                return
            lost = self._records.recover_lost(self._stalled_seconds, attempts_exhausted())
        except Unavailable:
            self._answering_since = None
            raise
        if lost:
            _log.warning("edits lost their worker", edits=lost)

    def drop_expired(self) -> None:
        """Delete results whose time is over."""
        self._blobs.delete(*self._records.expire_results())

    def drop_orphans(self) -> None:
        """Delete blobs that no record names, left by a process that was killed in between."""
        for prefix in ("meshes", "results"):
            old = list(self._blobs.keys_older_than(prefix, _ORPHAN_SECONDS))
            self._blobs.delete(*self._records.unnamed_blobs(old))

    def trim_cache(self) -> None:
        """Delete the cached files that were unused for longest, down to the size allowed."""
        found = [(path, path.stat()) for path in self._cache.rglob("*") if path.is_file()]
        total = sum(stat.st_size for _, stat in found)
        for path, stat in sorted(found, key=lambda item: item[1].st_atime):
            if total <= self._cache_bytes:
                break
            path.unlink(missing_ok=True)
            total -= stat.st_size


async def _repeat(task: Callable[[], None], seconds: float) -> None:
    while True:
        began = time.monotonic()
        try:
            await asyncio.to_thread(task)
        except (Unavailable, BlobStoreError, FileNotFoundError) as error:
            _log.warning("upkeep is postponed", task=task.__name__, error=str(error))
        await asyncio.sleep(max(0.0, seconds - (time.monotonic() - began)))
