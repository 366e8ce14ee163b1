"""An edited PLY file: the uploaded bytes with the numbers of what moved replaced."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.errors import MeshFormatError
from engine.io._mesh_file import MeshFile
from engine.io._normals import StoredNormals, renewed_normals
from engine.io._ply_body import PlyBody
from engine.io._ply_header import PlyElement, PlyHeader, PlyProperty
from engine.io._ply_kernels import scatter_bytes
from engine.io._ply_reader import normal_properties, position_properties
from engine.io._polygons import NAMED_ELEMENTS
from engine.io._text_kernels import find_token_ends
from engine.io._text_numbers import (
    NORMAL_DIGITS,
    POSITION_DIGITS,
    NumberStyle,
    Replacement,
    as_bytes,
    matching_style,
    replace_numbers,
)
from engine.types import BoolArray, FloatArray, IntArray


def patch_ply(file: MeshFile, header: PlyHeader, vertices: FloatArray) -> bytes:
    """The file's bytes with ``vertices`` (n, 3) as positions and their normals renewed."""
    changed = vertices != file.mesh.vertices
    if not changed.any():
        return file.source
    body = PlyBody(file.source, header)
    element, at = _vertex_rows(body)
    position, normal = position_properties(header), normal_properties(header)
    places, _, _ = body.walk(element, at, element.count, (*position, *normal))
    columns = [element.properties[i] for i in (*position, *normal)]
    values, mask = vertices, changed
    if normal:
        normals, renewed = _normals(file, vertices, body, columns[3:], places[:, 3:])
        values, mask = np.hstack([vertices, normals]), np.hstack([changed, renewed])
    if body.ascii:
        return _patch_text(file.source, columns, places, values, mask)
    return _patch_binary(file.source, header, columns, places, values, mask)


def _vertex_rows(body: PlyBody) -> tuple[PlyElement, int]:
    at = body.header.body
    for element in body.header.elements:
        if element.name == "vertex":
            return element, at
        at = body.skip(element, at)
    raise MeshFormatError("the PLY file has no vertex element", code="no_vertices")


def _normals(
    file: MeshFile,
    vertices: FloatArray,
    body: PlyBody,
    columns: list[PlyProperty],
    places: IntArray,
) -> tuple[FloatArray, BoolArray]:
    """(n, 3) normals, and which of their numbers are new."""
    read = [body.read(places[:, k], column.scalar) for k, column in enumerate(columns)]
    normals = np.stack(read, axis=1)
    renewed = np.zeros(normals.shape, bool)
    records, values = renewed_normals(file, vertices, StoredNormals(normals, file.corners))
    normals[records] = values
    renewed[records] = True
    return normals, renewed


def _patch_text(
    data: bytes,
    columns: list[PlyProperty],
    places: IntArray,
    values: FloatArray,
    mask: BoolArray,
) -> bytes:
    ends = np.empty(places.size, np.int64)
    find_token_ends(as_bytes(data), places.reshape(-1), ends)
    ends = ends.reshape(places.shape)
    replacements: list[Replacement] = []
    for first, digits in ((0, POSITION_DIGITS), (3, NORMAL_DIGITS)):
        part = slice(first, first + 3)
        if not mask[:, part].any():
            continue
        starts, stops = places[:, part].reshape(-1), ends[:, part].reshape(-1)
        finite = values[np.isfinite(values[:, part]).all(axis=1), part]
        style = matching_style(data, starts, stops, finite, digits=digits)
        chosen = mask[:, part].reshape(-1)
        for k, column in enumerate(columns[part]):
            mine = chosen & (np.arange(len(chosen)) % 3 == k)
            numbers = values[:, part].reshape(-1)[mine]
            if column.scalar[0] in "iu":
                numbers = _stored(numbers, np.dtype(column.scalar), np.flatnonzero(mine) // 3)
            own = _declared_style(column.scalar, style, first == 0)
            replacements.append(
                Replacement(starts[mine], stops[mine], numbers.astype(np.float64), own)
            )
    return replace_numbers(data, replacements)


def _declared_style(scalar: str, style: NumberStyle, position: bool) -> NumberStyle:
    if scalar[0] in "iu":
        return NumberStyle("integer")
    return NumberStyle("shortest") if scalar == "f8" and position else style


def _patch_binary(
    data: bytes,
    header: PlyHeader,
    columns: list[PlyProperty],
    places: IntArray,
    values: FloatArray,
    mask: BoolArray,
) -> bytes:
    out = as_bytes(data).copy()
    for k, column in enumerate(columns):
        rows = np.flatnonzero(mask[:, k])
        stored = np.dtype(column.scalar).newbyteorder(">" if header.big_endian else "<")
        numbers = _stored(values[rows, k], stored, rows)
        scatter_bytes(out, places[rows, k], numbers.view(np.uint8).reshape(-1, stored.itemsize))
    return out.tobytes()


def _stored(values: FloatArray, scalar: np.dtype[Any], rows: IntArray) -> NDArray[Any]:
    """``values`` of vertices ``rows`` in the file's own type, refused if that cannot hold them."""
    if scalar.kind in "iu":
        values = np.round(values)
        limits = np.iinfo(scalar)
        bad = (values < limits.min) | (values > limits.max)
    else:
        bad = np.abs(values) > np.finfo(scalar).max
    if bad.any():
        raise MeshFormatError(
            f"{int(bad.sum())} numbers do not fit the file's own {scalar.name}; "
            "ask for another format",
            code="not_representable",
            elements={"vertices": rows[bad][:NAMED_ELEMENTS].tolist()},
        )
    return values.astype(scalar)
