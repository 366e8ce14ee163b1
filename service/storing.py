"""Result files on their way into the blob store, while the edit that writes them still runs."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Self

from obstore.exceptions import BaseError as BlobStoreError

from service.domain import ResultRecord
from service.jobtypes import ResultFile
from service.stores.blobs import Blobs, Stored

_AT_ONCE = 8  # each waits for the disk


class Storing:
    """Puts files under fresh keys; what is not ``published`` in the end is deleted again."""

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self._pool = ThreadPoolExecutor(_AT_ONCE)
        self._begun: dict[Path, tuple[str, Future[Stored]]] = {}
        self.published = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pool.shutdown(cancel_futures=True)
        if not self.published:
            self.forget()

    def put(self, path: Path) -> None:
        """Begin with a file that is complete; no more than once."""
        if path not in self._begun:
            key = self._blobs.new_key("results")
            self._begun[path] = key, self._pool.submit(self._blobs.put_file, key, path)

    def stored(self, edit_id: str, files: Sequence[ResultFile]) -> list[ResultRecord]:
        """The records of ``files``, when all are stored; raises what storing one raised."""
        for file in files:
            self.put(file.path)
        return [self._record(edit_id, file) for file in files]

    def _record(self, edit_id: str, file: ResultFile) -> ResultRecord:
        key, storing = self._begun[file.path]
        kept = storing.result()
        return ResultRecord(
            edit_id=edit_id,
            name=file.name,
            role=file.role,
            meta=file.meta,
            media_type=file.media_type,
            bytes=kept.bytes,
            sha256=kept.sha256,
            blob_key=key,
        )

    def forget(self) -> None:
        """Delete everything that was stored; the same paths may then be put once more."""
        for key, storing in self._begun.values():
            if not storing.cancel():
                with suppress(BlobStoreError, OSError):
                    storing.result()
                self._blobs.delete(key)
        self._begun.clear()
