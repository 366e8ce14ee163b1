"""Writing: the uploaded bytes with the numbers of what moved, and nothing else, replaced."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.errors import EngineError, MeshFormatError
from engine.io import MeshFile, read_mesh, write_mesh
from engine.io._text_numbers import NumberStyle
from tests.engine.io import variants
from tests.faces import DATA, HEAD_NEUTRAL, ICT_NEUTRAL

BUNDLED = sorted(p for p in DATA.rglob("*") if p.suffix in (".ply", ".obj"))
VARIANTS: dict[str, Callable[[], bytes]] = {
    "little": lambda: variants.custom_ply("<"),
    "big": lambda: variants.custom_ply(">"),
    "normals": lambda: variants.custom_ply(">", scalar="f4", normals=True),
    "text": variants.ascii_ply,
    "awkward": variants.awkward_obj,
    "vn": variants.obj_with_normals,
    "uv": HEAD_NEUTRAL.read_bytes,
}
BINARY = ("little", "big", "normals")


def nudged(file: MeshFile, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """The file's vertices with a tenth of them moved by a hundredth of the extent."""
    rng = np.random.default_rng(seed)
    vertices = file.mesh.vertices.copy()
    some = rng.random(len(vertices)) < 0.1
    extent = np.linalg.norm(np.ptp(vertices, axis=0))
    vertices[some] += rng.normal(size=(some.sum(), 3)) * extent / 100
    return vertices, some


@pytest.mark.parametrize("path", BUNDLED, ids=lambda path: path.name)
def test_an_unedited_bundled_file_comes_back_byte_for_byte(path: Path) -> None:
    file = read_mesh(path)
    assert write_mesh(file) == path.read_bytes()
    assert write_mesh(file, file.mesh.vertices.copy()) == path.read_bytes()


@pytest.mark.parametrize("name", VARIANTS)
def test_an_unedited_file_comes_back_byte_for_byte(name: str) -> None:
    data = VARIANTS[name]()
    file = read_mesh(data)
    assert write_mesh(file, file.mesh.vertices.copy()) == data


@pytest.mark.parametrize("name", VARIANTS)
def test_an_edit_reads_back_and_leaves_the_rest_alone(name: str) -> None:
    file = read_mesh(VARIANTS[name]())
    vertices, some = nudged(file)
    again = read_mesh(write_mesh(file, vertices))
    extent = np.linalg.norm(np.ptp(vertices, axis=0))
    assert np.abs(again.mesh.vertices - vertices).max() < 1e-7 * extent
    assert np.array_equal(again.mesh.vertices[~some], file.mesh.vertices[~some])
    assert np.array_equal(again.corners, file.corners)
    assert np.array_equal(again.offsets, file.offsets)
    assert again.warnings == file.warnings


@pytest.mark.parametrize("name", ["text", "awkward", "uv"])
def test_text_changes_in_the_numbers_of_moved_vertices_only(name: str) -> None:
    data = VARIANTS[name]()
    file = read_mesh(data)
    vertices, some = nudged(file)
    old, new = data.split(b"\n"), write_mesh(file, vertices).split(b"\n")
    assert len(old) == len(new)
    changed = [k for k in range(len(old)) if old[k] != new[k]]
    assert len(changed) == some.sum()
    for k in changed:
        gaps = [re.split(rb"[-+.\deE]+", line) for line in (old[k], new[k])]
        assert gaps[0] == gaps[1]


@pytest.mark.parametrize("name", ["little", "big"])
def test_binary_changes_in_the_numbers_of_moved_vertices_only(name: str) -> None:
    data = VARIANTS[name]()
    file = read_mesh(data)
    vertices, some = nudged(file)
    old, new = (np.frombuffer(d, np.uint8) for d in (data, write_mesh(file, vertices)))
    start = data.index(b"end_header") + 11 + 12
    size = 1 + 4 + 3 * 8 + 2
    body = slice(start, start + size * len(vertices))
    assert np.array_equal(np.delete(old, body), np.delete(new, body))
    differs = (old[body] != new[body]).reshape(-1, size)
    assert np.array_equal(differs.any(axis=1), some)
    assert not differs[:, :5].any()
    assert not differs[:, -2:].any()
    assert np.array_equal(read_mesh(new.tobytes()).mesh.vertices, vertices)


def test_text_keeps_the_number_format_of_the_file() -> None:
    exponents = read_mesh(variants.awkward_obj())
    moved = exponents.mesh.vertices + 0.001
    line = write_mesh(exponents, moved).split(b"\r\n")[3]
    assert re.fullmatch(
        rb"v\t-?\d\.\d{9}e[+-]\d\d   -?\d\.\d{9}e\+\d\d -?\d\.\d{9}e\+\d\d 1.0", line
    )
    fixed = write_mesh(variants.head(), variants.head().mesh.vertices + 0.25).split(b"\n")[1]
    assert fixed == b"v -2.982 68.549 13.016"
    zeros = b"v 0.000 0.000 0.000\nv 1.000 0.000 0.000\nv 0.000 1.000 0.000\nf 1 2 3\n"
    shifted = write_mesh(
        read_mesh(zeros), read_mesh(zeros).mesh.vertices + np.array([0.5, 0, 1 / 3])
    )
    assert shifted.startswith(b"v 0.500 0.000 0.33333333\nv 1.500 0.000")


@pytest.mark.parametrize("offset", [0.0, 5.4e6])
@pytest.mark.parametrize("size", [1e-5, 1.0, 1e5])
def test_text_is_as_fine_as_the_mesh_is_small_wherever_it_lies(offset: float, size: float) -> None:
    data = f"v {offset} 0 0\nv {offset + size} 0 0\nv {offset} {size} 0\nf 1 2 3\n".encode()
    file = read_mesh(data)
    vertices = file.mesh.vertices + np.array([1, -2, 3]) * size / 7
    again = read_mesh(write_mesh(file, vertices)).mesh.vertices
    ulp = np.spacing(offset + size)
    assert np.abs(again - vertices).max() <= 1e-8 * size + ulp


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.floats(-1e5, 1e5) | st.integers(-99, 99).map(lambda k: k / 16), min_size=1),
    st.integers(0, 9),
)
def test_fixed_decimals_are_those_that_python_writes(numbers: list[float], decimals: int) -> None:
    text, starts, ends = NumberStyle("fixed", decimals, decimals).write(np.array(numbers))
    pieces = [text[a:b].tobytes().decode() for a, b in zip(starts, ends, strict=True)]
    assert pieces == [f"{number:.{decimals}f}" for number in numbers]


def test_text_with_more_digits_than_a_float_keeps_every_double() -> None:
    rng = np.random.default_rng(5)
    rows = "".join("v " + " ".join(map(repr, r)) + "\n" for r in rng.normal(size=(50, 3)).tolist())
    file = read_mesh(f"{rows}f 1 2 3\n".encode())
    vertices = file.mesh.vertices * np.pi
    assert np.array_equal(read_mesh(write_mesh(file, vertices)).mesh.vertices, vertices)


def _vn(data: bytes) -> np.ndarray:
    lines = [line.split()[1:] for line in data.split(b"\n") if line.startswith(b"vn ")]
    return np.array(lines, float)


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    sums = np.zeros(vertices.shape)
    for k in range(3):
        np.add.at(sums, faces[:, k], np.cross(b - a, c - a))
    return sums / np.linalg.norm(sums, axis=1, keepdims=True)


def test_obj_normals_follow_a_rotation_of_the_mesh() -> None:
    data = variants.obj_with_normals()
    file = read_mesh(data)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = _vn(write_mesh(file, file.mesh.vertices @ turn.T))
    assert np.abs(turned - _vn(data) @ turn.T).max() < 1e-4


def test_only_normals_next_to_moved_vertices_are_renewed() -> None:
    data = variants.obj_with_normals()
    file = read_mesh(data)
    vertices = file.mesh.vertices.copy()
    vertices[100] += 0.05
    around = np.unique(file.mesh.faces[(file.mesh.faces == 100).any(axis=1)])
    old, new = data.split(b"\n"), write_mesh(file, vertices).split(b"\n")
    changed = np.flatnonzero([a != b for a, b in zip(old, new, strict=True)])
    assert set(changed) <= {100, *(around + len(vertices)).tolist()}
    assert np.abs(_vn(b"\n".join(new)) - _normals(vertices, file.mesh.faces))[around].max() < 1e-4


def test_ply_normals_are_renewed_in_place() -> None:
    file = read_mesh(variants.custom_ply("<", scalar="f4", normals=True))
    vertices = file.mesh.vertices * [1.0, 2.0, 1.0]
    data = write_mesh(file, vertices)
    size = 1 + 4 + 12 + 2 + 12
    start = data.index(b"end_header") + 11 + 12
    rows = np.frombuffer(data[start : start + size * len(vertices)], np.uint8).reshape(-1, size)
    normals = np.ascontiguousarray(rows[:, -12:]).view("<f4")
    expected = _normals(vertices, file.mesh.faces)
    away = _normals(file.mesh.vertices, file.mesh.faces)[:, 2] < 0  # the file says 0 0 1 for all
    assert np.abs(np.where(away[:, None], -1, 1) * expected - normals).max() < 1e-5


def test_flat_shading_and_seams_survive_and_ambiguous_normals_stay() -> None:
    roof = (
        b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 0\nv -1 0 0\nvn 0 0 1\nvn 0 0 1\n"
        b"f 1//1 2//1 3//1 4//1\n"
    )
    file = read_mesh(roof + b"f 5//2 4//2 6//2\n")
    lifted = file.mesh.vertices.copy()
    lifted[5, 2] = 1.0
    flat = _vn(write_mesh(file, lifted))
    assert np.allclose(flat[0], [0, 0, 1])
    assert np.allclose(flat[1], np.array([1, 0, 1]) / np.sqrt(2), atol=1e-4)
    shared = read_mesh(roof + b"f 5//1 4//1 6//1\n")
    lifted[5, 2] = 3.0
    assert np.allclose(_vn(write_mesh(shared, lifted)), [0, 0, 1])


@pytest.mark.parametrize("name", VARIANTS)
@pytest.mark.parametrize("format", ["obj", "ply"])
def test_clean_exports_hold_the_same_polygons(name: str, format: Literal["obj", "ply"]) -> None:
    file = read_mesh(VARIANTS[name]())
    vertices, _ = nudged(file)
    again = read_mesh(write_mesh(file, vertices, format=format))
    assert again.format == format
    assert np.array_equal(again.corners, file.corners)
    assert np.array_equal(again.offsets, file.offsets)
    largest = np.abs(vertices).max()
    assert np.abs(again.mesh.vertices - vertices).max() <= (0 if file.double else 1e-7 * largest)


def test_degenerate_polygons_do_not_reach_a_clean_obj() -> None:
    file = read_mesh(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\nf 1 2 3\nf 3\n")
    assert write_mesh(file, format="obj").endswith(b"v 0 1 0\nf 1 2 3\n")
    assert np.array_equal(read_mesh(write_mesh(file, format="ply")).offsets, file.offsets)


def test_integer_positions_are_rounded_and_refused_beyond_their_range() -> None:
    header = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty short x\nproperty short y\n"
    header += b"property short z\nelement face 1\nproperty list uchar int vertex_indices\n"
    file = read_mesh(header + b"end_header\n0 0 0\n9 0 0\n0 9 0\n3 0 1 2\n")
    moved = file.mesh.vertices + np.array([0.7, 0, 0])
    assert write_mesh(file, moved).endswith(b"\n1 0 0\n10 0 0\n1 9 0\n3 0 1 2\n")
    with pytest.raises(MeshFormatError) as refusal:
        write_mesh(file, moved * 1e5)
    assert refusal.value.code == "not_representable"


def test_positions_must_fit_the_file() -> None:
    with pytest.raises(EngineError, match="positions must be"):
        write_mesh(read_mesh(ICT_NEUTRAL), np.zeros((5, 3)))
