"""An edited OBJ file: the uploaded bytes with the numbers of what moved replaced."""

from __future__ import annotations

import numpy as np

from engine.io._mesh_file import MeshFile, ObjLayout
from engine.io._normals import StoredNormals, renewed_normals
from engine.io._obj_reader import vertex_tokens
from engine.io._text_kernels import read_numbers
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

_SAMPLED_LINES = 10_000


def patch_obj(file: MeshFile, layout: ObjLayout, vertices: FloatArray) -> bytes:
    """The file's bytes with ``vertices`` (n, 3) as positions and their normals renewed."""
    data, old = file.source, file.mesh.vertices
    rows = np.flatnonzero((vertices != old).any(axis=1))
    if not len(rows):
        return data
    style = _style(data, layout.vertex_lines, vertices, POSITION_DIGITS)
    changed = vertices[rows] != old[rows]
    replacements = [_replacement(data, layout.vertex_lines[rows], vertices[rows], changed, style)]
    if len(layout.corner_normals):
        stored = StoredNormals(_read_normals(data, layout.normal_lines), layout.corner_normals)
        records, normals = renewed_normals(file, vertices, stored)
        if len(records):
            style = _style(data, layout.normal_lines, normals, NORMAL_DIGITS)
            lines, every = layout.normal_lines[records], np.ones(normals.shape, bool)
            replacements.append(_replacement(data, lines, normals, every, style))
    return replace_numbers(data, replacements)


def _style(data: bytes, lines: IntArray, values: FloatArray, digits: int) -> NumberStyle:
    step = max(1, len(lines) // _SAMPLED_LINES)
    starts, ends = vertex_tokens(data, np.ascontiguousarray(lines[::step]))
    return matching_style(data, starts.reshape(-1), ends.reshape(-1), values, digits=digits)


def _replacement(
    data: bytes, lines: IntArray, values: FloatArray, changed: BoolArray, style: NumberStyle
) -> Replacement:
    starts, ends = vertex_tokens(data, lines)
    return Replacement(starts[changed], ends[changed], values[changed], style)


def _read_normals(data: bytes, lines: IntArray) -> FloatArray:
    """(k, 3) normals; NaN for what is not a plain number, so that it stays as it is."""
    starts, _ = vertex_tokens(data, lines)
    values = np.empty(starts.size)
    read_numbers(as_bytes(data), starts.reshape(-1), values)
    return values.reshape(-1, 3)
