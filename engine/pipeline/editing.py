"""edit(): composition of the stages, nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from engine.controls import AddressedMesh, ControlPoint
from engine.io import MeshFile
from engine.linalg import Keep
from engine.passengers import attach
from engine.pipeline.controlling import Requested, resolve_requested
from engine.pipeline.distortion import editable_faces, source_to_disk
from engine.pipeline.exactness import exact_points
from engine.pipeline.frames import Setting, travels
from engine.pipeline.mapping import PlaneProblem, solve_with_automatic
from engine.pipeline.opened import OpenEdit
from engine.pipeline.planes import TargetPlane, target_plane
from engine.pipeline.preparation import (
    addressed,
    fingerprint,
    joined,
    known_expressions,
    match,
    prepare,
)
from engine.pipeline.shaping import Shaper, handles
from engine.pipeline.values import Edit, EditPlan, Match, Prepared, SolvedPlanes, Stages, Value
from engine.pipeline.weighting import Spreading
from engine.restoration import Orientation
from engine.types import FloatArray, PlaneMap


@dataclass(slots=True)
class Stopwatch:
    """The plain ``Stages``: does the work, and adds up seconds per stage."""

    seconds: dict[str, float] = field(default_factory=dict[str, float])

    def run(self, name: str, key: str, work: Callable[[], Value]) -> Value:
        """Do the work and time it; work within work of the same stage counts once."""
        before = self.seconds.get(name, 0.0)
        start = time.perf_counter()
        value = work()
        self.seconds[name] = before + time.perf_counter() - start
        return value

    def progress(self, name: str, fraction: float) -> None:
        """Nobody listens."""

    def iterations(self, name: str, count: int, residual: float) -> None:
        """Nobody listens."""


def edit(
    source: MeshFile,
    targets: Mapping[str, MeshFile] | None = None,
    plan: EditPlan | None = None,
    *,
    stages: Stages | None = None,
) -> Edit:
    """Carry ``source`` to each target and along the way that ``plan`` asks for.

    Positions in the answer are in the source file's coordinates and vertex order. All weights 0
    is the source, bit for bit. Raises an EngineError that names what cannot be edited,
    registered, mapped or reached.
    """
    return open_edit(source, targets, plan, stages=stages).edit()


def open_edit(
    source: MeshFile,
    targets: Mapping[str, MeshFile] | None = None,
    plan: EditPlan | None = None,
    *,
    stages: Stages | None = None,
) -> OpenEdit:
    """An edit whose weights and moves may be changed in milliseconds; see ``OpenEdit``.

    Everything that does not depend on these is done here, and raises what ``edit`` raises.
    """
    targets, plan, stages = targets or {}, plan or EditPlan(), stages or Stopwatch()
    faces = _prepared(source, targets, plan, stages)
    own = _addressed(source, faces[0])
    theirs = {
        name: _addressed(file, face)
        for (name, file), face in zip(targets.items(), faces[1:], strict=True)
    }

    def resolved(points: Sequence[ControlPoint]) -> Requested:
        return resolve_requested(points, own, theirs)

    asked = resolved(plan.points)
    matches = _matches(source, targets, faces, asked, plan, stages)
    setting = _setting(source, tuple(targets), faces, matches, asked, plan, stages)
    return OpenEdit(setting, matches, asked, resolved, stages)


def _prepared(
    source: MeshFile, targets: Mapping[str, MeshFile], plan: EditPlan, stages: Stages
) -> list[Prepared]:
    made = [prepare(source, plan.options, stages, [point.at for point in plan.points])]
    for name, file in targets.items():
        there = [point.to[name] for point in plan.points if name in point.to]
        made.append(prepare(file, plan.options, stages, there))
        for stage in ("topology", "parameterization"):
            stages.progress(stage, len(made) / (len(targets) + 1))
    return made


def _addressed(file: MeshFile, face: Prepared) -> AddressedMesh:
    return addressed(file, face.surface, face.centre, face.diagonal)


def _matches(
    source: MeshFile,
    targets: Mapping[str, MeshFile],
    faces: Sequence[Prepared],
    asked: Requested,
    plan: EditPlan,
    stages: Stages,
) -> list[Match]:
    made: list[Match] = []
    expressions = known_expressions(faces[0], source, plan.options, stages) if targets else None
    for index, file in enumerate(targets.values()):
        given, there = asked.given[index], asked.given_at[index]
        landmarks = (joined(asked.points, given), there) if len(given) else None
        files = (source, file)
        made.append(
            match(faces[0], faces[index + 1], files, plan.options, stages, landmarks, expressions)
        )
        for stage in ("registration", "correspondence"):
            stages.progress(stage, (index + 1) / len(targets))
    return made


def _setting(
    file: MeshFile,
    names: Sequence[str],
    faces: Sequence[Prepared],
    matches: Sequence[Match],
    asked: Requested,
    plan: EditPlan,
    stages: Stages,
) -> Setting:
    source, targets = faces[0], tuple(faces[1:])
    planes = stages.run(
        "control_points",
        "",
        lambda: tuple(target_plane(source, t, m) for t, m in zip(targets, matches, strict=True)),
    )
    stages.progress("control_points", 1.0)
    key = _planes_key(source, planes, asked, plan)
    solved = stages.run(
        "iteration", key, lambda: solve_with_automatic(plan, source, targets, planes, asked)
    )
    _report_iterations(stages, solved.maps)
    problem = stages.run("iteration", "", lambda: _problem(source, solved, plan, stages, key))
    shaper = stages.run("restoration", "", lambda: Shaper(source, plan.options))
    shapes = stages.run(
        "restoration",
        fingerprint(key, plan.options.restoration),
        lambda: _shapes(shaper, targets, planes, solved, asked),
    )
    analysis = _keep(stages, "restoration", fingerprint(source.surface.mesh.faces))
    editable = editable_faces(source, plan.histogram_bins)
    held = handles(plan.points, asked, source.diagonal)
    return Setting(
        file=file,
        source=source,
        names=tuple(names),
        targets=targets,
        planes=planes,
        problem=problem,
        shaper=shaper,
        shapes=shapes,
        blending=stages.run(
            "restoration", "", lambda: shaper.blending(shapes, solved.controls, analysis)
        ),
        maps=tuple(zip(solved.maps, solved.refined, strict=True)),
        passengers=attach(
            file.mesh,
            _addressed(file, source).surface,
            rigid=plan.options.passengers == "rigid",
        ),
        handles=held,
        grip=stages.run("restoration", "", lambda: shaper.grip(held)),
        spreading=Spreading(source.surface.mesh, solved.controls.points),
        travels=travels(solved.controls, source, shapes),
        editable=editable,
        orientation=Orientation(source.surface.mesh),
        before=source_to_disk(source, editable),
        plan=plan,
    )


def _problem(
    source: Prepared, solved: SolvedPlanes, plan: EditPlan, stages: Stages, key: str
) -> PlaneProblem:
    keep = _keep(stages, "iteration", key)
    return PlaneProblem(source, solved.controls, solved.boundary, plan.options, keep=keep)


def _shapes(
    shaper: Shaper,
    targets: Sequence[Prepared],
    planes: Sequence[TargetPlane],
    solved: SolvedPlanes,
    asked: Requested,
) -> tuple[FloatArray, ...]:
    """The source carried to every target (n, 3)."""
    return tuple(
        shaper.on_target(
            plane, found.z, solved.controls, exact_points(asked, index, plane, targets[index])
        )
        for index, (plane, found) in enumerate(zip(planes, solved.maps, strict=True))
    )


def _keep(stages: Stages, stage: str, key: str) -> Keep:
    """Keeps a symbolic analysis under ``key``."""
    return lambda work: stages.run(stage, fingerprint("analysis", key), work)


def _planes_key(
    source: Prepared, planes: Sequence[TargetPlane], asked: Requested, plan: EditPlan
) -> str:
    """What the planes and the shapes of the targets depend on: not on weights and moves."""
    surface, options = source.surface.mesh, plan.options
    words = (options.iteration, options.outer_boundary, options.holes, str(plan.auto))
    placed = [asked.points, *asked.given_at]
    return fingerprint(
        *words,
        repr([point.name for point in plan.points]),
        surface.vertices,
        surface.faces,
        source.disk.z,
        source.disk.surface.mesh.faces,
        asked.snap,
        *asked.given,
        *(values for points in placed for values in (points.face, points.barycentric)),
        *(
            values
            for plane in planes
            for values in (
                plane.z,
                plane.shape.vertices,
                plane.shape.faces,
                plane.places,
                plane.positions,
                plane.confidence,
            )
        ),
    )


def _report_iterations(stages: Stages, maps: Sequence[PlaneMap]) -> None:
    if maps:
        last = [float(found.residuals[-1]) if len(found.residuals) else 0.0 for found in maps]
        stages.iterations("iteration", sum(found.solves for found in maps), max(last))
