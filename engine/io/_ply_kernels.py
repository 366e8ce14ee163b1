"""Compiled walks over PLY rows: where each row's properties are, and the lists in them.

``counters`` and ``sizes`` describe the properties of a row in order: the size in bytes of a
list's length (0 for a scalar) and of one item. ``columns[p]`` is the column of ``places`` that
takes the position of property p, or -1.
"""

from __future__ import annotations

from engine._jit import kernel
from engine.io._text_kernels import (
    Bytes,
    is_newline,
    next_line,
    read_integer,
    skip_blanks,
    token_end,
)
from engine.types import IntArray

TOO_LARGE = 10**17


@kernel
def read_binary_integer(data: Bytes, at: int, size: int, signed: bool, big: bool) -> int:
    """The integer of ``size`` bytes at ``at``."""
    value = 0
    for k in range(size):
        value = value * 256 + int(data[at + (k if big else size - 1 - k)])
    if signed and value >= 1 << (8 * size - 1):
        value -= 1 << (8 * size)
    return value


@kernel
def walk_binary(
    data: Bytes,
    at: int,
    counters: IntArray,
    signs: IntArray,
    sizes: IntArray,
    big: bool,
    columns: IntArray,
    places: IntArray,
) -> tuple[int, int]:
    """Fill ``places`` (rows, wanted); returns where the walk ended and the row it failed in.

    -1 as the row says that all is well. A row fails that goes beyond the data or holds a list
    of negative length.
    """
    end = len(data)
    for row in range(len(places)):
        for p in range(len(counters)):
            if columns[p] >= 0:
                places[row, columns[p]] = at
            count = 1
            if counters[p] > 0:
                if at + counters[p] > end:
                    return at, row
                count = read_binary_integer(data, at, counters[p], signs[p] != 0, big)
                at += counters[p]
            if count < 0 or at + count * sizes[p] > end:
                return at, row
            at += count * sizes[p]
    return at, -1


@kernel
def walk_ascii(
    data: Bytes, at: int, counters: IntArray, columns: IntArray, places: IntArray
) -> tuple[int, int, int, int]:
    """Fill ``places`` as ``walk_binary`` does, one row per line that is not blank.

    Returns the end, the failing row or -1, the number of rows with more on their line than
    declared, and the first of them.
    """
    end, longer, first_longer = len(data), 0, -1
    for row in range(len(places)):
        at = skip_blanks(data, at)
        while len(counters) and at < end and is_newline(data[at]):
            at = skip_blanks(data, at + 1)
        for p in range(len(counters)):
            if columns[p] >= 0:
                places[row, columns[p]] = at
            count = 1
            if counters[p] > 0:
                count, after = read_integer(data, at)
                if after == at or token_end(data, after) != after or count < 0:
                    return at, row, longer, first_longer
                at = skip_blanks(data, after)
            while count > 0:
                if at >= end or is_newline(data[at]):
                    return at, row, longer, first_longer
                at = skip_blanks(data, token_end(data, at))
                count -= 1
        if at < end and not is_newline(data[at]):
            longer += 1
            if first_longer < 0:
                first_longer = row
        at = next_line(data, at, False)
    return at, -1, longer, first_longer


@kernel
def binary_list_ends(
    data: Bytes, places: IntArray, counter: int, signed: bool, big: bool, ends: IntArray
) -> None:
    """``ends[i + 1]`` becomes ``ends[0]`` plus the lengths of the first i + 1 lists."""
    for i in range(len(places)):
        ends[i + 1] = ends[i] + read_binary_integer(data, places[i], counter, signed, big)


@kernel
def binary_list_items(
    data: Bytes,
    places: IntArray,
    counter: int,
    size: int,
    signed: bool,
    big: bool,
    ends: IntArray,
    items: IntArray,
) -> None:
    """``items[ends[i]:ends[i + 1]]`` becomes the integers of the list at ``places[i]``."""
    for i in range(len(places)):
        at = places[i] + counter
        for k in range(ends[i], ends[i + 1]):
            items[k] = read_binary_integer(data, at, size, signed, big)
            at += size


@kernel
def ascii_list_ends(data: Bytes, places: IntArray, ends: IntArray) -> None:
    """As ``binary_list_ends``."""
    for i in range(len(places)):
        ends[i + 1] = ends[i] + read_integer(data, places[i])[0]


@kernel
def ascii_list_items(data: Bytes, places: IntArray, ends: IntArray, items: IntArray) -> int:
    """As ``binary_list_items``; returns where the first token is that is no integer, or -1."""
    for i in range(len(places)):
        at = token_end(data, places[i])
        for k in range(ends[i], ends[i + 1]):
            at = skip_blanks(data, at)
            items[k], after = read_integer(data, at)
            if after == at or token_end(data, after) != after:
                return at
            at = after
    return -1


@kernel
def list_item_places(
    data: Bytes,
    places: IntArray,
    text: bool,
    counter: int,
    size: int,
    ends: IntArray,
    starts: IntArray,
) -> None:
    """``starts[ends[i]:ends[i + 1]]`` becomes where the items of the list at ``places[i]`` are."""
    for i in range(len(places)):
        at = token_end(data, places[i]) if text else places[i] + counter
        for k in range(ends[i], ends[i + 1]):
            at = skip_blanks(data, at) if text else at
            starts[k] = at
            at = token_end(data, at) if text else at + size


@kernel
def count_lines(data: Bytes, at: int) -> int:
    """How many lines from ``at`` on hold anything."""
    count = 0
    while at < len(data):
        at = skip_blanks(data, at)
        count += at < len(data) and not is_newline(data[at])
        at = next_line(data, at, False)
    return count


@kernel
def gather_bytes(data: Bytes, places: IntArray, out: Bytes) -> None:
    """``out[i]`` becomes the ``out.shape[1]`` bytes at ``places[i]``."""
    for i in range(len(places)):
        for k in range(out.shape[1]):
            out[i, k] = data[places[i] + k]


@kernel
def scatter_bytes(data: Bytes, places: IntArray, values: Bytes) -> None:
    """The bytes at ``places[i]`` become ``values[i]``."""
    for i in range(len(places)):
        for k in range(values.shape[1]):
            data[places[i] + k] = values[i, k]
