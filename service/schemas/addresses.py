"""Four ways to say where a point lies on a mesh."""

from __future__ import annotations

from typing import Annotated, Literal, cast

from pydantic import Discriminator, Field, Tag

from service.schemas.common import Index, Length, Name, Request, Vector

MAX_CORNERS = 64


class VertexAddress(Request):
    """A vertex of the uploaded file."""

    vertex: Index
    """0-based, in the order of the uploaded file."""


class PolygonAddress(Request):
    """A point inside a polygon of the uploaded file."""

    polygon: Index
    """0-based, in the order of the uploaded file."""
    barycentric: Annotated[
        list[Annotated[float, Field(ge=0, le=1)]], Field(min_length=3, max_length=MAX_CORNERS)
    ]
    """One weight per corner, summing to 1. Polygons are fanned from their first corner: three
    weights on a larger polygon address its first triangle."""


class PositionAddress(Request):
    """A position in space, snapped to the surface."""

    position: Vector
    max_snap: Length | None = None
    """Refused when the surface is farther than this, in the mesh's unit; by default 1 % of the
    bounding-box diagonal."""


class LandmarkAddress(Request):
    """A landmark that the mesh was given."""

    landmark: Name


AddressKind = Literal["by vertex", "by polygon", "by position", "by landmark"]
_KEYS: dict[str, AddressKind] = {
    "vertex": "by vertex",
    "polygon": "by polygon",
    "barycentric": "by polygon",
    "position": "by position",
    "max_snap": "by position",
    "landmark": "by landmark",
}


def _kind(value: object) -> AddressKind | None:
    if isinstance(value, VertexAddress):
        return "by vertex"
    if isinstance(value, PolygonAddress):
        return "by polygon"
    if isinstance(value, PositionAddress):
        return "by position"
    if isinstance(value, LandmarkAddress):
        return "by landmark"
    if not isinstance(value, dict):
        return None
    kinds: set[AddressKind] = {
        _KEYS[key] for key in cast("dict[str, object]", value) if key in _KEYS
    }
    return kinds.pop() if len(kinds) == 1 else None


Place = Annotated[
    Annotated[VertexAddress, Tag("by vertex")]
    | Annotated[PolygonAddress, Tag("by polygon")]
    | Annotated[PositionAddress, Tag("by position")],
    Discriminator(
        _kind,
        custom_error_type="address",
        custom_error_message="A place is an object with exactly one of `vertex`, "
        "`polygon` + `barycentric`, or `position`",
    ),
]
Address = Annotated[
    Annotated[VertexAddress, Tag("by vertex")]
    | Annotated[PolygonAddress, Tag("by polygon")]
    | Annotated[PositionAddress, Tag("by position")]
    | Annotated[LandmarkAddress, Tag("by landmark")],
    Discriminator(
        _kind,
        custom_error_type="address",
        custom_error_message="An address is an object with exactly one of `vertex`, "
        "`polygon` + `barycentric`, `position` (+ `max_snap`), or `landmark`",
    ),
]
