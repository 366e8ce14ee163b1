"""What the plane costs: one Beltrami step next to plain scipy, whole maps, small moves; scaling.

A step is: coefficient of a map, assembly, factorisation, two right-hand sides. Plain scipy does it
with vectorised numpy and SuperLU, everything anew; by its default ordering up to 200,000 vertices,
above that by minimum degree on Aᵀ + A without pivoting, where the default takes minutes. One core;
each figure is the fastest of several runs (of one for plain scipy on large meshes).

    python -m benchmarks.plane_speed [ICT_FOLDER] [--parts 1 2 4 12] [--plot scaling.png]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.sparse.linalg import splu

from benchmarks.disk_cases import BUNDLED
from benchmarks.plane_cases import Plane, face_plane
from engine.beltrami import BeltramiSolver, beltrami_coefficient
from engine.quasiconformal import PreparedPlane, QuasiconformalSolver
from engine.types import ComplexArray, IntArray

MINIMUM_DEGREE_FROM = 200_000


def plain_coefficient(z: ComplexArray, faces: IntArray, w: ComplexArray) -> ComplexArray:
    a, b, c = z[faces].T
    u, v, x, y = b - a, c - a, w[faces[:, 1]] - w[faces[:, 0]], w[faces[:, 2]] - w[faces[:, 0]]
    return -(v * x - u * y) / (v.conjugate() * x - u.conjugate() * y)


def plain_step(
    z: ComplexArray, faces: IntArray, w: ComplexArray, fixed: IntArray, values: ComplexArray
) -> ComplexArray:
    """One step as one writes it with numpy and scipy alone."""
    mu = plain_coefficient(z, faces, w)
    corner = z[faces]
    edge = np.roll(corner, -2, axis=1) - np.roll(corner, -1, axis=1)
    area = 0.5 * ((corner[:, 1] - corner[:, 0]).conj() * (corner[:, 2] - corner[:, 0])).imag
    rho, tau = mu.real, mu.imag
    below = 1 - rho**2 - tau**2
    alpha = ((rho - 1) ** 2 + tau**2) / below, -2 * tau / below, ((1 + rho) ** 2 + tau**2) / below
    x, y = -edge.imag / (2 * area[:, None]), edge.real / (2 * area[:, None])
    xx, yy = x[:, :, None] * x[:, None], y[:, :, None] * y[:, None]
    xy = x[:, :, None] * y[:, None] + y[:, :, None] * x[:, None]
    entries = sum((area * k)[:, None, None] * m for k, m in zip(alpha, (xx, xy, yy), strict=True))
    rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, 3).ravel()
    matrix = sp.csc_array((np.ravel(entries), (rows, columns)), shape=(len(z), len(z)))
    free = np.setdiff1d(np.arange(len(z)), fixed)
    below_rows = matrix[free]
    options: dict[str, Any] = {}
    if len(z) > MINIMUM_DEGREE_FROM:
        options = {
            "permc_spec": "MMD_AT_PLUS_A",
            "diag_pivot_thresh": 0.0,
            "options": {"SymmetricMode": True},
        }
    factor = splu(sp.csc_matrix(below_rows[:, free]), **options)
    load = -(below_rows[:, fixed] @ values)
    image = np.empty(len(z), np.complex128)
    image[fixed] = values
    image[free] = factor.solve(load.real) + 1j * factor.solve(load.imag)
    return image


def fastest(job: Callable[[], ComplexArray], runs: int) -> tuple[float, ComplexArray]:
    """Seconds of the fastest of ``runs`` runs, and what the last one gave."""
    best, found = np.inf, np.zeros(0, np.complex128)
    for _ in range(runs):
        start = time.perf_counter()
        found = job()
        best = min(best, time.perf_counter() - start)
    return best, found


def measure_step(plane: Plane, runs: int) -> tuple[float, float]:
    z, faces, fixed = plane.z, plane.faces, plane.points
    values = plane.targets("smile")
    w = QuasiconformalSolver(PreparedPlane(z, faces), fixed).map(values).z
    solver = BeltramiSolver(z[faces], faces, fixed)
    corners = z[faces]

    def ours() -> ComplexArray:
        return solver.solve(beltrami_coefficient(corners, faces, w), values)

    def plain() -> ComplexArray:
        return plain_step(z, faces, w, fixed, values)

    fast, here = fastest(ours, runs + 2)
    slow, there = fastest(plain, runs)
    if np.abs(here - there).max() > 1e-8:
        raise ArithmeticError("the two steps differ")
    return slow, fast


def measure_maps(plane: Plane) -> dict[str, float]:
    """Preparation, every whole map, and a small new move of the smile's points."""
    start = time.perf_counter()
    prepared = PreparedPlane(plane.z, plane.faces)
    _ = prepared.analysis
    seconds = {"prepare": time.perf_counter() - start}
    large = len(plane.z) > MINIMUM_DEGREE_FROM
    for name in plane.truths:
        targets = plane.targets(name)
        times = []
        for _ in range(1 if large else 3):
            solver = QuasiconformalSolver(prepared, plane.points)
            start = time.perf_counter()
            found = solver.map(targets)
            times.append(time.perf_counter() - start)
        print(
            f"    {name:9} {min(times):8.3f} s  solves {found.solves}  folds {len(found.folds)}"
            f"  max|Δν| {found.residuals[-1]:.0e}",
            flush=True,
        )
        seconds[name] = min(times)
    solver = QuasiconformalSolver(prepared, plane.points)
    at = solver.map(plane.targets("smile"))
    times = []
    for share in (1.02, 1.04) if large else (1.02, 1.04, 1.06, 1.08, 1.1):
        targets = plane.targets("smile", share)
        start = time.perf_counter()
        at = solver.map(targets, start=at.z)
        times.append(time.perf_counter() - start)
    seconds["small move"] = float(np.median(times))
    return seconds


def draw(path: Path, sizes: list[int], steps: list[tuple[float, float]], maps: list[float]) -> None:
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.loglog(sizes, [slow for slow, _ in steps], "o-", label="one step, plain scipy")
    axes.loglog(sizes, [fast for _, fast in steps], "o-", label="one step, Quasiface")
    axes.loglog(sizes, maps, "s-", label="whole map to new control points (worst case)")
    axes.set_xlabel("vertices")
    axes.set_ylabel("seconds, one core")
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.legend()
    figure.savefig(path, dpi=120)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=BUNDLED / "ict_face")
    parser.add_argument("--parts", type=int, nargs="+", default=[1, 2, 4, 12])
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    sizes: list[int] = []
    steps: list[tuple[float, float]] = []
    worst: list[float] = []
    for parts in arguments.parts:
        plane = face_plane(arguments.folder, parts)
        sizes.append(len(plane.z))
        large = len(plane.z) > MINIMUM_DEGREE_FROM
        steps.append(measure_step(plane, 1 if large else 7))
        slow, fast = steps[-1]
        print(f"{sizes[-1]} vertices: plain {slow:.4f} s, ours {fast:.4f} s, {slow / fast:.1f} x")
        seconds = measure_maps(plane)
        worst.append(max(seconds[name] for name in plane.truths))
        print(
            f"    prepare {seconds['prepare']:.2f} s, small move {seconds['small move']:.3f} s",
            flush=True,
        )
    if len(sizes) > 2:
        from_20k = [i for i, size in enumerate(sizes) if size >= 20_000]
        slope = np.polyfit(
            np.log(np.take(sizes, from_20k)), np.log([steps[i][1] for i in from_20k]), 1
        )
        print(f"a step takes vertices to the power {slope[0]:.2f}, from {sizes[from_20k[0]]} on")
    if arguments.plot is not None:
        draw(arguments.plot, sizes, steps, worst)


if __name__ == "__main__":
    main()
