"""Triangles, lines and dots in the pixels of an image, antialiased by distance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engine._jit import kernel
from engine.types import FloatArray, IntArray

Pixels = NDArray[np.uint8]


@kernel
def _mix(image: Pixels, y: int, x: int, colour: Pixels, share: float) -> None:
    for c in range(3):
        image[y, x, c] = np.uint8(image[y, x, c] * (1.0 - share) + colour[c] * share + 0.5)


@kernel
def paint_triangles(
    image: Pixels, at: FloatArray, faces: IntArray, colours: Pixels, line: Pixels, width: float
) -> None:
    """Fill ``faces`` of points ``at`` (n, 2), x and y in pixels, each with its colour (m, 3).

    Sides are lines of the colour ``line``, ``width`` pixels wide.
    """
    high, wide = image.shape[0], image.shape[1]
    for f in range(len(faces)):
        ax, ay = at[faces[f, 0], 0], at[faces[f, 0], 1]
        bx, by = at[faces[f, 1], 0], at[faces[f, 1], 1]
        cx, cy = at[faces[f, 2], 0], at[faces[f, 2], 1]
        turn = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if turn == 0.0:
            continue
        sign = 1.0 if turn > 0.0 else -1.0
        la = sign / np.hypot(cx - bx, cy - by)
        lb = sign / np.hypot(ax - cx, ay - cy)
        lc = sign / np.hypot(bx - ax, by - ay)
        top, bottom = max(min(ay, by, cy), 0.0), min(max(ay, by, cy), high - 1.0)
        left, right = max(min(ax, bx, cx), 0.0), min(max(ax, bx, cx), wide - 1.0)
        for y in range(int(np.ceil(top)), int(bottom) + 1):
            for x in range(int(np.ceil(left)), int(right) + 1):
                da = ((cx - bx) * (y - by) - (cy - by) * (x - bx)) * la
                db = ((ax - cx) * (y - cy) - (ay - cy) * (x - cx)) * lb
                dc = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) * lc
                near = min(da, db, dc)
                if near < 0.0:
                    continue
                for c in range(3):
                    image[y, x, c] = colours[f, c]
                if near < 1.0:
                    _mix(image, y, x, line, width * (1.0 - near))


@kernel
def paint_lines(image: Pixels, ends: FloatArray, colour: Pixels, width: float) -> None:
    """Lines ``ends`` (k, 2, 2) from x, y to x, y with round ends; of no length: dots."""
    high, wide = image.shape[0], image.shape[1]
    reach = 0.5 * width + 0.5
    for k in range(len(ends)):
        ax, ay, bx, by = ends[k, 0, 0], ends[k, 0, 1], ends[k, 1, 0], ends[k, 1, 1]
        dx, dy = bx - ax, by - ay
        square = dx * dx + dy * dy
        top, bottom = max(min(ay, by) - reach, 0.0), min(max(ay, by) + reach, high - 1.0)
        left, right = max(min(ax, bx) - reach, 0.0), min(max(ax, bx) + reach, wide - 1.0)
        for y in range(int(np.ceil(top)), int(bottom) + 1):
            for x in range(int(np.ceil(left)), int(right) + 1):
                t = 0.0
                if square > 0.0:
                    t = min(max(((x - ax) * dx + (y - ay) * dy) / square, 0.0), 1.0)
                away = np.hypot(x - ax - t * dx, y - ay - t * dy)
                share = min(reach - away, width, 1.0)
                if share > 0.0:
                    _mix(image, y, x, colour, share)


@kernel
def binned(image: Pixels, shift: int) -> tuple[IntArray, IntArray]:
    """How many pixels have each colour, to 8 - ``shift`` bits a channel, and their sums (b, 3)."""
    bits = 8 - shift
    counts = np.zeros(1 << 3 * bits, np.int64)
    sums = np.zeros((len(counts), 3), np.int64)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            r, g, b = image[y, x, 0], image[y, x, 1], image[y, x, 2]
            at = (((r >> shift) << bits | (g >> shift)) << bits) | (b >> shift)
            counts[at] += 1
            sums[at, 0] += r
            sums[at, 1] += g
            sums[at, 2] += b
    return counts, sums


@kernel
def nearest_colours(colours: FloatArray, palette: FloatArray) -> Pixels:
    """Which of the ``palette`` (p, 3), 256 at most, is nearest to each of ``colours`` (k, 3)."""
    out = np.zeros(len(colours), np.uint8)
    for k in range(len(colours)):
        best = np.inf
        for p in range(len(palette)):
            away = 0.0
            for c in range(3):
                away += (colours[k, c] - palette[p, c]) ** 2
            if away < best:
                best, out[k] = away, np.uint8(p)
    return out


@kernel
def replaced_colours(image: Pixels, shift: int, number: Pixels) -> Pixels:
    """The ``number`` (b,) of each pixel's bin, bins as ``binned`` has them."""
    bits = 8 - shift
    out = np.empty(image.shape[:2], np.uint8)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            r, g, b = image[y, x, 0], image[y, x, 1], image[y, x, 2]
            out[y, x] = number[(((r >> shift) << bits | (g >> shift)) << bits) | (b >> shift)]
    return out
