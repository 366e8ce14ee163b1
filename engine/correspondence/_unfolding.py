"""Places where a projection turns faces over, laid out again in charts of the target.

In a crease closest points jump from side to side. There a piece of the target is mapped to a
disk, and the images of the source's vertices are spread in it by positive weights, with those
around held; folds that are left are opened by the least distortion. A face that is upright in the
plane may still not be so in space, where its corners lie on two sides of a fold: vertices then
move one by one until both hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine._operator_kernels import faces_within
from engine.correspondence._charts import Chart, dilated, parts
from engine.correspondence._fitting import Target
from engine.correspondence._patches import Patch, Surfaces, normals_at
from engine.correspondence._projection import Freedom
from engine.correspondence._upright_kernels import upside_down
from engine.operators import face_areas, face_normals, vertex_normals
from engine.types import BoolArray, FloatArray, IntArray, Mesh, SurfacePoints

_WIDEST = 8  # rings around faces turned over, after 1, 2 and 4, on a source of up to so many
_VERTICES = 10_000  # vertices; on a denser one rings double on, as far in space
_RARE = 1e-3  # share of faces: where more stand on noise, wide rounds would move what lies right
_FEW = 3  # faces turned over, which may need no more than a vertex moved a little
_ALIKE = 0.05  # of an edge's length
_INSIDE = 1e-9  # barycentric coordinates from which a point lies inside a face, not on its edge
_PATCH_RINGS = (2, 3, 5, 8)  # of the target around the images, until they make a disk


def turned_faces(
    source: Mesh, points: SurfacePoints, target: Target, heights: FloatArray | float = 0.0
) -> BoolArray:
    """(m,) faces of the source whose image lies upside down on the target, or has no area.

    Its vertices are at ``points``, or ``heights`` (n, 3) off them.
    """
    places = points.on(target.mesh) + heights
    return upside_down(source.faces, face_areas(source), places, normals_at(points, target))


@dataclass(frozen=True, slots=True)
class Unfolded:
    """``points`` (n,) laid out again where faces were turned over, how many of these there were,
    and which (m,) still are."""

    points: SurfacePoints
    found: int
    left: BoolArray

    def __str__(self) -> str:
        if not self.found:
            return "no face turned over"
        left = int(self.left.sum())
        return f"{self.found} faces turned over, {left or 'none'} left so"


def unfolded(
    source: Mesh,
    points: SurfacePoints,
    target: Target,
    freedom: Freedom,
    exists: BoolArray,
    sure: BoolArray,
    *,
    noisy: bool = False,
) -> Unfolded:
    """``points`` (n,) of the target with the faces that they turn over laid out again.

    Faces with a vertex that does not ``exists`` (n,) on the target are left as they are. Each
    round begins at the faces that are still turned over and takes more rings of the source around
    them; on a ``noisy`` target there is but one, unless it leaves few. What is left is tried again
    without the faces that have a vertex that is not ``sure`` (n,) to exist: their images still hold
    the others', and at last they do not.
    """
    there = faces_within(exists, source.faces) & (face_areas(source) > 0)
    there &= ~_alike(source, points, target)
    turned = there & turned_faces(source, points, target)
    left = turned | (there & _doubtful(source, points, target))
    certain = there & faces_within(sure, source.faces)
    whole, rings = Surfaces(source, target, freedom, there), _rings(len(source.vertices))
    points, left = _rounds(whole, points, left, rings[:1])
    if not noisy or left.mean() < _RARE:
        points, left = _rounds(whole, points, left, rings[1:])
        for loose in (False, True):
            surfaces = Surfaces(source, target, freedom, certain, loose=loose)
            points, kept = _rounds(surfaces, points, left & certain, rings)
            left = kept | (left & ~certain)
    left |= there & turned_faces(source, points, target)
    return Unfolded(points, int(turned.sum()), left)


def _rings(vertex_count: int) -> tuple[int, ...]:
    widest = _WIDEST * np.sqrt(max(vertex_count / _VERTICES, 1.0))
    return tuple(2**k for k in range(round(np.log2(widest)) + 1))


def _rounds(
    surfaces: Surfaces, points: SurfacePoints, left: BoolArray, rings: tuple[int, ...]
) -> tuple[SurfacePoints, BoolArray]:
    """Points laid out again, with more rings around the faces ``left`` (m,) each time that there
    are any; and those left turned over."""
    source, target = surfaces.source, surfaces.target
    for wide in rings:
        if not left.any():
            break
        to, still = _round(surfaces, points, left, wide)
        still |= surfaces.there & turned_faces(source, to, target)
        if still.sum() < left.sum():
            points, left = to, still
    return points, left


def _alike(source: Mesh, points: SurfacePoints, target: Target) -> BoolArray:
    """(m,) faces that lie upside down on the source itself, in a crease, and so on the target: each
    edge of theirs and of all faces around them is as long as its image."""
    faces = source.faces
    below = vertex_normals(source)[faces].sum(axis=1)
    upside_down = np.einsum("mi,mi->m", face_normals(source), below) <= 0
    before, after = (
        np.linalg.norm(x[faces] - x[np.roll(faces, 1, axis=1)], axis=2)
        for x in (source.vertices, points.on(target.mesh))
    )
    changed = np.zeros(len(source.vertices), dtype=np.bool_)
    changed[faces[(np.abs(after - before) > _ALIKE * before).any(axis=1)]] = True
    return upside_down & ~changed[faces].any(axis=1)


def _doubtful(source: Mesh, points: SurfacePoints, target: Target) -> BoolArray:
    """(m,) faces that point against the target's surface at a corner: folded, or over a fold.

    On an edge rounding says which face of the target a corner is put in: there the mean of its
    vertices' normals counts.
    """
    normals = face_normals(Mesh(points.on(target.mesh), source.faces))
    inside = points.barycentric.min(axis=1) > _INSIDE
    below = np.where(
        inside[:, None], face_normals(target.mesh)[points.face], normals_at(points, target)
    )
    return np.einsum("mi,mci->mc", normals, below[source.faces]).min(axis=1) <= 0


def _round(
    surfaces: Surfaces, points: SurfacePoints, seeds: BoolArray, rings: int
) -> tuple[SurfacePoints, BoolArray]:
    """Points laid out again around the faces ``seeds`` (m,), and those left turned over."""
    near = np.zeros(len(surfaces.source.vertices), dtype=np.bool_)
    near[surfaces.source.faces[seeds]] = True
    part = parts(dilated(near, surfaces.ours, rings), surfaces.ours)
    left = np.zeros_like(seeds)
    for k in range(part.max() + 1):
        region = part == k
        around = dilated(region, surfaces.ours, 1)
        chart = _chart(surfaces, points.face[around])
        if chart is None:
            continue
        patch = Patch(surfaces, chart, around, region, points)
        before = patch.turned
        if before.any():
            if before.sum() <= _FEW:
                patch.set_upright(rings)
            if patch.turned.any():
                patch.spread(rings)
                patch.set_upright(rings)
            if patch.turned.sum() < before.sum():
                points, before = patch.written(points), patch.turned
            left[patch.faces[before]] = True
    return points, left


def _chart(surfaces: Surfaces, faces: IntArray) -> Chart | None:
    """A chart of the target around ``faces``, as small as one can be found with all of them.

    Between the images of a coarse source's neighbours a fine target has many rings; only where no
    chart has all of ``faces`` one is taken that has most.
    """
    most: Chart | None = None
    for rings in _PATCH_RINGS:
        chart = Chart.around(surfaces.target.mesh, faces, surfaces.theirs, rings)
        if chart is not None and np.isin(faces, chart.faces).all():
            return chart
        most = most or chart
    return most
