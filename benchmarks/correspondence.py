"""How near the correspondence comes to the truth, before anything is made of it.

Mean error / mean displacement after the best rigid alignment, folds, confidence and processor
seconds, for each expression and way; then the summaries of every set, how confidence relates to
the error, there and back, and stability. Without a folder the bundled faces are used.

    python -m benchmarks.correspondence [DATA] [--sets ict_face …] [--only smile …]
        [--ways automatic landmarks] [--rivals] [--noise 0.01] [--reversal] [--stability]
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.correspondence_checks import reversal, variants
from benchmarks.correspondence_tasks import ALL_SETS, BUNDLED, Task, tasks
from benchmarks.correspondence_ways import OURS, RIVALS, answer, placed, turned_faces
from benchmarks.faces import SETS, rigidly_aligned
from engine.errors import EngineError
from engine.types import BoolArray, FloatArray

LARGE = 0.15  # mean displacement from which on an expression is judged by its share, cm
NEAR = 0.02  # of the face's diagonal
SURE = 0.9
FIGURES = re.compile(r"\d+|none")
BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)


@dataclass(frozen=True)
class Row:
    """``error``, ``still`` in the source's unit; ``off`` (n,) per vertex, of the diagonal.

    ``turned`` counts faces of which no vertex is said to be missing from the target.
    """

    task: Task
    way: str
    error: float
    still: float
    turned: int
    turned_sure: int
    seconds: float
    mode: str
    confidence: FloatArray
    off: FloatArray
    valid: BoolArray

    @property
    def share(self) -> float:
        return self.error / self.still

    def __str__(self) -> str:
        known = self.confidence[self.valid]
        sure = self.off[self.valid & (self.confidence >= SURE)]
        near = f"{np.mean(sure <= NEAR):4.0%}" if len(sure) else "   -"
        return (
            f"{self.task.group:14}{self.task.name:24} {self.way:15} {self.share:7.1%} of "
            f"{self.still:.3f} = {self.error:.4f}  turned {self.turned:4} ({self.turned_sure} sure)"
            f"  confidence {known.mean():.2f}, sure {np.mean(known >= SURE):4.0%}, of these near "
            f"{near}  {self.seconds:6.2f} s  {self.mode}"
        )


def judged(task: Task, way: str) -> Row:
    given = answer(task, way)
    source, _ = placed(task.source, task.target)
    on_surface = source.surface.vertex_of
    here = np.flatnonzero(on_surface >= 0)
    vertex = on_surface[here]
    carried = given.places[vertex] / task.scale
    truth, rest = task.truth[here] / task.scale, task.source.mesh.vertices[here]
    valid = task.valid[here]
    error = np.linalg.norm(
        rigidly_aligned(carried[valid], truth[valid]) - truth[valid], axis=1
    ).mean()
    still = np.linalg.norm(rigidly_aligned(rest[valid], truth[valid]) - truth[valid], axis=1).mean()
    turned = turned_faces(source, given)
    least = given.confidence[source.mesh.faces].min(axis=1)
    diagonal = np.linalg.norm(np.ptp(rest, axis=0))
    return Row(
        task,
        way,
        float(error),
        float(still),
        int((turned & (least > 0)).sum()),
        int((turned & (least >= SURE)).sum()),
        given.seconds,
        given.mode,
        given.confidence[vertex],
        np.linalg.norm(carried - truth, axis=1) / diagonal,
        valid,
    )


def summarise(rows: list[Row]) -> None:
    """Per set and way: share of the large expressions, error of the small ones, folds, time."""
    print(
        f"\n{'':16}{'':11}{'large: n, median, worst':>26}{'small: n, median, worst cm':>31}", end=""
    )
    print(f"{'turned':>9}{'seconds':>9}")
    for group, way in dict.fromkeys((row.task.group, row.way) for row in rows):
        mine = [row for row in rows if (row.task.group, row.way) == (group, way)]
        large = [row.share for row in mine if row.still >= LARGE]
        small = [row.error for row in mine if row.still < LARGE]
        shares = f"{len(large):4}{np.median(large):10.1%}{max(large):10.1%}" if large else ""
        errors = f"{len(small):6}{np.median(small):10.3f}{max(small):10.3f}" if small else ""
        turned, seconds = sum(row.turned for row in mine), np.median([row.seconds for row in mine])
        print(f"{group:16}{way:11}{shares:>26}{errors:>31}{turned:9}{seconds:9.2f}")


def print_confidence(rows: list[Row]) -> None:
    """How far points of each confidence are off, and what is said of points that do not exist."""
    print(
        "\nconfidence          share of points   median off   mean off   within 2 % of the diagonal"
    )
    for way in dict.fromkeys(row.way for row in rows):
        mine = [row for row in rows if row.way == way]
        sure = np.concatenate([row.confidence[row.valid] for row in mine])
        off = np.concatenate([row.off[row.valid] for row in mine])
        for low, high in pairwise(BINS):
            these = (sure >= low) & ((sure < high) | (high == 1.0))
            if these.any():
                here = off[these]
                print(
                    f"{way:11}{low:.1f} – {high:.1f}{these.mean():14.1%}{np.median(here):14.3%}"
                    f"{here.mean():11.3%}{np.mean(here <= NEAR):17.1%}"
                )
        absent = [row.confidence[~row.valid] for row in mine if not row.valid.all()]
        if absent:
            missing = np.concatenate(absent)
            print(
                f"{way:11}not on the target: {np.mean(missing < 0.5):.1%} below 0.5, "
                f"{np.mean(missing >= SURE):.1%} sure"
            )


def measured(data: Path, groups: list[str], only: list[str] | None, noise: float) -> list[Task]:
    return [task for group in groups for task in tasks(data, group, noise, only)]


def run_ways(work: list[Task], ways: list[str]) -> list[Row]:
    rows: list[Row] = []
    for task in work:
        for way in ways:
            try:
                rows.append(judged(task, way))
                print(rows[-1], flush=True)
            except EngineError as refusal:
                print(f"{task.group:14}{task.name:24}{way:10}refused: {refusal}", flush=True)
    return rows


def print_reversal(work: list[Task]) -> None:
    print("\nthere and back, deviation / diagonal: median, 95 % quantile, median of what is sure")
    for task in work:
        median, tail, sure = reversal(task)
        print(f"{task.group:14}{task.name:24}{median:8.3%}{tail:8.3%}{sure:8.3%}", flush=True)


def print_stability(work: list[Task], grain: float, noise: float) -> None:
    print("\nerror of changed targets relative to that of the plain one, and modes that differ")
    for task in work:
        plain = judged(task, "automatic")
        print(f"{task.group:14}{task.name:24}{'plain':12}{plain.error:8.4f} cm  {plain.mode}")
        for name, other in variants(task, grain, noise).items():
            row = judged(other, "automatic")
            same = FIGURES.sub("", row.mode) == FIGURES.sub("", plain.mode)
            change = f"{row.error / plain.error - 1:+8.1%}  turned {row.turned}"
            print(
                f"{task.group:14}{task.name:24}{name:12}{change}  {'' if same else row.mode}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, nargs="?", default=BUNDLED)
    parser.add_argument("--sets", nargs="+", choices=ALL_SETS, default=list(ALL_SETS))
    parser.add_argument("--only", nargs="+", help="expressions")
    parser.add_argument("--ways", nargs="*", choices=OURS, default=list(OURS))
    parser.add_argument("--rivals", action="store_true", help="slow")
    parser.add_argument("--noise", type=float, default=0.01, help="of the targets, cm")
    parser.add_argument("--reversal", action="store_true")
    parser.add_argument("--stability", action="store_true")
    arguments = parser.parse_args()
    work = measured(arguments.data, arguments.sets, arguments.only, arguments.noise)
    rows = run_ways(work, arguments.ways + (list(RIVALS) if arguments.rivals else []))
    if rows:
        summarise(rows)
        print_confidence([row for row in rows if row.way in OURS])
    if arguments.reversal:
        print_reversal(work)
    if arguments.stability:
        print_stability([task for task in work if task.group in SETS], arguments.noise, 0.02)


if __name__ == "__main__":
    main()
