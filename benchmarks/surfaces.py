"""How near the carried source comes to the true surface, wherever on it its points lie.

A slip along the surface costs nothing here: what is left is what the eye sees in the shading. Mean
distance from the true surface and angle to its normals, of the points on the target's own faces and
on the skin that these stand for; 15,000 vertices, 2,000 (`coarse`), and the ICT face with its sides
in four parts on one of 100,000 (`dense`), without noise and with 0.1 mm.

    python -m benchmarks.surfaces DATA [--dense]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.correspondence_tasks import Task, tasks
from benchmarks.correspondence_ways import normals_at, placed
from benchmarks.faces import as_file, remeshed
from benchmarks.scale import halved
from engine.correspondence import correspond
from engine.io import read_mesh
from engine.locate import PointLocator
from engine.operators import vertex_normals
from engine.registration import register
from engine.types import BoolArray, Mesh

SURE = 0.5
FACES = {
    "ict_face": ["smile", "pucker", "jaw_open"],
    "makehuman": ["smile", "mouth_open", "wink"],
    "coarse": ["smile"],
}
DENSE = ("smile", "jaw_open")


def dense(data: Path, name: str, noise: float) -> Task:
    files = [read_mesh(data / f"ict_face/A_{one}.ply").mesh for one in ("neutral", name)]
    shapes, faces = [file.vertices for file in files], files[0].faces
    for _ in range(2):
        shapes, faces = halved(shapes, faces)
    target, turn, shift = remeshed(Mesh(shapes[1], faces), 3, noise, count=100_000)
    source, truth = as_file(Mesh(shapes[0], faces)), shapes[1] @ turn.T + shift
    every = np.ones(len(truth), dtype=np.bool_)
    return Task("dense", name, source, target, truth, 1.0, every, np.zeros(0, dtype=np.int64))


def cases(data: Path, noise: float, with_dense: bool) -> Iterator[Task]:
    for group, names in FACES.items():
        yield from tasks(data, group, noise, names)
    if with_dense:
        yield from (dense(data, name, noise) for name in DENSE)


def off(carried: Mesh, true: Mesh, among: BoolArray) -> str:
    """Mean distance (mm) and angle (degrees) of ``carried`` from the ``true`` surface."""
    feet, _ = PointLocator(true).nearest(carried.vertices)
    there = normals_at(true, feet)
    there /= np.maximum(np.linalg.norm(there, axis=1), 1e-300)[:, None]
    distance = 10 * np.linalg.norm(feet.on(true) - carried.vertices, axis=1)
    cosine = np.einsum("ni,ni->n", vertex_normals(carried), there)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return f"{distance[among].mean():.4f} mm {angle[among].mean():.2f}°"


def judged(task: Task, noise: float) -> str:
    source, target = placed(task.source, task.target)
    given = correspond(source.surface, target.surface, register(source.mesh, target.mesh))
    number = source.surface.vertex_of
    here = np.flatnonzero(number >= 0)
    truth = np.zeros_like(source.mesh.vertices)
    truth[number[here]] = task.truth[here]
    true = source.mesh.moved(truth)
    flat, risen = (
        off(true.moved(target.to_file(places)), true, given.confidence >= SURE)
        for places in (given.points.on(target.mesh), given.on(target.mesh))
    )
    return f"{task.group:12}{task.name:18}{noise:5.2f} cm   {flat:20}{risen:20}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--dense", action="store_true")
    asked = parser.parse_args()
    print(f"{'':12}{'':18}{'noise':11}{'flat faces':20}{'skin'}")
    for noise in (0.0, 0.01):
        for task in cases(asked.data, noise, asked.dense):
            print(judged(task, noise), flush=True)


if __name__ == "__main__":
    main()
