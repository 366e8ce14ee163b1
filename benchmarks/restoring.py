"""How near a face comes to an expression with 51, 100 and 200 true points, by several ways.

The points are given as ``to`` on top of the automatic correspondence; the 51 are the inner
Multi-PIE landmarks where the set has them. Mean error / mean displacement, both after the best
rigid alignment; next to it the 95th percentile of the error over its mean. ``default`` is the
edit's own mesh, ``look-up`` what the plane map alone reads off the target, the others
know the points alone: Algorithm 5 with W x = W x_source and as printed, and ARAP by libigl.

    python -m benchmarks.restoring DATA [--sets ict_face …] [--only smile …] [--counts 51 100 200]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import igl
import numpy as np

from benchmarks.correspondence import LARGE
from benchmarks.faces import SETS, Pair, pairs, rigidly_aligned, spread_vertices
from engine.controls import ControlPoint, PositionAddress, VertexAddress
from engine.errors import EngineError
from engine.pipeline import EditPlan, Stopwatch, edit
from engine.pipeline.planes import Reading, finely_mapped
from engine.pipeline.values import Edit, Value
from engine.restoration import restore_paper
from engine.types import FloatArray, IntArray

WAYS = ("default", "look-up", "W x = W x0", "W x = 0", "ARAP")


@dataclass(slots=True)
class Keeping(Stopwatch):
    """Remembers what each stage answered last."""

    kept: dict[str, object] = field(default_factory=dict[str, object])

    def run(self, name: str, key: str, work: Callable[[], Value]) -> Value:
        value = Stopwatch.run(self, name, key, work)
        self.kept.setdefault(name, value)
        return value


def points_of(pair: Pair, count: int) -> IntArray:
    return pair.landmarks if count == 51 else spread_vertices(pair.source.mesh.vertices, count)


def edited(pair: Pair, given: IntArray, stages: Keeping) -> Edit:
    points = tuple(
        ControlPoint(
            f"p{vertex}",
            VertexAddress(int(vertex)),
            to={"expression": PositionAddress(tuple(map(float, pair.truth[vertex])))},
        )
        for vertex in given
    )
    return edit(pair.source, {"expression": pair.target}, EditPlan(points=points), stages=stages)


def looked_up(pair: Pair, done: Edit, stages: Keeping) -> FloatArray:
    """The edited plane read off the target; where it cannot be read, the default's own places."""
    (plane,) = stages.kept["control_points"]  # type: ignore[misc]
    disk = done.source.disk.surface
    held = disk.vertex >= 0
    image, readable = done.targets[0].plane.z, held & finely_mapped(done.source)
    places, _ = Reading(plane, readable, np.zeros_like(image)).at(image)
    surface = done.targets[0].surface.copy()
    known = held & (plane.confidence > 0)
    surface[disk.vertex[known]] = places[known]
    on = done.source.surface.vertex_of
    out = done.targets[0].vertices.copy()
    out[on >= 0] = done.source.to_file(surface)[on[on >= 0]]
    return out


def from_points_alone(pair: Pair, given: IntArray, way: str) -> FloatArray:
    mesh, goals = pair.source.mesh, pair.expression[given]
    if way == "ARAP":
        data = igl.ARAPData()
        data.energy = igl.ARAP_ENERGY_TYPE_SPOKES_AND_RIMS
        data.max_iter = 100
        faces = mesh.faces.astype(np.int64)
        igl.arap_precomputation(mesh.vertices, faces, 3, given, data)
        return igl.arap_solve(goals, data, mesh.vertices.copy())
    return restore_paper(mesh, given, goals, detail=way == "W x = W x0")


@dataclass(frozen=True)
class Row:
    still: float
    share: float
    tail: float  # 95th percentile of the error over its mean
    missed: float  # of the diagonal, the farthest given point


def judged(vertices: FloatArray, pair: Pair, given: IntArray) -> Row:
    truth, rest = pair.expression, pair.source.mesh.vertices
    still = np.linalg.norm(rigidly_aligned(rest, truth) - truth, axis=1).mean()
    off = np.linalg.norm(rigidly_aligned(vertices, truth) - truth, axis=1)
    return Row(
        float(still),
        float(off.mean() / still),
        float(np.percentile(off, 95) / off.mean()),
        float(off[given].max() / np.linalg.norm(np.ptp(rest, axis=0))),
    )


def measure(pair: Pair, count: int) -> dict[str, Row]:
    given, stages = points_of(pair, count), Keeping()
    done = edited(pair, given, stages)
    made = {"default": done.targets[0].vertices, "look-up": looked_up(pair, done, stages)}
    made |= {way: from_points_alone(pair, given, way) for way in WAYS[2:]}
    return {way: judged(vertices, pair, given) for way, vertices in made.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--sets", nargs="+", default=list(SETS))
    parser.add_argument("--counts", nargs="+", type=int, default=[51, 100, 200])
    parser.add_argument("--only", nargs="*", help="words of expressions' names")
    arguments = parser.parse_args()
    rows: dict[tuple[str, int, str], list[Row]] = {}
    for which in arguments.sets:
        for pair in pairs(arguments.data, which, only=arguments.only):
            for count in arguments.counts:
                start = time.perf_counter()
                try:
                    found = measure(pair, count)
                except EngineError as error:
                    print(f"{which:13}{pair.name:17}{count:4} refused: {error}", flush=True)
                    continue
                for way, row in found.items():
                    rows.setdefault((which, count, way), []).append(row)
                shown = " ".join(f"{way} {row.share:6.1%}" for way, row in found.items())
                own = found["default"]
                print(
                    f"{which:13}{pair.name:17}{count:4} of {own.still:.3f}: {shown} | p95 "
                    f"{own.tail:.1f} x mean, points {own.missed:.1e}, "
                    f"{time.perf_counter() - start:.1f} s",
                    flush=True,
                )
    summarise(rows)


def summarise(rows: dict[tuple[str, int, str], list[Row]]) -> None:
    """Medians over the expressions that move, per set and over all sets."""
    print(f"\n{'':14}{'points':>7}" + "".join(f"{way:>13}" for way in WAYS) + "   p95 / mean")
    sets = list(dict.fromkeys(which for which, _, _ in rows))
    for which in [*sets, "all"]:
        mine = sets if which == "all" else [which]
        for count in sorted({count for _, count, _ in rows}):
            line, tails = f"{which:14}{count:7}", [0.0]
            for way in WAYS:
                all_rows = [row for one in mine for row in rows.get((one, count, way), [])]
                moving = [row for row in all_rows if row.still >= LARGE]
                line += f"{np.median([row.share for row in moving]):13.1%}" if moving else ""
                if way == "default":
                    tails = [row.tail for row in moving]
            print(f"{line}   {np.median(tails):.1f}, at most {max(tails):.1f}")


if __name__ == "__main__":
    main()
