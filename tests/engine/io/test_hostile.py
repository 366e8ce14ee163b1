"""Whatever the bytes: a mesh or an EngineError, in memory and time in proportion to the file."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.errors import EngineError
from engine.io import read_mesh
from tests.engine.io import variants
from tests.engine.io.contract import check

OBJ = (
    b"\xef\xbb\xbf# c\nv 0 0 0\nv 1 0 0 1\r\nv 1\t1 0 1 0 0\nvt 0 0\nvn 0 0 1\ng a b\n"
    b"v 0 1.5e-1 -0.25\nf 1/1/1 2//1 -1 \\\n 3/1\nl 1 2\np 1\nusemtl x\ncurv 0 1 2\nf 1 2 3\n"
)
TEXT_PLY = (
    b"ply\nformat ascii 1.0\ncomment c\nelement cam 1\nproperty list uchar float q\n"
    b"element vertex 4\nproperty uchar red\nproperty float x\nproperty float y\n"
    b"property double z\nproperty float nx\nproperty float ny\nproperty float nz\n"
    b"element face 2\nproperty list uchar int vertex_indices\nend_header\n2 0.5 1\n"
    b"1 0 0 0 0 0 1\n2 1 0 0 0 0 1\n3 1 1 0 0 0 1\n4 0 1 0.5 0 0 1\n4 0 1 2 3\n3 0 1 2\n"
)
BINARY_PLY = (
    TEXT_PLY[: TEXT_PLY.index(b"2 0.5")].replace(b"ascii", b"binary_big_endian")
    + b"\1\0\0\0\0"
    + b"".join(
        bytes([1])
        + np.array(p[:2], ">f4").tobytes()
        + np.array(p[2:], ">f8").tobytes()
        + np.array([0, 0, 1], ">f4").tobytes()
        for p in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0.5))
    )
    + b"\4"
    + np.arange(4, dtype=">i4").tobytes()
    + b"\3"
    + np.arange(3, dtype=">i4").tobytes()
)
SEEDS = (OBJ, TEXT_PLY, BINARY_PLY)


def test_the_seeds_are_valid() -> None:
    for seed in SEEDS:
        assert read_mesh(seed).polygon_count == 2


@settings(max_examples=300, deadline=None)
@given(st.sampled_from([b"", b"ply\n", b"ply\nformat ascii 1.0\n", b"v 0 0 0\n"]), st.binary())
def test_arbitrary_bytes(start: bytes, rest: bytes) -> None:
    check(start + rest)


@pytest.mark.parametrize("seed", SEEDS, ids=["obj", "text ply", "binary ply"])
def test_every_truncation(seed: bytes) -> None:
    for stop in range(len(seed)):
        check(seed[:stop])


SIZE = 1 << 20
VERTICES = b"v 0 0 0\n" * 3
HEADER = b"ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
HEADER += b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"


@pytest.mark.timeout(60)  # a megabyte; steps in the square of its lines would not end by then
@pytest.mark.parametrize(
    "data",
    [
        VERTICES + b"f 1 2 3\n" * (SIZE // 8),
        VERTICES + b"f" + b" 1" * (SIZE // 2),
        VERTICES + b"f\n" * (SIZE // 2),
        b"v 1 2 3\n" * (SIZE // 8) + b"f 1 2 3\n",
        b"v 1e99 nan 3\n" * (SIZE // 13),
        b"v 0.12345678901234567890123 2 3\n" * (SIZE // 32) + b"f 1 2 3\n",
        b"\\\n" * (SIZE // 2),
        b"#" * SIZE,
        b"junk\n" * (SIZE // 5),
        VERTICES + b"vp 1\n" * (SIZE // 5),
        HEADER % (SIZE // 6) + b"0 0 0\n" * (SIZE // 6) + b"3 0 1 2\n",
        HEADER % 10**9 + b"0 0 0\n" * (SIZE // 6),
        b"ply\n" + b"comment x\n" * (SIZE // 10),
        b"ply\nformat ascii 1.0\n" + b"element a 1\n" * 80_000 + b"end_header\n",
        b"ply\nformat ascii 1.0\nelement a 1\n"
        + b"".join(b"property int %d\n" % k for k in range(40_000))
        + b"end_header\n",
    ],
    ids=lambda data: str(data[:12]),
)
def test_memory_and_time_are_in_proportion(data: bytes) -> None:
    read_mesh_or_refuse(data[: len(data) // 64])
    tracemalloc.start()
    read_mesh_or_refuse(data)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20 * len(data)


def read_mesh_or_refuse(data: bytes) -> None:
    try:
        read_mesh(data)
    except EngineError as error:
        assert error.code


def test_a_list_that_claims_more_than_the_file_holds_is_refused_before_it_is_unpacked() -> None:
    data = variants.custom_ply("<")
    at = data.index(b"end_header") + 11
    with pytest.raises(EngineError) as refusal:
        read_mesh(data[:at] + b"\xff\xff" + data[at + 2 :])
    assert refusal.value.code in ("truncated", "bad_row")
