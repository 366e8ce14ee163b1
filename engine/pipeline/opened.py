"""An edit that stays open: other weights and moves of the same control points, at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from engine.at_once import both
from engine.controls import Address, ControlPoint
from engine.errors import EngineError
from engine.measures import MeasuredSurface, SurfaceDistance
from engine.pipeline.controlling import Requested
from engine.pipeline.frames import (
    Setting,
    Shaped,
    carried_mesh,
    compared,
    make_meshes,
    measure_frames,
    shape_frames,
)
from engine.pipeline.retargeting import Retargeting
from engine.pipeline.shaping import handles
from engine.pipeline.values import (
    CarriedMesh,
    CarriedTarget,
    Edit,
    EditedMeshes,
    EditPlan,
    Match,
    Stages,
    Value,
)
from engine.types import PlaneMap


class OpenEdit:
    """A source and its targets with everything solved that weights and moves do not change.

    Plans given to ``edit`` and ``meshes`` may differ from the first one in weights, distances,
    frames, keyframes, moves, which points are fixed, and where the points that have a ``to`` on a
    target have it, not in anything else. Raises ``EngineError`` (``other_edit``) for those that
    do. For another ``to`` the correspondence is bent around the point, not found anew as another
    edit would; ``edit`` refuses likewise where the planes cannot follow, ``meshes`` needs none.
    """

    def __init__(
        self,
        setting: Setting,
        matches: Sequence[Match],
        asked: Requested,
        resolve: Callable[[Sequence[ControlPoint]], Requested],
        stages: Stages,
    ) -> None:
        self._setting = setting
        self._matches = tuple(matches)
        self._asked = asked
        self._resolve = resolve
        self._retargeting = Retargeting(setting, asked)
        self._stages = stages
        self._grip = setting.handles.points, setting.grip
        self._seen: dict[int, SurfaceDistance] = {}
        self._carried: dict[int, CarriedMesh] = {}
        self._surfaces: dict[int, MeasuredSurface] = {}

    def meshes(self, plan: EditPlan | None = None) -> EditedMeshes:
        """The meshes that ``edit`` makes, without planes and figures."""
        setting = self._asked_for(plan)
        frames, targets = both(
            lambda: make_meshes(setting, self._stages), lambda: self._on_targets(setting)
        )
        return EditedMeshes(setting.source, setting.problem.controls, targets, tuple(frames))

    def edit(self, plan: EditPlan | None = None) -> Edit:
        """Everything about every frame, and the source on every target."""
        asked, stages = self._asked_for(plan), self._stages
        (setting, shaped), seen = both(
            lambda: self._shaped(asked),
            lambda: [self._compared(asked, index) for index in range(len(asked.maps))],
        )
        meshes = self._on_targets(setting)
        planes = [plane for plane, _ in setting.maps]
        targets = map(_carried_target, meshes, planes, seen)
        frames = measure_frames(setting, shaped, stages)
        return Edit(
            setting.source, setting.problem.controls, tuple(targets), tuple(frames), setting.before
        )

    def _asked_for(self, plan: EditPlan | None) -> Setting:
        if plan is None:
            return self._setting
        return self._stages.run("restoration", "", lambda: self._with(plan))

    def _shaped(self, asked: Setting) -> tuple[Setting, list[Shaped]]:
        stages = self._stages
        setting = stages.run("iteration", "", lambda: self._retargeting.mapped(asked))
        return setting, shape_frames(setting, stages)

    def prepare(self) -> None:
        """Make now what other places on targets need, not when they are first asked for."""
        self._retargeting.prepare()
        for index, given in enumerate(self._asked.given):
            if len(given):
                self._measured(index)

    def _on_targets(self, setting: Setting) -> tuple[CarriedMesh, ...]:
        """The source on every target."""
        return tuple(
            self._once(
                self._carried, setting, index, lambda i=index, m=match: carried_mesh(setting, i, m)
            )
            for index, match in enumerate(self._matches)
        )

    def _compared(self, setting: Setting, index: int) -> SurfaceDistance:
        """How far the source on one target is from it."""
        return self._once(
            self._seen,
            setting,
            index,
            lambda: compared(setting, index, lambda: self._measured(index), self._stages),
        )

    def _once(
        self, kept: dict[int, Value], setting: Setting, index: int, made: Callable[[], Value]
    ) -> Value:
        """What is ``made`` of a target, ``kept`` as long as no point goes elsewhere there."""
        if setting.shapes[index] is not self._setting.shapes[index]:
            return made()
        if index not in kept:
            kept[index] = made()
        return kept[index]

    def _measured(self, index: int) -> MeasuredSurface:
        """One target's surface, to which shapes are compared again and again."""
        if index not in self._surfaces:
            self._surfaces[index] = MeasuredSurface(self._setting.planes[index].editable)
        return self._surfaces[index]

    def _with(self, plan: EditPlan) -> Setting:
        setting = self._setting
        if _kept(plan) != _kept(setting.plan):
            raise EngineError(
                "an open edit keeps its control points' places, bins and options: open another one",
                code="other_edit",
            )
        asked = self._asked
        if _goals(plan) != _goals(setting.plan):
            asked = self._resolve(plan.points)
            setting = self._retargeting.to(asked)
        held = handles(plan.points, asked, setting.source.diagonal)
        same = np.array_equal(held.points.face, self._grip[0].face)
        same &= np.array_equal(held.points.barycentric, self._grip[0].barycentric)
        if not same:
            self._grip = held.points, setting.shaper.grip(held)
        return replace(setting, plan=plan, handles=held, grip=self._grip[1])


def _carried_target(mesh: CarriedMesh, plane: PlaneMap, distance: SurfaceDistance) -> CarriedTarget:
    return CarriedTarget(
        name=mesh.name,
        vertices=mesh.vertices,
        surface=mesh.surface,
        centre=mesh.centre,
        warnings=mesh.warnings,
        match=mesh.match,
        turned_faces=mesh.turned_faces,
        plane=plane,
        distance=distance,
    )


def _kept(plan: EditPlan) -> tuple[object, ...]:
    """What all plans of one open edit share."""
    places = [(point.name, point.at, sorted(point.to)) for point in plan.points]
    if plan.options.restoration == "paper":
        return places, _goals(plan), plan.auto, plan.histogram_bins, plan.options
    return places, plan.auto, plan.histogram_bins, plan.options


def _goals(plan: EditPlan) -> list[dict[str, Address]]:
    return [dict(point.to) for point in plan.points]
