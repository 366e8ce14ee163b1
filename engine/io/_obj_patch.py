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
    differ = vertices != old
    rows = np.flatnonzero(differ[:, 0] | differ[:, 1] | differ[:, 2])
    if not len(rows):
        return data
    style = _style(data, layout.vertex_lines, vertices, POSITION_DIGITS)
    tokens = vertex_tokens(data, layout.vertex_lines[rows])
    replacements = [_replacement(tokens, vertices[rows], differ[rows], style)]
    if len(layout.corner_normals):
        replacements += _renewed(file, layout, vertices)
    return replace_numbers(data, replacements)


def _renewed(file: MeshFile, layout: ObjLayout, vertices: FloatArray) -> list[Replacement]:
    """The normals that change with the positions."""
    data = file.source
    starts, ends = vertex_tokens(data, layout.normal_lines)
    stored = np.empty(starts.shape)  # NaN for what is no plain number: it stays as it is
    read_numbers(as_bytes(data), starts.reshape(-1), stored.reshape(-1))
    records, normals = renewed_normals(file, vertices, StoredNormals(stored, layout.corner_normals))
    if not len(records):
        return []
    style = _style(data, layout.normal_lines, normals, NORMAL_DIGITS)
    every = np.ones(normals.shape, bool)
    return [_replacement((starts[records], ends[records]), normals, every, style)]


def _style(data: bytes, lines: IntArray, values: FloatArray, digits: int) -> NumberStyle:
    step = max(1, len(lines) // _SAMPLED_LINES)
    starts, ends = vertex_tokens(data, np.ascontiguousarray(lines[::step]))
    return matching_style(data, starts.reshape(-1), ends.reshape(-1), values, digits=digits)


def _replacement(
    tokens: tuple[IntArray, IntArray], values: FloatArray, changed: BoolArray, style: NumberStyle
) -> Replacement:
    starts, ends = tokens
    return Replacement(starts[changed], ends[changed], values[changed], style)
