"""First maps onto the disk: conformal by a Green's function, arc length, barycentric."""

from __future__ import annotations

import numpy as np

from engine._halfedge_kernels import opposite_halfedges
from engine.operators import cotangent_weights
from engine.parameterization._frame import Frame, edge_lengths, on_circle
from engine.parameterization._harmonic import HarmonicSolver
from engine.parameterization._harmonic_kernels import barycentric_areas, central_bump
from engine.parameterization._intrinsic_kernels import (
    flip_to_delaunay,
    half_cotangents,
    mollified_lengths,
    steep_floor,
)
from engine.types import ComplexArray, DiskSurface, FloatArray, IntArray, Mesh

_CONCENTRATION = 32  # the power that narrows a source around the pole
_ROUNDS = 3  # of finding the boundary from a source; each leaves about 3 % of the error


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


def spread(density: FloatArray, lengths: FloatArray, *, steepest: float = 50.0) -> ComplexArray:
    """Points (b,) on the unit circle from 1: edge i takes ``density`` i times ``lengths`` i.

    Density falls by at most a factor of ``steepest`` from one edge to the next; with the least
    step of ``on_circle`` this keeps apart boundary vertices that carry no measure, such as the
    tips of ears.
    """
    share = steep_floor(density, 1 / steepest) * lengths
    turned = np.cumsum(share[:-1]) * (2 * np.pi / share.sum())
    return on_circle(np.exp(1j * np.concatenate([[0.0], turned])))


def conformal_disk(disk: DiskSurface, frame: Frame) -> ComplexArray:
    """z (n,) of a discretely conformal map onto the unit disk, centred in ``frame``.

    The boundary is spread by harmonic measure: the flux of the Green's function of a pole, which
    is the conformal parameter of the circle by the Riemann map that sends the pole to 0. The
    interior is harmonic.

    The pole is no vertex, so that the map follows the surface continuously, but a bump that is
    round in the plane: by the mean value property its flux is that of its centre. The first bump
    is around the maximum of the torsion function; the next ones lie round 0 in the frame, in the
    plane that the one before gave. Raises ``NumericalError``.
    """
    n = len(disk.mesh.vertices)
    faces, weights = delaunay_weights(disk.mesh)
    solver = HarmonicSolver(faces, weights, disk.boundary, n)
    lengths = edge_lengths(disk)
    if not len(solver.free):
        return solver.solve(spread(np.ones_like(lengths), lengths))
    lengths = np.maximum(lengths, 1e-12 * lengths.max())
    source = barycentric_areas(disk.mesh.vertices, disk.mesh.faces)
    torsion = solver.solve(np.zeros(len(lengths)), source=source)
    source *= (torsion / torsion.max()) ** _CONCENTRATION
    moved, circle = _centred(solver, frame, source, lengths)
    for _ in range(_ROUNDS - 1):
        source = central_bump(moved, faces, _CONCENTRATION)
        if not source[solver.free].any():  # to rounding the whole inside lies on the circle
            break
        moved, circle = _centred(solver, frame, source, lengths)
    return solver.solve(circle)


def _centred(
    solver: HarmonicSolver, frame: Frame, source: FloatArray, lengths: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """The map (n,) whose boundary is spread by the flux from ``source`` (n,), centred, and where
    it takes the boundary (b,)."""
    still = np.zeros(len(lengths))
    flux = solver.outflow(solver.solve(still, source=source / source.sum()))
    around = np.maximum(flux, 0.0) / (np.roll(lengths, 1) + lengths)
    circle = spread(around + np.roll(around, -1), lengths)
    z = solver.solve(circle)
    centring = frame.centring(z)
    return centring(z), on_circle(centring(circle))


def arc_length_disk(disk: DiskSurface) -> ComplexArray:
    """z (n,) of Algorithm 3: boundary by arc length, interior by the cotangent Laplacian."""
    lengths = edge_lengths(disk)
    weights = cotangent_weights(disk.mesh)
    solver = HarmonicSolver(disk.mesh.faces, weights, disk.boundary, len(disk.mesh.vertices))
    return solver.refined(solver.solve(spread(np.ones_like(lengths), lengths)))


def embedded(
    mesh: Mesh, fixed: IntArray, z: ComplexArray, *, least: float = 0.01, most: float = 25.0
) -> ComplexArray:
    """z (n,) with every vertex that is not ``fixed`` at a positive mean of its neighbours.

    An embedding if the fixed vertices are a boundary laid out convexly (Tutte 1963, Floater
    1997): any positive weights will do; these are half cotangents cut off at ``least`` and
    ``most``.
    """
    weights = np.clip(cotangent_weights(mesh), least, most)
    return HarmonicSolver(mesh.faces, weights, fixed, len(z)).solve(z[fixed])
