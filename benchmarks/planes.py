"""Quasi-conformal maps of a face's plane: the anchor cases by every method, and large moves.

Steps, folds (signed, exact), max |μ|, area-weighted spread of |μ|, mean distance to the true
places, seconds. "paper" and "paper_teichmueller" run to 1e-3 or 150 steps. libigl's harmonic map
through the same points stands beside them: it has no folds test and no notion of μ.

    python -m benchmarks.planes [ICT_FOLDER] [--parts 1 2] [--pictures docs/pictures]

ICT_FOLDER holds ``A_neutral.ply`` and expressions; without it the bundled faces (which lack brows
and blink) are measured. Needs the ``bench`` extra.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import get_args

import igl
import numpy as np

from benchmarks.disk_cases import BUNDLED
from benchmarks.plane_cases import Plane, face_plane
from benchmarks.plane_picture import draw_map
from engine.beltrami import beltrami_coefficient, folds, triangle_areas
from engine.errors import QuasiconformalError
from engine.quasiconformal import Method, PreparedPlane, QuasiconformalSolver
from engine.types import ComplexArray, IntArray

LITERAL = {"paper", "paper_teichmueller"}


def spread(plane: Plane, mu: ComplexArray) -> float:
    area, size = triangle_areas(plane.z[plane.faces]), np.abs(mu)
    mean = np.average(size, weights=area)
    return float(np.sqrt(np.average((size - mean) ** 2, weights=area)) / mean)


def row(name: str, method: str, plane: Plane, w: ComplexArray, more: str) -> str:
    mu = beltrami_coefficient(plane.z[plane.faces], plane.faces, w)
    count = len(folds(plane.z[plane.faces], plane.faces, w))
    finite = mu[np.isfinite(mu)]
    line = (
        f"{name:10} {method:18} folds {count:4d}  max|μ| {np.abs(finite).max():6.3f}"
        f"  spread {spread(plane, np.where(np.isfinite(mu), mu, 1)):5.2f}"
    )
    if name in plane.truths:
        line += f"  distance {np.abs(w - plane.truths[name]).mean():.5f}"
    return f"{line}  {more}"


def libigl_harmonic(plane: Plane, points: IntArray, targets: ComplexArray) -> ComplexArray:
    flat = np.stack([plane.z.real, plane.z.imag, 0 * plane.z.real], axis=1)
    places = np.stack([targets.real, targets.imag], axis=1)
    w = igl.harmonic(flat, plane.faces, points, places, 1)
    return w[:, 0] + 1j * w[:, 1]


def anchors(plane: Plane, pictures: Path | None) -> None:
    prepared = PreparedPlane(plane.z, plane.faces)
    for name in plane.truths:
        targets = plane.targets(name)
        for method in get_args(Method):
            options = {"tolerance": 1e-3, "max_solves": 150} if method in LITERAL else {}
            solver = QuasiconformalSolver(prepared, plane.points, method=method, **options)
            solver.map(targets) if method == "default" else None
            start = time.perf_counter()
            found = solver.map(targets)
            seconds = time.perf_counter() - start
            last = found.residuals[-1]
            state = "converged" if found.converged else f"max|Δν| {last:.0e}"
            more = f"solves {found.solves:3d} {state}  {seconds:.3f} s"
            print(row(name, method, plane, found.z, more), flush=True)
            if method == "default" and pictures is not None:
                path = pictures / f"plane-{name.replace(' ', '-')}.png"
                draw_map(path, plane, found, plane.points[len(plane.boundary) :])
        start = time.perf_counter()
        w = libigl_harmonic(plane, plane.points, targets)
        print(row(name, "igl harmonic", plane, w, f"{time.perf_counter() - start:.3f} s"))


def large_moves(plane: Plane) -> None:
    prepared = PreparedPlane(plane.z, plane.faces)
    jaw = plane.targets("jaw open", 1.6)
    inside = np.where(np.abs(jaw) > 0.985, jaw / np.maximum(np.abs(jaw), 1e-9) * 0.985, jaw)
    rim = len(plane.boundary)
    inside[:rim] = jaw[:rim]
    here = plane.z[plane.points]
    near, far = here.copy(), here.copy()
    near[[rim + 20, rim + 21]] = here[[rim + 21, rim + 20]]
    far[[rim, rim + 5]] = here[[rim + 5, rim]]
    cases = {
        "jaw x1.3": (plane.points, plane.targets("jaw open", 1.3)),
        "jaw x1.6": (plane.points, jaw),
        "... inside": (plane.points, inside),
        "jaw x3": (plane.points, plane.targets("jaw open", 3.0)),
        "swap near": (plane.points, near),
        "swap far": (plane.points, far),
    }
    for degrees in (30, 60, 90, 120, 150, 180):
        cases[f"twist {degrees}"] = plane.twisted(degrees)
    for name, (points, targets) in cases.items():
        solver = QuasiconformalSolver(prepared, points)
        start = time.perf_counter()
        try:
            found = solver.map(targets)
        except QuasiconformalError as error:
            took = time.perf_counter() - start
            named = error.elements.get("points", [])
            print(f"{name:10} refused in {took:.3f} s: {error.code}, points {named}", flush=True)
            continue
        took = time.perf_counter() - start
        state = "" if found.converged else f", max|Δν| {found.residuals[-1]:.0e}"
        more = f"solves {found.solves}{state}  {took:.3f} s"
        print(row(name, "default", plane, found.z, more), flush=True)
        w = libigl_harmonic(plane, points, targets)
        print(row(name, "igl harmonic", plane, w, ""), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=BUNDLED / "ict_face")
    parser.add_argument("--parts", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    for parts in arguments.parts:
        plane = face_plane(arguments.folder, parts)
        print(f"\n{len(plane.z)} vertices, {len(plane.points) - len(plane.boundary)} points")
        anchors(plane, arguments.pictures if parts == arguments.parts[0] else None)
        if parts == 1:
            print()
            large_moves(plane)


if __name__ == "__main__":
    main()
