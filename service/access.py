"""Access keys: who may use the service."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import sha256
from hmac import compare_digest

from service.errors import KeyMissingError, KeyRefusedError

CHALLENGE = {"WWW-Authenticate": 'Bearer realm="quasiface"'}


class Access:
    """The keys that open the service; with none it is open to everyone who reaches it."""

    def __init__(self, keys: Iterable[str] = ()) -> None:
        self._digests = [_digest(key) for key in keys]

    @property
    def open(self) -> bool:
        """Whether no key is asked for."""
        return not self._digests

    def check(self, key: str | None) -> None:
        """Raise KeyMissingError or KeyRefusedError; takes as long for a near miss as for any."""
        if self.open:
            return
        if not key:
            raise KeyMissingError(
                "Send an access key as `Authorization: Bearer <key>` or `X-API-Key: <key>`",
                headers=CHALLENGE,
            )
        given = _digest(key)
        matches = [compare_digest(given, digest) for digest in self._digests]
        if not any(matches):
            raise KeyRefusedError("The access key that was sent opens nothing here")


def _digest(key: str) -> bytes:
    return sha256(key.encode("utf-8", "surrogatepass")).digest()
