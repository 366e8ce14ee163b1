"""Other places of the same control points on the targets, from an edit that is solved already."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import cast

import numpy as np

from engine.at_once import each
from engine.errors import EngineError, QuasiconformalError
from engine.pipeline._bend_kernels import bent, bumps
from engine.pipeline.controlling import Requested
from engine.pipeline.exactness import exact_points
from engine.pipeline.frames import Setting, travels
from engine.pipeline.mapping import on_disk
from engine.pipeline.planes import Reading, length_per_plane, place_points
from engine.pipeline.shaping import ElasticBlending
from engine.restoration import Follower
from engine.types import ComplexArray, FloatArray, PlaneMap

_NEAR = 0.1  # of the disk's radius: how far a point takes others along in a correspondence
_REACH = (0.15, 0.5)  # the same in a plane map alone,
_SPACING = 1.6  # over the root of the number of points: where they are few, it takes more along
_GENTLE = 4.0  # times its way at least, so that nothing folds
_JUMP = 5.0  # times as far in the plane as in space: over lips or lids, to the other side


@dataclass(frozen=True, slots=True)
class _Followed:
    """One target as the open edit has it, ready to follow other places of the points."""

    reading: Reading
    follower: Follower
    exact: FloatArray


@dataclass(frozen=True, slots=True)
class _Sent:
    """One target after that: where its control points go, its bent plane, the source on it."""

    ends: ComplexArray
    refined: ComplexArray
    shape: FloatArray


class Retargeting:
    """What is kept of a ``setting`` so that its points may go elsewhere in milliseconds.

    The correspondence and the plane stay as they are, but for the surroundings of a point that
    goes elsewhere: there they are bent smoothly.
    """

    def __init__(self, setting: Setting, asked: Requested) -> None:
        self._setting = setting
        self._asked = asked
        self._followed: dict[int, _Followed] = {}
        points = on_disk(setting.source, setting.problem.controls.points)
        corner = np.argmax(points.barycentric, axis=1)
        vertex = setting.source.disk.surface.mesh.faces[points.face, corner]
        self._length = length_per_plane(setting.source)[vertex]
        controls = setting.problem.controls
        alone = float(np.clip(_SPACING / np.sqrt(max(len(points), 1)), *_REACH))
        self._reach = _NEAR if len(controls.names) > controls.requested else alone

    def prepare(self) -> None:
        """Make all that is kept for ``to``, of every target that points have a place on."""
        for index, given in enumerate(self._asked.given):
            if len(given):
                self._follow(index)

    def to(self, asked: Requested) -> Setting:
        """The setting with the points where ``asked`` has them; its ``maps`` are but bent."""
        setting = self._setting
        tasks = [partial(self._sent, asked, index) for index in range(len(setting.planes))]
        sent = {index: one for index, one in enumerate(each(tasks)) if one is not None}
        if not sent:
            return setting
        controls = setting.problem.controls
        ends, shapes = controls.plane_targets.copy(), list(setting.shapes)
        maps = list(setting.maps)
        for index, one in sent.items():
            ends[index], shapes[index] = one.ends, one.shape
            maps[index] = maps[index][0], one.refined
        controls = replace(controls, plane_targets=ends, given_at=asked.given_at)
        blending = cast(ElasticBlending, setting.blending)
        return replace(
            setting,
            problem=setting.problem.sent_to(controls),
            shapes=tuple(shapes),
            maps=tuple(maps),
            blending=blending.with_shapes({index: one.shape for index, one in sent.items()}),
            travels=travels(controls, setting.source, shapes),
        )

    def _sent(self, asked: Requested, index: int) -> _Sent | None:
        """One target with its points where ``asked`` has them; None if they stay."""
        setting = self._setting
        controls, (plane, refined) = setting.problem.controls, setting.maps[index]
        way, exact = self._ways(index, asked)
        if not np.abs(way).max(initial=0.0) > 0.0:
            return None
        which = asked.given[index]
        smooth = self._without_jumps(index, way, exact)
        bend = _Bend(controls.plane[which], smooth, self._reach)
        ends = controls.plane_targets[index] + bend.at(controls.plane)
        ends[which] += way - smooth
        followed = self._follow(index)
        image = plane.z + bend.at(setting.source.disk.z)
        shape = setting.shaper.carried_again(followed.follower, followed.reading, image, exact)
        return _Sent(ends, refined + bend.at(setting.problem.z), shape)

    def mapped(self, setting: Setting) -> Setting:
        """The ``setting`` that ``to`` gave, its planes solved.

        Raises ``EngineError`` (``other_edit``) where its points and the automatic points of the
        open edit contradict each other.
        """
        before = self._setting.problem.controls.plane_targets
        ends, maps = setting.problem.controls.plane_targets, list(setting.maps)
        moved: list[int] = np.flatnonzero((ends != before).any(axis=1)).tolist()
        solved = each([partial(self._solved, setting, index) for index in moved])
        for index, one in zip(moved, solved, strict=True):
            maps[index] = one
        return replace(setting, maps=tuple(maps))

    def _solved(self, setting: Setting, index: int) -> tuple[PlaneMap, ComplexArray]:
        """One target's plane of the ``setting`` that ``to`` gave.

        From its bent one; where the points fold that, from the one before.
        """
        problem = setting.problem.anew()
        ends = problem.controls.plane_targets
        where = problem.boundary.at(np.eye(len(ends))[:, index : index + 1])
        goals = problem.goals(ends[index], where)
        start = problem.placed(setting.maps[index][1], goals, where)
        try:
            return problem.map(
                goals, where, self._setting.maps[index][1] if start is None else start
            )
        except QuasiconformalError as error:
            raise EngineError(
                "the open edit's plane cannot follow its points to these places: open another edit",
                code="other_edit",
            ) from error

    def _ways(self, index: int, asked: Requested) -> tuple[ComplexArray, FloatArray]:
        """How far the points (k,) of a target go in its plane, and where they then are (k, 3)."""
        setting = self._setting
        plane, target = setting.planes[index], setting.targets[index]
        exact = exact_points(asked, index, plane, target)
        if exact is None:
            return np.zeros(0, dtype=np.complex128), np.zeros((0, 3))
        before = setting.problem.controls.plane_targets[index, asked.given[index]]
        there = place_points(target, plane.z, asked.given_at[index])
        start = setting.problem.controls.plane[asked.given[index]]
        return np.where(np.isnan(there), start, there) - before, exact[1]

    def _without_jumps(self, index: int, way: ComplexArray, exact: FloatArray) -> ComplexArray:
        """``way`` (k,), 0 where it leads to the other side of an opening that is near in space.

        What is around such a point stays where it is, or the sides would be dragged over each
        other.
        """
        length = self._length[self._asked.given[index]]
        in_space = np.linalg.norm(exact - self._follow(index).exact, axis=1)
        return np.where(np.abs(way) * length > _JUMP * in_space, 0.0, way)

    def _follow(self, index: int) -> _Followed:
        if index not in self._followed:
            setting = self._setting
            plane, image = setting.planes[index], setting.maps[index][0].z
            reading = setting.shaper.reading(plane, image, setting.problem.controls)
            exact = exact_points(self._asked, index, plane, setting.targets[index])
            assert exact is not None
            follower = setting.shaper.carried(reading, image, exact).follower()
            self._followed[index] = _Followed(reading, follower, exact[1])
        return self._followed[index]


class _Bend:
    """A smooth plane field that takes ``centres`` (k,) along ``ways`` (k,)."""

    def __init__(self, centres: ComplexArray, ways: ComplexArray, reach: float) -> None:
        self._centres = centres
        self._reach = max(reach, _GENTLE * float(np.abs(ways).max()))
        matrix = bumps(centres, centres, self._reach)
        self._strength: ComplexArray = np.linalg.solve(matrix, ways).astype(np.complex128)

    def at(self, z: ComplexArray) -> ComplexArray:
        """The field (n,) at ``z`` (n,)."""
        return bent(z, self._centres, self._strength, self._reach)
