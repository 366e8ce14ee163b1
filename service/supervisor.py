"""``quasiface serve``: owns the database, the API and the workers, and restarts what dies."""

from __future__ import annotations

import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence

import psutil
import structlog

from service.embedded import EmbeddedPostgres, EmbeddedPostgresError
from service.processes import before_exec
from service.settings import Settings
from service.stores.records import Records

_TICK_SECONDS = 0.05
_FIRST_DELAY_SECONDS = 0.1
_LONGEST_DELAY_SECONDS = 5.0
_STABLE_SECONDS = 5.0
_API_SECONDS = 10.0
_GRACE_SECONDS = 5.0
_log = structlog.stdlib.get_logger("service.supervisor")


class _Part:
    """A process that is to run as long as the service does."""

    def __init__(self, name: str, command: Sequence[str], handles: Sequence[int] = ()) -> None:
        self.name = name
        self._command = [sys.executable, "-m", *command]
        self._handles = handles
        self._process: subprocess.Popen[bytes] | None = None
        self._delay = _FIRST_DELAY_SECONDS
        self._began = self._ended = 0.0

    @property
    def alive(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def start(self, environment: Mapping[str, str]) -> None:
        self._began, self._ended = time.monotonic(), 0.0
        self._process = subprocess.Popen(
            self._command,
            env=environment,
            stdin=subprocess.DEVNULL,
            pass_fds=self._handles,
            start_new_session=True,
            preexec_fn=before_exec(),  # noqa: PLW1509  the supervisor has one thread
        )

    def keep(self, environment: Mapping[str, str]) -> None:
        """Start it again if it has died: soon, but ever later if it keeps dying."""
        if self.alive or self._process is None:
            return
        now = time.monotonic()
        if not self._ended:
            self._ended = now
            stable = now - self._began > _STABLE_SECONDS
            longer = min(2 * self._delay, _LONGEST_DELAY_SECONDS)
            self._delay = _FIRST_DELAY_SECONDS if stable else longer
            _log.error("a process died", part=self.name, exit_code=self._process.returncode)
        if now - self._ended >= self._delay:
            self.start(environment)

    def send(self, number: signal.Signals) -> None:
        if self._process is not None and self.alive:
            self._process.send_signal(number)


class Supervisor:
    """One machine's whole service. ``run`` in the main thread of a process without others.

    ``worker`` is the module that a worker process runs, with its arguments.
    """

    def __init__(
        self, settings: Settings, worker: Sequence[str] = ("service.cli", "worker")
    ) -> None:
        self._settings = settings
        self._listener = _listen(settings)
        self._postgres = None if settings.database_url else EmbeddedPostgres(settings.data_dir)
        handle = self._listener.fileno()
        self._api = _Part("api", ["service.cli", "api", "--listener", str(handle)], [handle])
        self._workers = [_Part(f"worker {i + 1}", worker) for i in range(settings.workers)]
        self._environment: Mapping[str, str] = {}
        self._stops = 0

    def run(self) -> None:
        """Until SIGTERM or SIGINT; a second one stops at once."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._note_stop)
        try:
            self._start()
            while not self._stops:
                self._keep_alive()
                time.sleep(_TICK_SECONDS)
            self._drain()
        finally:
            self._end()

    def _note_stop(self, number: int, frame: object) -> None:
        self._stops += 1

    def _start(self) -> None:
        if self._postgres is not None:
            self._postgres.start()
            shutil.rmtree(self._settings.scratch_dir, ignore_errors=True)
        url = self._postgres.url if self._postgres else self._settings.require_database_url()
        self._environment = self._settings.child_environment(url)
        records = Records(url)
        try:
            records.migrate()
            if self._postgres is not None:
                self._recover(records)
        finally:
            records.close()
        for part in (self._api, *self._workers):
            part.start(self._environment)
        host, port = self._listener.getsockname()[:2]
        _log.info(
            "serving", url=f"http://{_in_url(host)}:{port}", data=str(self._settings.data_dir)
        )

    @staticmethod
    def _recover(records: Records) -> None:
        """The database was ours alone and has just started: no worker can be alive."""
        interrupted = records.recover_all()
        if interrupted:
            _log.warning("edits were interrupted and are queued again", edits=interrupted)

    def _keep_alive(self) -> None:
        if self._postgres is not None and not self._postgres.alive:
            _log.error("the database died and is started again")
            try:
                self._postgres.start()
            except EmbeddedPostgresError as error:
                _log.error("the database does not start", error=str(error))
                time.sleep(_FIRST_DELAY_SECONDS)
        for part in (self._api, *self._workers):
            part.keep(self._environment)

    def _drain(self) -> None:
        """Finish what runs and refuse what is new; the API ends last, so that it can be asked."""
        _log.info("draining; once more to stop at once")
        self._listener.close()
        self._api.send(signal.SIGUSR1)
        for part in self._workers:
            part.send(signal.SIGTERM)
        seconds = self._settings.drain_seconds + _GRACE_SECONDS
        self._wait(lambda: any(part.alive for part in self._workers), seconds)
        self._api.send(signal.SIGTERM)
        self._wait(lambda: self._api.alive, _API_SECONDS)

    def _wait(self, running: Callable[[], bool], seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while running() and self._stops < 2 and time.monotonic() < deadline:
            if self._postgres is not None and not self._postgres.alive:
                self._postgres.start()
            time.sleep(_TICK_SECONDS)

    def _end(self) -> None:
        """Leave no process behind, whatever state they are in."""
        self._listener.close()
        postgres = self._postgres.pid if self._postgres else None
        family = psutil.Process().children(recursive=True)
        others = [one for one in family if postgres not in (one.pid, _parent(one))]
        for part in (self._api, *self._workers):
            part.send(signal.SIGKILL)
        for part in (self._api, *self._workers):
            self._wait_for(part)
        _, left = psutil.wait_procs(others, timeout=_GRACE_SECONDS)
        for one in left:
            one.kill()
        if self._postgres is not None:
            self._postgres.stop(hard=self._stops > 1)
        _log.info("stopped")

    @staticmethod
    def _wait_for(part: _Part) -> None:
        while part.alive:
            time.sleep(_TICK_SECONDS)


def _parent(process: psutil.Process) -> int | None:
    try:
        return process.ppid()
    except psutil.NoSuchProcess:
        return None


def _listen(settings: Settings) -> socket.socket:
    """Bound by the supervisor: a port that is taken stops the start, and a restart of the API
    keeps callers waiting instead of refusing them.
    """
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    return socket.create_server((settings.host, settings.port), family=family, backlog=2048)


def _in_url(host: str) -> str:
    return f"[{host}]" if ":" in host else host
