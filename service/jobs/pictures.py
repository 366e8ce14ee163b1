"""Plots of an edit as PNG: the Beltrami histograms, and the plane before and after."""

from __future__ import annotations

from io import BytesIO

import numpy as np
from PIL import Image

from engine.measures import BeltramiHistogram
from engine.pipeline import Edit, Frame
from engine.raster import Canvas, few_colours, heat
from engine.types import ComplexArray, FloatArray, IntArray
from service.jobs.plots import INK, Colour, Lettering, Plot

_MUTED: Colour = (138, 151, 163)
_START: Colour = (200, 50, 43)
_END: Colour = (36, 98, 181)
_HOTTEST = 0.8  # |μ| of the darkest colour
_SIDES = 0.15  # pixels
_FAST = 1  # of PNG's levels: higher ones save little here at many times the time


def histogram_picture(before: BeltramiHistogram, frame: Frame) -> bytes:
    """The paper's Fig. 13 and beside it what the edit itself distorted, for one frame."""
    canvas, lettering = Canvas(1100, 396), Lettering()
    plane, surface, after = frame.plane_to_plane, frame.surface_to_surface, frame.edited_to_disk

    def plot(box: tuple[int, int, int, int], *shown: BeltramiHistogram) -> Plot:
        top = max(float(one.area_weights.max()) for one in shown)
        return Plot(canvas, lettering, box, float(before.edges[-1]), top)

    disks = plot((85, 40, 530, 330), before, after)
    disks.bars(before.edges, before.area_weights, _MUTED, _note("source → its disk", before))
    disks.steps(after.edges, after.area_weights, _END, _note("edited → its disk", after))
    likeness = frame.similarity
    title = f"Before and after: W₁ = {likeness.wasserstein_1:.4f}, r = {likeness.correlation:.4f}"
    disks.labels(title, "|μ|  (0: conformal)", "share of the area")
    maps = plot((640, 40, 1085, 330), plane, surface)
    maps.bars(surface.edges, surface.area_weights, _END, _note("surface → surface", surface))
    maps.steps(plane.edges, plane.area_weights, _START, _note("plane → plane", plane))
    maps.labels("What the edit distorted", "|μ|  (0: conformal)", "share of the area")
    return _png(canvas, lettering)


def _note(label: str, shown: BeltramiHistogram) -> str:
    return f"{label}: mean {shown.mean:.3f}, p95 {shown.p95:.3f}, folds {shown.folds}"


def source_plane(edit: Edit) -> Canvas:
    """What all plane pictures of edits that share source and control points begin with."""
    canvas, faces = Canvas(1210, 640), _disk_faces(edit)
    colours = heat(np.zeros(len(faces)))
    canvas.triangles(_pixels(edit.source.disk.z, _LEFT), faces, colours, INK, width=_SIDES)
    canvas.dots(_pixels(edit.controls.plane, _LEFT), _START, width=4.5)
    return canvas


def _disk_faces(edit: Edit) -> IntArray:
    disk = edit.source.disk.surface
    return disk.mesh.faces[: len(disk.face)]


def plane_picture(edit: Edit, frame: Frame, begun: Canvas) -> bytes:
    """The source disk, ``begun``, and the edited disk; control points go from red to blue."""
    canvas, lettering, faces = begun.copy(), Lettering(), _disk_faces(edit)
    mu = np.abs(frame.plane.mu[: len(faces)])
    at = _pixels(frame.plane.z, _RIGHT)
    canvas.triangles(at, faces, heat(mu / _HOTTEST), INK, width=_SIDES)
    start, end = edit.controls.plane, frame.control_points
    ways = np.stack([_pixels(start, _RIGHT), _pixels(end, _RIGHT)], axis=1)
    canvas.lines(ways, INK, width=1.0)
    canvas.dots(ways[:, 0], _START, width=4.0)
    canvas.dots(ways[:, 1], _END, width=4.5)
    lettering.add((_LEFT[0], 18), f"Source disk, {len(start)} control points", size=17)
    most = f"|μ| ≤ {mu.max(initial=0.0):.2f}"
    folds = f"{len(frame.plane.folds)} folds"
    lettering.add((_RIGHT[0], 18), f"Edited disk: {most}, {folds}", size=17)
    return _png(canvas, lettering)


_RADIUS = 295.0
_LEFT, _RIGHT = (302.0, 337.0), (908.0, 337.0)


def _pixels(z: ComplexArray, centre: tuple[float, float]) -> FloatArray:
    return np.stack([centre[0] + _RADIUS * z.real, centre[1] - _RADIUS * z.imag], axis=-1)


def _png(canvas: Canvas, lettering: Lettering) -> bytes:
    image = Image.fromarray(canvas.pixels)
    lettering.on(image)
    buffer = BytesIO()
    palette, numbers = few_colours(np.asarray(image))
    few = Image.fromarray(numbers)
    few.putpalette(palette.tobytes())
    few.save(buffer, "png", compress_level=_FAST)
    return buffer.getvalue()
