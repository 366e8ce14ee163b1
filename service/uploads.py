"""From uploaded bytes to a mesh: stored once, inspected in a child process, or nothing kept."""

from __future__ import annotations

import re
import tempfile
from collections.abc import AsyncGenerator, Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import structlog
from anyio import from_thread, to_thread

from service.dependencies import Service
from service.domain import Json, MeshRecord, Unavailable
from service.errors import InvalidError, refusal_of
from service.jobtypes import InspectJob
from service.runner import Limits, Outcome, RunnerError
from service.schemas import MeshInfo, ProblemError
from service.stores.blobs import Stored
from service.unpacking import Unpacked

CHUNK = 1024**2
MAX_NAME = 255
_log = structlog.stdlib.get_logger()


def clean_name(given: str | None) -> str:
    """The last part of a file name; InvalidError for one that cannot be shown or kept."""
    name = re.split(r"[/\\]", given or "")[-1].strip() or "mesh"
    if len(name) > MAX_NAME or not name.isprintable():
        raise InvalidError(
            f"A mesh's name has at most {MAX_NAME} characters, all of them printable",
            errors=[
                ProblemError(
                    parameter="name",
                    code="name",
                    message="give a shorter or plainer name",
                    elements={"max_length": MAX_NAME},
                )
            ],
        )
    return name


def chunks_of(stream: AsyncGenerator[bytes, None]) -> Iterator[bytes]:
    """An async stream's chunks, for the worker thread that stores them."""

    async def next_chunk() -> bytes | None:
        return await anext(stream, None)

    while (chunk := from_thread.run(next_chunk)) is not None:
        yield chunk


def chunks_of_file(file: BinaryIO) -> Iterator[bytes]:
    """A file's chunks."""
    while chunk := file.read(CHUNK):
        yield chunk


async def take_mesh(
    service: Service, name: str, chunks: Iterable[bytes]
) -> tuple[MeshRecord, bool]:
    """The mesh with these bytes, unpacked if they are gzip, and whether it is new.

    Raises what the inspection refuses; then nothing is kept.
    """
    key = service.blobs.new_key("meshes")
    content = Unpacked(chunks, service.settings.max_upload_bytes)
    stored = await to_thread.run_sync(
        service.blobs.put_stream, key, content, limiter=service.transfers
    )
    if content.packed and name.lower().endswith(".gz"):
        name = name[:-3] or name
    kept = False
    try:
        known = await to_thread.run_sync(service.records.find_mesh_by_sha, stored.sha256)
        if known is not None:
            return known, False
        info = await _inspect(service, key)
        record, kept = await to_thread.run_sync(_create, service, name, key, stored, info)
        return record, kept
    finally:
        if not kept:
            await to_thread.run_sync(service.blobs.delete, key)


def discard(service: Service, mesh: MeshRecord) -> None:
    """Forget a mesh and its bytes; Conflict while an unfinished edit uses it."""
    service.blobs.delete(service.records.delete_mesh(mesh.id).blob_key)


def _create(
    service: Service, name: str, key: str, stored: Stored, info: MeshInfo
) -> tuple[MeshRecord, bool]:
    return service.records.create_mesh(
        name=name,
        format=info.format,
        bytes=stored.bytes,
        sha256=stored.sha256,
        blob_key=key,
        info=info.model_dump(mode="json"),
    )


async def _inspect(service: Service, key: str) -> MeshInfo:
    def job(scratch: Path) -> InspectJob:
        return InspectJob(service.blobs.local_path(key, scratch))

    return MeshInfo.model_validate(await ask_child(service, service.jobs.inspect, job))


async def ask_child(service: Service, function: str, make_job: Callable[[Path], object]) -> Json:
    """What a child answers to the job that ``make_job`` makes in a scratch folder.

    Raises the refusal that the child raised, or that stands for how it ended.
    """

    def ask() -> Outcome:
        with tempfile.TemporaryDirectory(prefix="quasiface-") as scratch:
            return service.runner.call(
                function,
                make_job(Path(scratch)),
                Limits(service.settings.inspect_seconds, service.settings.inspect_memory_bytes),
            )

    try:
        outcome = await to_thread.run_sync(ask, limiter=service.inspections)
    except RunnerError as error:
        raise Unavailable("no process for this computation can be started") from error
    if outcome.ending == "returned":
        value: Any = outcome.value
        return value
    refusal = refusal_of(outcome)
    _log.warning(
        "child_ended",
        function=function,
        ending=outcome.ending,
        refusal=str(refusal),
        error=repr(outcome.error),
        detail=outcome.detail,
    )
    raise refusal
