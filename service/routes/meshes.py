"""Meshes: upload, list, look at, resolve addresses on, name landmarks of, delete."""

from __future__ import annotations

from typing import Annotated, Any

from anyio import to_thread
from fastapi import APIRouter, Depends, Query, Request, Response
from starlette.datastructures import FormData, UploadFile

from service.accepting import Faults, place
from service.bodies import form_of, limited, media_type, read_json, text_field
from service.dependencies import Service, TheMesh, ThePaging, TheService, accepting
from service.domain import MeshRecord
from service.downloads import Download, respond
from service.errors import InvalidError
from service.jobtypes import SnapJob
from service.presenting import V1, mesh_answer
from service.routes.documents import BINARY, body, file_responses, form, json_of, problems
from service.schemas import (
    InvalidDocumentError,
    LandmarkSet,
    Mesh,
    MeshPage,
    ProblemError,
    SnapDocument,
    SnappedPoints,
    parse,
)
from service.uploads import ask_child, chunks_of, chunks_of_file, clean_name, discard, take_mesh

router = APIRouter(prefix="/meshes", tags=["meshes"])
MEDIA_TYPES = {"obj": "model/obj", "ply": "model/ply"}

_FILE = {"file": BINARY["schema"]}
_UPLOAD = body(
    form("landmarks", "LandmarkSet", {"properties": _FILE}, ["file"])
    | {"application/octet-stream": BINARY}
)


@router.post(
    "",
    status_code=201,
    operation_id="upload_mesh",
    summary="Upload one PLY or OBJ file",
    dependencies=[Depends(accepting)],
    responses={200: {"model": Mesh, "description": "These bytes were uploaded before"}}
    | problems(400, 413, 415, 422),
    openapi_extra=_UPLOAD,
)
async def upload(
    request: Request,
    response: Response,
    service: TheService,
    name: Annotated[
        str | None, Query(max_length=1024, description="The file's name, for a raw body.")
    ] = None,
) -> Mesh:
    """The same bytes again give 200 and the same id. A file that is refused is not kept.

    A gzip file is unpacked; so is any body with `Content-Encoding: gzip`.
    """
    if media_type(request) == "multipart/form-data":
        async with form_of(request, service.settings.max_upload_bytes) as sent:
            record, new = await _from_form(service, sent, name)
    else:
        stream = limited(request, service.settings.max_upload_bytes).stream()
        record, new = await take_mesh(service, clean_name(name), chunks_of(stream))
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"{V1}/meshes/{record.id}"
    return mesh_answer(record)


async def _from_form(service: Service, sent: FormData, name: str | None) -> tuple[MeshRecord, bool]:
    files = [part for part in sent.getlist("file") if isinstance(part, UploadFile)]
    if len(files) != 1:
        message = f"the form must have one file in the field `file`, not {len(files)}"
        raise InvalidError(message, errors=[ProblemError(code="file", message=message)])
    landmarks = await text_field(sent, "landmarks")
    wanted = None if landmarks is None else parse(LandmarkSet, landmarks)
    clean = clean_name(name or files[0].filename)
    record, new = await take_mesh(service, clean, chunks_of_file(files[0].file))
    if wanted is None:
        return record, new
    try:
        return await to_thread.run_sync(_set_landmarks, service, record, wanted), new
    except InvalidDocumentError:
        if new:
            await to_thread.run_sync(discard, service, record)
        raise


@router.get("", operation_id="list_meshes", responses=problems(400, 422))
def list_meshes(service: TheService, paging: ThePaging) -> MeshPage:
    """The newest first."""
    page = service.records.list_meshes(paging.limit, paging.cursor)
    return MeshPage(items=[mesh_answer(item) for item in page.items], next_cursor=page.next_cursor)


@router.get("/{mesh_id}", operation_id="get_mesh", responses=problems(404))
def get_mesh(mesh: TheMesh) -> Mesh:
    """One mesh: what the inspection found in it."""
    return mesh_answer(mesh)


@router.head("/{mesh_id}/content", include_in_schema=False)
@router.get(
    "/{mesh_id}/content",
    operation_id="get_mesh_content",
    response_class=Response,
    responses=file_responses(*MEDIA_TYPES.values()) | problems(404, 416),
)
def content(request: Request, service: TheService, mesh: TheMesh) -> Response:
    """The uploaded bytes, unchanged."""
    name = mesh.name if mesh.name.lower().endswith(f".{mesh.format}") else None
    return respond(
        request,
        service.blobs,
        Download(
            blob_key=mesh.blob_key,
            name=name or f"{mesh.name}.{mesh.format}",
            media_type=MEDIA_TYPES[mesh.format],
            bytes=mesh.bytes,
            sha256=mesh.sha256,
        ),
    )


@router.post(
    "/{mesh_id}/snap",
    operation_id="snap",
    responses=problems(400, 404, 413, 415, 422),
    openapi_extra=body(
        {
            "application/json": json_of(
                SnapDocument, {"points": [{"name": "nose_tip", "at": {"position": [0, 1.2, 13]}}]}
            )
        }
    ),
)
async def snap(request: Request, service: TheService, mesh: TheMesh) -> SnappedPoints:
    """Resolve control-point addresses against the mesh without starting a job."""
    wanted = await read_json(request, SnapDocument)
    faults = Faults()
    points: list[dict[str, Any]] = []
    for index, point in enumerate(wanted.points):
        at = place(point.at, mesh, f"/points/{index}/at", faults)
        points.append({"name": point.name, "at": at.model_dump(mode="json")})
    faults.refuse()
    answer = await ask_child(
        service,
        service.jobs.snap,
        lambda scratch: SnapJob(service.blobs.local_path(mesh.blob_key, scratch), points),
    )
    if answer.get("errors"):
        raise InvalidDocumentError([ProblemError.model_validate(x) for x in answer["errors"]])
    return SnappedPoints.model_validate(answer)


@router.put(
    "/{mesh_id}/landmarks",
    operation_id="set_landmarks",
    responses=problems(400, 404, 413, 415, 422),
    openapi_extra=body({"application/json": json_of(LandmarkSet, {"nose_tip": {"vertex": 4172}})}),
)
async def set_landmarks(request: Request, service: TheService, mesh: TheMesh) -> Mesh:
    """Give the mesh a named set of landmarks, in place of any that it has."""
    wanted = await read_json(request, LandmarkSet)
    return mesh_answer(await to_thread.run_sync(_set_landmarks, service, mesh, wanted))


def _set_landmarks(service: Service, mesh: MeshRecord, wanted: LandmarkSet) -> MeshRecord:
    faults = Faults()
    for name, address in wanted.root.items():
        place(address, mesh, f"/{name}", faults)
    faults.refuse()
    return service.records.set_landmarks(mesh.id, wanted.model_dump(mode="json"))


@router.delete(
    "/{mesh_id}", status_code=204, operation_id="delete_mesh", responses=problems(404, 409)
)
def delete_mesh(mesh: TheMesh, service: TheService) -> None:
    """Refused while an unfinished edit uses the mesh."""
    discard(service, mesh)
