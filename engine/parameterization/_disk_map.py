"""Surface to disk: a first map, its folds repaired, its frame fixed, its bijectivity certified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.sparse.csgraph import connected_components

from engine.errors import ParameterizationError
from engine.operators import adjacency, face_areas
from engine.parameterization._certificate import folded_faces, rim_turns_once
from engine.parameterization._conformal import (
    arc_length_disk,
    centred,
    conformal_disk,
    embedded,
    turned,
)
from engine.parameterization._mips_kernels import determinants, face_coefficients, grow
from engine.parameterization._untangling import Descent, scaled_coefficients
from engine.types import BoolArray, ComplexArray, DiskMap, DiskSurface, IntArray, Mesh

_LEAST_HEIGHT = 0.02  # of the longest edge, for the shape that a sliver is asked to have
_CRUSHED = 1e-4  # of the area that a face's surroundings suggest


def disk_map(
    disk: DiskSurface, *, method: Literal["default", "paper"] = "default", polish: bool = False
) -> DiskMap:
    """A bijection of ``disk`` onto the closed unit disk, boundary on the exact circle.

    ``default``: conformal by a Green's function on the intrinsic Delaunay triangulation; the
    surface's area-weighted mean lies at 0. ``polish`` lowers the angle distortion a little
    further by two Newton steps with the boundary sliding. ``paper``: Algorithm 3, boundary by
    arc length, interior harmonic with cotangent weights. In both, direction 1 is the one in
    which the surface's area lies farthest out, so that frames of similar faces agree.

    Folds of either map are undone locally by the least conformal distortion (boundary sliding
    in ``default``, fixed in ``paper``), from where the vertices are or, where that fails, from
    positive means of neighbours, at last for the whole disk. Raises ``ParameterizationError``
    naming the faces (of ``disk.mesh``) that are still not positively oriented, or have no area.
    """
    if not face_areas(disk.mesh)[: len(disk.face)].sum() > 0:
        raise ParameterizationError(
            "the surface has no area: its vertices lie on one line or point",
            code="no_area",
            elements={"faces": list(range(min(100, len(disk.face)))), "count": len(disk.face)},
        )
    z = turned(disk, arc_length_disk(disk) if method == "paper" else conformal_disk(disk))
    layout = _Layout.of(disk, slides=method == "default")
    z = layout.without_folds(z)
    if polish and method == "default":
        z = layout.without_folds(turned(disk, centred(disk, layout.polished(z))))
    _certify(disk, z)
    return DiskMap(disk, z)


@dataclass(frozen=True, slots=True)
class _Layout:
    """A disk, coefficients ``a`` (m, 3) of its faces, boundary edges ``rim`` (b, 2), vertices
    ``on_rim`` (n,), and whether those may slide."""

    disk: DiskSurface
    a: ComplexArray
    rim: IntArray
    on_rim: BoolArray
    slides: bool

    @classmethod
    def of(cls, disk: DiskSurface, *, slides: bool) -> _Layout:
        rim = np.stack([disk.boundary, np.roll(disk.boundary, -1)], axis=1)
        on_rim = np.zeros(len(disk.mesh.vertices), dtype=np.bool_)
        on_rim[disk.boundary] = True
        a = face_coefficients(disk.mesh.vertices, disk.mesh.faces, _LEAST_HEIGHT)
        return cls(disk, a, rim, on_rim, slides)

    def without_folds(self, z: ComplexArray) -> ComplexArray:
        """Lay out growing surroundings of the folds again, at last everything."""
        faces = self.disk.mesh.faces
        for region in self._regions(z, np.union1d(folded_faces(z, faces), self._crushed(z)), 3):
            z = self._laid_out(z, region)
        for rings in (6, 12, 30):
            for region in self._regions(z, folded_faces(z, faces), rings):
                z = self._laid_out(z, region)
        if len(folded_faces(z, faces)):
            z = self._laid_out(z, np.ones_like(self.on_rim))
        return z

    def _crushed(self, z: ComplexArray) -> IntArray:
        """Faces (k,) with hardly any area for their surroundings, useless as parts of a plane."""
        faces = self.disk.mesh.faces
        share = determinants(scaled_coefficients(self.a, faces, z), faces, z)
        return np.flatnonzero((share < _CRUSHED) & ~self.on_rim[faces].all(axis=1))

    def _regions(self, z: ComplexArray, bad: IntArray, rings: int) -> list[BoolArray]:
        """The connected regions of vertices (n,) within ``rings`` of the faces ``bad``."""
        if not len(bad):
            return []
        faces = self.disk.mesh.faces
        near = np.zeros(len(z), dtype=np.bool_)
        near[faces[bad]] = True
        near = grow(near, faces, rings)
        inside = faces[near[faces].all(axis=1)]
        _, label = connected_components(adjacency(inside, len(z)), directed=False)
        return [near & (label == part) for part in np.unique(label[faces[bad, 0]])]

    def _laid_out(self, z: ComplexArray, near: BoolArray) -> ComplexArray:
        """``z`` after moving only the vertices ``near``, if that can be done without folds.

        Untangled from where they are, else from positive means of their neighbours.
        """
        faces = self.disk.mesh.faces
        touched = np.flatnonzero(near[faces].any(axis=1))
        vertices, corners = np.unique(faces[touched], return_inverse=True)
        local = corners.reshape(-1, 3).astype(np.int64)
        place = np.full(len(z), -1, dtype=np.int64)
        place[vertices] = np.arange(len(vertices))
        rim = place[self.rim]
        rim = rim[(rim >= 0).all(axis=1)]
        still = ~near[vertices] | self.on_rim[vertices]
        mesh = Mesh(self.disk.mesh.vertices[vertices], local)
        for start in (z[vertices], embedded(mesh, np.flatnonzero(still), z[vertices])):
            scaled = scaled_coefficients(self.a[touched], local, start)
            descent = Descent(scaled, local, still if not self.slides else ~near[vertices], rim)
            for found in (descent.untangle(start, max_steps=60, tolerance=0.05), start):
                if not len(folded_faces(found, local)):
                    moved = z.copy()
                    moved[vertices] = found
                    return moved
        return z

    def polished(self, z: ComplexArray) -> ComplexArray:
        """Two reweighted Newton steps towards the least mean of |f_z̄ / f_z|, without a fold."""
        faces = self.disk.mesh.faces
        scaled = scaled_coefficients(self.a, faces, z)
        descent = Descent(scaled, faces, np.zeros_like(self.on_rim), self.rim)
        for _ in range(2):
            z = descent.sharpen(z)
        return z


def _certify(disk: DiskSurface, z: ComplexArray) -> None:
    folded = folded_faces(z, disk.mesh.faces)
    if len(folded):
        raise ParameterizationError(
            f"{len(folded)} faces of the disk could not be laid out without folding, first "
            f"{folded[0]}; remeshing the slivers or pockets around them would help",
            code="folds",
            elements={"faces": folded[:100].tolist(), "count": len(folded)},
        )
    if not rim_turns_once(z[disk.boundary]):
        raise ParameterizationError(
            "the boundary does not wind once around the disk: some of its edges have no length "
            "or carry no measure",
            code="boundary",
            elements={"vertices": disk.boundary[:100].tolist()},
        )
