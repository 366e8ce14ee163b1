"""Edit 3D face meshes by quasi-conformal maps: from files to surfaces, planes and back.

``edit`` is the whole method; every stage is here on its own as well. All functions are pure,
all values frozen; arrays in values are read-only.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from engine.beltrami import beltrami_coefficient, flat_triangles, folds
    from engine.controls import ControlPoint, PolygonAddress, PositionAddress, VertexAddress
    from engine.correspondence import correspond
    from engine.errors import EngineError
    from engine.io import MeshFile, read_mesh, write_glb, write_mesh
    from engine.parameterization import disk_map
    from engine.pipeline import (
        Edit,
        EditPlan,
        Keyframe,
        OpenEdit,
        Options,
        Stopwatch,
        edit,
        open_edit,
    )
    from engine.quasiconformal import quasiconformal_map
    from engine.registration import register
    from engine.restoration import restore
    from engine.topology import disk_surface, editable_surface
    from engine.types import (
        Correspondence,
        DiskMap,
        DiskSurface,
        Mesh,
        PlaneMap,
        Registration,
        Similarity,
        Surface,
        SurfacePoints,
    )

__all__ = [
    "ControlPoint",
    "Correspondence",
    "DiskMap",
    "DiskSurface",
    "Edit",
    "EditPlan",
    "EngineError",
    "Keyframe",
    "Mesh",
    "MeshFile",
    "OpenEdit",
    "Options",
    "PlaneMap",
    "PolygonAddress",
    "PositionAddress",
    "Registration",
    "Similarity",
    "Stopwatch",
    "Surface",
    "SurfacePoints",
    "VertexAddress",
    "beltrami_coefficient",
    "correspond",
    "disk_map",
    "disk_surface",
    "edit",
    "editable_surface",
    "flat_triangles",
    "folds",
    "open_edit",
    "quasiconformal_map",
    "read_mesh",
    "register",
    "restore",
    "write_glb",
    "write_mesh",
]

_MODULES = {
    "ControlPoint": "engine.controls",
    "Correspondence": "engine.types",
    "DiskMap": "engine.types",
    "DiskSurface": "engine.types",
    "Edit": "engine.pipeline",
    "EditPlan": "engine.pipeline",
    "EngineError": "engine.errors",
    "Keyframe": "engine.pipeline",
    "Mesh": "engine.types",
    "MeshFile": "engine.io",
    "OpenEdit": "engine.pipeline",
    "Options": "engine.pipeline",
    "PlaneMap": "engine.types",
    "PolygonAddress": "engine.controls",
    "PositionAddress": "engine.controls",
    "Registration": "engine.types",
    "Similarity": "engine.types",
    "Stopwatch": "engine.pipeline",
    "Surface": "engine.types",
    "SurfacePoints": "engine.types",
    "VertexAddress": "engine.controls",
    "beltrami_coefficient": "engine.beltrami",
    "correspond": "engine.correspondence",
    "disk_map": "engine.parameterization",
    "disk_surface": "engine.topology",
    "edit": "engine.pipeline",
    "editable_surface": "engine.topology",
    "flat_triangles": "engine.beltrami",
    "folds": "engine.beltrami",
    "open_edit": "engine.pipeline",
    "quasiconformal_map": "engine.quasiconformal",
    "read_mesh": "engine.io",
    "register": "engine.registration",
    "restore": "engine.restoration",
    "write_glb": "engine.io",
    "write_mesh": "engine.io",
}


def __getattr__(name: str) -> object:
    """Import what is asked for when it is: errors and types do not wait for the solvers."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)
