"""The OpenAPI document: made from the routes, committed, and checked for drift."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from service.routes import router
from service.routes.documents import request_schemas

DESCRIPTION = """\
Edits 3D face meshes by quasi-conformal maps: upload PLY or OBJ files, start an edit of one towards
others or by moved control points, and fetch the edited meshes.

Errors are `application/problem+json` (RFC 9457): each entry of `errors` has a JSON `pointer` into
what was sent, a stable `code`, and the offending things under `elements`.
"""


def document() -> dict[str, Any]:
    """The document, equal for equal code."""
    bare = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    bare.include_router(router)
    made = get_openapi(
        title="Quasiface",
        version=version("quasiface"),
        description=DESCRIPTION,
        routes=bare.routes,
        license_info={"name": "MIT", "identifier": "MIT"},
        separate_input_output_schemas=False,
    )
    made["components"]["schemas"] |= request_schemas()
    for path in made["paths"].values():
        for operation in path.values():
            _put_right(operation["responses"])
    for unused in ("HTTPValidationError", "ValidationError"):
        made["components"]["schemas"].pop(unused)
    return made


def _put_right(responses: dict[str, Any]) -> None:
    """Take out what FastAPI adds of its own: its validation error, and a key of OpenAPI 3.2."""
    content = responses.get("200", {}).get("content", {})
    content.get("text/event-stream", {}).pop("itemSchema", None)
    if "application/json" in responses.get("422", {}).get("content", {}):
        del responses["422"]


def rendered() -> str:
    """The document as it is committed."""
    return json.dumps(document(), indent=1, sort_keys=True, ensure_ascii=False) + "\n"


def command(
    check: Annotated[
        Path | None, typer.Option(help="Fail unless this file holds the current document.")
    ] = None,
    write: Annotated[Path | None, typer.Option(help="Write the current document here.")] = None,
) -> None:
    """Print, write or check the OpenAPI document."""
    current = rendered()
    if write is not None:
        write.parent.mkdir(parents=True, exist_ok=True)
        write.write_text(current, encoding="utf-8")
    if check is not None:
        _check(check, current)
    if write is None and check is None:
        typer.echo(current, nl=False)


def _check(path: Path, current: str) -> None:
    committed = path.read_text(encoding="utf-8") if path.is_file() else ""
    if committed != current:
        typer.echo(
            f"{path} is not what the code says: run `quasiface openapi --write {path}` "
            "and commit it with the change",
            err=True,
        )
        raise typer.Exit(1)
