"""Edits: start, list, look at, wait for, cancel, delete."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Depends, Header, Query, Request, Response

from service.accepting import accept, check
from service.bodies import form_of, media_type, read_json
from service.dependencies import MAX_WAIT, Service, TheEdit, ThePaging, TheService, accepting
from service.domain import EditRecord, EditStatus
from service.edit_forms import edit_from_form
from service.jobtypes import ValidateJob
from service.presenting import edit_answer, edit_href
from service.routes.documents import BINARY, body, form, json_of, problems
from service.routes.examples import EDIT, FORM_EDIT
from service.schemas import (
    Edit,
    EditDocument,
    EditPage,
    InvalidDocumentError,
    ProblemError,
    Validation,
)
from service.uploads import ask_child
from service.waiting import finished

router = APIRouter(prefix="/edits", tags=["edits"])
RETRY_AFTER = "1"
_WAIT = re.compile(
    r"(?:^|[,;])\s*wait\s*=\s*\"?(\d{1,9})\"?\s*(?:$|[,;])", re.ASCII | re.IGNORECASE
)

_DOCUMENT = body(
    {"application/json": json_of(EditDocument, EDIT)}
    | form(
        "edit",
        "EditDocument",
        {"additionalProperties": BINARY["schema"]},
        ["edit"],
        example=FORM_EDIT,
    )
)


@dataclass(frozen=True, slots=True)
class Wishes:
    """How a client wants an edit to be started."""

    validate_only: bool
    wait: float | None
    idempotency_key: str | None


def wishes(
    validate_only: Annotated[bool, Query(description="Check all, start nothing.")] = False,
    prefer: Annotated[str, Header(description="`wait=N`: wait N seconds for the end.")] = "",
    idempotency_key: Annotated[
        str | None,
        Header(
            min_length=1,
            max_length=255,
            pattern=r"^[\x21-\x7e]([\x20-\x7e]*[\x21-\x7e])?$",
            description="Makes a repeat of this request return the first answer.",
        ),
    ] = None,
) -> Wishes:
    """What the query and the headers say; a `Prefer` that is not understood is no error."""
    waited = _WAIT.search(prefer)
    return Wishes(validate_only, min(int(waited[1]), MAX_WAIT) if waited else None, idempotency_key)


@router.post(
    "",
    status_code=202,
    operation_id="start_edit",
    summary="Start an edit",
    dependencies=[Depends(accepting)],
    response_model=None,
    responses={
        200: {"model": Validation, "description": "With `validate_only`: it can be started"},
        201: {"model": Edit, "description": "With `Prefer: wait`: the finished edit"},
        202: {"model": Edit, "description": "Accepted; `Location` says where to look"},
    }
    | problems(400, 404, 413, 415, 422, 429),
    openapi_extra=_DOCUMENT,
)
async def start(
    request: Request,
    response: Response,
    service: TheService,
    wishes: Annotated[Wishes, Depends(wishes)],
) -> Edit | Validation:
    """From an edit document, or from a form with the document and the files that it names."""
    document = await _document(request, service)
    if wishes.validate_only:
        response.status_code = 200
        return await _validate(service, document)
    edit, new = await to_thread.run_sync(accept, service.records, document, wishes.idempotency_key)
    if wishes.wait is not None:
        response.headers["Preference-Applied"] = f"wait={wishes.wait:g}"
        edit = await finished(service, edit, wishes.wait)
    if not new:
        response.headers["Idempotency-Replayed"] = "true"
    response.headers["Location"] = edit_href(edit.id)
    if wishes.wait is not None and edit.finished:
        response.status_code = 201
    else:
        response.headers["Retry-After"] = RETRY_AFTER
    return await to_thread.run_sync(_answer, service, edit)


async def _document(request: Request, service: Service) -> EditDocument:
    if media_type(request) != "multipart/form-data":
        return await read_json(request, EditDocument)
    async with form_of(request, service.settings.max_upload_bytes) as sent:
        return await edit_from_form(service, sent)


async def _validate(service: Service, document: EditDocument) -> Validation:
    resolved, meshes = await to_thread.run_sync(check, service.records, document)
    plain = resolved.model_dump(mode="json")
    answer = await ask_child(
        service,
        service.jobs.validate,
        lambda scratch: ValidateJob(
            plain,
            {mesh.id: service.blobs.local_path(mesh.blob_key, scratch) for mesh in meshes},
        ),
    )
    errors = [ProblemError.model_validate(item) for item in answer.pop("errors", [])]
    if errors:
        raise InvalidDocumentError(errors)
    return Validation.model_validate({**answer, "document": plain})


def _answer(service: Service, edit: EditRecord) -> Edit:
    if edit.status != "succeeded" or edit.results_expired:
        return edit_answer(edit)
    return edit_answer(edit, service.records.published(edit.id) or None)


@router.get("", operation_id="list_edits", responses=problems(400, 422))
def list_edits(
    service: TheService,
    paging: ThePaging,
    status: Annotated[EditStatus | None, Query(description="Only edits in this status.")] = None,
) -> EditPage:
    """The newest first."""
    page = service.records.list_edits(paging.limit, paging.cursor, status)
    return EditPage(
        items=[edit_answer(item, brief=True) for item in page.items], next_cursor=page.next_cursor
    )


@router.get("/{edit_id}", operation_id="get_edit", responses=problems(404, 422))
async def get_edit(
    service: TheService,
    edit: TheEdit,
    response: Response,
    wait: Annotated[
        float, Query(ge=0, le=1e6, description="Wait so many seconds (at most 300) for its end.")
    ] = 0.0,
) -> Edit:
    """One edit, whatever its status."""
    edit = await finished(service, edit, min(wait, MAX_WAIT))
    if not edit.finished:
        response.headers["Retry-After"] = RETRY_AFTER
    return await to_thread.run_sync(_answer, service, edit)


@router.post(
    "/{edit_id}/cancel", status_code=202, operation_id="cancel_edit", responses=problems(404)
)
def cancel(service: TheService, edit: TheEdit) -> Edit:
    """A queued edit is canceled at once, a running one stops within a second; idempotent."""
    return edit_answer(service.records.request_cancel(edit.id))


@router.delete(
    "/{edit_id}", status_code=204, operation_id="delete_edit", responses=problems(404, 409)
)
def delete_edit(service: TheService, edit: TheEdit) -> None:
    """Remove a finished edit and its results."""
    service.blobs.delete(*service.records.delete_edit(edit.id))
