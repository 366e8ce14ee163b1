"""Records as answers."""

from __future__ import annotations

from collections.abc import Sequence
from urllib.parse import quote

from service.domain import EditRecord, MeshRecord, ResultRecord
from service.schemas import Edit, EditLinks, Mesh, Result

V1 = "/v1"


def mesh_answer(record: MeshRecord) -> Mesh:
    """A mesh."""
    return Mesh.model_validate(
        {
            **record.info,
            "id": record.id,
            "name": record.name,
            "format": record.format,
            "bytes": record.bytes,
            "sha256": record.sha256,
            "created_at": record.created_at,
        }
    )


def edit_href(edit_id: str) -> str:
    """Where an edit is."""
    return f"{V1}/edits/{edit_id}"


def result_answer(record: ResultRecord) -> Result:
    """A result file."""
    return Result.model_validate(
        {
            **record.meta,
            "name": record.name,
            "role": record.role,
            "media_type": record.media_type,
            "bytes": record.bytes,
            "sha256": record.sha256,
            "href": f"{edit_href(record.edit_id)}/results/{quote(record.name)}",
        }
    )


def edit_answer(
    record: EditRecord, results: Sequence[ResultRecord] | None = None, *, brief: bool = False
) -> Edit:
    """An edit, with its result files where they are given; ``brief`` without its document."""
    href = edit_href(record.id)
    return Edit.model_validate(
        {
            "id": record.id,
            "status": record.status,
            "queue_position": record.queue_position,
            "stages": record.stages,
            "document": None if brief else record.document,
            "summary": record.summary,
            "error": record.error,
            "results": None if results is None else [result_answer(item) for item in results],
            "attempt": record.attempt,
            "created_at": record.created_at,
            "started_at": record.started_at,
            "finished_at": record.finished_at,
            "expires_at": record.expires_at,
            "links": EditLinks(
                self=href,
                events=f"{href}/events",
                results=f"{href}/results",
                cancel=f"{href}/cancel",
            ),
        }
    )
