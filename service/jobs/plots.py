"""Axes of a picture: bars, steps and their legend, drawn straight into pixels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from engine.raster import Canvas
from engine.types import FloatArray

Colour = tuple[int, int, int]
Box = tuple[int, int, int, int]

INK: Colour = (34, 48, 60)
_TICK = 4
_STEPS = (1.0, 2.0, 5.0)
_TICKS = 5  # at least, along each axis
_PALE = 0.45  # of a bar's colour on white


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which has the signs that are needed, as matplotlib brings it along."""
    found = find_spec("matplotlib")
    assert found is not None and found.origin is not None
    fonts = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf"
    return ImageFont.truetype(str(fonts / "DejaVuSans.ttf"), size)


class Lettering:
    """Text, kept until the picture is drawn and put on top of it."""

    def __init__(self) -> None:
        self._lines: list[tuple[tuple[float, float], str, str, int, bool]] = []

    def add(
        self,
        at: tuple[float, float],
        text: str,
        *,
        anchor: str = "mm",
        size: int = 15,
        upright: bool = False,
    ) -> None:
        """``text`` at x, y in pixels; ``anchor`` as Pillow has it; ``upright``: from below."""
        self._lines.append((at, text, anchor, size, upright))

    def on(self, image: Image.Image) -> None:
        """Write everything."""
        draw = ImageDraw.Draw(image)
        for at, text, anchor, size, upright in self._lines:
            if not upright:
                draw.text(at, text, fill=INK, font=_font(size), anchor=anchor)
                continue
            width, height = int(_font(size).getlength(text)) + 2, size + 8
            strip = Image.new("RGB", (width, height), "white")
            middle = (width / 2, height / 2)
            ImageDraw.Draw(strip).text(middle, text, fill=INK, font=_font(size), anchor="mm")
            turned = strip.transpose(Image.Transpose.ROTATE_90)
            image.paste(turned, (int(at[0] - height / 2), int(at[1] - width / 2)))


class Plot:
    """One pair of axes inside ``box`` (left, top, right, bottom) pixels, from 0 on both ways."""

    def __init__(
        self, canvas: Canvas, lettering: Lettering, box: Box, right: float, top: float
    ) -> None:
        self._canvas, self._lettering = canvas, lettering
        self._box = box
        self._right, self._top = right, 1.08 * top or 1.0
        self._legend = 0
        self._axes()

    def _at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        left, high, right, low = self._box
        across = left + (right - left) * np.asarray(x) / self._right
        return np.stack([across, low - (low - high) * np.asarray(y) / self._top], axis=-1)

    def _axes(self) -> None:
        left, high, right, low = self._box
        frame = np.array([[[left, low], [right, low]], [[left, low], [left, high]]], dtype=float)
        self._canvas.lines(frame, INK, width=1.2)
        for value, label in _ticks(self._right):
            ((x, y),) = self._at(np.array([value]), np.zeros(1))
            self._canvas.lines(np.array([[[x, y], [x, y + _TICK]]]), INK, width=1.2)
            self._lettering.add((x, y + _TICK + 3), label, anchor="ma", size=14)
        for value, label in _ticks(self._top):
            ((x, y),) = self._at(np.zeros(1), np.array([value]))
            self._canvas.lines(np.array([[[x, y], [x - _TICK, y]]]), INK, width=1.2)
            self._lettering.add((x - _TICK - 3, y), label, anchor="rm", size=14)

    def labels(self, title: str, below: str, beside: str) -> None:
        """A title above, and what the two axes show."""
        left, high, right, low = self._box
        middle = 0.5 * (left + right)
        self._lettering.add((middle, high - 16), title, size=17)
        self._lettering.add((middle, low + 38), below)
        self._lettering.add((left - 62, 0.5 * (high + low)), beside, upright=True)

    def bars(self, edges: FloatArray, heights: FloatArray, colour: Colour, note: str) -> None:
        """Filled bars of ``heights`` (b,) between ``edges`` (b + 1,)."""
        red, green, blue = (round(255 + _PALE * (c - 255)) for c in colour)
        pale = (red, green, blue)
        corners = self._at(np.repeat(edges, 2)[1:-1], np.repeat(heights, 2))
        floor = self._at(np.repeat(edges, 2)[1:-1], np.zeros(2 * len(heights)))
        for (x, y), (end, _), (_, low) in zip(corners[::2], corners[1::2], floor[::2], strict=True):
            self._canvas.pixels[round(y) : round(low), round(x) : round(end)] = pale
        self._note(note, pale, width=9.0)

    def steps(self, edges: FloatArray, heights: FloatArray, colour: Colour, note: str) -> None:
        """A line along the tops of bars."""
        ends = np.concatenate([[0.0], np.repeat(heights, 2), [0.0]])
        path = self._at(np.repeat(edges, 2), ends)
        self._canvas.lines(np.stack([path[:-1], path[1:]], axis=1), colour, width=2.0)
        self._note(note, colour, width=2.0)

    def _note(self, note: str, colour: Colour, *, width: float) -> None:
        _, high, right, _ = self._box
        y = high + 14 + 22 * self._legend
        self._legend += 1
        self._canvas.lines(np.array([[[right - 36, y], [right - 12, y]]]), colour, width=width)
        self._lettering.add((right - 46, y), note, anchor="rm", size=14)


def _ticks(end: float) -> Sequence[tuple[float, str]]:
    """Round numbers from 0 to ``end`` and how they are written."""
    power = 10.0 ** np.floor(np.log10(end / _TICKS))
    step = max(s * power for s in (*_STEPS[:1], *_STEPS) if s * power <= end / _TICKS + 1e-12)
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return [(n * step, f"{n * step:.{digits}f}") for n in range(int(end / step + 1e-9) + 1)]
