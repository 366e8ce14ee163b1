"""The README's picture: source, frames, targets, and what the edit distorted.

    python -m benchmarks.picture DEMO_OUT docs/pictures/demo.png

``DEMO_OUT`` is the folder that ``make demo`` filled.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from engine.io import read_mesh
from engine.operators import vertex_normals
from engine.types import FloatArray, Mesh

LIGHT = np.array([0.35, 0.45, 0.82])
SKIN = np.array([0.90, 0.76, 0.68])


def draw_face(axes: Axes, mesh: Mesh, window: tuple[float, float, float]) -> None:
    """Front view (+z towards the eye), Lambert shading, far faces first."""
    normals = vertex_normals(mesh)[mesh.faces].mean(axis=1)
    corners = mesh.vertices[mesh.faces]
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    order = order[normals[order, 2] > -0.1]
    light = 0.15 + 0.85 * np.clip(normals[order] @ LIGHT, 0.0, 1.0)
    colours = np.clip(light[:, None] * SKIN, 0.0, 1.0)
    faces = PolyCollection(list(corners[order][:, :, :2]), facecolors=colours, edgecolors=colours)
    faces.set_linewidth(0.3)
    axes.add_collection(faces)
    x, y, reach = window
    axes.set_xlim(x - reach, x + reach)
    axes.set_ylim(y - 1.4 * reach, y + 1.4 * reach)
    axes.set_aspect("equal")
    axes.set_axis_off()


def window_of(vertices: FloatArray) -> tuple[float, float, float]:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return (low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0.55 * float(high[0] - low[0])


def main() -> None:
    folder, out = Path(sys.argv[1]), Path(sys.argv[2])
    frames = sorted(folder.glob("frame-*.obj"))
    chosen = [frames[round(k * (len(frames) - 1) / 4)] for k in range(5)]
    shown = [(path, f"frame {int(path.stem[-4:])}") for path in chosen]
    shown[0] = (shown[0][0], "source (frame 0)")
    shown += [(path, path.stem) for path in sorted(folder.glob("target-*.obj"))]
    figure = Figure(figsize=(14, 6.2), dpi=100, layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=[1.25, 1.0])
    window = window_of(read_mesh(frames[0]).mesh.vertices)
    for axes, (path, title) in zip(top.subplots(1, len(shown)), shown, strict=True):
        draw_face(axes, read_mesh(path).mesh, window)
        axes.set_title(title, fontsize=10)
    draw_histograms(bottom.subplots(1, 1), folder, len(frames) - 1)
    FigureCanvasAgg(figure).print_png(out.open("wb"))


def draw_histograms(axes: Axes, folder: Path, last: int) -> None:
    document = json.loads((folder / "histogram.json").read_text())
    edges = np.asarray(document["edges"])
    labels = {
        "source_to_disk": "source → its disk",
        "edited_to_disk": "edited → its disk",
        "surface": "source → edited surface",
    }
    for shown in document["maps"]:
        if shown["name"] in labels and shown.get("frame", last) == last:
            note = f"{labels[shown['name']]}: mean {shown['mean']:.3f}, folds {shown['folds']}"
            axes.stairs(shown["area_weights"], edges, label=note, linewidth=1.8)
    axes.set_xlabel("|μ|, the Beltrami coefficient of a face (0: its angles are kept)")
    axes.set_ylabel("share of the area")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)


if __name__ == "__main__":
    main()
