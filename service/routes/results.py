"""The files that an edit made."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from service.dependencies import TheEdit, TheService
from service.domain import InvalidCursor
from service.downloads import Download, respond
from service.jobtypes import MEDIA_TYPES
from service.presenting import result_answer
from service.routes.documents import file_responses, problems
from service.schemas import ResultPage

router = APIRouter(prefix="/edits", tags=["results"])
MAX_RESULTS = 2000
SHOWN_INLINE = {"image/png", "application/json"}


@router.get(
    "/{edit_id}/results", operation_id="list_results", responses=problems(400, 404, 409, 410, 422)
)
def list_results(
    service: TheService,
    edit: TheEdit,
    limit: Annotated[int, Query(ge=1, le=MAX_RESULTS)] = MAX_RESULTS,
    cursor: Annotated[str | None, Query(max_length=512)] = None,
) -> ResultPage:
    """The result files of a succeeded edit."""
    records = service.records.list_results(edit.id)
    names = [record.name for record in records]
    if cursor is not None and cursor not in names:
        raise InvalidCursor("the cursor is not one that this list gave")
    start = 0 if cursor is None else names.index(cursor) + 1
    items = [result_answer(record) for record in records[start : start + limit]]
    more = start + limit < len(records)
    return ResultPage(items=items, next_cursor=items[-1].name if more else None)


@router.head("/{edit_id}/results/{name}", include_in_schema=False)
@router.get(
    "/{edit_id}/results/{name}",
    operation_id="get_result",
    response_class=Response,
    responses=file_responses(*MEDIA_TYPES.values()) | problems(404, 409, 410, 416),
)
def get_result(request: Request, service: TheService, edit: TheEdit, name: str) -> Response:
    """One result file."""
    record = service.records.get_result(edit.id, name)
    return respond(
        request,
        service.blobs,
        Download(
            blob_key=record.blob_key,
            name=record.name,
            media_type=record.media_type,
            bytes=record.bytes,
            sha256=record.sha256,
            inline=record.media_type in SHOWN_INLINE,
        ),
    )
