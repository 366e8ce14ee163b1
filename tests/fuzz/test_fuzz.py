"""A short run of the fuzzer: the corpus, and some seconds of what it leads to."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SECONDS = 6


def test_nothing_new_breaks_the_readers(tmp_path: Path) -> None:
    pytest.importorskip("atheris", reason="has wheels for x86-64 Linux only")
    folder = Path(__file__).parent
    limits = [f"-max_total_time={SECONDS}", "-max_len=700", f"-artifact_prefix={tmp_path}/"]
    run = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", tmp_path, folder / "corpus", *limits],
        cwd=folder.parents[1],
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr[-4000:]
    assert "Done" in run.stderr
