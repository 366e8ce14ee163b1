"""A grid drawn on sources and carried to targets: by the correspondence, and by the truth.

The checker's cells are even in x and y of the source's rest, seen from the front. Pale: what is
said not to be on the target (confidence below 0.5), or is not. Black: faces from behind. The
right half looks closer at where the expression stretches most.

    python -m benchmarks.carried_grids DATA OUT.png [--cases ict_face:smile …] [--way automatic]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from benchmarks.correspondence_tasks import Task, tasks
from benchmarks.correspondence_ways import OURS, answer, placed
from benchmarks.faces import rigid_motion
from benchmarks.picture import LIGHT
from benchmarks.strips import window_of
from engine.operators import edges, vertex_normals
from engine.raster import Canvas
from engine.types import FloatArray, Mesh

CASES = (
    "ict_face:jaw_open",
    "ict_face:smile",
    "makehuman:mouth_open",
    "cartoon_toon:mouth_open",
    "pairs:p3_surprise_virtual_scan",
    "whole head:surprise",
)
CELLS = 44  # across the source
CLOSE = 0.5  # of the window
MOST = 0.98  # quantile of the edges' change from which on it is looked at closer
FACES = 400_000  # at least are drawn, each of one colour, so that cells end within faces
FINE = 3  # pixels drawn for each that is shown
TALL = 1.25  # height over width
TITLE = 24  # pixels
PALETTE = 32  # colours of the file
WARM, COOL, EVEN, BEHIND = (
    np.array(colour) for colour in ((196, 64, 32), (24, 92, 150), (246, 240, 226), (20, 20, 20))
)
Window = tuple[float, float, float]


def grid_colours(rest: FloatArray, width: float) -> FloatArray:
    """Colours (..., 3) of points (..., 3) at rest: every second cell, in bands of two colours."""
    cell = np.floor(rest[..., :2] * CELLS / width).astype(np.int64)
    band = np.where((cell // 4).sum(axis=-1) % 2 == 0, 0, 1)
    odd = cell.sum(axis=-1) % 2 == 1
    return np.where(odd[..., None], np.stack([WARM, COOL])[band], EVEN)


def split(corners: FloatArray) -> FloatArray:
    """Each of the triangles (m, 3, k) as the four (4m, 3, k) between its sides' middles."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def drawn(
    rest: Mesh, places: FloatArray, known: FloatArray, window: Window, side: int
) -> NDArray[np.uint8]:
    """``places`` (n, 3) of the vertices, from the front, with the grid of ``rest``."""
    moved = rest.moved(places)
    whole = np.hstack([places, vertex_normals(moved), rest.vertices, known[:, None]])
    corners = whole[rest.faces]
    while len(corners) < FACES:
        corners = split(corners)
    middle = corners.mean(axis=1)
    corners, middle = (values[np.argsort(middle[:, 2])] for values in (corners, middle))
    sides = np.diff(corners[:, :, :2], axis=1)
    front = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0] > 0
    normals = middle[:, 3:6] / np.maximum(np.linalg.norm(middle[:, 3:6], axis=1), 1e-12)[:, None]
    light = 0.35 + 0.65 * np.clip(normals @ LIGHT, 0.0, 1.0)
    colours = grid_colours(middle[:, 6:9], float(np.ptp(rest.vertices[:, 0]))) * light[:, None]
    colours = np.where(middle[:, 9:] < 0.5, 0.3 * colours + 0.7 * 255, colours)
    colours = np.where(front[:, None], colours, BEHIND)
    x, y, reach = window
    scale = FINE * side / (2 * reach)
    at = (corners[:, :, :2] - (x - reach, y + TALL * reach)) * (scale, -scale)
    canvas = Canvas(FINE * side, FINE * round(side * TALL))
    faces = np.arange(3 * len(at)).reshape(-1, 3)
    canvas.triangles(at.reshape(-1, 2), faces, colours.astype(np.uint8), (0, 0, 0), width=0.0)
    shape = (round(side * TALL), FINE, side, FINE, 3)
    return canvas.pixels.reshape(shape).mean(axis=(1, 3)).astype(np.uint8)


def where_stretched(rest: Mesh, places: FloatArray) -> list[float]:
    """The middle of the edges whose length changes most, in ``places`` (n, 3)."""
    ends = edges(rest.faces)
    a, b = (np.linalg.norm(np.diff(x[ends], axis=1)[:, 0], axis=1) for x in (rest.vertices, places))
    change = np.abs(b - a)
    return places[ends[change >= np.quantile(change, MOST)]].mean(axis=(0, 1)).tolist()


def pictures(task: Task, way: str, side: int) -> list[NDArray[np.uint8]]:
    """Source, carried and true grid, then all three again from close by."""
    given = answer(task, way)
    source, _ = placed(task.source, task.target)
    rest = source.mesh.moved(source.to_file(source.mesh.vertices))
    on_surface = source.surface.vertex_of
    here = np.flatnonzero(on_surface >= 0)
    truth, valid = np.empty_like(rest.vertices), np.empty(len(rest.vertices))
    truth[on_surface[here]] = task.truth[here] / task.scale
    valid[on_surface[here]] = task.valid[here]
    turn, shift = rigid_motion(truth, rest.vertices)
    there, carried = (p @ turn.T + shift for p in (truth, given.places / task.scale))
    far = window_of(rest.vertices)
    x, y, _ = where_stretched(rest, there)
    near = (x, y, CLOSE * far[2])
    shown = ((rest.vertices, valid >= 0), (carried, given.confidence), (there, valid))
    return [
        drawn(rest, p, known.astype(np.float64), window, side)
        for window in (far, near)
        for p, known in shown
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--cases", nargs="+", default=CASES)
    parser.add_argument("--way", choices=OURS, default="automatic")
    parser.add_argument("--side", type=int, default=240, help="pixels across each picture")
    arguments = parser.parse_args()
    rows, side = len(arguments.cases), arguments.side
    height = rows * (TALL * side + TITLE)
    figure = Figure(figsize=(6 * side / 100, height / 100), dpi=100)
    axes = figure.subplots(rows, 6, squeeze=False)
    figure.subplots_adjust(0, 0, 1, 1 - TITLE / height, 0.01, TITLE / (TALL * side))
    for case, row in zip(arguments.cases, axes, strict=True):
        group, _, name = case.partition(":")
        task = next(tasks(arguments.data, group, 0.01, [name]))
        titles = [case.replace(":", " "), "carried", "true", "source", "carried", "true"]
        shown = pictures(task, arguments.way, side)
        for axis, pixels, title in zip(row, shown, titles, strict=True):
            axis.imshow(pixels)
            axis.set_title(title, fontsize=7, pad=3)
            axis.set_axis_off()
        print(case, flush=True)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    picture.quantize(PALETTE, dither=Image.Dither.NONE).save(arguments.out, optimize=True)


if __name__ == "__main__":
    main()
