"""Bytes under unique keys, in a folder or in any S3 bucket."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Stored:
    """What was stored: its length and SHA-256 (hex)."""

    bytes: int
    sha256: str


class Blobs:
    """A blob store. Keys are never reused: put under a fresh key, delete, but never replace."""

    def __init__(self, url: str) -> None:
        raise NotImplementedError

    @staticmethod
    def new_key(*parts: str) -> str:
        """A key that was never used, under readable parts: ``meshes/<random>``."""
        raise NotImplementedError

    def put_file(self, key: str, path: Path) -> Stored:
        """Store a file."""
        raise NotImplementedError

    def put_stream(self, key: str, chunks: Iterable[bytes]) -> Stored:
        """Store chunks as they come; nothing is kept if the iteration raises."""
        raise NotImplementedError

    def size(self, key: str) -> int:
        """Length in bytes; NotFound if there is no such blob."""
        raise NotImplementedError

    def iterate(self, key: str, start: int = 0, end: int | None = None) -> Iterator[bytes]:
        """The bytes ``start`` to ``end`` (exclusive), in chunks of at most 1 MiB."""
        raise NotImplementedError

    def get_range(self, key: str, start: int, end: int) -> bytes:
        """The bytes ``start`` to ``end`` (exclusive) at once."""
        raise NotImplementedError

    def delete(self, key: str) -> None:
        """Delete; nothing happens if it is not there."""
        raise NotImplementedError

    def local_path(self, key: str, scratch: Path) -> Path:
        """A file with these bytes, not to be written: the store's own, or a download."""
        raise NotImplementedError
