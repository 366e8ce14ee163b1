"""What can be said before any solve: targets that no fold-free map can meet."""

from __future__ import annotations

import numpy as np

from engine.beltrami import orientations
from engine.errors import QuasiconformalError
from engine.quasiconformal._domain import PlaneDomain
from engine.quasiconformal._limit_kernels import crossing_edges, winding_numbers
from engine.types import ComplexArray, IntArray


def refuse_impossible(domain: PlaneDomain, targets: ComplexArray) -> None:
    """Raise ``impossible``, naming indices into ``points``, when a certificate says so.

    Two points with one target; a face with three constrained corners that is turned over; a
    fully constrained boundary that crosses itself or leaves an inner target outside.
    """
    _refuse(_shared_targets(targets), "share their target with another point")
    index = np.full(len(domain.z), -1, np.int64)
    index[domain.points] = np.arange(len(domain.points))
    corner = index[domain.faces]
    rigid = corner[(corner >= 0).all(axis=1)]
    turned = rigid[orientations(targets[rigid]) <= 0]
    _refuse(np.unique(turned), "turn over faces with all three corners constrained")
    edges = domain.boundary_edges()
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


def points_near_folds(domain: PlaneDomain, w: ComplexArray) -> IntArray:
    """Indices of the control points nearest to each patch of folds, inner ones if there are any.

    Rings of neighbours grow around the folded faces until they hold a control point.
    """
    marked = np.zeros(len(domain.z), np.bool_)
    marked[domain.faces[domain.folds(w)].ravel()] = True
    on_boundary = domain.on_boundary()[domain.points]
    wanted = np.flatnonzero(~on_boundary) if not on_boundary.all() else np.arange(len(on_boundary))
    while marked.any():
        found = wanted[marked[domain.points[wanted]]]
        if len(found) or marked.all():
            return found.astype(np.int64)
        marked[domain.faces[marked[domain.faces].any(axis=1)].ravel()] = True
    return np.zeros(0, np.int64)
