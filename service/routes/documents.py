"""What routes say about themselves in the OpenAPI document."""

from __future__ import annotations

from http import HTTPStatus
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import JsonSchemaMode, models_json_schema

from service.schemas import EditDocument, LandmarkSet, SnapDocument

REF = "#/components/schemas/{model}"
BINARY: dict[str, Any] = {"schema": {"type": "string", "format": "binary"}}
_WHEN = {
    400: "Malformed: the request cannot be read",
    401: "An access key is needed",
    403: "The access key is not known",
    404: "There is no such thing",
    409: "Its state does not allow this",
    410: "The results have expired",
    413: "The body is too large; states the limit",
    415: "The content is of a kind that is not taken",
    416: "The range lies outside the file",
    422: "It cannot be carried out; says why and what would help",
    429: "The queue is full; try again after `Retry-After` seconds",
    503: "The service is shutting down or a part of it does not answer",
}


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Responses that are problem details."""
    schema = {"$ref": REF.format(model="Problem")}
    return {
        status: {
            "description": _WHEN[status],
            "content": {"application/problem+json": {"schema": schema}},
        }
        for status in statuses
    }


def file_responses(*media_types: str) -> dict[int | str, dict[str, Any]]:
    """Responses that are a stored file."""
    content: dict[str, Any] = {
        kind: {} if kind == "application/json" else BINARY for kind in media_types
    }
    headers = {
        name: {"schema": {"type": "string"}, "description": description}
        for name, description in {
            "ETag": "Changes with the bytes",
            "Accept-Ranges": "Always `bytes`",
            "Content-Disposition": "The name to save it under",
        }.items()
    }
    return {
        200: {"description": "The file", "content": content, "headers": headers},
        206: {"description": "The range asked for", "content": content, "headers": headers},
        304: {"description": f"{HTTPStatus.NOT_MODIFIED.phrase}: the client has it"},
    }


def body(content: dict[str, Any]) -> dict[str, Any]:
    """A request body that the route reads itself."""
    return {"requestBody": {"required": True, "content": content}}


def json_of(model: type[BaseModel], example: Any = None) -> dict[str, Any]:
    """A JSON document as the content of a request body."""
    content: dict[str, Any] = {"schema": {"$ref": REF.format(model=model.__name__)}}
    return content if example is None else {**content, "example": example}


def form(
    document: str, model: str, fields: dict[str, Any], required: list[str], **more: Any
) -> dict[str, Any]:
    """A multipart form with a JSON ``document`` field among others as a request body's content."""
    schema = {
        "type": "object",
        "required": required,
        **fields,
        "properties": {
            document: {"$ref": REF.format(model=model)},
            **fields.get("properties", {}),
        },
    }
    encoding = {document: {"contentType": "application/json"}}
    return {"multipart/form-data": {"schema": schema, "encoding": encoding, **more}}


def request_schemas() -> dict[str, Any]:
    """The schemas of the documents that routes read themselves."""
    models: list[tuple[type[BaseModel], JsonSchemaMode]] = [
        (EditDocument, "validation"),
        (SnapDocument, "validation"),
        (LandmarkSet, "validation"),
    ]
    _, schema = models_json_schema(models, ref_template=REF)
    return schema["$defs"]
