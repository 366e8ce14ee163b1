"""``quasiface serve``: one command that survives anything and leaves nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import httpx
import psutil
import pytest

from service.processes import before_exec
from tests.faces import ICT_NEUTRAL
from tests.service.core import ROOT, eventually, gone
from tests.service.killing import (
    Client,
    Stack,
    free_port,
    kill_at_random,
    known_mesh,
    running,
    tally,
)

CLI = [sys.executable, "-m", "service.cli"]
SERVE = ("service.cli", "serve")


@pytest.fixture(scope="module")
def first_started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    with running(Stack(tmp_path_factory.mktemp("stack"))) as stack:
        yield stack


@pytest.fixture
def stack(first_started: Stack) -> Stack:
    """A service that runs, for tests that bring it back whatever they do to it."""
    assert first_started.process is not None
    if first_started.process.poll() is not None:
        first_started.start()
    first_started.wait_until_ready()
    return first_started


def refused(*arguments: str, **environment: str) -> str:
    ended = subprocess.run(
        [*CLI, *arguments],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert ended.returncode == 2, ended.stderr
    assert "Traceback" not in ended.stderr
    return ended.stderr


def all_gone(family: list[psutil.Process]) -> bool:
    return all(gone(one.pid) for one in family)


def test_an_open_service_does_not_leave_the_machine(tmp_path: Path) -> None:
    arguments = ("serve", "--host", "0.0.0.0", "--data-dir", str(tmp_path))
    assert "QUASIFACE_API_KEYS" in refused(*arguments)
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_started_is_said_in_a_sentence(stack: Stack) -> None:
    assert "QUASIFACE_DATABASE_URL" in refused("worker")
    assert "QUASIFACE_WORKERS" in refused("serve", QUASIFACE_WORKERS="none")
    assert "in use" in refused("serve", "--port", str(stack.port))
    port = str(free_port())
    assert "belongs to" in refused("serve", "--port", port, "--data-dir", str(stack.data))


def test_two_services_share_a_machine_and_stop_without_a_trace(tmp_path: Path) -> None:
    one = Stack(tmp_path / "first one", SERVE)
    other = Stack(tmp_path / "second, 'one'", SERVE)
    with running(one), running(other):
        mesh = {"file": ("face.ply", ICT_NEUTRAL.read_bytes())}
        answer = httpx.post(f"{one.url}/v1/meshes", files=mesh, timeout=120.0)
        assert answer.status_code == 201, answer.text
        counts = [
            len(httpx.get(f"{stack.url}/v1/meshes", timeout=30.0).json()["items"])
            for stack in (one, other)
        ]
        assert counts == [1, 0]
        family = one.family() + other.family()
        assert one.stop() == other.stop() == 0
        assert all_gone(family)
    log = (one.data / "service.log").read_text()
    assert "OPEN" in log


def test_sigterm_finishes_what_runs_and_the_next_start_does_the_rest(stack: Stack) -> None:
    with Client(stack, known_mesh(stack), pause=0.02) as client:
        eventually(lambda: len(client.accepted) > 20)
        family = stack.family()
        assert stack.stop() == 0
        assert all_gone(family)
        stack.start()
    result = tally(stack, Counter(), client.accepted, 60.0)
    assert (result.lost, result.twice, result.reruns) == ([], [], 0)
    assert result.succeeded == len(client.accepted)


def test_a_second_signal_stops_at_once(tmp_path: Path) -> None:
    stack = Stack(tmp_path, settings={"QUASIFACE_DRAIN_SECONDS": "600"})
    with running(stack):
        family = stack.family()
        assert stack.process is not None
        began = time.monotonic()
        stack.process.send_signal(signal.SIGINT)
        time.sleep(0.1)
        stack.process.send_signal(signal.SIGINT)
        assert stack.process.wait(30) == 0
        assert time.monotonic() - began < 15
        assert all_gone(family)


def test_nothing_outlives_a_killed_supervisor(stack: Stack) -> None:
    family = stack.family()
    assert stack.process is not None
    stack.process.kill()
    stack.process.wait()
    eventually(lambda: all_gone(family))
    stack.start()
    stack.wait_until_ready()


@pytest.mark.parametrize("uid", [65534 if os.geteuid() == 0 else os.geteuid()])
def test_an_ordinary_user_can_serve(tmp_path: Path, uid: int) -> None:
    user = (uid, uid) if uid != os.geteuid() else None
    if user:
        os.chown(tmp_path, *user)
    port = str(free_port())
    with (tmp_path / "log").open("wb") as log:
        process = subprocess.Popen(
            [*CLI, "serve", "--port", port, "--data-dir", str(tmp_path / "data")],
            cwd=ROOT,
            stderr=log,
            preexec_fn=before_exec(user=user),  # noqa: PLW1509
        )
    stack = Stack(tmp_path / "data", SERVE, port=int(port), process=process)
    try:
        eventually((tmp_path / "data" / "postgres.socket").exists)
        eventually(lambda: answers(stack))
        assert {one.uids().effective for one in stack.family()} == {uid}
        assert stack.stop() == 0
    finally:
        process.kill()
        process.wait()


def answers(stack: Stack) -> bool:
    try:
        return httpx.get(f"{stack.url}/readyz", timeout=5.0).status_code == 200
    except httpx.TransportError:
        return False


@pytest.mark.timeout(600)
def test_kills_at_random_lose_nothing_and_publish_nothing_twice(stack: Stack) -> None:
    kills, accepted = kill_at_random(stack, 12, (0.3, 2.0), seed=7)
    result = tally(stack, kills, accepted, 120.0)
    assert result.accepted > 0
    assert (result.lost, result.twice) == ([], []), str(result)
    assert result.crashed <= kills["child"], str(result)
    assert result.exhausted <= (kills["worker"] + kills["zygote"]) // 3, str(result)
    assert result.succeeded + result.crashed + result.exhausted == result.accepted
