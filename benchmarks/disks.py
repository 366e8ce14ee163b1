"""Disk maps next to libigl's: angle distortion, folds, seconds; a census of folds; timings.

Angle distortion is the mean of |angle on the surface - angle in the plane| over all corners, in
degrees: of the surface's own faces, and of those that close its holes as well. Folds are faces
whose signed area is not positive, decided exactly.

    python -m benchmarks.disks [DATA] [--face scan.ply] [--parts quality census timings]

Without DATA (a folder of same-topology sets and other meshes) the bundled faces are measured.
Needs the ``bench`` extra.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable
from fractions import Fraction
from itertools import chain
from pathlib import Path

import igl
import numpy as np

from benchmarks.disk_cases import BUNDLED, closed, combinations, files, fillings, refined
from engine.errors import EngineError
from engine.io import read_mesh
from engine.parameterization import disk_map
from engine.topology import disk_surface, editable_surface
from engine.types import ComplexArray, DiskSurface, FloatArray, IntArray, Surface

Mapper = Callable[[DiskSurface], ComplexArray]


def harmonic(disk: DiskSurface) -> ComplexArray:
    """libigl: boundary by arc length on the circle, interior harmonic."""
    vertices, loop = np.asfortranarray(disk.mesh.vertices), disk.boundary
    circle = igl.map_vertices_to_circle(vertices, loop.astype(np.int32))
    z = igl.harmonic(disk.mesh.vertices, disk.mesh.faces, loop, np.ascontiguousarray(circle), 1)
    return z[:, 0] + 1j * z[:, 1]


def least_squares_conformal(disk: DiskSurface) -> ComplexArray:
    """libigl: LSCM with two opposite boundary vertices pinned; its image is no disk."""
    pins = disk.boundary[[0, len(disk.boundary) // 2]]
    places = np.array([[0.0, 0.0], [1.0, 0.0]])
    z, _ = igl.lscm(disk.mesh.vertices, disk.mesh.faces, pins, places)
    return z[:, 0] + 1j * z[:, 1]


MAPS: dict[str, Mapper] = {
    "plain": lambda disk: disk_map(disk).z,
    "polished": lambda disk: disk_map(disk, polish=True).z,
    "paper": lambda disk: disk_map(disk, method="paper").z,
    "igl harmonic": harmonic,
    "igl LSCM": least_squares_conformal,
}


def angles(points: FloatArray, faces: IntArray) -> FloatArray:
    corner = points[faces]
    ahead, back = np.roll(corner, -1, 1) - corner, np.roll(corner, 1, 1) - corner
    size = np.linalg.norm(np.cross(ahead, back), axis=2)
    return np.degrees(np.arctan2(size, (ahead * back).sum(axis=2)))


def distortion(disk: DiskSurface, z: ComplexArray) -> tuple[float, float]:
    """Over the surface's own faces, and over all."""
    plane = np.stack([z.real, z.imag, 0 * z.real], axis=1)
    faces = disk.mesh.faces
    change = np.abs(angles(disk.mesh.vertices, faces) - angles(plane, faces))
    return float(change[: len(disk.face)].mean()), float(change.mean())


def folds(z: ComplexArray, faces: IntArray) -> int:
    a, b, c = z[faces].T
    area = (b - a).real * (c - a).imag - (b - a).imag * (c - a).real
    near = np.flatnonzero(np.abs(area) <= 1e-14 * np.abs(b - a) * np.abs(c - a))
    folded = area < 0
    for face in near:
        (p, q), (r, s), (u, v) = (
            (Fraction(float(w.real)), Fraction(float(w.imag))) for w in z[faces[face]]
        )
        folded[face] = (r - p) * (v - q) <= (s - q) * (u - p)
    return int(folded.sum())


def timed(mapper: Mapper, disk: DiskSurface, repeats: int) -> tuple[ComplexArray, float]:
    """The map, and the least of some times after the first."""
    z, best = mapper(disk), np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        mapper(disk)
        best = min(best, time.perf_counter() - start)
    return z, best


def quality(name: str, surface: Surface) -> None:
    for filling, disk in fillings(surface):
        for way, mapper in MAPS.items():
            try:
                z, seconds = timed(mapper, disk, 3)
            except EngineError as error:
                print(f"{name:34} {filling:8} {way:13} refused: {error}", flush=True)
                continue
            own, every = distortion(disk, z)
            print(
                f"{name:34} {len(disk.mesh.vertices):7} {filling:8} {way:13}"
                f" angles {own:6.3f} {every:6.3f} folds {folds(z, disk.mesh.faces):4}"
                f" {1e3 * seconds:8.1f} ms",
                flush=True,
            )


def census(name: str, surface: Surface, counts: Counter[tuple[str, str]]) -> None:
    """Count the maps of one surface, those that fold, their folds and refusals."""
    for filling, disk in fillings(surface):
        for way in ("plain", "polished", "paper", "igl harmonic"):
            if filling == "kept" and way == "igl harmonic":
                continue
            group = f"{filling} {way}"
            counts[group, "maps"] += 1
            try:
                z = MAPS[way](disk)
            except EngineError as error:
                counts[group, "refused"] += 1
                print(f"{name} {group} refused: {error}", flush=True)
                continue
            folded = folds(z, disk.mesh.faces)
            counts[group, "folded maps"] += folded > 0
            counts[group, "folds"] += folded


def print_census(title: str, counts: Counter[tuple[str, str]]) -> None:
    for group in dict.fromkeys(group for group, _ in counts):
        print(
            f"{title:14} {group:22}"
            + "".join(
                f" {what} {counts[group, what]:6}"
                for what in ("maps", "folded maps", "folds", "refused")
            ),
            flush=True,
        )


def timings(name: str, surface: Surface) -> None:
    """As it is, and refined to about 10^5 and 10^6 vertices."""
    start = disk_surface(surface)
    for size in (0, 1e5, 1e6):
        parts = max(1, round((size / len(start.mesh.vertices)) ** 0.5))
        disk = refined(start.mesh, parts) if parts > 1 else start
        for way in ("plain", "polished", "igl harmonic"):
            if way == "polished" and size == 1e6:
                continue
            z, seconds = timed(MAPS[way], disk, 1 if size == 1e6 else 3)
            count = folds(z, disk.mesh.faces)
            print(
                f"{name:34} {len(z):8} vertices {way:13} {1e3 * seconds:9.1f} ms folds {count}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--face", type=Path, nargs="*", default=[])
    parser.add_argument("--parts", nargs="+", default=["quality", "census", "timings"])
    parser.add_argument("--combinations", type=int, default=200)
    arguments = parser.parse_args()
    folder: Path = arguments.data or BUNDLED
    given = [(path.name, editable_surface(read_mesh(path).mesh)[0]) for path in arguments.face]
    neutral = ((name, surface) for name, surface in files(folder) if "neutral" in name)
    if "quality" in arguments.parts:
        for name, surface in chain(given, neutral):
            quality(name, surface)
    if "census" in arguments.parts:
        for title, surfaces in (
            ("files", chain(given, files(folder))),
            ("closed", ((name, whole) for name, one in files(folder) if (whole := closed(one)))),
            ("combinations", combinations(folder, arguments.combinations)),
        ):
            counts: Counter[tuple[str, str]] = Counter()
            for name, surface in surfaces:
                census(name, surface, counts)
            print_census(title, counts)
    if "timings" in arguments.parts:
        for name, surface in [*given, next(files(BUNDLED))]:
            timings(name, surface)


if __name__ == "__main__":
    main()
