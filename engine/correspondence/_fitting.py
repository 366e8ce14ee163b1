"""Non-rigid registration of a deformable surface to a target: the iteration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.correspondence._energy import DeformableSurface
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


def fit(
    surface: DeformableSurface,
    start: FloatArray,
    target: Target,
    steps: Sequence[Step],
    *,
    loops: Sequence[LoopPair],
    landmarks: Landmarks | None,
    weights: Weights,
    static: FloatArray | None = None,
) -> FloatArray:
    """Positions (n, 3) of ``surface`` after all ``steps`` from ``start``."""
    x = start
    rest = surface.mesh.vertices
    for turn, step in enumerate(steps):
        k, data = surface.smoothness(1.0, weights.stretching / step.smooth**2)
        right = k @ rest
        scale = step.smooth**-4
        blocks = np.zeros((surface.n, 3, 3))
        moved = surface.mesh.moved(x)
        pull = _Pull(blocks, right, scale)
        _pull_to_target(pull, surface, moved, target, step, weights)
        for pair in loops:
            _pull_loop(pull, pair, x, step, weights)
        if static is not None:
            pull.add_points(np.arange(surface.n), rest, weights.static * static * surface.areas)
        blocks += 1e-6 * np.eye(3)
        right += 1e-6 * x
        surface.add_at_vertices(data, blocks)
        if weights.back > 0:
            _pull_back((data, right), surface, moved, target, step, weights, turn)
        if landmarks is not None:
            for axis in np.eye(3):
                normals = np.tile(axis, (len(landmarks.goals), 1))
                w = np.full(len(landmarks.goals), weights.landmark * scale)
                surface.add_planes((data, right), landmarks.at, landmarks.goals, normals, w)
        x = surface.pattern.factor(data).solve(right.ravel()).reshape(-1, 3)
    return x


@dataclass(frozen=True, slots=True)
class _Pull:
    """Quadratic pulls on single vertices, gathered: blocks (n, 3, 3) and right-hand side."""

    blocks: FloatArray
    right: FloatArray
    scale: float

    def add(self, vertices: IntArray, blocks: FloatArray, goals: FloatArray) -> None:
        scaled = self.scale * blocks
        self.blocks[vertices] += scaled
        self.right[vertices] += np.einsum("nij,nj->ni", scaled, goals)

    def add_points(self, vertices: IntArray, goals: FloatArray, weights: FloatArray) -> None:
        self.add(vertices, weights[:, None, None] * np.eye(3), goals)


def _pull_to_target(
    pull: _Pull,
    surface: DeformableSurface,
    moved: Mesh,
    target: Target,
    step: Step,
    weights: Weights,
) -> None:
    normals = vertex_normals(moved)
    feet = target.index(step.normal_weight).feet(moved.vertices, normals)
    agree = np.einsum("ni,ni->n", normals, feet.normal) > weights.agree
    w = surface.areas * welsch(feet.distance, step.reach) * (agree & ~feet.on_border)
    planes = feet.normal[:, :, None] * feet.normal[:, None, :] + weights.point * np.eye(3)
    pull.add(np.arange(surface.n), w[:, None, None] * planes, feet.position)


def _pull_loop(pull: _Pull, pair: LoopPair, x: FloatArray, step: Step, weights: Weights) -> None:
    positions = x[pair.vertices]
    goals, tangents = pair.goals(positions)
    gaps = np.linalg.norm(np.roll(positions, -1, axis=0) - positions, axis=1)
    w = weights.loop * step.smooth * (gaps + np.roll(gaps, 1)) / 2
    slide = weights.outer_slide if pair.parameters is None else weights.slit_slide
    across = np.eye(3) - (1 - slide) * tangents[:, :, None] * tangents[:, None, :]
    pull.add(pair.vertices, w[:, None, None] * across, goals)


def _pull_back(
    system: tuple[FloatArray, FloatArray],
    surface: DeformableSurface,
    moved: Mesh,
    target: Target,
    step: Step,
    weights: Weights,
    turn: int,
) -> None:
    chosen, areas = target.samples(turn)
    points, normals = target.mesh.vertices[chosen], target.normals[chosen]
    feet = NormalAwareIndex(moved, step.normal_weight, surface.stars).feet(points, normals)
    agree = np.einsum("ti,ti->t", normals, feet.normal) > weights.agree
    w = weights.back * areas * welsch(feet.distance, step.reach) * (agree & ~feet.on_border)
    surface.add_planes(system, feet, points, normals, w * step.smooth**-4)


def welsch(distance: FloatArray, width: float) -> FloatArray:
    """exp(-d² / 2σ²): how much a foot at this distance counts."""
    return np.exp(-(distance**2) / (2 * width**2))
