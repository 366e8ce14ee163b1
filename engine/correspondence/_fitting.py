"""Non-rigid registration of a deformable surface to a target: the iteration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.correspondence._energy import DeformableSurface, Planes, System
from engine.correspondence._loops import LoopPair
from engine.nearest import Feet, NormalAwareIndex
from engine.operators import vertex_areas, vertex_normals
from engine.types import FloatArray, IntArray, Mesh


@dataclass(frozen=True, slots=True)
class Step:
    """One step's lengths, in square roots of the source's area.

    ``smooth`` ℓ: detail below this length is smoothness' business; ``reach`` σ of the Welsch
    kernel on closest-point distances; ``normal_weight`` of the closest-point search.
    """

    smooth: float
    reach: float
    normal_weight: float


@dataclass(frozen=True, slots=True)
class Weights:
    """Weights of the energy's terms relative to the source's point-to-plane term."""

    point: float = 0.005  # point-to-point part of a source vertex's pull
    back: float = 8.0  # planes of target vertices on the source
    loop: float = 2.0
    slit_slide: float = 0.5  # tangential part of a loop's pull where its parameters are fixed
    outer_slide: float = 0.02
    landmark: float = 0.002  # area that a landmark stands for
    stretching: float = 0.05
    static: float = 0.0
    agree: float = 0.5  # least cosine of matching normals


@dataclass(frozen=True, slots=True)
class Landmarks:
    """Points ``at`` a deformable surface and the positions ``goals`` (k, 3) they belong to."""

    at: Feet
    goals: FloatArray


class Target:
    """The target in the source's frame, its indices by normal weight, and samples of it."""

    def __init__(self, mesh: Mesh, samples: int = 5000) -> None:
        self.mesh = mesh
        self.normals = vertex_normals(mesh)
        self._areas = vertex_areas(mesh)
        self._first = NormalAwareIndex(mesh, 0.1)
        self._indices = {0.1: self._first}
        rng = np.random.default_rng(0)
        used = np.flatnonzero(self._areas > 0)
        self._order = rng.permutation(used)
        self._samples = min(samples, len(used))

    def index(self, normal_weight: float) -> NormalAwareIndex:
        """The index for a normal weight, rounded to hundredths."""
        key = round(normal_weight, 2)
        if key not in self._indices:
            self._indices[key] = NormalAwareIndex(self.mesh, key, self._first.stars)
        return self._indices[key]

    def samples(self, turn: int) -> tuple[IntArray, FloatArray]:
        """Vertices for target-to-source terms, others at each ``turn``, and their areas."""
        chosen = np.roll(self._order, -turn * self._samples)[: self._samples]
        share = self._areas[self._order].sum() / self._areas[chosen].sum()
        return chosen, self._areas[chosen] * share


def welsch(distance: FloatArray, width: float) -> FloatArray:
    """exp(-d² / 2σ²): how much a foot at this distance counts."""
    return np.exp(-(distance**2) / (2 * width**2))


@dataclass(frozen=True, slots=True)
class Fitting:
    """Everything that stays the same while ``surface`` deforms onto ``target``.

    ``static`` (n,) in [0, 1] tells how surely a vertex has not moved.
    """

    surface: DeformableSurface
    target: Target
    loops: tuple[LoopPair, ...]
    landmarks: Landmarks | None
    weights: Weights
    static: FloatArray

    def run(self, start: FloatArray, steps: Sequence[Step]) -> FloatArray:
        """Positions (n, 3) after all ``steps`` from ``start``.

        Each step minimises data terms at the current closest points plus ℓ⁴ times the bending
        (biharmonic) energy of the displacement and a little of its membrane energy.
        """
        x = start
        for turn, step in enumerate(steps):
            x = self._step(x, step, turn)
        return x

    def _step(self, x: FloatArray, step: Step, turn: int) -> FloatArray:
        surface = self.surface
        rest, moved = surface.mesh.vertices, surface.mesh.moved(x)
        stretching = self.weights.stretching * step.smooth**2
        operator, data = surface.smoothness(step.smooth**4, stretching)
        pulls = _Pulls(np.zeros((surface.n, 3, 3)), operator @ rest)
        self._pull_to_target(pulls, moved, step)
        self._pull_loops(pulls, x, step)
        pulls.add_points(rest, self.weights.static * self.static * surface.areas)
        pulls.add_points(x, np.full(surface.n, 1e-6 * step.smooth**4))
        surface.add_at_vertices(data, pulls.blocks)
        system = (data, pulls.right)
        if self.weights.back > 0:
            self._pull_back(system, moved, step, turn)
        self._pull_landmarks(system)
        return surface.pattern.factor(data).solve(pulls.right.ravel()).reshape(-1, 3)

    def _pull_to_target(self, pulls: _Pulls, moved: Mesh, step: Step) -> None:
        normals = vertex_normals(moved)
        feet = self.target.index(step.normal_weight).feet(moved.vertices, normals)
        agree = np.einsum("ni,ni->n", normals, feet.normal) > self.weights.agree
        w = self.surface.areas * welsch(feet.distance, step.reach) * (agree & ~feet.on_border)
        planes = feet.normal[:, :, None] * feet.normal[:, None, :]
        planes += self.weights.point * np.eye(3)
        pulls.add(np.arange(self.surface.n), w[:, None, None] * planes, feet.position)

    def _pull_loops(self, pulls: _Pulls, x: FloatArray, step: Step) -> None:
        for pair in self.loops:
            positions = x[pair.vertices]
            goals, tangents = pair.goals(positions)
            gaps = np.linalg.norm(np.roll(positions, -1, axis=0) - positions, axis=1)
            w = self.weights.loop * step.smooth * (gaps + np.roll(gaps, 1)) / 2
            free = self.weights.outer_slide if pair.slides else self.weights.slit_slide
            across = np.eye(3) - (1 - free) * tangents[:, :, None] * tangents[:, None, :]
            pulls.add(pair.vertices, w[:, None, None] * across, goals)

    def _pull_back(self, system: System, moved: Mesh, step: Step, turn: int) -> None:
        chosen, areas = self.target.samples(turn)
        points, normals = self.target.mesh.vertices[chosen], self.target.normals[chosen]
        index = NormalAwareIndex(moved, step.normal_weight, self.surface.stars)
        feet = index.feet(points, normals)
        agree = np.einsum("ti,ti->t", normals, feet.normal) > self.weights.agree
        w = self.weights.back * areas * welsch(feet.distance, step.reach)
        planes = Planes(points, normals, w * (agree & ~feet.on_border))
        self.surface.add_planes(system, feet, planes)

    def _pull_landmarks(self, system: System) -> None:
        if self.landmarks is None:
            return
        goals = self.landmarks.goals
        w = np.full(len(goals), self.weights.landmark)
        for axis in np.eye(3):
            planes = Planes(goals, np.tile(axis, (len(goals), 1)), w)
            self.surface.add_planes(system, self.landmarks.at, planes)


@dataclass(frozen=True, slots=True)
class _Pulls:
    """Quadratic pulls on single vertices, summed: blocks (n, 3, 3) and right-hand side (n, 3)."""

    blocks: FloatArray
    right: FloatArray

    def add(self, vertices: IntArray, blocks: FloatArray, goals: FloatArray) -> None:
        self.blocks[vertices] += blocks
        self.right[vertices] += np.einsum("nij,nj->ni", blocks, goals)

    def add_points(self, goals: FloatArray, weights: FloatArray) -> None:
        blocks = weights[:, None, None] * np.eye(3)
        self.add(np.arange(len(goals)), blocks, goals)
