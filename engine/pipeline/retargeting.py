"""Other places of the same control points on the targets, from an edit that is solved already."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from engine.errors import EngineError, QuasiconformalError
from engine.pipeline.controlling import Requested
from engine.pipeline.exactness import exact_points
from engine.pipeline.frames import Setting, travels
from engine.pipeline.planes import place_points
from engine.pipeline.shaping import ElasticBlending
from engine.restoration import Carried
from engine.types import ComplexArray, FloatArray

_REACH = 0.15  # of the disk's radius: how far a point that moves takes others along
_GENTLE = 4.0  # times its way at least, so that nothing folds


class Retargeting:
    """What is kept of a ``setting`` so that its points may go elsewhere in milliseconds.

    The correspondence stays as it is: around a point that goes elsewhere it is bent smoothly.
    """

    def __init__(self, setting: Setting, asked: Requested) -> None:
        self._setting = setting
        self._asked = asked
        self._carried: dict[int, Carried] = {}

    def to(self, asked: Requested) -> Setting:
        """The setting with the points of the request where ``asked`` has them.

        Raises ``EngineError`` (``other_edit``) where these places and the automatic points of the
        open edit contradict each other.
        """
        setting = self._setting
        controls = setting.problem.controls
        ends, planes = controls.plane_targets.copy(), list(setting.planes)
        moved: list[int] = []
        for index, plane in enumerate(setting.planes):
            which = asked.given[index]
            there = place_points(setting.targets[index], plane.z, asked.given_at[index])
            there = np.where(np.isnan(there), controls.plane[which], there)
            way = there - ends[index, which]
            if not np.abs(way).max(initial=0.0) > 0.0:
                continue
            moved.append(index)
            bend = _Bend(controls.plane[which], way)
            planes[index] = replace(plane, places=plane.places + bend.at(setting.source.disk.z))
            ends[index] += bend.at(controls.plane)
            ends[index, which] = there
        if not moved:
            return setting
        return self._solved(replace(setting, planes=tuple(planes)), ends, moved, asked)

    def _solved(
        self, setting: Setting, ends: ComplexArray, moved: list[int], asked: Requested
    ) -> Setting:
        controls = replace(setting.problem.controls, plane_targets=ends, given_at=asked.given_at)
        problem = setting.problem.sent_to(controls)
        maps, shapes = list(setting.maps), list(setting.shapes)
        blending = cast(ElasticBlending, setting.blending)
        for index in moved:
            where = problem.boundary.at(np.eye(len(ends))[:, index : index + 1])
            try:
                maps[index] = problem.map(
                    problem.goals(ends[index], where), where, setting.maps[index][1]
                )
            except QuasiconformalError as error:
                raise EngineError(
                    "the open edit's plane cannot follow its points to these places: open "
                    "another edit",
                    code="other_edit",
                ) from error
            shapes[index] = self._shape(setting, index, maps[index][0].z, asked)
            blending = blending.with_shape(index, shapes[index])
        return replace(
            setting,
            problem=problem,
            maps=tuple(maps),
            shapes=tuple(shapes),
            blending=blending,
            travels=travels(controls, setting.source, shapes),
        )

    def _shape(
        self, setting: Setting, index: int, image: ComplexArray, asked: Requested
    ) -> FloatArray:
        shaper, controls = setting.shaper, setting.problem.controls
        if index not in self._carried:
            first = self._setting
            self._carried[index] = shaper.carried(
                first.planes[index],
                first.maps[index][0].z,
                first.problem.controls,
                exact_points(self._asked, index, first.planes[index], first.targets[index]),
            )
        plane = setting.planes[index]
        exact = exact_points(asked, index, plane, setting.targets[index])
        positions = exact[1] if exact is not None else np.zeros((0, 3))
        return shaper.carried_again(self._carried[index], plane, image, controls, positions)


class _Bend:
    """A smooth plane field that takes ``centres`` (k,) along ``ways`` (k,) (Wendland 1995)."""

    def __init__(self, centres: ComplexArray, ways: ComplexArray) -> None:
        self._centres = centres
        self._reach = max(_REACH, _GENTLE * float(np.abs(ways).max()))
        self._strength = np.linalg.solve(self._bump(centres), ways)

    def _bump(self, z: ComplexArray) -> FloatArray:
        r = np.minimum(np.abs(z[:, None] - self._centres) / self._reach, 1.0)
        return (1 - r) ** 4 * (4 * r + 1)

    def at(self, z: ComplexArray) -> ComplexArray:
        """The field (n,) at ``z`` (n,)."""
        return self._bump(z) @ self._strength
