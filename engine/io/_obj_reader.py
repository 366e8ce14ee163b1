"""Reading OBJ: vertices, polygons, and where the numbers are. Everything else stays as bytes."""

from __future__ import annotations

import re
from collections import Counter, defaultdict

import numpy as np

from engine.errors import MeshFormatError, UnsupportedFormatError
from engine.io import _obj_kernels as kernels
from engine.io._mesh_file import MeshFile, ObjLayout
from engine.io._polygons import build_mesh, check_memory, outgrow_single
from engine.io._text_kernels import find_tokens
from engine.io._text_numbers import (
    FLOAT_DIGITS,
    as_bytes,
    format_error,
    line_numbers,
    resolve_numbers,
    sample_digits,
)
from engine.types import FloatArray, IntArray, MeshWarning

_FREE_FORM = frozenset(
    b"vp cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con bzp bsp cdc cdp "
    b"res ctech stech".split()
)
_HARMLESS = frozenset(
    b"mtllib mg bevel c_interp d_interp lod shadow_obj trace_obj maplib usemap".split()
)
_FREE_FORM_SKIPPED, _UNKNOWN = "free_form_skipped", "unknown_statements"
_ELEMENTS = {b"p": "point_elements", b"l": "line_elements"}
_SAID = {
    "point_elements": "point elements follow their vertices",
    "line_elements": "line elements follow their vertices",
    _FREE_FORM_SKIPPED: "statements about curves and surfaces are left as they are, not edited",
    _UNKNOWN: "statements that OBJ does not know are left as they are",
}
_ERRORS = {
    kernels.MISSING_COORDINATE: ("a vertex needs three coordinates", "missing_coordinate"),
    kernels.BAD_CORNER: ("a face corner must be v, v/vt, v//vn or v/vt/vn", "bad_face"),
}


def read_obj(data: bytes, begin: int) -> MeshFile:
    """The OBJ file whose first statement is at byte ``begin``."""
    counts = np.zeros(kernels.OTHER + 1, np.int64)
    corner_count = kernels.count_statements(as_bytes(data), begin, counts)
    vertex_count, normal_count = int(counts[kernels.VERTEX]), int(counts[kernels.NORMAL])
    face_count = int(counts[kernels.FACE])
    corner_normals = np.empty(corner_count if normal_count else 0, np.int64)
    check_memory(
        len(data),
        vertices=4 * vertex_count,
        normals=normal_count,
        corners=corner_count + len(corner_normals),
        offsets=2 * face_count,
    )
    vertices = np.empty((vertex_count, 3))
    vertex_lines, normal_lines = np.empty(vertex_count, np.int64), np.empty(normal_count, np.int64)
    corners, offsets = np.empty(corner_count, np.int64), np.zeros(face_count + 1, np.int64)
    keywords = np.zeros((kernels.KEYWORDS, 2), np.int64)
    places = np.empty((kernels.KEYWORDS, kernels.PLACES), np.int64)
    status, at = kernels.fill_statements(
        as_bytes(data),
        begin,
        vertices,
        vertex_lines,
        normal_lines,
        offsets,
        corners,
        corner_normals,
        keywords,
        places,
    )
    others = _other_statements(data, keywords, places)
    _check_text(data, vertex_count, others)
    if status != kernels.FINE:
        raise format_error(data, at, *_ERRORS[status])
    _resolve_vertices(data, vertices, vertex_lines)
    mesh, warnings = build_mesh(vertices, corners, offsets, len(data))
    corner_normals[corner_normals >= normal_count] = -1
    return MeshFile(
        mesh=mesh,
        corners=corners,
        offsets=offsets,
        format="obj",
        double=_is_double(data, vertex_lines) or outgrow_single(vertices),
        warnings=(*_statement_warnings(data, others), *warnings),
        source=data,
        layout=ObjLayout(vertex_lines, normal_lines, corner_normals),
    )


def vertex_tokens(data: bytes, lines: IntArray) -> tuple[IntArray, IntArray]:
    """Starts and ends (k, 3) of the three numbers of the statements at ``lines``."""
    starts, ends = np.empty((len(lines), 3), np.int64), np.empty((len(lines), 3), np.int64)
    find_tokens(as_bytes(data), lines, 1, starts, ends)
    return starts, ends


def _is_double(data: bytes, lines: IntArray) -> bool:
    step = max(1, len(lines) // 10_000)
    starts, ends = vertex_tokens(data, np.ascontiguousarray(lines[::step]))
    return sample_digits(data, starts.reshape(-1), ends.reshape(-1))[2] > FLOAT_DIGITS


def _resolve_vertices(data: bytes, vertices: FloatArray, lines: IntArray) -> None:
    rows = np.flatnonzero(np.logical_or.reduce([np.isnan(column) for column in vertices.T]))
    for chunk in np.array_split(rows, 1 + len(rows) // 10_000):
        starts, _ = vertex_tokens(data, lines[chunk])
        values = vertices[chunk].reshape(-1)
        resolve_numbers(data, starts.reshape(-1), values)
        vertices[chunk] = values.reshape(-1, 3)


Statements = dict[bytes, tuple[int, list[int]]]
"""How many statements start with each keyword, and the bytes where the first ten are."""


def _other_statements(data: bytes, keywords: IntArray, places: IntArray) -> Statements:
    found: Statements = {}
    for (_, count), at in zip(keywords.tolist(), places.tolist(), strict=True):
        if count:
            word = re.split(rb"\s", data[at[0] : at[0] + 40], maxsplit=1)[0]
            found[word] = (count, at[:count])
    return found


def _check_text(data: bytes, vertex_count: int, others: Statements) -> None:
    """Tell what is not OBJ at all from OBJ without vertices."""
    if vertex_count:
        return
    foreign = {word: at[0] for word, (_, at) in others.items() if _kind_of(word) == _UNKNOWN}
    if not foreign:
        raise MeshFormatError("the OBJ file has no vertices", code="no_vertices")
    word, at = min(foreign.items(), key=lambda item: item[1])
    line = line_numbers(data, [at])[0]
    raise UnsupportedFormatError(
        f"the file is neither PLY nor OBJ: line {line} starts with "
        f"{word[:20].decode('ascii', 'replace')!r}",
        elements={"line": line, "byte": at},
    )


def _kind_of(keyword: bytes) -> str | None:
    """The code of the warning about statements with this keyword; None if none is due."""
    if keyword in _HARMLESS:
        return None
    if keyword in _ELEMENTS:
        return _ELEMENTS[keyword]
    return _FREE_FORM_SKIPPED if keyword in _FREE_FORM else _UNKNOWN


def _statement_warnings(data: bytes, others: Statements) -> tuple[MeshWarning, ...]:
    """What the file holds beside polygons: kept in the bytes, but not edited."""
    counts: Counter[str] = Counter()
    places: dict[str, list[int]] = defaultdict(list)
    for word, (count, at) in others.items():
        code = _kind_of(word)
        if code is not None:
            counts[code] += count
            places[code] += at
    warnings: list[MeshWarning] = []
    for code in sorted(counts):
        first = tuple(line_numbers(data, sorted(places[code])[: kernels.PLACES]))
        message = f"{counts[code]} {_SAID[code]}"
        warnings.append(MeshWarning(code, message, "lines", counts[code], first))
    return tuple(warnings)
