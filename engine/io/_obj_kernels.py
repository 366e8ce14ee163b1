"""Compiled scanning of OBJ statements: once to count, once to fill arrays of that size."""

from __future__ import annotations

from engine._jit import kernel
from engine.io._text_kernels import (
    BACKSLASH,
    HASH,
    LINE_FEED,
    SLASH,
    SPACE,
    Bytes,
    after_continuation,
    is_blank,
    is_newline,
    next_line,
    next_token,
    read_integer,
    read_number,
    statement_ended,
    token_end,
    token_ended,
)
from engine.types import FloatArray, IntArray

SKIP, VERTEX, NORMAL, FACE, OTHER = 0, 1, 2, 3, 4
KEYWORDS, PLACES = 32, 10
FINE, MISSING_COORDINATE, BAD_CORNER = 0, 1, 2


@kernel
def keyword_length(data: Bytes, at: int) -> int:
    """How many of the first three bytes from ``at`` belong to the keyword there (3: or more)."""
    for length in range(3):
        if at + length >= len(data):
            return length
        byte = data[at + length]
        if byte <= SPACE and (is_blank(byte) or is_newline(byte)):
            return length
        if byte == BACKSLASH and after_continuation(data, at + length) != at + length:
            return length
    return 3


@kernel
def note_keyword(data: Bytes, at: int, keywords: IntArray, places: IntArray) -> None:
    """Count the statement at ``at`` under its keyword.

    ``keywords`` (KEYWORDS, 2) holds codes, 0 where none is yet, and counts; ``places`` (KEYWORDS,
    PLACES) the first positions. What no longer finds room goes into the last row.
    """
    code = 0
    for k in range(7):
        if at + k >= len(data) or data[at + k] <= SPACE:
            break
        code = code * 256 + int(data[at + k])
    row = 0
    while row < len(keywords) - 1 and keywords[row, 0] != code and keywords[row, 1] > 0:
        row += 1
    keywords[row, 0] = code
    if keywords[row, 1] < places.shape[1]:
        places[row, keywords[row, 1]] = at
    keywords[row, 1] += 1


@kernel
def skip_empty_lines(data: Bytes, at: int) -> int:
    """The first position from ``at`` on that is no blank, end of line or continuation."""
    while at < len(data):
        byte = data[at]
        if byte > SPACE:
            after = after_continuation(data, at) if byte == BACKSLASH else at
            if after == at:
                break
            at = after
        elif is_blank(byte) or is_newline(byte):
            at += 1
        else:
            break
    return at


@kernel
def classify(data: Bytes, at: int) -> int:
    """What the statement at ``at`` (after blanks) is; OTHER for every less usual keyword."""
    if statement_ended(data, at):
        return SKIP
    first, kind = data[at], OTHER
    length = keyword_length(data, at)
    second = data[at + 1] if length >= 2 else 0
    if length == 1:
        if first == ord("v"):
            kind = VERTEX
        elif first == ord("f"):
            kind = FACE
        elif first in (ord("g"), ord("o"), ord("s")):
            kind = SKIP
    elif length == 2 and first == ord("v"):
        if second == ord("t"):
            kind = SKIP
        elif second == ord("n"):
            kind = NORMAL
    elif length == 2 and first == ord("f") and second == ord("o"):
        kind = FACE
    elif length == 3 and first == ord("u") and second == ord("s") and data[at + 2] == ord("e"):
        kind = SKIP
    return kind


@kernel
def count_statements(data: Bytes, begin: int, counts: IntArray) -> int:
    """``counts[kind]`` statements of each kind from ``begin`` on; returns the corners of faces.

    One loop over the bytes, four times as fast here as going from token to token; it must find
    the very corners that ``fill_statements`` finds.
    """
    corners, at, end = 0, begin, len(data)
    while at < end:
        at = skip_empty_lines(data, at)
        kind = classify(data, at)
        counts[kind] += 1
        comment, in_token = at < end and data[at] == HASH, True
        while at < end:
            byte = data[at]
            at += 1
            if byte > SPACE:
                after = at if comment or byte != BACKSLASH else after_continuation(data, at - 1) + 1
                if after > at:
                    at, in_token = after - 1, False
                elif not in_token:
                    in_token, comment = True, comment or byte == HASH
                    corners += kind == FACE and not comment
            elif is_newline(byte):
                break
            elif is_blank(byte):
                in_token = False
    return corners


@kernel
def resolve(index: int, count: int) -> int:
    """0-based index of a 1-based or, when negative, relative one; negative if there is none."""
    if index > 0:
        return index - 1
    return count + index if index < 0 else -1


@kernel
def read_corner(data: Bytes, at: int) -> tuple[int, int, int, bool]:
    """Vertex and normal of a corner v, v/vt, v//vn or v/vt/vn; its end; whether it is one."""
    vertex, after = read_integer(data, at)
    if after == at:
        return 0, 0, at, False
    normal, at = 0, after
    if at < len(data) and data[at] == SLASH:
        _, at = read_integer(data, at + 1)
        if at < len(data) and data[at] == SLASH:
            normal, at = read_integer(data, at + 1)
    return vertex, normal, at, token_ended(data, at)


@kernel
def fill_statements(
    data: Bytes,
    begin: int,
    vertices: FloatArray,
    vertex_lines: IntArray,
    normal_lines: IntArray,
    offsets: IntArray,
    corners: IntArray,
    corner_normals: IntArray,
    keywords: IntArray,
    places: IntArray,
) -> tuple[int, int]:
    """Fill arrays sized by ``count_statements``; returns a status and where it arose.

    ``corner_normals`` may be empty: then normals are not looked at. ``keywords`` and ``places``
    take what there is beside vertices, normals and faces: see ``note_keyword``.
    """
    vertex, normal, face, corner, at = 0, 0, 0, 0, begin
    while at < len(data):
        at = skip_empty_lines(data, at)
        kind, start = classify(data, at), at
        if kind == VERTEX:
            vertex_lines[vertex] = start
            at += 1
            for axis in range(3):
                at = next_token(data, at)
                if at < 0:
                    return MISSING_COORDINATE, start
                vertices[vertex, axis], at = read_number(data, at)
            vertex += 1
        elif kind == NORMAL:
            normal_lines[normal] = start
            normal += 1
        elif kind == FACE:
            token = next_token(data, token_end(data, at))
            while token >= 0:
                v, n, at, good = read_corner(data, token)
                if not good:
                    return BAD_CORNER, start
                corners[corner] = resolve(v, vertex)
                if len(corner_normals):
                    corner_normals[corner] = resolve(n, normal)
                corner += 1
                token = next_token(data, at)
            face += 1
            offsets[face] = corner
        elif kind == OTHER:
            note_keyword(data, start, keywords, places)
        if at < len(data) and data[at] == LINE_FEED:
            at += 1
        else:
            at = next_line(data, at, True)
    return FINE, at
