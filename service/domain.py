"""The service's own values and refusals, below HTTP and above storage."""

# ruff: noqa: N818  (read as what is raised: raise NotFound)

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any, Generic, Literal, TypeVar

Json = dict[str, Any]
EditStatus = Literal["queued", "running", "succeeded", "failed", "canceled"]
FINISHED: tuple[EditStatus, ...] = ("succeeded", "failed", "canceled")

Item = TypeVar("Item")


class DomainError(Exception):
    """A request that the state of the service does not allow; ``code`` is stable."""

    code = "domain_error"


class NotFound(DomainError):
    """There is no such mesh, edit or result."""

    code = "not_found"


class Conflict(DomainError):
    """The thing is in a state that forbids this now; ``code`` says which."""

    def __init__(self, message: str, code: str = "conflict") -> None:
        super().__init__(message, code)
        self.message = message
        self.code = code

    def __str__(self) -> str:
        return self.message


class Gone(DomainError):
    """The results existed and have expired."""

    code = "expired"


class IdempotencyMismatch(DomainError):
    """The idempotency key was used before with another body."""

    code = "idempotency_key_reused"


class QueueFull(DomainError):
    """As many edits wait as the service accepts."""

    code = "queue_full"


class InvalidCursor(DomainError):
    """The cursor of a list did not come from this service."""

    code = "invalid_cursor"


class Unavailable(DomainError):
    """The database did not answer in time; the same request may be repeated."""

    code = "unavailable"


@dataclass(frozen=True, slots=True)
class MeshRecord:
    """An uploaded mesh: its bytes are the blob ``blob_key``; ``info`` is what inspection found."""

    id: str
    name: str
    format: str
    bytes: int
    sha256: str
    blob_key: str
    info: Json
    created_at: datetime


@dataclass(frozen=True, slots=True)
class EditRecord:
    """An edit as it stands. ``error`` is the stored problem of a failed one (without trace id)."""

    id: str
    status: EditStatus
    document: Json
    meshes: tuple[str, ...]
    tenant: str
    fingerprint: str
    idempotency_key: str | None
    stages: list[Json]
    error: Json | None
    summary: Json
    attempt: int
    last_seq: int
    cancel_requested: bool
    queue_position: int | None
    created_at: datetime
    queued_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    expires_at: datetime | None
    results_expired: bool

    @property
    def finished(self) -> bool:
        """Whether the edit has reached its final status."""
        return self.status in FINISHED


@dataclass(frozen=True, slots=True)
class ResultRecord:
    """A published result file."""

    edit_id: str
    name: str
    role: str
    meta: Json
    media_type: str
    bytes: int
    sha256: str
    blob_key: str


@dataclass(frozen=True, slots=True)
class EventRecord:
    """Something that happened to an edit; ``seq`` counts from 1 within the edit."""

    seq: int
    type: str
    data: Json
    at: datetime


@dataclass(frozen=True, slots=True)
class Page(Generic[Item]):
    """A piece of a list, newest first, and where the next piece begins."""

    items: tuple[Item, ...]
    next_cursor: str | None
