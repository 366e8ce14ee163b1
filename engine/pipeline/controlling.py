"""Which control points an edit has, where every target has them, and how strongly they pull."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from engine.controls import (
    AddressedMesh,
    ControlPoint,
    resolve,
    spread_points,
)
from engine.errors import ControlPointError
from engine.operators import adjacency
from engine.pipeline.planes import (
    TargetPlane,
    finely_mapped,
    length_per_plane,
    place_points,
)
from engine.pipeline.values import Controls, EditPlan, Prepared
from engine.types import (
    BoolArray,
    ComplexArray,
    FloatArray,
    IntArray,
    SurfacePoints,
    frozen_array,
)

SURE_ENOUGH = 0.3
DISPLACEMENT_STRETCH = 2.0
PEAK_REACH = 0.125  # of the face's size over the root of the number of points


@dataclass(frozen=True, slots=True)
class Requested:
    """The request's own points, resolved: on the source, and per target those with a ``to``."""

    points: SurfacePoints
    snap: FloatArray
    given: tuple[IntArray, ...]
    given_at: tuple[SurfacePoints, ...]


def resolve_requested(
    points: Sequence[ControlPoint],
    source: AddressedMesh,
    targets: Mapping[str, AddressedMesh],
) -> Requested:
    """Resolve every address of the request; raises ControlPointError naming the bad ones."""
    names = [point.name for point in points]
    on_source, snap = resolve([point.at for point in points], names, source)
    given: list[IntArray] = []
    given_at: list[SurfacePoints] = []
    for target, mesh in targets.items():
        which = [index for index, point in enumerate(points) if target in point.to]
        there, _ = resolve(
            [points[index].to[target] for index in which],
            [f"{names[index]} on {target}" for index in which],
            mesh,
        )
        given.append(np.asarray(which, dtype=np.int64))
        given_at.append(there)
    return Requested(on_source, snap, tuple(given), tuple(given_at))


def all_controls(
    plan: EditPlan,
    source: Prepared,
    targets: Sequence[Prepared],
    planes: Sequence[TargetPlane],
    requested: Requested,
    automatic: IntArray,
) -> Controls:
    """The request's points and ``automatic`` disk vertices, on the source disk and all targets'."""
    auto = _at_vertices(source, source.disk.surface.vertex[automatic])
    points = _concatenated(requested.points, auto)
    start = place_points(source, source.disk.z, points)
    _refuse_unheld(plan.points, start)
    ends = np.array(
        [
            _on_target(source, target, plane, points, which, there)
            for target, plane, which, there in zip(
                targets, planes, requested.given, requested.given_at, strict=True
            )
        ],
        dtype=np.complex128,
    ).reshape(len(planes), len(points))
    ends = np.where(np.isnan(ends), start, ends)
    names = [point.name for point in plan.points]
    names += [f"auto_{index}" for index in range(len(auto))]
    return Controls(
        tuple(names),
        len(plan.points),
        points,
        np.concatenate([requested.snap, np.zeros(len(auto))]),
        start,
        ends,
        requested.given,
        requested.given_at,
    )


def _concatenated(first: SurfacePoints, second: SurfacePoints) -> SurfacePoints:
    return SurfacePoints(
        np.concatenate([first.face, second.face]),
        np.concatenate([first.barycentric, second.barycentric]),
    )


def _refuse_unheld(points: Sequence[ControlPoint], start: ComplexArray) -> None:
    lost = [point.name for point, z in zip(points, start, strict=False) if np.isnan(z)]
    if lost:
        raise ControlPointError(
            f"control points {', '.join(lost[:5])} lie on the patch at which the closed surface "
            "is opened; use fewer points at the back of the head",
            code="not_on_disk",
            elements={"points": lost},
        )


def _on_target(
    source: Prepared,
    target: Prepared,
    plane: TargetPlane,
    points: SurfacePoints,
    which: IntArray,
    there: SurfacePoints,
) -> ComplexArray:
    """Where a target has the control points: as given, else as the correspondence says."""
    of_surface = np.full(len(source.surface.mesh.vertices), np.nan + 0j)
    held = source.disk.surface.vertex >= 0
    of_surface[source.disk.surface.vertex[held]] = plane.places[held]
    corners = of_surface[source.surface.mesh.faces[points.face]]
    ends = np.where(points.barycentric > 0.0, corners * points.barycentric, 0.0).sum(axis=1)
    ends[which] = place_points(target, plane.z, there)
    return ends


@dataclass(frozen=True, slots=True)
class Candidates:
    """Disk vertices that may become automatic points: ``allowed``, and how far each travels."""

    allowed: BoolArray
    travel: FloatArray
    taken: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "allowed", frozen_array(self.allowed, np.bool_))
        object.__setattr__(self, "travel", frozen_array(self.travel, np.float64))
        object.__setattr__(self, "taken", frozen_array(self.taken, np.int64))


def candidates(source: Prepared, planes: Sequence[TargetPlane], requested: Requested) -> Candidates:
    """Where every target's correspondence is sure, away from the outer boundary."""
    disk = source.disk.surface
    sure, travel = np.ones(len(disk.vertex)), np.zeros(len(disk.vertex))
    for plane in planes:
        sure = np.minimum(sure, plane.confidence)
        way = np.linalg.norm(plane.positions - disk.mesh.vertices, axis=1)
        travel = np.maximum(travel, way)
    allowed = finely_mapped(source) & (disk.vertex >= 0) & (sure >= SURE_ENOUGH)
    touching = np.isin(disk.mesh.faces, disk.boundary).any(axis=1)
    allowed[disk.mesh.faces[touching]] = False
    return Candidates(allowed, travel, _nearest_vertices(source, requested.points))


def spread_automatic(source: Prepared, found: Candidates, count: int) -> IntArray:
    """Spread over the surface, denser where the expressions move it."""
    scale = np.percentile(found.travel[found.allowed], 95) if found.allowed.any() else 0.0
    importance = np.minimum(found.travel / scale, 1.0) if scale > 0 else found.travel * 0.0
    return spread_points(
        source.disk.surface.mesh.vertices,
        DISPLACEMENT_STRETCH * importance,
        count,
        found.taken,
        found.allowed,
    )


def worst_automatic(
    source: Prepared,
    planes: Sequence[TargetPlane],
    images: Sequence[ComplexArray],
    found: Candidates,
    count: int,
) -> IntArray:
    """Where the maps without them err most, not next to each other.

    The error is the distance in the plane between where a map and where the correspondence puts
    a vertex, measured in lengths of the source surface around that vertex.
    """
    disk = source.disk.surface
    stretch = length_per_plane(source)
    error = np.zeros(len(disk.vertex))
    for plane, image in zip(planes, images, strict=True):
        off = np.abs(image[: len(error)] - plane.places) * stretch * plane.confidence
        error = np.maximum(error, np.nan_to_num(off))
    error[~found.allowed] = 0.0
    return _peaks(disk.mesh.vertices, error, count)


def _peaks(positions: FloatArray, error: FloatArray, count: int) -> IntArray:
    """Up to ``count`` vertices of largest error, none within the reach of one chosen before."""
    reach = PEAK_REACH * np.ptp(positions, axis=0).max() / np.sqrt(max(count, 1))
    left = error.copy()
    chosen: list[int] = []
    while len(chosen) < count:
        vertex = int(np.argmax(left))
        if left[vertex] <= 0.0:
            break
        chosen.append(vertex)
        left[np.linalg.norm(positions - positions[vertex], axis=1) < reach] = 0.0
    return np.asarray(chosen, dtype=np.int64)


def apart(source: Prepared, vertices: IntArray) -> IntArray:
    """Those of ``vertices``, first come first kept, that are no neighbours of one another."""
    disk = source.disk.surface.mesh
    around = adjacency(disk.faces, len(disk.vertices))
    blocked = np.zeros(len(disk.vertices), dtype=bool)
    kept: list[int] = []
    for vertex in vertices.tolist():
        if not blocked[vertex]:
            kept.append(vertex)
            blocked[vertex] = True
            blocked[around.indices[around.indptr[vertex] : around.indptr[vertex + 1]]] = True
    return np.asarray(kept, dtype=np.int64)


def _nearest_vertices(source: Prepared, points: SurfacePoints) -> IntArray:
    """The disk vertex that dominates each surface point."""
    of_surface = np.full(len(source.surface.mesh.vertices), -1)
    held = source.disk.surface.vertex >= 0
    of_surface[source.disk.surface.vertex[held]] = np.flatnonzero(held)
    corner = np.argmax(points.barycentric, axis=1)
    found = of_surface[source.surface.mesh.faces[points.face, corner]]
    return found[found >= 0]


def _at_vertices(source: Prepared, vertices: IntArray) -> SurfacePoints:
    """Surface vertices as points: weight 1 on one corner of one of their faces."""
    faces = source.surface.mesh.faces
    face_of = np.zeros(len(source.surface.mesh.vertices), dtype=np.int64)
    face_of[faces.ravel()] = np.repeat(np.arange(len(faces)), 3)
    chosen = face_of[vertices]
    return SurfacePoints(chosen, (faces[chosen] == vertices[:, None]).astype(np.float64))


def keep_controls(controls: Controls, keep: IntArray) -> Controls:
    """Only the control points ``keep``; all of the request's must be among them."""
    return Controls(
        tuple(controls.names[index] for index in keep),
        controls.requested,
        SurfacePoints(controls.points.face[keep], controls.points.barycentric[keep]),
        controls.snap[keep],
        controls.plane[keep],
        controls.plane_targets[:, keep],
        controls.given,
        controls.given_at,
    )
