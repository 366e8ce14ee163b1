"""Rigid registration of two meshes (Algorithm 2, eqs. (1)-(5)), optionally with scale."""

from __future__ import annotations

from typing import Literal

import numpy as np

from engine.errors import RegistrationError
from engine.registration._iterative import closest_point_registration
from engine.registration._robust import robust_registration
from engine.types import Mesh, Registration

__all__ = ["register"]


def register(
    source: Mesh,
    target: Mesh,
    *,
    method: Literal["default", "paper"] = "default",
    free_scale: bool = False,
    tolerance: float = 1e-3,
    max_iterations: int = 100,
) -> Registration:
    """The similarity that carries ``target`` into the frame and the unit of ``source``.

    ``"paper"``: point-to-point ICP on all vertices from the pose as given, scale 1. Ends when E_R
    falls below ``tolerance`` (the paper's τ) times the source's bounding-box diagonal, or when
    the closest points no longer change.

    ``"default"``: any pose; units that differ by a power of ten are detected, and with
    ``free_scale`` any scale is estimated. Robust trimmed point-to-plane steps look for the part
    that did not move, so expressions and missing parts do not bias the pose. Ends when a step
    is shorter than ``tolerance`` hundredths of the square root of the source's area. E_R is
    that of the samples of the source that the target turns out to have, E_R(1) before any turn.

    Raises :class:`RegistrationError` when a mesh has fewer than three points, no extent, or when
    the two do not fit anywhere.
    """
    _check(source, "source")
    _check(target, "target")
    if method == "paper":
        return closest_point_registration(source, target, tolerance, max_iterations)
    return robust_registration(source, target, free_scale, tolerance, max_iterations)


def _check(mesh: Mesh, name: str) -> None:
    count = len(mesh.vertices)
    if count < 3:
        raise RegistrationError(
            f"the {name} has {count} points; a rigid motion needs at least three",
            code="too_few_points",
            elements={"vertex_count": count},
        )
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    extents = np.linalg.svd(centred, compute_uv=False)
    if extents[1] <= 1e-9 * extents[0] or extents[0] == 0.0:
        raise RegistrationError(
            f"all points of the {name} lie on one line, so its rotation is undetermined",
            code="degenerate",
            elements={"extents": extents.tolist()},
        )
