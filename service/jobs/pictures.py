"""Plots of an edit as PNG: the Beltrami histograms, and the plane before and after."""

from __future__ import annotations

from io import BytesIO
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from engine.measures import BeltramiHistogram
from engine.pipeline import Edit, Frame
from engine.types import ComplexArray, FloatArray, IntArray

_INK = "#22303c"
_MUTED = "#8a97a3"
_START = "#c8322b"
_END = "#2462b5"


def histogram_picture(before: BeltramiHistogram, frame: Frame) -> bytes:
    """The paper's Fig. 13 and beside it what the edit itself distorted, for one frame."""
    figure = Figure(figsize=(10, 3.6), dpi=110, layout="constrained")
    disks, maps = figure.subplots(1, 2)
    _draw(disks, before, "source → its disk", _MUTED, filled=True)
    _draw(disks, frame.edited_to_disk, "edited → its disk", _END)
    disks.set_title(
        f"Before and after: W₁ = {frame.similarity.wasserstein_1:.4f}, "
        f"r = {frame.similarity.correlation:.4f}"
    )
    _draw(maps, frame.plane_to_plane, "plane → plane", _START)
    _draw(maps, frame.surface_to_surface, "surface → surface", _END, filled=True)
    maps.set_title("What the edit distorted")
    for axes in (disks, maps):
        axes.set_xlabel("|μ|  (0: conformal)")
        axes.set_ylabel("share of the area")
        axes.legend(frameon=False)
        axes.spines[["top", "right"]].set_visible(False)
    return _png(figure)


def _draw(
    axes: Axes, shown: BeltramiHistogram, label: str, colour: str, *, filled: bool = False
) -> None:
    note = f"{label}: mean {shown.mean:.3f}, p95 {shown.p95:.3f}, folds {shown.folds}"
    axes.stairs(
        shown.area_weights,
        shown.edges,
        label=note,
        color=colour,
        fill=filled,
        alpha=0.45 if filled else 1.0,
        linewidth=1.6,
    )


def plane_picture(edit: Edit, frame: Frame) -> bytes:
    """The source disk and the edited disk; control points go from red to blue."""
    figure = Figure(figsize=(11, 5.6), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2)
    disk = edit.source.disk
    faces = disk.surface.mesh.faces[: len(disk.surface.face)]
    _mesh(left, disk.z, faces, np.zeros(len(faces)))
    _mesh(right, frame.plane.z, faces, np.abs(frame.plane.mu[: len(faces)]))
    start, end = edit.controls.plane, frame.control_points
    left.scatter(start.real, start.imag, s=9, color=_START, zorder=3)
    ways = np.stack([_points(start), _points(end)], axis=1)
    right.add_collection(LineCollection(list(ways), colors=_INK, linewidths=0.7, zorder=2))
    right.scatter(start.real, start.imag, s=7, color=_START, zorder=3)
    right.scatter(end.real, end.imag, s=9, color=_END, zorder=4)
    left.set_title(f"Source disk, {len(start)} control points")
    right.set_title(
        f"Edited disk: |μ| ≤ {np.abs(frame.plane.mu[: len(faces)]).max(initial=0.0):.2f}, "
        f"{len(frame.plane.folds)} folds"
    )
    for axes in (left, right):
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_xlim(-1.03, 1.03)
        axes.set_ylim(-1.03, 1.03)
    return _png(figure)


def _points(z: ComplexArray) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.stack([z.real, z.imag], axis=-1)


def _mesh(axes: Axes, z: ComplexArray, faces: IntArray, distortion: FloatArray) -> None:
    axes.add_collection(
        PolyCollection(
            cast(Any, _points(z[faces])),  # an array is five times as fast as a list
            array=distortion,
            cmap="YlOrRd",
            clim=(0.0, 0.8),
            edgecolors="#22303c",
            linewidths=0.08,
        )
    )


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    FigureCanvasAgg(figure).print_png(buffer)
    return buffer.getvalue()
