"""What passes between a worker and the child process that does its job: plain picklable values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Json = dict[str, Any]

MEDIA_TYPES = {
    "obj": "model/obj",
    "ply": "model/ply",
    "glb": "model/gltf-binary",
    "json": "application/json",
    "png": "image/png",
    "zip": "application/zip",
}
"""The media type of a result file by the ending of its name."""

Event = Json
"""What a job reports while it runs: ``{"type": "stage", "name": …, "status": "running" | "done",
"progress": 0..1, "seconds": …, "cached": …}``, with ``iterations`` and ``residual`` where known; or
``{"type": "result", "path": …}``, a result file that is complete."""

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
    """A file that a job wrote; ``meta`` has ``target``, ``frame``, ``weights`` where they apply."""

    name: str
    role: str
    media_type: str
    path: Path
    meta: Json = field(default_factory=dict[str, Any])


Work = Callable[[Any, Report], Any]
"""What a child does with its payload: the function that a call names, or one that stays open."""


@dataclass(frozen=True, slots=True)
class InspectJob:
    """Inspect an uploaded file: answered by a ``MeshInfo`` as a dict, or an ``EngineError``."""

    path: Path


@dataclass(frozen=True, slots=True)
class SnapJob:
    """Resolve ``points`` (each ``{"name", "at"}``, landmarks replaced by places) on one mesh.

    Answered by ``{"points": [SnappedPoint…], "errors": [ProblemError…]}`` as dicts.
    """

    path: Path
    points: list[Json]


@dataclass(frozen=True, slots=True)
class ValidateJob:
    """Check an edit as far as possible without running it; ``meshes`` as in ``EditJob``.

    Answered by ``{"errors": [ProblemError…], "warnings": [MeshWarning…]}`` as dicts, and
    whatever else is known of what would run.
    """

    document: Json
    meshes: Mapping[str, Path]
