"""What happens to an edit, as server-sent events."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Header
from fastapi.sse import EventSourceResponse, ServerSentEvent
from pydantic import BeforeValidator
from pydantic_core import PydanticCustomError

from service.dependencies import TheEdit, TheService
from service.domain import EventRecord, NotFound
from service.routes.documents import problems
from service.schemas.common import MAX_INDEX
from service.waiting import changed

router = APIRouter(prefix="/edits", tags=["edits"])
PATIENCE = 60.0


def _plain(value: object) -> object:
    """A number as this service writes it; pydantic would also take 1_0 and 1.0."""
    if isinstance(value, str) and not (value.isascii() and value.isdigit()):
        raise PydanticCustomError("int_parsing", "Input should be a number of plain digits")
    return value


@router.get(
    "/{edit_id}/events",
    operation_id="watch_edit",
    response_class=EventSourceResponse,
    responses={
        200: {
            "description": "`status`, `stage` and `progress` events, to the end of the edit",
            "content": {"text/event-stream": {"schema": {"type": "string"}}},
        }
    }
    | problems(404, 422),
)
async def events(
    service: TheService,
    edit: TheEdit,
    last_event_id: Annotated[int, Header(ge=0, le=MAX_INDEX), BeforeValidator(_plain)] = 0,
) -> AsyncGenerator[ServerSentEvent]:
    """From the event after `Last-Event-ID` on; a comment now and then keeps the line open."""
    seq = last_event_id
    while not service.draining.is_set():
        try:
            for event in await to_thread.run_sync(service.records.events_after, edit.id, seq):
                yield _sent(event)
                seq = event.seq
            if edit.finished and edit.last_seq <= seq:
                return
            edit = await changed(service, edit, seq, PATIENCE)
        except NotFound:  # deleted while it was watched
            return


def _sent(event: EventRecord) -> ServerSentEvent:
    data = {**event.data, "at": event.at.isoformat()}
    return ServerSentEvent(id=str(event.seq), event=event.type, data=data)
