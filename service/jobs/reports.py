"""What an edit tells in figures: histogram.json, report.json, the echo of control points."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.io import MeshFile
from engine.measures import BeltramiHistogram, SurfaceDistance
from engine.pipeline import (
    CarriedMesh,
    CarriedTarget,
    Edit,
    EditedMesh,
    EditedMeshes,
    EditPlan,
    Frame,
)
from engine.types import ComplexArray, FloatArray, IntArray, PlaneMap, Surface, SurfacePoints
from service.jobs.findings import warning_documents

Json = dict[str, Any]


def histogram_document(edit: Edit) -> Json:
    """``histogram.json`` as the contract gives it."""
    maps = [_histogram("source_to_disk", edit.source_to_disk)]
    similarity: list[Json] = []
    for frame in edit.frames:
        maps += [
            _histogram("edited_to_disk", frame.edited_to_disk, frame.index),
            _histogram("plane", frame.plane_to_plane, frame.index),
            _histogram("surface", frame.surface_to_surface, frame.index),
        ]
        similarity.append(
            {
                "of": "source_to_disk",
                "to": "edited_to_disk",
                "frame": frame.index,
                "wasserstein_1": frame.similarity.wasserstein_1,
                "correlation": frame.similarity.correlation,
            }
        )
    edges = edit.source_to_disk.edges.tolist()
    return {"edges": edges, "maps": maps, "similarity": similarity}


def _histogram(name: str, shown: BeltramiHistogram, frame: int | None = None) -> Json:
    which = {} if frame is None else {"frame": frame}
    return {
        "name": name,
        **which,
        "counts": shown.counts.tolist(),
        "area_weights": shown.area_weights.tolist(),
        "mean": shown.mean,
        "p95": shown.p95,
        "max": shown.max,
        "folds": shown.folds,
        "undefined": shown.undefined,
    }


def source_places(edit: EditedMeshes, file: MeshFile) -> list[Json]:
    """Where the control points are on the source; the same for all edits of an open one."""
    source = edit.source.surface
    surface = Surface(
        source.mesh.moved(edit.source.to_file(source.mesh.vertices)),
        source.vertex_of,
        source.face_of,
        source.loops,
    )
    return surface_point_documents(file, surface, edit.controls.points)


def control_point_documents(edit: EditedMeshes, places: Sequence[Json]) -> list[Json]:
    """Every control point as it was resolved.

    On the source (its ``source_places``), on each target, and in the plane.
    """
    controls = edit.controls
    names = [target.name for target in edit.targets]
    elsewhere = [_on_target(edit, target).tolist() for target in edit.targets]
    columns = zip(
        controls.names,
        places,
        controls.snap.tolist(),
        _pairs(controls.plane),
        _after(edit),
        strict=True,
    )
    return [
        {
            "name": name,
            "automatic": index >= controls.requested,
            **place,
            "snap_distance": snap,
            "on_targets": dict(zip(names, [there[index] for there in elsewhere], strict=True)),
            "plane_before": before,
            "plane_after": after,
        }
        for index, (name, place, snap, before, after) in enumerate(columns)
    ]


def _after(edit: EditedMeshes) -> Sequence[list[float] | None]:
    """Where the control points ended in the last frame's plane, if that was solved."""
    if isinstance(edit, Edit):
        return _pairs(edit.frames[-1].control_points)
    return [None] * len(edit.controls.names)


def _pairs(z: ComplexArray) -> list[list[float]]:
    return np.stack([z.real, z.imag], axis=1).tolist()


def _on_target(edit: EditedMeshes, target: CarriedMesh) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The control points on a carried target, in that target file's own coordinates."""
    moved = edit.source.surface.mesh.moved(target.surface)
    there = target.match.registration.target_from_source(edit.controls.points.on(moved))
    return there * edit.source.diagonal + target.centre


def surface_point_documents(file: MeshFile, surface: Surface, points: SurfacePoints) -> list[Json]:
    """Surface points in the file's terms: ``polygon``, one weight per corner, ``position``.

    ``surface`` is in the file's coordinates.
    """
    triangle = surface.face_of[points.face]
    polygon = file.polygon_of[triangle]
    fan = triangle - file.first_face[polygon]
    columns = (polygon, fan, _triangle_weights(file, surface, points), points.on(surface.mesh))
    return [_surface_point(file, *one) for one in zip(*(c.tolist() for c in columns), strict=True)]


def _triangle_weights(file: MeshFile, surface: Surface, points: SurfacePoints) -> FloatArray:
    """(k, 3) weights in the order of the file's triangles, which the surface may have turned."""
    there = surface.mesh.vertices[surface.mesh.faces[points.face]]
    here = file.mesh.vertices[file.mesh.faces[surface.face_of[points.face]]]
    far = np.linalg.norm(here[:, :, None] - there[:, None], axis=-1)
    order = np.argmin(far, axis=2)
    return np.take_along_axis(points.barycentric, order, axis=1)


def _surface_point(
    file: MeshFile, polygon: int, fan: int, weights: list[float], position: list[float]
) -> Json:
    corners = file.corners[file.offsets[polygon] : file.offsets[polygon + 1]].tolist()
    every = [0.0] * len(corners)
    every[0], every[fan + 1], every[fan + 2] = weights
    document: Json = {"polygon": polygon, "barycentric": every, "position": position}
    if max(every) == 1.0:
        document["vertex"] = corners[every.index(1.0)]
    return document


@dataclass(frozen=True, slots=True)
class Inputs:
    """The mesh files of an edit, ``targets`` by name, and what the report says of them."""

    source: MeshFile
    targets: Mapping[str, MeshFile]
    described: Json


def report_document(
    edit: EditedMeshes,
    plan: EditPlan,
    inputs: Inputs,
    places: Sequence[Json],
    stages: list[Json],
    version: str,
) -> Json:
    """``report.json``: every figure of the edit; of planes and distances where there are any.

    ``places``: the ``source_places`` of the control points.
    """
    return {
        "engine_version": version,
        "inputs": inputs.described,
        "options": _options(plan),
        "stages": stages,
        "control_points": control_point_documents(edit, places),
        **(_source_disk(edit.source_to_disk) if isinstance(edit, Edit) else {}),
        "targets": {target.name: _target(edit, target) for target in edit.targets},
        "frames": [_frame(frame, edit.source.surface.face_of) for frame in edit.frames],
        "warnings": {"source": warning_documents(inputs.source, edit.source.warnings)}
        | {
            target.name: warning_documents(inputs.targets[target.name], target.warnings)
            for target in edit.targets
        },
    }


def _source_disk(shown: BeltramiHistogram) -> Json:
    return {
        "source_disk": {"folds": shown.folds, "mean_mu": shown.mean, "max_mu": shown.max},
    }


def _options(plan: EditPlan) -> Json:
    return dataclasses.asdict(plan.options)


def _target(edit: EditedMeshes, target: CarriedMesh) -> Json:
    registration = target.match.registration
    pose = registration.source_from_target
    unit = edit.source.diagonal
    translation = (
        edit.source.centre + unit * pose.translation - pose(target.centre) + pose.translation
    )
    confidence = target.match.correspondence.confidence
    return {
        "registration": {
            "direction": "source_from_target",
            "rotation": pose.rotation.tolist(),
            "translation": translation.tolist(),
            "scale": pose.scale,
            "unit": unit_note(pose.scale),
            "rms": (registration.rms * unit).tolist(),
            "matching_rate": registration.matching_rate,
            "iterations": registration.iterations,
            "converged": registration.converged,
        },
        "correspondence": {
            "mode": target.match.correspondence.mode,
            "mean_confidence": float(confidence.mean()),
            "unknown_vertices": int((confidence == 0.0).sum()),
        },
        "turned_faces": len(target.turned_faces),
        **(_target_figures(target) if isinstance(target, CarriedTarget) else {}),
    }


def _target_figures(target: CarriedTarget) -> Json:
    return {
        "iteration": plane_figures(target.plane),
        "distance": distance_figures(target.distance),
    }


def unit_note(scale: float) -> str:
    """What a registration's scale says of the unit of the target's file."""
    if scale == 1.0:
        return "the same as the source's"
    exponent = math.log10(scale)
    if abs(exponent - round(exponent)) < 1e-9:
        return f"{scale:g} of the source's, as the sizes tell"
    return f"free, as asked for: lengths times {scale:.6g} are the source's"


def plane_figures(plane: PlaneMap) -> Json:
    """A plane map's convergence and distortion."""
    return {
        "solves": plane.solves,
        "converged": plane.converged,
        "residuals": plane.residuals.tolist(),
        "folds": len(plane.folds),
        "max_mu": float(np.abs(plane.mu).max(initial=0.0)),
    }


def distance_figures(distance: SurfaceDistance) -> Json:
    """Both ways, in the source file's unit."""
    return {
        "result_to_target": dataclasses.asdict(distance.to_target),
        "target_to_result": dataclasses.asdict(distance.from_target),
    }


def _frame(frame: EditedMesh, face_of: IntArray) -> Json:
    return {
        "frame": frame.index,
        "time": frame.time,
        "weights": dict(frame.weights),
        "turned_faces": len(frame.turned_faces),
        "warnings": _turned(face_of[frame.turned_faces]),
        **(_frame_figures(frame) if isinstance(frame, Frame) else {}),
    }


def _frame_figures(frame: Frame) -> Json:
    return {
        "iteration": plane_figures(frame.plane),
        "control_point_residual": frame.control_residual,
        "points_left_out": list(frame.left_out),
        "similarity": {
            "wasserstein_1": frame.similarity.wasserstein_1,
            "correlation": frame.similarity.correlation,
        },
    }


def _turned(faces: IntArray) -> list[Json]:
    """What to say of an edited mesh whose ``faces``, of the file, are inverted or collapsed."""
    if not len(faces):
        return []
    message = (
        f"{len(faces)} triangles are turned over or crushed: moves or weights ask for more than "
        "the surface between them allows"
    )
    return [
        {
            "code": "turned_faces",
            "message": message,
            "elements": "faces",
            "count": len(faces),
            "first": faces[:10].tolist(),
        }
    ]
