"""Jobs that behave as badly as jobs can, for the tests of runner and worker.

They do without the engine: what they are forked from starts in a moment.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from engine.errors import TopologyError
from service.domain import NotFound
from service.jobtypes import EditJob, Report, ResultFile, Work


def double(payload: int, report: Report) -> int:
    return 2 * payload


def report_and_sleep(payload: float, report: Report) -> str:
    for step in range(5):
        report({"type": "stage", "name": "sleep", "status": "running", "progress": step / 5})
        time.sleep(payload / 5)
    return "slept"


def hang(payload: object, report: Report) -> None:
    report({"type": "stage", "name": "hang", "status": "running", "progress": 0.0})
    while True:
        pass


def segfault(payload: object, report: Report) -> None:
    ctypes.string_at(0)


def exit_at_once(payload: int, report: Report) -> None:
    os._exit(payload)


def eat_memory(payload: object, report: Report) -> None:
    """By small pieces, as native code does that never sees a MemoryError."""
    pieces: list[bytearray] = []
    while True:
        pieces.append(bytearray(4 * 1024**2))
        time.sleep(0.001)


def eat_memory_at_once(payload: object, report: Report) -> int:
    return len(bytearray(64 * 1024**3))


def refuse(payload: object, report: Report) -> None:
    raise TopologyError("no surface", code="no_surface", elements={"faces": [1, 2]})


def refuse_domain(payload: object, report: Report) -> None:
    raise NotFound("no such thing")


def bug(payload: object, report: Report) -> None:
    raise KeyError("oops")


def leave_a_grandchild(payload: object, report: Report) -> int:
    return subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]).pid


def own_pid(payload: object, report: Report) -> int:
    return os.getpid()


def parent_pid(payload: object, report: Report) -> int:
    return os.getppid()


def big_answer(payload: int, report: Report) -> bytes:
    return b"x" * payload


def edit(job: EditJob, report: Report) -> list[ResultFile]:
    """Does what ``document["do"]`` says, for ``document["seconds"]``, and writes a file."""
    document: dict[str, Any] = dict(job.document)
    action = {"segfault": segfault, "hang": hang, "eat_memory": eat_memory, "bug": bug}.get(
        document.get("do", "")
    )
    report({"type": "stage", "name": "read", "status": "running", "progress": 0.0})
    sizes = {mesh: Path(path).stat().st_size for mesh, path in job.meshes.items()}
    report({"type": "stage", "name": "read", "status": "done", "progress": 1.0, "seconds": 0.0})
    if action is not None:
        action(None, report)
    if document.get("do") == "refuse":
        refuse(None, report)
    report_and_sleep(document.get("seconds", 0.0), report)
    path = job.out / "edited.txt"
    path.write_text(f"{document.get('text', '')} {sorted(sizes.values())}")
    return [ResultFile("edited.txt", "mesh", "text/plain", path, {"frame": 0})]


def steady(job: EditJob, report: Report) -> list[ResultFile]:
    """Takes 0.3 s and writes a file that says which edit it belongs to."""
    report_and_sleep(0.3, report)
    path = job.out / "edited.txt"
    path.write_text(job.edit_id)
    return [ResultFile("edited.txt", "mesh", "text/plain", path)]


def keep_edit_open(job: EditJob) -> Work:
    """Edits from this one write which process they come from, and do what their "weights" say."""
    return partial(_from, os.getpid())


def keep_steady_open(job: EditJob) -> Work:
    return steady


def _from(opened: int, job: EditJob, report: Report) -> list[ResultFile]:
    document = {**job.document, **job.document.get("weights", {}), "text": f"from {opened}"}
    return edit(replace(job, document=document), report)


def keep_counting(payload: int) -> Work:
    """What is opened counts its calls; no child sees those of another."""
    seen: list[Any] = [payload]

    def count(payload: Any, report: Report) -> tuple[int, list[Any]]:
        seen.append(payload)
        return os.getppid(), seen

    return count


def keep_obeying(payload: object) -> Work:
    """What is opened does what its payload names."""
    return lambda payload, report: globals()[payload](None, report)


def keep_refusing(payload: object) -> Work:
    raise TopologyError("no surface", code="no_surface")


def keep_hanging(payload: object) -> Work:
    while True:
        pass


def keep_eating(payload: int) -> Work:
    held = bytearray(payload)
    return lambda payload, report: len(held)


def keep_holding(job: EditJob) -> Work:
    """Holds as many bytes as ``frames`` says, and tells by which process."""
    held = bytearray(os.urandom(job.document["frames"]))
    return lambda job, report: os.getppid() if held else None
