"""Which point of a target's surface each source vertex is, under an unknown expression."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from engine.correspondence._closest import closest_vertices
from engine.correspondence._expressions import (
    Expressions,
    expression_template,
    lay_expressions,
)
from engine.correspondence._nonrigid import nonrigid_correspondence
from engine.numbering import Numbering
from engine.types import Correspondence, FloatArray, Registration, Surface, SurfacePoints
from engine.visibility import ambient_visibility

__all__ = ["Expressions", "correspond", "expression_template", "lay_expressions"]


def correspond(
    source: Surface,
    target: Surface,
    registration: Registration,
    *,
    method: Literal["default", "paper"] = "default",
    landmarks: tuple[SurfacePoints, SurfacePoints] | None = None,
    visibility: tuple[FloatArray, FloatArray] | None = None,
    expressions: Expressions | None = None,
    colours: tuple[FloatArray, FloatArray] | None = None,
) -> Correspondence:
    """For every source surface vertex a point of the target's surface, and how sure that is.

    ``"paper"``: the closest target vertex after the rigid alignment, as Algorithm 2 leaves it;
    every confidence is 1.

    ``"default"``: boundary loops are paired, then the source deforms onto the target, coarse to
    fine; the confidence falls where the target has no such point (beyond its border, normals
    that contradict, too far), where the map turns faces over, and where shape says little.
    ``landmarks`` are known pairs, points of the source's mesh and of the target's; they steer the
    deformation and a landmark on a source vertex is met exactly.

    Cavities (mouths, eye sockets) are cut away where the other surface has an opening too, so
    that their rims lead the outside, and fitted afterwards. ``visibility`` are the ambient
    visibilities of both surfaces' faces, by default from the surfaces alone; those that take the
    whole file into account find the cavities that eyeballs close.

    ``expressions``, as :func:`lay_expressions` has them on the source, are how it is likely to
    have moved: a displacement that they make up costs little. ``colours`` (n, 3) of the source's
    vertices and (m, 3) of the target's, in any unit and light, tell where skin slid along itself;
    they are left out where they do not agree. ``mode`` of the result tells which terms were used,
    and why.

    Raises :class:`RegistrationError` when a surface has no area.
    """
    if method == "paper":
        return closest_vertices(source, target, registration)
    if visibility is None:
        visibility = (ambient_visibility(source.mesh), ambient_visibility(target.mesh))
    numbering = Numbering(target.mesh)
    found = nonrigid_correspondence(
        source,
        numbering.surface(target),
        registration,
        landmarks and (landmarks[0], numbering.points_inside(landmarks[1])),
        (visibility[0], visibility[1][numbering.faces]),
        expressions,
        colours and (colours[0], numbering.inside(colours[1])),
    )
    return replace(found, points=numbering.points_outside(found.points))
