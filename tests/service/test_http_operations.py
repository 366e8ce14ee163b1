"""Keys, health, metrics, documentation, and the answers to requests that fit no endpoint."""

from __future__ import annotations

import re
import socket
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
import typer
from openapi_spec_validator import validate
from pydantic import SecretStr

from service import openapi
from service.dependencies import JobNames
from tests.faces import ICT_NEUTRAL
from tests.service.core import eventually
from tests.service.http_server import Serve, Server, problem

pytest_plugins = ["tests.service.http_fixtures"]

INSPECTED_AT_ONCE = 2
COMMITTED = Path(__file__).parents[2] / "openapi" / "openapi.json"


def test_keys_open_the_service_and_nothing_else_does(serve: Serve) -> None:
    locked = serve(api_keys=(SecretStr("first-key"), SecretStr("second-key")))
    for path in ("/livez", "/readyz", "/version", "/openapi.json", "/docs"):
        assert locked.client.get(path).status_code == 200
    for method, path in [
        ("GET", "/v1/meshes"),
        ("POST", "/v1/meshes"),
        ("GET", "/v1/meshes/msh_x/content"),
        ("POST", "/v1/edits"),
        ("GET", "/v1/edits/edt_x/events"),
        ("DELETE", "/v1/edits/edt_x"),
        ("GET", "/metrics"),
    ]:
        answer = locked.client.request(method, path)
        problem(answer, 401)
        assert answer.headers["www-authenticate"].startswith("Bearer")
        for headers in (
            {"x-api-key": "first-ke"},
            {"authorization": "Bearer first-key2"},
            {"x-api-key": "schl\u00fcssel".encode("latin-1")},
        ):
            problem(locked.client.request(method, path, headers=headers), 403)
    for headers in ({"x-api-key": "first-key"}, {"authorization": "bearer second-key"}):
        assert locked.client.get("/v1/meshes", headers=headers).status_code == 200


def test_an_answer_before_the_end_of_a_body_arrives(serve: Serve) -> None:
    locked = serve(api_keys=(SecretStr("key"),))
    for _ in range(5):
        problem(locked.client.post("/v1/meshes", content=bytes(30_000_000)), 401)
        answer = locked.client.post(
            "/v1/meshes", content=bytes(30_000_000), headers={"x-api-key": "key"}
        )
        problem(answer, 413)


def test_health_and_version(server: Server) -> None:
    assert server.client.get("/livez").json() == {"status": "live"}
    assert server.client.get("/readyz").json() == {"status": "ready"}
    version = server.client.get("/version").json()
    assert version["name"] == "quasiface"
    assert re.fullmatch(r"\d+\.\d+\.\d+", version["version"])


def test_metrics_count_requests_by_route_and_edits_by_status(server: Server) -> None:
    edit_id = server.start()
    for _ in range(3):
        server.client.get(f"/v1/edits/{edit_id}")
    server.client.request("BREW", "/v1/unheard-of")
    text = server.client.get("/metrics").text
    counted = re.search(
        r'http_requests_total\{method="GET",route="/v1/edits/\{edit_id\}",status="200"\} (\d+)',
        text,
    )
    assert counted is not None
    assert float(counted[1]) >= 3
    assert 'quasiface_edits{status="queued"} 1.0' in text
    assert edit_id not in text
    assert "BREW" not in text
    server.client.post(f"/v1/edits/{edit_id}/cancel")
    assert 'quasiface_edits{status="queued"} 0.0' in server.client.get("/metrics").text


def test_requests_that_fit_no_endpoint(server: Server) -> None:
    problem(server.client.get("/nothing"), 404)
    problem(server.client.get("/v1/%00"), 404)
    answer = server.client.put("/v1/meshes")
    problem(answer, 405)
    assert answer.headers["allow"] == "GET, POST"
    problem(server.client.post("/livez"), 405)


def test_the_client_may_name_its_request(server: Server) -> None:
    mine = "0123456789abcdef0123456789abcdef"
    answer = server.client.get("/v1/edits/edt_none", headers={"x-request-id": mine})
    assert problem(answer, 404)["trace_id"] == mine
    odd = server.client.get("/v1/edits/edt_none", headers={"x-request-id": "a b <script>"})
    assert problem(odd, 404)["trace_id"] != "a b <script>"


def test_browsers_are_told_to_be_careful(server: Server) -> None:
    for path in ("/livez", "/nothing", "/v1/meshes"):
        headers = server.client.get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "access-control-allow-origin" not in headers


def test_origins_are_allowed_by_name(serve: Serve) -> None:
    shared = serve(cors_origins=("https://faces.example",))
    for origin, allowed in [("https://faces.example", True), ("https://other.example", False)]:
        headers = shared.client.get("/livez", headers={"origin": origin}).headers
        assert ("access-control-allow-origin" in headers) is allowed


def test_the_documentation_needs_no_other_server(server: Server) -> None:
    page = server.client.get("/docs")
    assert page.headers["content-type"].startswith("text/html")
    links = re.findall(r'(?:src|href)="([^"]+)"', page.text)
    assert len(links) >= 3
    for link in links:
        assert not urlsplit(link).netloc
        assert server.client.get(link).status_code == 200
    assert "https://" not in page.text


def test_the_openapi_document_is_valid_served_and_committed(server: Server) -> None:
    served = server.client.get("/openapi.json").json()
    validate(served)
    assert served["openapi"].startswith("3.1")
    assert served == openapi.document()
    assert openapi.rendered() == openapi.rendered()
    assert COMMITTED.read_text(encoding="utf-8") == openapi.rendered()
    refused = served["paths"]["/v1/edits"]["post"]["responses"]["422"]["content"]
    assert list(refused) == ["application/problem+json"]


def test_the_openapi_command_writes_and_notices_drift(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "new" / "openapi.json"
    openapi.command(write=path)
    openapi.command(check=path)
    path.write_text(path.read_text().replace("Quasiface", "Something"))
    for wrong in (path, tmp_path / "missing.json"):
        with pytest.raises(typer.Exit) as stopped:
            openapi.command(check=wrong)
        assert stopped.value.exit_code == 1
        assert f"quasiface openapi --write {wrong}" in capsys.readouterr().err


@pytest.mark.parametrize("job", ["segfault", "eat_memory", "hang", "bug", "exit_at_once"])
def test_a_file_that_breaks_its_inspection_is_refused_and_not_kept(serve: Serve, job: str) -> None:
    fragile = serve(
        JobNames(inspect=f"tests.service.fake_jobs:{job}"),
        inspect_seconds=2.0,
        inspect_memory_bytes=512 * 1024**2,
    )
    before = set(fragile.parts.blobs.keys_older_than("meshes", -60))
    answer = fragile.client.post("/v1/meshes", content=b"v 0 0 0\n" + job.encode())
    refused = problem(answer, 422)
    expected = {"hang": "time_limit", "eat_memory": "memory_limit"}.get(job, "crashed")
    assert refused["errors"][0]["code"] == expected
    assert set(fragile.parts.blobs.keys_older_than("meshes", -60)) == before


def test_requests_are_answered_while_hostile_files_are_read(serve: Serve, tmp_path: Path) -> None:
    busy = serve(JobNames(inspect="tests.service.fake_inspections:inspect_until_released"))
    release = tmp_path / "release"
    garbage = f"# {release}\n".encode() + b"v nan 1e-330 0.12345678901234567890\n" * 100_000
    with ThreadPoolExecutor(4) as pool:
        uploads = [
            pool.submit(busy.client.post, "/v1/meshes", content=garbage + b"#" * k)
            for k in range(4)
        ]
        try:
            eventually(lambda: len(list(tmp_path.iterdir())) == INSPECTED_AT_ONCE)
            for _ in range(10):
                for path in ("/livez", "/readyz", "/v1/meshes", "/v1/edits"):
                    assert busy.client.get(path).status_code == 200
            assert not any(upload.done() for upload in uploads)
        finally:
            release.touch()
        for upload in uploads:
            assert problem(upload.result(), 422)["errors"][0]["code"] == "not_finite"


def test_a_mistake_of_the_service_is_a_problem_too(serve: Serve) -> None:
    mistaken = serve(JobNames(inspect="tests.service.fake_jobs:own_pid"))
    answer = mistaken.client.post("/v1/meshes", content=b"x")
    body = problem(answer, 500)
    assert "Traceback" not in answer.text
    assert body["errors"] == []


def test_an_upload_that_breaks_off_leaves_nothing(server: Server) -> None:
    before = set(server.parts.blobs.keys_older_than("meshes", -60))
    url = httpx.URL(server.url)
    assert url.port is not None
    with socket.create_connection((url.host, url.port)) as connection:
        connection.sendall(
            b"POST /v1/meshes?name=a.ply HTTP/1.1\r\nHost: x\r\nContent-Length: 900000\r\n\r\n"
            + ICT_NEUTRAL.read_bytes()[:300_000]
        )
    assert server.client.get("/livez").status_code == 200
    assert set(server.parts.blobs.keys_older_than("meshes", -60)) == before
