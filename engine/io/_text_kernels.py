"""Compiled scanning of text: white space, tokens, decimal numbers.

Every function takes ``data``, the file's bytes, and positions in it. A back-slash at the end of a
line continues the line, as OBJ has it.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from engine._jit import kernel
from engine.types import FloatArray, IntArray

Bytes = NDArray[np.uint8]

TAB, LINE_FEED, VERTICAL_TAB, FORM_FEED, CARRIAGE_RETURN, SPACE = 9, 10, 11, 12, 13, 32
HASH, PLUS, MINUS, POINT, SLASH, ZERO, NINE, BACKSLASH = 35, 43, 45, 46, 47, 48, 57, 92

LARGEST_POWER = 345  # of ten: 19 digits times more are infinite, times less are zero
SCALED_POWER = 280  # from here on the tables hold powers that are nearer to 1 by 2**SCALE
SCALE = 600
MOST_DIGITS = 19  # that fit 64 bits
LONGEST_NUMBER = 512
_POWERS = [
    Fraction(10) ** exponent
    * Fraction(2) ** (SCALE * ((exponent < -SCALED_POWER) - (exponent > SCALED_POWER)))
    for exponent in range(-LARGEST_POWER, LARGEST_POWER + 1)
]
POWER_HIGH = np.array([float(power) for power in _POWERS])
POWER_LOW = np.array([float(p - Fraction(float(p))) for p in _POWERS])


@kernel
def is_newline(byte: int) -> bool:
    """Whether ``byte`` ends a line."""
    return (byte == LINE_FEED) | (byte == CARRIAGE_RETURN)


@kernel
def is_blank(byte: int) -> bool:
    """Whether ``byte`` separates tokens on a line: space, tab, vertical tab, form feed."""
    return (byte == SPACE) | (byte == TAB) | (byte == VERTICAL_TAB) | (byte == FORM_FEED)


@kernel
def after_continuation(data: Bytes, at: int) -> int:
    """Where the line goes on if it is continued at ``at``, else ``at``."""
    end = len(data)
    if data[at] != BACKSLASH or at + 1 >= end or not is_newline(data[at + 1]):
        return at
    if data[at + 1] == CARRIAGE_RETURN and at + 2 < end and data[at + 2] == LINE_FEED:
        return at + 3
    return at + 2


@kernel
def skip_blanks(data: Bytes, at: int) -> int:
    """The first position from ``at`` on that is neither blank nor a continuation."""
    while at < len(data):
        byte = data[at]
        if byte > SPACE:
            after = after_continuation(data, at) if byte == BACKSLASH else at
            if after == at:
                break
            at = after
        elif is_blank(byte):
            at += 1
        else:
            break
    return at


@kernel
def token_end(data: Bytes, at: int) -> int:
    """The end of the token that starts at ``at``."""
    while at < len(data):
        byte = data[at]
        if byte > SPACE:
            if byte == BACKSLASH and after_continuation(data, at) != at:
                break
        elif is_blank(byte) or is_newline(byte):
            break
        at += 1
    return at


@kernel
def statement_ended(data: Bytes, at: int) -> bool:
    """Whether a line has no token left at ``at``: its end, or a comment."""
    return at >= len(data) or is_newline(data[at]) or data[at] == HASH


@kernel
def token_ended(data: Bytes, at: int) -> bool:
    """Whether no token goes on at ``at``."""
    if at < len(data) and (data[at] == SPACE or data[at] == LINE_FEED):
        return True
    return token_end(data, at) == at


@kernel
def next_token(data: Bytes, at: int) -> int:
    """The start of the next token of the statement, -1 if there is none."""
    if at + 1 < len(data) and data[at] == SPACE:
        byte = data[at + 1]
        if byte > HASH and byte != BACKSLASH:
            return at + 1
    at = skip_blanks(data, at)
    return -1 if statement_ended(data, at) else at


@kernel
def next_line(data: Bytes, at: int, continued: bool) -> int:
    """The start of the line after the one ``at`` is on.

    ``continued`` obeys back-slashes, up to a token that starts with # and makes the rest of the
    line a comment. ``at`` is the start of a token, or the end of one.
    """
    comment, in_token = not continued, at < len(data) and data[at] != HASH
    while at < len(data):
        byte = data[at]
        at += 1
        if byte > SPACE:
            after = at if comment or byte != BACKSLASH else after_continuation(data, at - 1) + 1
            if after > at:
                at, in_token = after - 1, False
            elif not in_token:
                in_token, comment = True, comment or byte == HASH
        elif is_newline(byte):
            break
        elif is_blank(byte):
            in_token = False
    return at


@kernel
def two_product(a: float, b: float) -> tuple[float, float]:
    """a * b as rounded, and what rounding left out, exactly (Dekker 1971)."""
    product = a * b
    split = 134217729.0 * a
    a_high = split - (split - a)
    a_low = a - a_high
    split = 134217729.0 * b
    b_high = split - (split - b)
    b_low = b - b_high
    error = a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
    return product, error


@kernel
def decimal(mantissa: np.uint64, exponent: int) -> float:
    """mantissa * 10**exponent, correctly rounded, or NaN where that takes longer arithmetic.

    ``mantissa`` has at most 19 digits. Exact for mantissas up to 2**53 and powers up to 10**22
    (Clinger 1990).
    """
    value = np.float64(mantissa)
    if mantissa == 0 or exponent == 0:
        return value
    if mantissa <= np.uint64(1 << 53) and -22 <= exponent <= 22:
        if exponent < 0:
            return value / POWER_HIGH[LARGEST_POWER - exponent]
        return value * POWER_HIGH[LARGEST_POWER + exponent]
    if abs(exponent) > LARGEST_POWER:
        return np.inf if exponent > 0 else 0.0
    return rounded_product(mantissa, exponent)


@kernel
def rounded_product(mantissa: np.uint64, exponent: int) -> float:
    """As ``decimal``, in double-double arithmetic: good to 2**-103, given up within 2**-98 of a
    tie.
    """
    value = np.float64(mantissa)
    rest = np.float64(np.int64(mantissa - np.uint64(value)))
    high = POWER_HIGH[LARGEST_POWER + exponent]
    product, error = two_product(value, high)
    low = error + (value * POWER_LOW[LARGEST_POWER + exponent] + rest * high)
    if exponent < -SCALED_POWER and product < 2.0 ** (SCALE - 1021):
        return subnormal(product, low)
    doubt = product * 2.0**-98
    above, below = product + (low + doubt), product + (low - doubt)
    if above != below:
        return np.nan
    if abs(exponent) > SCALED_POWER:
        return above * 2.0 ** (SCALE if exponent > 0 else -SCALE)
    return above


@kernel
def subnormal(product: float, low: float) -> float:
    """(product + low) / 2**SCALE to the nearest multiple of the smallest double; NaN near a tie."""
    steps = product * 2.0 ** (1074 - SCALE)
    whole = int(steps)
    rest = (steps - whole) + low * 2.0 ** (1074 - SCALE)
    more = math.floor(rest + 0.5)
    if abs(rest - more) > 0.5 - 2.0**-50:
        return np.nan
    return (whole + more) * 2.0**-1074


@kernel
def read_number(data: Bytes, at: int) -> tuple[float, int]:
    """The decimal number whose token starts at ``at``, and the token's end.

    NaN stands for every token that is not a finite number, and for the few that need longer
    arithmetic: the caller looks at those one by one.
    """
    start, end = at, len(data)
    negative = at < end and data[at] == MINUS
    if at < end and (data[at] == MINUS or data[at] == PLUS):
        at += 1
    mantissa, exponent, digits, point = np.uint64(0), 0, 0, False
    significant, cut = 0, False
    while at < end:
        byte = data[at]
        if ZERO <= byte <= NINE:
            digits += 1
            if significant < MOST_DIGITS:
                mantissa = mantissa * np.uint64(10) + np.uint64(byte - ZERO)
                exponent -= point
            else:
                cut = True
                exponent += not point
            significant += mantissa != 0
        elif byte == POINT and not point:
            point = True
        else:
            break
        at += 1
    if digits == 0 or (cut and at - start > LONGEST_NUMBER):
        return np.nan, token_end(data, at)
    if at < end and data[at] in (101, 69):
        at += 1
        down = at < end and data[at] == MINUS
        if at < end and (data[at] == MINUS or data[at] == PLUS):
            at += 1
        power, first = 0, at
        while at < end and ZERO <= data[at] <= NINE:
            power = min(power * 10 + (data[at] - ZERO), 1_000_000)
            at += 1
        if at == first:
            return np.nan, token_end(data, at)
        exponent += -power if down else power
    if not token_ended(data, at):
        return np.nan, token_end(data, at)
    value = decimal(mantissa, exponent)
    if cut and value != decimal(mantissa + np.uint64(1), exponent):
        return np.nan, at
    return (-value if negative else value), at


@kernel
def read_integer(data: Bytes, at: int) -> tuple[int, int]:
    """The signed integer at ``at`` and where its digits end (``at`` itself if there is none).

    Values beyond 10**17 are cut to that.
    """
    first, end = at, len(data)
    negative = at < end and data[at] == MINUS
    if at < end and (data[at] == MINUS or data[at] == PLUS):
        at += 1
    value, digits = 0, at
    while at < end and ZERO <= data[at] <= NINE:
        value = min(value * 10 + int(data[at] - ZERO), 10**17)
        at += 1
    if at == digits:
        return 0, first
    return (-value if negative else value), at


@kernel
def find_further_tokens(data: Bytes, lines: IntArray, first: int, starts: IntArray) -> None:
    """``starts[i, j]`` becomes that of token ``first + j`` of the statement at ``lines[i]``, -1
    where the statement has fewer.
    """
    for i in range(len(lines)):
        at = lines[i]
        for j in range(first + starts.shape[1]):
            if at >= 0:
                at = next_token(data, token_end(data, at))
            if j >= first - 1 and j - first + 1 < starts.shape[1]:
                starts[i, j - first + 1] = at


@kernel
def read_numbers(data: Bytes, starts: IntArray, values: FloatArray) -> None:
    """``values[i]`` becomes the number whose token starts at ``starts[i]``; see read_number."""
    for i in range(len(starts)):
        values[i] = read_number(data, starts[i])[0]


@kernel
def find_token_ends(data: Bytes, starts: IntArray, ends: IntArray) -> None:
    """``ends[i]`` becomes the end of the token that starts at ``starts[i]``."""
    for i in range(len(starts)):
        ends[i] = token_end(data, starts[i])


@kernel
def find_tokens(data: Bytes, lines: IntArray, first: int, starts: IntArray, ends: IntArray) -> None:
    """``starts[i, j]`` and ``ends[i, j]`` become those of token ``first + j`` of the line at
    ``lines[i]``.
    """
    for i in range(len(lines)):
        at = skip_blanks(data, lines[i])
        for _ in range(first):
            at = skip_blanks(data, token_end(data, at))
        for j in range(starts.shape[1]):
            starts[i, j] = at
            ends[i, j] = token_end(data, at)
            at = skip_blanks(data, ends[i, j])
