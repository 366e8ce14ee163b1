"""The outer boundary of an edit's planes: sliding along the circle, fixed, or free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import isotonic_regression

from engine.errors import QuasiconformalError
from engine.pipeline.planes import TargetPlane
from engine.pipeline.values import Boundary, Options, Prepared
from engine.types import FloatArray

RIM = 0.97  # a boundary vertex that a target shows beyond this radius lies on its outer loop
RIM_SHARE = 0.6  # outer loops correspond when this share of the source's lies on the target's
SMALLEST_GAP = 0.2  # boundary arcs shrink to no less than this share of their length


def edit_boundary(source: Prepared, planes: Sequence[TargetPlane], options: Options) -> Boundary:
    """Sliding with the targets' outer loops where they correspond, else fixed or free."""
    loop = source.disk.surface.boundary
    start = source.disk.z[loop]
    still = np.zeros((len(planes), len(loop)))
    if options.outer_boundary in {"fixed", "paper"} or not planes:
        return Boundary(loop, start, still)
    free = Boundary(loop, start, still).freed()
    if options.outer_boundary in {"free", "sliding"}:
        return free
    angles = [boundary_angles(source, plane) for plane in planes]
    matched = [found for found in angles if found is not None]
    if len(matched) == len(angles):
        own = np.unwrap(np.angle(start))
        return Boundary(loop, start, np.array(matched) - own)
    if options.outer_boundary == "matched":
        raise QuasiconformalError(
            "outer_boundary 'matched' was asked for, but the outer boundaries do not correspond; "
            "use 'default', 'fixed' or 'free'",
            code="boundary_not_matched",
        )
    return free


def may_be_freed(boundary: Boundary, options: Options) -> bool:
    """Whether the request leaves it to us what a boundary does that no map can follow."""
    return options.outer_boundary == "default" and len(boundary.vertices) > 0


def boundary_angles(source: Prepared, plane: TargetPlane) -> FloatArray | None:
    """Where each outer boundary vertex goes on the circle; None if the loops do not correspond.

    The angles increase strictly along the loop: isotonic regression of what the correspondence
    says, weighted by its confidence.
    """
    loop = source.disk.surface.boundary
    places, sure = plane.places[loop], plane.confidence[loop]
    known = sure > 0.0
    if known.mean() < RIM_SHARE or (np.abs(places[known]) > RIM).mean() < RIM_SHARE:
        return None
    start = np.unwrap(np.angle(source.disk.z[loop]))
    index = np.flatnonzero(known & (np.abs(places) > RIM))
    shift = np.unwrap(np.angle(places[index] * np.exp(-1j * start[index])))
    shift -= 2.0 * np.pi * np.round(np.median(shift) / (2.0 * np.pi))
    count = len(loop)
    around = np.concatenate([index - count, index, index + count])
    shift = np.interp(np.arange(count), around, np.tile(shift, 3))
    weight = np.where(known, np.maximum(sure, 1e-3), 1e-3)
    three = np.concatenate([start - 2.0 * np.pi, start, start + 2.0 * np.pi])
    wanted = (1.0 - SMALLEST_GAP) * three + np.tile(shift, 3)
    increasing = isotonic_regression(wanted, weights=np.tile(weight, 3)).x
    return increasing[count : 2 * count] + SMALLEST_GAP * start
