"""An edit that stays open: other weights and moves of the same control points, at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from engine.errors import EngineError
from engine.pipeline.controlling import Requested
from engine.pipeline.frames import Setting, carried_target, make_frames, make_meshes
from engine.pipeline.shaping import handles
from engine.pipeline.values import Edit, EditPlan, Match, Stages
from engine.types import FloatArray


class OpenEdit:
    """A source and its targets with everything solved that weights and moves do not change.

    Plans given to ``edit`` and ``meshes`` may differ from the first one in weights, distances,
    frames, keyframes, moves and which points are fixed, not in anything else. Raises
    ``EngineError`` (``other_edit``) for those that do.
    """

    def __init__(
        self, setting: Setting, matches: Sequence[Match], asked: Requested, stages: Stages
    ) -> None:
        self._setting = setting
        self._matches = tuple(matches)
        self._asked = asked
        self._stages = stages

    def meshes(self, plan: EditPlan | None = None) -> list[FloatArray]:
        """The vertices (n_file, 3) of every frame, without planes and figures."""
        return make_meshes(self._setting if plan is None else self._with(plan))

    def edit(self, plan: EditPlan | None = None) -> Edit:
        """Everything about every frame, and the source on every target."""
        setting = self._setting if plan is None else self._with(plan)
        stages = self._stages
        carried = stages.run(
            "measures",
            "",
            lambda: tuple(
                carried_target(setting, index, found, self._matches[index])
                for index, (found, _) in enumerate(setting.maps)
            ),
        )
        frames = make_frames(setting, stages)
        return Edit(
            setting.source, setting.problem.controls, carried, tuple(frames), setting.before
        )

    def _with(self, plan: EditPlan) -> Setting:
        setting = self._setting
        if _kept(plan) != _kept(setting.plan):
            raise EngineError(
                "an open edit keeps its control points' places, bins and options: open another one",
                code="other_edit",
            )
        held = handles(plan.points, self._asked, setting.source.diagonal)
        same = np.array_equal(held.points.face, setting.handles.points.face)
        same &= np.array_equal(held.points.barycentric, setting.handles.points.barycentric)
        grip = setting.grip if same else setting.shaper.grip(held)
        return replace(setting, plan=plan, handles=held, grip=grip)


def _kept(plan: EditPlan) -> tuple[object, ...]:
    """What all plans of one open edit share."""
    places = [(point.name, point.at, dict(point.to)) for point in plan.points]
    return places, plan.auto, plan.histogram_bins, plan.options
