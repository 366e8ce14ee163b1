"""gzip on the way in: unpacked piece by piece, and never beyond a limit."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator

from service.errors import InvalidError, TooLargeError
from service.schemas import ProblemError

PIECE = 1024**2
MAGIC = b"\x1f\x8b"
MAX_MEMBERS = 100_000
_GZIP = 16 + zlib.MAX_WBITS


class Gunzip:
    """Unpacks the members of a gzip file, which may come in any pieces."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._member = zlib.decompressobj(_GZIP)
        self._members = 1
        self._read = self._written = 0

    def feed(self, data: bytes) -> Iterator[bytes]:
        """What the next bytes unpack to, in pieces of at most 1 MiB.

        Raises TooLargeError beyond the limit, InvalidError for what is no gzip.
        """
        self._read += len(data)
        more = True
        while data or more:
            if self._member.eof:
                data = data.lstrip(b"\0")  # padding
                if not data:
                    return
                self._begin_member()
            piece = self._unpack(data)
            if piece:
                yield piece
            more = len(piece) == PIECE
            data = self._member.unused_data or self._member.unconsumed_tail

    def finish(self) -> None:
        """Raises InvalidError unless the last member is complete."""
        if not self._member.eof:
            raise _damaged(f"the gzip data end in the middle, at byte {self._read}", self._read)

    def _begin_member(self) -> None:
        self._members += 1
        if self._members > MAX_MEMBERS:
            raise _damaged(f"the gzip data have more than {MAX_MEMBERS} members", self._read)
        self._member = zlib.decompressobj(_GZIP)

    def _unpack(self, data: bytes) -> bytes:
        try:
            piece = self._member.decompress(data, PIECE)
        except zlib.error as error:
            raise _damaged(
                f"the gzip data are damaged, before byte {self._read} ({error}): pack them again",
                self._read,
            ) from error
        self._written += len(piece)
        if self._written > self._limit:
            message = f"The body unpacks to more than the limit of {self._limit} bytes"
            raise TooLargeError(message, errors=[_too_large(message, self._limit)])
        return piece


class Unpacked:
    """The chunks of a file, unpacked if its first bytes say that it is gzip."""

    def __init__(self, chunks: Iterable[bytes], limit: int) -> None:
        self._chunks = iter(chunks)
        self._limit = limit
        self.packed = False

    def __iter__(self) -> Iterator[bytes]:
        start = b""
        for chunk in self._chunks:
            start += chunk
            if len(start) >= len(MAGIC):
                break
        if not start.startswith(MAGIC):
            yield start
            yield from self._chunks
            return
        self.packed = True
        gunzip = Gunzip(self._limit)
        yield from gunzip.feed(start)
        for chunk in self._chunks:
            yield from gunzip.feed(chunk)
        gunzip.finish()


def _too_large(message: str, limit: int) -> ProblemError:
    return ProblemError(code="too_large", message=message, elements={"limit": limit})


def _damaged(message: str, byte: int) -> InvalidError:
    error = ProblemError(code="gzip", message=message, elements={"byte": byte})
    return InvalidError(message, errors=[error])
