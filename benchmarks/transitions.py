"""The way between a face and its expressions: even steps, arcs in place of chords, edge lengths.

Steps: the largest vertex step over its mean on 24 even steps, and the largest ratio that any
moving vertex has of its own. Edges: by how much the edges of what turns are shorter halfway than
the mean of both ends, next to linear blending. Hinges have known answers: a jaw turned about its
joint, a lid over its eyeball; the error halfway is a share of the true displacement.

    python -m benchmarks.transitions DATA
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.faces import SETS, expressions
from engine.operators import edges
from engine.restoration import Blender
from engine.types import FloatArray, Mesh

STEPS = 24
MOVING = 0.1  # of the largest displacement
FAR = 0.6  # the same for what counts as the jaw


def way(blender: Blender) -> FloatArray:
    """Positions (steps + 1, n, 3) at even weights."""
    return np.stack([blender.at(np.array([w])) for w in np.linspace(0.0, 1.0, STEPS + 1)])


def vertex_steps(path: FloatArray) -> FloatArray:
    """How far each vertex goes in each step of a path (k, n, 3): (k - 1, n)."""
    return np.linalg.norm(np.diff(path, axis=0), axis=2)


def largest_step(path: FloatArray) -> float:
    """The largest step of any vertex over the mean one, steps being their largest vertex's."""
    largest = vertex_steps(path).max(axis=1)
    return float(largest.max() / largest.mean())


def evenness(path: FloatArray) -> tuple[float, float]:
    step = vertex_steps(path)
    moved = np.linalg.norm(path[-1] - path[0], axis=1)
    own = step[:, moved > MOVING * moved.max()]
    return largest_step(path), float((own.max(axis=0) / own.mean(axis=0)).max())


def shrinkage(mesh: Mesh, end: FloatArray, halfway: FloatArray, share: float) -> float:
    moved = np.linalg.norm(end - mesh.vertices, axis=1)
    ends = edges(mesh.faces)
    ends = ends[(moved[ends] > share * moved.max()).all(axis=1)]
    lengths = [
        np.linalg.norm(x[ends[:, 0]] - x[ends[:, 1]], axis=1) for x in (mesh.vertices, halfway, end)
    ]
    usual = (lengths[0] + lengths[2]) / 2
    return float(1 - lengths[1].sum() / usual.sum())


def plate(count: int = 41) -> Mesh:
    side = np.linspace(-1.0, 1.0, count)
    x, y = (values.ravel() for values in np.meshgrid(side, side))
    k = np.arange(count * (count - 1)).reshape(-1, count)[:, :-1].ravel()
    faces = [np.stack([k, k + 1, k + count + 1], 1), np.stack([k, k + count + 1, k + count], 1)]
    return Mesh(np.stack([x, y, 0.2 * np.cos(2 * x)], axis=1), np.concatenate(faces))


def turned(points: FloatArray, angle: FloatArray, joint: FloatArray) -> FloatArray:
    """Points turned by an angle (n,) each about the x axis through ``joint``."""
    axis = np.zeros((len(angle), 3))
    axis[:, 0] = angle
    return Rotation.from_rotvec(axis).apply(points - joint) + joint


def hinge(name: str, mesh: Mesh, share: FloatArray, degrees: float, joint: FloatArray) -> None:
    """Print the errors halfway of a surface of which each vertex turns by a share of an angle."""
    full = np.radians(degrees) * share
    end, truth = (turned(mesh.vertices, part * full, joint) for part in (1.0, 0.5))
    blender = Blender(mesh, [end])
    still = np.linalg.norm(truth - mesh.vertices, axis=1)
    for label, made in (
        ("default", blender.at(np.array([0.5]))),
        ("linear", (mesh.vertices + end) / 2),
    ):
        off = np.linalg.norm(made - truth, axis=1)
        short = shrinkage(mesh, end, made, FAR)
        print(
            f"{name} by {degrees:.0f}°, {label:8} error halfway {off.mean() / still.mean():6.2%}, "
            f"edges shorter by {short:6.2%}"
        )


def smoothstep(x: FloatArray) -> FloatArray:
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3 - 2 * x)


def hinges() -> None:
    jaw = plate()
    share = smoothstep((-jaw.vertices[:, 1] + 0.1) / 0.4)
    for degrees in (25.0, 45.0, 90.0):
        hinge("jaw", jaw, share, degrees, np.array([0.0, 0.0, -1.0]))
    flat = plate().vertices
    lid = np.stack([np.sin(flat[:, 0]), 0.7 + flat[:, 1] / 2, 0 * flat[:, 0]], axis=1)
    ball = np.stack(
        [lid[:, 0], np.cos(flat[:, 0]) * np.sin(lid[:, 1]), np.cos(flat[:, 0]) * np.cos(lid[:, 1])],
        axis=1,
    )
    mesh = Mesh(ball, plate().faces)
    share = smoothstep((1.2 - lid[:, 1]) / 0.9)
    for degrees in (30.0, 60.0):
        hinge("lid", mesh, share, degrees, np.zeros(3))
        end = turned(ball, np.radians(degrees) * share, np.zeros(3))
        halfway = Blender(mesh, [end]).at(np.array([0.5]))
        for label, made in (("default", halfway), ("linear", (ball + end) / 2)):
            deep = 1 - np.linalg.norm(made, axis=1).min()
            print(f"    {label}: deepest into the eyeball {deep:.2%} of its radius")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    arguments = parser.parse_args()
    hinges()
    for which in SETS:
        mesh, shapes = expressions(arguments.data, which)
        for name, end in shapes.items():
            blender = Blender(mesh, [end])
            path_taken = way(blender)
            whole, own = evenness(path_taken)
            exact = np.array_equal(path_taken[0], mesh.vertices)
            exact &= np.array_equal(path_taken[-1], end)
            middle = path_taken[STEPS // 2]
            ours, chord = (
                shrinkage(mesh, end, made, FAR) for made in (middle, (mesh.vertices + end) / 2)
            )
            print(
                f"{which:14}{name:17} largest step {whole:.2f} x mean, "
                f"of one vertex {own:.2f} x; ends exact: {exact}; edges shorter halfway "
                f"{ours:6.2%}, linear {chord:6.2%}",
                flush=True,
            )


if __name__ == "__main__":
    main()
