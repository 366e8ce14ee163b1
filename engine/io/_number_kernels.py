"""Compiled looks at how numbers are written, and writing new ones in their place."""

from __future__ import annotations

import math

import numpy as np

from engine._jit import kernel
from engine.io._text_kernels import (
    LONGEST_NUMBER,
    MINUS,
    NINE,
    PLUS,
    POINT,
    ZERO,
    Bytes,
    token_end,
    two_product,
)
from engine.types import FloatArray, IntArray

KNOWN, DECIMAL, NOT_FINITE, TOO_LONG, NO_NUMBER = 0, 1, 2, 3, 4
CLOSE = 41
NAN, NAN_OF, INF, INFINITY, MICROSOFTS = (
    np.frombuffer(word, np.uint8) for word in (b"nan", b"nan(", b"inf", b"infinity", b"1.#")
)


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
def judge_tokens(
    data: Bytes, starts: IntArray, values: FloatArray, ends: IntArray, kinds: Bytes
) -> None:
    """What the tokens are whose ``values`` are NaN, and where they end; all others are KNOWN."""
    for i in range(len(starts)):
        kinds[i] = KNOWN
        if np.isnan(values[i]):
            ends[i] = token_end(data, starts[i])
            kinds[i] = token_kind(data, starts[i], ends[i])


@kernel
def token_kind(data: Bytes, start: int, end: int) -> int:
    """DECIMAL, NOT_FINITE, or what is wrong with it."""
    if end - start > LONGEST_NUMBER:
        return TOO_LONG
    if start < end and (data[start] == PLUS or data[start] == MINUS):
        start += 1
    if is_not_finite(data, start, end):
        return NOT_FINITE
    return DECIMAL if is_decimal(data, start, end) else NO_NUMBER


@kernel
def is_decimal(data: Bytes, at: int, end: int) -> bool:
    """Whether digits with at most one point, and maybe an exponent, run from ``at`` to ``end``."""
    start, digits = at, 0
    while at < end and (ZERO <= data[at] <= NINE or (data[at] == POINT and at - start == digits)):
        digits += data[at] != POINT
        at += 1
    if digits and at < end and data[at] in (101, 69):
        at += 1
        if at < end and (data[at] == PLUS or data[at] == MINUS):
            at += 1
        digits = 0
        while at < end and ZERO <= data[at] <= NINE:
            digits += 1
            at += 1
    return digits > 0 and at == end


@kernel
def is_not_finite(data: Bytes, start: int, end: int) -> bool:
    """Whether the token is nan, inf, infinity, nan(…) or 1.#…, of either case."""
    return (
        is_word(data, start, end, NAN)
        or is_word(data, start, end, INF)
        or is_word(data, start, end, INFINITY)
        or is_word(data, start, min(end, start + len(MICROSOFTS)), MICROSOFTS)
        or (is_word(data, start, min(end, start + len(NAN_OF)), NAN_OF) and data[end - 1] == CLOSE)
    )


@kernel
def is_word(data: Bytes, start: int, end: int, word: Bytes) -> bool:
    """Whether the bytes from ``start`` to ``end`` are ``word``, in letters of either case."""
    if end - start != len(word):
        return False
    for k in range(len(word)):
        if data[start + k] != word[k] and data[start + k] | 32 != word[k]:
            return False
    return True


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
