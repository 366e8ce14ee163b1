"""First maps onto the disk: conformal by a Green's function, arc length, barycentric."""

from __future__ import annotations

import numpy as np

from engine.linalg import FixedSolver
from engine.operators import cotangent_weights, vertex_areas, weighted_laplacian
from engine.parameterization._automorphism import centring
from engine.parameterization._intrinsic_kernels import (
    flip_to_delaunay,
    half_cotangents,
    mollified_lengths,
    opposite_halfedges,
)
from engine.types import ComplexArray, DiskSurface, FloatArray, IntArray, Mesh


def delaunay_weights(mesh: Mesh, *, mollification: float = 1e-5) -> tuple[IntArray, FloatArray]:
    """Faces (m, 3) and half cotangents (m, 3) of the intrinsic Delaunay triangulation.

    Edge lengths are lengthened by up to ``mollification`` of their mean, so that degenerate
    faces have an inside. Edge weights are then not negative and harmonic maps onto convex
    regions embed this triangulation (not always the mesh's own).
    """
    length = mollified_lengths(mesh.vertices, mesh.faces, mollification)
    faces = mesh.faces.copy()
    flip_to_delaunay(faces, length, opposite_halfedges(faces, len(mesh.vertices)), 100)
    return faces, half_cotangents(length)


def edge_lengths(disk: DiskSurface) -> FloatArray:
    """Lengths (b,) of the boundary edges; edge i leaves boundary vertex i."""
    loop = disk.mesh.vertices[disk.boundary]
    return np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)


def spread(increments: FloatArray, *, least: float = 1e-4) -> ComplexArray:
    """Points (b,) on the unit circle from 1, ``increments`` (b,) apart as shares of 2π.

    No share is below ``least`` times the mean, which keeps apart boundary vertices that carry no
    measure, such as the tips of ears.
    """
    increments = np.maximum(increments / increments.sum(), least / len(increments))
    turned = np.cumsum(increments) * (2 * np.pi / increments.sum())
    return np.exp(1j * np.concatenate([[0.0], turned[:-1]])).astype(np.complex128)


def conformal_disk(disk: DiskSurface) -> ComplexArray:
    """z (n,) of a discretely conformal map onto the unit disk, centred.

    The boundary is spread by harmonic measure: the flux through it of the Green's function of a
    pole deep inside (the maximum of the torsion function), the conformal parameter of the circle
    by the Riemann map that sends the pole to 0. The interior is harmonic. Then the boundary is
    moved by the disk automorphism that brings the surface's area-weighted mean to 0, and the
    interior is made harmonic again. Raises ``NumericalError``.
    """
    n, boundary = len(disk.mesh.vertices), disk.boundary
    faces, weights = delaunay_weights(disk.mesh)
    laplacian = weighted_laplacian(faces, weights, n)
    solver = FixedSolver(laplacian, boundary)
    lengths = edge_lengths(disk)
    if not len(solver.free):
        return solver.solve(spread(lengths))
    still = np.zeros(len(boundary))
    torsion = solver.solve(still, source=vertex_areas(disk.mesh))
    pole = np.zeros(n)
    pole[np.argmax(torsion)] = 1.0
    flux = np.maximum(-(laplacian @ solver.solve(still, source=pole))[boundary], 0.0)
    before = np.roll(lengths, 1)
    backward = flux * before / np.maximum(before + lengths, 1e-300)
    circle = spread(flux - backward + np.roll(backward, -1))
    z = solver.solve(circle)
    moved = centring(z, surface_areas(disk))(circle)
    return solver.solve(moved / np.abs(moved))


def surface_areas(disk: DiskSurface) -> FloatArray:
    """Barycentric areas (n,) of the surface's own faces, not of those that close its holes."""
    own = Mesh(disk.mesh.vertices, disk.mesh.faces[: len(disk.face)])
    return vertex_areas(own)


def arc_length_disk(disk: DiskSurface) -> ComplexArray:
    """z (n,) of Algorithm 3: boundary by arc length, interior by the cotangent Laplacian."""
    weights = cotangent_weights(disk.mesh)
    laplacian = weighted_laplacian(disk.mesh.faces, weights, len(disk.mesh.vertices))
    circle = spread(edge_lengths(disk))
    return FixedSolver(laplacian, disk.boundary).solve(circle)


def barycentric_disk(disk: DiskSurface, circle: ComplexArray) -> ComplexArray:
    """z (n,) with every interior vertex at the mean of its neighbours: an embedding (Tutte 1963).

    ``circle`` (b,): the boundary's positions, in order around the unit circle.
    """
    half = np.full(disk.mesh.faces.shape, 0.5)
    laplacian = weighted_laplacian(disk.mesh.faces, half, len(disk.mesh.vertices))
    return FixedSolver(laplacian, disk.boundary).solve(circle)


def turned(disk: DiskSurface, z: ComplexArray) -> ComplexArray:
    """``z`` rotated so that direction 1 is the one in which the surface's area lies farthest out.

    The direction is the phase of the area-weighted mean of |z|² z, intrinsic and independent
    of the triangulation. A surface without such a direction keeps the frame it came in.
    """
    moment = complex(surface_areas(disk) @ (np.abs(z) ** 2 * z))
    if moment == 0:
        return z
    z = z * (moment.conjugate() / abs(moment))
    z[disk.boundary] /= np.abs(z[disk.boundary])
    return z
