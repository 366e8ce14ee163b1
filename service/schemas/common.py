"""What every wire model shares: strictness, names, bounded numbers."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

MAX_TARGETS = 16
MAX_POINTS = 10_000
MAX_FRAMES = 480
MAX_INDEX = 2**31 - 1
MAX_COORDINATE = 1e12

Name = Annotated[
    str,
    Field(
        min_length=1,
        max_length=64,
        pattern=r"^\w([\w .\-]*\w)?$",
        description="Letters, digits, `_`, and inside also spaces, dots and dashes.",
    ),
]
Index = Annotated[int, Field(ge=0, le=MAX_INDEX)]
Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Length = Annotated[float, Field(ge=0, le=MAX_COORDINATE)]


class Request(BaseModel):
    """A document that a client sends: nothing unknown, nothing converted, nothing infinite."""

    model_config = ConfigDict(
        extra="forbid", allow_inf_nan=False, frozen=True, use_attribute_docstrings=True
    )


class Answer(BaseModel):
    """A document that the service sends."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)
