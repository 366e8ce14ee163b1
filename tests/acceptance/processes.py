"""Processes as a user starts them, and requests as a user sends them."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import psutil

from tests.service.core import eventually
from tests.service.killing import free_port

Json = dict[str, Any]
READY_SECONDS = 120.0
STOP_SECONDS = 60.0
EDIT_SECONDS = 240.0


@dataclass(frozen=True)
class Service:
    """An API that runs, and a client of it."""

    process: subprocess.Popen[bytes]
    client: httpx.Client

    def stop(self) -> int:
        """The exit code after SIGTERM."""
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(STOP_SECONDS)

    def upload(self, name: str, content: bytes) -> httpx.Response:
        return self.client.post("/v1/meshes", params={"name": name}, content=content)

    def uploaded(self, name: str, content: bytes) -> str:
        """The id of a mesh, which must be taken."""
        answer = self.upload(name, content)
        assert answer.status_code in {200, 201}, answer.text
        return answer.json()["id"]

    def edited(self, **request: Any) -> Json:
        """The edit that a request starts, when it has succeeded."""
        answer = self.client.post("/v1/edits", headers={"Prefer": "wait=60"}, **request)
        assert answer.status_code in {201, 202}, answer.text
        return self.succeeded(answer.json())

    def succeeded(self, edit: Json) -> Json:
        """The same edit, when it has succeeded."""

        def over() -> bool:
            answer = self.client.get(edit["links"]["self"], params={"wait": 30})
            edit.update(answer.json())
            return edit["status"] not in {"queued", "running"}

        eventually(over, EDIT_SECONDS)
        assert edit["status"] == "succeeded", edit["error"]
        return edit

    def results(self, edit: Json) -> dict[str, bytes]:
        """Every result file by name; each must be as long as listed, and have the listed hash."""
        files: dict[str, bytes] = {}
        for result in edit["results"]:
            answer = self.client.get(result["href"])
            assert answer.status_code == 200, answer.text
            assert answer.headers["content-type"] == result["media_type"]
            assert len(answer.content) == result["bytes"]
            assert hashlib.sha256(answer.content).hexdigest() == result["sha256"]
            files[result["name"]] = answer.content
        return files


@contextmanager
def process(
    command: Sequence[str | Path], log: Path, *, cwd: Path, **settings: object
) -> Iterator[subprocess.Popen[bytes]]:
    """A process with QUASIFACE_… ``settings`` or, in capitals, other variables; killed at last."""
    variables = {
        name if name.isupper() else f"QUASIFACE_{name.upper()}": str(value)
        for name, value in settings.items()
    }
    with log.open("wb") as sink:
        started = subprocess.Popen(
            command, cwd=cwd, env=_environment(variables), stdout=sink, stderr=sink
        )
    try:
        yield started
    finally:
        if started.poll() is None:
            started.terminate()
            try:
                started.wait(STOP_SECONDS)
            except subprocess.TimeoutExpired:
                started.kill()
                started.wait()


def _environment(variables: Mapping[str, str]) -> dict[str, str]:
    """This process's environment, without what would lend the other one our Python."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
    return kept | dict(variables)


@contextmanager
def service(
    command: Sequence[str | Path], log: Path, *, cwd: Path, **settings: object
) -> Iterator[Service]:
    """``command`` with a free ``--port``, when it is ready."""
    port = free_port()
    with (
        process([*command, "--port", str(port)], log, cwd=cwd, **settings) as started,
        httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=120.0) as client,
    ):

        def ready() -> bool:
            assert started.poll() is None, log.read_text()[-3000:]
            try:
                return client.get("/readyz").status_code == 200
            except httpx.TransportError:
                return False

        eventually(ready, READY_SECONDS)
        yield Service(started, client)


def processes_of(folder: Path) -> list[psutil.Process]:
    """Every process that works in a folder or was told of it."""
    found: list[psutil.Process] = []
    for one in psutil.process_iter():
        try:
            told = [one.cwd(), *one.cmdline(), *one.environ().values()]
        except (psutil.NoSuchProcess, psutil.ZombieProcess, psutil.AccessDenied):
            continue
        if any(str(folder) in word for word in told):
            found.append(one)
    return found
