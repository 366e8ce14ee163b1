"""What routes are given."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from threading import Event
from typing import Annotated, cast

from anyio import CapacityLimiter
from fastapi import Depends, Query, Request
from fastapi.security import APIKeyHeader, HTTPAuthorizationCredentials, HTTPBearer

from service.access import Access
from service.domain import EditRecord, MeshRecord, NotFound
from service.errors import DrainingError
from service.metrics import Metrics
from service.runner import Runner
from service.settings import Settings
from service.stores.blobs import Blobs
from service.stores.records import Records

MAX_WAIT = 300.0


@dataclass(frozen=True, slots=True)
class JobNames:
    """The functions that children run, each as ``module:function``."""

    inspect: str = "service.jobs:inspect_mesh"
    validate: str = "service.jobs:validate_edit"
    snap: str = "service.jobs:snap_points"


@dataclass(frozen=True, slots=True)
class Service:
    """Everything that requests share. ``draining`` is set when the process is to end."""

    settings: Settings
    records: Records
    blobs: Blobs
    runner: Runner
    jobs: JobNames
    draining: Event
    access: Access
    metrics: Metrics
    inspections: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2))
    transfers: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(64))


def get_service(request: Request) -> Service:
    """The service that this app was created around."""
    return cast("Service", request.app.state.service)


TheService = Annotated[Service, Depends(get_service)]

_ID = re.compile(r"[a-z]{3}_[0-9a-z]{1,64}", re.ASCII)


def is_id(text: str) -> bool:
    """Whether it has the form of an id; nothing else is looked up in the database."""
    return _ID.fullmatch(text) is not None


def known_form(kind: str, identifier: str) -> str:
    """The identifier; NotFound if it cannot be one."""
    if not is_id(identifier):
        raise NotFound(f"there is no {kind} of that id")
    return identifier


def existing_mesh(mesh_id: str, service: TheService) -> MeshRecord:
    """The mesh that the path names."""
    return service.records.get_mesh(known_form("mesh", mesh_id))


def existing_edit(edit_id: str, service: TheService) -> EditRecord:
    """The edit that the path names."""
    return service.records.get_edit(known_form("edit", edit_id))


TheMesh = Annotated[MeshRecord, Depends(existing_mesh)]
TheEdit = Annotated[EditRecord, Depends(existing_edit)]

_bearer = HTTPBearer(auto_error=False, scheme_name="bearer", description="An access key.")
_api_key = APIKeyHeader(
    name="X-API-Key", auto_error=False, scheme_name="api_key", description="An access key."
)


def require_key(
    service: TheService,
    bearer: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)],
    api_key: Annotated[str | None, Depends(_api_key)],
) -> None:
    """Refuse requests without a key that opens the service."""
    service.access.check(bearer.credentials if bearer else api_key)


def accepting(service: TheService) -> None:
    """Refuse new work while the process is about to end."""
    if service.draining.is_set():
        raise DrainingError("The service is shutting down; send the request again in a moment")


@dataclass(frozen=True, slots=True)
class Paging:
    """Which piece of a list is wanted."""

    limit: int
    cursor: str | None


def paging(
    limit: Annotated[int, Query(ge=1, le=200, description="How many items at most.")] = 50,
    cursor: Annotated[
        str | None, Query(max_length=512, description="`next_cursor` of the piece before.")
    ] = None,
) -> Paging:
    """The paging of a list request."""
    return Paging(limit, cursor)


ThePaging = Annotated[Paging, Depends(paging)]
