"""Closed curves by arc length, and the two corners of an eye or a mouth."""

from __future__ import annotations

import numpy as np

from engine.correspondence._curve_kernels import closest_on_polyline
from engine.types import FloatArray, IntArray

_CORNER_REACH = 0.04  # of the length: over how much a turn is measured
_CORNER_SAMPLES = 600


class ClosedCurve:
    """A closed polyline through ``points`` (k, 3), parametrised by arc length in [0, length)."""

    def __init__(self, points: FloatArray) -> None:
        self.points = points
        self._closed = np.vstack((points, points[:1]))
        self._steps = np.diff(self._closed, axis=0)
        self._lengths = np.maximum(np.linalg.norm(self._steps, axis=1), 1e-300)
        self.parameters = np.concatenate(([0.0], np.cumsum(self._lengths)))
        self.length = float(self.parameters[-1])
        self.centroid = self.at(np.arange(400) / 400 * self.length).mean(axis=0)

    def at(self, parameter: FloatArray) -> FloatArray:
        """Positions (m, 3) at arc lengths (m,), taken modulo the length."""
        t = np.mod(parameter, self.length)
        columns = [np.interp(t, self.parameters, self._closed[:, k]) for k in range(3)]
        return np.stack(columns, axis=1)

    def tangent(self, parameter: FloatArray) -> FloatArray:
        """Unit tangents (m, 3), averaged over two hundredths of the length."""
        h = 0.01 * self.length
        chord = self.at(parameter + h) - self.at(parameter - h)
        return chord / np.maximum(np.linalg.norm(chord, axis=1), 1e-300)[:, None]

    def project(self, points: FloatArray) -> FloatArray:
        """Arc length (m,) of the closest point of the curve to each of ``points`` (m, 3)."""
        nearest, part = closest_on_polyline(points, self.points, self._steps)
        return self.parameters[nearest] + part * self._lengths[nearest]

    def segment(self, parameter: FloatArray) -> tuple[IntArray, FloatArray]:
        """The segment (m,) at arc lengths (m,), from point k to the next, and how far along it."""
        t = np.mod(parameter, self.length)
        index = np.clip(
            np.searchsorted(self.parameters, t, side="right") - 1, 0, len(self.points) - 1
        )
        return index, np.clip((t - self.parameters[index]) / self._lengths[index], 0, 1)

    @property
    def vector_area(self) -> FloatArray:
        """Half the sum of successive points' cross products (3,): normal to the hole, its area."""
        arms = self.points - self.centroid
        return np.cross(arms, np.roll(arms, -1, axis=0)).sum(axis=0) / 2

    @property
    def openness(self) -> float:
        """The area of what it surrounds over that of a circle as long: near 0 for a slit."""
        return 4 * np.pi * float(np.linalg.norm(self.vector_area)) / self.length**2

    def winding(self, axis: FloatArray, centre: FloatArray) -> int:
        """How often the curve turns around the line through ``centre`` (3,) along ``axis`` (3,)."""
        first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        arms = self._closed - centre
        angles = np.arctan2(arms @ np.cross(axis, first), arms @ first * np.linalg.norm(axis))
        turns = np.diff(angles) / (2 * np.pi)
        return round(float((turns - np.rint(turns)).sum()))

    def principal_axis(self) -> FloatArray:
        """The unit direction (3,) in which the curve extends most."""
        samples = self.at(np.arange(400) / 400 * self.length)
        return np.linalg.svd(samples - self.centroid, full_matrices=False)[2][0]

    def slit_evidence(
        self, axis: FloatArray, samples: int, reach: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Arc lengths (samples,), and what speaks for a corner there.

        The extent along ``axis``, at most 1, and 1 - cos of the turn over ``reach`` lengths.
        """
        t = np.arange(samples) / samples * self.length
        here, h = self.at(t), reach * self.length
        ahead, behind = self.at(t + h) - here, here - self.at(t - h)
        scale = np.linalg.norm(ahead, axis=1) * np.linalg.norm(behind, axis=1)
        turning = 1 - np.einsum("ti,ti->t", ahead, behind) / np.maximum(scale, 1e-300)
        extent = (here - self.centroid) @ axis
        return t, extent / max(float(np.abs(extent).max()), 1e-300), turning

    def corners(self, axis: FloatArray) -> tuple[float, float]:
        """Arc lengths of the two corners of a slit along ``axis``.

        A corner lies far out along the axis and the curve turns there: argmax of the relative
        extent plus 1 - cos(turning angle).
        """
        t, extent, turning = self.slit_evidence(axis, _CORNER_SAMPLES, _CORNER_REACH)
        return float(t[np.argmax(extent + turning)]), float(t[np.argmax(turning - extent)])
