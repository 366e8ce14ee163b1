"""Beltrami coefficients of maps that are linear on triangles, and the linear Beltrami solver.

On a triangle f_z = Σ aᵢ wᵢ and f_z̄ = Σ āᵢ wᵢ with wᵢ the images of its corners, so
μ = f_z̄ / f_z (Lui, Lam, Yau, Gu: Teichmüller mapping (T-map) and its applications to landmark
matching registration, 2014). A triangle keeps its orientation exactly when |μ| < 1.

The domain is given by its triangles' ``corners`` (m, 3) complex: ``z[faces]`` for a plane mesh,
``flat_triangles(mesh)`` for a surface. ``faces`` (m, 3) index into ``image`` (n,) complex.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from engine._beltrami_kernels import (
    assemble_beltrami,
    coefficients,
    filtered_orientations,
    flat_corners,
    wirtinger_weights,
)
from engine.errors import EngineError, NumericalError
from engine.linalg import ElementPattern
from engine.types import ComplexArray, FloatArray, IntArray, Mesh


def flat_triangles(mesh: Mesh) -> ComplexArray:
    """Isometric corners (m, 3) of each triangle in its own plane, counter-clockwise."""
    return flat_corners(mesh.vertices, mesh.faces)


def triangle_areas(corners: ComplexArray) -> FloatArray:
    """Signed areas (m,) of plane triangles, positive counter-clockwise."""
    u = corners[:, 1] - corners[:, 0]
    v = corners[:, 2] - corners[:, 0]
    return 0.5 * (u.real * v.imag - u.imag * v.real)


def beltrami_coefficient(
    corners: ComplexArray, faces: IntArray, image: ComplexArray
) -> ComplexArray:
    """μ = f_z̄ / f_z per triangle (m,); infinite where f_z = 0.

    |μ| > 1 marks a turned triangle and |μ| = 1 a flat one, up to rounding; ``folds`` decides
    exactly. Exact for maps that are affine on a triangle, whatever the triangle's shape.
    """
    return coefficients(
        np.ascontiguousarray(corners, np.complex128),
        np.ascontiguousarray(faces, np.int64),
        np.ascontiguousarray(image, np.complex128),
    )


def orientations(corners: ComplexArray) -> IntArray:
    """The exact sign of each triangle's area: 1 counter-clockwise, -1 clockwise, 0 flat.

    Double precision with a forward error bound decides nearly all of them (Shewchuk 1997),
    rational arithmetic the rest.
    """
    corners = np.ascontiguousarray(corners, np.complex128)
    sign = filtered_orientations(corners)
    for t in np.flatnonzero(sign == 0):
        (ax, ay), (bx, by), (cx, cy) = (
            (Fraction(float(z.real)), Fraction(float(z.imag))) for z in corners[t]
        )
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        sign[t] = (area > 0) - (area < 0)
    return sign


def folds(corners: ComplexArray, faces: IntArray, image: ComplexArray) -> IntArray:
    """Faces that ``image`` flattens or turns over, relative to their orientation in the domain.

    The test is exact for the given coordinates. A face that is flat in the domain counts as
    counter-clockwise there, so it is a fold unless its image is counter-clockwise.
    """
    before = np.where(orientations(corners) < 0, -1, 1)
    return np.flatnonzero(orientations(image[faces]) != before).astype(np.int64)


def composed_coefficient(
    mu_f: ComplexArray, mu_g: ComplexArray, corners: ComplexArray, faces: IntArray, f: ComplexArray
) -> ComplexArray:
    """Coefficient of g∘f per face, from μ of f and μ of g on the images of the same faces.

    μ_{g∘f} = (μ_f + τ μ_g) / (1 + τ conj(μ_f) μ_g), τ = conj(f_z) / f_z.
    """
    a, _ = wirtinger_weights(np.ascontiguousarray(corners, np.complex128))
    f_z = np.einsum("ti,ti->t", a, f[faces])
    tau = np.conj(f_z) / f_z
    return (mu_f + tau * mu_g) / (1.0 + tau * np.conj(mu_f) * mu_g)


class BeltramiSolver:
    """F_b of one domain: the map with a given coefficient through given points, many times.

    For f = u + iv and μ = ρ + iτ solves ∇·(A∇u) = 0 = ∇·(A∇v) with A = [[α₁, α₂], [α₂, α₃]],
    α₁ = ((ρ-1)² + τ²)/(1-|μ|²), α₂ = -2τ/(1-|μ|²), α₃ = ((1+ρ)² + τ²)/(1-|μ|²), and natural
    conditions on a boundary that is not fixed. The sparsity pattern is analysed here, once.

    ``corners`` (m, 3) counter-clockwise, ``faces`` (m, 3) using every vertex, ``fixed`` (c,)
    distinct vertices, at least one.
    """

    def __init__(self, corners: ComplexArray, faces: IntArray, fixed: IntArray) -> None:
        self.corners = np.ascontiguousarray(corners, np.complex128)
        self.faces = np.ascontiguousarray(faces, np.int64)
        self.fixed = np.ascontiguousarray(fixed, np.int64)
        self._a, self._area = wirtinger_weights(self.corners)
        if not (self._area > 0.0).all():
            bad = np.flatnonzero(~(self._area > 0.0))
            raise NumericalError(
                f"{len(bad)} triangles of the domain are flat or turned over, first {bad[0]};"
                " repair the domain map first",
                elements={"faces": bad[:100].tolist()},
            )
        self._count = int(self.faces.max()) + 1
        self._unknown = np.zeros(self._count, np.int64)
        self._unknown[self.fixed] = -1
        self._free = np.flatnonzero(self._unknown == 0)
        self._unknown[self._free] = np.arange(len(self._free))
        self._pattern = ElementPattern(self._unknown[self.faces], len(self._free))
        self._analysis = self._pattern.analyse()

    def solve(self, mu: ComplexArray, values: ComplexArray) -> ComplexArray:
        """The image (n,) of all vertices; ``mu`` (m,) with |μ| < 1, ``values`` (c,) of ``fixed``.

        Raises NumericalError where |μ| ≥ 1: the equation is not elliptic there.
        """
        if not (np.abs(mu) < 1.0).all():
            bad = np.flatnonzero(~(np.abs(mu) < 1.0))
            raise NumericalError(
                f"|μ| must stay below 1; {len(bad)} faces do not, first {bad[0]}",
                elements={"faces": bad[:100].tolist()},
            )
        if len(values) != len(self.fixed):
            raise EngineError("one value per fixed vertex", code="shape")
        image = np.zeros(self._count, np.complex128)
        image[self.fixed] = values
        if not len(self._free):
            return image
        data = np.empty(self._pattern.nnz)
        load = np.empty(len(self._free), np.complex128)
        assemble_beltrami(
            self._a,
            self._area,
            self.faces,
            np.ascontiguousarray(mu, np.complex128),
            self._unknown,
            image,
            self._pattern.position,
            data,
            load,
        )
        image[self._free] = self._analysis.factor(data).solve(load)
        return image


def linear_beltrami_solve(
    corners: ComplexArray,
    faces: IntArray,
    mu: ComplexArray,
    fixed: IntArray,
    values: ComplexArray,
) -> ComplexArray:
    """F_b(μ) once: see ``BeltramiSolver``, which keeps its analysis for many solves."""
    return BeltramiSolver(corners, faces, fixed).solve(mu, values)
