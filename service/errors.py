"""Every refusal as problem details (RFC 9457): one table from exceptions to statuses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from asgi_correlation_id import correlation_id

from engine.errors import EngineError, UnsupportedFormatError
from service.domain import (
    Conflict,
    DomainError,
    Gone,
    IdempotencyMismatch,
    InvalidCursor,
    NotFound,
    QueueFull,
    Unavailable,
)
from service.runner import Outcome
from service.schemas import InvalidDocumentError, MalformedJsonError, Problem, ProblemError

URN: Final = "urn:quasiface:problem:"


class RefusedError(Exception):
    """A request that is refused: why, the places, and what the client may do about it."""

    def __init__(
        self,
        message: str,
        *,
        errors: Sequence[ProblemError] = (),
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(message)
        self.errors = list(errors)
        self.headers = dict(headers or {})

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), str(self), self.errors, self.headers)


def _rebuild(
    cls: type[RefusedError],
    message: str,
    errors: Sequence[ProblemError],
    headers: Mapping[str, str],
) -> RefusedError:
    return cls(message, errors=errors, headers=headers)


class MalformedError(RefusedError):
    """The request cannot be read."""


class KeyMissingError(RefusedError):
    """The service asks for a key and none came."""


class KeyRefusedError(RefusedError):
    """A key came that the service does not know."""


class TooLargeError(RefusedError):
    """The body is longer than the service takes."""


class MediaTypeError(RefusedError):
    """The body is of a kind that the service does not take."""


class RangeError(RefusedError):
    """The range lies outside the file."""


class InvalidError(RefusedError):
    """The request can be read, and cannot be carried out as it is."""


class DrainingError(RefusedError):
    """The service is shutting down and takes no new work."""


class TimeLimitError(RefusedError):
    """A computation on the client's data met the time limit."""


class MemoryLimitError(RefusedError):
    """A computation on the client's data met the memory limit."""


class CrashError(RefusedError):
    """A computation on the client's data broke down in a way that nobody foresaw."""


@dataclass(frozen=True, slots=True)
class Kind:
    """What all problems of one kind share."""

    slug: str
    title: str
    status: int


KINDS: Final[Mapping[type[Exception], Kind]] = {
    MalformedError: Kind("malformed", "The request cannot be read", 400),
    MalformedJsonError: Kind("malformed", "The request cannot be read", 400),
    InvalidCursor: Kind("malformed", "The request cannot be read", 400),
    KeyMissingError: Kind("key-missing", "An access key is needed", 401),
    KeyRefusedError: Kind("key-refused", "The access key is not known", 403),
    NotFound: Kind("unknown", "There is no such thing", 404),
    Conflict: Kind("state", "Its state does not allow this", 409),
    Gone: Kind("expired", "It has been removed", 410),
    TooLargeError: Kind("too-large", "The body is too large", 413),
    MediaTypeError: Kind("media-type", "The content is of a kind that is not taken", 415),
    UnsupportedFormatError: Kind("media-type", "The content is neither PLY nor OBJ", 415),
    RangeError: Kind("range", "The range lies outside the file", 416),
    InvalidError: Kind("invalid", "The request cannot be carried out", 422),
    InvalidDocumentError: Kind("invalid", "The request cannot be carried out", 422),
    EngineError: Kind("cannot-be-edited", "This cannot be edited", 422),
    TimeLimitError: Kind("time-limit", "It takes longer than the service allows", 422),
    MemoryLimitError: Kind("memory-limit", "It needs more memory than the service allows", 422),
    CrashError: Kind("crashed", "The computation broke down", 422),
    IdempotencyMismatch: Kind("key-reused", "The idempotency key belongs to another request", 422),
    QueueFull: Kind("queue-full", "The queue is full", 429),
    DrainingError: Kind("draining", "The service is shutting down", 503),
    Unavailable: Kind("unavailable", "A part of the service does not answer", 503),
}
REFUSALS: Final = tuple(KINDS)
RETRY_AFTER: Final[Mapping[type[Exception], int]] = {
    QueueFull: 10,
    DrainingError: 5,
    Unavailable: 5,
}


def kind_of(error: Exception) -> Kind:
    """The kind of problem that an exception in the table, or a subclass of one, stands for."""
    return next(KINDS[cls] for cls in type(error).__mro__ if cls in KINDS)


def problem_of(error: Exception) -> Problem:
    """The problem details of an exception in the table."""
    kind = kind_of(error)
    return Problem(
        type=URN + kind.slug,
        title=kind.title,
        status=kind.status,
        detail=_detail(error),
        errors=_errors(error),
        trace_id=correlation_id.get(),
    )


def headers_of(error: Exception) -> dict[str, str]:
    """The HTTP headers that belong to the problem of an exception in the table."""
    headers = dict(error.headers) if isinstance(error, RefusedError) else {}
    for cls, seconds in RETRY_AFTER.items():
        if isinstance(error, cls):
            headers.setdefault("Retry-After", str(seconds))
    return headers


def refusal_of(outcome: Outcome) -> Exception:
    """Why a child process gave no value, as an exception of the table."""
    match outcome.ending:
        case "time_limit":
            return _limit(TimeLimitError, outcome)
        case "memory_limit":
            return _limit(MemoryLimitError, outcome)
        case "raised" if isinstance(outcome.error, EngineError | DomainError | RefusedError):
            return outcome.error
        case "lost" | "canceled":
            return Unavailable("the process that computes was lost; send the request again")
        case _:
            return CrashError(
                "The computation on this file broke down; the service has logged why",
                errors=[ProblemError(code="crashed", message=f"it ended as: {outcome.ending}")],
            )


def name_file(error: Exception, name: str) -> Exception:
    """The same refusal, saying also which of several files it is about."""
    match error:
        case EngineError():
            error.elements["file"] = name
        case RefusedError():
            error.errors = [
                item.model_copy(update={"elements": {**item.elements, "file": name}})
                for item in error.errors
            ]
        case _:
            pass
    return error


def _limit(cls: type[RefusedError], outcome: Outcome) -> RefusedError:
    return cls(
        outcome.detail,
        errors=[
            ProblemError(
                code=outcome.ending,
                message=f"{outcome.detail}; a mesh with fewer polygons would help",
                elements={"seconds": outcome.seconds, "peak_bytes": outcome.peak_bytes},
            )
        ],
    )


def _detail(error: Exception) -> str:
    if isinstance(error, InvalidDocumentError) and error.errors:
        first = error.errors[0]
        more = f" (and {len(error.errors) - 1} more)" if len(error.errors) > 1 else ""
        return f"{first.pointer or 'the document'}: {first.message}{more}"
    return str(error)


def _errors(error: Exception) -> list[ProblemError]:
    match error:
        case RefusedError() | InvalidDocumentError():
            return error.errors
        case EngineError():
            return [ProblemError(code=error.code, message=str(error), elements=error.elements)]
        case DomainError():
            return [ProblemError(code=error.code, message=str(error))]
        case _:
            return [ProblemError(code=kind_of(error).slug, message=str(error))]
