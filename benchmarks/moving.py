"""Direct moves: random ones that must not break the face, and expressions from few handles.

Random: one to five points of a face are sent up to a tenth of its diagonal away, six fixed points
stay; inverted and collapsed triangles are counted, and how far points end from their goals.
Handles: 10, 20 and 51 points of a face are put where an expression has them; the mean error of the
rest over the mean displacement, log area and angle change, and turned triangles, next to editing by
the Laplacian, by differential coordinates and by ARAP (the last by libigl).

    python -m benchmarks.moving DATA [--sets ict_face …]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import igl
import numpy as np
import scipy.sparse as sp

from benchmarks.correspondence import LARGE
from benchmarks.faces import SETS, expression_files, inner_landmarks, spread_vertices
from engine.errors import RestorationError
from engine.io import read_mesh
from engine.linalg import FixedSolver
from engine.operators import cotangent_laplacian, face_areas, vertex_areas
from engine.restoration import Restorer, turned_faces
from engine.types import FloatArray, IntArray, Mesh, SurfacePoints

MOVES = 60
FARTHEST = 0.1  # of the diagonal
COUNTS = (10, 20, 51)
WAYS = ("default", "Laplacian", "differential", "ARAP")


def at_vertices(mesh: Mesh, vertices: IntArray) -> SurfacePoints:
    face_of = np.zeros(len(mesh.vertices), dtype=np.int64)
    face_of[mesh.faces.ravel()] = np.repeat(np.arange(len(mesh.faces)), 3)
    face = face_of[vertices]
    return SurfacePoints(face, (mesh.faces[face] == vertices[:, None]).astype(float))


def random_moves(mesh: Mesh, which: str) -> None:
    restorer = Restorer(mesh)
    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    random = np.random.default_rng(0)
    used = np.unique(mesh.faces)
    turned, broken, missed, refused = 0, 0, 0.0, 0
    for _ in range(MOVES):
        chosen = random.choice(used, 6 + random.integers(1, 6), replace=False)
        fixed, moving = at_vertices(mesh, chosen[:6]), at_vertices(mesh, chosen[6:])
        way = random.normal(size=(len(moving), 3))
        way *= FARTHEST * diagonal * random.random() / np.linalg.norm(way, axis=1, keepdims=True)
        goal = mesh.vertices[chosen[6:]] + way
        try:
            made = restorer.deform(moving, goal, fixed=fixed)
        except RestorationError:
            refused += 1
            continue
        bad = len(turned_faces(mesh, mesh.vertices, made))
        turned, broken = turned + bad, broken + (bad > 0)
        off = np.concatenate([made[chosen[6:]] - goal, (made - mesh.vertices)[chosen[:6]]])
        missed = max(missed, float(np.abs(off).max()) / diagonal)
    print(
        f"{which:14}{MOVES} random moves: {turned} inverted or collapsed triangles in {broken} of "
        f"them, {refused} refused, points off by at most {missed:.0e} of the diagonal",
        flush=True,
    )


def by_laplacian(mesh: Mesh, handles: IntArray, goals: FloatArray, details: bool) -> FloatArray:
    """Bilaplacian of the displacement, or of the position with the source's own as right side."""
    L = cotangent_laplacian(mesh)
    if details:
        solver = FixedSolver(sp.csr_array(L.T @ L), handles)
        return solver.solve(goals, source=L.T @ (L @ mesh.vertices))
    area = vertex_areas(mesh)
    mass = sp.diags_array(1.0 / np.maximum(area, 1e-3 * area.mean()))
    solver = FixedSolver(sp.csr_array(L.T @ mass @ L), handles)
    return mesh.vertices + solver.solve(goals - mesh.vertices[handles])


def edited(mesh: Mesh, restorer: Restorer, handles: IntArray, goals: FloatArray, way: str):
    match way:
        case "default":
            return restorer.deform(at_vertices(mesh, handles), goals)
        case "ARAP":
            data = igl.ARAPData()
            data.max_iter = 100
            igl.arap_precomputation(mesh.vertices, mesh.faces.astype(np.int64), 3, handles, data)
            return igl.arap_solve(goals, data, mesh.vertices.copy())
        case _:
            return by_laplacian(mesh, handles, goals, way == "differential")


def angles(mesh: Mesh) -> FloatArray:
    corner = mesh.vertices[mesh.faces]
    a, b = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=2), (a * b).sum(axis=2))


def distortion(mesh: Mesh, made: FloatArray) -> tuple[float, float, int]:
    """Mean |log area ratio|, mean angle change in degrees, turned triangles."""
    area, new = face_areas(mesh), face_areas(mesh.moved(made))
    good = (area > 0) & (new > 0)
    stretch = float(np.average(np.abs(np.log(new[good] / area[good])), weights=area[good]))
    turn = np.abs(angles(mesh.moved(made)) - angles(mesh)).mean(axis=1)
    return (
        stretch,
        float(np.degrees(np.average(turn, weights=area))),
        len(turned_faces(mesh, mesh.vertices, made)),
    )


def expressions(data: Path, which: str) -> None:
    neutral, files = expression_files(data, which)
    if neutral is None:
        return
    source = read_mesh(neutral)
    mesh, restorer = source.mesh, Restorer(source.mesh)
    random_moves(mesh, which)
    landmarks = inner_landmarks(neutral.parent, source)
    for count in COUNTS:
        order = spread_vertices(mesh.vertices[landmarks], count)
        handles = landmarks[order]
        rows: dict[str, list[tuple[float, ...]]] = {way: [] for way in WAYS}
        for path in files.values():
            truth = read_mesh(path).mesh.vertices
            still = np.linalg.norm(truth - mesh.vertices, axis=1).mean()
            if still < LARGE:
                continue
            for way in WAYS:
                made = edited(mesh, restorer, handles, truth[handles], way)
                error = np.linalg.norm(made - truth, axis=1).mean() / still
                rows[way].append((float(error), *distortion(mesh, made)))
        for way, found in rows.items():
            error, area, angle, _ = np.median(np.array(found), axis=0)
            folds = sum(int(row[3]) for row in found)
            print(
                f"{which:14}{count:3} handles, {len(found)} expressions {way:14}{error:7.1%}, area "
                f"{area:.3f}, angles {angle:4.1f}°, {folds} turned",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--sets", nargs="+", default=list(SETS))
    arguments = parser.parse_args()
    for which in arguments.sets:
        expressions(arguments.data, which)


if __name__ == "__main__":
    main()
