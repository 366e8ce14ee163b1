"""Reading OBJ: vertices, polygons, and where the numbers are. Everything else stays as bytes."""

from __future__ import annotations

import re
from collections import defaultdict

import numpy as np

from engine.errors import MeshFormatError, UnsupportedFormatError
from engine.io import _obj_kernels as kernels
from engine.io._mesh_file import MeshFile, ObjLayout
from engine.io._polygons import build_mesh, check_memory, outgrow_single
from engine.io._text_kernels import find_token_ends, find_tokens
from engine.io._text_numbers import (
    FLOAT_DIGITS,
    as_bytes,
    format_error,
    line_number,
    resolve_numbers,
    sample_digits,
)
from engine.types import FloatArray, IntArray, MeshWarning

_OTHERS_KEPT = 10_000
_FREE_FORM = frozenset(
    b"vp cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con bzp bsp cdc cdp "
    b"res ctech stech".split()
)
_HARMLESS = frozenset(
    b"mtllib mg bevel c_interp d_interp lod shadow_obj trace_obj maplib usemap".split()
)
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
    others = np.empty(min(int(counts[kernels.OTHER]), _OTHERS_KEPT), np.int64)
    status, at = kernels.fill_statements(
        as_bytes(data),
        begin,
        vertices,
        vertex_lines,
        normal_lines,
        offsets,
        corners,
        corner_normals,
        others,
    )
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
        warnings=(*_statement_warnings(data, counts, others), *warnings),
        source=data,
        layout=ObjLayout(vertex_lines, normal_lines, corner_normals),
    )


def vertex_tokens(data: bytes, lines: IntArray) -> tuple[IntArray, IntArray]:
    """Starts and ends (k, 3) of the three numbers of the statements at ``lines``."""
    starts = np.empty((len(lines), 3), np.int64)
    find_tokens(as_bytes(data), lines, 1, starts)
    ends = np.empty(starts.size, np.int64)
    find_token_ends(as_bytes(data), starts.reshape(-1), ends)
    return starts, ends.reshape(-1, 3)


def _is_double(data: bytes, lines: IntArray) -> bool:
    step = max(1, len(lines) // 10_000)
    starts, ends = vertex_tokens(data, np.ascontiguousarray(lines[::step]))
    return sample_digits(data, starts.reshape(-1), ends.reshape(-1))[2] > FLOAT_DIGITS


def _resolve_vertices(data: bytes, vertices: FloatArray, lines: IntArray) -> None:
    rows = np.flatnonzero(np.isnan(vertices).any(axis=1))
    for chunk in np.array_split(rows, 1 + len(rows) // 100_000):
        starts, _ = vertex_tokens(data, lines[chunk])
        values = vertices[chunk].reshape(-1)
        resolve_numbers(data, starts.reshape(-1), values)
        vertices[chunk] = values.reshape(-1, 3)


def _keyword(data: bytes, at: int) -> bytes:
    return re.split(rb"\s", data[at : at + 40], maxsplit=1)[0]


def _check_text(data: bytes, vertex_count: int, others: IntArray) -> None:
    """Tell what is not OBJ at all from OBJ without vertices."""
    if vertex_count:
        return
    known = _FREE_FORM | _HARMLESS
    for at in others.tolist():
        if _keyword(data, at) not in known:
            raise UnsupportedFormatError(
                f"the file is neither PLY nor OBJ: line {line_number(data, at)} starts with "
                f"{_keyword(data, at)[:20].decode('ascii', 'replace')!r}",
                elements={"line": line_number(data, at), "byte": at},
            )
    raise MeshFormatError("the OBJ file has no vertices", code="no_vertices")


def _statement_warnings(data: bytes, counts: IntArray, others: IntArray) -> tuple[MeshWarning, ...]:
    """What the file holds beside polygons: kept in the bytes, but not edited."""
    warnings: list[MeshWarning] = []
    for kind, code in ((kernels.POINT, "point_elements"), (kernels.LINE, "line_elements")):
        if counts[kind]:
            message = f"{counts[kind]} {code.replace('_', ' ')} follow their vertices"
            warnings.append(MeshWarning(code, message, "lines", int(counts[kind])))
    found: dict[str, list[int]] = defaultdict(list)
    for at in others.tolist():
        keyword = _keyword(data, at)
        if keyword in _FREE_FORM:
            found["free_form_skipped"].append(at)
        elif keyword not in _HARMLESS:
            found["unknown_statements"].append(at)
    for code, places in found.items():
        message = f"{len(places)} statements are left as they are, not edited"
        first = tuple(line_number(data, at) for at in places[:10])
        warnings.append(MeshWarning(code, message, "lines", len(places), first))
    return tuple(warnings)
