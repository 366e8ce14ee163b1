"""How fast an open edit answers: new weights, weights per point, moves, frames, and of what.

One source of 9,409 vertices with three targets and 14 control points; processor seconds (the
machine may be busy with other work), medians of seven calls.

    python -m benchmarks.instant DATA
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from engine import (
    ControlPoint,
    EditPlan,
    MeshFile,
    OpenEdit,
    PositionAddress,
    Stopwatch,
    VertexAddress,
    open_edit,
    read_mesh,
)
from engine.controls import Address

TARGETS = ("smile", "jaw_open", "surprise")
MIXED = {"smile": 0.5, "jaw_open": 0.3, "surprise": 0.2}
CALLS = 7
PARTS = {
    "gradients blended": "_gradients",
    "Poisson solve": "solve",
    "rotations": "_turns",
    "right side": "load",
    "weights spread": "field",
    "rotations and stretches": "_apart",
    "Poisson factor": "_held",
    "look-up": "_looked_up",
    "back-substitution": "_followed",
    "passengers": "carry",
}


def measured(name: str, work: Callable[[int], object]) -> None:
    """Print the median of some calls, and what the parts took in one more."""
    work(0)
    seconds: list[float] = []
    for number in range(CALLS):
        start = time.process_time()
        work(number)
        seconds.append(time.process_time() - start)
    profile = cProfile.Profile(time.process_time)
    profile.runcall(work, CALLS)
    inside = {key[2]: row[3] for key, row in pstats.Stats(profile).stats.items()}  # type: ignore[attr-defined]
    parts = ", ".join(
        f"{part} {1000 * inside[function]:.1f}"
        for part, function in PARTS.items()
        if inside.get(function, 0.0) > 5e-4
    )
    print(f"{name:34}{1000 * statistics.median(seconds):8.1f} ms  ({parts})", flush=True)


def plan_with(points: tuple[ControlPoint, ...], number: int) -> EditPlan:
    """The mixed expression, a little different in each call."""
    weights = {name: weight + 0.01 * number for name, weight in MIXED.items()}
    return EditPlan(points=points, weights=weights)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    folder = parser.parse_args().data / "ict_face"
    landmarks = json.loads((folder / "landmarks.json").read_text())["multi_pie_68"]
    points = tuple(
        ControlPoint(f"p{number}", VertexAddress(landmarks[number])) for number in range(17, 68, 4)
    )
    source = read_mesh(folder / "A_neutral.ply")
    targets = {name: read_mesh(folder / f"A_{name}.ply") for name in TARGETS}
    watch = Stopwatch()
    start = time.process_time()
    opened = open_edit(source, targets, EditPlan(points=points), stages=watch)
    print(f"opening: {time.process_time() - start:.1f} s")
    talk(opened, points)
    retarget(source, targets, points)


def talk(opened: OpenEdit, points: tuple[ControlPoint, ...]) -> None:
    """Everything that is asked of an edit again and again."""
    measured("new weights", lambda n: opened.meshes(plan_with(points, n)))
    smiling = tuple(replace(p, weights={"smile": 0.2 + 0.1 * i}) for i, p in enumerate(points[:5]))
    own = smiling + points[5:]
    measured("new weights of 5 points", lambda n: opened.meshes(plan_with(own, n)))
    measured("24 frames", lambda n: opened.meshes(replace(plan_with(points, n), frames=24)))

    def moved(number: int) -> EditPlan:
        shift = 0.2 + 0.05 * np.sin(number + np.arange(3 * len(points))).reshape(-1, 3)
        moving = tuple(
            replace(point, move=tuple(map(float, by)))
            for point, by in zip(points, shift, strict=True)
        )
        return plan_with(moving, 0)

    opened.meshes(moved(0))
    measured("new moves of 13 points, weights kept", lambda n: opened.meshes(moved(n)))
    print("and with planes, histograms, distances:")
    measured("new weights", lambda n: opened.edit(plan_with(points, n)))


def retarget(
    source: MeshFile, targets: dict[str, MeshFile], points: tuple[ControlPoint, ...]
) -> None:
    """Points that have a place on every target get other places there."""

    def placed(number: int, names: Sequence[str], count: int) -> EditPlan:
        sent: list[ControlPoint] = []
        for index, point in enumerate(points):
            to: dict[str, Address] = {}
            for name, file in targets.items():
                place = file.mesh.vertices[point.at.vertex]  # type: ignore[union-attr]
                if name in names and index < count:
                    place = place + 0.05 * np.sin(number + np.arange(3) + index)
                to[name] = PositionAddress((float(place[0]), float(place[1]), float(place[2])))
            sent.append(replace(point, to=to))
        return plan_with(tuple(sent), 0)

    opened = open_edit(source, targets, placed(0, (), 0))
    one, all_ = TARGETS[:1], len(points)
    measured("new place of a point on a target", lambda n: opened.meshes(placed(n + 1, one, 1)))
    measured("of 13 points on a target", lambda n: opened.meshes(placed(n + 1, one, all_)))
    measured("of 13 points on 3 targets", lambda n: opened.meshes(placed(n + 1, TARGETS, all_)))


if __name__ == "__main__":
    main()
