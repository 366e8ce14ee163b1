"""What one edited mesh costs as meshes grow, prepared: weights, and moves of ten points.

The ICT face and its smile and jaw open, each side in two, four, … parts. Processor seconds, and
the peak of resident memory per vertex; every size runs in a process of its own.

    python -m benchmarks.scale DATA [--halvings 0 1 2 3]
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.moving import at_vertices
from engine.io import read_mesh
from engine.restoration import Blender, Restorer
from engine.types import FloatArray, IntArray, Mesh


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


def timed(work: object) -> tuple[object, float]:
    start = time.process_time()
    made = work()  # type: ignore[operator]
    return made, time.process_time() - start


def peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0


def one(data: Path, halvings: int) -> None:
    files = [
        read_mesh(data / f"ict_face/A_{name}.ply").mesh for name in ("neutral", "smile", "jaw_open")
    ]
    shapes, faces = [file.vertices for file in files], files[0].faces
    for _ in range(halvings):
        shapes, faces = halved(shapes, faces)
    mesh, count = Mesh(shapes[0], faces), len(shapes[0])
    empty = peak()
    blender, prepared = timed(lambda: Blender(mesh, shapes[1:]))
    blender.at(np.array([0.1, 0.1]))
    _, weights = timed(lambda: blender.at(np.array([0.5, 0.4])))
    field = np.stack([np.linspace(0, 1, count), np.linspace(1, 0, count)])
    _, per_point = timed(lambda: blender.at(field))
    blending = (peak() - empty) / count
    del blender
    restorer, factored = timed(lambda: Restorer(mesh))
    chosen = np.linspace(0, count - 1, 10).astype(np.int64)
    grip, held = timed(lambda: restorer.grip(at_vertices(mesh, chosen)))
    _, moves = timed(lambda: grip.at(mesh.vertices[chosen] + 0.2))
    print(
        f"{count:9,} vertices: prepared in {prepared:.2f} s, weights {weights:.3f} s, weights per "
        f"point {per_point:.2f} s, {blending / 1000:.1f} kB a vertex; moves prepared in "
        f"{factored + held:.2f} s, each {moves:.2f} s, {(peak() - empty) / count / 1000:.1f} kB",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--halvings", nargs="+", type=int, default=[0, 1, 2, 3])
    parser.add_argument("--one", type=int)
    arguments = parser.parse_args()
    if arguments.one is not None:
        one(arguments.data, arguments.one)
        return
    for halvings in arguments.halvings:
        command = [sys.executable, "-m", "benchmarks.scale", str(arguments.data)]
        subprocess.run([*command, "--one", str(halvings)], check=True)


if __name__ == "__main__":
    main()
