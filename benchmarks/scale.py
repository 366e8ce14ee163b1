"""What one edited mesh costs as meshes grow, prepared: weights, and moves of ten points.

The ICT face, its smile and jaw open, or MakeHuman's, with each side in two, four, … parts.
Processor seconds, and the peak of resident memory per vertex; every size runs in a process of its
own. Four halvings of MakeHuman's skin have 1.1 million vertices.

    python -m benchmarks.scale DATA [--face makehuman] [--halvings 0 1 2 3]
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchmarks.moving import at_vertices
from engine.io import read_mesh
from engine.restoration import Blender, Restorer
from engine.types import FloatArray, IntArray, Mesh

T = TypeVar("T")

FACES = {
    "ict_face": [f"ict_face/A_{name}.ply" for name in ("neutral", "smile", "jaw_open")],
    "makehuman": [
        f"makehuman/female_cauc_skin_{name}.obj" for name in ("neutral", "smile", "mouth_open")
    ],
}


def halved(vertices: list[FloatArray], faces: IntArray) -> tuple[list[FloatArray], IntArray]:
    """Every side in two, in all of the shapes alike."""
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    ends, which = np.unique(sides, axis=0, return_inverse=True)
    middle = len(vertices[0]) + which.reshape(-1, 3)
    a, b, c = faces.T
    p, q, r = middle.T
    rows = [(a, p, r), (p, b, q), (r, q, c), (p, q, r)]
    made = [np.concatenate([shape, shape[ends].mean(axis=1)]) for shape in vertices]
    return made, np.concatenate([np.stack(row, axis=1) for row in rows])


def timed(work: Callable[[], T]) -> tuple[T, float]:
    start = time.process_time()
    made = work()
    return made, time.process_time() - start


def peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0


def one(data: Path, face: str, halvings: int) -> None:
    files = [read_mesh(data / name).mesh for name in FACES[face]]
    shapes, faces = [file.vertices for file in files], files[0].faces
    for _ in range(halvings):
        shapes, faces = halved(shapes, faces)
    mesh, count = Mesh(shapes[0], faces), len(shapes[0])
    empty = peak()
    blends = of_weights(mesh, shapes[1:])
    blending = (peak() - empty) / count / 1000
    moves = of_moves(mesh)
    moving = (peak() - empty) / count / 1000
    print(
        f"{count:9,} vertices: {blends}, {blending:.1f} kB a vertex; {moves}, {moving:.1f} kB",
        flush=True,
    )


def of_weights(mesh: Mesh, shapes: list[FloatArray]) -> str:
    blender, prepared = timed(lambda: Blender(mesh, shapes))
    blender.at(np.array([0.1, 0.1]))
    _, weights = timed(lambda: blender.at(np.array([0.5, 0.4])))
    share = np.linspace(0, 1, len(mesh.vertices))
    blender.at(np.stack([share, share]))
    _, own = timed(lambda: blender.at(np.stack([share, 1 - share])))
    return f"prepared in {prepared:.2f} s, weights {weights:.3f} s, per point {own:.2f} s"


def of_moves(mesh: Mesh) -> str:
    chosen = np.linspace(0, len(mesh.vertices) - 1, 10).astype(np.int64)
    grip, prepared = timed(lambda: Restorer(mesh).grip(at_vertices(mesh, chosen)))
    grip.at(mesh.vertices[chosen] + 0.1)
    _, moves = timed(lambda: grip.at(mesh.vertices[chosen] + 0.2))
    return f"moves prepared in {prepared:.2f} s, each {moves:.2f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--face", choices=sorted(FACES), default="ict_face")
    parser.add_argument("--halvings", nargs="+", type=int, default=[0, 1, 2, 3])
    parser.add_argument("--one", type=int)
    arguments = parser.parse_args()
    if arguments.one is not None:
        one(arguments.data, arguments.face, arguments.one)
        return
    for halvings in arguments.halvings:
        command = [sys.executable, "-m", "benchmarks.scale", str(arguments.data)]
        command += ["--face", arguments.face, "--one", str(halvings)]
        subprocess.run(command, check=True)


if __name__ == "__main__":
    main()
