"""The whole method: prepare meshes, match them, edit."""

from engine.pipeline.editing import Stopwatch, edit, open_edit
from engine.pipeline.opened import OpenEdit
from engine.pipeline.preparation import addressed, find_surface, normalisation, prepare
from engine.pipeline.values import (
    CarriedMesh,
    CarriedTarget,
    Controls,
    Edit,
    EditedMesh,
    EditedMeshes,
    EditPlan,
    Frame,
    Keyframe,
    Match,
    Options,
    Prepared,
    Stages,
)

__all__ = [
    "CarriedMesh",
    "CarriedTarget",
    "Controls",
    "Edit",
    "EditPlan",
    "EditedMesh",
    "EditedMeshes",
    "Frame",
    "Keyframe",
    "Match",
    "OpenEdit",
    "Options",
    "Prepared",
    "Stages",
    "Stopwatch",
    "addressed",
    "edit",
    "find_surface",
    "normalisation",
    "open_edit",
    "prepare",
]
