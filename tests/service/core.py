"""Helpers for the tests of the service's core: edits, worker processes, waiting."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil
from sqlalchemy import text

from service.domain import EditRecord, Json, MeshRecord
from service.stores.blobs import Blobs
from service.stores.records import Records

ROOT = Path(__file__).parents[2]


def eventually(check: Callable[[], bool], seconds: float = 90.0) -> float:
    """Wait until ``check`` holds; returns how long that took."""
    began = time.monotonic()
    while not check():
        assert time.monotonic() - began < seconds, f"not so within {seconds} s"
        time.sleep(0.01)
    return time.monotonic() - began


def gone(pid: int) -> bool:
    """Whether the process has ended (or only waits to be reaped)."""
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def new_mesh(records: Records, blobs: Blobs, content: bytes = b"a mesh") -> MeshRecord:
    key = blobs.new_key("meshes")
    stored = blobs.put_stream(key, [content])
    known = {"bytes": stored.bytes, "sha256": stored.sha256, "blob_key": key, "info": {}}
    mesh, _ = records.create_mesh(name="face.ply", format="ply", **known)
    return mesh


def new_edit(records: Records, document: Json | None = None, meshes: tuple[str, ...] = ()) -> str:
    document = document or {}
    edit, new = records.create_edit(document=document, meshes=meshes, fingerprint=str(document))
    assert new
    return edit.id


def job_of(records: Records, edit_id: str) -> int:
    query = text("SELECT job_id FROM edits WHERE id = :id")
    return records._database.run(
        lambda connection: connection.execute(query, {"id": edit_id}).scalar_one()
    )


def claim(records: Records, edit_id: str) -> EditRecord:
    edit = records.claim_attempt(edit_id, job_of(records, edit_id))
    assert edit is not None
    return edit


@dataclass
class Workers:
    """Worker processes that run ``fake_jobs:edit``."""

    url: str
    data: Path
    running: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start(self, **settings: object) -> subprocess.Popen[bytes]:
        environment = {
            **os.environ,
            "QUASIFACE_DATABASE_URL": self.url,
            "QUASIFACE_DATA_DIR": str(self.data),
            "QUASIFACE_BLOB_URL": str(self.data / "blobs"),
            "QUASIFACE_STALLED_SECONDS": "3",
            "QUASIFACE_OPEN_EDITS": "0",
            **{f"QUASIFACE_{name.upper()}": str(value) for name, value in settings.items()},
        }
        command = [sys.executable, "-m", "tests.service.fake_worker"]
        process = subprocess.Popen(command, cwd=ROOT, env=environment)
        self.running.append(process)
        return process

    def end(self) -> None:
        for process in self.running:
            process.kill()
            process.wait()


def zygote_of(worker: subprocess.Popen[bytes]) -> psutil.Process:
    """The process that the worker's children come from, once it is there."""
    eventually(lambda: bool(zygotes_under(worker.pid)))
    return zygotes_under(worker.pid)[0]


def zygotes_under(pid: int) -> list[psutil.Process]:
    """The processes below this one that children are forked from."""
    found: list[psutil.Process] = []
    for process in psutil.Process(pid).children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            parent = process.parent()
            lineage = [one.cmdline() if one else [] for one in (process, parent)]
            if ["service.zygote" in command for command in lineage] == [True, False]:
                found.append(process)
    return found


def child_of(worker: subprocess.Popen[bytes]) -> psutil.Process:
    """The child that the worker runs an edit in, once it is there."""
    zygote = zygote_of(worker)
    eventually(lambda: bool(zygote.children()))
    return zygote.children()[0]


def kill(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)


def finished(records: Records, edit_id: str, seconds: float = 120.0) -> EditRecord:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        edit = records.wait_for_change(edit_id, 10**9, deadline - time.monotonic())
        if edit.finished:
            return edit
    raise AssertionError(f"not finished within {seconds} s")


def until_running(records: Records, edit_id: str) -> None:
    eventually(lambda: records.get_edit(edit_id).status == "running")


def written(records: Records, workers: Workers, edit_id: str) -> str:
    """What the edit wrote, in its first attempt."""
    edit = finished(records, edit_id)
    assert (edit.status, edit.attempt, edit.error) == ("succeeded", 1, None)
    (result,) = records.list_results(edit_id)
    blobs = Blobs(str(workers.data / "blobs"))
    return blobs.get_range(result.blob_key, 0, result.bytes).decode()


def holder(records: Records, workers: Workers, name: str) -> int:
    """The process that a worker keeps open for edits of this name, once there is one."""
    found: list[str] = []

    def held() -> bool:
        found.append(written(records, workers, new_edit(records, {"name": name})))
        return found[-1].startswith("from ")

    eventually(held, 120.0)
    assert found[0] == " []"
    return int(found[-1].split()[1])
