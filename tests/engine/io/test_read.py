"""Reading: what is in the file, whatever its dialect."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.errors import MeshFormatError, UnsupportedFormatError
from engine.io import read_mesh, vertex_colours
from engine.io._text_kernels import read_numbers
from engine.io._text_numbers import resolve_numbers
from tests.engine.io import variants
from tests.faces import HEAD_NEUTRAL, ICT_NEUTRAL

SQUARE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def test_the_bundled_faces_have_the_counts_of_their_headers() -> None:
    face, head = read_mesh(ICT_NEUTRAL), read_mesh(HEAD_NEUTRAL)
    assert (face.format, len(face.mesh.vertices), len(face.mesh.faces)) == ("ply", 9409, 18460)
    assert (head.format, len(head.mesh.vertices), head.polygon_count) == ("obj", 4848, 4776)
    assert len(head.mesh.faces) == 2 * 4776
    assert not face.warnings


def test_content_decides_not_the_name(tmp_path: Path) -> None:
    path = tmp_path / "face.obj"
    path.write_bytes(ICT_NEUTRAL.read_bytes())
    assert read_mesh(path).format == "ply"


def test_polygons_are_fanned_from_their_first_corner() -> None:
    file = read_mesh(SQUARE + b"v 2 2 0\nf 1 2 3\nf 1 2\nf 1 2 3 4 5\n")
    assert file.mesh.faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert file.polygon_of.tolist() == [0, 2, 2, 2]
    assert file.first_face.tolist() == [0, -1, 1]
    assert [w.code for w in file.warnings] == ["degenerate_polygons"]


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_ply_with_foreign_properties_and_elements(order: str) -> None:
    file, plain = read_mesh(variants.custom_ply(order)), variants.face()
    assert np.array_equal(file.mesh.vertices, plain.mesh.vertices)
    assert np.array_equal(file.mesh.faces, plain.mesh.faces)
    assert file.double


@pytest.mark.parametrize("newline", [b"\n", b"\r\n", b"\r"])
def test_text_ply_with_foreign_properties_and_elements(newline: bytes) -> None:
    file, head = read_mesh(variants.ascii_ply().replace(b"\n", newline)), variants.head()
    assert np.array_equal(file.mesh.vertices, head.mesh.vertices)
    assert np.array_equal(file.corners, head.corners)
    assert np.array_equal(file.offsets, head.offsets)


def test_obj_in_an_awkward_dialect() -> None:
    file, head = read_mesh(variants.awkward_obj()), variants.head()
    assert np.allclose(file.mesh.vertices, head.mesh.vertices, rtol=1e-5)
    assert np.array_equal(file.corners, head.corners)
    assert np.array_equal(file.offsets, head.offsets)
    codes = {w.code for w in file.warnings}
    assert codes == {"point_elements", "line_elements", "free_form_skipped"}


def test_vertices_in_a_list_bearing_element_and_of_every_type() -> None:
    for name, code in (("char", "i1"), ("uint16", "u2"), ("int", "i4"), ("float64", "f8")):
        points = np.array([[0, 0, 0], [3, 0, 0], [0, 5, 0]], f">{code}")
        rows = b"".join(bytes([k]) + b"\x07" * k + p.tobytes() for k, p in enumerate(points))
        header = "ply\r\nformat binary_big_endian 1.0\r\nelement vertex 3\r\n"
        header += "property list uchar uchar tags\r\n"
        header += "".join(f"property {name} {axis}\r\n" for axis in "xyz")
        header += "element face 1\r\nproperty list uint ushort vertex_index\r\nend_header\r\n"
        data = header.encode() + rows + b"\0\0\0\3" + np.array([0, 1, 2], ">u2").tobytes()
        assert np.array_equal(read_mesh(data).mesh.vertices, points.astype(float))


def test_triangle_strips_become_triangles_that_alternate_and_start_anew() -> None:
    header = b"ply\nformat ascii 1.0\nelement vertex 5\n%sproperty float x\nproperty float y\n"
    header += b"property float z\nelement face 1\nproperty list uchar int vertex_index\n"
    header += b"element tristrips 2\nproperty list int int vertex_indices\nend_header\n"
    rows = b"0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n3 0 1 2\n9 0 1 2 3 -1 2 3 4 4\n2 0 1\n"
    file = read_mesh(header % b"" + rows)
    expected = [[0, 1, 2], [0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 4]]
    assert file.mesh.faces.tolist() == expected
    assert file.polygon_count == 5
    strips_only = (header % b"").replace(b"element face 1", b"element face 0") + rows
    again = read_mesh(strips_only.replace(b"\n3 0 1 2\n", b"\n"))
    assert again.mesh.faces.tolist() == expected[1:]
    with pytest.raises(MeshFormatError, match="face 3"):
        read_mesh((header % b"" + rows).replace(b"2 3 -1", b"2 3 -2"))


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_vertex_numbers_of_a_type_with_fractions_are_taken_if_whole(encoding: str) -> None:
    header = f"ply\nformat {encoding} 1.0\nelement vertex 4\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += "element face 2\nproperty list ushort float vertex_indices\nend_header\n"
    order = ">" if encoding == "binary_big_endian" else "<"

    def data(*last: float) -> bytes:
        if encoding == "ascii":
            text = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2.0 3e0\n3 " + " ".join(map(str, last))
            return (header + text + "\n").encode()
        points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], f"{order}f8").tobytes()
        lists = [np.arange(4), np.array(last)]
        packed = [
            np.array([len(x)], f"{order}u2").tobytes() + x.astype(f"{order}f4").tobytes()
            for x in lists
        ]
        return header.encode() + points + b"".join(packed)

    file = read_mesh(data(2.0, 3.0, 0.0))
    assert variants.polygons(file) == [[0, 1, 2, 3], [2, 3, 0]]
    for wrong in (0.5, float("nan"), float("inf"), 1e30):
        with pytest.raises(MeshFormatError, match=r"face 1 "):
            read_mesh(data(2.0, 3.0, wrong))


def test_what_lies_beyond_the_counts_of_the_header_is_pointed_at() -> None:
    text = variants.ascii_ply() + b"\n 1 2 3\n4\n"
    (warning,) = read_mesh(text).warnings
    line = variants.ascii_ply().count(b"\n") + 1
    assert (warning.code, warning.count, warning.first) == ("trailing_lines", 2, (line,))
    binary = variants.custom_ply("<")
    (warning,) = read_mesh(binary + b"more").warnings
    assert (warning.code, warning.count, warning.first) == ("trailing_bytes", 4, (len(binary),))


def test_statements_beside_faces_are_counted_in_full_with_their_first_lines() -> None:
    lines = ["l 1 2", "curv 0 1 2", "p 1", "deg 3", "mtllib a b.mtl", "hello there", "l 3 4"]
    text = SQUARE + b"f 1 2 3\n" + "\n".join(lines * 5000).encode()
    found = {w.code: w for w in read_mesh(text).warnings if w.elements == "lines"}
    assert {code: w.count for code, w in found.items()} == {
        "line_elements": 10_000,
        "free_form_skipped": 10_000,
        "point_elements": 5_000,
        "unknown_statements": 5_000,
    }
    assert found["free_form_skipped"].first[:4] == (7, 9, 14, 16)
    assert found["line_elements"].first[:3] == (6, 12, 13)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.floats(-1e60, 1e60) | st.floats(-1e-300, 1e-300), min_size=9, max_size=9),
    st.integers(0, 40),
)
def test_every_double_is_read_as_python_reads_it(numbers: list[float], digits: int) -> None:
    every = (repr, "{:.3g}".format, "{:+.20E}".format, f"{{:.{digits}e}}".format, "{:.6f}".format)
    for write in every:
        texts = [write(number) for number in numbers]
        rows = [" ".join(texts[k : k + 3]) for k in (0, 3, 6)]
        data = "".join(f"v {row}\n" for row in rows) + "f 1 2 3\n"
        expected = np.array([float(text) for text in texts]).reshape(3, 3)
        assert np.array_equal(read_mesh(data.encode()).mesh.vertices, expected)


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 10**30), st.integers(-360, 320), st.booleans())
def test_every_decimal_is_rounded_as_python_rounds_it(
    mantissa: int, exponent: int, halfway: bool
) -> None:
    """Beyond the largest and below the smallest double too, and between two doubles."""
    if halfway:
        mantissa = 2 * (mantissa % 2**53) + 1 << mantissa % 10
    text = f"{mantissa}e{exponent}".encode()
    values = np.empty(1)
    read_numbers(np.frombuffer(text, np.uint8), np.zeros(1, np.int64), values)
    resolve_numbers(text, np.zeros(1, np.int64), values)
    assert values[0] == float(text)


PIECES = ("v 0 0 0", "v 1 2 3 1", "f 1 2 3", "f 1 2 3 1", "g a", "vn 0 0 1", "s", "curv 1", "f")
SEPARATORS = ("\n", "\r\n", " \\\n", "\\\r\n ", " # c\n", "# c\n", " # c \\\n", "#", " ", "\t\\")


def _reference_statements(text: str) -> list[list[str]]:
    """Statements of an OBJ text as lists of words, by the letter of the format."""
    statements, words = [], list[str]()
    for line in text.replace("\r\n", "\n").split("\n"):
        comment = re.search(r"(^|\s)#", line)
        words += (line[: comment.start()] if comment else line.removesuffix("\\")).split()
        if comment or not line.endswith("\\"):
            statements.append(words)
            words = []
    return [*statements, words]


@settings(max_examples=500, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(PIECES), st.sampled_from(SEPARATORS)), max_size=12))
def test_lines_continue_and_comments_end_as_the_format_says(parts: list[tuple[str, str]]) -> None:
    text = SQUARE.decode() + "".join(map("".join, parts)) + "\n\nf 1 2 4\n"
    statements = [words for words in _reference_statements(text) if words]
    try:
        file = read_mesh(text.encode())
    except MeshFormatError as refusal:
        assert refusal.code in ("bad_face", "missing_coordinate", "not_a_number")
        return
    faces = [[int(k) - 1 for k in words[1:]] for words in statements if words[0] == "f"]
    assert variants.polygons(file) == faces
    assert len(file.mesh.vertices) == sum(words[0] == "v" for words in statements)


def _ply(vertices: bytes, count: int, faces: bytes = b"\3\0\1\2", face_count: int = 1) -> bytes:
    return (
        (
            b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\n"
            b"property float y\nproperty float z\nelement face %d\n"
            b"property list uchar uchar vertex_indices\nend_header\n" % (count, face_count)
        )
        + vertices
        + faces
    )


TRIANGLE = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0], "<f4").tobytes()


@pytest.mark.parametrize(
    ("data", "code", "words"),
    [
        (b"", "empty", "empty"),
        (b"# nothing\n", "no_vertices", "no vertices"),
        (SQUARE, "no_faces", "4 points and no faces"),
        (_ply(TRIANGLE, 3, b"", 0), "no_faces", "3 points and no faces"),
        (_ply(b"", 0), "no_vertices", "no vertices"),
        (_ply(TRIANGLE, 3)[:-2], "truncated", "ends at byte"),
        (_ply(TRIANGLE, 2**31), "truncated", "cut off"),
        (_ply(TRIANGLE, 3, b"\3\0\1\3"), "index_out_of_range", "face 0"),
        (_ply(b"\xff" * 12 + TRIANGLE[12:], 3), "not_finite", "vertex 0"),
        (SQUARE + b"v inf 0 0\nf 1 2 5\n", "not_finite", "vertex 4"),
        (SQUARE + b"v 1e200 0 0\nf 1 2 5\n", "too_large", "vertex 4"),
        *(
            (SQUARE + b"v 0 " + word + b" 0\nf 1 2 5\n", "not_finite", "vertex 4")
            for word in (b"1e999", b"-Infinity", b"nan(0x7)", b"1.#QNAN", b"+NaN")
        ),
        *(
            (SQUARE + b"v 0 " + word + b" 0\nf 1 2 5\n", "not_a_number", "line 5")
            for word in (b"1e", b"-", b".", b"nan(", b"infinit", b"1.2.3", b"0x10", b"1_0", b"2,5")
        ),
        (SQUARE + b"f 1 2 3\nf 1 2 9\n", "index_out_of_range", "face 1"),
        (SQUARE + b"f 1 2 0\n", "index_out_of_range", "face 0"),
        (SQUARE + b"f -1 -2 -5\n", "index_out_of_range", "face 0"),
        (SQUARE + b"f 1 2 99999999999999999999999\n", "index_out_of_range", "face 0"),
        (SQUARE + b"f 1 2 x\n", "bad_face", "line 5"),
        (SQUARE + b"v 1 2\nf 1 2 3\n", "missing_coordinate", "line 5"),
        (SQUARE + b"v 1 2 0x3\nf 1 2 3\n", "not_a_number", "line 5"),
        (SQUARE + b"v 1 2 1_0\nf 1 2 3\n", "not_a_number", "line 5"),
        (SQUARE + b"v 1 2 " + b"9" * 10**6 + b"\nf 1 2 3\n", "number_too_long", "line 5"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\n", "bad_header", "end_header"),
        (
            b"ply\nformat ascii 1.0\nelement vertex " + b"9" * 5000 + b"\nend_header\n",
            "bad_header",
            "line 3",
        ),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n",
            "bad_header",
            "line 4",
        ),
        (b"ply\nformat morse 1.0\nend_header\n", "bad_header", "line 2"),
        (variants.ascii_ply()[:150_000], "truncated", "ends at byte"),
        (variants.ascii_ply().replace(b"\n9 4 ", b"\n9 4.5 ", 1), "bad_row", "incomplete"),
    ],
)
def test_damaged_files_are_refused_with_the_place(data: bytes, code: str, words: str) -> None:
    with pytest.raises(MeshFormatError, match=words) as refusal:
        read_mesh(data)
    assert refusal.value.code == code


@pytest.mark.parametrize(
    ("data", "found"),
    [
        ("v 0 0 0\n".encode("utf-16"), "UTF-16"),
        ("v 0 0 0\n".encode("utf-16-le"), "UTF-16"),
        ("ply\nformat".encode("utf-16-be"), "UTF-16"),
        (b"\x1f\x8b\x08\x00", "gzip"),
        (b"glTF\x02\x00\x00\x00", "GLB"),
        (b"solid face\nfacet normal 0 0 1\n", "STL"),
        (b"<html></html>", "HTML"),
        (b"Dear reader,\nthis is no mesh.\n", "Dear"),
        (bytes(range(128, 256)) * 10, "neither PLY nor OBJ"),
    ],
)
def test_other_formats_are_refused_by_name(data: bytes, found: str) -> None:
    with pytest.raises(UnsupportedFormatError, match=found):
        read_mesh(data)


def test_files_that_unpack_out_of_proportion_are_refused() -> None:
    with pytest.raises(MeshFormatError) as refusal:
        read_mesh(SQUARE + b"f" + b" 1" * 8_000_000)
    assert refusal.value.code == "out_of_proportion"


def test_a_backslash_continues_a_line_only_at_its_end():
    file = read_mesh(b"v\\ 9 9 9\nv 0 0 0\nv 1 0\\\n0\nv 0 1 0\nf 1 2 3\n")
    assert file.mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    (warning,) = file.warnings
    assert (warning.code, warning.count) == ("unknown_statements", 1)


def test_colours_of_vertices_come_in_the_files_unit() -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty uchar blue\nproperty float x\n"
    header += "property float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    found = vertex_colours(
        read_mesh(f"{header}3 0 0 0 1 2\n6 1 0 0 4 5\n9 0 1 0 7 8\n3 0 1 2\n".encode())
    )
    assert found is not None
    assert found.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


def test_colours_of_obj_vertices_follow_their_positions() -> None:
    long = "0.50196081399917602539062"
    text = f"v 0 0 0 1 .5 0\nv 1 0 0 \\\n {long} 0 1 # c\nv 0 1 0 0 1e-1 1 1\nf 1 2 3\n"
    found = vertex_colours(read_mesh(text.encode()))
    assert found is not None
    assert np.allclose(found, [[1, 0.5, 0], [float(long), 0, 1], [0, 0.1, 1]], atol=0, rtol=1e-15)


@pytest.mark.parametrize("rest", ["", " 1", " 1 0 # 0", " 1 0 x", " 1 0 nan", " 1 0 1e300"])
def test_a_vertex_without_a_colour_leaves_the_file_without(rest: str) -> None:
    text = f"v 0 0 0 1 1 0\nv 1 0 0 0 0 1\nv 0 1 0{rest}\nf 1 2 3\n"
    assert vertex_colours(read_mesh(text.encode())) is None


def test_the_bundled_faces_have_no_colours() -> None:
    assert vertex_colours(read_mesh(ICT_NEUTRAL)) is None
    assert vertex_colours(read_mesh(HEAD_NEUTRAL)) is None
