"""Whatever is sent in place of an edit document is answered with 4xx and the place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from service.domain import Json
from service.schemas import EditDocument, broken_rules, parse
from tests.service.http_server import Server, problem

pytest_plugins = ["tests.service.http_fixtures"]

EXAMPLES = Path(__file__).parents[2] / "openapi" / "examples"
SOURCE = {"source": "msh_a"}
TARGET = [{"mesh": "msh_b", "name": "smile"}]
POINT = {"name": "a", "at": {"vertex": 0}}


def with_point(**changes: Any) -> Json:
    return SOURCE | {"targets": TARGET, "control_points": {"points": [POINT | changes]}}


def with_fields(**changes: Any) -> Json:
    return SOURCE | {"targets": TARGET} | changes


AT = "/control_points/points/0"
FAULTS: list[tuple[Json, str, str]] = [
    ({}, "/source", "missing"),
    (with_fields(surprise=1), "/surprise", "unknown_field"),
    (with_fields(source=5), "/source", "string_type"),
    (with_fields(source="a\x00b"), "/source", "string_pattern_mismatch"),
    (with_fields(source="x" * 999), "/source", "string_too_long"),
    (SOURCE, "/targets", "nothing_to_do"),
    (SOURCE | {"targets": TARGET * 17}, "/targets", "too_long"),
    (SOURCE | {"targets": TARGET * 2}, "/targets/1/name", "duplicate_name"),
    (
        SOURCE | {"targets": [{"mesh": "m", "name": "../x"}]},
        "/targets/0/name",
        "string_pattern_mismatch",
    ),
    (with_fields(weights={"smile": 3.5}), "/weights/smile", "less_than_equal"),
    (with_fields(weights={"smile": -2.5}), "/weights/smile", "greater_than_equal"),
    (with_fields(weights={"smile": True}), "/weights/smile", "float_type"),
    (with_fields(weights={"smile": "1"}), "/weights/smile", "float_type"),
    (with_fields(weights={"frown": 1}), "/weights/frown", "unknown_target"),
    (with_fields(weights={"a/b~c": 1}), "/weights/a~1b~0c", "string_pattern_mismatch"),
    (
        with_fields(weights={"smile": 1}, distance={"smile": 1}),
        "/distance/smile",
        "weight_and_distance",
    ),
    (with_fields(distance={"smile": -1}), "/distance/smile", "greater_than_equal"),
    (with_fields(frames=1), "/frames", "greater_than_equal"),
    (with_fields(frames=481), "/frames", "less_than_equal"),
    (with_fields(frames=10**400), "/frames", "less_than_equal"),
    (with_fields(frames=2.5), "/frames", "int_type"),
    (with_fields(keyframes=[{"time": 0, "weights": {}}] * 2), "/keyframes", "frames_missing"),
    (
        with_fields(frames=3, keyframes=[{"time": 1, "weights": {}}, {"time": 1, "weights": {}}]),
        "/keyframes/1/time",
        "times_not_increasing",
    ),
    (with_fields(output={"formats": ["stl"]}), "/output/formats/0", "literal_error"),
    (with_fields(output={"formats": ["obj", "obj"]}), "/output/formats/1", "duplicate_format"),
    (with_fields(output={"histogram_bins": 0}), "/output/histogram_bins", "greater_than_equal"),
    (with_fields(options={"iteration": "magic"}), "/options/iteration", "literal_error"),
    (with_fields(options={"holes": "closed"}), "/options/holes", "literal_error"),
    (
        with_fields(options={"iteration": "paper", "holes": "kept"}),
        "/options/holes",
        "iteration_excludes_holes",
    ),
    (
        with_fields(options={"iteration": "paper_teichmueller", "outer_boundary": "sliding"}),
        "/options/outer_boundary",
        "iteration_excludes_outer_boundary",
    ),
    (with_fields(control_points={"auto": -1}), "/control_points/auto", "greater_than_equal"),
    (with_fields(control_points={"auto": 10**9}), "/control_points/auto", "less_than_equal"),
    (
        with_fields(control_points={"points": [POINT, POINT]}),
        "/control_points/points/1/name",
        "duplicate_name",
    ),
    (with_point(at={"vertex": -1}), f"{AT}/at/vertex", "greater_than_equal"),
    (with_point(at={"vertex": 2**63}), f"{AT}/at/vertex", "less_than_equal"),
    (with_point(at={"vertex": 1, "position": [0, 0, 0]}), f"{AT}/at", "address"),
    (with_point(at={}), f"{AT}/at", "address"),
    (with_point(at=7), f"{AT}/at", "address"),
    (with_point(at={"polygon": 1}), f"{AT}/at/barycentric", "missing"),
    (
        with_point(at={"polygon": 1, "barycentric": [0.5, 0.2, 0.2]}),
        f"{AT}/at/barycentric",
        "barycentric_sum",
    ),
    (
        with_point(at={"polygon": 1, "barycentric": [2, -1, 0]}),
        f"{AT}/at/barycentric/0",
        "less_than_equal",
    ),
    (with_point(at={"position": [0, 0]}), f"{AT}/at/position/2", "missing"),
    (
        with_point(at={"position": [0, 0, 0], "max_snap": -1}),
        f"{AT}/at/max_snap",
        "greater_than_equal",
    ),
    (with_point(at={"position": [0, 0, 1e300]}), f"{AT}/at/position/2", "less_than_equal"),
    (with_point(to={"smile": {"vertex": 1.5}}), f"{AT}/to/smile/vertex", "int_type"),
    (with_point(to={"frown": {"vertex": 1}}), f"{AT}/to/frown", "unknown_target"),
    (with_point(moved_to={"smile": {"vertex": 1}}), f"{AT}/moved_to/smile", "moved_to_without_to"),
    (with_point(fixed=True, move=[0, 0, 1]), f"{AT}/move", "fixed_excludes_move"),
    (with_point(fixed=True, to={"smile": {"vertex": 1}}), f"{AT}/to", "fixed_excludes_to"),
    (with_point(move=[0, 0, 1], weights={"smile": 1}), f"{AT}/weights", "move_excludes_weights"),
]


@pytest.mark.parametrize(("document", "pointer", "code"), FAULTS)
def test_every_fault_has_a_pointer_and_a_code(
    server: Server, document: Json, pointer: str, code: str
) -> None:
    refused = problem(server.client.post("/v1/edits", json=document), 422)
    assert (pointer, code) in [(error["pointer"], error["code"]) for error in refused["errors"]]
    assert all(error["message"] for error in refused["errors"])


def test_many_faults_are_named_together_and_their_number_is_bounded(server: Server) -> None:
    document = with_fields(weights={"smile": 9}, frames=0, options={"iteration": 1})
    refused = problem(server.client.post("/v1/edits", json=document), 422)
    assert len(refused["errors"]) == 3
    points = {"points": [{"at": {"vertex": -1}}] * 5000}
    refused = problem(server.client.post("/v1/edits", json=with_fields(control_points=points)), 422)
    assert len(refused["errors"]) == 100
    refused = problem(
        server.client.post("/v1/edits", json=SOURCE | dict.fromkeys(map(str, range(50_000)))), 422
    )
    assert refused["errors"][0]["code"] == "too_many_errors"


def test_the_number_of_control_points_is_bounded(server: Server) -> None:
    points = [{"name": f"p{i}", "at": {"vertex": i}} for i in range(100_000)]
    document = with_fields(control_points={"points": points})
    refused = problem(server.client.post("/v1/edits", json=document), 422)
    assert refused["errors"][0]["elements"]["max_length"] == 10_000


DEEP = 100_000
MALFORMED = [
    b"",
    b"{",
    b"nonsense",
    b'{"source": "a",}',
    b"[" * DEEP + b"]" * DEEP,
    b'{"targets": ' + b"[" * 300 + b"]" * 300 + b"}",
    b'{"source": "\\ud800"}',
    b'{"source": "\xff"}',
    b'\xef\xbb\xbf{"source": "a"}',
    b'{"frames": ' + b"9" * 10_000 + b"}",
    b"\x00" * 100,
]


@pytest.mark.parametrize("body", MALFORMED, ids=range(len(MALFORMED)))
def test_what_is_no_json_is_malformed(server: Server, body: bytes) -> None:
    headers = {"content-type": "application/json"}
    answer = server.client.post("/v1/edits", content=body, headers=headers)
    assert problem(answer, 400)["errors"][0]["code"] == "malformed"


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_are_none_are_refused(server: Server, value: str) -> None:
    body = json.dumps(with_fields(weights={"smile": 12345})).replace("12345", value)
    answer = server.client.post(
        "/v1/edits", content=body, headers={"content-type": "application/json"}
    )
    assert problem(answer, 422)["errors"][0]["pointer"] == "/weights/smile"


@pytest.mark.parametrize("document", [[], "text", 1, None, True, [SOURCE]])
def test_documents_that_are_no_objects_are_refused(server: Server, document: Any) -> None:
    answer = server.client.post("/v1/edits", content=json.dumps(document))
    assert problem(answer, 422)["errors"][0]["pointer"] == ""


@pytest.mark.parametrize(
    "kind", ["text/plain", "application/xml", "application/x-www-form-urlencoded", "\xff"]
)
def test_other_kinds_of_content_are_not_taken(server: Server, kind: str) -> None:
    headers = {"content-type": kind.encode("latin-1")}
    problem(server.client.post("/v1/edits", content=b"{}", headers=headers), 415)


def test_documents_have_a_limit(server: Server) -> None:
    body = b'{"source": "' + b"x" * (9 * 1024**2) + b'"}'
    answer = server.client.post(
        "/v1/edits", content=body, headers={"content-type": "application/json"}
    )
    assert problem(answer, 413)["errors"][0]["elements"]["limit"] == 8 * 1024**2


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.json")), ids=lambda path: path.stem)
def test_the_examples_have_the_right_form(path: Path) -> None:
    assert broken_rules(parse(EditDocument, path.read_bytes())) == []


def test_the_example_of_the_contract_has_the_right_form(server: Server) -> None:
    document = server.client.get("/openapi.json").json()
    content = document["paths"]["/v1/edits"]["post"]["requestBody"]["content"]
    example = content["application/json"]["example"]
    refused = problem(server.client.post("/v1/edits", json=example), 422)
    assert {error["code"] for error in refused["errors"]} == {"unknown_mesh"}
    assert len(refused["errors"]) == 3
