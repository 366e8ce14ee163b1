"""Request bodies, read no further than their limit."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Iterator
from contextlib import asynccontextmanager
from typing import TypeVar

from anyio.lowlevel import checkpoint
from fastapi import Request
from pydantic import BaseModel
from starlette.datastructures import FormData, UploadFile
from starlette.types import Message, Receive

from service.errors import MalformedError, MediaTypeError, TooLargeError
from service.schemas import ProblemError, parse
from service.unpacking import Gunzip

MAX_DOCUMENT_BYTES = 8 * 1024**2
MAX_FILES = 32
MAX_FIELDS = 32
GZIP = {"gzip", "x-gzip"}

Model = TypeVar("Model", bound=BaseModel)


def limited(request: Request, limit: int) -> Request:
    """The same request, its body unpacked; TooLargeError beyond ``limit`` bytes, packed or not."""
    declared = request.headers.get("content-length", "")
    if declared.isascii() and declared.isdigit() and int(declared[:20]) > limit:
        raise _too_large(limit)
    receive = _counting(request.receive, limit)
    coding = ",".join(request.headers.getlist("content-encoding")).strip().lower()
    if coding in GZIP:
        receive = _unpacking(receive, limit)
    elif coding not in {"", "identity"}:
        raise MediaTypeError(
            f"The body is encoded as {coding[:40]}; send it as it is, or as gzip",
            errors=[ProblemError(code="content_encoding", message="send it as it is, or as gzip")],
            headers={"Accept-Encoding": "gzip"},
        )
    return Request(request.scope, receive)


def _counting(receive: Receive, limit: int) -> Receive:
    total = 0

    async def counted() -> Message:
        nonlocal total
        message = await receive()
        total += len(message.get("body", b""))
        if total > limit:
            raise _too_large(limit)
        return message

    return counted


def _unpacking(receive: Receive, limit: int) -> Receive:
    gunzip = Gunzip(limit)
    pieces: Iterator[bytes] = iter(())
    more = True

    async def unpacked() -> Message:
        nonlocal pieces, more
        await checkpoint()  # a bomb must not keep others waiting
        while (piece := next(pieces, None)) is None:
            if not more:
                gunzip.finish()
                return {"type": "http.request", "body": b"", "more_body": False}
            message = await receive()
            if message["type"] != "http.request":
                return message
            pieces = gunzip.feed(message.get("body", b""))
            more = message.get("more_body", False)
        return {"type": "http.request", "body": piece, "more_body": True}

    return unpacked


def _too_large(limit: int) -> TooLargeError:
    message = f"The body is longer than the limit of {limit} bytes"
    return TooLargeError(
        message,
        errors=[ProblemError(code="too_large", message=message, elements={"limit": limit})],
    )


def media_type(request: Request) -> str:
    """The media type of the body, without parameters, in lower case."""
    return request.headers.get("content-type", "").split(";")[0].strip().lower()


async def read_json(request: Request, model: type[Model]) -> Model:
    """The JSON document in the body."""
    kind = media_type(request)
    if kind and kind != "application/json" and not kind.endswith("+json"):
        raise MediaTypeError(
            f"The body must be application/json, not {kind}",
            errors=[ProblemError(code="media_type", message="send application/json")],
        )
    return parse(model, await limited(request, MAX_DOCUMENT_BYTES).body())


@asynccontextmanager
async def form_of(request: Request, limit: int) -> AsyncGenerator[FormData]:
    """The multipart form in the body; files wait on disk, and are gone afterwards."""
    async with limited(request, limit).form(
        max_files=MAX_FILES, max_fields=MAX_FIELDS, max_part_size=MAX_DOCUMENT_BYTES
    ) as form:
        yield form


async def text_field(form: FormData, field: str) -> bytes | None:
    """The bytes of a form field that holds a document, whether sent as text or as a file."""
    values = form.getlist(field)
    if len(values) > 1:
        raise MalformedError(
            f"The form has {len(values)} fields named `{field}`; send one",
            errors=[ProblemError(code="duplicate_field", message=f"`{field}` comes twice")],
        )
    if not values:
        return None
    value = values[0]
    if isinstance(value, UploadFile):
        if (value.size or 0) > MAX_DOCUMENT_BYTES:
            raise _too_large(MAX_DOCUMENT_BYTES)
        return await value.read()
    return value.encode("utf-8", "surrogatepass")
