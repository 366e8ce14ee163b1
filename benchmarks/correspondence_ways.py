"""Ways to say where a source's vertices are on a target: the engine's, and those of others."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import trimesh

from benchmarks.correspondence_tasks import Task
from benchmarks.paint import captures
from engine.correspondence import correspond, expression_template, lay_expressions
from engine.io import MeshFile
from engine.locate import PointLocator
from engine.operators import vertex_normals
from engine.pipeline.preparation import find_surface
from engine.registration import register
from engine.types import (
    BoolArray,
    FloatArray,
    IntArray,
    Mesh,
    Registration,
    Surface,
    SurfacePoints,
)
from engine.visibility import ambient_visibility

OURS = ("automatic", "landmarks", "prior", "landmarks+prior", "coloured", "coloured+prior")
RIVALS = ("closest", "paper", "amberg", "sumner")


@dataclass(frozen=True)
class Placed:
    """A file's editable surface in the frame and unit in which it is matched.

    file position = ``unit`` · position + ``centre``.
    """

    surface: Surface
    centre: FloatArray
    unit: float

    @property
    def mesh(self) -> Mesh:
        return self.surface.mesh

    def to_file(self, points: FloatArray) -> FloatArray:
        return self.unit * points + self.centre


@dataclass(frozen=True)
class Answer:
    """Places (n, 3) of the source surface's vertices in the target's file, and how sure."""

    places: FloatArray
    confidence: FloatArray
    normals: FloatArray  # of the target there
    mode: str
    seconds: float  # of the processor, for pose and correspondence


def placed(source: MeshFile, target: MeshFile) -> tuple[Placed, Placed]:
    """Both files as the pipeline gives them to the stages: centred, in the source's diagonal."""
    ours, centre, diagonal, _ = find_surface(source, ())
    theirs, other_centre, other_diagonal, _ = find_surface(target, ())
    ratio = other_diagonal / diagonal
    scaled = theirs.mesh.moved(theirs.mesh.vertices * ratio)
    surface = Surface(scaled, theirs.vertex_of, theirs.face_of, theirs.loops)
    return Placed(ours, centre, diagonal), Placed(surface, other_centre, diagonal)


def answer(task: Task, way: str) -> Answer:
    """What ``way`` makes of a task."""
    source, target = placed(task.source, task.target)
    unmarked = not way.startswith("landmarks") and way not in ("amberg", "sumner")
    marks = None if unmarked else landmarks(task, source, target)
    known = None
    if way.endswith("prior"):
        template = expression_template(source.surface)
        known = lay_expressions(source.surface, register(source.mesh, template))
    colours = painted(task, source, target) if way.startswith("coloured") else None
    start = time.process_time()
    method = "paper" if way == "paper" else "default"
    pose = register(source.mesh, target.mesh, method=method)
    match way:
        case "closest":
            onto = target.mesh.moved(pose.source_from_target(target.mesh.vertices))
            points = PointLocator(onto).nearest(source.mesh.vertices)[0]
            places, confidence, mode = points.on(target.mesh), np.ones(len(points)), ""
        case "amberg" | "sumner":
            assert marks is not None
            return _rival(way, source, target, pose, marks)
        case _:
            found = correspond(
                source.surface,
                target.surface,
                pose,
                method=method,
                landmarks=marks,
                expressions=known,
                colours=colours,
                visibility=(visible(task.source, source), visible(task.target, target)),
            )
            points, places = found.points, found.on(target.mesh)
            confidence, mode = found.confidence, found.mode
    seconds = time.process_time() - start
    return Answer(
        target.to_file(places),
        confidence,
        normals_at(target.mesh, points),
        mode,
        seconds,
    )


def painted(task: Task, source: Placed, target: Placed) -> tuple[FloatArray, FloatArray]:
    """Colours of both surfaces as two captures of one skin have them."""
    of = source.surface.vertex_of
    truth = np.zeros_like(source.mesh.vertices)
    truth[of[of >= 0]] = (task.truth[of >= 0] - target.centre) / target.unit
    valid = np.zeros(len(truth), dtype=np.bool_)
    valid[of[of >= 0]] = task.valid[of >= 0]
    return captures(source.mesh, truth, valid, target.mesh)


def visible(file: MeshFile, face: Placed) -> FloatArray:
    """The ambient visibility of the surface's faces, with all of the file in the way."""
    whole = file.mesh.moved((file.mesh.vertices - face.centre) / face.unit)
    return ambient_visibility(face.mesh, whole)


def normals_at(mesh: Mesh, points: SurfacePoints) -> FloatArray:
    return points.on(mesh.moved(vertex_normals(mesh)))


def landmarks(task: Task, source: Placed, target: Placed) -> tuple[SurfacePoints, SurfacePoints]:
    """The task's landmarks as points of both surfaces, those that the surfaces have."""
    on_surface = source.surface.vertex_of[task.landmarks]
    given = task.landmarks[on_surface >= 0]
    true = (task.truth[given] - target.centre) / target.unit
    return (
        vertex_points(source.mesh, on_surface[on_surface >= 0]),
        PointLocator(target.mesh).nearest(true)[0],
    )


def vertex_points(mesh: Mesh, vertices: IntArray) -> SurfacePoints:
    used, first = np.unique(mesh.faces, return_index=True)
    corner = first[np.searchsorted(used, vertices)]
    weights = np.zeros((len(corner), 3))
    weights[np.arange(len(corner)), corner % 3] = 1.0
    return SurfacePoints(corner // 3, weights)


def _rival(
    way: str,
    source: Placed,
    target: Placed,
    pose: Registration,
    marks: tuple[SurfacePoints, SurfacePoints],
) -> Answer:
    """trimesh's non-rigid registrations from our pose, with the same landmarks."""
    onto = target.mesh.moved(pose.source_from_target(target.mesh.vertices))
    a, b = (trimesh.Trimesh(m.vertices, m.faces, process=False) for m in (source.mesh, onto))
    ours = source.mesh.faces[marks[0].face, marks[0].barycentric.argmax(axis=1)]
    work = (
        trimesh.registration.nricp_amberg if way == "amberg" else trimesh.registration.nricp_sumner
    )
    start = time.process_time()
    moved = np.asarray(work(a, b, source_landmarks=ours, target_positions=marks[1].on(onto)))
    seconds = time.process_time() - start
    points = PointLocator(onto).nearest(moved)[0]
    back = pose.target_from_source(moved)
    return Answer(
        target.to_file(back), np.ones(len(back)), normals_at(target.mesh, points), "", seconds
    )


def turned_faces(source: Placed, given: Answer) -> BoolArray:
    """(m,) faces of the source whose image lies upside down on the target, or is flat."""
    a, b, c = np.moveaxis(given.places[source.mesh.faces], 1, 0)
    below = given.normals[source.mesh.faces].sum(axis=1)
    return np.einsum("mi,mi->m", np.cross(b - a, c - a), below) <= 0
