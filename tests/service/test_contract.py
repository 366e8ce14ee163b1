"""The service against its own OpenAPI document, by schemathesis: all checks, in chains too."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from pydantic import SecretStr

from tests.service.http_server import Serve

pytest_plugins = ["tests.service.http_fixtures"]
ROOT = Path(__file__).parents[2]
CONFIG = Path(__file__).with_name("schemathesis.toml")


def test_the_service_keeps_its_contract(serve: Serve) -> None:
    locked = serve(api_keys=(SecretStr("key"),))
    command = ["schemathesis.cli", "--config-file", str(CONFIG), "run", "--checks", "all"]
    run = subprocess.run(
        [sys.executable, "-m", *command, f"{locked.url}/openapi.json"],
        cwd=ROOT,
        env={**os.environ, "CONTRACT_KEY": "key"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-8000:] + run.stderr[-2000:]
