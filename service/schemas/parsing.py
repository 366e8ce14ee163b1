"""JSON bytes to a request model, with every fault named by a JSON pointer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, cast

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, from_json

from service.schemas.problems import Element, ProblemError
from service.schemas.rules import MAX_ERRORS, escaped

TOO_MANY_ERRORS = 10_000
_CODES = {"extra_forbidden": "unknown_field", "int_from_float": "int_type"}
_SHOWN_LIMITS = {"ge", "gt", "le", "lt", "min_length", "max_length", "actual_length", "expected"}

Model = TypeVar("Model", bound=BaseModel)


class MalformedJsonError(Exception):
    """The bytes are not JSON (or nest too deeply): says where."""


class InvalidDocumentError(Exception):
    """The JSON is not the document that it should be."""

    def __init__(self, errors: Sequence[ProblemError]) -> None:
        super().__init__(f"{len(errors)} things in the document are wrong")
        self.errors = list(errors)

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.errors,)


def parse(model: type[Model], body: bytes) -> Model:
    """The document in ``body``; raises MalformedJsonError or InvalidDocumentError."""
    try:
        return model.model_validate_json(body, strict=True)
    except ValidationError as error:
        if error.error_count() > TOO_MANY_ERRORS:  # listing them would take seconds
            raise InvalidDocumentError([_too_many(error.error_count())]) from None
        details = error.errors(include_url=False, include_input=False)
    if details[0]["type"] == "json_invalid":
        raise MalformedJsonError(details[0]["msg"])
    document = from_json(body)
    raise InvalidDocumentError([_problem(item, document) for item in details[:MAX_ERRORS]])


def limits(details: ErrorDetails) -> dict[str, Element]:
    """The limits that a validation error is about."""
    context = cast("Mapping[str, Any]", details.get("ctx", {}))
    return {
        key: value
        for key, value in context.items()
        if key in _SHOWN_LIMITS and isinstance(value, int | float | str)
    }


def code(details: ErrorDetails) -> str:
    """The stable code of a validation error."""
    return _CODES.get(details["type"], details["type"])


def _too_many(count: int) -> ProblemError:
    return ProblemError(
        code="too_many_errors",
        message=f"the document has {count} faults: is it the right one?",
        elements={"count": count},
    )


def _problem(details: ErrorDetails, document: object) -> ProblemError:
    return ProblemError(
        pointer=_pointer(details, document),
        code=code(details),
        message=details["msg"],
        elements=limits(details),
    )


def _pointer(details: ErrorDetails, document: object) -> str:
    """The location as a JSON pointer: steps that name a union's branch are no part of it."""
    pointer = ""
    at: Any = document
    for position, step in enumerate(details["loc"]):
        last = position == len(details["loc"]) - 1
        if isinstance(at, dict) and step in at:
            at = cast("dict[str | int, Any]", at)[step]
        elif isinstance(at, list) and isinstance(step, int) and step < len(cast("list[Any]", at)):
            at = cast("list[Any]", at)[step]
        elif not (last and details["type"] == "missing"):
            continue
        pointer += "/" + escaped(str(step))
    return pointer
