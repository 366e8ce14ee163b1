"""Edits over real HTTP: accepted once, looked at, waited for, canceled, deleted."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from engine.errors import TopologyError
from service.failures import refusal
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE
from tests.service.http_server import Serve, Server, problem

pytest_plugins = ["tests.service.http_fixtures"]


def test_an_edit_is_accepted_and_can_be_looked_at(server: Server) -> None:
    document = server.edit(
        weights={"smile": 0.7}, control_points={"points": [{"at": {"vertex": 5}}]}
    )
    answer = server.client.post("/v1/edits", json=document)
    assert answer.status_code == 202
    edit = answer.json()
    assert edit["id"].startswith("edt_")
    assert answer.headers["location"] == f"/v1/edits/{edit['id']}"
    assert int(answer.headers["retry-after"]) >= 1
    assert (edit["status"], edit["queue_position"], edit["stages"]) == ("queued", 1, [])
    assert edit["document"]["weights"] == {"smile": 0.7}
    assert edit["document"]["control_points"]["points"][0]["name"] == "point-0"
    looked = server.client.get(answer.headers["location"])
    assert looked.status_code == 200
    assert looked.json() == edit
    assert set(edit["links"]) == {"self", "events", "results", "cancel"}


def test_stages_show_what_the_job_reports(server: Server) -> None:
    edit = server.parts.begin(server.start())
    server.parts.report(edit, "registration", "running", 0.25)
    shown = server.client.get(f"/v1/edits/{edit.id}").json()
    assert shown["status"] == "running"
    assert shown["queue_position"] is None
    (stage,) = shown["stages"]
    assert (stage["name"], stage["status"], stage["progress"]) == ("registration", "running", 0.25)
    assert stage["cached"] is False
    server.parts.publish(edit, {})


def test_prefer_wait_answers_with_the_finished_edit(server: Server) -> None:
    document = server.edit()
    with ThreadPoolExecutor() as pool:
        waiting = pool.submit(
            server.client.post, "/v1/edits", json=document, headers={"prefer": "wait=20"}
        )
        while not (queued := server.client.get("/v1/edits?status=queued").json()["items"]):
            time.sleep(0.02)
        server.parts.publish(server.parts.begin(queued[0]["id"]), {"edited.obj": b"v 0 0 0\n"})
        answer = waiting.result(20)
    assert answer.status_code == 201
    assert answer.elapsed.total_seconds() < 15
    assert answer.headers["preference-applied"] == "wait=20"
    edit = answer.json()
    assert edit["status"] == "succeeded"
    (result,) = edit["results"]
    assert (result["name"], result["role"], result["bytes"]) == ("edited.obj", "mesh", 8)
    assert result["href"] == f"/v1/edits/{edit['id']}/results/edited.obj"


@pytest.mark.parametrize("prefer", ["wait=0", "respond-async, wait=1", "wait=x", "w" * 999])
def test_prefer_wait_gives_up_when_its_time_is_over(server: Server, prefer: str) -> None:
    began = time.monotonic()
    answer = server.client.post("/v1/edits", json=server.edit(), headers={"prefer": prefer})
    assert answer.status_code == 202
    assert time.monotonic() - began < 6


def test_long_polls_end_with_the_edit_or_with_their_time(server: Server) -> None:
    edit_id = server.start()
    began = time.monotonic()
    assert server.client.get(f"/v1/edits/{edit_id}?wait=1").json()["status"] == "queued"
    assert 0.9 < time.monotonic() - began < 4
    with ThreadPoolExecutor(12) as pool:
        polls = [
            pool.submit(server.client.get, f"/v1/edits/{edit_id}?wait=100000") for _ in range(12)
        ]
        time.sleep(0.3)
        assert not any(poll.done() for poll in polls)
        server.client.post(f"/v1/edits/{edit_id}/cancel")
        assert {poll.result(10).json()["status"] for poll in polls} == {"canceled"}


@pytest.mark.parametrize("wait", ["-1", "x", "nan", "inf", "1e308"])
def test_waits_that_make_no_sense_are_refused(server: Server, wait: str) -> None:
    answer = server.client.get(f"/v1/edits/{server.start()}?wait={wait}")
    assert problem(answer, 422)["errors"][0]["parameter"] == "wait"


def test_an_idempotency_key_gives_the_first_answer_again(server: Server) -> None:
    document = server.edit(weights={"smile": 0.25})
    key = {"idempotency-key": "once only"}
    with ThreadPoolExecutor(6) as pool:
        answers = [
            future.result()
            for future in [
                pool.submit(server.client.post, "/v1/edits", json=document, headers=key)
                for _ in range(6)
            ]
        ]
    assert {answer.status_code for answer in answers} == {202}
    assert len({answer.json()["id"] for answer in answers}) == 1
    assert sum("idempotency-replayed" not in answer.headers for answer in answers) == 1
    other = server.client.post("/v1/edits", json=document | {"frames": 3}, headers=key)
    assert problem(other, 422)["errors"][0]["code"] == "idempotency_key_reused"


@pytest.mark.parametrize("key", ["", "x" * 256, "\x7f", "é".encode("latin-1").decode("latin-1")])
def test_odd_idempotency_keys_are_refused(server: Server, key: str) -> None:
    headers = {"idempotency-key": key.encode("latin-1")}
    problem(server.client.post("/v1/edits", json=server.edit(), headers=headers), 422)


def test_validation_only_starts_nothing_and_names_everything(server: Server) -> None:
    good = server.edit(control_points={"points": [{"name": "a", "at": {"vertex": 5}}]})
    answer = server.client.post("/v1/edits?validate_only=true", json=good)
    assert answer.status_code == 200, answer.text
    assert answer.json()["valid"] is True
    assert answer.json()["document"]["source"] == good["source"]
    smile = good["targets"][0]["mesh"]
    assert answer.json()["inputs"] == {
        "source": {"mesh": good["source"], "unit_guess": "cm"},
        "targets": {"smile": {"mesh": smile, "unit_guess": "cm"}},
    }

    points = [
        {"name": "far", "at": {"position": [1e5, 0, 0]}},
        {"name": "good", "at": {"vertex": 4}, "to": {"smile": {"position": [0, 9e4, 0]}}},
    ]
    bad = good | {"control_points": {"points": points}}
    refused = problem(server.client.post("/v1/edits?validate_only=true", json=bad), 422)
    pointers = [error["pointer"] for error in refused["errors"]]
    assert len(pointers) == 2
    assert pointers[0].startswith("/control_points/points/0/at")
    assert pointers[1].startswith("/control_points/points/1/to/smile")
    assert server.client.get("/v1/edits?status=queued").json()["items"] == []


def test_unknown_meshes_vertices_and_landmarks_are_named_at_once(server: Server) -> None:
    document = server.edit()
    document["targets"].append({"mesh": "msh_0", "name": "other"})
    document["control_points"] = {
        "points": [
            {"at": {"vertex": 10_000}},
            {
                "at": {"landmark": "chin"},
                "to": {"smile": {"polygon": 20_000, "barycentric": [1, 0, 0]}},
            },
        ]
    }
    refused = problem(server.client.post("/v1/edits", json=document), 422)
    assert {(error["pointer"], error["code"]) for error in refused["errors"]} == {
        ("/targets/1/mesh", "unknown_mesh"),
        ("/control_points/points/0/at/vertex", "vertex_out_of_range"),
        ("/control_points/points/1/at/landmark", "unknown_landmark"),
        ("/control_points/points/1/to/smile/polygon", "polygon_out_of_range"),
    }


def test_landmarks_become_places_when_an_edit_is_accepted(server: Server) -> None:
    document = server.edit(control_points={"points": [{"at": {"landmark": "tip"}}]})
    server.client.put(f"/v1/meshes/{document['source']}/landmarks", json={"tip": {"vertex": 9}})
    answer = server.client.post("/v1/edits", json=document)
    assert answer.status_code == 202, answer.text
    assert answer.json()["document"]["control_points"]["points"][0]["at"] == {"vertex": 9}
    server.client.put(f"/v1/meshes/{document['source']}/landmarks", json={})


def form_files() -> dict[str, tuple[str, bytes]]:
    return {
        "first": ("neutral.ply", ICT_NEUTRAL.read_bytes()),
        "second": ("jaw.ply", ICT_JAW_OPEN.read_bytes()),
    }


def test_one_form_goes_from_files_to_a_job(server: Server) -> None:
    edit = '{"source": "neutral.ply", "targets": [{"mesh": "second", "name": "jaw"}]}'
    answer = server.client.post("/v1/edits", files=form_files(), data={"edit": edit})
    assert answer.status_code == 202, answer.text
    document = answer.json()["document"]
    assert document["source"] == server.upload(ICT_NEUTRAL)
    assert document["targets"][0]["mesh"] == server.upload(ICT_JAW_OPEN)


def test_forms_that_do_not_fit_together_are_refused(server: Server) -> None:
    edit = '{"source": "neutral.ply", "targets": [{"mesh": "jaw.ply", "name": "jaw"}]}'

    def refused(status: int, edit: str, files: object) -> list[str]:
        answer = server.client.post("/v1/edits", files=files, data={"edit": edit})
        return [error["code"] for error in problem(answer, status)["errors"]]

    one = {"neutral.ply": ("neutral.ply", ICT_NEUTRAL.read_bytes())}
    assert refused(422, edit, one) == ["unknown_mesh"]
    assert refused(422, edit.replace('"jaw.ply"', '"neutral.ply"'), form_files()) == ["unused_file"]
    assert refused(400, "{", form_files()) == ["malformed"]
    twice = [("a", ("n.ply", b"x")), ("b", ("n.ply", b"y"))]
    assert refused(422, edit, twice) == ["duplicate_file"]
    broken = form_files() | {"second": ("jaw.ply", ICT_SMILE.read_bytes()[:90_000] + b"#")}
    answer = server.client.post("/v1/edits", files=broken, data={"edit": edit})
    assert problem(answer, 422)["errors"][0]["elements"]["file"] == "jaw.ply"
    problem(server.client.post("/v1/edits", files=form_files()), 422)


def test_lists_filter_by_status(server: Server) -> None:
    kept, ended = server.start(), server.start()
    server.client.post(f"/v1/edits/{ended}/cancel")
    queued = server.client.get("/v1/edits?status=queued").json()["items"]
    canceled = server.client.get("/v1/edits?status=canceled&limit=1").json()
    assert [edit["id"] for edit in queued] == [kept]
    assert canceled["items"][0]["id"] == ended
    problem(server.client.get("/v1/edits?status=lost"), 422)
    problem(server.client.get("/v1/edits?cursor=%00"), 400)


def test_cancel_is_idempotent_and_delete_needs_an_end(server: Server) -> None:
    edit_id = server.start()
    assert problem(server.client.delete(f"/v1/edits/{edit_id}"), 409)
    for _ in range(2):
        answer = server.client.post(f"/v1/edits/{edit_id}/cancel")
        assert answer.status_code == 202
        assert answer.json()["status"] == "canceled"
    assert server.client.delete(f"/v1/edits/{edit_id}").status_code == 204
    for method, path in [("GET", ""), ("DELETE", ""), ("POST", "/cancel"), ("GET", "/events")]:
        problem(server.client.request(method, f"/v1/edits/{edit_id}{path}"), 404)


def test_a_failed_edit_is_answered_with_its_problem(server: Server) -> None:
    edit = server.parts.begin(server.start())
    error = TopologyError("no disk", code="no_disk", elements={"loops": [3, 4]})
    assert server.parts.records.fail(edit.id, edit.attempt, refusal(error))
    answer = server.client.get(f"/v1/edits/{edit.id}")
    assert answer.status_code == 200
    shown = answer.json()
    assert shown["status"] == "failed"
    assert {"type", "title", "status", "detail", "errors", "trace_id"} <= set(shown["error"])
    assert shown["error"]["errors"][0]["elements"] == {"loops": [3, 4]}
    problem(server.client.get(f"/v1/edits/{edit.id}/results"), 409)


def test_a_full_queue_is_said_so(serve: Serve) -> None:
    small = serve(queue_limit=1)
    small.start()
    answer = small.client.post("/v1/edits", json=small.edit())
    problem(answer, 429)
    assert int(answer.headers["retry-after"]) >= 1


def test_a_draining_service_takes_no_new_work_and_answers_who_waits(serve: Serve) -> None:
    closing = serve()
    document, edit_id = closing.edit(), closing.start()
    threading.Timer(0.5, closing.parts.draining.set).start()
    began = time.monotonic()
    assert closing.client.get(f"/v1/edits/{edit_id}?wait=60").json()["status"] == "queued"
    assert time.monotonic() - began < 5
    answer = closing.client.post("/v1/edits", json=document)
    problem(answer, 503)
    assert "retry-after" in answer.headers
    problem(closing.client.post("/v1/meshes", content=b"v 0 0 0"), 503)
    problem(closing.client.get("/readyz"), 503)
    assert closing.client.get("/livez").status_code == 200
    assert closing.client.get(f"/v1/edits/{edit_id}").status_code == 200
    closing.client.post(f"/v1/edits/{edit_id}/cancel")
