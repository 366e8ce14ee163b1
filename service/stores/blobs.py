"""Bytes under unique keys, in a folder or in any S3 bucket."""

from __future__ import annotations

import hashlib
import os
import secrets
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from urllib.parse import unquote, urlsplit

import obstore
from obstore.store import LocalStore, S3Store

from service.domain import NotFound

CHUNK = 1024 * 1024
_PART = 8 * CHUNK


class BlobUrlError(ValueError):
    """The blob URL names no kind of store that there is."""


@dataclass(frozen=True, slots=True)
class Stored:
    """What was stored: its length and SHA-256 (hex)."""

    bytes: int
    sha256: str


class Blobs:
    """A blob store. Keys are never reused: put under a fresh key, delete, but never replace.

    ``url`` is a folder's path, ``file:///folder`` or ``s3://bucket/prefix``; S3 takes its
    endpoint and credentials from the usual ``AWS_…`` variables.
    """

    def __init__(self, url: str) -> None:
        self._folder: Path | None = None
        parts = urlsplit(url)
        if parts.scheme == "s3":
            # Whether http is used at all is up to the endpoint that the environment names.
            self._store = S3Store.from_url(url, client_options={"allow_http": True})
        elif parts.scheme in ("", "file"):
            self._folder = Path(unquote(parts.path) if parts.scheme else url).absolute()
            self._store = LocalStore(self._folder, mkdir=True)
        else:
            raise BlobUrlError(f"blobs go to a folder or to s3://bucket/prefix, not to {url}")

    @staticmethod
    def new_key(*parts: str) -> str:
        """A key that was never used, beginning with readable parts: ``meshes/<random>``."""
        return "/".join((*parts, secrets.token_hex(16)))

    def put_file(self, key: str, path: Path) -> Stored:
        """Store a file under a fresh key."""
        with path.open("rb") as file:
            return self.put_stream(key, iter(lambda: file.read(CHUNK), b""))

    def put_stream(self, key: str, chunks: Iterable[bytes]) -> Stored:
        """Store chunks as they come; nothing is kept if the iteration raises."""
        measured = _Measured(chunks)
        obstore.put(self._store, key, measured, chunk_size=_PART, max_concurrency=4)
        if self._folder is not None:
            _flush(self._folder / key)
        return Stored(measured.bytes, measured.digest.hexdigest())

    def size(self, key: str) -> int:
        """Length in bytes; NotFound if there is no such blob."""
        try:
            return obstore.head(self._store, key)["size"]
        except FileNotFoundError:
            raise _missing(key) from None

    def iterate(self, key: str, start: int = 0, end: int | None = None) -> Iterator[bytes]:
        """The bytes from ``start`` to before ``end``, in chunks of about 1 MiB; NotFound."""
        stop = self.size(key) if end is None else end
        if start >= stop:
            return
        try:
            got = obstore.get(self._store, key, options={"range": (start, stop)})
        except FileNotFoundError:
            raise _missing(key) from None
        for chunk in got.stream(min_chunk_size=CHUNK):
            yield bytes(chunk)

    def get_range(self, key: str, start: int, end: int) -> bytes:
        """The bytes from ``start`` to before ``end`` at once; NotFound."""
        return b"".join(self.iterate(key, start, end))

    def delete(self, *keys: str) -> None:
        """Delete; those that are not there are no error."""
        for key in keys:
            try:
                obstore.delete(self._store, key)
            except FileNotFoundError:
                continue

    def local_path(self, key: str, scratch: Path) -> Path:
        """A file with these bytes, not to be written to: the store's own, or a download.

        A download goes to a file under the folder ``scratch``. NotFound if there is no such blob.
        """
        if self._folder is not None:
            path = self._folder / key
            if not path.is_file():
                raise _missing(key)
            return path
        path = scratch / key.replace("/", "-")
        with path.open("wb") as file:
            for chunk in self.iterate(key):
                file.write(chunk)
        return path

    def keys_older_than(self, prefix: str, seconds: float) -> Iterator[str]:
        """The keys under ``prefix`` that were stored at least ``seconds`` ago."""
        latest = datetime.now(UTC) - timedelta(seconds=seconds)
        for batch in obstore.list(self._store, prefix):
            for blob in batch:
                if blob["last_modified"] < latest:
                    yield blob["path"]


class _Measured:
    """Counts and hashes chunks on their way."""

    def __init__(self, chunks: Iterable[bytes]) -> None:
        self._chunks = iter(chunks)
        self.bytes = 0
        self.digest = hashlib.sha256()

    def __iter__(self) -> Iterator[bytes]:
        return self

    def __next__(self) -> bytes:
        chunk = next(self._chunks)
        self.bytes += len(chunk)
        self.digest.update(chunk)
        return chunk


def _missing(key: str) -> NotFound:
    return NotFound(f"there is no blob {key}")


def _flush(path: Path) -> None:
    """Onto the disk: a record that names this blob must not outlive it in a power failure."""
    for target in (path, path.parent):
        handle = os.open(target, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
