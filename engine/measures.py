"""What a result is measured by: Beltrami histograms and their likeness, distances to a target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.errors import EngineError
from engine.locate import PointLocator
from engine.operators import vertex_areas
from engine.types import ComplexArray, FloatArray, IntArray, Mesh, frozen_array

_FLAT = 1e-12  # deviation of a bin's weight from the mean that is rounding


@dataclass(frozen=True, slots=True)
class BeltramiHistogram:
    """The distribution of |mu| over a map's faces.

    ``counts`` (b,) and ``area_weights`` (b,) per bin of ``edges`` (b + 1,): the first sum to the
    number of faces, the second to 1; values beyond the last edge are in the last bin. ``mean`` and
    ``p95`` weigh by area; ``max`` is over all faces. ``undefined`` counts faces whose coefficient
    is not finite (their image has no area): they are in the last bin and in no other figure.
    """

    edges: FloatArray
    counts: IntArray
    area_weights: FloatArray
    mean: float
    p95: float
    max: float
    folds: int
    undefined: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "edges", frozen_array(self.edges, np.float64))
        object.__setattr__(self, "counts", frozen_array(self.counts, np.int64))
        object.__setattr__(self, "area_weights", frozen_array(self.area_weights, np.float64))


@dataclass(frozen=True, slots=True)
class HistogramSimilarity:
    """How alike two histograms are.

    ``wasserstein_1``: how far, in units of |mu|, area has to be moved to turn one into the other,
    each bin's at its middle. ``correlation``: Pearson's, over the bins' area weights; two flat
    histograms correlate by 1, a flat and another one by 0.
    """

    wasserstein_1: float
    correlation: float


@dataclass(frozen=True, slots=True)
class DistanceStatistics:
    """Distances from one surface to another, weighed by area, in the meshes' unit."""

    mean: float
    p95: float
    max: float

    def scaled(self, factor: float) -> DistanceStatistics:
        """The same distances in another unit."""
        return DistanceStatistics(self.mean * factor, self.p95 * factor, self.max * factor)


@dataclass(frozen=True, slots=True)
class SurfaceDistance:
    """Distances both ways: ``to_target`` from the result, ``from_target`` back to it."""

    to_target: DistanceStatistics
    from_target: DistanceStatistics

    def scaled(self, factor: float) -> SurfaceDistance:
        """The same distances in another unit."""
        return SurfaceDistance(self.to_target.scaled(factor), self.from_target.scaled(factor))


def histogram(
    mu: ComplexArray, areas: FloatArray, folds: int, bins: int | FloatArray
) -> BeltramiHistogram:
    """Statistics of the Beltrami coefficients ``mu`` (m,) of faces with ``areas`` (m,).

    ``folds``: how many faces the map turns over, by a signed test. ``bins``: how many equal bins
    on [0, 1], where |mu| of a map without folds lies, or the ascending edges from 0 on.
    """
    edges = np.linspace(0.0, 1.0, bins + 1) if isinstance(bins, int) else bins
    if len(edges) < 2:
        raise EngineError("a histogram needs at least one bin", code="bins")
    size = np.abs(mu)
    finite = np.isfinite(size)
    share = areas / areas.sum() if areas.sum() > 0 else np.full(len(areas), 1 / max(len(areas), 1))
    inside = np.searchsorted(edges, np.where(finite, size, np.inf), side="right") - 1
    which = np.clip(inside, 0, len(edges) - 2)
    held = np.zeros(len(edges) - 1)
    np.add.at(held, which, share)
    good, weight = size[finite], share[finite]
    total = weight.sum()
    return BeltramiHistogram(
        edges=edges,
        counts=np.bincount(which, minlength=len(edges) - 1),
        area_weights=held,
        mean=float(good @ weight / total) if total > 0 else 0.0,
        p95=_weighted_quantile(good, weight, 0.95),
        max=float(good.max(initial=0.0)),
        folds=folds,
        undefined=int(np.count_nonzero(~finite)),
    )


def similarity(a: BeltramiHistogram, b: BeltramiHistogram) -> HistogramSimilarity:
    """Likeness of two area-weighted histograms over the same edges."""
    if not np.array_equal(a.edges, b.edges):
        raise EngineError("histograms over different bins cannot be compared", code="bins")
    middles = 0.5 * (a.edges[1:] + a.edges[:-1])
    ahead = np.cumsum(a.area_weights - b.area_weights)[:-1]
    moved = float(np.abs(ahead) @ np.diff(middles))
    p, q = (h.area_weights - h.area_weights.mean() for h in (a, b))
    flat = [bool(np.abs(deviation).max() < _FLAT) for deviation in (p, q)]
    if any(flat):
        return HistogramSimilarity(moved, float(all(flat)))
    return HistogramSimilarity(moved, float(p @ q / np.sqrt((p @ p) * (q @ q))))


class MeasuredSurface:
    """A surface of ``mesh``, ready for distances to and from others."""

    def __init__(self, mesh: Mesh) -> None:
        weight = vertex_areas(mesh)
        used = weight > 0
        self._locator = PointLocator(mesh)
        self._points = mesh.vertices[used]
        self._weight = weight[used] / weight.sum()

    def distance(self, result: Mesh) -> SurfaceDistance:
        """Distances of each one's vertices to the other's surface (the paper's Fig. 11)."""
        other = MeasuredSurface(result)
        return SurfaceDistance(other._to(self), self._to(other))

    def _to(self, other: MeasuredSurface) -> DistanceStatistics:
        _, distance = other._locator.nearest(self._points)
        return DistanceStatistics(
            mean=float(distance @ self._weight),
            p95=_weighted_quantile(distance, self._weight, 0.95),
            max=float(distance.max(initial=0.0)),
        )


def _weighted_quantile(values: FloatArray, weight: FloatArray, part: float) -> float:
    """The smallest value with at least ``part`` of the weight at or below it; 0 of nothing."""
    if not len(values):
        return 0.0
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    return float(values[order][min(np.searchsorted(below, part * below[-1]), len(order) - 1)])
