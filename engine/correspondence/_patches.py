"""Pieces of a source over a piece of its target, laid out until no face is turned over."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from engine._operator_kernels import faces_within
from engine.beltrami import flat_triangles, triangle_areas
from engine.correspondence._charts import Chart, dilated, parts
from engine.correspondence._energy import clipped_laplacian
from engine.correspondence._fitting import Target
from engine.correspondence._levels import interpolated
from engine.correspondence._projection import Freedom
from engine.correspondence._upright_kernels import FLAT, set_upright, uprightnesses
from engine.distortion import DistortionDescent
from engine.errors import NumericalError
from engine.linalg import FixedSolver
from engine.nearest import vertex_stars
from engine.operators import adjacency, face_areas, vertex_areas
from engine.topology import boundary_loops
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray, Mesh, SurfacePoints

_WIDER = 3  # rings more and more that are spread around faces turned over
_LENGTHS = (1, 2, 4, 8, 16, np.inf)  # edges of the source over which images are spread
_STEPS = 30  # of the descent where spreading leaves folds
_LEAST_SCALE = 0.1  # of a face's image, relative to those around
_MANY = 200  # faces turned over: too many for moving vertices one by one
_NEAR = 2  # rings around faces turned over whose vertices move one by one
_MARGIN = 0.1  # of the uprightness that a face shall have
_PRICE = 0.02  # of moving a vertex by an edge, in units of uprightness
_SPACING = 0.3  # of the points to which vertices may move, in edges of the source
_BESIDE, _TURNS = (0.02, 0.05, 0.1), 6  # edges away, and points around, beside a vertex
_CANDIDATES = 20_000  # such points at most


@dataclass(frozen=True)
class Surfaces:
    """A source whose faces ``there`` (m,) shall lie upright on the target.

    The others hold what is beside them where it is, unless they are ``loose``.
    """

    source: Mesh
    target: Target
    freedom: Freedom
    there: BoolArray
    loose: bool = False

    @cached_property
    def ours(self) -> sp.csr_array:
        return adjacency(self.source.faces, len(self.source.vertices))

    @cached_property
    def theirs(self) -> sp.csr_array:
        return adjacency(self.target.mesh.faces, len(self.target.mesh.vertices))

    @cached_property
    def spreads(self) -> BoolArray:
        """(n,) the vertices that may be spread between their neighbours."""
        free = self.freedom.kind == 0
        for loop in boundary_loops(self.source.faces, len(free)):
            free[loop] = False
        if not self.loose:
            free[self.source.faces[~self.there]] = False
        return free

    @cached_property
    def rim(self) -> IntArray:
        """(m', 3) which of the rims the edges of the target's faces are on, by the corner
        opposite; 0 inside."""
        faces = self.target.mesh.faces
        loop = np.zeros(len(self.target.mesh.vertices), dtype=np.int64)
        follower = np.full(len(loop), -1)
        for k, rim in enumerate(self.freedom.rims, start=1):
            loop[rim], follower[rim] = k, np.roll(rim, -1)
        start, end = np.roll(faces, -1, axis=1), np.roll(faces, 1, axis=1)
        return np.where((follower[start] == end) | (follower[end] == start), loop[start], 0)


class Patch:
    """The source's faces within ``around`` (n,), imaged in a chart; ``region`` (n,) may move.

    Faces are left out that have a vertex outside of the chart that may not be spread: a landmark
    that lies apart from its surroundings.
    """

    def __init__(
        self,
        surfaces: Surfaces,
        chart: Chart,
        around: BoolArray,
        region: BoolArray,
        points: SurfacePoints,
    ) -> None:
        source = surfaces.source
        chosen, near = around.copy(), np.flatnonzero(around)
        lost = np.isnan(chart.of(SurfacePoints(points.face[near], points.barycentric[near])))
        chosen[near[lost]] = (region & (surfaces.freedom.kind == 0))[near[lost]]
        self.faces = np.flatnonzero(faces_within(chosen, source.faces) & surfaces.there)
        self._vertices, flat = np.unique(source.faces[self.faces], return_inverse=True)
        self._surfaces, self._chart = surfaces, chart
        self._mesh = Mesh(source.vertices[self._vertices], flat.reshape(-1, 3))
        self._region = region[self._vertices]
        self._kind = surfaces.freedom.kind[self._vertices]
        self._face = points.face[self._vertices]
        self._barycentric = points.barycentric[self._vertices]
        self._z = chart.of(self._points)
        self._areas = face_areas(self._mesh)
        self.turned = self._judged()

    @cached_property
    def _links(self) -> sp.csr_array:
        return adjacency(self._mesh.faces, len(self._vertices))

    @cached_property
    def _laplacian(self) -> sp.csr_array:
        return clipped_laplacian(self._mesh)

    def _judged(self) -> BoolArray:
        """Which faces are turned over or collapsed, in the chart or in space."""
        images = self._placed(self._points)
        upright = uprightnesses(self._mesh.faces, self._areas, *images) > FLAT
        return ~upright | np.isnan(self._z)[self._mesh.faces].any(axis=1)

    @property
    def _points(self) -> SurfacePoints:
        return SurfacePoints(self._face, self._barycentric)

    def _put(self, vertices: IntArray | BoolArray, points: SurfacePoints) -> None:
        self._face[vertices], self._barycentric[vertices] = points.face, points.barycentric
        self._z[vertices] = self._chart.of(points)

    def _around(self, faces: BoolArray, rings: int) -> BoolArray:
        near = np.zeros(len(self._vertices), dtype=np.bool_)
        near[self._mesh.faces[faces]] = True
        return dilated(near, self._links, rings) & self._region

    def spread(self, rings: int) -> None:
        """Lay out anew, by positive weights, what is turned over in the chart.

        Images stay as near to where they were as folds allow.
        """
        faces, z = self._mesh.faces, self._z
        folded, moved = _clockwise(z, faces), np.zeros(len(z), dtype=np.bool_)
        for wide in range(rings, rings + _WIDER):
            free = self._spreading(self._around(folded, wide))
            if not free.any():
                break
            for length in _LENGTHS:
                spread = self._smoothed(z, np.flatnonzero(~free), length)
                left = _clockwise(spread, faces)
                if left.sum() < folded.sum() or np.isnan(z).any():
                    z, folded, moved = spread, left, moved | free
                if not folded.any():
                    break
        free = self._spreading(self._around(folded, rings + _WIDER))
        if free.any() and np.isfinite(z).all():
            opened = _opened(z, self._mesh, free)
            if _clockwise(opened, faces).sum() < folded.sum():
                z, moved = opened, moved | free
        if moved.any():
            self._put(moved, self._chart.located(z[moved]))

    def _smoothed(self, z: ComplexArray, known: IntArray, length: float) -> ComplexArray:
        """``z`` (n,) after an implicit step of diffusion over ``length`` edges from all but those
        ``known``, which stay; after an infinite one their harmonic extension."""
        placed = ~np.isnan(z)
        edge = np.sqrt(2 * np.median(self._areas))
        kept = placed * vertex_areas(self._mesh) / (length * edge) ** 2
        source = kept * np.where(placed, z, 0)
        solver = FixedSolver(sp.csr_array(self._laplacian + sp.diags_array(kept)), known)
        return solver.solve(z[known], source=source)

    def _spreading(self, chosen: BoolArray) -> BoolArray:
        """Those of ``chosen`` vertices that may be spread between others that stay."""
        free = chosen & (self._surfaces.spreads[self._vertices] | np.isnan(self._z))
        part = parts(np.ones_like(free), self._links)
        return free & np.isin(part, part[~free])

    def set_upright(self, rings: int) -> None:
        """Move vertices one by one where faces are still turned over, in the chart or in space."""
        self.turned = self._judged()
        if not 0 < self.turned.sum() <= _MANY or np.isnan(self._z).any():
            return
        images = self._placed(self._points)
        stars = vertex_stars(self._mesh.faces, len(self._vertices))
        unit = float(np.sqrt(np.median(self._areas)))
        movable = np.flatnonzero(self._around(self.turned, min(rings, _NEAR)))
        candidates, kinds = self._candidates(unit, movable)
        became = set_upright(
            (self._mesh.faces, self._areas, stars.start, stars.face),
            movable,
            (self._kind, *images),
            (kinds, *self._placed(candidates)),
            (_MARGIN, _PRICE / unit),
        )
        moved = np.flatnonzero(became >= 0)
        chosen = became[moved]
        self._put(moved, SurfacePoints(candidates.face[chosen], candidates.barycentric[chosen]))
        self.turned = self._judged()

    def _placed(self, points: SurfacePoints) -> tuple[ComplexArray, FloatArray, FloatArray]:
        target = self._surfaces.target
        return self._chart.of(points), points.on(target.mesh), normals_at(points, target)

    def _candidates(self, unit: float, movable: IntArray) -> tuple[SurfacePoints, IntArray]:
        """A grid on every face of the chart and points beside ``movable`` vertices, sorted by the
        real part in the chart, and the rim that each of them is on, or 0."""
        faces, target = self._chart.faces, self._surfaces.target.mesh
        size = np.sqrt(np.median(face_areas(Mesh(target.vertices, target.faces[faces]))))
        finest = np.sqrt(2 * _CANDIDATES / len(faces))
        parts_of_edge = int(np.clip(np.ceil(size / (_SPACING * unit)), 2, max(finest, 2)))
        i, j = np.divmod(np.arange((parts_of_edge + 1) ** 2), parts_of_edge + 1)
        inside = i + j <= parts_of_edge
        grid = np.stack([i, j, parts_of_edge - i - j], axis=1)[inside] / parts_of_edge
        rim = (self._surfaces.rim[faces][:, None, :] * (grid == 0)).max(axis=2).ravel()
        beside = self._beside(movable)
        face = np.concatenate([np.repeat(faces, len(grid)), beside.face])
        barycentric = np.concatenate([np.tile(grid, (len(faces), 1)), beside.barycentric])
        rim = np.concatenate([rim, np.zeros(len(beside), dtype=np.int64)])
        order = np.argsort(self._chart.of(SurfacePoints(face, barycentric)).real)
        return SurfacePoints(face[order], barycentric[order]), rim[order]

    def _beside(self, movable: IntArray) -> SurfacePoints:
        """Points close to ``movable`` vertices, for those that need to move but little."""
        faces = self._mesh.faces
        lengths = np.abs(self._z[faces] - self._z[np.roll(faces, 1, axis=1)])
        count = np.maximum(np.bincount(faces.ravel(), minlength=len(self._z)), 1)
        length = np.bincount(faces.ravel(), lengths.ravel(), len(self._z)) / count
        turns = np.exp(2j * np.pi * np.arange(_TURNS) / _TURNS)
        ways = np.concatenate([radius * turns for radius in _BESIDE])
        return self._chart.located((self._z[movable, None] + length[movable, None] * ways).ravel())

    def written(self, points: SurfacePoints) -> SurfacePoints:
        """``points`` (n,) of the whole source with those of this patch."""
        face, barycentric = points.face.copy(), points.barycentric.copy()
        face[self._vertices], barycentric[self._vertices] = self._face, self._barycentric
        return SurfacePoints(face, barycentric)


def normals_at(points: SurfacePoints, target: Target) -> FloatArray:
    """(n, 3) normals of the target's surface at its ``points`` (n,)."""
    return interpolated(target.mesh, points.face, points.barycentric, target.normals)


def _opened(z: ComplexArray, mesh: Mesh, free: BoolArray) -> ComplexArray:
    """``z`` (n,) with folds undone by ``free`` vertices, by the least distortion of shapes."""
    faces, flat = mesh.faces, flat_triangles(mesh)
    whole = np.abs(triangle_areas(flat)) > 0
    faces, flat = faces[whole], flat[whole]
    opposite = np.roll(flat, 1, axis=1) - np.roll(flat, -1, axis=1)
    slopes = -0.25j * opposite.conj() / triangle_areas(flat)[:, None]
    image = z[faces]
    size = np.abs(image - np.roll(image, 1, axis=1)).sum(axis=1) / np.abs(opposite).sum(axis=1)
    total = np.bincount(faces.ravel(), np.repeat(size, 3), len(z))
    count = np.maximum(np.bincount(faces.ravel(), minlength=len(z)), 1)
    scale = (total / count)[faces].mean(axis=1)
    if not scale.any():
        return z
    scale = np.maximum(scale, _LEAST_SCALE * scale.mean())
    rim = np.empty((0, 2), dtype=np.int64)
    descent = DistortionDescent(slopes / scale[:, None], faces, ~free, rim)
    try:
        return descent.untangle(z, most=_STEPS).w
    except NumericalError:  # of overflow: there is nothing to gain here
        return z


def _clockwise(z: ComplexArray, faces: IntArray) -> BoolArray:
    """Which of ``faces`` (m, 3) are not counter-clockwise."""
    a, b, c = z[faces].T
    counter_clockwise: BoolArray = ((b - a).conj() * (c - a)).imag > 0
    return ~counter_clockwise
