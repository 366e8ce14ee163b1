"""A whole service that is killed, in parts and altogether, while edits come in over HTTP."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

import httpx
import psutil

from service.stores.blobs import Blobs
from service.stores.records import Records
from tests.service.core import ROOT, eventually, new_mesh, zygotes_under

PARTS = ("api", "worker", "zygote", "child", "database", "everything")


@dataclass
class Stack:
    """A supervisor process and what belongs to it; ``start`` again after a kill."""

    data: Path
    module: tuple[str, ...] = ("tests.service.fake_stack", "steady")
    settings: dict[str, str] = field(default_factory=dict[str, str])
    port: int = 0
    process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        self.port = self.port or free_port()
        environment = {
            **os.environ,
            "QUASIFACE_HOST": "127.0.0.1",
            "QUASIFACE_PORT": str(self.port),
            "QUASIFACE_DATA_DIR": str(self.data),
            "QUASIFACE_STALLED_SECONDS": "3",
            **self.settings,
        }
        self.data.mkdir(parents=True, exist_ok=True)
        with (self.data / "service.log").open("ab") as log:
            command = [sys.executable, "-m", *self.module]
            self.process = subprocess.Popen(
                command, cwd=ROOT, env=environment, stdout=log, stderr=log
            )

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def wait_until_ready(self, seconds: float = 180.0) -> None:
        def ready() -> bool:
            assert self.process is not None
            assert self.process.poll() is None, (self.data / "service.log").read_text()[-3000:]
            try:
                return httpx.get(f"{self.url}/readyz", timeout=5.0).status_code == 200
            except httpx.TransportError:
                return False

        eventually(ready, seconds)

    def family(self) -> list[psutil.Process]:
        """Every process of the service, the supervisor first."""
        assert self.process is not None
        supervisor = psutil.Process(self.process.pid)
        return [supervisor, *supervisor.children(recursive=True)]

    def members(self, part: str) -> list[psutil.Process]:
        """The processes of one part, as far as they run at the moment."""
        supervisor, *others = self.family()
        named = {
            "api": lambda process: "--listener" in process.cmdline(),
            "worker": lambda process: "tests.service.fake_worker" in process.cmdline(),
            "database": lambda process: process.cmdline()[0].endswith("bin/postgres"),
        }
        if part in named:
            return [one for one in others if one.ppid() == supervisor.pid and named[part](one)]
        zygotes = zygotes_under(supervisor.pid)
        if part == "zygote":
            return zygotes
        return [child for zygote in zygotes for child in zygote.children(recursive=True)]

    def records(self) -> Records:
        """The service's records, past the API."""
        host = quote((self.data / "postgres.socket").read_text(), safe="")
        return Records(f"postgresql://quasiface@/postgres?host={host}")

    def stop(self, seconds: float = 120.0) -> int:
        assert self.process is not None
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        return self.process.wait(seconds)


@contextmanager
def running(stack: Stack) -> Iterator[Stack]:
    stack.start()
    try:
        stack.wait_until_ready()
        yield stack
    finally:
        assert stack.process is not None
        with suppress(subprocess.TimeoutExpired):
            stack.stop()
        stack.process.kill()
        stack.process.wait()


@dataclass
class Tally:
    """What became of the edits that were accepted."""

    kills: Counter[str]
    accepted: int
    succeeded: int
    crashed: int
    exhausted: int
    lost: list[str]
    twice: list[str]
    reruns: int
    slowest: float

    def __str__(self) -> str:
        return (
            f"kills {dict(self.kills)}\naccepted {self.accepted}, succeeded {self.succeeded}, "
            f"failed because their own child was killed {self.crashed}, "
            f"because they lost their worker three times {self.exhausted}, "
            f"lost {len(self.lost)} {self.lost}, published twice {len(self.twice)}, "
            f"attempts run again {self.reruns}, slowest {self.slowest:.1f} s"
        )


class Client:
    """Sends edits one after the other, each until it is accepted, as a careful client does."""

    def __init__(self, stack: Stack, mesh: str, pause: float = 0.1) -> None:
        self.accepted: list[str] = []
        self._stack = stack
        self._pause = pause
        point = {"name": "nose", "at": {"vertex": 1}, "move": [0.0, 0.0, 1.0]}
        self._edit = {"source": mesh, "control_points": {"points": [point]}}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.failure: str | None = None

    def __enter__(self) -> Client:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        number = 0
        while not self._over.is_set() and self.failure is None:
            try:
                answer = httpx.post(
                    f"{self._stack.url}/v1/edits",
                    json=self._edit,
                    headers={"Idempotency-Key": f"edit {number}"},
                    timeout=20.0,
                )
            except httpx.TransportError:
                time.sleep(0.05)
                continue
            if answer.status_code == 202:
                self.accepted.append(answer.json()["id"])
                number += 1
                time.sleep(self._pause)
            elif answer.status_code == 503:
                time.sleep(0.05)
            else:
                self.failure = answer.text


def kill_at_random(
    stack: Stack,
    kills: int,
    pause: tuple[float, float],
    seed: int,
    parts: Sequence[str] = PARTS,
) -> tuple[Counter[str], list[str]]:
    """Kill ``kills`` times while edits come in; returns the kills and the edits accepted."""
    chance = random.Random(seed)
    done: Counter[str] = Counter()
    with Client(stack, known_mesh(stack)) as client:
        while done.total() < kills and client.failure is None:
            time.sleep(chance.uniform(*pause))
            part = chance.choice(parts)
            try:
                done[part] += _kill(stack, part, chance)
            except psutil.NoSuchProcess:
                continue  # it ended by itself while we looked for it
    assert client.failure is None, client.failure
    return done, client.accepted


def known_mesh(stack: Stack) -> str:
    """A mesh that the service takes for inspected."""
    records, blobs = stack.records(), Blobs(str(stack.data / "blobs"))
    mesh = new_mesh(records, blobs)
    with records._database.engine.begin() as connection:
        connection.exec_driver_sql('UPDATE meshes SET info = \'{"vertices": 9, "polygons": 9}\'')
    records.close()
    return mesh.id


def _kill(stack: Stack, part: str, chance: random.Random) -> int:
    if part == "everything":
        family = stack.family()
        for process in family:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        assert stack.process is not None
        stack.process.wait()
        stack.start()
        return 1
    members = stack.members(part)
    if not members:
        return 0
    chance.choice(members).kill()
    return 1


def tally(stack: Stack, kills: Counter[str], accepted: list[str], seconds: float) -> Tally:
    """Wait for all that was accepted, and see what became of it."""
    stack.wait_until_ready()
    records, blobs = stack.records(), Blobs(str(stack.data / "blobs"))
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        counts = records.queue_counts()
        if not counts.get("queued") and not counts.get("running"):
            break
        time.sleep(0.2)
    result = Tally(kills, len(accepted), 0, 0, 0, [], [], 0, 0.0)
    for edit_id in accepted:
        edit = records.get_edit(edit_id)
        result.reruns += max(0, edit.attempt - 1)
        if edit.status == "failed" and edit.error is not None:
            code = edit.error["errors"][0]["code"]
            result.crashed += code == "worker_crashed"
            result.exhausted += code == "attempts_exhausted"
            if code not in {"worker_crashed", "attempts_exhausted"}:
                result.lost.append(f"{edit_id} {code}")
        elif edit.status != "succeeded" or edit.finished_at is None:
            result.lost.append(f"{edit_id} {edit.status}")
        else:
            result.succeeded += 1
            result.slowest = max(
                result.slowest, (edit.finished_at - edit.created_at).total_seconds()
            )
            ends = [e for e in records.events_after(edit_id) if e.data.get("status") == "succeeded"]
            (published,) = records.list_results(edit_id)
            content = blobs.get_range(published.blob_key, 0, published.bytes)
            if len(ends) != 1 or content != edit_id.encode():
                result.twice.append(edit_id)
    records.close()
    return result


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
