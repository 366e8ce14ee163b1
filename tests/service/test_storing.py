"""Result files on their way into the blob store."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.domain import NotFound
from service.jobtypes import ResultFile
from service.stores.blobs import Blobs
from service.storing import Storing


def result(folder: Path, name: str, content: bytes) -> ResultFile:
    path = folder / name
    path.write_bytes(content)
    return ResultFile(name, "mesh", "model/ply", path, {"frame": 1})


def kept(blobs: Blobs) -> list[str]:
    return sorted(blobs.keys_older_than("results", -3600.0))


def test_files_are_stored_before_they_are_asked_for(tmp_path: Path) -> None:
    blobs = Blobs(str(tmp_path / "blobs"))
    early, late = result(tmp_path, "early", b"early"), result(tmp_path, "late", b"late")
    with Storing(blobs) as storing:
        storing.put(early.path)
        storing.put(early.path)
        first, second = storing.stored("edit", [early, late])
        storing.published = True
    assert (first.name, first.bytes, first.meta) == ("early", 5, {"frame": 1})
    assert b"".join(blobs.iterate(first.blob_key)) == b"early"
    assert b"".join(blobs.iterate(second.blob_key)) == b"late"
    assert kept(blobs) == sorted([first.blob_key, second.blob_key])


def test_nothing_is_left_of_what_is_not_published(tmp_path: Path) -> None:
    blobs = Blobs(str(tmp_path / "blobs"))
    files = [result(tmp_path, f"{number}", b"x" * number) for number in range(20)]
    with Storing(blobs) as storing:
        for file in files[:10]:
            storing.put(file.path)
        records = storing.stored("edit", files)
    assert kept(blobs) == []
    with pytest.raises(NotFound):
        blobs.size(records[0].blob_key)


def test_a_file_that_was_forgotten_is_stored_as_it_is_now(tmp_path: Path) -> None:
    blobs = Blobs(str(tmp_path / "blobs"))
    file = result(tmp_path, "file", b"of a process that was lost")
    with Storing(blobs) as storing:
        storing.put(file.path)
        storing.forget()
        file.path.write_bytes(b"anew")
        (record,) = storing.stored("edit", [file])
        storing.published = True
    assert b"".join(blobs.iterate(record.blob_key)) == b"anew"
    assert kept(blobs) == [record.blob_key]


def test_a_file_that_is_missing_is_an_error_and_leaves_nothing(tmp_path: Path) -> None:
    blobs = Blobs(str(tmp_path / "blobs"))
    there = result(tmp_path, "there", b"there")
    missing = ResultFile("missing", "mesh", "model/ply", tmp_path / "missing", {})
    with pytest.raises(FileNotFoundError), Storing(blobs) as storing:
        storing.stored("edit", [there, missing])
    assert kept(blobs) == []
