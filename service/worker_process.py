"""The process that runs edits."""

from __future__ import annotations

import asyncio
import signal

from service import logs
from service.attempt import Workshop
from service.openings import Openings, Room
from service.runner import Limits, Runner
from service.settings import Settings
from service.stores.blobs import Blobs
from service.stores.records import Records
from service.upkeep import Upkeep
from service.worker import Worker

RUN_EDIT = "service.jobs:run_edit"
KEEP_OPEN = "service.jobs:keep_open"
_PATIENCE_SECONDS = 300.0


async def run_worker(settings: Settings, function: str = RUN_EDIT, opener: str = KEEP_OPEN) -> None:
    """Run edits, each by ``function`` in a child, until SIGTERM or SIGINT; a second one kills.

    ``opener`` is the function that opens edits for others to start from.
    """
    logs.configure(settings.log_level)
    url = settings.require_database_url()
    records = Records(
        url,
        result_ttl=settings.result_ttl,
        max_attempts=settings.max_attempts,
        patience=_PATIENCE_SECONDS,
    )
    blobs = Blobs(settings.blobs)
    runner = Runner((function.partition(":")[0], "engine._jit:load_kept_kernels"))
    limits = Limits(settings.job_seconds, settings.job_memory_bytes)
    room = Room(settings.open_edits, settings.open_bytes)
    openings = Openings(
        runner, opener, limits, room, folder=settings.open_dir, scratch=settings.scratch_dir
    )
    worker = Worker(
        url,
        Workshop(
            records=records,
            blobs=blobs,
            runner=runner,
            openings=openings,
            limits=limits,
            scratch=settings.scratch_dir,
            cache=settings.cache_dir,
            function=function,
        ),
        Upkeep(
            records,
            blobs,
            cache=settings.cache_dir,
            cache_bytes=settings.cache_bytes,
            stalled_seconds=settings.stalled_seconds,
        ),
        drain_seconds=settings.drain_seconds,
    )
    _stop_on_signals(worker)
    try:
        await asyncio.to_thread(records.migrate)
        await worker.run()
    finally:
        openings.close()
        runner.close()
        records.close()


def _stop_on_signals(worker: Worker) -> None:
    loop = asyncio.get_running_loop()

    def stop() -> None:
        worker.stop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.remove_signal_handler(number)
            signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop)
