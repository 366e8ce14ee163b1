"""Servers for the tests of the HTTP layer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from threading import Event

import pytest

from service.dependencies import JobNames
from service.embedded import EmbeddedPostgres
from service.runner import Runner
from service.settings import Settings
from service.stores.blobs import Blobs
from service.stores.records import Records
from tests.service.http_server import Parts, Server, serving


@pytest.fixture(scope="session")
def http_parts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Parts]:
    folder = tmp_path_factory.mktemp("http")
    postgres = EmbeddedPostgres(folder)
    postgres.start()
    records = Records(postgres.url, patience=5.0)
    records.migrate()
    runner = Runner()
    settings = Settings(data_dir=folder, max_upload_bytes=8 * 1024**2, inspect_seconds=60)
    yield Parts(postgres.url, settings, records, Blobs(str(folder / "blobs")), runner, Event())
    runner.close()
    records.close()
    postgres.stop()


@pytest.fixture(scope="session")
def shared_server(http_parts: Parts) -> Iterator[Server]:
    with serving(http_parts) as server:
        yield server


@pytest.fixture
def server(shared_server: Server) -> Iterator[Server]:
    yield shared_server
    end_all(shared_server.parts.records)


@pytest.fixture
def serve(http_parts: Parts) -> Iterator[Callable[..., Server]]:
    """Make another server on the same parts, with some settings or jobs changed."""
    with ExitStack() as stack:

        def make(jobs: JobNames | None = None, **changes: object) -> Server:
            settings = http_parts.settings.model_copy(update=changes)
            records = Records(http_parts.url, queue_limit=settings.queue_limit, patience=5.0)
            stack.callback(records.close)
            parts = replace(http_parts, settings=settings, records=records, draining=Event())
            return stack.enter_context(serving(parts, jobs))

        yield make


def end_all(records: Records) -> None:
    """Cancel what a test left in the queue."""
    for edit in records.list_edits(200, None, "queued").items:
        records.request_cancel(edit.id)
