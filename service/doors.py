"""Sockets by name in a private folder: how the workers of a machine find each other's processes."""

from __future__ import annotations

import os
import secrets
import socket
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path


class Doors:
    """A folder of listening sockets; one whose process is gone is removed by whoever finds it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def make(self) -> tuple[socket.socket, str]:
        """A socket that listens behind a name that nobody knows yet."""
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        door, name = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET), secrets.token_hex(8)
        with self._short(name) as path:
            door.bind(path)
        door.listen()
        return door, name

    def rename(self, before: str, name: str) -> bool:
        """Make a door known; False, and it is removed, if there is one of that name."""
        try:
            os.link(self._folder / before, self._folder / name)
        except FileExistsError:
            return False
        finally:
            self.remove(before)
        return True

    def enter(self, name: str) -> socket.socket | None:
        """A connection, if anybody is there; it counts as a use."""
        caller = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            with self._short(name) as path:
                caller.connect(path)
            now = time.time_ns()
            os.utime(self._folder / name, ns=(now, now))
        except ConnectionRefusedError:
            self.remove(name)
        except FileNotFoundError:
            pass
        else:
            return caller
        caller.close()
        return None

    def last_use(self, name: str) -> int:
        """When it was last entered, in nanoseconds; 0 if it is gone."""
        try:
            return (self._folder / name).stat().st_mtime_ns
        except FileNotFoundError:
            return 0

    def remove(self, name: str) -> None:
        """Nobody finds it any more."""
        (self._folder / name).unlink(missing_ok=True)

    @contextmanager
    def _short(self, name: str) -> Generator[str]:
        """A path that fits into a socket's address, wherever the folder is."""
        handle = os.open(self._folder, os.O_PATH | os.O_DIRECTORY)
        try:
            yield f"/proc/self/fd/{handle}/{name}"
        finally:
            os.close(handle)
