"""Weights below 0 and above 1: what the plain blend does there, and what edits make of it.

Each expression's own shape in the neutral face's triangulation. Faces turned over that neither the
source nor, above 1, the expression turns over; faces that pass through others more than they do
there; how much deeper skin is in the skin that faces it (lips, lids), as a share of the diagonal;
how much of the way beyond is given up; the largest vertex step over its mean on 40 even steps from
-0.5 to 1.5; processor seconds of the first mesh beyond, and of each further one. At the end of a
set: sums, of which the largest; the deepest; medians; ranges. Halvings: of each side, first.

    python -m benchmarks.beyond DATA [--sets ict_face …] [--only jaw_open …] [--halvings 2]
    python -m benchmarks.beyond DATA --strips OUT.png --only jaw_open smile …
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pymeshlab
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.faces import SETS, expressions
from benchmarks.picture import draw_face
from benchmarks.scale import halved
from benchmarks.transitions import largest_step
from engine.restoration import Blender, Contacts, Extrapolator, turned_faces
from engine.types import FloatArray, IntArray, Mesh

PATH = np.round(np.linspace(-0.5, 1.5, 41), 4)
SHOWN = (-0.5, -0.4, -0.25, 1.25, 1.4, 1.5)
COLUMNS = (-0.5, 0.0, 0.5, 1.0, 1.25, 1.5)


@dataclass(frozen=True)
class Figures:
    """What one expression comes to: by the plain blend, and by the edit."""

    found: FloatArray  # (w, 2, 3) at the weights shown: turned over, passing through, depth
    given_up: FloatArray  # (2,) of the way beyond at -0.5 and at 1.5
    step: float
    seconds: FloatArray  # (2,) of the first mesh beyond, and of a further one


class Judge:
    """What is wrong with surfaces that it is not where the weights are cut to 0 … 1."""

    def __init__(self, blender: Blender) -> None:
        self._mesh, self._size = blender.mesh, blender.size
        self._contacts = Contacts(blender.mesh, blender.shapes, blender.moves.sum(axis=0))

    def found(self, surfaces: list[FloatArray], within: FloatArray) -> FloatArray:
        """Faces turned over, faces that pass through others, greatest depth of each (k, 3)."""
        mesh = self._mesh
        turned, through = turned_faces(mesh, mesh.vertices, within), passing(mesh, within)
        return np.array(
            [
                (
                    len(np.setdiff1d(turned_faces(mesh, mesh.vertices, x), turned)),
                    len(np.setdiff1d(passing(mesh, x), through)),
                    self._contacts.depths(x, within).max(initial=0.0) / self._size,
                )
                for x in surfaces
            ]
        )


def passing(mesh: Mesh, x: FloatArray) -> IntArray:
    """The faces that pass through others."""
    work = pymeshlab.MeshSet()
    work.add_mesh(pymeshlab.Mesh(x, mesh.faces))
    work.compute_selection_by_self_intersections_per_face()
    return np.flatnonzero(work.current_mesh().face_selection_array())


def given_up(plain: FloatArray, sane: FloatArray, within: FloatArray) -> float:
    """The share of the way from ``within`` to ``plain`` by which ``sane`` differs from it."""
    off, way = (np.linalg.norm(plain - x, axis=1).mean() for x in (sane, within))
    return float(off / way)


def measured(mesh: Mesh, end: FloatArray) -> Figures:
    plain = Blender(mesh, [end])
    sane, judge = Extrapolator(plain), Judge(plain)
    seconds: list[float] = []
    for weight in (-0.5, 1.5, -0.5, 1.5):
        start = time.process_time()
        sane.at(np.array([weight]))
        seconds.append(time.process_time() - start)
    found: list[FloatArray] = []
    for weight in SHOWN:
        within = mesh.vertices if weight < 0 else end
        found.append(judge.found([way.at(np.array([weight])) for way in (plain, sane)], within))
    way = np.stack([sane.at(np.array([weight])) for weight in PATH])
    lost = [
        given_up(plain.at(np.array([w])), x, within)
        for w, x, within in ((-0.5, way[0], mesh.vertices), (1.5, way[-1], end))
    ]
    times = np.array([max(seconds[:2]), max(seconds[2:])])
    return Figures(np.stack(found), np.array(lost), largest_step(way), times)


def line(figures: Figures) -> str:
    shown = "; ".join(
        f"{weight:5}: " + " > ".join(f"{t:3.0f} {p:4.0f} {d:5.2%}" for t, p, d in found)
        for weight, found in zip(SHOWN, figures.found, strict=True)
    )
    lost, seconds = figures.given_up, figures.seconds
    return (
        f"{shown}; given up {lost[0]:4.0%} {lost[1]:4.0%}; largest step {figures.step:.2f} x mean; "
        f"first {seconds[0]:.2f} s, then {1000 * seconds[1]:.0f} ms"
    )


def total(every: list[Figures]) -> str:
    found = np.stack([figures.found for figures in every])
    sums, most = found.sum(axis=0), found.max(axis=0)
    rows = [
        f"    {weight:5}: turned over {s[0, 0]:.0f} > {s[1, 0]:.0f} (at most {m[1, 0]:.0f}), "
        f"passing {s[0, 1]:.0f} > {s[1, 1]:.0f}, depth {m[0, 2]:.2%} > {m[1, 2]:.2%}"
        for weight, s, m in zip(SHOWN, sums, most, strict=True)
    ]
    lost = np.median([figures.given_up for figures in every], axis=0)
    steps = [figures.step for figures in every]
    times = np.array([figures.seconds for figures in every])
    first, then = times.min(axis=0), times.max(axis=0)
    rows.append(
        f"    given up {lost[0]:.0%}, {lost[1]:.0%} (medians); steps {min(steps):.2f} to "
        f"{max(steps):.2f} x mean; first {first[0]:.2f} to {then[0]:.2f} s, then "
        f"{1000 * first[1]:.0f} to {1000 * then[1]:.0f} ms"
    )
    return "\n".join(rows)


def draw_strips(out: Path, cases: list[tuple[str, Mesh, FloatArray]]) -> None:
    """The mouth's or the eyes' surroundings at even weights, plain blend above, edit below."""
    figure = Figure(figsize=(1.6 * len(COLUMNS), 3.6 * len(cases)), dpi=100, layout="constrained")
    axes = figure.subplots(2 * len(cases), len(COLUMNS), squeeze=False)
    for number, (name, mesh, end) in enumerate(cases):
        moved = np.square(end - mesh.vertices).sum(axis=1)
        middle = moved @ mesh.vertices / moved.sum()
        spread = np.sqrt((moved @ np.square(mesh.vertices - middle)[:, :2]).sum() / moved.sum())
        window = float(middle[0]), float(middle[1]), 1.8 * float(spread)
        plain = Blender(mesh, [end])
        for row, way in zip(axes[2 * number :], (plain, Extrapolator(plain)), strict=False):
            for axis, weight in zip(row, COLUMNS, strict=True):
                draw_face(axis, mesh.moved(way.at(np.array([weight]))), window)
                axis.set_title(f"{name} {weight:g}", fontsize=7)
    FigureCanvasAgg(figure).print_png(out.open("wb"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--sets", nargs="+", default=list(SETS))
    parser.add_argument("--only", nargs="*", help="words of expressions' names")
    parser.add_argument("--halvings", type=int, default=0)
    parser.add_argument("--strips", type=Path)
    arguments = parser.parse_args()
    drawn: list[tuple[str, Mesh, FloatArray]] = []
    for which in arguments.sets:
        mesh, shapes = expressions(arguments.data, which)
        every: list[Figures] = []
        for name, end in shapes.items():
            if arguments.only and not any(word in name for word in arguments.only):
                continue
            if arguments.strips:
                drawn.append((f"{which} {name}", mesh, end))
                continue
            ends, faces = [mesh.vertices, end], mesh.faces
            for _ in range(arguments.halvings):
                ends, faces = halved(ends, faces)
            every.append(measured(Mesh(ends[0], faces), ends[1]))
            print(f"{which + ' ' + name:28}{line(every[-1])}", flush=True)
        if every:
            print(f"{which}, {len(every)} expressions\n{total(every)}", flush=True)
    if arguments.strips:
        draw_strips(arguments.strips, drawn)


if __name__ == "__main__":
    main()
