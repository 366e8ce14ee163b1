"""Problem details (RFC 9457)."""

from __future__ import annotations

from pydantic import Field

from service.schemas.common import Answer

Element = int | float | str | list[int] | list[float] | list[str]


class ProblemError(Answer):
    """One thing that is wrong."""

    pointer: str = ""
    """JSON pointer into the document that was sent; empty for the whole."""
    parameter: str | None = None
    """The query, path or header parameter, where it is one."""
    code: str
    """Stable and machine-readable."""
    message: str
    """What is wrong and what would help, for a person."""
    elements: dict[str, Element] = Field(default_factory=dict)
    """The offending things: vertex or face indices, loop lengths, names, limits."""


class Problem(Answer):
    """Why a request or a job failed."""

    type: str
    """A URI that names the kind of problem."""
    title: str
    status: int
    detail: str
    errors: list[ProblemError] = Field(default_factory=list["ProblemError"])
    trace_id: str | None = None
    """Names this request in the service's logs."""
