"""Weights below 0 and above 1: what the plain blend does there, and what edits make of it.

Each expression's own shape in the neutral face's triangulation. Faces turned over that neither the
source nor, above 1, the expression turns over; faces that pass through others more than they do
there; how much deeper skin is in the skin that faces it (lips, lids), as a share of the diagonal;
how much of the way beyond is given up; the largest vertex step over its mean on 40 even steps from
-0.5 to 1.5; processor seconds of the first mesh beyond, and of each further one.

    python -m benchmarks.beyond DATA [--sets ict_face …] [--strips OUT.png --only jaw_open smile …]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import pymeshlab
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.faces import SETS
from benchmarks.picture import draw_face
from engine.io import read_mesh
from engine.restoration import Blender, Contacts, Extrapolator, turned_faces
from engine.types import FloatArray, IntArray, Mesh

PATH = np.round(np.linspace(-0.5, 1.5, 41), 4)
SHOWN = (-0.5, -0.4, -0.25, 1.25, 1.4, 1.5)
COLUMNS = (-0.5, 0.0, 0.5, 1.0, 1.25, 1.5)


def passing(mesh: Mesh, x: FloatArray) -> IntArray:
    """The faces that pass through others."""
    work = pymeshlab.MeshSet()
    work.add_mesh(pymeshlab.Mesh(x, mesh.faces))
    work.compute_selection_by_self_intersections_per_face()
    return np.flatnonzero(work.current_mesh().face_selection_array())


def report(name: str, mesh: Mesh, end: FloatArray) -> None:
    plain = Blender(mesh, [end])
    sane = Extrapolator(plain)
    seconds: list[float] = []
    for weight in (-0.5, 1.5, -0.5, 1.5):
        start = time.process_time()
        sane.at(np.array([weight]))
        seconds.append(time.process_time() - start)
    contacts = Contacts(mesh, [end], plain.moves.sum(axis=0))
    shown: list[str] = []
    for weight in SHOWN:
        within = mesh.vertices if weight < 0 else end
        already = turned_faces(mesh, mesh.vertices, within), passing(mesh, within)
        counts: list[str] = []
        for x in (plain.at(np.array([weight])), sane.at(np.array([weight]))):
            turned = np.setdiff1d(turned_faces(mesh, mesh.vertices, x), already[0])
            through = np.setdiff1d(passing(mesh, x), already[1])
            depth = contacts.depths(x, within).max(initial=0.0) / plain.size
            counts.append(f"{len(turned):3} {len(through):4} {depth:5.2%}")
        shown.append(f"{weight:5}: {' > '.join(counts)}")
    way = np.stack([sane.at(np.array([weight])) for weight in PATH])
    step = np.linalg.norm(np.diff(way, axis=0), axis=2).max(axis=1)
    lost = [given_up(plain.at(np.array([w])), x, b) for w, x, b in
            ((-0.5, way[0], mesh.vertices), (1.5, way[-1], end))]  # fmt: skip
    print(
        f"{name:28}{'; '.join(shown)}; given up {lost[0]:4.0%} {lost[1]:4.0%}; "
        f"largest step {step.max() / step.mean():.2f} x mean; first {max(seconds[:2]):.2f} s, "
        f"then {1000 * max(seconds[2:]):.0f} ms",
        flush=True,
    )


def given_up(plain: FloatArray, sane: FloatArray, within: FloatArray) -> float:
    off, way = (np.linalg.norm(plain - x, axis=1).mean() for x in (sane, within))
    return float(off / way)


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
    parser.add_argument("--strips", type=Path)
    arguments = parser.parse_args()
    cases: list[tuple[str, Mesh, FloatArray]] = []
    for which in arguments.sets:
        pattern, prefix = SETS[which]
        files = {path.stem.removeprefix(prefix): path for path in arguments.data.glob(pattern)}
        mesh = read_mesh(files.pop("neutral")).mesh
        for name, path in sorted(files.items()):
            if not arguments.only or any(word in name for word in arguments.only):
                cases.append((f"{which} {name}", mesh, read_mesh(path).mesh.vertices))
    if arguments.strips:
        draw_strips(arguments.strips, cases)
        return
    for case in cases:
        report(*case)


if __name__ == "__main__":
    main()
