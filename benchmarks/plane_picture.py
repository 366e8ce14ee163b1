"""A plane before and after a map: |μ| as colour, control points red where they are, blue to be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from benchmarks.plane_cases import Plane
from engine.types import ComplexArray, FloatArray, IntArray, PlaneMap


def _triangles(axes: Axes, z: ComplexArray, faces: IntArray, size: FloatArray, top: float) -> None:
    corners = np.stack([z.real, z.imag], axis=1)[faces]
    shown = PolyCollection(list(corners), array=size, cmap="viridis", linewidths=0.1)
    shown.set_edgecolor((1, 1, 1, 0.35))
    shown.set_clim(0, top)
    axes.add_collection(shown)
    axes.set_xlim(-1.02, 1.02)
    axes.set_ylim(-1.02, 1.02)
    axes.set_aspect("equal")
    axes.axis("off")


def draw_map(path: Path, plane: Plane, found: PlaneMap, points: IntArray) -> None:
    """Write ``path``: the source plane with the points' ways, and the edited plane."""
    size = np.abs(found.mu)
    top = float(size.max())
    figure = Figure(figsize=(11, 5.6), layout="constrained")
    FigureCanvasAgg(figure)
    before, after = figure.subplots(1, 2)
    _triangles(before, plane.z, plane.faces, size, top)
    _triangles(after, found.z, plane.faces, size, top)
    here, there = plane.z[points], found.z[points]
    for axes in (before, after):
        ways = np.stack([here, there], axis=1)
        lines = np.stack([ways.real, ways.imag], axis=2)
        axes.add_collection(LineCollection(list(lines), colors="white", linewidths=0.8))
        axes.scatter(here.real, here.imag, s=9, color="red", zorder=3)
        axes.scatter(there.real, there.imag, s=9, color="blue", zorder=3)
    before.set_title("source plane")
    after.set_title(f"edited plane: {found.solves} solves, max |μ| {top:.3f}")
    figure.colorbar(after.collections[0], ax=[before, after], label="|μ|", shrink=0.8)
    figure.savefig(path, dpi=110)
