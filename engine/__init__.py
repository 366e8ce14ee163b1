"""Edit 3D face meshes by quasi-conformal maps: from files to surfaces, planes and back.

``edit`` is the whole method; every stage is here on its own as well. All functions are pure,
all values frozen; arrays in values are read-only.
"""

from engine.beltrami import beltrami_coefficient, flat_triangles, folds
from engine.controls import ControlPoint, PolygonAddress, PositionAddress, VertexAddress
from engine.correspondence import correspond
from engine.errors import EngineError
from engine.io import MeshFile, read_mesh, write_glb, write_mesh
from engine.parameterization import disk_map
from engine.pipeline import Edit, EditPlan, Keyframe, Options, Stopwatch, edit
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
    "quasiconformal_map",
    "read_mesh",
    "register",
    "restore",
    "write_glb",
    "write_mesh",
]
