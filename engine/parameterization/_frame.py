"""The frame of a disk map: the Möbius freedom, fixed by measures of the surface itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression

from engine.errors import ParameterizationError
from engine.parameterization._automorphism import DiskAutomorphism, centring
from engine.parameterization._harmonic_kernels import barycentric_areas
from engine.types import ComplexArray, DiskSurface, FloatArray, IntArray

_NO_DIRECTION = 1e-9  # of the disk's radius


@dataclass(frozen=True, slots=True)
class Frame:
    """``area`` (n,): shares of the surface's own area at the vertices. ``rim`` (b,): shares of the
    length of the boundary at its vertices ``boundary``. Both sum to 1. ``bearing`` (n,): of an
    opened surface, what each vertex weighs for the rotation.

    A map is in the frame if its means by area and by rim are opposite, the rim's on the positive
    real axis. Both are integrals over the surface, so the frame depends neither on pose, scale
    and labels nor, but for what a triangulation cuts off, on the triangulation. The rim in it
    keeps a large area (a head above its neck) from being squeezed against the circle's far side.

    The rim of an opened surface runs along whichever edges are there, and may lie around the mean
    by area. There the mean by area is 0, and that weighted by the component of the place in space
    along the surface's bearing as well lies on the positive real axis.
    """

    area: FloatArray
    rim: FloatArray
    boundary: IntArray
    bearing: FloatArray | None = None

    @classmethod
    def of(cls, disk: DiskSurface) -> Frame:
        """The frame of a disk. Raises ``ParameterizationError`` if the surface has no area."""
        area = barycentric_areas(disk.mesh.vertices, disk.mesh.faces[: len(disk.face)])
        if not area.sum() > 0:
            raise ParameterizationError(
                "the surface has no area: its vertices lie on one line or point",
                code="no_area",
                elements={"faces": list(range(min(100, len(disk.face)))), "count": len(disk.face)},
            )
        lengths = edge_lengths(disk)
        rim = lengths + np.roll(lengths, 1)
        area = area / area.sum()
        if disk.opening is not None:
            along = (disk.mesh.vertices - disk.opening.centre) @ disk.opening.bearing
            scale = np.sqrt(area @ along**2)
            bearing = area * along / scale if scale > 0 else None
            return cls(area, 0.0 * rim, disk.boundary, bearing)
        return cls(area, rim / max(rim.sum(), np.finfo(float).tiny), disk.boundary)

    def centring(self, z: ComplexArray) -> DiskAutomorphism:
        """The automorphism without rotation that makes the two means of z (n,) opposite."""
        both = self.area.copy()
        both[self.boundary] += self.rim
        return centring(z, both)

    def turned(self, z: ComplexArray) -> ComplexArray:
        """``z`` (n,) rotated so that the mean by area lies on the negative real axis, or that by
        the bearing on the positive one.

        Where it is 0 (the surface has no direction) z keeps the direction that it came in.
        """
        mean = complex(self.area @ z) if self.bearing is None else -complex(self.bearing @ z)
        if abs(mean) < _NO_DIRECTION:
            return z
        z = z * (-mean.conjugate() / abs(mean))
        z[self.boundary] /= np.abs(z[self.boundary])
        return z

    def framed(self, z: ComplexArray) -> ComplexArray:
        """``z`` (n,) moved into the frame."""
        z = self.centring(z)(z)
        z[self.boundary] = on_circle(z[self.boundary])
        return self.turned(z)


def edge_lengths(disk: DiskSurface) -> FloatArray:
    """Lengths (b,) of the boundary edges; edge i leaves boundary vertex i."""
    loop = disk.mesh.vertices[disk.boundary]
    return np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)


def steps_around(circle: ComplexArray) -> FloatArray:
    """Angles (b,), in [0, 2 pi), from each point of the unit circle to the next."""
    return np.mod(np.angle(np.roll(circle, -1) / circle), 2 * np.pi)


def on_circle(z: ComplexArray) -> ComplexArray:
    """``z`` (k,), in order around 0, projected onto the unit circle, neighbours kept apart.

    No step is less than 1e-5 of the mean one or 2e-7, below which doubles no longer tell three
    points of the circle from a straight line.
    """
    circle = z / np.abs(z)
    steps = steps_around(circle)
    steps = np.where(steps > 2 * np.pi - 1e-6, 0.0, steps)
    least = max(1e-5 * 2 * np.pi / len(z), 2e-7)
    if steps.min() >= least:
        return circle
    steps = np.maximum(steps, least)
    turned = np.cumsum(steps[:-1]) * (2 * np.pi / steps.sum())
    return circle[0] * np.exp(1j * np.concatenate([[0.0], turned]))


def in_order(z: ComplexArray) -> ComplexArray:
    """``z`` (k,), roughly in order around 0, on the unit circle and in order (isotonic)."""
    circle = z / np.abs(z)
    steps = np.angle(np.roll(circle, -1) / circle)
    if steps.min() >= 0:
        return circle
    angle = np.angle(circle[0]) + np.concatenate([[0.0], np.cumsum(steps[:-1])])
    around = np.concatenate([angle - 2 * np.pi, angle, angle + 2 * np.pi])
    return np.exp(1j * isotonic_regression(around).x[len(z) : 2 * len(z)])
