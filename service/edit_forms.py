"""An edit and its files in one multipart form."""

from __future__ import annotations

from contextlib import suppress

from anyio import to_thread
from starlette.datastructures import FormData, UploadFile

from service.bodies import text_field
from service.dependencies import Service
from service.domain import Conflict, MeshRecord, NotFound
from service.errors import REFUSALS, InvalidError, name_file
from service.schemas import EditDocument, InvalidDocumentError, ProblemError, broken_rules, parse
from service.uploads import chunks_of_file, clean_name, discard, take_mesh

DOCUMENT = "edit"


async def edit_from_form(service: Service, sent: FormData) -> EditDocument:
    """The edit in the form, with mesh ids in place of the names of files.

    All files are kept as meshes, or, when anything is wrong, none.
    """
    body = await text_field(sent, DOCUMENT)
    if body is None:
        message = f"the form needs the field `{DOCUMENT}` with the edit document"
        raise InvalidError(message, errors=[ProblemError(code="missing", message=message)])
    edit = parse(EditDocument, body)
    files = _files(sent)
    _refuse(broken_rules(edit) + _unused(edit, files))
    ids: dict[str, str] = {}
    added: list[MeshRecord] = []
    try:
        for reference in dict.fromkeys(reference for _, reference in edit.meshes()):
            if reference in files:
                mesh, new = await _take(service, reference, files[reference])
                ids[reference] = mesh.id
                added += [mesh] * new
    except BaseException:
        await to_thread.run_sync(_undo, service, added)
        raise
    return edit.with_meshes(ids)


async def _take(service: Service, name: str, file: UploadFile) -> tuple[MeshRecord, bool]:
    try:
        return await take_mesh(service, clean_name(file.filename), chunks_of_file(file.file))
    except REFUSALS as error:
        raise name_file(error, name) from error


def _undo(service: Service, added: list[MeshRecord]) -> None:
    for mesh in added:
        with suppress(Conflict, NotFound):  # another request uses it, or has deleted it
            discard(service, mesh)


def _files(sent: FormData) -> dict[str, UploadFile]:
    """The form's files by the names that an edit may use: file name, else name of the field."""
    files = [
        (field, value)
        for field, value in sent.multi_items()
        if isinstance(value, UploadFile) and field != DOCUMENT
    ]
    names = [value.filename or field for field, value in files]
    _refuse(
        [
            ProblemError(
                code="duplicate_file",
                message=f"two files in the form are named {name!r}",
                elements={"file": name},
            )
            for name in sorted({name for name in names if names.count(name) > 1})
        ]
    )
    by_field = dict(files)
    return by_field | dict(zip(names, (value for _, value in files), strict=True))


def _unused(edit: EditDocument, files: dict[str, UploadFile]) -> list[ProblemError]:
    used = [id(files[name]) for _, name in edit.meshes() if name in files]
    return [
        ProblemError(
            code="unused_file",
            message=f"the edit names no file {name!r}: leave it out, or name it",
            elements={"file": name},
        )
        for name, file in files.items()
        if id(file) not in used and name == (file.filename or name)
    ]


def _refuse(errors: list[ProblemError]) -> None:
    if errors:
        raise InvalidDocumentError(errors)
