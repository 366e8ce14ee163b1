"""Settings: safe by default, and secrets stay secret."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from service.settings import ConfigurationError, Settings
from tests.service.core import ROOT

LOG_EVERYTHING = """
import logging, structlog
from service import logs
from service.settings import Settings
settings = Settings()
logs.configure("DEBUG")
structlog.stdlib.get_logger("test").warning("settings", all=settings, keys=settings.api_keys)
logging.getLogger("other").warning("and %s", settings)
"""


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.0.0.5"])
def test_this_machine_alone_needs_no_key(host: str) -> None:
    Settings(host=host).require_safe_bind()


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "example.org"])
def test_others_need_one_or_an_explicit_switch(host: str) -> None:
    with pytest.raises(ConfigurationError, match="QUASIFACE_API_KEYS"):
        Settings(host=host).require_safe_bind()
    Settings(host=host, allow_open=True).require_safe_bind()
    Settings(host=host, api_keys="one, two").require_safe_bind()


def test_keys_come_as_a_list_and_never_reach_a_log(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QUASIFACE_API_KEYS", "secret-one, secret-two,")
    monkeypatch.setenv("QUASIFACE_DATABASE_URL", "postgresql://me:secret-three@host/db")
    settings = Settings()
    assert [key.get_secret_value() for key in settings.api_keys] == ["secret-one", "secret-two"]
    assert "secret" not in repr(settings)
    command = [sys.executable, "-c", LOG_EVERYTHING]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    lines = [json.loads(line) for line in ended.stderr.splitlines()]
    assert [line["logger"] for line in lines] == ["test", "other"]
    assert "secret-" not in ended.stderr


def test_children_work_with_the_same_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QUASIFACE_JOB_SECONDS", "7")
    environment = Settings(port=1234, data_dir="here").child_environment("postgresql://x")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    child = Settings()
    assert (child.port, child.job_seconds) == (1234, 7.0)
    assert child.data_dir.is_absolute()
    assert child.require_database_url() == "postgresql://x"
