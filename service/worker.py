"""A worker process: takes edits from the queue, one at a time, until it is told to stop."""

from __future__ import annotations

import asyncio

import psycopg
import structlog
from procrastinate import App, JobContext
from procrastinate.exceptions import ConnectorException
from psycopg_pool import AsyncConnectionPool

from service.attempt import Attempt, Workshop
from service.queue import QUEUE, RUN_EDIT, PatientConnector
from service.upkeep import Upkeep

_HEARTBEAT_SECONDS = 1.0
_POLL_SECONDS = 2.0
_RETRY_SECONDS = 0.2
_CONNECTIONS = 3
_CONNECT_SECONDS = 2.0
_FORGET_WORKERS_SECONDS = 600.0
_NEVER_SECONDS = 3600.0
_log = structlog.stdlib.get_logger("service.worker")


class Worker:
    """Runs edits from the queue behind ``url``; ``run`` returns after ``stop``."""

    def __init__(
        self, url: str, workshop: Workshop, upkeep: Upkeep, *, drain_seconds: float
    ) -> None:
        self._url = url
        self._workshop = workshop
        self._upkeep = upkeep
        self._drain_seconds = drain_seconds
        self._stopping = asyncio.Event()

    def stop(self) -> None:
        """Take no more edits; a running one goes back in the queue after ``drain_seconds``."""
        self._stopping.set()

    async def run(self) -> None:
        """Until stopped, through any restart of the database."""
        for folder in (self._workshop.scratch, self._workshop.cache):
            folder.mkdir(parents=True, exist_ok=True)
        await asyncio.to_thread(self._workshop.runner.wait_until_ready)
        upkeep = asyncio.create_task(self._upkeep.run())
        try:
            while not self._stopping.is_set():
                await self._take_edits()
        finally:
            upkeep.cancel()
            await asyncio.gather(upkeep, return_exceptions=True)

    async def _take_edits(self) -> None:
        """With one registration as a worker: until stopped, or until the connection is lost."""
        app = App(connector=PatientConnector())
        app.task(name=RUN_EDIT, queue=QUEUE, pass_context=True)(self._run_edit)
        pool = AsyncConnectionPool(
            self._url,
            min_size=1,
            max_size=_CONNECTIONS,
            timeout=_CONNECT_SECONDS,
            open=False,
        )
        try:
            async with pool, app.open_async(pool):
                working = asyncio.create_task(
                    app.run_worker_async(
                        queues=[QUEUE],
                        concurrency=1,
                        fetch_job_polling_interval=_POLL_SECONDS,
                        abort_job_polling_interval=_NEVER_SECONDS,
                        update_heartbeat_interval=_HEARTBEAT_SECONDS,
                        stalled_worker_timeout=_FORGET_WORKERS_SECONDS,
                        shutdown_graceful_timeout=self._drain_seconds,
                        delete_jobs="always",
                        install_signal_handlers=False,
                    )
                )
                stopping = asyncio.create_task(self._stopping.wait())
                await asyncio.wait({working, stopping}, return_when=asyncio.FIRST_COMPLETED)
                stopping.cancel()
                working.cancel()
                await working
        except (ConnectorException, psycopg.OperationalError) as error:
            _log.warning("the database does not answer", error=str(error.__cause__ or error))
            await asyncio.sleep(_RETRY_SECONDS)
        except asyncio.CancelledError:
            if not self._stopping.is_set():
                raise

    async def _run_edit(self, context: JobContext, edit_id: str) -> None:
        if context.job.id is None:
            raise ValueError("a job from the queue has an id")
        attempt = Attempt(self._workshop, edit_id, context.job.id)
        running = asyncio.create_task(asyncio.to_thread(attempt.run))
        try:
            await asyncio.shield(running)
        except asyncio.CancelledError:
            await asyncio.to_thread(attempt.interrupt)
            await running
            raise
