"""The embedded database: it starts whatever a killed one left behind."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import psutil
import psycopg
import pytest

from service.embedded import DataFolderInUseError, EmbeddedPostgres, EmbeddedPostgresError
from service.processes import before_exec
from tests.service.core import ROOT, eventually, gone, kill

NOBODY = 65534
USERS = ["root", "nobody"] if os.geteuid() == 0 else ["myself"]
OWNER = """
import sys, time
from pathlib import Path
from service.embedded import EmbeddedPostgres
server = EmbeddedPostgres(Path(sys.argv[1]))
server.start()
print(server.pid, server.url, flush=True)
time.sleep(600)
"""


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as made:
        yield made


def start(stack: ExitStack, folder: Path) -> EmbeddedPostgres:
    server = EmbeddedPostgres(folder)
    stack.callback(server.stop)
    server.start()
    return server


def ask(url: str, query: str) -> object:
    with psycopg.connect(url) as connection:
        row = connection.execute(query.encode()).fetchone()
        return row[0] if row else None


def keep(url: str, value: int) -> None:
    with psycopg.connect(url) as connection:
        connection.execute("CREATE TABLE IF NOT EXISTS kept (value int)")
        connection.execute("INSERT INTO kept VALUES (%s)", (value,))


def test_what_is_committed_survives_stops_and_kills(stack: ExitStack, tmp_path: Path) -> None:
    folder = tmp_path / "a folder, with 'odd' \"characters\" ü"
    server = start(stack, folder)
    keep(server.url, 1)
    server.stop()
    with pytest.raises(EmbeddedPostgresError):
        _ = server.url
    server.start()
    keep(server.url, 2)
    url = server.url
    assert server.pid is not None
    kill(server.pid)
    eventually(lambda: not server.alive)
    server.start()
    assert server.url == url
    assert ask(url, "SELECT sum(value) FROM kept") == 3
    server.stop(hard=True)
    server.start()
    assert ask(server.url, "SELECT sum(value) FROM kept") == 3


def test_a_pid_file_that_names_a_stranger_does_not_matter(stack: ExitStack, tmp_path: Path) -> None:
    server = start(stack, tmp_path)
    assert server.pid is not None
    kill(server.pid)
    eventually(lambda: not server.alive)
    stale = tmp_path / "postgres" / "postmaster.pid"
    lines = stale.read_text().splitlines()
    stale.write_text("\n".join([str(os.getpid()), *lines[1:]]) + "\n")
    server.start()
    assert server.alive


def test_an_interrupted_first_start_is_begun_again(stack: ExitStack, tmp_path: Path) -> None:
    half = tmp_path / "postgres.new"
    half.mkdir()
    (half / "PG_VERSION").write_text("18\n")
    assert start(stack, tmp_path).alive


def test_two_folders_have_two_servers_and_one_folder_one(stack: ExitStack, tmp_path: Path) -> None:
    one, two = (start(stack, tmp_path / name) for name in ("one", "two"))
    keep(one.url, 1)
    assert ask(two.url, "SELECT to_regclass('kept')") is None
    with pytest.raises(DataFolderInUseError):
        EmbeddedPostgres(tmp_path / "one").start()


@pytest.mark.parametrize("user", USERS)
def test_it_dies_with_its_owner_and_the_next_one_recovers(tmp_path: Path, user: str) -> None:
    identity = (NOBODY, NOBODY) if user == "nobody" else None
    if identity:
        os.chown(tmp_path, *identity)
    for value in (1, 2, 3):
        owner = subprocess.Popen(
            [sys.executable, "-c", OWNER, str(tmp_path)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
            preexec_fn=before_exec(user=identity),  # noqa: PLW1509
        )
        assert owner.stdout is not None
        pid, url = owner.stdout.readline().split()
        assert psutil.Process(int(pid)).uids().effective != 0
        keep(url, value)
        assert ask(url, "SELECT count(*) FROM kept") == value
        owner.kill()
        owner.wait()
        owner.stdout.close()
    eventually(lambda: gone(int(pid)))
