"""One service for the tests that only send it requests."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

from tests.acceptance.processes import Service, service
from tests.service.core import ROOT


@pytest.fixture(scope="session")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("acceptance")
    command = [sys.executable, "-m", "service.cli", "serve", "--data-dir", folder / "data"]
    with service(command, folder / "log", cwd=ROOT) as started:
        yield started
