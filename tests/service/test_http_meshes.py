"""Meshes over real HTTP: what is kept, what is refused, and how."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Iterator

import pytest

from tests.faces import HEAD_NEUTRAL, ICT_JAW_OPEN, ICT_NEUTRAL
from tests.service.http_server import Serve, Server, problem

pytest_plugins = ["tests.service.http_fixtures"]


def blob_count(server: Server) -> int:
    return sum(1 for _ in server.parts.blobs.keys_older_than("meshes", -60))


def test_a_file_becomes_a_mesh_and_the_same_bytes_the_same_one(server: Server) -> None:
    data = HEAD_NEUTRAL.read_bytes()
    first = server.client.post("/v1/meshes", files={"file": ("head neutral.obj", data)})
    again = server.client.post("/v1/meshes?name=other.obj", content=data)

    assert (first.status_code, again.status_code) == (201, 200)
    mesh = first.json()
    assert mesh == again.json()
    assert mesh["name"] == "head neutral.obj"
    assert mesh["format"] == "obj"
    assert mesh["bytes"] == len(data)
    assert mesh["sha256"] == hashlib.sha256(data).hexdigest()
    assert mesh["polygons"] > 0
    assert mesh["triangles"] == 2 * mesh["polygons"]
    assert mesh["created_at"].endswith("Z")
    assert mesh["warnings"] == [] or mesh["warnings"][0]["code"]
    assert first.headers["location"] == f"/v1/meshes/{mesh['id']}"
    assert server.client.get(first.headers["location"]).json() == mesh


def test_the_patch_has_the_topology_it_is_known_to_have(server: Server) -> None:
    mesh = server.client.get(f"/v1/meshes/{server.upload(ICT_NEUTRAL)}").json()
    counts = [mesh[key] for key in ("vertices", "triangles", "components", "boundary_loops")]
    assert counts == [9409, 18460, 1, 4]
    assert mesh["euler_characteristic"] == -2
    low, high = mesh["bounding_box"]
    assert all(a < b for a, b in zip(low, high, strict=True))


def test_chunks_without_a_length_are_taken(server: Server) -> None:
    data = ICT_JAW_OPEN.read_bytes()

    def chunks() -> Iterator[bytes]:
        for start in range(0, len(data), 10_000):
            yield data[start : start + 10_000]

    answer = server.client.post("/v1/meshes", params={"name": "jaw.ply"}, content=chunks())
    assert answer.status_code in {200, 201}
    assert answer.json()["sha256"] == hashlib.sha256(data).hexdigest()


@pytest.mark.parametrize("declared", [True, False])
def test_too_large_a_body_is_refused_with_the_limit(serve: Serve, declared: bool) -> None:
    small = serve(max_upload_bytes=200_000)
    before = blob_count(small)
    data = ICT_NEUTRAL.read_bytes()[:240_000]
    body = data if declared else iter([data[:150_000], data[150_000:]])
    refused = problem(small.client.post("/v1/meshes", content=body), 413)
    assert refused["errors"][0]["elements"] == {"limit": 200_000}
    form = small.client.post("/v1/meshes", files={"file": ("a.ply", data)})
    assert "200000" in problem(form, 413)["detail"]
    assert blob_count(small) == before


@pytest.mark.parametrize(
    ("content", "status"),
    [
        (b"", {415, 422}),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), {415}),
        (b"hello, I am a text", {415, 422}),
        (b"ply\nformat ascii 1.0\nelement vertex 4294967295\n", {422}),
        (b"\x00" * 5000, {415, 422}),
        (ICT_NEUTRAL.read_bytes()[:150_000], {422}),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", {422}),
        (b"v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", {422}),
    ],
)
def test_what_is_no_mesh_is_refused_and_not_kept(
    server: Server, content: bytes, status: set[int]
) -> None:
    before = blob_count(server)
    answer = server.client.post("/v1/meshes?name=a.ply", content=content)
    assert answer.status_code in status, answer.text
    refused = problem(answer, answer.status_code)
    assert refused["errors"][0]["code"]
    assert blob_count(server) == before


@pytest.mark.parametrize("name", ["a\x00b.ply", "x" * 300, "a\nb.ply"])
def test_names_that_cannot_be_shown_are_refused(server: Server, name: str) -> None:
    answer = server.client.post("/v1/meshes", params={"name": name}, content=b"ply")
    assert problem(answer, 422)["errors"][0]["parameter"] == "name"


@pytest.mark.parametrize(
    ("headers", "content"),
    [
        ({"content-type": "multipart/form-data"}, b"no boundary"),
        ({"content-type": "multipart/form-data; boundary=x"}, b"not a form"),
        ({"content-type": "multipart/form-data; boundary=x"}, b"--x\r\n\r\nabc\r\n--x--\r\n"),
        ({"content-type": "multipart/form-data; boundary=x; charset=hex"}, b"--x--\r\n"),
        (
            {"content-type": "multipart/form-data; boundary=x; charset=hex"},
            b'--x\r\ncontent-disposition: form-data; name="file"\r\n\r\nzz\r\n--x--\r\n',
        ),
    ],
)
def test_broken_forms_are_refused(server: Server, headers: dict[str, str], content: bytes) -> None:
    answer = server.client.post("/v1/meshes", headers=headers, content=content)
    assert answer.status_code in {400, 422}
    problem(answer, answer.status_code)


def test_a_form_needs_one_file(server: Server) -> None:
    problem(server.client.post("/v1/meshes", files={"other": b"x"}), 422)
    problem(server.client.post("/v1/meshes", files=[("file", b"x"), ("file", b"y")]), 422)


def test_gzip_is_unpacked_whether_the_file_or_the_transfer_is_packed(server: Server) -> None:
    data = b"# packed\n" + HEAD_NEUTRAL.read_bytes()
    half = len(data) // 2
    packed = gzip.compress(data[:half]) + gzip.compress(data[half:]) + bytes(100)
    first = server.client.post("/v1/meshes?name=head.obj.gz", content=packed)
    assert first.status_code == 201, first.text
    mesh = first.json()
    assert (mesh["name"], mesh["format"], mesh["bytes"]) == ("head.obj", "obj", len(data))
    assert mesh["sha256"] == hashlib.sha256(data).hexdigest()
    assert server.client.get(f"/v1/meshes/{mesh['id']}/content").content == data
    coded = {"content-encoding": "gzip"}
    same = [
        server.client.post("/v1/meshes", content=data),
        server.client.post("/v1/meshes", content=gzip.compress(data), headers=coded),
        server.client.post("/v1/meshes", content=gzip.compress(packed), headers=coded),
        server.client.post("/v1/meshes", files={"file": ("head.obj.gz", packed)}),
    ]
    assert [(answer.status_code, answer.json()["id"]) for answer in same] == [(200, mesh["id"])] * 4
    snap = gzip.compress(b'{"points": [{"at": {"vertex": 1}}]}')
    href = f"/v1/meshes/{mesh['id']}/snap"
    json = {"content-type": "application/json"}
    assert server.client.post(href, content=snap, headers=json | coded).status_code == 200


def test_broken_and_swelling_gzip_is_refused(serve: Serve) -> None:
    small = serve(max_upload_bytes=1_000_000)
    before = blob_count(small)
    packed = gzip.compress(ICT_NEUTRAL.read_bytes())
    bomb = gzip.compress(bytes(300_000_000))
    assert len(bomb) < 1_000_000
    damaged = packed[:2000] + bytes(100) + packed[2100:]
    for headers in ({}, {"content-encoding": "gzip"}):
        for content, status, code in [
            (packed[:-20], 422, "gzip"),
            (damaged, 422, "gzip"),
            (packed + b"more", 422, "gzip"),
            (bomb, 413, "too_large"),
        ]:
            answer = small.client.post("/v1/meshes", content=content, headers=headers)
            assert problem(answer, status)["errors"][0]["code"] == code
    for coding in ("br", "gzip, gzip"):
        answer = small.client.post(
            "/v1/meshes", content=packed, headers={"content-encoding": coding}
        )
        assert problem(answer, 415)["errors"][0]["code"] == "content_encoding"
        assert answer.headers["accept-encoding"] == "gzip"
    assert blob_count(small) == before


def test_lists_come_in_pieces_newest_first(server: Server) -> None:
    ids = {server.upload(path) for path in (ICT_NEUTRAL, ICT_JAW_OPEN, HEAD_NEUTRAL)}
    seen: list[str] = []
    cursor: dict[str, str] = {}
    while True:
        page = server.client.get("/v1/meshes", params={"limit": 1, **cursor}).json()
        seen += [item["id"] for item in page["items"]]
        if page["next_cursor"] is None:
            break
        cursor = {"cursor": page["next_cursor"]}
    assert ids <= set(seen)
    assert len(seen) == len(set(seen))
    whole = server.client.get("/v1/meshes").json()["items"]
    assert [item["id"] for item in whole] == seen
    assert whole == sorted(whole, key=lambda item: item["created_at"], reverse=True)


@pytest.mark.parametrize("query", ["limit=0", "limit=-1", "limit=1e9", "limit=x", "limit=99999"])
def test_limits_out_of_range_are_refused(server: Server, query: str) -> None:
    refused = problem(server.client.get(f"/v1/meshes?{query}"), 422)
    assert refused["errors"][0]["parameter"] == "limit"


@pytest.mark.parametrize("cursor", ["x", "%00", "%ff", "e30", "é", "a" * 400, ""])
def test_cursors_that_are_none_are_refused(server: Server, cursor: str) -> None:
    problem(server.client.get(f"/v1/meshes?cursor={cursor}"), 400)


@pytest.mark.parametrize(
    "identifier", ["msh_unknown", "%00", "msh_%00", "..", "%F0%9F%98%80", "a" * 3000, "'; DROP"]
)
def test_unknown_ids_are_unknown(server: Server, identifier: str) -> None:
    for method in ("GET", "DELETE"):
        answer = server.client.request(method, f"{server.url}/v1/meshes/{identifier}/")
        if identifier != "..":
            answer = server.client.request(method, f"{server.url}/v1/meshes/{identifier}")
        problem(answer, 404)


def test_the_content_is_the_upload_whole_and_in_ranges(server: Server) -> None:
    data = ICT_NEUTRAL.read_bytes()
    href = f"/v1/meshes/{server.upload(ICT_NEUTRAL)}/content"
    whole = server.client.get(href)
    assert whole.content == data
    assert whole.headers["accept-ranges"] == "bytes"
    assert "attachment" in whole.headers["content-disposition"]
    assert whole.headers["content-length"] == str(len(data))
    etag = whole.headers["etag"]

    head = server.client.head(href)
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-length"] == str(len(data))

    for asked, expected, content_range in [
        ("bytes=0-99", data[:100], f"bytes 0-99/{len(data)}"),
        ("bytes=100-", data[100:], f"bytes 100-{len(data) - 1}/{len(data)}"),
        ("bytes=-7", data[-7:], f"bytes {len(data) - 7}-{len(data) - 1}/{len(data)}"),
        ("bytes=5-999999999", data[5:], f"bytes 5-{len(data) - 1}/{len(data)}"),
    ]:
        part = server.client.get(href, headers={"range": asked})
        assert part.status_code == 206
        assert part.content == expected
        assert part.headers["content-range"] == content_range

    for ignored in ("bytes=9-3", "bytes=a-b", "lines=1-2", "bytes=0-1,5-6", "bytes=-"):
        assert server.client.get(href, headers={"range": ignored}).content == data
    for outside in (f"bytes={len(data)}-", "bytes=999999999999-", "bytes=-0"):
        answer = server.client.get(href, headers={"range": outside})
        problem(answer, 416)
        assert answer.headers["content-range"] == f"bytes */{len(data)}"

    assert server.client.get(href, headers={"if-none-match": f'"x", {etag}'}).status_code == 304
    stale = server.client.get(href, headers={"range": "bytes=0-9", "if-range": '"old"'})
    assert (stale.status_code, stale.content) == (200, data)
    fresh = server.client.get(href, headers={"range": "bytes=0-9", "if-range": etag})
    assert fresh.status_code == 206


def test_addresses_snap_to_the_surface_without_a_job(server: Server) -> None:
    href = f"/v1/meshes/{server.upload(ICT_NEUTRAL)}/snap"
    points = [
        {"name": "tip", "at": {"vertex": 100}},
        {"at": {"polygon": 7, "barycentric": [0.2, 0.3, 0.5]}},
    ]
    answer = server.client.post(href, json={"points": points})
    assert answer.status_code == 200, answer.text
    tip, inside = answer.json()["points"]
    assert (tip["name"], tip["vertex"], tip["snap_distance"]) == ("tip", 100, pytest.approx(0.0))
    assert inside["polygon"] == 7
    assert inside["barycentric"] == pytest.approx([0.2, 0.3, 0.5])

    near = [x + 0.01 for x in tip["position"]]
    (snapped,) = server.client.post(href, json={"points": [{"at": {"position": near}}]}).json()[
        "points"
    ]
    assert 0 < snapped["snap_distance"] <= 0.0174


def test_as_many_addresses_as_a_request_may_have_are_resolved(server: Server) -> None:
    href = f"/v1/meshes/{server.upload(ICT_NEUTRAL)}/snap"
    kinds = [{"vertex": 5}, {"position": [0, 1.2, 13], "max_snap": 9}, {"position": [9e5, 0, 0]}]
    points = [{"at": kinds[k % 2]} for k in range(10_000)]
    answer = server.client.post(href, json={"points": points})
    assert answer.status_code == 200, answer.text
    found = [{**point, "name": ""} for point in answer.json()["points"]]
    assert found[0]["vertex"] == 5
    assert found == found[:2] * 5000
    refused = problem(server.client.post(href, json={"points": [{"at": kinds[2]}] * 10_000}), 422)
    assert len(refused["errors"]) >= 100


def test_addresses_that_cannot_be_resolved_are_all_named(server: Server) -> None:
    href = f"/v1/meshes/{server.upload(ICT_NEUTRAL)}/snap"
    points = [
        {"at": {"vertex": 9409}},
        {"at": {"vertex": 3}},
        {"at": {"polygon": 18460, "barycentric": [1, 0, 0]}},
        {"at": {"landmark": "chin"}},
    ]
    refused = problem(server.client.post(href, json={"points": points}), 422)
    assert [(x["pointer"], x["code"]) for x in refused["errors"]] == [
        ("/points/0/at/vertex", "vertex_out_of_range"),
        ("/points/2/at/polygon", "polygon_out_of_range"),
        ("/points/3/at/landmark", "unknown_landmark"),
    ]
    assert refused["errors"][0]["elements"] == {"index": 9409, "count": 9409}
    far = {"points": [{"at": {"vertex": 1}}, {"at": {"position": [1e6, 0, 0]}}]}
    refused = problem(server.client.post(href, json=far), 422)
    assert refused["errors"][0]["pointer"].startswith("/points/1/at")


def test_landmarks_are_kept_with_a_mesh_and_resolve(server: Server) -> None:
    mesh_id = server.upload(ICT_NEUTRAL)
    wanted = {"nose tip": {"vertex": 42}, "chin": {"polygon": 3, "barycentric": [1, 0, 0]}}
    answer = server.client.put(f"/v1/meshes/{mesh_id}/landmarks", json=wanted)
    assert answer.json()["landmarks"] == wanted
    assert server.client.get(f"/v1/meshes/{mesh_id}").json()["landmarks"] == wanted
    snapped = server.client.post(
        f"/v1/meshes/{mesh_id}/snap", json={"points": [{"at": {"landmark": "nose tip"}}]}
    ).json()
    assert snapped["points"][0]["vertex"] == 42

    refused = server.client.put(
        f"/v1/meshes/{mesh_id}/landmarks", json={"a": {"vertex": 10**6}, "b": {"landmark": "a"}}
    )
    assert problem(refused, 422)["errors"][0]["pointer"] == "/b"
    server.client.put(f"/v1/meshes/{mesh_id}/landmarks", json={})


def test_landmarks_come_with_an_upload_or_nothing_is_kept(server: Server) -> None:
    data = b"# landmarks\n" + HEAD_NEUTRAL.read_bytes()
    files = {"file": ("h.obj", data)}
    before = blob_count(server)
    for landmarks, status in [('{"a": {"vertex": 1000000}}', 422), ("{", 400), ("[]", 422)]:
        answer = server.client.post("/v1/meshes", files=files, data={"landmarks": landmarks})
        problem(answer, status)
    assert blob_count(server) == before
    good = server.client.post("/v1/meshes", files=files, data={"landmarks": '{"a": {"vertex": 1}}'})
    assert good.status_code == 201
    assert good.json()["landmarks"] == {"a": {"vertex": 1}}


def test_a_deleted_mesh_is_gone_unless_an_edit_needs_it(server: Server) -> None:
    edit_id = server.start()
    source = server.client.get(f"/v1/edits/{edit_id}").json()["document"]["source"]
    problem(server.client.delete(f"/v1/meshes/{source}"), 409)
    server.client.post(f"/v1/edits/{edit_id}/cancel")
    before = blob_count(server)
    assert server.client.delete(f"/v1/meshes/{source}").status_code == 204
    assert blob_count(server) == before - 1
    problem(server.client.get(f"/v1/meshes/{source}"), 404)
    problem(server.client.delete(f"/v1/meshes/{source}"), 404)
