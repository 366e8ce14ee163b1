"""A database, a folder and workers for the tests of the service's core."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import text

from service.embedded import EmbeddedPostgres
from service.stores.blobs import Blobs
from service.stores.records import Records
from tests.service.core import Workers


@pytest.fixture(scope="session")
def postgres(tmp_path_factory: pytest.TempPathFactory) -> Iterator[EmbeddedPostgres]:
    server = EmbeddedPostgres(tmp_path_factory.mktemp("core database"))
    server.start()
    yield server
    server.stop()


@pytest.fixture(scope="session")
def migrated(postgres: EmbeddedPostgres) -> str:
    records = Records(postgres.url)
    records.migrate()
    records.close()
    return postgres.url


@pytest.fixture
def records(migrated: str) -> Iterator[Records]:
    store = Records(migrated, patience=20.0)
    empty = "TRUNCATE meshes, edits, procrastinate_jobs CASCADE"
    store._database.run(lambda connection: connection.execute(text(empty)))
    yield store
    store.close()


@pytest.fixture
def blobs(tmp_path: Path) -> Blobs:
    return Blobs(str(tmp_path / "blobs"))


@pytest.fixture
def workers(migrated: str, tmp_path: Path) -> Iterator[Workers]:
    made = Workers(migrated, tmp_path)
    yield made
    made.end()
