"""Frames and carried targets: shapes into file vertices, planes and distortions per frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from engine.controls import interpolate_controls
from engine.io import MeshFile
from engine.measures import BeltramiHistogram, MeasuredSurface, SurfaceDistance
from engine.parameterization import align_disk, disk_map
from engine.passengers import Passengers, carry
from engine.pipeline.distortion import Editable, frame_distortion
from engine.pipeline.framing import Moment, general_weights, moments
from engine.pipeline.mapping import PlaneProblem, solve_frame
from engine.pipeline.planes import TargetPlane, place_points
from engine.pipeline.preparation import fingerprint
from engine.pipeline.shaping import Blending, Handles, Shaper
from engine.pipeline.values import (
    CarriedMesh,
    Controls,
    EditedMesh,
    EditPlan,
    Frame,
    Match,
    PlacedPlane,
    Prepared,
    Stages,
)
from engine.pipeline.weighting import Spreading, Weights, final_weights
from engine.restoration import Grip, Orientation
from engine.types import ComplexArray, DiskSurface, FloatArray, PlaneMap


@dataclass(frozen=True, slots=True)
class Setting:
    """What all frames of one edit share."""

    file: MeshFile
    source: Prepared
    names: tuple[str, ...]
    targets: tuple[Prepared, ...]
    planes: tuple[TargetPlane, ...]
    problem: PlaneProblem
    shaper: Shaper
    shapes: tuple[FloatArray, ...]
    blending: Blending
    maps: tuple[tuple[PlaneMap, ComplexArray], ...]
    passengers: Passengers
    handles: Handles
    grip: Grip | None
    spreading: Spreading
    travels: FloatArray
    editable: Editable
    orientation: Orientation
    before: BeltramiHistogram
    plan: EditPlan

    def file_vertices(self, surface: FloatArray) -> FloatArray:
        """All vertices of the file (n_file, 3) when its editable surface is ``surface``."""
        rest = self.source.to_file(self.source.surface.mesh.vertices)
        carried = carry(self.passengers, rest, self.source.to_file(surface))
        if self.plan.options.passengers not in {"stay", "paper"}:
            return carried
        on_surface = self.source.surface.vertex_of >= 0
        return np.where(on_surface[:, None], carried, self.file.mesh.vertices)

    def known_plane(self, weights: Weights) -> tuple[PlaneMap, ComplexArray] | None:
        """The plane of weights that are one target's alone: solved already."""
        if weights.surface.shape[1] != 1 or not np.array_equal(
            weights.points, np.broadcast_to(weights.surface, weights.points.shape)
        ):
            return None
        alone = np.flatnonzero(weights.surface[:, 0])
        if len(alone) != 1 or weights.surface[alone[0], 0] != 1.0:
            return None
        return self.maps[alone[0]]

    def boundary_weights(self, weights: Weights) -> FloatArray:
        """The weights at the outer boundary's vertices: (targets, b) or (targets, 1)."""
        if weights.surface.shape[1] == 1:
            return weights.surface
        return weights.surface[:, self.source.disk.surface.vertex[self.problem.boundary.vertices]]


def compared(
    setting: Setting, index: int, measured: Callable[[], MeasuredSurface], stages: Stages
) -> SurfaceDistance:
    """The source at weight 1 of one target beside that target, both ways, in file units.

    It needs no plane.
    """
    shape, own = setting.shapes[index], setting.planes[index].editable
    mesh = setting.source.surface.mesh
    distance = stages.run(
        "measures",
        fingerprint("distance", mesh.vertices, mesh.faces, shape, own.vertices, own.faces),
        lambda: measured().distance(mesh.moved(shape)),
    )
    return distance.scaled(setting.source.diagonal)


def carried_mesh(setting: Setting, index: int, match: Match) -> CarriedMesh:
    """The source at weight 1 of one target."""
    shape, target = setting.shapes[index], setting.targets[index]
    return CarriedMesh(
        name=setting.names[index],
        vertices=setting.file_vertices(shape),
        surface=shape,
        centre=target.centre,
        warnings=target.warnings,
        match=match,
        turned_faces=setting.orientation.turned(shape),
    )


@dataclass(frozen=True, slots=True)
class Shaped:
    """One frame's surface (n, 3) and plane."""

    moment: Moment
    surface: FloatArray
    placed: PlacedPlane


def shape_frames(setting: Setting, stages: Stages) -> list[Shaped]:
    """Every frame of the plan, in order, each plane started from the one before."""
    setting = replace(setting, problem=setting.problem.anew())
    todo = moments(setting.plan, setting.names)
    weights = _Weighting(setting)
    made: list[Shaped] = []
    warm: ComplexArray | None = None
    for index, moment in enumerate(todo):
        alpha = weights.at(moment)
        surface = stages.run("restoration", "", lambda a=alpha, m=moment: _surface(setting, a, m))
        placed = stages.run(
            "iteration", "", lambda a=alpha, s=surface, w=warm: _plane(setting, a, s, w)
        )
        warm = placed.refined
        made.append(Shaped(moment, surface, placed))
        for stage in ("restoration", "iteration"):
            stages.progress(stage, (index + 1) / len(todo))
    return made


def measure_frames(setting: Setting, shaped: Sequence[Shaped], stages: Stages) -> list[Frame]:
    """The frames with what each distorts."""
    made: list[Frame] = []
    for index, one in enumerate(shaped):
        made.append(
            stages.run("measures", "", lambda i=index, frame=one: _frame(setting, i, frame))
        )
        stages.progress("measures", (index + 1) / len(shaped))
    return made


class _Weighting:
    """Alpha of eq. (7) at each moment: scaled final weights, or the keyframes' own."""

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        self._final = self._of(general_weights(setting.plan, setting.names))

    def _of(self, general: dict[str, float]) -> Weights:
        setting = self._setting
        return final_weights(
            setting.plan,
            setting.names,
            general,
            setting.problem.controls,
            setting.travels,
            setting.spreading,
        )

    def at(self, moment: Moment) -> Weights:
        """The weights of one moment."""
        if self._setting.plan.keyframes:
            return self._of(dict(moment.weights))
        share = moment.share
        if share == 1.0:
            return self._final
        return Weights(self._final.points * share, self._final.surface * share)


def travels(controls: Controls, source: Prepared, shapes: Sequence[FloatArray]) -> FloatArray:
    """How far each control point travels to each target (targets, c), in file units."""
    points, mesh = controls.points, source.surface.mesh
    start = points.on(mesh)
    ends = [points.on(mesh.moved(shape)) for shape in shapes]
    lengths = [np.linalg.norm(end - start, axis=1) * source.diagonal for end in ends]
    return np.array(lengths).reshape(len(ends), len(points))


def make_meshes(setting: Setting, stages: Stages) -> list[EditedMesh]:
    """Every frame of the plan, in order, without planes."""
    todo = moments(setting.plan, setting.names)
    weights = _Weighting(setting)
    made: list[EditedMesh] = []
    for index, moment in enumerate(todo):
        made.append(
            stages.run(
                "restoration",
                "",
                lambda i=index, m=moment: _edited_mesh(setting, i, m, weights.at(m)),
            )
        )
        stages.progress("restoration", (index + 1) / len(todo))
    return made


def _edited_mesh(setting: Setting, index: int, moment: Moment, weights: Weights) -> EditedMesh:
    surface = _surface(setting, weights, moment)
    return EditedMesh(
        index=index,
        time=moment.time,
        weights=moment.weights,
        vertices=setting.file_vertices(surface),
        turned_faces=setting.orientation.turned(surface),
    )


def _surface(setting: Setting, weights: Weights, moment: Moment) -> FloatArray:
    blended = setting.blending(weights.surface)
    return setting.shaper.with_handles(blended, setting.handles, setting.grip, moment.share)


def _plane(
    setting: Setting, weights: Weights, surface: FloatArray, warm: ComplexArray | None
) -> PlacedPlane:
    """The edited plane of one frame: eq. (7), then the iteration."""
    controls = setting.problem.controls
    boundary = setting.problem.boundary
    if setting.planes:
        targets = interpolate_controls(controls.plane, list(controls.plane_targets), weights.points)
        where = boundary.at(setting.boundary_weights(weights))
    else:
        targets = _own_disk(setting, surface)
        where = boundary.start
    known = setting.known_plane(weights)
    if known is None:
        if warm is None and weights.surface.shape[1] == 1:
            images = [refined for _, refined in setting.maps]
            goals = setting.problem.goals(targets, where)
            warm = setting.problem.between(images, weights.surface[:, 0], goals, where)
        return solve_frame(setting.problem, targets, where, warm)
    solved, refined = known
    reached = setting.problem.reached(refined)
    off = np.abs(reached - setting.problem.goals(targets, where)).max(initial=0.0)
    return PlacedPlane(solved, refined, reached, float(off), ())


def _own_disk(setting: Setting, surface: FloatArray) -> ComplexArray:
    """Where the control points lie on the edited surface's own disk, in the source's frame.

    A direct move has no target whose disk could say where its plane goes.
    """
    disk = setting.source.disk
    controls = setting.problem.controls
    if np.array_equal(surface, setting.source.surface.mesh.vertices):
        return controls.plane
    moved = moved_disk(disk.surface, surface)
    own = disk_map(moved, method=setting.plan.options.parameterization)
    held = disk.surface.vertex >= 0
    automorphism = align_disk(own.z[held], disk.z[held], np.ones(int(held.sum())))
    return place_points(setting.source, automorphism(own.z), controls.points)


def moved_disk(disk: DiskSurface, surface: FloatArray) -> DiskSurface:
    """The same disk over moved surface vertices; vertices that only close holes stay."""
    vertices = disk.mesh.vertices.copy()
    held = disk.vertex >= 0
    vertices[held] = surface[disk.vertex[held]]
    return replace(disk, mesh=disk.mesh.moved(vertices))


def _frame(setting: Setting, index: int, shaped: Shaped) -> Frame:
    moment, surface, placed = shaped.moment, shaped.surface, shaped.placed
    distortion = frame_distortion(
        setting.source, setting.editable, setting.before, surface, placed.map.z
    )
    return Frame(
        index=index,
        time=moment.time,
        weights=moment.weights,
        vertices=setting.file_vertices(surface),
        turned_faces=setting.orientation.turned(surface),
        plane=placed.map,
        control_points=placed.reached,
        control_residual=placed.residual,
        left_out=placed.left_out,
        edited_to_disk=distortion.edited_to_disk,
        plane_to_plane=distortion.plane,
        surface_to_surface=distortion.surface,
        similarity=distortion.similarity,
    )
