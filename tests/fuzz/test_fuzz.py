"""A short run of the fuzzer: the corpus, and some of what it leads to, each time other inputs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

RUNS = 1200


def test_nothing_new_breaks_the_readers(tmp_path: Path) -> None:
    pytest.importorskip("atheris", reason="has wheels for x86-64 Linux only")
    folder = Path(__file__).parent
    found = tmp_path / "found"
    found.mkdir()
    limits = [f"-runs={RUNS}", "-max_len=700", f"-artifact_prefix={tmp_path}/"]
    run = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", found, folder / "corpus", *limits],
        cwd=folder.parents[1],
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    said = run.stdout[-2000:] + run.stderr[:1000] + run.stderr[-4000:]
    broke = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    assert not broke, f"add to tests/fuzz/corpus what broke the contract: {broke}\n{said}"
    assert run.returncode == 0, f"ended with {run.returncode}\n{said}"
    assert f"Done {RUNS} runs" in run.stderr
