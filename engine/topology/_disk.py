"""The topological disk that stands for a surface in the plane."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from engine.errors import TopologyError
from engine.topology._collar import collar
from engine.topology._cut import cut_of
from engine.topology._filling import HoleFiller
from engine.topology._handles import euler_characteristic
from engine.topology._loops import boundary_loops
from engine.topology._opening import opening_patch
from engine.topology._sheets_kernels import face_vectors
from engine.types import BoolArray, DiskSurface, IntArray, Mesh, Surface

SMALLEST_OUTER_LOOP = 1e-3
"""Below this length^2 / (4 pi area) the outer loop is a puncture of a closed surface."""


def disk_surface(
    surface: Surface,
    *,
    keep: IntArray | None = None,
    holes: Literal["filled", "kept"] = "filled",
) -> DiskSurface:
    """Close the inner holes of ``surface`` for the plane, or open it if it is closed.

    Holes get faces of minimal total area (large ones are divided by short chords first) that make
    no edge twice and need no new vertices; ``holes="kept"`` leaves them open. A closed surface, or
    one whose outer loop is a mere puncture (then a hole like the others), loses the disk-shaped
    patch of faces that reach into a ball (``cut_of``): about 5 % of its area, in the same place
    whatever the triangles, and away from the surface vertices ``keep``. Vertices inside the patch
    are not in the disk; what the patch has outside of the ball is in its ``opening``; holes at the
    patch are closed. Raises ``TopologyError`` if the result is not a disk.
    """
    mesh = surface.mesh
    punctured = bool(surface.loops) and _roundness(mesh, surface.loops[0]) < SMALLEST_OUTER_LOOP
    loops = list(surface.loops if punctured else surface.loops[1:])
    filler = HoleFiller(mesh.vertices, mesh.faces, loops)
    fills = [filler.fill(loop) for loop in loops]
    faces = np.concatenate([mesh.faces, *fills])
    present = np.ones(len(faces), dtype=np.bool_)
    cut = None
    if surface.closed or punctured:
        whole = Mesh(mesh.vertices, faces)
        cut = cut_of(whole, keep)
        present = ~opening_patch(whole, cut, keep)
    disk = _disk(surface, faces, present)
    if cut is not None:
        opening = collar(mesh.vertices, faces[~present], disk, cut)
        disk = replace(disk, opening=opening)
    if holes == "filled":
        return disk
    at_patch = np.zeros(len(mesh.vertices), dtype=np.bool_)
    at_patch[faces[~present]] = True
    stays = [not at_patch[loop].any() for loop in loops]
    fill_stays = np.repeat(stays, [len(fill) for fill in fills]).astype(np.bool_)
    return _reopened(
        disk,
        [loop for loop, open_ in zip(loops, stays, strict=True) if open_],
        np.concatenate([present[: len(mesh.faces)], ~fill_stays])[present],
    )


def _reopened(disk: DiskSurface, loops: list[IntArray], present: BoolArray) -> DiskSurface:
    """``disk`` without the faces that are not ``present``, which close ``loops`` of the surface."""
    mesh = Mesh(disk.mesh.vertices, disk.mesh.faces[present])
    holes = tuple(np.searchsorted(disk.vertex, loop) for loop in loops)
    return replace(disk, mesh=mesh, holes=holes)


def filled_disk(disk: DiskSurface) -> DiskSurface:
    """``disk`` with the holes closed that were kept, after its other faces."""
    if not disk.holes:
        return disk
    filler = HoleFiller(disk.mesh.vertices, disk.mesh.faces, list(disk.holes))
    faces = np.concatenate([disk.mesh.faces, *(filler.fill(loop) for loop in disk.holes)])
    mesh = Mesh(disk.mesh.vertices, faces)
    return replace(disk, mesh=mesh, holes=())


def _roundness(mesh: Mesh, loop: IntArray) -> float:
    corners = mesh.vertices[loop]
    length = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum()
    area = 0.5 * np.linalg.norm(face_vectors(mesh.vertices, mesh.faces), axis=1).sum()
    return float(length**2 / (4 * np.pi * area))


def _disk(surface: Surface, faces: IntArray, present: BoolArray) -> DiskSurface:
    vertices, own = surface.mesh.vertices, len(surface.mesh.faces)
    faces = faces[present]
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    vertex = np.flatnonzero(used)
    number = np.cumsum(used) - 1
    mesh = Mesh(vertices[vertex], number[faces])
    loops = boundary_loops(mesh.faces, len(vertex))
    if len(loops) != 1 or euler_characteristic(mesh.faces) != 1:
        raise TopologyError(
            f"closing the holes leaves {len(loops)} boundary loops and the Euler characteristic "
            f"{euler_characteristic(mesh.faces)}, not a disk (1 and 1)",
            code="not_a_disk",
            elements={"loop_sizes": [len(loop) for loop in loops]},
        )
    return DiskSurface(mesh, loops[0], vertex, np.flatnonzero(present[:own]))
