"""Odd files over HTTP: taken with a warning or refused with a reason, and never a failure."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from engine.io import read_mesh
from engine.types import FloatArray
from service.domain import Json
from tests.acceptance import awkward_faces as odd
from tests.acceptance.files import small
from tests.acceptance.processes import Service
from tests.faces import ICT_SMILE
from tests.service.http_server import problem

pytest_plugins = ["tests.acceptance.fixtures"]
FINER = 4500
MOVE = (0.0, 0.3, 0.5)
FAR = 1e5
Make = Callable[[], bytes]

REFUSED: dict[str, tuple[Make, int, str]] = {
    "nan.ply": (odd.with_nan, 422, "not_finite"),
    "out_of_range.ply": (odd.index_out_of_range, 422, "index_out_of_range"),
    "truncated.ply": (odd.truncated, 422, "truncated"),
    "points.ply": (odd.points_only, 422, "no_faces"),
    "empty.obj": (lambda: b"# nothing\n", 422, "no_vertices"),
    "nothing.ply": (lambda: b"", 422, "empty"),
    "picture.ply": (lambda: b"\x89PNG\r\n\x1a\n" + bytes(64), 415, "unsupported_format"),
    "mobius.ply": (odd.mobius_strip, 422, "not_orientable"),
    "torus.ply": (odd.torus, 422, "handles"),
    "twice.ply": (odd.two_discs, 422, "ambiguous"),
}
TAKEN: dict[str, tuple[Make, set[str]]] = {
    "negative.obj": (odd.negative_indices, set()),
    "polygons.obj": (odd.polygons, set()),
    "big_endian.ply": (odd.big_endian_doubles, set()),
    "soup.ply": (odd.soup, {"welded_vertices"}),
    "flipped.ply": (odd.partly_flipped, {"flipped_faces"}),
    "fins.ply": (odd.fins, {"nonmanifold_edges", "duplicate_faces", "other_components"}),
    "islands.ply": (odd.islands, {"other_components"}),
    "far_away.ply": (odd.far_away, set()),
    "pinholes.ply": (odd.pinholes, {"pinholes"}),
    "bow_ties.ply": (odd.bow_ties, {"other_components"}),
    "leftovers.obj": (
        odd.leftovers,
        {"point_elements", "line_elements", "free_form_skipped", "unknown_statements"}
        | {"degenerate_faces", "unreferenced_vertices"},
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_surface_is_refused_with_the_reason(running: Service, name: str) -> None:
    make, status, code = REFUSED[name]
    refused = problem(running.upload(name, make()), status)
    assert [error["code"] for error in refused["errors"]] == [code]
    assert len(refused["detail"]) > 10


@pytest.mark.parametrize("name", TAKEN)
def test_what_is_a_surface_somehow_is_taken_and_edited(running: Service, name: str) -> None:
    make, warnings = TAKEN[name]
    content = make()
    answer = running.upload(name, content)
    assert answer.status_code == 201, answer.text
    mesh = answer.json()
    assert {warning["code"] for warning in mesh["warnings"]} == warnings
    for warning in mesh["warnings"]:
        assert 0 < len(warning["first"]) == min(warning["count"], 10)
    check_addresses(running, mesh["id"], content)
    front = nose_of(read_mesh(content).mesh.vertices)
    point = {"name": "nose", "at": {"vertex": front}, "move": MOVE}
    document = {"source": mesh["id"], "control_points": {"points": [point]}}
    said = check_validation(running, document, mesh)
    results = running.results(running.edited(json=document))
    report = json.loads(results["report.json"])
    assert report["warnings"]["source"] == mesh["warnings"]
    assert report["inputs"]["source"].items() >= said["inputs"]["source"].items()
    check_layout(content, results[f"edited.{mesh['format']}"], front)


def nose_of(vertices: FloatArray) -> int:
    """A vertex of the file where the face has the tip of its nose."""
    face = small().vertices
    away = np.array(odd.UTM) * (np.abs(vertices).max() > FAR)
    return int(np.argmin(np.linalg.norm(vertices - away - face[np.argmax(face[:, 2])], axis=1)))


def check_validation(running: Service, document: Json, mesh: Json) -> Json:
    """A validation says beforehand what the mesh's resource says."""
    answer = running.client.post("/v1/edits", params={"validate_only": True}, json=document)
    assert answer.status_code == 200, answer.text
    said = answer.json()
    at_source = [warning | {"pointer": "/source"} for warning in mesh["warnings"]]
    assert said["warnings"] == at_source
    assert said["inputs"]["source"] == {"mesh": mesh["id"], "unit_guess": mesh["unit_guess"]}
    return said


def check_addresses(running: Service, mesh: str, content: bytes) -> None:
    """Vertices and polygons are those of the file, in its order."""
    file = read_mesh(content)
    polygon = 321
    corner, after = file.corners[file.offsets[polygon] :][:2].tolist()
    points = [
        {"at": {"vertex": corner}},
        {"at": {"polygon": polygon, "barycentric": [0.75, 0.25, 0.0]}},
    ]
    answer = running.client.post(f"/v1/meshes/{mesh}/snap", json={"points": points})
    assert answer.status_code == 200, answer.text
    at = np.array([point["position"] for point in answer.json()["points"]])
    ends = file.mesh.vertices[[corner, after]]
    diagonal = np.linalg.norm(np.ptp(file.mesh.vertices, axis=0))
    assert np.abs(at - [ends[0], ends[0] * 0.75 + ends[1] * 0.25]).max() < 1e-9 * diagonal


def check_layout(content: bytes, result: bytes, front: int) -> None:
    """Everything but positions is as it was; what moved ends where asked, or moved by less."""
    before, after = read_mesh(content), read_mesh(result)
    assert after.format == before.format
    assert np.array_equal(after.mesh.faces, before.mesh.faces)
    assert np.array_equal(after.polygon_of, before.polygon_of)
    moved = after.mesh.vertices - before.mesh.vertices
    assert np.abs(moved[front] - MOVE).max() < 2e-6
    assert np.linalg.norm(moved, axis=1).max() < 0.8
    if before.format == "ply":
        end = content.index(b"end_header")
        assert result[:end] == content[:end]
        assert len(result) == len(content)


def test_a_soup_follows_an_expression(running: Service) -> None:
    content = odd.soup(FINER)
    source = running.uploaded("finer soup.ply", content)
    smile = running.uploaded("smile.ply", ICT_SMILE.read_bytes())
    targets = [{"mesh": smile, "name": "smile"}]
    edit = running.edited(json={"source": source, "targets": targets})
    after = read_mesh(running.results(edit)["edited.ply"]).mesh
    before = read_mesh(content).mesh
    together = np.unique(before.vertices, axis=0, return_inverse=True)[1]
    order = np.argsort(together, kind="stable")
    apart = np.diff(together[order]) == 0
    gaps = np.linalg.norm(np.diff(after.vertices[order], axis=0), axis=1)[apart]
    assert gaps.max() == 0, "the soup came apart"
    assert np.linalg.norm(after.vertices - before.vertices, axis=1).max() > 0.5
