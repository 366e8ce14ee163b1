"""The wire models: what clients send and what the service answers."""

from service.schemas.addresses import (
    Address,
    LandmarkAddress,
    Place,
    PolygonAddress,
    PositionAddress,
    VertexAddress,
)
from service.schemas.answers import (
    Edit,
    EditLinks,
    EditPage,
    EventData,
    Mesh,
    MeshInfo,
    MeshPage,
    Ready,
    Result,
    ResultPage,
    SnappedPoint,
    SnappedPoints,
    Stage,
    Validation,
    Version,
    Warned,
)
from service.schemas.edits import ControlPoint, EditDocument, Options
from service.schemas.meshes import LandmarkSet, Places, SnapDocument
from service.schemas.parsing import InvalidDocumentError, MalformedJsonError, parse
from service.schemas.problems import Element, Problem, ProblemError
from service.schemas.rules import broken_rules

__all__ = [
    "Address",
    "ControlPoint",
    "Edit",
    "EditDocument",
    "EditLinks",
    "EditPage",
    "Element",
    "EventData",
    "InvalidDocumentError",
    "LandmarkAddress",
    "LandmarkSet",
    "MalformedJsonError",
    "Mesh",
    "MeshInfo",
    "MeshPage",
    "Options",
    "Place",
    "Places",
    "PolygonAddress",
    "PositionAddress",
    "Problem",
    "ProblemError",
    "Ready",
    "Result",
    "ResultPage",
    "SnapDocument",
    "SnappedPoint",
    "SnappedPoints",
    "Stage",
    "Validation",
    "Version",
    "VertexAddress",
    "Warned",
    "broken_rules",
    "parse",
]
