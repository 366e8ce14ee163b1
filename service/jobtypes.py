"""What passes between a worker and the child process that does its job: plain picklable values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Json = dict[str, Any]

Event = Json
"""What a job reports while it runs: ``{"type": "stage", "name": …, "status": "running" | "done",
"progress": 0..1, "seconds": …, "cached": …}``, with ``iterations`` and ``residual`` where known."""

Report = Callable[[Event], None]


@dataclass(frozen=True, slots=True)
class EditJob:
    """One attempt at an edit.

    ``document`` is the edit as accepted, ``meshes`` the local file behind each mesh id in it,
    ``out`` an empty folder for result files, ``cache`` a folder shared by the jobs of a machine.
    """

    edit_id: str
    document: Json
    meshes: Mapping[str, Path]
    out: Path
    cache: Path


@dataclass(frozen=True, slots=True)
class ResultFile:
    """A file that a job wrote: ``meta`` holds ``target``, ``frame``, ``weights`` where they apply."""

    name: str
    role: str
    media_type: str
    path: Path
    meta: Json = field(default_factory=dict[str, Any])
