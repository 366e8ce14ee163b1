"""Surface to disk: a first map, its folds repaired, its frame fixed, its bijectivity certified."""

from __future__ import annotations

from typing import Literal

import numpy as np

from engine.errors import ParameterizationError
from engine.parameterization._certificate import (
    folded_faces,
    folded_vertices,
    rim_turns_once,
    runs_clockwise,
)
from engine.parameterization._conformal import arc_length_disk, conformal_disk
from engine.parameterization._frame import Frame, in_order, on_circle
from engine.parameterization._layout import Layout
from engine.parameterization._triangulation import require_disk
from engine.topology import filled_disk, with_collar
from engine.types import ComplexArray, DiskMap, DiskSurface

_POLISHING_STEPS = 2
_FREEING_STEPS = 4


def disk_map(
    disk: DiskSurface, *, method: Literal["default", "paper"] = "default", polish: bool = False
) -> DiskMap:
    """A bijection of ``disk`` onto the closed unit disk, boundary on the exact circle.

    ``default``: conformal by a Green's function on the intrinsic Delaunay triangulation.
    ``polish`` lowers the mean angle distortion further by two Gauss-Newton steps, the boundary
    sliding. ``paper``: Algorithm 3, boundary by arc length, interior harmonic with cotangent
    weights. The ``Frame`` is the surface's own: in ``default`` its means by area and by boundary
    length are opposite each other; in both the mean by area lies on the negative real axis.

    A disk with holes is mapped onto the disk less the holes' images. It is first mapped with its
    holes closed. In ``default`` the fills are then forgotten and four such steps lower the angle
    distortion of the surface alone, the inner loops moving freely: of the shapes that conformality
    allows them (it determines none) they take one nearby. In ``paper`` they stay.

    Folds of either map are undone locally by the least conformal distortion (boundary sliding
    in ``default``, fixed in ``paper``), from where the vertices are or, where that fails, from
    positive means of neighbours, at last for the whole disk. Every disk without an edge between
    the same two vertices twice has a straight-line embedding with its boundary on the circle
    (Floater 2003). Where such means shrink a thin tube beyond what doubles tell apart, what lies
    behind three of its edges is drawn into them on a grid (``_necks``).

    Raises ``ParameterizationError``: ``not_a_disk`` and ``no_area`` for what is none, ``folds`` and
    ``boundary`` where rounding leaves none; each names faces of ``disk.mesh`` or vertices.
    """
    whole = filled_disk(disk)
    require_disk(whole)
    frame = Frame.of(disk)
    layout = Layout.of(whole.mesh, whole.boundary, slides=method == "default")
    z = layout.without_folds(_first(whole, frame, method))
    _certify(whole, z)
    if method == "default" and disk.holes:
        z = _sharpened(disk, frame, z, _FREEING_STEPS)
    elif method == "default" and polish:
        z = _sharpened(disk, frame, z, _POLISHING_STEPS)
    return DiskMap(disk, z)


def _first(disk: DiskSurface, frame: Frame, method: Literal["default", "paper"]) -> ComplexArray:
    """A map (n,) in its frame, which may fold; of an opened surface that of all up to the curve on
    which it was opened, the boundary of ``disk`` moved out to the circle."""
    whole = with_collar(disk)
    if whole is not disk:
        frame = Frame.of(whole)
    z = arc_length_disk(whole) if method == "paper" else conformal_disk(whole, frame)
    z = frame.turned(z)[: len(disk.mesh.vertices)]
    if whole is not disk:
        z[disk.boundary] = on_circle(in_order(z[disk.boundary]))
    return z


def _sharpened(disk: DiskSurface, frame: Frame, z: ComplexArray, steps: int) -> ComplexArray:
    """The bijection ``z`` (n,) with less angle distortion, its boundary sliding, its holes free.

    Back in the frame it is repaired; where that should fail the frame is left as the steps did.
    """
    layout = Layout.of(disk.mesh, disk.boundary, slides=True)
    sharpener = layout.sharpener(disk.holes)
    distortion = sharpener.distortion(z)
    for _ in range(steps):
        to = sharpener.step(z)
        before, distortion = distortion, sharpener.distortion(to)
        if distortion >= before:
            break
        z = to
    framed = layout.without_folds(frame.framed(z))
    if len(folded_vertices(framed, disk.mesh.faces, disk.holes)):
        framed = frame.turned(z)
    _certify(disk, framed)
    return framed


def _certify(disk: DiskSurface, z: ComplexArray) -> None:
    folded = folded_faces(z, disk.mesh.faces)
    if len(folded):
        raise ParameterizationError(
            f"{len(folded)} faces of the disk could not be laid out without folding, first "
            f"{folded[0]}; remeshing the slivers or pockets around them would help",
            code="folds",
            elements={"faces": folded[:100].tolist(), "count": len(folded)},
        )
    if not rim_turns_once(z[disk.boundary]):
        raise ParameterizationError(
            "the boundary does not wind once around the disk: some of its edges have no length "
            "or carry no measure",
            code="boundary",
            elements={"vertices": disk.boundary[:100].tolist()},
        )
    closed = [loop for loop in disk.holes if not runs_clockwise(z[loop])]
    if closed:
        raise ParameterizationError(
            f"{len(closed)} holes could not be laid out as simple polygons; close them instead",
            code="holes",
            elements={"vertices": np.concatenate(closed)[:100].tolist()},
        )
