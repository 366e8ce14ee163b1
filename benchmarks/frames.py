"""Whether a face lands in the same frame, however it is triangulated.

Every surface is remeshed in several ways, then shuffled, turned, shifted and scaled. Its vertices
are laid on the copy; how far apart are their places in the two planes (radius 1)? Single vertices
in deep pockets, whose nearest point of the copy is on another wall, stay in. Heads whose neck is
open count twice: as they are, and closed, so that the disk has to open them.

    python -m benchmarks.frames DATA [--only WORD ...] [--seeds 2] [--method paper]

Needs the ``bench`` extra.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter
from typing import Literal

import numpy as np
import pymeshlab
from scipy.spatial.transform import Rotation

from benchmarks.disk_cases import closed, files
from engine.locate import PointLocator
from engine.operators import face_areas
from engine.parameterization import disk_map
from engine.topology import disk_surface, editable_surface
from engine.types import BoolArray, DiskMap, FloatArray, IntArray, Mesh, Surface

NOISE = 5e-4  # of the square root of the area: about 0.2 mm on a head


def meshlab(change: Callable[[pymeshlab.MeshSet], None]) -> Callable[[Mesh], Mesh]:
    def changed(mesh: Mesh) -> Mesh:
        work = pymeshlab.MeshSet()
        work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
        change(work)
        made = work.current_mesh()
        return Mesh(made.vertex_matrix(), made.face_matrix().astype(np.int64))

    return changed


def isotropic(mesh: Mesh, share: float) -> Mesh:
    edge = float(np.sqrt(face_areas(mesh).sum() / (share * len(mesh.vertices)) / 0.866))
    return meshlab(
        lambda work: work.meshing_isotropic_explicit_remeshing(
            iterations=6, targetlen=pymeshlab.PureValue(edge), featuredeg=30
        )
    )(mesh)


def decimated(mesh: Mesh) -> Mesh:
    return meshlab(
        lambda work: work.meshing_decimation_quadric_edge_collapse(
            targetfacenum=len(mesh.faces) // 2, preservetopology=True, preserveboundary=True
        )
    )(mesh)


def halved(mesh: Mesh) -> Mesh:
    """Every edge halved, nothing moved."""
    return meshlab(
        lambda work: work.meshing_surface_subdivision_midpoint(
            iterations=1, threshold=pymeshlab.PureValue(0.0)
        )
    )(mesh)


COPIES: dict[str, Callable[[Mesh], Mesh]] = {
    "same": lambda mesh: mesh,
    "noise": lambda mesh: mesh,
    "midpoints x4": halved,
    "quadric x0.5": decimated,
    "isotropic x0.5": lambda mesh: isotropic(mesh, 0.5),
    "isotropic x1": lambda mesh: isotropic(mesh, 1.0),
    "isotropic x1 noise": lambda mesh: isotropic(mesh, 1.0),
    "isotropic x2": lambda mesh: isotropic(mesh, 2.0),
}


def moved(mesh: Mesh, seed: int, noise: float) -> tuple[Mesh, Callable[[FloatArray], FloatArray]]:
    """Shuffled, turned, shifted and scaled; and where points go that lie on the mesh."""
    random = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    scale, shift = 10 ** random.uniform(-2, 2), random.normal(size=3)
    order = random.permutation(len(mesh.vertices))
    faces = np.argsort(order)[mesh.faces][random.permutation(len(mesh.faces))]
    size = noise * np.sqrt(face_areas(mesh).sum())
    rough = mesh.vertices[order] + size * random.normal(size=(len(order), 3))

    def carried(points: FloatArray) -> FloatArray:
        return scale * (points @ turn.T + shift)

    return Mesh(carried(rough), faces), carried


def apart(
    one: tuple[Surface, DiskMap],
    other: tuple[Surface, DiskMap],
    carried: Callable[[FloatArray], FloatArray],
) -> tuple[FloatArray, BoolArray]:
    """For vertices (k,) that both disks have: how far apart, and whether they lie in faces at the
    boundary of either."""
    plane, copy = one[1], other[1]
    used = np.unique(own_faces(plane))
    points = carried(plane.surface.mesh.vertices[used])
    there, _ = PointLocator(other[0].mesh).nearest(points)
    both = np.isin(there.face, copy.surface.face)
    own = Mesh(copy.surface.mesh.vertices, own_faces(copy))
    found, _ = PointLocator(own).nearest(points)
    z = np.einsum("ki,ki->k", found.barycentric, copy.z[own.faces[found.face]])
    edge = np.zeros(len(plane.z), dtype=np.bool_)
    edge[own_faces(plane)[at_edge(plane)]] = True
    edge = edge[used] | at_edge(copy)[found.face]
    return np.abs(z - plane.z[used])[both], edge[both]


def own_faces(plane: DiskMap) -> IntArray:
    return plane.surface.mesh.faces[: len(plane.surface.face)]


def at_edge(plane: DiskMap) -> BoolArray:
    """Which of the surface's own faces (m,) have a vertex on the boundary."""
    return np.isin(own_faces(plane), plane.surface.boundary).any(axis=1)


def mapped(mesh: Mesh, method: Literal["default", "paper"]) -> tuple[Surface, DiskMap, float]:
    surface, _ = editable_surface(mesh)
    best = np.inf
    for _ in range(2):
        start = perf_counter()
        plane = disk_map(disk_surface(surface), method=method)
        best = min(best, perf_counter() - start)
    return surface, plane, best


def cases(folder: Path) -> Iterator[tuple[str, Mesh]]:
    """Neutral heads, masks and scans, and closed what has one loop only."""
    for name, surface in files(folder):
        if "awkward" in name or "_head_" in name or "pairs" in name:
            continue
        if "neutral" not in name and "scan_" not in name:
            continue
        yield name, surface.mesh
        if whole := closed(surface):
            yield name + " closed", whole.mesh


def row(
    name: str, mesh: Mesh, copies: list[str], seeds: int, method: Literal["default", "paper"]
) -> None:
    surface, plane, seconds = mapped(mesh, method)
    area = plane.surface.mesh.vertices, plane.surface.mesh.faces
    lost = 1 - face_areas(Mesh(*area))[: len(plane.surface.face)].sum() / face_areas(mesh).sum()
    print(f"{name}: {len(mesh.vertices)} vertices, {lost:.3f} opened, {1e3 * seconds:.0f} ms")
    for copy in copies:
        for seed in range(seeds):
            made = COPIES[copy](mesh)
            changed, carried = moved(made, seed, NOISE if "noise" in copy else 0.0)
            other, copied, _ = mapped(changed, method)
            distance, edge = apart((surface, plane), (other, copied), carried)
            inner = distance[~edge]
            print(
                f"    {copy:20} {len(made.vertices):7} mean {distance.mean():.4f}"
                f" max {distance.max():.4f}; off the boundary: mean {inner.mean():.4f}"
                f" 99.9 % {np.quantile(inner, 0.999):.4f} max {inner.max():.4f}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", nargs="*", default=[""])
    parser.add_argument("--copies", nargs="*", default=list(COPIES))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--method", choices=["default", "paper"], default="default")
    arguments = parser.parse_args()
    for name, mesh in cases(arguments.data):
        if any(word in name for word in arguments.only):
            row(name, mesh, arguments.copies, arguments.seeds, arguments.method)


if __name__ == "__main__":
    main()
