"""The plane of a face under expressions: landmarks and true places, at several resolutions.

The face is the front of the ICT face (vertices 0 to 6705, its "narrow face area"), its holes closed
with minimal area. The plane is its conformal disk; the circle stays fixed, so an expression's own
plane, the truth, is harmonic under the same circle. 51 Multi-PIE landmarks and 20 spread points are
sent where the truth has them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.disk_cases import refined
from engine.io import read_mesh
from engine.linalg import FixedSolver
from engine.operators import weighted_laplacian
from engine.parameterization import disk_map
from engine.parameterization._conformal import delaunay_weights
from engine.topology import disk_surface, editable_surface
from engine.types import ComplexArray, DiskSurface, FloatArray, IntArray, Mesh

NARROW = 6706
SPREAD = 20


@dataclass(frozen=True)
class Plane:
    """``z`` (n,) with ``faces``; the first ``len(boundary)`` of ``points`` are the circle's."""

    z: ComplexArray
    faces: IntArray
    boundary: IntArray
    inner: IntArray
    spread: IntArray
    truths: dict[str, ComplexArray]

    @property
    def points(self) -> IntArray:
        return np.concatenate([self.boundary, self.inner, self.spread])

    def targets(self, name: str, share: float = 1.0) -> ComplexArray:
        """Where the points go: ``share`` of the way to the truth, the circle's nowhere."""
        here, there = self.z[self.points], self.truths[name][self.points]
        there[: len(self.boundary)] = here[: len(self.boundary)]
        return here + share * (there - here)

    def twisted(self, degrees: float) -> tuple[IntArray, ComplexArray]:
        """The circle and the inner landmarks alone, these turned about their centre."""
        rim, inner = self.z[self.boundary], self.z[self.inner]
        turned = (inner - inner.mean()) * np.exp(1j * np.radians(degrees)) + inner.mean()
        return np.concatenate([self.boundary, self.inner]), np.concatenate([rim, turned])


def expressions(folder: Path) -> Iterator[tuple[str, FloatArray]]:
    """Vertices of the neutral face, then of the expressions that the folder's files give."""
    rest, *_ = (read_mesh(folder / "A_neutral.ply").mesh.vertices[:NARROW],)
    yield "neutral", rest

    def moves(name: str) -> FloatArray | None:
        path = folder / f"A_{name}.ply"
        return read_mesh(path).mesh.vertices[:NARROW] - rest if path.exists() else None

    jaw, smile, blink, surprise = (moves(x) for x in ("jaw_open", "smile", "blink", "surprise"))
    if jaw is None or smile is None:
        return
    yield "jaw open", rest + jaw
    yield "smile", rest + smile
    if blink is None or surprise is None:
        yield "mix", rest + 0.5 * jaw + 0.5 * smile
        return
    brows = 0.5 * (surprise - 0.7 * jaw)
    yield "brows", rest + brows
    yield "blink", rest + blink
    yield "mix", rest + 0.5 * jaw + 0.5 * smile + brows + 0.5 * blink


def face_disk(folder: Path) -> DiskSurface:
    """The narrow face of the neutral file, its holes closed."""
    mesh = read_mesh(folder / "A_neutral.ply").mesh
    narrow = mesh.faces[(mesh.faces < NARROW).all(axis=1)]
    surface, _ = editable_surface(Mesh(mesh.vertices[:NARROW], narrow))
    disk = disk_surface(surface)
    if not np.array_equal(surface.vertex_of[disk.vertex], np.arange(NARROW)):
        raise ValueError("the narrow face is not a surface of its own")
    return disk


def face_plane(folder: Path, parts: int) -> Plane:
    """The plane of the neutral face, every triangle's sides in ``parts`` parts."""
    coarse = face_disk(folder)
    shapes = dict(expressions(folder))
    disk = refined(coarse.mesh, parts)
    z = disk_map(disk).z
    named = json.loads((folder / "landmarks.json").read_text())["multi_pie_68"][17:]
    inner = _same_places(disk.mesh.vertices, coarse.mesh.vertices[named])
    truths = {
        name: _harmonic(refined(coarse.mesh.moved(shape), parts).mesh, disk.boundary, z)
        for name, shape in shapes.items()
        if name != "neutral"
    }
    return Plane(z, disk.mesh.faces, disk.boundary, inner, _spread(z, inner), truths)


def _harmonic(mesh: Mesh, boundary: IntArray, z: ComplexArray) -> ComplexArray:
    faces, weights = delaunay_weights(mesh)
    laplacian = weighted_laplacian(faces, weights, len(mesh.vertices))
    return FixedSolver(laplacian, boundary).solve(z[boundary])


def _same_places(vertices: FloatArray, places: FloatArray) -> IntArray:
    return np.array([int(((vertices - place) ** 2).sum(axis=1).argmin()) for place in places])


def _spread(z: ComplexArray, inner: IntArray) -> IntArray:
    away = np.minimum(1 - np.abs(z), np.abs(z[:, None] - z[inner]).min(axis=1))
    chosen: list[int] = []
    while len(chosen) < SPREAD:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.abs(z - z[chosen[-1]]))
    return np.array(chosen)
