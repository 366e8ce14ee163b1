"""What can be said before any solve: targets that no fold-free map can meet."""

from __future__ import annotations

import numpy as np

from engine.beltrami import orientations
from engine.errors import QuasiconformalError
from engine.quasiconformal._limit_kernels import crossing_edges, winding_numbers
from engine.quasiconformal._plane import Constraints, PreparedPlane
from engine.types import ComplexArray, IntArray


def refuse_impossible(
    plane: PreparedPlane, constraints: Constraints, targets: ComplexArray
) -> None:
    """Raise ``impossible``, naming indices into ``points``, when a certificate says so.

    Two points with one target; a face with three constrained corners that is turned over; a
    fully constrained boundary that crosses itself or leaves an inner target outside; with a
    sliding boundary, a target of an inner point that is not inside the unit circle.
    """
    points = constraints.points
    _refuse(_shared_targets(targets), "share their target with another point")
    index = np.full(len(plane.z), -1, np.int64)
    index[points] = np.arange(len(points))
    corner = index[plane.faces]
    rigid = corner[(corner >= 0).all(axis=1)]
    turned = rigid[orientations(targets[rigid]) <= 0]
    _refuse(np.unique(turned), "turn over faces with all three corners constrained")
    if constraints.sliding.any():
        beyond = ~plane.on_boundary[points] & (np.abs(targets) >= 1.0)
        _refuse(np.flatnonzero(beyond), "have targets that are not inside the unit circle")
    edges = plane.boundary_edges
    if len(edges) == 0 or (index[edges] < 0).any():
        return
    edges = index[edges]
    crossing = np.unique(edges[crossing_edges(edges, targets)])
    _refuse(crossing, "are on a boundary that crosses itself")
    inner = np.ones(len(targets), np.bool_)
    inner[edges.ravel()] = False
    at = np.flatnonzero(inner)
    outside = at[winding_numbers(targets[edges], targets[at]) != 1]
    _refuse(outside, "have targets outside the image of the boundary")


def _refuse(points: IntArray, reason: str) -> None:
    if len(points):
        raise QuasiconformalError(
            f"{len(points)} control points {reason}, first {points[0]}: no map without folds"
            " meets these targets; move or drop them",
            code="impossible",
            elements={"points": points.tolist()},
        )


def _shared_targets(targets: ComplexArray) -> IntArray:
    _, inverse, counts = np.unique(targets, return_inverse=True, return_counts=True)
    return np.flatnonzero(counts[inverse] > 1).astype(np.int64)


def points_near_folds(plane: PreparedPlane, points: IntArray, w: ComplexArray) -> IntArray:
    """Indices of the control points nearest to each patch of folds, inner ones if there are any.

    Rings of neighbours grow around the folded faces until they hold a control point.
    """
    marked = np.zeros(len(plane.z), np.bool_)
    marked[plane.faces[plane.folds(w)].ravel()] = True
    on_boundary = plane.on_boundary[points]
    wanted = np.flatnonzero(~on_boundary) if not on_boundary.all() else np.arange(len(points))
    while marked.any():
        found = wanted[marked[points[wanted]]]
        if len(found) or marked.all():
            return found.astype(np.int64)
        marked[plane.faces[marked[plane.faces].any(axis=1)].ravel()] = True
    return np.zeros(0, np.int64)
