"""Result files and events over real HTTP."""

from __future__ import annotations

import json
import threading
import time

import httpx
import pytest
from httpx_sse import ServerSentEvent, connect_sse
from sqlalchemy import update

from service.stores import tables
from tests.service.http_server import Server, problem

pytest_plugins = ["tests.service.http_fixtures"]


def finished(server: Server, files: dict[str, bytes]) -> str:
    edit = server.parts.begin(server.start())
    server.parts.publish(edit, files)
    return edit.id


def test_results_are_listed_and_fetched(server: Server) -> None:
    data = b"v 1 2 3\n" * 40_000
    files = {
        "edited.obj": data,
        "report.json": b"{}",
        "target-\u043b\u0438\u0446 a.obj": b"v",
    }
    edit_id = finished(server, files)
    href = f"/v1/edits/{edit_id}/results"
    page = server.client.get(href).json()
    assert page["next_cursor"] is None
    assert [item["name"] for item in page["items"]] == list(files)
    first = page["items"][0]
    assert (first["role"], first["frame"], first["weights"]) == ("mesh", 0, {"smile": 0.5})
    for item in page["items"]:
        answer = server.client.get(item["href"])
        assert answer.content == files[item["name"]]
        assert answer.headers["content-type"].split(";")[0] == item["media_type"]
        assert answer.headers["etag"] == f'"{item["sha256"]}"'
        assert "content-encoding" not in answer.headers
    assert "filename*=UTF-8''target-" in answer.headers["content-disposition"]
    whole = server.client.get(first["href"])
    assert 'filename="edited.obj"' in whole.headers["content-disposition"]
    part = server.client.get(first["href"], headers={"range": "bytes=8-15"})
    assert (part.status_code, part.content) == (206, data[8:16])
    assert server.client.head(first["href"]).headers["content-length"] == str(len(data))
    assert server.client.get(f"/v1/edits/{edit_id}").json()["results"] == page["items"]
    problem(server.client.get(f"{href}/nothing.obj"), 404)
    problem(server.client.get(f"{href}/%00"), 404)


def test_result_lists_come_in_pieces(server: Server) -> None:
    edit_id = finished(server, {f"frame-{i}.obj": b"v" for i in range(5)})
    seen: list[str] = []
    params: dict[str, object] = {"limit": 2}
    while True:
        page = server.client.get(f"/v1/edits/{edit_id}/results", params=params).json()
        seen += [item["name"] for item in page["items"]]
        if page["next_cursor"] is None:
            break
        params["cursor"] = page["next_cursor"]
    assert seen == [f"frame-{i}.obj" for i in range(5)]
    problem(server.client.get(f"/v1/edits/{edit_id}/results?cursor=zzz"), 400)


def test_results_are_refused_until_ready_and_after_they_expired(server: Server) -> None:
    unfinished = server.start()
    early = problem(server.client.get(f"/v1/edits/{unfinished}/results/edited.obj"), 409)
    assert early["errors"][0]["code"] == "not_ready"

    edit_id = finished(server, {"edited.obj": b"v"})
    change = update(tables.edits).where(tables.edits.c.id == edit_id)
    past = change.values(expires_at=tables.edits.c.created_at)
    server.parts.records._database.run(lambda connection: connection.execute(past))
    server.parts.blobs.delete(*server.parts.records.expire_results())
    for path in ("results", "results/edited.obj"):
        problem(server.client.get(f"/v1/edits/{edit_id}/{path}"), 410)
    shown = server.client.get(f"/v1/edits/{edit_id}")
    assert shown.status_code == 200
    assert shown.json()["results"] is None


def watch(server: Server, edit_id: str, after: int | None = None) -> list[ServerSentEvent]:
    headers = {} if after is None else {"Last-Event-ID": str(after)}
    with httpx.Client(timeout=20) as client:
        url = f"{server.url}/v1/edits/{edit_id}/events"
        with connect_sse(client, "GET", url, headers=headers) as source:
            assert source.response.headers["content-type"].startswith("text/event-stream")
            return list(source.iter_sse())


def test_events_tell_the_whole_story_and_then_end(server: Server) -> None:
    edit_id = server.start()
    told: list[ServerSentEvent] = []
    watcher = threading.Thread(target=lambda: told.extend(watch(server, edit_id)))
    watcher.start()
    edit = server.parts.begin(edit_id)
    for progress in (0.0, 0.5, 1.0):
        server.parts.report(edit, "registration", "running", progress)
    server.parts.report(edit, "registration", "done", 1.0)
    server.parts.publish(edit, {"edited.obj": b"v"})
    watcher.join(15)
    assert not watcher.is_alive()
    assert [int(event.id) for event in told] == list(range(1, len(told) + 1))
    statuses = [json.loads(e.data)["status"] for e in told if e.event == "status"]
    assert statuses == ["queued", "running", "succeeded"]
    assert {event.event for event in told} == {"status", "stage", "progress"}
    last = next(json.loads(e.data) for e in reversed(told) if e.event != "status")
    assert (last["name"], last["status"], last["progress"]) == ("registration", "done", 1.0)

    resumed = watch(server, edit_id, after=3)
    assert [(e.id, e.data) for e in resumed] == [(e.id, e.data) for e in told[3:]]
    assert watch(server, edit_id, after=len(told)) == []


def test_events_of_an_edit_that_is_canceled_end(server: Server) -> None:
    edit_id = server.start()
    threading.Timer(0.5, server.client.post, [f"/v1/edits/{edit_id}/cancel"]).start()
    began = time.monotonic()
    told = watch(server, edit_id)
    assert time.monotonic() - began < 8
    assert json.loads(told[-1].data)["status"] == "canceled"


@pytest.mark.parametrize("after", ["x", "-1", "1_0", "9" * 30])
def test_garbage_to_resume_from_is_refused(server: Server, after: str) -> None:
    edit_id = server.start()
    answer = server.client.get(f"/v1/edits/{edit_id}/events", headers={"last-event-id": after})
    problem(answer, 422)
