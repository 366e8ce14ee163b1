"""Inspections that behave as badly as they can."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from engine.errors import EngineError
from engine.io import read_mesh
from service.jobs import inspect_mesh
from service.jobtypes import InspectJob, Json, Report


def inspect_until_released(job: InspectJob, report: Report) -> Json:
    """Reads the file over and over, until the file exists that its first line names."""
    release = Path(job.path.read_text().partition("\n")[0].removeprefix("# "))
    release.with_suffix(f".{os.getpid()}").touch()
    while not release.exists():
        with contextlib.suppress(EngineError):
            read_mesh(job.path)
    return inspect_mesh(job, report)
