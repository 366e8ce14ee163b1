"""Numbers in text: the few that need a second look, and how to write new ones like the old."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from engine.errors import MeshFormatError
from engine.io import _text_kernels as kernels
from engine.io._text_kernels import Bytes
from engine.types import FloatArray, IntArray

LONGEST_NUMBER = 512
FLOAT_DIGITS = 9
POSITION_DIGITS = 8
NORMAL_DIGITS = 5
SAMPLE = 30_000
CHUNK = 100_000
_DECIMAL = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,9})?")
_NOT_FINITE = re.compile(rb"[+-]?(nan(\(\w*\))?|inf(inity)?|1\.#\w+)", re.IGNORECASE)


def as_bytes(data: bytes) -> Bytes:
    """``data`` as a read-only array of bytes, not copied."""
    return np.frombuffer(data, np.uint8)


def line_number(data: bytes, at: int) -> int:
    """The 1-based line of byte ``at``, whichever line ends the file uses."""
    feeds = data.count(b"\n", 0, at)
    return 1 + (feeds or data.count(b"\r", 0, at))


def format_error(data: bytes, at: int, what: str, code: str) -> MeshFormatError:
    """An error that shows the line of byte ``at`` and its beginning."""
    line = line_number(data, at)
    shown = re.split(rb"[\r\n]", data[at : at + 60], maxsplit=1)[0].decode("ascii", "replace")
    return MeshFormatError(
        f"line {line}: {what}: {shown!r}", code=code, elements={"line": line, "byte": at}
    )


def resolve_numbers(data: bytes, starts: IntArray, values: FloatArray) -> None:
    """Give ``values`` that are NaN for want of a fast way their number; ``starts`` their tokens.

    What is written as NaN or infinity becomes that. Raises MeshFormatError with the line for
    tokens that are not numbers.
    """
    ends = np.empty_like(starts)
    kernels.find_token_ends(as_bytes(data), starts, ends)
    for i in np.flatnonzero(np.isnan(values)):
        start, end = int(starts[i]), int(ends[i])
        if end - start > LONGEST_NUMBER:
            what = f"a number of {end - start} characters; the most is {LONGEST_NUMBER}"
            raise format_error(data, start, what, "number_too_long")
        token = data[start:end]
        if _DECIMAL.fullmatch(token):
            values[i] = float(token)
        elif not _NOT_FINITE.fullmatch(token):
            raise format_error(data, start, "not a number", "not_a_number")


@dataclass(frozen=True, slots=True)
class NumberStyle:
    """How to write numbers: with ``decimals`` of which trailing zeros beyond ``keep`` go."""

    kind: Literal["fixed", "exponent", "shortest", "integer"]
    decimals: int = 0
    keep: int = 0

    def write(self, values: FloatArray) -> bytes:
        """The numbers, each followed by one space."""
        numbers: list[float] = values.tolist()
        if self.kind == "shortest":
            return b"".join(b"%a " % number for number in numbers)
        if self.kind == "integer":
            return (b"%d " * len(numbers)) % tuple(numbers)
        letter = b"f" if self.kind == "fixed" else b"e"
        return (b"%%.%d%s " % (self.decimals, letter) * len(numbers)) % tuple(numbers)


def sample_digits(data: bytes, starts: IntArray, ends: IntArray) -> tuple[int, int, int, float]:
    """Fewest and most decimals, most significant digits, share with exponents, of a sample."""
    step = max(1, len(starts) // SAMPLE)
    sample = np.ascontiguousarray(starts[::step]), np.ascontiguousarray(ends[::step])
    fewest, most, longest, exponents = kernels.measure_numbers(as_bytes(data), *sample)
    return fewest, most, longest, exponents / max(1, len(sample[0]))


def matching_style(
    data: bytes, starts: IntArray, ends: IntArray, values: FloatArray, *, digits: int
) -> NumberStyle:
    """The style of the numbers in the file, with decimals enough for ``values`` (k, 3).

    The last decimal is at most 10**-digits of the values' extent, and never coarser than the
    file's own. Files with more digits than a 32-bit float get the shortest text that reads back
    as the same double.
    """
    fewest, most, longest, exponents = sample_digits(data, starts, ends)
    if longest > FLOAT_DIGITS:
        return NumberStyle("shortest")
    extent = float(np.linalg.norm(np.ptp(values, axis=0)))
    largest = float(np.abs(values).max())
    scale = extent or largest or 1.0
    if exponents > 0.5:
        needed = digits + int(np.ceil(np.log10(max(largest / scale, 1.0))))
        return NumberStyle("exponent", min(max(most, needed), 16))
    needed = digits - int(np.floor(np.log10(scale)))
    if needed > 30:
        return NumberStyle("shortest")
    return NumberStyle("fixed", max(most, needed, 0), fewest)


@dataclass(frozen=True, slots=True)
class Replacement:
    """New numbers ``values`` (k,) for the tokens at bytes starts[i] to ends[i]."""

    starts: IntArray
    ends: IntArray
    values: FloatArray
    style: NumberStyle


def _written(replacement: Replacement) -> tuple[Bytes, IntArray, IntArray]:
    values, style = replacement.values, replacement.style
    text = as_bytes(
        b"".join(style.write(values[i : i + CHUNK]) for i in range(0, len(values), CHUNK))
    )
    ends = np.flatnonzero(text == kernels.SPACE)
    starts = np.concatenate([np.zeros(1, np.int64), ends + 1])[:-1]
    if style.kind == "fixed":
        kernels.trim_zeros(text, starts, ends, style.keep)
    return text, starts, ends


def replace_numbers(data: bytes, replacements: Sequence[Replacement]) -> bytes:
    """``data`` with the numbers replaced and every other byte as it was."""
    written = [_written(replacement) for replacement in replacements]
    shifts = np.cumsum([0, *(len(text) for text, _, _ in written)])
    text_starts = np.concatenate([w[1] + shift for w, shift in zip(written, shifts, strict=False)])
    text_ends = np.concatenate([w[2] + shift for w, shift in zip(written, shifts, strict=False)])
    text = np.concatenate([text for text, _, _ in written])
    starts = np.concatenate([r.starts for r in replacements])
    ends = np.concatenate([r.ends for r in replacements])
    grown = int((text_ends - text_starts).sum() - (ends - starts).sum())
    order = np.argsort(starts, kind="stable")
    out = np.empty(len(data) + grown, np.uint8)
    pieces = (text, text_starts[order], text_ends[order])
    kernels.splice(as_bytes(data), starts[order], ends[order], *pieces, out)
    return out.tobytes()
