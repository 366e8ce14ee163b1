"""Where to open a closed surface: by integrals over it, whatever its triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from engine.topology._halfedges import twins
from engine.topology._sheets_kernels import face_vectors
from engine.types import FloatArray, IntArray, Mesh

OPENED_SHARE = 0.05
"""Share of the area of a closed surface that lies in the ball where it is opened."""

CLEARANCE = 1.5
"""Within how many radii of a pole there must be no vertex to keep."""

SKEWNESS = 100.0
"""Weight of the volume's third moment against the offset of the centres, in units of the area."""

SAME_END = 0.65
"""Least cosine of two directions to the same end."""

GAP_SHARPNESS = 20.0
"""How near to a maximum the smooth one is that finds the widest gap."""

LEAST_VOLUME = 1e-6
"""Of the area^1.5, below which a closed surface has no volume to speak of."""


@dataclass(frozen=True, slots=True)
class Cut:
    """A closed surface is opened in the ball of ``radius`` around ``pole`` (3,).

    ``bearing`` (3,) is a direction across the way from the surface's ``centre`` (3,) to the pole.
    """

    centre: FloatArray
    pole: FloatArray
    radius: float
    bearing: FloatArray


def cut_of(mesh: Mesh, keep: IntArray | None) -> Cut:
    """The cut of a closed mesh, the same for the same surface.

    The pole lies on the broad side, away from where the volume is drawn out (a nose, a neck) and,
    where it is drawn out nowhere, from where there is much surface around little volume. Where
    these are not the same end (a head upon shoulders) and the drawn-out one is plain, the pole
    lies there: in the plane, what is behind a neck would be a speck. If vertices ``keep`` are
    near, or the surface has no direction, it lies in the widest gap between these.
    """
    measured = _Measured(mesh)
    offset, skew = measured.directions()
    way = _plain_way(measured, offset, skew)
    kept = mesh.vertices[keep] if keep is not None else mesh.vertices[:0]
    if len(kept) and way.any():
        pole = measured.pole(way)
        near = CLEARANCE * measured.radius(pole, OPENED_SHARE)
        if np.linalg.norm(kept - pole, axis=1).min() < near:
            way = np.zeros(3)
    if not way.any():
        outward = mesh.vertices - measured.centre
        way = _unit(outward[np.argmax((outward**2).sum(axis=1))])
        if len(kept):
            way = _widest_gap(_unit(kept - measured.centre), _unit(outward))
    across = [vector - (vector @ way) * way for vector in (_unit(offset), _unit(skew))]
    bearing = max(across, key=lambda vector: float(np.linalg.norm(vector)))
    pole = measured.pole(way)
    return Cut(measured.centre, pole, measured.radius(pole, OPENED_SHARE), bearing)


def _plain_way(measured: _Measured, offset: FloatArray, skew: FloatArray) -> FloatArray:
    """The direction (3,) of the pole by the surface alone; 0 if it has none."""
    tip = _unit(skew)
    if tip.any() and _unit(offset) @ tip < SAME_END:
        pole = measured.pole(tip)
        if measured.bends(pole, measured.radius(pole, OPENED_SHARE)) < OPENED_SHARE:
            return tip
    return -_unit(offset + SKEWNESS * skew)


class _Measured:
    """Integrals over a closed mesh. ``centre`` (3,) is that of its area."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._doubled = face_vectors(mesh.vertices, mesh.faces)
        self._area = np.linalg.norm(self._doubled, axis=1) / 2
        self._total = float(self._area.sum())
        self._corners = mesh.vertices[mesh.faces]
        self._middle = self._corners.mean(axis=1)
        self.centre: FloatArray = self._area @ self._middle / self._total

    def pole(self, way: FloatArray) -> FloatArray:
        """The point (3,) as far from the centre along ``way`` as the surface reaches."""
        return self.centre + ((self._mesh.vertices - self.centre) @ way).max() * way

    def radius(self, pole: FloatArray, share: float) -> float:
        """Of the ball around ``pole`` that holds this share of the area."""
        away = np.linalg.norm(self._middle - pole, axis=1)
        order = np.argsort(away, kind="stable")
        covered = np.cumsum(self._area[order]) - self._area[order] / 2
        return float(np.interp(share * self._total, covered, away[order]))

    def bends(self, pole: FloatArray, radius: float) -> float:
        """The share of edge length times angle between the normals that lies in a ball."""
        unit = _unit(self._doubled / self._total)
        across = unit[twins(self._mesh.faces) // 3].reshape(-1, 3, 3)
        angle = np.arccos(np.clip(np.einsum("fkx,fx->fk", across, unit), -1, 1))
        sides = np.linalg.norm(np.roll(self._corners, -1, axis=1) - self._corners, axis=2)
        bending = (sides * angle).sum(axis=1)
        inside = np.linalg.norm(self._middle - pole, axis=1) < radius
        return float(bending[inside].sum() / max(bending.sum(), np.finfo(float).tiny))

    def directions(self) -> tuple[FloatArray, FloatArray]:
        """From the centre of the volume to that of the area, and the mean of |x|² x over the
        volume from its centre, (3,) each, in units of the area; both 0 without volume.

        Sums over pyramids to the faces, by a rule that is exact for cubic functions.
        """
        size, doubled = np.sqrt(self._total), self._doubled / self._total
        corners, middle = ((x - self.centre) / size for x in (self._corners, self._middle))
        pyramid = np.einsum("fx,fx->f", doubled, middle) / 6
        volume = pyramid.sum()
        if abs(volume) < LEAST_VOLUME:
            return np.zeros(3), np.zeros(3)
        offset = -0.75 * (pyramid @ middle) / volume
        corners, middle = corners + offset, middle + offset
        pyramid = np.einsum("fx,fx->f", doubled, middle) / 6
        mean = 0.45 * _cubic(middle)
        for k in range(3):
            mean += 0.05 * _cubic(corners[:, k])
            mean += 2 / 15 * _cubic((corners[:, k] + corners[:, k - 1]) / 2)
        return offset, 0.5 * (pyramid @ mean) / volume


def _cubic(x: FloatArray) -> FloatArray:
    return np.einsum("kx,kx->k", x, x)[:, None] * x


def _unit(vectors: FloatArray) -> FloatArray:
    """Vectors (..., 3) at length 1, 0 for those below 1e-12."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 1e-12)


def _widest_gap(among: FloatArray, ways: FloatArray) -> FloatArray:
    """The direction (3,) in the widest gap between the directions ``among`` (k, 3).

    From the one of ``ways`` (n, 3) that is farthest from them, down a smooth maximum of their
    cosines.
    """
    way = ways[np.argmax(KDTree(among).query(ways)[0])]
    for _ in range(200):
        cosine = among @ way
        weight = np.exp(GAP_SHARPNESS * (cosine - cosine.max()))
        pull = weight @ among / weight.sum()
        way = way - (pull - (pull @ way) * way) / GAP_SHARPNESS
        way /= np.linalg.norm(way)
    return way
