"""A relay between a client and the database that may lose the answer to one commit."""

from __future__ import annotations

import selectors
import socket
import threading
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

from sqlalchemy.engine import make_url

_SOCKET = ".s.PGSQL.5432"
_BYTES = 1 << 16


class Relay:
    """Relays connections to ``url``'s database; ``lose_commit_of`` breaks one of them."""

    def __init__(self, url: str, folder: Path) -> None:
        host = make_url(url).query["host"]
        assert isinstance(host, str)
        self._server = str(Path(host) / _SOCKET)
        self.url = url.replace(quote(host, safe=""), quote(str(folder), safe=""))
        assert self.url != url
        self._statement: bytes | None = None
        self._then_away = False
        self._away = False
        self.lost = threading.Event()
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(folder / _SOCKET))
        self._listener.listen()
        threading.Thread(target=self._accept, daemon=True).start()

    def lose_commit_of(self, statement: bytes, *, then_away: bool) -> None:
        """The next commit after ``statement`` is done, its answer lost; then nothing answers."""
        self._statement, self._then_away = statement, then_away

    def close(self) -> None:
        """Take no more connections."""
        self._away = True
        self._listener.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                threading.Thread(target=self._relay, args=(client,), daemon=True).start()

    def _relay(self, client: socket.socket) -> None:
        with client, socket.socket(socket.AF_UNIX) as server, suppress(OSError):
            server.connect(self._server)
            both = selectors.DefaultSelector()
            both.register(client, selectors.EVENT_READ, (client, server))
            both.register(server, selectors.EVENT_READ, (server, client))
            marked = False
            while True:
                for key, _ in both.select():
                    sender, receiver = key.data
                    data = sender.recv(_BYTES)
                    if not data or self._away:
                        return
                    receiver.sendall(data)
                    asked = sender is client and self._statement is not None
                    marked = marked or (asked and self._statement in data)
                    if asked and marked and b"COMMIT" in data:
                        server.recv(_BYTES)
                        self._statement, self._away = None, self._then_away
                        self.lost.set()
                        return
