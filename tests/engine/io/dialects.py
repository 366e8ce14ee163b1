"""Valid OBJ and PLY files in all their variety, with what a reader must find in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from engine.types import FloatArray

Polygons = list[list[int]]
Draw = st.DrawFn


@dataclass(frozen=True)
class Example:
    data: bytes
    vertices: FloatArray
    polygons: Polygons


_NUMBERS = st.one_of(
    st.floats(-1e6, 1e6), st.integers(-1000, 1000).map(float), st.floats(-1e-6, 1e-6)
)
_FORMATS = st.sampled_from(["{!r}", "{:.6f}", "{:.3f}", "{:.4e}", "{:+.9E}", "{:.17g}", "{:g}"])


@st.composite
def _polygons(draw: Draw, count: int) -> Polygons:
    corner = st.integers(0, count - 1)
    some = draw(st.lists(st.lists(corner, min_size=1, max_size=7), max_size=6))
    return [*some, draw(st.lists(corner, min_size=3, max_size=4))]


_ASIDE = st.sampled_from(
    [
        "# a comment: v 1 2 3",
        "g one two",
        "g",
        "o a name",
        "s 1",
        "s off",
        "usemtl skin",
        "mtllib my face.mtl",
        "vt 0.5 0.25",
        "vt 0.5",
        "vn 0 0 1",
        "vn 0.6 0 -0.8",
        "p 1",
        "l 1 2",
        "vp 0.1 0.2",
        "cstype bspline",
        "curv 0 1 1 2",
        "end",
        "call other.obj",
        "",
        "   ",
        "\t# indented",
    ]
)


@st.composite
def obj_files(draw: Draw) -> Example:
    newline = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    gap = draw(st.sampled_from([" ", "   ", "\t", f" \\{newline}  "]))
    shape = draw(_FORMATS)
    tail = draw(st.sampled_from(["", "1", "1.0", "0.5 0.25 1", "255 0 0"]))
    corner = draw(st.sampled_from(["{v}", "{v}/1", "{v}//1", "{v}/1/1", "{v}/-1/-1", "{v}/"]))
    count = draw(st.integers(3, 9))
    texts = [[shape.format(draw(_NUMBERS)) for _ in range(3)] for _ in range(count)]
    polygons = draw(_polygons(count))
    lines = ["vn 1 0 0"] if draw(st.booleans()) else []
    vertices_before = draw(st.integers(3, count))
    backwards = draw(st.booleans())

    def line_of(polygon: list[int], known: int) -> str:
        places = [v - known if backwards and v < known else v + 1 for v in polygon]
        comment = draw(st.sampled_from(["", " # face", "\t"]))
        keyword = draw(st.sampled_from(["f", "fo"]))
        return gap.join([keyword, *(corner.format(v=v) for v in places)]) + comment

    for text in texts[:vertices_before]:
        lines += [*draw(st.lists(_ASIDE, max_size=2)), gap.join(["v", *text, tail]).rstrip(gap)]
    first = draw(st.integers(0, len(polygons)))
    for polygon in polygons[:first]:
        lines += [line_of(polygon, vertices_before), *draw(st.lists(_ASIDE, max_size=1))]
    lines += [gap.join(["v", *text, tail]).rstrip(gap) for text in texts[vertices_before:]]
    for polygon in polygons[first:]:
        lines += [*draw(st.lists(_ASIDE, max_size=1)), line_of(polygon, count)]
    mark = draw(st.sampled_from(["", "\ufeff"]))
    text = mark + newline.join([*lines, draw(st.sampled_from(["", "# end", " "]))])
    return Example(text.encode(), np.array(texts, float), polygons)


_REAL = {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
_WHOLE = {
    **{"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2"},
    **{"ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4"},
}
_SCALARS = _REAL | _WHOLE
_COUNTERS = st.sampled_from(["uchar", "uint8", "char", "ushort", "short", "int", "uint32"])


@dataclass(frozen=True)
class _Column:
    """A property and its value in each row: numbers, or lists of them with a counter's type."""

    name: str
    kind: str
    rows: list[list[float]]
    counter: str | None = None

    @property
    def declaration(self) -> str:
        listed = "" if self.counter is None else f"list {self.counter} "
        return f"property {listed}{self.kind} {self.name}"


def _values(kind: str) -> st.SearchStrategy[float]:
    if kind in _REAL:
        return st.floats(-1e6, 1e6, width=32 if _REAL[kind] == "f4" else 64)
    limits = np.iinfo(_WHOLE[kind])
    return st.integers(max(int(limits.min), -(10**6)), min(int(limits.max), 10**6)).map(float)


@st.composite
def _column(draw: Draw, name: str, count: int) -> _Column:
    kind = draw(st.sampled_from(sorted(_SCALARS)))
    listed = draw(st.booleans())
    counter = draw(_COUNTERS) if listed else None
    size = st.integers(0, 3) if listed else st.just(1)
    return _Column(
        name,
        kind,
        [[draw(_values(kind)) for _ in range(draw(size))] for _ in range(count)],
        counter,
    )


@st.composite
def _columns(draw: Draw, prefix: str, count: int, most: int) -> list[_Column]:
    return [draw(_column(f"{prefix}{i}", count)) for i in range(draw(st.integers(0, most)))]


@st.composite
def ply_files(draw: Draw) -> Example:
    encoding = draw(st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian"]))
    newline = draw(st.sampled_from(["\n", "\r\n"] if encoding != "ascii" else ["\n", "\r\n", "\r"]))
    count = draw(st.integers(3, 9))
    places = [
        _Column(axis, kind, [[draw(_values(kind))] for _ in range(count)])
        for axis, kind in zip("xyz", draw(_kinds()), strict=True)
    ]
    normals = (
        [
            _Column(f"n{axis}", "float", [[draw(_values("float"))] for _ in range(count)])
            for axis in "xyz"
        ]
        if draw(st.booleans())
        else []
    )
    vertex = draw(st.permutations([*places, *normals, *draw(_columns("c", count, 2))]))
    polygons = draw(_polygons(count))
    listed = _Column(
        draw(st.sampled_from(["vertex_indices", "vertex_index"])),
        draw(st.sampled_from(sorted(_SCALARS))),
        [[float(v) for v in polygon] for polygon in polygons],
        draw(_COUNTERS),
    )
    face = draw(st.permutations([listed, *draw(_columns("d", len(polygons), 2))]))
    elements = [("vertex", count, vertex), ("face", len(polygons), face)]
    for name in ("camera", "edge"):
        if draw(st.booleans()):
            rows = draw(st.integers(0, 2))
            at = draw(st.integers(0, len(elements)))
            elements.insert(at, (name, rows, draw(_columns("e", rows, 2))))
    header = ["ply", f"format {encoding} 1.0"]
    for name, rows, columns in elements:
        header += draw(
            st.lists(st.sampled_from(["comment by tests", "obj_info x", "comment"]), max_size=1)
        )
        header += [f"element {name} {rows}", *(column.declaration for column in columns)]
    text = newline.join([*header, "end_header", ""]).encode()
    body = _text_body if encoding == "ascii" else _binary_body
    data = text + body(draw, elements, newline if encoding == "ascii" else encoding)
    vertices = np.array([[column.rows[i][0] for column in places] for i in range(count)])
    return Example(data, vertices, polygons)


def _kinds() -> st.SearchStrategy[list[str]]:
    kind = st.sampled_from(
        ["float", "float", "double", "float32", "float64", "int", "short", "uchar"]
    )
    return st.one_of(kind.map(lambda one: [one] * 3), st.lists(kind, min_size=3, max_size=3))


Elements = list[tuple[str, int, list[_Column]]]


def _text_body(draw: Draw, elements: Elements, newline: str) -> bytes:
    gap = draw(st.sampled_from([" ", "  ", "\t"]))
    lines: list[str] = []
    for _, rows, columns in elements:
        for i in range(rows if columns else 0):
            words: list[str] = []
            for column in columns:
                words += [] if column.counter is None else [str(len(column.rows[i]))]
                words += [_text(value, column.kind) for value in column.rows[i]]
            lines.append(gap.join(words) + draw(st.sampled_from(["", " "])))
    return newline.join([*lines, ""]).encode()


def _text(value: float, kind: str) -> str:
    return str(int(value)) if kind in _WHOLE else repr(value)


def _binary_body(draw: Draw, elements: Elements, encoding: str) -> bytes:
    order = ">" if encoding == "binary_big_endian" else "<"
    parts: list[bytes] = []
    for _, rows, columns in elements:
        for i in range(rows):
            for column in columns:
                if column.counter is not None:
                    size = np.array([len(column.rows[i])], order + _SCALARS[column.counter])
                    parts.append(size.tobytes())
                parts.append(np.array(column.rows[i], order + _SCALARS[column.kind]).tobytes())
    return b"".join(parts)


def files() -> st.SearchStrategy[Example]:
    return st.one_of(obj_files(), ply_files())
