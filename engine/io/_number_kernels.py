"""Compiled looks at how numbers are written, and writing new ones in their place."""

from __future__ import annotations

import math

import numpy as np

from engine._jit import kernel
from engine.io._text_kernels import MINUS, NINE, PLUS, POINT, ZERO, Bytes, two_product
from engine.types import BoolArray, FloatArray, IntArray

NAN, INF = (ord("n"), ord("a"), ord("n")), (ord("i"), ord("n"), ord("f"))


@kernel
def measure_numbers(data: Bytes, starts: IntArray, ends: IntArray) -> tuple[int, int, int, int]:
    """Fewest and most decimals, most significant digits, and how many have an exponent."""
    fewest, most, longest, exponents = 1 << 30, 0, 0, 0
    for i in range(len(starts)):
        decimals, significant, point = 0, 0, False
        for at in range(starts[i], ends[i]):
            byte = data[at]
            if byte == POINT:
                point = True
            elif ZERO <= byte <= NINE:
                decimals += point
                significant += significant > 0 or byte != ZERO
            elif byte in (101, 69):
                exponents += 1
                break
        fewest, most = min(fewest, decimals), max(most, decimals)
        longest = max(longest, significant)
    return fewest, most, longest, exponents


@kernel
def nan_or_inf(data: Bytes, starts: IntArray, ends: IntArray) -> BoolArray:
    """Whether each token is nan or inf in letters of either case, signed or not."""
    found = np.zeros(len(starts), np.bool_)
    for i in range(len(starts)):
        at = starts[i]
        if at < ends[i] and data[at] in (PLUS, MINUS):
            at += 1
        if ends[i] - at == 3:
            word = (data[at] | 32, data[at + 1] | 32, data[at + 2] | 32)
            found[i] = word in (NAN, INF)
    return found


@kernel
def round_product(value: float, power: float) -> int:
    """value * power to the nearest integer, ties to the even one, by the exact product.

    Both are not negative, their product is below 2**52.
    """
    product, error = two_product(value, power)
    whole = int(product)
    above = (product - whole - 0.5) + error
    return whole + int(above > 0.0 or (above == 0.0 and whole % 2 == 1))


@kernel
def write_fixed(
    values: FloatArray, decimals: int, text: Bytes, starts: IntArray, ends: IntArray
) -> None:
    """Row i of ``text`` (k, width) takes values[i] as ``%.{decimals}f`` does, at its end.

    ``starts`` and ``ends`` become the pieces of the flat ``text``. A row must be wide enough, and
    |value| * 10**decimals below 2**52.
    """
    power = 10.0**decimals
    width = text.shape[1]
    for i in range(len(values)):
        left, at = round_product(abs(values[i]), power), width
        written = 0
        while left > 0 or written <= decimals:
            if written == decimals and decimals > 0:
                at -= 1
                text[i, at] = POINT
            at -= 1
            text[i, at] = ZERO + left % 10
            left //= 10
            written += 1
        if math.copysign(1.0, values[i]) < 0:
            at -= 1
            text[i, at] = MINUS
        starts[i], ends[i] = i * width + at, (i + 1) * width


@kernel
def trim_zeros(text: Bytes, starts: IntArray, ends: IntArray, keep: int) -> None:
    """Move ``ends`` back over trailing zeros, but leave ``keep`` decimals; drop a bare point."""
    for i in range(len(starts)):
        point = -1
        for at in range(starts[i], ends[i]):
            if text[at] == POINT:
                point = at
        if point >= 0:
            end = ends[i]
            while end > point + 1 + keep and text[end - 1] == ZERO:
                end -= 1
            ends[i] = point if end == point + 1 else end


@kernel
def copy_bytes(data: Bytes, start: int, stop: int, out: Bytes, write: int) -> int:
    """Copy data[start:stop] to ``out`` from ``write`` on; returns where it ended there."""
    if stop - start > 64:
        out[write : write + stop - start] = data[start:stop]
        return write + stop - start
    for at in range(start, stop):
        out[write] = data[at]
        write += 1
    return write


@kernel
def splice(
    data: Bytes,
    read: int,
    part: tuple[IntArray, IntArray, Bytes, IntArray, IntArray],
    out: Bytes,
    write: int,
) -> tuple[int, int]:
    """Copy ``data`` from ``read`` to ``out`` from ``write`` on, up to the last of some pieces.

    ``part`` is starts, ends, text, text starts, text ends: the pieces data[starts[i]:ends[i]], in
    order, become text[text_starts[i]:text_ends[i]]. Returns where reading and writing ended.
    """
    starts, ends, text, text_starts, text_ends = part
    for i in range(len(starts)):
        write = copy_bytes(data, read, starts[i], out, write)
        write = copy_bytes(text, text_starts[i], text_ends[i], out, write)
        read = ends[i]
    return read, write
