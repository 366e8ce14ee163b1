"""Stored bytes as responses: entity tags, ranges, names."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import StreamingResponse

from service.errors import RangeError
from service.schemas import ProblemError
from service.stores.blobs import Blobs

_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})", re.ASCII)


@dataclass(frozen=True, slots=True)
class Download:
    """A stored file as it is offered."""

    blob_key: str
    name: str
    media_type: str
    bytes: int
    sha256: str
    inline: bool = False

    @property
    def etag(self) -> str:
        """A strong entity tag: equal bytes have equal tags."""
        return f'"{self.sha256}"'


def respond(request: Request, blobs: Blobs, file: Download) -> Response:
    """The file, a range of it, or that the client has it already."""
    headers = {
        "ETag": file.etag,
        "Accept-Ranges": "bytes",
        "Cache-Control": "private, no-cache",
        "Content-Disposition": _disposition(file),
    }
    if _names(request.headers.get("if-none-match", ""), file.etag):
        return Response(status_code=304, headers=headers)
    wanted = _wanted_range(request, file)
    start, end = wanted or (0, file.bytes)
    if wanted:
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{file.bytes}"
    headers["Content-Length"] = str(end - start)
    status = 206 if wanted else 200
    if request.method == "HEAD":
        return Response(status_code=status, headers=headers, media_type=file.media_type)
    return StreamingResponse(
        blobs.iterate(file.blob_key, start, end),
        status_code=status,
        headers=headers,
        media_type=file.media_type,
    )


def _wanted_range(request: Request, file: Download) -> tuple[int, int] | None:
    """The range [start, end) asked for; None for the whole, as for ranges that are not understood.

    Raises RangeError for one outside the file.
    """
    condition = request.headers.get("if-range")
    match = _RANGE.fullmatch(request.headers.get("range", "").replace(" ", ""))
    if match is None or (condition is not None and condition != file.etag):
        return None
    first, last = match.groups()
    if first:
        start = int(first)
        end = min(int(last) + 1, file.bytes) if last else file.bytes
        if last and int(last) < start:
            return None
    elif last:
        start, end = max(file.bytes - int(last), 0), file.bytes
    else:
        return None
    if start >= end:
        raise RangeError(
            f"The file has {file.bytes} bytes",
            errors=[
                ProblemError(
                    parameter="Range",
                    code="range",
                    message="ask for a range inside the file",
                    elements={"bytes": file.bytes},
                )
            ],
            headers={"Content-Range": f"bytes */{file.bytes}"},
        )
    return start, end


def _names(condition: str, etag: str) -> bool:
    tags = [tag.strip().removeprefix("W/") for tag in condition.split(",")]
    return "*" in tags or etag in tags


def _disposition(file: Download) -> str:
    kind = "inline" if file.inline else "attachment"
    plain = re.sub(r'[^\x20-\x7e]|["\\%]', "_", file.name)
    if plain == file.name:
        return f'{kind}; filename="{plain}"'
    return f"{kind}; filename=\"{plain}\"; filename*=UTF-8''{quote(file.name, safe='')}"
