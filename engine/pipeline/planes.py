"""The planes of an edit: targets in the source's frame, control points, boundary, maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.locate import PlaneLocator
from engine.operators import vertex_areas
from engine.parameterization import align_disk
from engine.pipeline.values import Match, Prepared
from engine.types import (
    BoolArray,
    ComplexArray,
    FloatArray,
    IntArray,
    Mesh,
    SurfacePoints,
    frozen_array,
)

COARSEST = 8.0  # lengths per plane length that can still be read, in medians
STRAY = 0.01  # of the face's diagonal


@dataclass(frozen=True, slots=True)
class TargetPlane:
    """A target's disk in the source disk's frame.

    ``z`` (n_target_disk,) plane positions; ``shape`` its disk mesh in the source's normalised
    frame; ``places`` (n_source_disk,) where the correspondence puts each source disk vertex in
    this plane, NaN where it says nothing; ``confidence`` likewise; ``positions`` the same
    places on the skin (n_source_disk, 3), ``heights`` how far that is off the flat faces there.
    ``surface_vertices`` are all the target surface's vertices in the source's normalised frame.
    """

    z: ComplexArray
    shape: Mesh
    surface_vertices: FloatArray
    editable_faces: int
    places: ComplexArray
    positions: FloatArray
    heights: FloatArray
    confidence: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "z", frozen_array(self.z, np.complex128))
        object.__setattr__(self, "places", frozen_array(self.places, np.complex128))
        object.__setattr__(self, "positions", frozen_array(self.positions, np.float64))
        object.__setattr__(self, "heights", frozen_array(self.heights, np.float64))
        object.__setattr__(self, "confidence", frozen_array(self.confidence, np.float64))

    @property
    def editable(self) -> Mesh:
        """The target's editable surface, without what only closes its holes."""
        return Mesh(self.shape.vertices, self.shape.faces[: self.editable_faces])


def place_points(prepared: Prepared, z: ComplexArray, points: SurfacePoints) -> ComplexArray:
    """Plane positions of points on the surface; NaN for those that the disk does not hold."""
    of_surface = np.full(len(prepared.surface.mesh.vertices), np.nan + 0j)
    held = prepared.disk.surface.vertex >= 0
    of_surface[prepared.disk.surface.vertex[held]] = z[held]
    corners = of_surface[prepared.surface.mesh.faces[points.face]]
    weights = points.barycentric
    return np.where(weights > 0.0, corners * weights, 0.0).sum(axis=1)


def target_plane(source: Prepared, target: Prepared, match: Match) -> TargetPlane:
    """Bring the target's disk into the source's frame by the correspondence."""
    disk, vertex = target.disk, source.disk.surface.vertex
    places = place_points(target, disk.z, match.correspondence.points)
    held = vertex >= 0
    here = np.full(len(vertex), np.nan + 0j)
    sure = np.zeros(len(vertex))
    here[held] = places[vertex[held]]
    sure[held] = match.correspondence.confidence[vertex[held]]
    sure[np.isnan(here)] = 0.0
    known = sure > 0.0
    automorphism = align_disk(here[known], source.disk.z[known], sure[known])
    ratio = target.diagonal / source.diagonal
    to_source = match.registration.source_from_target
    shape = disk.surface.mesh.moved(to_source(disk.surface.mesh.vertices * ratio))
    positions, heights = np.zeros((2, len(vertex), 3))
    surface = target.surface.mesh.moved(to_source(target.surface.mesh.vertices * ratio))
    heights[held] = to_source.ways(match.correspondence.heights[vertex[held]])
    positions[held] = match.correspondence.points.on(surface)[vertex[held]] + heights[held]
    moved = np.full(len(vertex), np.nan + 0j)
    moved[known] = automorphism(here[known])
    return TargetPlane(
        automorphism(disk.z),
        shape,
        surface.vertices,
        len(disk.surface.face),
        moved,
        positions,
        heights,
        sure,
    )


def length_per_plane(source: Prepared) -> FloatArray:
    """How long a unit of the source's disk is on the surface, around each vertex."""
    disk = source.disk.surface
    flat = np.stack([source.disk.z.real, source.disk.z.imag, np.zeros(len(disk.vertex))], axis=1)
    there = vertex_areas(disk.mesh.moved(flat))
    return np.sqrt(vertex_areas(disk.mesh) / np.maximum(there, np.finfo(float).tiny))


def finely_mapped(source: Prepared) -> BoolArray:
    """Disk vertices around which the plane is not too small to be read: no depths of pockets.

    The inside of a mouth or a nostril is a speck on a conformal disk. Control points there tie
    each other up, and a look-up from there says little.
    """
    length = length_per_plane(source)
    return length <= COARSEST * np.median(length)


def strayed(source: Prepared, plane: TargetPlane, image: ComplexArray) -> BoolArray:
    """Disk vertices that the plane map carries far from where the correspondence has them.

    It does so where control points that contradict each other had to be left out.
    """
    off = np.abs(image[: len(plane.places)] - plane.places) * length_per_plane(source)
    return np.nan_to_num(off) > STRAY


def beyond_map(plane: TargetPlane, image: ComplexArray) -> ComplexArray:
    """How far the correspondence has each disk vertex from ``image`` (n,), as far as it is sure.

    The plane map goes through some hundred of the correspondence's places and is smooth between
    them; this is what the correspondence knows beyond.
    """
    out = np.zeros_like(image)
    off = np.where(plane.confidence > 0.0, plane.places - image[: len(plane.places)], 0.0)
    out[: len(off)] = plane.confidence * off
    return out


class Reading:
    """Where edited plane positions lie on a target, and how sure that is.

    Only ``known`` (n,) places are read. The others, and those outside the target's surface (in a
    filled hole, beyond its boundary), fall back on the correspondence's own point, at half its
    confidence. ``beyond`` (n,) is added to the plane positions before.
    """

    def __init__(self, plane: TargetPlane, known: BoolArray, beyond: ComplexArray) -> None:
        self._plane = plane
        self._known = known
        self._beyond = beyond
        self._locator = PlaneLocator(plane.z, plane.shape.faces)
        self._last: IntArray | None = None

    def at(self, image: ComplexArray) -> tuple[FloatArray, FloatArray]:
        """Positions (n, 3) and their confidence (n,) for plane positions ``image`` (n,)."""
        plane, image = self._plane, image + self._beyond
        if self._last is None:
            points, outside = self._locator.locate(image)
        else:
            points, outside = self._locator.locate_near(image, self._last)
        self._last = points.face
        inside = (points.face < plane.editable_faces) & (outside < 1e-3) & self._known
        looked_up = points.on(plane.shape) + plane.heights
        positions = np.where(inside[:, None], looked_up, plane.positions)
        return positions, np.where(inside, plane.confidence, 0.5 * plane.confidence)
