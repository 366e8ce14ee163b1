"""What the colours of both surfaces tell: where skin slid along itself, which no shape shows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from engine._operator_kernels import sums_at_vertices
from engine.correspondence._levels import interpolated
from engine.linalg import SymmetricPattern
from engine.nearest import Feet, NormalAwareIndex
from engine.operators import (
    cotangent_laplacian,
    face_areas,
    face_normals,
    vertex_areas,
    vertex_normals,
)
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_SCALES = (0.005, 0.01, 0.02, 0.04)  # of the bands, in square roots of the source's area
_PER_SMOOTH = 0.7  # scale of a step's band over the length of its smoothing
_NEAR = 0.1  # how far from the target the colours of aligned surfaces are compared
_JUDGED = (1, 2)  # bands by which it is judged whether colours agree
_AGREE = 0.4  # least correlation of a channel's bands; unrelated noise stays below 0.25
_OWN = 0.3  # least share of a channel's variance that the surface's shape does not explain
_DEVIATIONS = 3.0  # at which values are cut for the correlation
_WEIGHT = 0.1  # of a colour whose slope is its deviation per scale, relative to point-to-plane
_DAMPING = 0.1  # slopes far below this, squared, say nothing
_ALIKE = 1.0  # deviations by which colours may differ and still be taken for the same


@dataclass(frozen=True, slots=True)
class Colours:
    """Bands of the colours' channels on both surfaces, standardised where the surfaces overlap.

    ``source`` (s, n, c), ``target`` (s, m, c) and ``slopes`` (s, m, 3, c), the tangential
    gradients on the target, whose faces are ``faces``. ``agreement`` (c,) is each channel's
    correlation between the aligned surfaces.
    """

    source: FloatArray
    target: FloatArray
    slopes: FloatArray
    faces: IntArray
    agreement: FloatArray

    @property
    def agree(self) -> bool:
        """Whether any channel is to be believed."""
        return bool((self.agreement > _AGREE).any())

    def restricted(self, kept: IntArray) -> Colours:
        """The same for the source's vertices ``kept`` only."""
        return replace(self, source=self.source[:, kept])

    def along(self, smooth: float, vertices: IntArray, feet: Feet) -> tuple[FloatArray, FloatArray]:
        """How stiffly (k, 3, 3) and how far (k, 3) colours pull source ``vertices`` off ``feet``.

        A Gauss-Newton step, as in optical flow, to where the target has the source's colour, at
        most ``smooth`` long; the band goes with ``smooth``. Park, Zhou, Koltun (2017) register
        coloured clouds by the same residual.
        """
        scales = np.array(_SCALES)
        band = int(np.abs(np.log(scales / (_PER_SMOOTH * smooth))).argmin())
        corners, weights = self.faces[feet.face], feet.barycentric
        there = np.einsum("ki,kic->kc", weights, self.target[band][corners])
        gap = self.source[band, vertices] - there
        slope = np.einsum("ki,kijc->kjc", weights, self.slopes[band][corners])
        upward = np.einsum("kjc,kj->kc", slope, feet.normal)
        slope = scales[band] * (slope - feet.normal[:, :, None] * upward[:, None])
        counted = np.exp(-(gap**2) / (2 * _ALIKE**2)) * (self.agreement > _AGREE)
        blocks = np.einsum("kic,kjc,kc->kij", slope, slope, counted)
        pulled = np.einsum("kic,kc->ki", slope, counted * gap)
        step = np.linalg.solve(blocks + _DAMPING * np.eye(3), pulled[:, :, None])[:, :, 0]
        step *= scales[band]
        length = np.maximum(np.linalg.norm(step, axis=1), smooth)
        return _WEIGHT * blocks, step * (smooth / length)[:, None]

    def __str__(self) -> str:
        best = float(self.agreement.max())
        if self.agree:
            return f"colours lead along the skin (correlation {best:.2f})"
        return f"the colours do not agree (correlation {best:.2f}) and are not used"


def compare_colours(
    source: Mesh, target: Mesh, index: NormalAwareIndex, colours: tuple[FloatArray, FloatArray]
) -> Colours:
    """The ``colours`` (n, 3), (m, 3) of aligned surfaces, in any units and light.

    ``index`` is the target's. Lengths are in square roots of the source's area.
    """
    normals = vertex_normals(source)
    feet = index.feet(source.vertices, normals)
    agree = np.einsum("ni,ni->n", normals, feet.normal) > 0.5
    met = agree & ~feet.on_border & (feet.distance < _NEAR)
    meets = np.zeros(len(target.vertices), dtype=np.bool_)
    meets[target.faces[feet.face[met]]] = True
    ours, own = _bands(source, colours[0], met)
    theirs, their_own = _bands(target, colours[1], meets)
    ours = np.stack([_standard(band, band[met]) for band in ours])
    found = [interpolated(target, feet.face[met], feet.barycentric[met], b) for b in theirs]
    theirs = np.stack([_standard(band, at) for band, at in zip(theirs, found, strict=True)])
    found = [_standard(at, at) for at in found]
    agreement = np.mean([_correlations(ours[k][met], found[k]) for k in _JUDGED], axis=0)
    agreement[np.minimum(own, their_own) < _OWN] = 0.0
    slopes = np.stack([_gradients(target, band) for band in theirs])
    return Colours(ours, theirs, slopes, target.faces, agreement)


def _bands(mesh: Mesh, colours: FloatArray, where: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Opponent channels of ``colours`` between each scale and its double, and how much is theirs.

    Blurred by diffusion, (M + t² L)⁻¹ M. What is slower than a band is mostly light; what places,
    normals and bends explain is light too, or painted by shape, and is taken out. Bands are
    (s, n, 3); (3,) is the share of the variance that is left, in the bands that are judged.
    """
    red, green, blue = _standard(colours, colours[where]).T
    channels = np.stack([(red + green + blue) / 3, red - green, (red + green) / 2 - blue], axis=1)
    normals = vertex_normals(mesh)
    areas = vertex_areas(mesh)
    areas = np.maximum(areas, 1e-3 * areas.mean())
    diffusion = sp.csr_array(sp.diags_array(areas) + cotangent_laplacian(mesh))
    pattern, unit = SymmetricPattern.of(diffusion, once=True)
    unit[pattern.diagonal] -= areas
    values = areas[:, None] * np.hstack([channels, mesh.vertices, normals])

    def blurred(scale: float) -> FloatArray:
        data = scale**2 * unit
        data[pattern.diagonal] += areas
        return pattern.factor(data).solve(values)

    low = [blurred(scale) for scale in (*_SCALES, 2 * _SCALES[-1])]
    bands: list[FloatArray] = []
    shares: list[FloatArray] = []
    for a, b in pairwise(low):
        bend = np.einsum("ni,ni->n", a[:, 6:], (a - b)[:, 3:6])
        band, share = _unexplained((a - b)[:, :3], np.column_stack([(a - b)[:, 3:], bend]), where)
        bands.append(band)
        shares.append(share)
    return np.stack(bands), np.mean([shares[k] for k in _JUDGED], axis=0)


def _unexplained(
    values: FloatArray, features: FloatArray, where: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """``values`` (n, c) less their regression on ``features`` (n, f), and the variance left (c,).

    The regression is that of the rows ``where``; the variance is a share of that before.
    """
    if not where.any():
        return values, np.zeros(values.shape[1])
    explained = features @ np.linalg.lstsq(features[where], values[where])[0]
    left = values - explained
    before, after = (x[where].var(axis=0) for x in (values, left))
    return left, np.divide(after, before, out=np.zeros_like(after), where=before > 0)


def _standard(values: FloatArray, sample: FloatArray) -> FloatArray:
    """``values`` (n, c) less the median of ``sample`` (k, c), over its mean absolute deviation."""
    if not len(sample):
        return np.zeros_like(values)
    middle = np.median(sample, axis=0)
    spread = np.abs(sample - middle).mean(axis=0)
    return np.divide(values - middle, spread, out=np.zeros_like(values), where=spread > 0)


def _correlations(a: FloatArray, b: FloatArray) -> FloatArray:
    """The correlation (c,) of the columns of two (n, c); 0 for constant ones."""
    if not len(a):
        return np.zeros(a.shape[1])
    a, b = (np.clip(x, -_DEVIATIONS, _DEVIATIONS) for x in (a, b))
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    size = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
    return np.divide((a * b).sum(axis=0), size, out=np.zeros_like(size), where=size > 0)


def _gradients(mesh: Mesh, values: FloatArray) -> FloatArray:
    """Gradients (n, 3, c) of ``values`` (n, c) at vertices: the faces' means by area."""
    corners, normals, areas = mesh.vertices[mesh.faces], face_normals(mesh), face_areas(mesh)
    opposite = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)
    turned = np.cross(normals[:, None], opposite)  # times 1 / 2A: the hat functions' gradients
    flux = np.einsum("mki,mkc->mic", turned, values[mesh.faces]) / 2
    count, columns = len(mesh.vertices), values.shape[1]
    sums = sums_at_vertices(mesh.faces, flux.reshape(-1, 3 * columns), count)
    around = sums_at_vertices(mesh.faces, areas[:, None], count)
    gradients = np.divide(sums, around, out=np.zeros_like(sums), where=around > 0)
    return gradients.reshape(count, 3, columns)
