"""How near an edit brings a face to an expression that it was given as another mesh.

For every expression: folds, control-point residual, seconds per stage, and the mean error to the
truth as a share of the mean displacement; automatic, with 51 points given, without what is known of
faces, and by the paper's literal way, in one run.

    python -m benchmarks.carrying DATA [--sets ict_face pairs "half missing" …]
        [--ways automatic points unaided paper]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from benchmarks.correspondence_tasks import ALL_SETS, Task, tasks
from benchmarks.faces import SETS, rigidly_aligned
from engine.controls import ControlPoint, PositionAddress, VertexAddress
from engine.errors import EngineError
from engine.pipeline import EditPlan, Options, Stopwatch, edit
from engine.types import FloatArray

PAPER = Options(
    registration="paper",
    correspondence="paper",
    parameterization="paper",
    iteration="paper",
    restoration="paper",
    outer_boundary="paper",
    passengers="paper",
)


def given_points(task: Task) -> tuple[ControlPoint, ...]:
    return tuple(
        ControlPoint(
            f"p{vertex}",
            VertexAddress(int(vertex)),
            to={"expression": PositionAddress(tuple(map(float, task.truth[vertex])))},
        )
        for vertex in task.landmarks
    )


def plan_of(way: str, task: Task) -> EditPlan:
    match way:
        case "points":
            return EditPlan(points=given_points(task))
        case "unaided":
            return EditPlan(options=Options(expression_prior="off"))
        case "paper":
            points = tuple(ControlPoint(f"p{v}", VertexAddress(int(v))) for v in task.landmarks)
            return EditPlan(points=points, auto=0, options=PAPER)
        case _:
            return EditPlan()


def relative_error(carried: FloatArray, task: Task) -> tuple[float, float, float]:
    """Mean error, mean displacement (both after rigid alignment), and their ratio."""
    valid = task.valid
    truth, rest = task.truth[valid] / task.scale, task.source.mesh.vertices[valid]
    error, still = (
        float(np.linalg.norm(rigidly_aligned(points, truth) - truth, axis=1).mean())
        for points in (carried[valid], rest)
    )
    return error, still, error / still


def measure(task: Task, way: str) -> dict[str, float]:
    watch = Stopwatch()
    start = time.perf_counter()
    done = edit(task.source, {"expression": task.target}, plan_of(way, task), stages=watch)
    seconds = time.perf_counter() - start
    carried = done.targets[0]
    error, still, share = relative_error(carried.vertices, task)
    return {
        "error": error,
        "still": still,
        "share": share,
        "disk folds": done.source_to_disk.folds,
        "plane folds": len(carried.plane.folds),
        "turned": len(carried.turned_faces),
        "residual": done.frames[-1].control_residual,
        "solves": carried.plane.solves,
        "points": len(done.controls.names),
        "seconds": seconds,
    } | {f"s:{name}": value for name, value in watch.seconds.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--sets", nargs="+", default=list(SETS), choices=ALL_SETS)
    parser.add_argument("--ways", nargs="+", default=["automatic", "points", "paper"])
    parser.add_argument("--noise", type=float, default=0.0, help="of the target, file units")
    parser.add_argument("--only", nargs="*", help="expressions")
    arguments = parser.parse_args()
    for which in arguments.sets:
        shares: dict[str, list[float]] = {way: [] for way in arguments.ways}
        for task in tasks(arguments.data, which, arguments.noise, arguments.only):
            for way in arguments.ways:
                try:
                    row = measure(task, way)
                except EngineError as error:
                    print(f"{which:13} {task.name:25} {way:10} refused: {error}", flush=True)
                    shares[way].append(np.nan)
                    continue
                shares[way].append(row["share"])
                stages = " ".join(f"{k[2:]} {v:.2f}" for k, v in row.items() if k[:2] == "s:")
                print(
                    f"{which:13} {task.name:25} {way:10} {row['share']:6.1%} of {row['still']:.3f}"
                    f" = {row['error']:.4f}"
                    f" | folds {row['disk folds']:.0f} {row['plane folds']:.0f}"
                    f" turned {row['turned']:.0f} residual {row['residual']:.0e}"
                    f" points {row['points']:.0f} solves {row['solves']:.0f}"
                    f" | {row['seconds']:.2f} s: {stages}",
                    flush=True,
                )
        for way, values in shares.items():
            known = np.asarray(values)
            print(
                f"{which} {way}: median {np.nanmedian(known):.1%}, worst {np.nanmax(known):.1%}",
                flush=True,
            )


if __name__ == "__main__":
    main()
