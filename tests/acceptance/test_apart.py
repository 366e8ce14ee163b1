"""API and workers as processes of their own, with a database and a blob store from elsewhere."""

from __future__ import annotations

import hashlib
import logging
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import boto3
import pytest
from moto.server import ThreadedMotoServer

from service.embedded import EmbeddedPostgres
from tests.acceptance.processes import Json, Service, process, service
from tests.faces import ICT_NEUTRAL, ICT_SMILE
from tests.service.core import ROOT, eventually

pytestmark = pytest.mark.timeout(600)
BUCKET = "faces"
PREFIX = "some/prefix"
PART = 100_000
CLI = [sys.executable, "-m", "service.cli"]


@pytest.fixture
def elsewhere(tmp_path: Path) -> Iterator[dict[str, str]]:
    """The settings that name a database and a bucket."""
    database = EmbeddedPostgres(tmp_path / "database")
    database.start()
    s3 = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    logging.getLogger("werkzeug").setLevel(logging.WARNING)
    s3.start()
    host, port = s3.get_host_and_port()
    yield {
        "database_url": database.url,
        "blob_url": f"s3://{BUCKET}/{PREFIX}",
        "AWS_ENDPOINT": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_REGION": "us-east-1",
    }
    s3.stop()
    database.stop()


def moved(source: str, vertex: int) -> Json:
    point = {"name": "point", "at": {"vertex": vertex}, "move": [0.0, 0.2, 0.3]}
    return {"source": source, "control_points": {"points": [point]}}


def downloaded_in_parts(api: Service, result: Json) -> bytes:
    content = b""
    while len(content) < result["bytes"]:
        last = min(len(content) + PART, result["bytes"]) - 1
        wanted = {"Range": f"bytes={len(content)}-{last}"}
        part = api.client.get(result["href"], headers=wanted)
        assert part.status_code == 206
        assert part.headers["content-range"] == (f"bytes {len(content)}-{last}/{result['bytes']}")
        content += part.content
    return content


def test_two_workers_share_two_edits(
    tmp_path: Path, elsewhere: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in elsewhere.items():
        if name.isupper():
            monkeypatch.setenv(name, value)
    s3: Any = boto3.client("s3", endpoint_url=elsewhere["AWS_ENDPOINT"])
    s3.create_bucket(Bucket=BUCKET)
    logs = [tmp_path / f"worker-{number}.log" for number in (1, 2)]
    with ExitStack() as stack:
        settings: dict[str, Any] = {"cwd": ROOT, **elsewhere}
        data = tmp_path / "of the API"
        api = stack.enter_context(
            service([*CLI, "api"], tmp_path / "api.log", data_dir=data, **settings)
        )
        source = api.uploaded("neutral.ply", ICT_NEUTRAL.read_bytes())
        api.uploaded("smile.ply", ICT_SMILE.read_bytes())
        edits = [
            api.client.post("/v1/edits", json=moved(source, vertex)).json()
            for vertex in (1000, 4000)
        ]
        workers = [
            stack.enter_context(
                process([*CLI, "worker"], log, data_dir=tmp_path / log.stem, **settings)
            )
            for log in logs
        ]
        edits = [api.succeeded(edit) for edit in edits]
        for edit in edits:
            for result in edit["results"]:
                content = downloaded_in_parts(api, result)
                assert hashlib.sha256(content).hexdigest() == result["sha256"]
        kept = s3.list_objects_v2(Bucket=BUCKET, Prefix=f"{PREFIX}/")["Contents"]
        sizes = [one["Size"] for one in kept]
        for edit in edits:
            assert {result["bytes"] for result in edit["results"]} <= set(sizes)
        assert not (data / "blobs").exists()
        for worker in workers:
            worker.terminate()
        eventually(lambda: all(worker.poll() == 0 for worker in workers))
        assert api.stop() == 0
    started = [{edit["id"] for edit in edits if edit["id"] in log.read_text()} for log in logs]
    assert sorted(map(len, started)) == [1, 1], started
    assert started[0] != started[1]
