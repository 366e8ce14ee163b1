"""The colours that the vertices of a file carry."""

from __future__ import annotations

import numpy as np

from engine.errors import MeshFormatError
from engine.io._mesh_file import MeshFile, ObjLayout
from engine.io._ply_body import PlyBody
from engine.io._ply_header import PlyHeader
from engine.io._ply_reader import colour_properties
from engine.io._text_kernels import find_further_tokens, read_numbers
from engine.io._text_numbers import as_bytes, resolve_numbers
from engine.types import FloatArray, IntArray

_MOST = 1e6  # far above 16 bits; what is greater is no colour


def vertex_colours(file: MeshFile) -> FloatArray | None:
    """Red, green and blue (n, 3) of the file's vertices, in the file's own unit.

    PLY: the scalar properties ``red``, ``green``, ``blue``; OBJ: ``v x y z r g b``. None unless
    every vertex has all three as numbers of the size that colours have.
    """
    try:
        colours = (
            _obj_colours(file.source, file.layout.vertex_lines)
            if isinstance(file.layout, ObjLayout)
            else _ply_colours(file.source, file.layout)
        )
    except MeshFormatError:
        return None
    sane = colours is not None and bool((np.abs(colours) <= _MOST).all())
    return colours if sane else None


def _ply_colours(data: bytes, header: PlyHeader) -> FloatArray | None:
    wanted = colour_properties(header)
    if not wanted:
        return None
    body, at = PlyBody(data, header), header.body
    for element in header.elements:
        if element.name == "vertex":
            return body.scalars(element, at, wanted)[0]
        at = body.skip(element, at)
    return None


def _obj_colours(data: bytes, lines: IntArray) -> FloatArray | None:
    if (_colour_tokens(data, lines[:1]) < 0).any():
        return None
    starts = _colour_tokens(data, lines)
    if (starts < 0).any():
        return None
    colours = np.empty(starts.size)
    read_numbers(as_bytes(data), starts.reshape(-1), colours)
    if np.isnan(colours).any():
        resolve_numbers(data, starts.reshape(-1), colours)
    return colours.reshape(-1, 3)


def _colour_tokens(data: bytes, lines: IntArray) -> IntArray:
    """Starts (k, 3) of the three numbers after the position, -1 where there is none."""
    starts = np.empty((len(lines), 3), np.int64)
    find_further_tokens(as_bytes(data), lines, 4, starts)
    return starts
