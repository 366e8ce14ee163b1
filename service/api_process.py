"""The process that answers HTTP."""

from __future__ import annotations

import signal
import socket
import threading
from types import FrameType
from typing import NoReturn

import uvicorn

from service import logs
from service.app import create_app
from service.runner import Runner
from service.settings import Settings
from service.stores.blobs import Blobs
from service.stores.records import Records

_GRACE_SECONDS = 8
_BACKLOG = 2048


class _Server(uvicorn.Server):
    """Tells the application first that its end is near."""

    def __init__(self, config: uvicorn.Config, draining: threading.Event) -> None:
        super().__init__(config)
        self._draining = draining

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self._draining.set()
        super().handle_exit(sig, frame)


def run_api(settings: Settings, listener: socket.socket | None = None) -> None:
    """Serve until SIGTERM or SIGINT. After SIGUSR1 it answers, but takes no new work."""
    logs.configure(settings.log_level)
    draining = threading.Event()
    signal.signal(signal.SIGUSR1, lambda number, frame: draining.set())
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _end)
    records = Records(
        settings.require_database_url(),
        queue_limit=settings.queue_limit,
        result_ttl=settings.result_ttl,
        max_attempts=settings.max_attempts,
    )
    runner = Runner()
    try:
        records.migrate()
        app = create_app(settings, records, Blobs(settings.blobs), runner, draining=draining)
        config = uvicorn.Config(
            app,
            host=settings.host,
            port=settings.port,
            backlog=_BACKLOG,
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=_GRACE_SECONDS,
        )
        _Server(config, draining).run(sockets=None if listener is None else [listener])
    finally:
        runner.close()
        records.close()


def _end(number: int, frame: FrameType | None) -> NoReturn:
    """Close what is open, and succeed: uvicorn raises the signal that ended it once more."""
    raise SystemExit(0)
