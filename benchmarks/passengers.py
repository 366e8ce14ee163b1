"""How teeth, tongue, eyes and lashes follow the skin's true motion, against their own truth.

For every expression of a whole head: mean displacement and mean error of each solid and of the
sheets that move, and how far solids are from rigid.

    python -m benchmarks.passengers DATA [--picture OUT.png]
"""

from __future__ import annotations

import argparse
import gzip
import time
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.faces import rigidly_aligned
from benchmarks.picture import draw_face, window_of
from engine.io import MeshFile, read_mesh
from engine.passengers import Passengers, attach, carry
from engine.pipeline import addressed, find_surface
from engine.types import FloatArray, Mesh, Surface

HEADS = {
    "ict_full": ("ict_full/neutral.obj", "ict_full/*.obj*"),
    "makehuman": (
        "makehuman/female_cauc_head_neutral.obj",
        "makehuman/female_cauc_head_*.obj",
    ),
    "cartoon_toon": ("cartoon_toon/toon_head_neutral.obj", "cartoon_toon/toon_head_*.obj"),
}
MOUTH = 0.12  # of the picture's half width, from the middle of the head down to the mouth
STILL = 0.1  # of the largest displacement: sheets that move less are left out of the ratio


def opened(path: Path) -> MeshFile:
    return read_mesh(gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path)


def skin_of(file: MeshFile) -> Surface:
    surface, centre, diagonal, _ = find_surface(file, ())
    return addressed(file, surface, centre, diagonal).surface


def carried(passengers: Passengers, skin: Surface, truth: FloatArray) -> FloatArray:
    """All vertices when the skin alone is put where it is in ``truth``."""
    after = skin.mesh.vertices.copy()
    on = skin.vertex_of >= 0
    after[skin.vertex_of[on]] = truth[on]
    return carry(passengers, skin.mesh.vertices, after)


def report(passengers: Passengers, made: FloatArray, truth: FloatArray, name: str) -> None:
    moved = np.linalg.norm(truth - passengers.vertices, axis=1)
    error = np.linalg.norm(made - truth, axis=1)
    print(name)
    for number in range(int(passengers.body.max()) + 1):
        mine = passengers.body == number
        rest = passengers.vertices[mine]
        bent = np.linalg.norm(rigidly_aligned(rest, made[mine]) - made[mine], axis=1).max()
        centre = " ".join(f"{value:5.1f}" for value in rest.mean(axis=0))
        print(
            f"  solid at {centre}: moves {moved[mine].mean():.3f}, error {error[mine].mean():.3f}, "
            f"bent {bent:.0e}"
        )
    if passengers.soft is not None:
        sheets = passengers.soft.vertices
        sheets = sheets[moved[sheets] > STILL * moved[sheets].max()]
        print(f"  sheets that move {moved[sheets].mean():.3f}, error {error[sheets].mean():.3f}")


def show(mesh: Mesh, made: FloatArray, truth: FloatArray, out: Path) -> None:
    figure = Figure(figsize=(12, 5), dpi=90, layout="constrained")
    x, y, reach = window_of(mesh.vertices)
    window = x, y - MOUTH * reach, reach / 4
    shown = {"neutral": mesh.vertices, "carried": made, "truth": truth}
    for axes, (title, vertices) in zip(figure.subplots(1, 3), shown.items(), strict=True):
        draw_face(axes, mesh.moved(vertices), window)
        axes.set_title(title)
    FigureCanvasAgg(figure).print_png(out.open("wb"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--picture", type=Path, help="of the mouth of the first head, open")
    arguments = parser.parse_args()
    for which, (first, pattern) in HEADS.items():
        neutral = opened(arguments.data / first)
        skin = skin_of(neutral)
        passengers = attach(neutral.mesh, skin)
        for path in sorted(arguments.data.glob(pattern)):
            if "neutral" in path.name:
                continue
            truth = opened(path).mesh.vertices
            start = time.process_time()
            made = carried(passengers, skin, truth)
            took = time.process_time() - start
            report(passengers, made, truth, f"{which} {path.name}, {1000 * took:.0f} ms")
            if arguments.picture and path.name == "jaw_open.obj":
                show(neutral.mesh, made, truth, arguments.picture)


if __name__ == "__main__":
    main()
