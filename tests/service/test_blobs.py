"""Blobs: the same behaviour in a folder and in a bucket."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import boto3
import pytest
from moto.server import ThreadedMotoServer

from service.domain import NotFound
from service.stores.blobs import Blobs, BlobUrlError

MIB = 1024**2
DATA = hashlib.shake_256(b"seed").digest(20 * MIB + 7)


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    server = ThreadedMotoServer("127.0.0.1", 0)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@pytest.fixture(params=["folder", "file", "s3"])
def blobs(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Blobs:
    folder = tmp_path / "a b%20, ü"
    if request.param != "s3":
        return Blobs(str(folder) if request.param == "folder" else folder.as_uri())
    endpoint = request.getfixturevalue("bucket")
    monkeypatch.setenv("AWS_ENDPOINT", endpoint)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    monkeypatch.setenv("AWS_REGION", "us-east-1")
    name = f"bucket-{abs(hash(request.node.name))}"
    boto3.client("s3", endpoint_url=endpoint).create_bucket(Bucket=name)
    return Blobs(f"s3://{name}/some/prefix")


def test_what_is_put_is_got(blobs: Blobs, tmp_path: Path) -> None:
    key = blobs.new_key("meshes")
    stored = blobs.put_stream(key, (DATA[i : i + MIB] for i in range(0, len(DATA), MIB)))
    assert (stored.bytes, stored.sha256) == (len(DATA), hashlib.sha256(DATA).hexdigest())
    assert blobs.size(key) == len(DATA)
    assert b"".join(blobs.iterate(key)) == DATA
    assert blobs.get_range(key, 5 * MIB - 3, 5 * MIB + 9) == DATA[5 * MIB - 3 : 5 * MIB + 9]
    assert b"".join(blobs.iterate(key, len(DATA) - 5)) == DATA[-5:]
    assert blobs.local_path(key, tmp_path).read_bytes() == DATA


def test_files_and_nothing_at_all_can_be_put(blobs: Blobs, tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.write_bytes(DATA[:1000])
    key, empty = blobs.new_key("results"), blobs.new_key("results")
    assert blobs.put_file(key, source).bytes == 1000
    assert blobs.get_range(key, 0, 1000) == DATA[:1000]
    assert blobs.put_stream(empty, []).bytes == 0
    assert list(blobs.iterate(empty)) == []


def test_an_upload_that_breaks_off_leaves_nothing(blobs: Blobs) -> None:
    def breaking() -> Iterator[bytes]:
        yield DATA[: 9 * MIB]
        raise ConnectionError("the client went away")

    key = blobs.new_key("meshes")
    with pytest.raises(ConnectionError):
        blobs.put_stream(key, breaking())
    assert list(blobs.keys_older_than("meshes", -60)) == []


def test_what_is_not_there_is_said_so(blobs: Blobs, tmp_path: Path) -> None:
    for ask in (
        blobs.size,
        lambda key: list(blobs.iterate(key, 0, 5)),
        lambda key: blobs.local_path(key, tmp_path),
    ):
        with pytest.raises(NotFound):
            ask("meshes/none")
    blobs.delete("meshes/none")


def test_old_keys_are_listed_and_deleted(blobs: Blobs) -> None:
    keys = {blobs.new_key("results") for _ in range(3)}
    for key in keys:
        blobs.put_stream(key, [b"x"])
    assert set(blobs.keys_older_than("results", -60)) == keys
    assert set(blobs.keys_older_than("results", 3600)) == set()
    blobs.delete(*keys)
    assert list(blobs.keys_older_than("results", -60)) == []


def test_other_stores_are_refused() -> None:
    with pytest.raises(BlobUrlError):
        Blobs("ftp://host/folder")
