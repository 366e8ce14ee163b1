"""A real server for the tests of the HTTP layer: uvicorn, Postgres, blobs on disk, children."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Event

import httpx
import uvicorn
from sqlalchemy import select

from service.app import create_app
from service.dependencies import JobNames
from service.domain import EditRecord, Json, ResultRecord
from service.runner import Runner
from service.settings import Settings
from service.stores import tables
from service.stores.blobs import Blobs
from service.stores.records import Records
from tests.faces import ICT_NEUTRAL, ICT_SMILE


@dataclass(frozen=True)
class Parts:
    """What a server is made of, for tests that do a worker's part."""

    url: str
    settings: Settings
    records: Records
    blobs: Blobs
    runner: Runner
    draining: Event

    def begin(self, edit_id: str) -> EditRecord:
        """Start an attempt, as a worker does."""
        query = select(tables.edits.c.job_id).where(tables.edits.c.id == edit_id)
        job_id = self.records._database.run(lambda c: c.execute(query).scalar_one())
        edit = self.records.claim_attempt(edit_id, job_id)
        assert edit is not None
        return edit

    def publish(self, edit: EditRecord, files: dict[str, bytes]) -> None:
        """Publish result files and with them the edit's success."""
        results: list[ResultRecord] = []
        for name, content in files.items():
            key = self.blobs.new_key("results")
            stored = self.blobs.put_stream(key, [content])
            results.append(
                ResultRecord(
                    edit.id,
                    name,
                    "mesh",
                    {"frame": 0, "weights": {"smile": 0.5}},
                    "model/obj" if name.endswith(".obj") else "application/json",
                    stored.bytes,
                    stored.sha256,
                    key,
                )
            )
        assert self.records.publish(edit.id, edit.attempt, results, {"control_points": []})

    def report(self, edit: EditRecord, name: str, status: str, progress: float) -> None:
        """Report a stage, as a job does."""
        event: Json = {"type": "stage", "name": name, "status": status, "progress": progress}
        assert self.records.record_progress(edit.id, edit.attempt, [event])


@dataclass(frozen=True)
class Server:
    """A server that runs, and a client of it."""

    url: str
    client: httpx.Client
    parts: Parts

    def upload(self, path: Path) -> str:
        """The id of the mesh in a file."""
        answer = self.client.post("/v1/meshes", files={"file": (path.name, path.read_bytes())})
        assert answer.status_code in {200, 201}, answer.text
        return answer.json()["id"]

    def start(self, **changes: object) -> str:
        """The id of a new edit of one bundled face towards another."""
        answer = self.client.post("/v1/edits", json=self.edit(**changes))
        assert answer.status_code == 202, answer.text
        return answer.json()["id"]

    def edit(self, **changes: object) -> Json:
        """An edit document of one bundled face towards another."""
        source, smile = self.upload(ICT_NEUTRAL), self.upload(ICT_SMILE)
        return {"source": source, "targets": [{"mesh": smile, "name": "smile"}], **changes}


Serve = Callable[..., Server]


@contextmanager
def serving(parts: Parts, jobs: JobNames | None = None) -> Iterator[Server]:
    """A server around these parts, on a free port."""
    app = create_app(
        parts.settings, parts.records, parts.blobs, parts.runner, jobs=jobs, draining=parts.draining
    )
    listener = _inherited(socket.create_server(("127.0.0.1", 0)))
    config = uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=5)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, args=([listener],), daemon=True)
    thread.start()
    url = f"http://127.0.0.1:{listener.getsockname()[1]}"
    try:
        with httpx.Client(base_url=url, timeout=60) as client:
            yield Server(url, client, parts)
    finally:
        server.should_exit = True
        thread.join(20)
        listener.close()
        assert not thread.is_alive()


def _inherited(listener: socket.socket) -> socket.socket:
    """As the API gets it, by its number: only so is it known for TCP, and answers are not held."""
    return socket.socket(fileno=listener.detach())


def problem(answer: httpx.Response, status: int) -> Json:
    """The problem details of an answer, which must be of this status and complete."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    body = answer.json()
    assert body["status"] == status
    assert body["type"] and body["title"] and body["detail"]
    assert body["trace_id"] == answer.headers["x-request-id"]
    return body
