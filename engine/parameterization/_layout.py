"""Laying out parts of a disk again where they fold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from engine._distortion_kernels import area_ratios
from engine.distortion import DistortionDescent
from engine.parameterization._certificate import folded_faces
from engine.parameterization._conformal import embedded
from engine.parameterization._necks import Bubble, bubbles, drawn
from engine.parameterization._shape_kernels import face_coefficients, image_scale
from engine.parameterization._sharpening import AngleDescent
from engine.parameterization._triangulation_kernels import grow
from engine.types import BoolArray, ComplexArray, IntArray, Mesh

_LEAST_HEIGHT = 0.02  # of the longest edge, for the shape that a sliver is asked to have
_CRUSHED = 1e-4  # of the area that a face's surroundings suggest


@dataclass(frozen=True, slots=True)
class Layout:
    """A mesh to lay out, coefficients ``a`` (m, 3) of its faces, boundary edges ``rim`` (b, 2) on
    the circle and whether their ends may slide. ``next_on_rim`` (n,) is -1 off the rim."""

    mesh: Mesh
    a: ComplexArray
    rim: IntArray
    next_on_rim: IntArray
    slides: bool

    @classmethod
    def of(cls, mesh: Mesh, boundary: IntArray, *, slides: bool) -> Layout:
        """The layout of ``mesh`` whose loop ``boundary`` (b,) lies on the circle."""
        rim = np.stack([boundary, np.roll(boundary, -1)], axis=1)
        next_on_rim = np.full(len(mesh.vertices), -1, dtype=np.int64)
        next_on_rim[boundary] = rim[:, 1]
        a = face_coefficients(mesh.vertices, mesh.faces, _LEAST_HEIGHT)
        return cls(mesh, a, rim, next_on_rim, slides)

    def without_folds(self, z: ComplexArray) -> ComplexArray:
        """Lay out growing surroundings of the folds in z (n,) again, at last everything.

        What lies behind three edges and still folds is taken out, and drawn in again in the end.
        """
        faces = self.mesh.faces
        bad = np.union1d(folded_faces(z, faces), self._crushed(z))
        for rings in (3, 6, 12, 30):
            if not len(bad):
                return z
            for touched, near in self._regions(bad, rings):
                z = self._laid_out(z, touched, near)
            bad = folded_faces(z, faces)
        if not len(bad):
            return z
        behind = bubbles(faces, len(z), bad)
        if behind:
            return self._drawn(z, behind)
        return self._laid_out(z, np.arange(len(faces)), np.ones(len(z), dtype=np.bool_))

    def _drawn(self, z: ComplexArray, behind: list[Bubble]) -> ComplexArray:
        """``z`` laid out without what is ``behind`` three edges, and that drawn into them."""
        faces = self.mesh.faces
        away = np.concatenate([bubble.faces for bubble in behind])
        rest = np.vstack([np.delete(faces, away, axis=0), *(bubble.ring for bubble in behind)])
        kept, corners = np.unique(rest, return_inverse=True)
        boundary = np.searchsorted(kept, self.rim[:, 0])
        mesh = Mesh(self.mesh.vertices[kept], corners.reshape(-1, 3).astype(np.int64))
        found = z.copy()
        found[kept] = Layout.of(mesh, boundary, slides=self.slides).without_folds(z[kept])
        for bubble in behind:
            inside, at = drawn(faces[bubble.faces], bubble.ring, found[bubble.ring])
            found[inside] = at
        return found

    def sharpener(self, holes: tuple[IntArray, ...] = ()) -> AngleDescent:
        """The descent of the angle distortion of this mesh with ``holes``."""
        return AngleDescent(self.a, self.mesh.faces, self.rim, len(self.mesh.vertices), holes)

    def _crushed(self, z: ComplexArray) -> IntArray:
        """Faces (k,) with hardly any area for their surroundings, useless as parts of a plane."""
        faces = self.mesh.faces
        share = area_ratios(_scaled(self.a, faces, z), faces, z)
        low = np.flatnonzero(share < _CRUSHED)
        return low[(self.next_on_rim[faces[low]] < 0).any(axis=1)]

    def _regions(self, bad: IntArray, rings: int) -> Iterator[tuple[IntArray, BoolArray]]:
        """The connected regions within ``rings`` of the faces ``bad``: faces (k,) that have a
        vertex inside, and which vertices (n,) are inside. No face is in two regions."""
        faces, n = self.mesh.faces, len(self.mesh.vertices)
        near = np.zeros(n, dtype=np.bool_)
        near[faces[bad]] = True
        near = grow(near, faces, rings)
        touched = np.flatnonzero(near[faces].any(axis=1))
        sides = faces[touched][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        a, b = sides[near[sides].all(axis=1)].T
        links = sp.coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(n, n))
        label = np.where(near, connected_components(links, directed=False)[1], -1)
        part = label[faces[touched]].max(axis=1)
        order = np.argsort(part, kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(part[order])) + 1):
            yield touched[group], label == part[group[0]]

    def _laid_out(self, z: ComplexArray, touched: IntArray, near: BoolArray) -> ComplexArray:
        """``z`` after moving only the vertices ``near``, if that can be done without folds.

        Untangled from where they are, else from positive means of their neighbours.
        """
        vertices, corners = np.unique(self.mesh.faces[touched], return_inverse=True)
        local = corners.reshape(-1, 3).astype(np.int64)
        after = self.next_on_rim[vertices]
        on_rim = after >= 0
        rim = np.flatnonzero(np.isin(after, vertices) & on_rim)
        rim = np.stack([rim, np.searchsorted(vertices, after[rim])], axis=1)
        still = ~near[vertices] | on_rim

        def starts() -> Iterator[ComplexArray]:
            yield z[vertices]
            mesh = Mesh(self.mesh.vertices[vertices], local)
            yield embedded(mesh, np.flatnonzero(still), z[vertices])

        for start in starts():
            scaled = _scaled(self.a[touched], local, start)
            fixed = ~near[vertices] if self.slides else still
            descent = DistortionDescent(scaled, local, fixed, rim)
            for found in (descent.untangle(start, most=60, tolerance=0.05).w, start):
                if not len(folded_faces(found, local)):
                    moved = z.copy()
                    moved[vertices] = found
                    return moved
        return z


def _scaled(a: ComplexArray, faces: IntArray, w: ComplexArray) -> ComplexArray:
    """``a`` (m, 3) for faces scaled to the local size of their images, so that D is near 1."""
    scale = image_scale(faces, a, w, len(w))
    return a / np.maximum(scale, np.finfo(np.float64).eps * scale.max())[:, None]
