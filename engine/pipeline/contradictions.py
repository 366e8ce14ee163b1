"""Automatic control points that contradict others in the plane: which ones to leave out."""

from __future__ import annotations

import numpy as np

from engine.errors import QuasiconformalError
from engine.pipeline.controlling import keep_controls
from engine.pipeline.values import Boundary, Controls, Prepared
from engine.quasiconformal import compatible_points

MOST_DROPS = 8
NEAREST_DROPPED = 12


def hopeless(controls: Controls) -> QuasiconformalError:
    """The error where leaving out automatic points did not help."""
    return QuasiconformalError(
        "the control points contradict each other in the plane; use fewer automatic points or "
        "smaller weights",
        code="not_reached",
        elements={"points": list(controls.names[: controls.requested])},
    )


def compatible(source: Prepared, controls: Controls, boundary: Boundary) -> Controls:
    """Drop automatic points whose neighbourhoods the targets turn over."""
    keep = np.ones(len(controls.names), dtype=bool)
    requested = np.arange(len(keep)) < controls.requested
    start = np.concatenate([boundary.start, controls.plane])
    trusted = np.concatenate([np.ones(len(boundary.start), dtype=bool), requested])
    targets = len(controls.plane_targets)
    for index, ends in enumerate(controls.plane_targets):
        where = boundary.at(np.eye(targets)[:, index : index + 1])
        kept = compatible_points(start, np.concatenate([where, ends]), trusted)
        keep &= kept[len(boundary.start) :] | requested
    return keep_controls(controls, np.flatnonzero(keep))


def without_contradictory(
    controls: Controls, boundary: Boundary, error: QuasiconformalError, attempt: int
) -> Controls:
    """Leave out the automatic points that an error names, and those nearest to the named ones.

    Twice as many of the latter at each ``attempt``, so that few attempts suffice. Raises the
    error with names when no automatic point can be the cause.
    """
    named = np.asarray(error.elements.get("points", []), dtype=np.int64) - len(boundary.vertices)
    named = named[named >= 0]
    automatic = np.arange(controls.requested, len(controls.names))
    if not len(automatic):
        names = [controls.names[index] for index in named]
        raise QuasiconformalError(
            f"control points {', '.join(names[:5]) or '(boundary)'} cannot all be met: {error}",
            code=error.code,
            elements={"points": names},
        ) from error
    apart = np.abs(controls.plane[automatic, None] - controls.plane[named]).min(
        axis=1, initial=np.inf
    )
    near = automatic[np.argsort(apart, kind="stable")[: NEAREST_DROPPED * 2**attempt]]
    drop = np.union1d(named[named >= controls.requested], near)
    return keep_controls(controls, np.setdiff1d(np.arange(len(controls.names)), drop))
