"""Surface to disk: a first map, its folds repaired, its frame fixed, its bijectivity certified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from engine.errors import ParameterizationError
from engine.parameterization._certificate import folded_faces, rim_turns_once
from engine.parameterization._conformal import (
    arc_length_disk,
    barycentric_disk,
    conformal_disk,
    turned,
)
from engine.parameterization._mips_kernels import dilatations, face_coefficients, grow
from engine.parameterization._untangling import Descent, scaled_coefficients
from engine.types import BoolArray, ComplexArray, DiskMap, DiskSurface

_LEAST_HEIGHT = 0.02  # of the longest edge, for the shape that a sliver is asked to have


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
    in ``default``, fixed in ``paper``); if that fails the whole map is improved from Tutte's
    embedding. Raises ``ParameterizationError`` naming the faces (of ``disk.mesh``) that are
    still not positively oriented.
    """
    z = turned(disk, arc_length_disk(disk) if method == "paper" else conformal_disk(disk))
    layout = _Layout.of(disk, slides=method == "default")
    z = layout.without_folds(z)
    if polish and method == "default":
        z = layout.polished(z)
    _certify(disk, z)
    return DiskMap(disk, z)


@dataclass(frozen=True, slots=True)
class _Layout:
    """A disk, the coefficients ``a`` (m, 3) of its faces, and whether its boundary may slide."""

    disk: DiskSurface
    a: ComplexArray
    rim: BoolArray
    slides: bool

    @classmethod
    def of(cls, disk: DiskSurface, *, slides: bool) -> _Layout:
        rim = np.zeros(len(disk.mesh.vertices), dtype=np.bool_)
        rim[disk.boundary] = True
        a = face_coefficients(disk.mesh.vertices, disk.mesh.faces, _LEAST_HEIGHT)
        return cls(disk, a, rim, slides)

    def without_folds(self, z: ComplexArray) -> ComplexArray:
        """Untangle growing surroundings of the folds, then the whole from Tutte's embedding."""
        faces = self.disk.mesh.faces
        for rings in (3, 6, 12, 30):
            folded = folded_faces(z, faces)
            if not len(folded):
                return z
            near = np.zeros(len(z), dtype=np.bool_)
            near[faces[folded]] = True
            z = self._untangled(z, grow(near, faces, rings))
        if len(folded_faces(z, faces)):
            embedded = barycentric_disk(self.disk, z[self.disk.boundary])
            if not len(folded_faces(embedded, faces)):
                z = self._untangled(embedded, np.ones_like(self.rim))
        return z

    def _untangled(self, z: ComplexArray, near: BoolArray) -> ComplexArray:
        """``z`` after moving only the vertices ``near``; unchanged where no descent exists."""
        faces = self.disk.mesh.faces
        touched = np.flatnonzero(near[faces].any(axis=1))
        vertices, corners = np.unique(faces[touched], return_inverse=True)
        local = corners.reshape(-1, 3).astype(np.int64)
        scaled = scaled_coefficients(self.a[touched], local, z[vertices])
        rim, held = self.rim[vertices], ~near[vertices]
        descent = Descent(scaled, local, held if self.slides else held | rim, rim)
        moved = z.copy()
        moved[vertices] = descent.untangle(z[vertices], max_steps=60, tolerance=0.05)
        return moved

    def polished(self, z: ComplexArray) -> ComplexArray:
        """Two reweighted Newton steps towards the least mean of |f_z̄ / f_z|, without a fold."""
        faces = self.disk.mesh.faces
        scaled = scaled_coefficients(self.a, faces, z)
        descent = Descent(scaled, faces, np.zeros_like(self.rim), self.rim)
        for _ in range(2):
            weights = 1 / np.hypot(dilatations(scaled, faces, z), 0.01)
            weights /= weights.sum()
            step, slope = descent.newton(z, weights, 0.0, 1e-7)
            z, _, _ = descent.search(z, step, slope, weights, 0.0)
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
