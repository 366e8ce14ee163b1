"""What clients send about meshes."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, RootModel

from service.schemas.addresses import Address, Place
from service.schemas.common import MAX_POINTS, Name, Request

Places = dict[str, Place]


class LandmarkSet(RootModel[Annotated[dict[Name, Place], Field(max_length=MAX_POINTS)]]):
    """Named places on a mesh, which control points may refer to."""

    model_config = {"allow_inf_nan": False, "frozen": True}


class PointToSnap(Request):
    """An address to resolve."""

    name: Name | None = None
    at: Address


class SnapDocument(Request):
    """Addresses to resolve on a mesh."""

    points: Annotated[list[PointToSnap], Field(min_length=1, max_length=MAX_POINTS)]
