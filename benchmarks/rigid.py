"""How well poses and units are found: angle, position and processor seconds for every kind of case.

Next to the paper's iteration and to trimesh's ``icp`` and ``mesh_other``, which are given the unit;
and a study of τ in the form of the paper's Table 1.

    python -m benchmarks.rigid DATA [--kinds complete …] [--only smile …] [--rivals] [--tau]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from benchmarks.faces import pairs
from benchmarks.rigid_cases import KINDS, Case, cases
from engine.errors import RegistrationError
from engine.registration import register
from engine.types import Mesh, Similarity

POSITION = 0.005  # of the source's diagonal, within which a result counts as right, per degree
TAUS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4)

Way = Callable[[Case], Similarity]


@dataclass(frozen=True)
class Outcome:
    """Angle in degrees and RMS displacement of the still part, as a share of the diagonal."""

    degrees: float
    position: float
    seconds: float
    right: bool


def ours(case: Case) -> Similarity:
    return register(case.source, case.target, free_scale=case.free_scale).target_from_source


def paper(case: Case) -> Similarity:
    return _unit_given(
        case, lambda target: register(case.source, target, method="paper").target_from_source
    )


def icp(case: Case) -> Similarity:
    def found(target: Mesh) -> Similarity:
        matrix = trimesh.registration.icp(
            case.source.vertices, target.vertices, reflection=False, scale=False
        )[0]
        return _similarity(matrix)

    return _unit_given(case, found)


def mesh_other(case: Case) -> Similarity:
    def found(target: Mesh) -> Similarity:
        mesh = trimesh.Trimesh(case.source.vertices, case.source.faces, process=False)
        return _similarity(
            trimesh.registration.mesh_other(mesh, target.vertices, reflection=False, seed=0)[0]
        )

    return _unit_given(case, found)


WAYS: dict[str, Way] = {
    "Quasiface": ours,
    "paper": paper,
    "trimesh icp": icp,
    "trimesh mesh_other": mesh_other,
}


def _unit_given(case: Case, find: Callable[[Mesh], Similarity]) -> Similarity:
    scale = case.truth.scale
    found = find(case.target.moved(case.target.vertices / scale))
    return Similarity(found.rotation, scale * found.translation, scale * found.scale)


def _similarity(matrix: np.ndarray) -> Similarity:
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    return Similarity(matrix[:3, :3] / scale, matrix[:3, 3], scale)


def judged(case: Case, way: Way) -> Outcome:
    start = time.process_time()
    try:
        found = way(case)
    except RegistrationError:
        return Outcome(180.0, np.inf, time.process_time() - start, False)
    seconds = time.process_time() - start
    turn = Rotation.from_matrix(found.rotation @ case.truth.rotation.T)
    degrees = float(np.degrees(turn.magnitude()))
    moved = case.truth.inverse()(found(case.still)) - case.still
    diagonal = np.linalg.norm(np.ptp(case.source.vertices, axis=0))
    position = float(np.sqrt((moved**2).sum(axis=1).mean()) / diagonal)
    right = degrees <= case.degrees and position <= POSITION * case.degrees
    return Outcome(degrees, position, seconds, right)


def print_table(data: Path, kinds: list[str], only: list[str] | None, ways: list[str]) -> None:
    outcomes: dict[tuple[str, str], list[Outcome]] = {}
    for case in cases(data, kinds, only):
        for way in ways:
            outcome = judged(case, WAYS[way])
            outcomes.setdefault((way, case.kind), []).append(outcome)
            if way == "Quasiface" and not outcome.right:
                print(
                    f"off: {case.kind}, {case.name}: {outcome.degrees:.2f}°, "
                    f"{outcome.position:.2%} of the diagonal",
                    flush=True,
                )
    print(f"{'':19}{'':13}{'cases':>6}{'right':>7}{'median, worst angle':>21}", end="")
    print(f"{'median, worst position':>24}{'median, worst s':>17}")
    for (way, kind), rows in sorted(outcomes.items(), key=lambda item: ways.index(item[0][0])):
        degrees = np.array([row.degrees for row in rows])
        position = 100 * np.array([row.position for row in rows])
        seconds = np.array([row.seconds for row in rows])
        print(
            f"{way:19}{kind:13}{len(rows):6}{np.mean([row.right for row in rows]):7.0%}"
            f"{np.median(degrees):12.2f}{degrees.max():8.2f}°"
            f"{np.median(position):14.3f}{position.max():9.3f}%"
            f"{np.median(seconds):10.2f}{seconds.max():7.2f}"
        )


def print_tau(data: Path) -> None:
    """MR against τ on the ICT expressions, turned by 3 to 12° and shifted by a tenth."""
    print("\nτ: matching rate, last E_R in source diagonals, iterations, seconds (means)")
    examples = list(pairs(data, "ict_face", noise=0.01))
    for method in ("paper", "default"):
        for tau in TAUS:
            rows: list[tuple[float, ...]] = []
            for pair in examples:
                source = pair.source.mesh
                start = time.process_time()
                found = register(
                    source, pair.target.mesh, method=method, tolerance=tau, max_iterations=500
                )
                seconds = time.process_time() - start
                diagonal = float(np.linalg.norm(np.ptp(source.vertices, axis=0)))
                rows.append(
                    (found.matching_rate, found.rms[-1] / diagonal, found.iterations, seconds)
                )
            rate, error, iterations, seconds = np.mean(rows, axis=0)
            print(f"{method:8} τ {tau:7.0e}  MR {rate:.4f}  E_R {error:.5f}", end="")
            print(f"  {iterations:5.1f} iterations  {seconds:.2f} s", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--only", nargs="+", help="expressions")
    parser.add_argument("--rivals", action="store_true")
    parser.add_argument("--tau", action="store_true", help="the study of τ, too")
    arguments = parser.parse_args()
    ways = list(WAYS) if arguments.rivals else ["Quasiface"]
    print_table(arguments.data, arguments.kinds, arguments.only, ways)
    if arguments.tau:
        print_tau(arguments.data)


if __name__ == "__main__":
    main()
