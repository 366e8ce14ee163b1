"""What can be said of meshes and edits without running anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from engine.controls import Address, refusal, resolve_each
from engine.errors import EngineError
from engine.io import MeshFile, read_mesh
from engine.pipeline import addressed, find_surface
from engine.topology import disk_surface, topology_counts, used_vertices
from engine.types import MeshWarning
from service.jobs.plans import address_of, engine_plan
from service.jobs.reports import surface_point_documents, warning_documents
from service.jobtypes import InspectJob, Json, Report, SnapJob, ValidateJob
from service.schemas import EditDocument

# The bounding-box diagonal of a face is some 20 to 50 cm.
_UNITS = ((0.1, 2.0, "m"), (10.0, 200.0, "cm"), (200.0, 2000.0, "mm"), (1e5, 2e6, "µm"))


def inspect_mesh(job: InspectJob, report: Report) -> Json:
    """Read an uploaded file and find its editable surface; raises the engine's refusals."""
    file = read_mesh(job.path)
    surface, _, diagonal, warnings = find_surface(file, ())
    disk_surface(surface)
    counts = topology_counts(file.mesh)
    box = file.mesh.vertices[used_vertices(file.mesh)]
    return {
        "format": file.format,
        "vertices": len(file.mesh.vertices),
        "polygons": file.polygon_count,
        "triangles": len(file.mesh.faces),
        "components": counts.components,
        "boundary_loops": counts.boundary_loops,
        "boundary_loop_lengths": [len(loop) for loop in surface.loops],
        "euler_characteristic": counts.euler_characteristic,
        "bounding_box": [box.min(axis=0).tolist(), box.max(axis=0).tolist()],
        "unit_guess": next((unit for low, high, unit in _UNITS if low < diagonal <= high), None),
        "warnings": _all_warnings(file, warnings),
    }


def snap_points(job: SnapJob, report: Report) -> Json:
    """Resolve addresses against one mesh: those that hold, and what is wrong with the others."""
    asked = [
        Asked(
            point.get("name") or f"point-{index}",
            address_of(point["at"]),
            f"/points/{index}/at",
        )
        for index, point in enumerate(job.points)
    ]
    resolved, errors, _ = _resolve_on(job.path, asked)
    return {"points": resolved, "errors": errors}


def validate_edit(job: ValidateJob, report: Report) -> Json:
    """Everything that can be checked of an edit short of running it."""
    document = EditDocument.model_validate(job.document)
    points = engine_plan(document).points
    asked = [
        Asked(point.name, point.at, f"/control_points/points/{index}/at")
        for index, point in enumerate(points)
    ]
    resolved, errors, warnings = _resolve_or_refuse(job.meshes[document.source], asked, "/source")
    for number, target in enumerate(document.targets):
        there = [
            Asked(
                point.name,
                point.to[target.name],
                f"/control_points/points/{index}/to/{target.name}",
            )
            for index, point in enumerate(points)
            if target.name in point.to
        ]
        found = _resolve_or_refuse(job.meshes[target.mesh], there, f"/targets/{number}/mesh")
        errors += found[1]
        warnings += found[2]
    return {"errors": errors, "warnings": warnings, "control_points": resolved}


@dataclass(frozen=True, slots=True)
class Asked:
    """An address of a request, what it is called, and where it stands there."""

    name: str
    address: Address
    pointer: str


def _resolve_or_refuse(
    path: Path, asked: Sequence[Asked], pointer: str
) -> tuple[list[Json], list[Json], list[Json]]:
    """Resolved points, errors, warnings; a mesh without an editable surface is one error."""
    try:
        return _resolve_on(path, asked)
    except EngineError as error:
        return [], [_error(error, pointer)], []


def _resolve_on(path: Path, asked: Sequence[Asked]) -> tuple[list[Json], list[Json], list[Json]]:
    file = read_mesh(path)
    surface, centre, diagonal, warnings = find_surface(file, [one.address for one in asked])
    disk_surface(surface)
    there = addressed(file, surface, centre, diagonal)
    if not asked:
        return [], [], _all_warnings(file, warnings)
    points, distance, problems = resolve_each([one.address for one in asked], there)
    places = surface_point_documents(file, there.surface, points)
    resolved: list[Json] = []
    errors: list[Json] = []
    for index, one in enumerate(asked):
        if index in problems:
            errors.append(_error(refusal([(one.name, *problems[index])]), one.pointer))
            continue
        place = {"name": one.name, **places[index], "snap_distance": float(distance[index])}
        resolved.append(place)
    return resolved, errors, _all_warnings(file, warnings)


def _error(error: EngineError, pointer: str) -> Json:
    return {
        "pointer": pointer,
        "code": error.code,
        "message": str(error),
        "elements": error.elements,
    }


def _all_warnings(file: MeshFile, found: tuple[MeshWarning, ...]) -> list[Json]:
    """The reader's warnings and the surface's, each matter once."""
    known = {warning.code for warning in file.warnings}
    return warning_documents(
        (*file.warnings, *(warning for warning in found if warning.code not in known))
    )
