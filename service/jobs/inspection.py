"""What can be said of meshes and edits without running anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from engine.controls import Address, refusal, resolve_each
from engine.errors import EngineError
from engine.io import MeshFile, read_mesh
from engine.pipeline import addressed, find_surface
from engine.topology import disk_surface, topology_counts, used_vertices
from service.jobs.findings import unit_guess, warning_documents
from service.jobs.plans import address_of, engine_address, engine_plan
from service.jobs.reports import surface_point_documents
from service.jobtypes import InspectJob, Json, Report, SnapJob, ValidateJob
from service.schemas import EditDocument


def inspect_mesh(job: InspectJob, report: Report) -> Json:
    """Read an uploaded file and find its editable surface; raises the engine's refusals."""
    file = read_mesh(job.path)
    surface, _, _, warnings = find_surface(file, ())
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
        "unit_guess": unit_guess(file),
        "warnings": warning_documents(file, warnings),
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
    resolved, errors, _ = _resolve_on(read_mesh(job.path), asked)
    return {"points": resolved, "errors": errors}


def validate_edit(job: ValidateJob, report: Report) -> Json:
    """Everything that can be checked of an edit short of running it."""
    document = EditDocument.model_validate(job.document)
    points = engine_plan(document).points
    asked = [
        Asked(point.name, point.at, f"/control_points/points/{index}/at")
        for index, point in enumerate(points)
    ]
    source = _resolve_or_refuse(job, document.source, asked, "/source")
    targets: dict[str, Found] = {}
    for number, target in enumerate(document.targets):
        there = [
            Asked(
                point.name,
                engine_address(places[target.name]),
                f"/control_points/points/{index}/{field}/{target.name}",
            )
            for index, point in enumerate(document.control_points.points)
            for field, places in (("to", point.to), ("moved_to", point.moved_to))
            if target.name in places
        ]
        targets[target.name] = _resolve_or_refuse(
            job, target.mesh, there, f"/targets/{number}/mesh"
        )
    every = [source, *targets.values()]
    return {
        "errors": [error for found in every for error in found.errors],
        "warnings": [warning for found in every for warning in found.warnings],
        "control_points": source.points,
        "inputs": {
            "source": source.described,
            "targets": {name: found.described for name, found in targets.items()},
        },
    }


@dataclass(frozen=True, slots=True)
class Asked:
    """An address of a request, what it is called, and where it stands there."""

    name: str
    address: Address
    pointer: str


@dataclass(frozen=True, slots=True)
class Found:
    """What one mesh answers: resolved points, what is wrong, what is unusual, what it is."""

    points: list[Json]
    errors: list[Json]
    warnings: list[Json]
    described: Json


def _resolve_or_refuse(job: ValidateJob, mesh: str, asked: Sequence[Asked], pointer: str) -> Found:
    """A mesh without an editable surface is one error; warnings say which mesh they are of."""
    try:
        file = read_mesh(job.meshes[mesh])
        resolved, errors, warnings = _resolve_on(file, asked)
    except EngineError as error:
        return Found([], [_error(error, pointer)], [], {"mesh": mesh})
    described = {"mesh": mesh, "unit_guess": unit_guess(file)}
    located = [warning | {"pointer": pointer} for warning in warnings]
    return Found(resolved, errors, located, described)


def _resolve_on(
    file: MeshFile, asked: Sequence[Asked]
) -> tuple[list[Json], list[Json], list[Json]]:
    """Resolved points, errors, warnings."""
    surface, centre, diagonal, warnings = find_surface(file, [one.address for one in asked])
    disk_surface(surface)
    there = addressed(file, surface, centre, diagonal)
    if not asked:
        return [], [], warning_documents(file, warnings)
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
    return resolved, errors, warning_documents(file, warnings)


def _error(error: EngineError, pointer: str) -> Json:
    return {
        "pointer": pointer,
        "code": error.code,
        "message": str(error),
        "elements": error.elements,
    }
