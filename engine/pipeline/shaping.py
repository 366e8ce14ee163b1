"""From plane to space within an edit: the source on each target, frames between, direct moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from engine.controls import ControlPoint
from engine.linalg import Keep
from engine.pipeline.controlling import Requested
from engine.pipeline.planes import Reading, TargetPlane, beyond_map, finely_mapped, strayed
from engine.pipeline.values import Controls, Options, Prepared
from engine.restoration import Carried, Extrapolator, Follower, Grip, Restorer, restore_paper
from engine.types import ComplexArray, FloatArray, IntArray, SurfacePoints, frozen_array

Blending = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Handles:
    """Points that end exactly ``offset`` (h, 3) away: moved ones, and fixed ones (offset 0)."""

    points: SurfacePoints
    offset: FloatArray
    fixed: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset", frozen_array(self.offset, np.float64))
        object.__setattr__(self, "fixed", frozen_array(self.fixed, np.int64))


def handles(points: Sequence[ControlPoint], asked: Requested, diagonal: float) -> Handles:
    """The request's ``move`` and ``fixed`` points, offsets in normalised units."""
    held = [i for i, point in enumerate(points) if point.fixed or point.move is not None]
    offset = [points[i].move or (0.0, 0.0, 0.0) for i in held]
    which = np.asarray(held, dtype=np.int64)
    return Handles(
        SurfacePoints(asked.points.face[which], asked.points.barycentric[which]),
        np.asarray(offset, dtype=np.float64).reshape(-1, 3) / diagonal,
        np.flatnonzero([points[i].fixed for i in held]),
    )


@dataclass(frozen=True, slots=True)
class ElasticBlending:
    """The default's blend, of targets that may be exchanged one by one."""

    blender: Extrapolator

    def __call__(self, weights: FloatArray) -> FloatArray:
        """The surface (n, 3) at weights (targets, 1) or (targets, n)."""
        return self.blender.at(weights if weights.shape[1] > 1 else weights[:, 0])

    def with_shapes(self, shapes: Mapping[int, FloatArray]) -> ElasticBlending:
        """The same with other ``shapes`` (n, 3) of some targets."""
        return ElasticBlending(self.blender.with_shapes(shapes))


class Shaper:
    """Restores the source surface (n, 3) from its edited planes; factored once per source."""

    def __init__(self, source: Prepared, options: Options) -> None:
        self._source = source
        self._options = options
        self._restorer = Restorer(source.surface.mesh)

    def on_target(
        self,
        plane: TargetPlane,
        image: ComplexArray,
        controls: Controls,
        exact: tuple[SurfacePoints, FloatArray] | None,
    ) -> FloatArray:
        """The source carried to one target, of which ``image`` (n_disk,) is the edited plane.

        ``exact``: points of the source that the request placed on the target, and where.
        """
        reading = self.reading(plane, image, controls)
        if self._options.restoration == "paper":
            looked_up, _ = self._looked_up(reading, image)
            known = self.known_vertices(controls)
            return restore_paper(self._source.surface.mesh, known, looked_up[known])
        return self.carried(reading, image, exact).shape

    def reading(self, plane: TargetPlane, image: ComplexArray, controls: Controls) -> Reading:
        """What can be read of a target around where ``image`` (n_disk,) has the source."""
        readable = (self._source.disk.surface.vertex >= 0) & finely_mapped(self._source)
        beyond = np.zeros_like(image)
        if len(controls.names) > controls.requested:
            readable &= ~strayed(self._source, plane, image)
            beyond = beyond_map(plane, image)
        return Reading(plane, readable, beyond)

    def carried(
        self,
        reading: Reading,
        image: ComplexArray,
        exact: tuple[SurfacePoints, FloatArray] | None,
    ) -> Carried:
        """The default's answer of ``on_target``, ready to follow other planes."""
        return self._restorer.carried(*self._looked_up(reading, image), exact)

    def carried_again(
        self, follower: Follower, reading: Reading, image: ComplexArray, positions: FloatArray
    ) -> FloatArray:
        """The source on a target whose plane, and whose exact points, have moved a little."""
        looked_up, _ = self._looked_up(reading, image)
        return follower.at(looked_up, positions)

    def _looked_up(self, reading: Reading, image: ComplexArray) -> tuple[FloatArray, FloatArray]:
        """Where each surface vertex (n, 3) is on the target, and how sure that is (n,)."""
        held = self._source.disk.surface.vertex >= 0
        positions, sure = reading.at(image)
        vertex = self._source.disk.surface.vertex[held]
        looked_up = self._source.surface.mesh.vertices.copy()
        confidence = np.zeros(len(looked_up))
        looked_up[vertex], confidence[vertex] = positions[held], sure[held]
        return looked_up, confidence

    def blending(
        self, shapes: Sequence[FloatArray], controls: Controls, keep: Keep | None = None
    ) -> Blending:
        """How the source goes towards ``shapes`` at weights (targets, 1) or (targets, n)."""
        if not shapes:
            return lambda weights: self._source.surface.mesh.vertices
        if self._options.restoration == "paper":
            return lambda weights: self._known_points_blended(shapes, weights, controls)
        return ElasticBlending(self._restorer.blender(shapes, keep))

    def _known_points_blended(
        self, shapes: Sequence[FloatArray], weights: FloatArray, controls: Controls
    ) -> FloatArray:
        """Algorithm 5 between targets: its known points go along eq. (7)'s straight lines."""
        rest = self._source.surface.mesh.vertices
        if not weights.any():
            return rest
        known = self.known_vertices(controls)
        positions = rest[known].copy()
        for shape, weight in zip(shapes, weights, strict=True):
            spread = np.broadcast_to(weight, len(rest))[known, None]
            positions += spread * (shape[known] - rest[known])
        return restore_paper(self._source.surface.mesh, known, positions)

    def grip(self, held: Handles) -> Grip | None:
        """What moves and holds the direct points, if any, for any offsets and frames."""
        return self._restorer.grip(held.points) if len(held.points) else None

    def with_handles(
        self, blended: FloatArray, held: Handles, grip: Grip | None, share: float
    ) -> FloatArray:
        """Move and hold the request's direct points on an already blended surface."""
        if grip is None:
            return blended
        mesh = self._source.surface.mesh
        here = held.points.on(mesh.moved(blended))
        goals = here + share * held.offset
        goals[held.fixed] = held.points.on(mesh)[held.fixed]
        if np.array_equal(goals, here):
            return blended
        return grip.at(goals, blended)

    def known_vertices(self, controls: Controls) -> IntArray:
        """Algorithm 5's known points: the vertices at the control points."""
        corner = np.argmax(controls.points.barycentric, axis=1)
        return np.unique(self._source.surface.mesh.faces[controls.points.face, corner])
