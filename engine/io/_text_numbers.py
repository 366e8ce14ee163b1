"""Numbers in text: the few that need a second look, and how to write new ones like the old."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Literal

import numpy as np

from engine.errors import MeshFormatError
from engine.io import _number_kernels as kernels
from engine.io._text_kernels import LONGEST_NUMBER, SPACE, Bytes
from engine.types import FloatArray, IntArray

FLOAT_DIGITS = 9
POSITION_DIGITS = 8
NORMAL_DIGITS = 5
SAMPLE = 30_000
CHUNK = 100_000
LARGEST_EXACT = 2.0**52


def as_bytes(data: bytes) -> Bytes:
    """``data`` as a read-only array of bytes, not copied."""
    return np.frombuffer(data, np.uint8)


def line_numbers(data: bytes, places: Sequence[int]) -> list[int]:
    """The 1-based lines of ascending bytes, whichever line ends the file uses."""
    ends = [data.count(b"\n", *between) for between in pairwise([0, *places])]
    if not any(ends):
        ends = [data.count(b"\r", *between) for between in pairwise([0, *places])]
    return [1 + count for count in accumulate(ends)]


def format_error(data: bytes, at: int, what: str, code: str) -> MeshFormatError:
    """An error that shows the line of byte ``at`` and its beginning."""
    (line,) = line_numbers(data, [at])
    shown = re.split(rb"[\r\n]", data[at : at + 60], maxsplit=1)[0].decode("ascii", "replace")
    return MeshFormatError(
        f"line {line}: {what}: {shown!r}", code=code, elements={"line": line, "byte": at}
    )


def resolve_numbers(data: bytes, starts: IntArray, values: FloatArray) -> None:
    """Give ``values`` that are NaN for want of a fast way their number; ``starts`` their tokens.

    What is written as NaN or infinity becomes that. Raises MeshFormatError with the line for
    tokens that are not numbers.
    """
    ends, kinds = np.empty_like(starts), np.empty(len(starts), np.uint8)
    kernels.judge_tokens(as_bytes(data), starts, values, ends, kinds)
    refused = np.flatnonzero(kinds >= kernels.TOO_LONG)
    if len(refused):
        start, length = int(starts[refused[0]]), int(ends[refused[0]] - starts[refused[0]])
        if kinds[refused[0]] == kernels.NO_NUMBER:
            raise format_error(data, start, "not a number", "not_a_number")
        what = f"a number of {length} characters; the most is {LONGEST_NUMBER}"
        raise format_error(data, start, what, "number_too_long")
    slow = np.flatnonzero(kinds == kernels.DECIMAL)
    tokens = zip(starts[slow].tolist(), ends[slow].tolist(), strict=True)
    values[slow] = [float(data[start:end]) for start, end in tokens]


Pieces = tuple[Bytes, IntArray, IntArray]
"""Text, and where its pieces start and end."""


@dataclass(frozen=True, slots=True)
class NumberStyle:
    """How to write numbers: with ``decimals`` of which trailing zeros beyond ``keep`` go."""

    kind: Literal["fixed", "exponent", "shortest", "integer"]
    decimals: int = 0
    keep: int = 0

    def write(self, values: FloatArray) -> Pieces:
        """The numbers as text."""
        if self.kind == "fixed":
            pieces = self._exact(values) if self._is_exact(values) else self._printed(values)
            kernels.trim_zeros(*pieces, self.keep)
            return pieces
        return self._printed(values)

    def _is_exact(self, values: FloatArray) -> bool:
        largest = float(np.abs(values).max(initial=0.0))
        return self.decimals <= 22 and largest * 10.0**self.decimals < LARGEST_EXACT

    def _exact(self, values: FloatArray) -> Pieces:
        digits = len(str(int(np.abs(values).max(initial=0.0)))) + self.decimals
        text = np.empty((len(values), digits + 3), np.uint8)
        starts, ends = np.empty(len(values), np.int64), np.empty(len(values), np.int64)
        kernels.write_fixed(values, self.decimals, text, starts, ends)
        return text.reshape(-1), starts, ends

    def _printed(self, values: FloatArray) -> Pieces:
        parts = range(0, len(values), CHUNK)
        text = as_bytes(b"".join(self._print(values[i : i + CHUNK].tolist()) for i in parts))
        ends = np.flatnonzero(text == SPACE)
        return text, np.concatenate([np.zeros(1, np.int64), ends + 1])[:-1], ends

    def _print(self, numbers: list[float]) -> bytes:
        """The numbers, each followed by one space."""
        if self.kind == "shortest":
            return b"%a " * len(numbers) % tuple(numbers)
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
    low, high = np.array([(column.min(), column.max()) for column in values.T]).T
    extent, largest = float(np.linalg.norm(high - low)), float(np.maximum(-low, high).max())
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


Part = tuple[IntArray, IntArray, Bytes, IntArray, IntArray]
"""Where numbers start and end in a file, and the pieces of text that replace them."""


def replace_numbers(data: bytes, replacements: Sequence[Replacement]) -> bytes:
    """``data`` with the numbers replaced and every other byte as it was."""
    parts = [(r.starts, r.ends, *r.style.write(r.values)) for r in replacements if len(r.starts)]
    apart = all((starts[:-1] <= starts[1:]).all() for starts, *_ in parts)
    if not apart or any(a[1][-1] > b[0][0] for a, b in pairwise(parts)):
        parts = [_merged(parts)]
    grown = sum(int((b - a).sum() - (ends - starts).sum()) for starts, ends, _, a, b in parts)
    last = int(parts[-1][1][-1]) if parts else 0
    out = np.empty(last + grown, np.uint8)
    read, write = 0, 0
    for part in parts:
        read, write = kernels.splice(as_bytes(data), read, part, out, write)
    return b"".join([out.data, memoryview(data)[read:]])


def _merged(parts: Sequence[Part]) -> Part:
    """All parts as one, in the order of the file."""
    shifts = np.cumsum([0, *(len(text) for _, _, text, _, _ in parts)])
    shifted = zip(parts, shifts, strict=False)
    starts, ends, text_starts, text_ends = np.hstack(
        [
            np.stack([starts, ends, a + shift, b + shift])
            for (starts, ends, _, a, b), shift in shifted
        ]
    )
    order = np.argsort(starts, kind="stable")
    text = np.concatenate([text for _, _, text, _, _ in parts])
    return starts[order], ends[order], text, text_starts[order], text_ends[order]
