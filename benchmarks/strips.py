"""Strips of expressions: source, a quarter, half, three quarters of the way, and target.

The targets are remeshed, and the edit is automatic; the last column is the truth.

    python -m benchmarks.strips DATA OUT.png [--cases ict_face:jaw_open …]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.faces import Pair, pairs, rigidly_aligned
from benchmarks.picture import draw_face
from engine.pipeline import EditPlan, edit
from engine.types import FloatArray

CASES = (
    "ict_face:jaw_open",
    "ict_face:smile",
    "makehuman:mouth_open",
    "makehuman:pucker",
    "cartoon_toon:surprise",
    "cartoon_toon:pucker",
)
FRAMES = 5


def frames_of(pair: Pair) -> list[FloatArray]:
    """The surfaces of an even way, then the truth."""
    plan = EditPlan(weights={"expression": 1.0}, frames=FRAMES)
    done = edit(pair.source, {"expression": pair.target}, plan)
    made = [frame.vertices for frame in done.frames]
    return [*made, rigidly_aligned(pair.expression, made[-1])]


def window_of(vertices: FloatArray) -> tuple[float, float, float]:
    """The middle and the reach of the front of a head, without its neck."""
    middle, reach = vertices.mean(axis=0), np.ptp(vertices, axis=0)[0]
    front = vertices[vertices[:, 2] > middle[2]]
    low, high = np.percentile(front, 2, axis=0), np.percentile(front, 98, axis=0)
    return float(middle[0]), float(low[1] + high[1]) / 2, 0.5 * float(reach)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--cases", nargs="+", default=CASES)
    arguments = parser.parse_args()
    rows = len(arguments.cases)
    figure = Figure(figsize=(9, 1.95 * rows), dpi=100, layout="constrained")
    axes = figure.subplots(rows, FRAMES + 1, squeeze=False)
    titles = ["source", *(f"{k / (FRAMES - 1):g}" for k in range(1, FRAMES)), "truth"]
    for case, row in zip(arguments.cases, axes, strict=True):
        which, _, name = case.partition(":")
        pair = next(pair for pair in pairs(arguments.data, which, only=[name]))
        window = window_of(pair.source.mesh.vertices)
        for axis, vertices, title in zip(row, frames_of(pair), titles, strict=True):
            draw_face(axis, pair.source.mesh.moved(vertices), window)
            axis.set_title(title if axis is not row[0] else case.replace(":", " "), fontsize=8)
        print(case, flush=True)
    FigureCanvasAgg(figure).print_png(arguments.out.open("wb"))


if __name__ == "__main__":
    main()
