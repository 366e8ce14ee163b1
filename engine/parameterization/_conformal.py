"""First maps onto the disk: conformal by a Green's function, arc length, barycentric."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from engine.linalg import FixedSolver
from engine.operators import (
    cotangent_laplacian,
    cotangent_weights,
    vertex_areas,
    weighted_laplacian,
)
from engine.parameterization._automorphism import centring
from engine.parameterization._intrinsic_kernels import (
    flip_to_delaunay,
    half_cotangents,
    mollified_lengths,
    opposite_halfedges,
    steep_floor,
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


def spread(density: FloatArray, lengths: FloatArray, *, steepest: float = 50.0) -> ComplexArray:
    """Points (b,) on the unit circle from 1: edge i takes ``density`` i times ``lengths`` i.

    Density falls by at most a factor of ``steepest`` from one edge to the next, and no edge gets
    less than 1e-5 of the mean angle; this keeps apart boundary vertices that carry no measure,
    such as the tips of ears.
    """
    share = steep_floor(density, 1 / steepest) * lengths
    share = np.maximum(share / share.sum(), 1e-5 / len(share))
    turned = np.cumsum(share) * (2 * np.pi / share.sum())
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
        return solver.solve(spread(np.ones_like(lengths), lengths))
    still = np.zeros(len(boundary))
    torsion = solver.solve(still, source=vertex_areas(disk.mesh))
    pole = np.zeros(n)
    pole[np.argmax(torsion)] = 1.0
    flux = np.maximum(-(laplacian @ solver.solve(still, source=pole))[boundary], 0.0)
    lengths = np.maximum(lengths, 1e-12 * lengths.max())
    around = flux / (np.roll(lengths, 1) + lengths)
    circle = spread(around + np.roll(around, -1), lengths)
    z = solver.solve(circle)
    return solver.solve(on_circle(centring(z, surface_areas(disk))(circle)))


def surface_areas(disk: DiskSurface) -> FloatArray:
    """Barycentric areas (n,) of the surface's own faces, not of those that close its holes."""
    own = Mesh(disk.mesh.vertices, disk.mesh.faces[: len(disk.face)])
    return vertex_areas(own)


def arc_length_disk(disk: DiskSurface) -> ComplexArray:
    """z (n,) of Algorithm 3: boundary by arc length, interior by the cotangent Laplacian."""
    weights = cotangent_weights(disk.mesh)
    laplacian = weighted_laplacian(disk.mesh.faces, weights, len(disk.mesh.vertices))
    lengths = edge_lengths(disk)
    circle = spread(np.ones_like(lengths), lengths)
    return FixedSolver(laplacian, disk.boundary).solve(circle)


def embedded(
    mesh: Mesh, fixed: IntArray, z: ComplexArray, *, least: float = 0.02, most: float = 50.0
) -> ComplexArray:
    """z (n,) with every vertex that is not ``fixed`` at a positive mean of its neighbours.

    An embedding if the fixed vertices are a boundary laid out convexly (Tutte 1963, Floater
    1997): any positive weights will do; these are cotangent weights cut off at ``least`` and
    ``most``.
    """
    n = len(mesh.vertices)
    laplacian = cotangent_laplacian(mesh)
    rows = np.repeat(np.arange(n), np.diff(laplacian.indptr))
    apart = rows != laplacian.indices
    rows, columns = rows[apart], laplacian.indices[apart]
    weight = np.clip(-np.asarray(laplacian.data, dtype=np.float64)[apart], least, most)
    every = np.arange(n)
    degree = np.bincount(rows, weights=weight, minlength=n)
    positive = sp.csr_array(
        (
            np.concatenate([degree, -weight]),
            (np.concatenate([every, rows]), np.concatenate([every, columns])),
        ),
        shape=(n, n),
    )
    return FixedSolver(positive, fixed).solve(z[fixed])


def turned(disk: DiskSurface, z: ComplexArray) -> ComplexArray:
    """``z`` rotated so that direction 1 is the one in which the surface's area lies farthest out.

    The direction is the phase of the area-weighted mean of |z|² z, intrinsic and independent
    of the triangulation. A surface without such a direction keeps the frame it came in.
    """
    moment = complex(surface_areas(disk) @ (np.abs(z) ** 2 * z))
    if moment == 0:
        return z
    z = z * (moment.conjugate() / abs(moment))
    z[disk.boundary] = on_circle(z[disk.boundary])
    return z


def centred(disk: DiskSurface, z: ComplexArray) -> ComplexArray:
    """``z`` moved by the disk automorphism that brings the surface's area-weighted mean to 0."""
    z = centring(z, surface_areas(disk))(z)
    z[disk.boundary] = on_circle(z[disk.boundary])
    return z


def on_circle(z: ComplexArray) -> ComplexArray:
    """``z`` (k,) projected onto the unit circle."""
    return z / np.abs(z)
