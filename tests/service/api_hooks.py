"""What schemathesis cannot know of this API: files that are meshes, beside any bytes."""

from __future__ import annotations

import os
from typing import Any
from urllib.parse import urljoin

import httpx
import schemathesis
from hypothesis import strategies as st

from tests.acceptance.awkward_faces import soup
from tests.acceptance.files import ply, small

FACE = small(count=300)
MESHES = (ply(FACE.vertices, FACE.faces), soup(300), b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")

schemathesis.openapi.media_type(
    "application/octet-stream", st.sampled_from(MESHES) | st.binary(max_size=200)
)


@schemathesis.hook
def before_load_schema(context: Any, raw_schema: dict[str, Any]) -> None:
    """Leave the schema of the event stream out: each event would be held against it."""
    events = raw_schema["paths"]["/v1/edits/{edit_id}/events"]["get"]["responses"]["200"]
    events["content"]["text/event-stream"] = {}


@schemathesis.hook
def before_call(context: Any, case: Any, kwargs: Any) -> None:
    """Nothing works on edits here: wait for none."""
    for name in [name for name in case.headers or {} if name.lower() == "prefer"]:
        if "wait=" in str(case.headers[name]):
            case.headers[name] = "wait=0"


@schemathesis.hook
def after_call(context: Any, case: Any, response: Any) -> None:
    """End edits at once, so that nobody waits for theirs."""
    if response.status_code == 202 and case.operation.label == "POST /v1/edits":
        href = urljoin(response.request.url, response.json()["links"]["cancel"])
        key = {"X-API-Key": os.environ["CONTRACT_KEY"]}
        httpx.post(href, headers=key, timeout=60).raise_for_status()
