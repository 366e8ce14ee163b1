"""The four maps of an edit and how they distort: disks before and after, plane, surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.beltrami import beltrami_coefficient, flat_triangles, folds
from engine.measures import BeltramiHistogram, HistogramSimilarity, histogram, similarity
from engine.operators import face_areas
from engine.pipeline.values import Prepared
from engine.types import ComplexArray, FloatArray, IntArray, Mesh, frozen_array


@dataclass(frozen=True, slots=True)
class Editable:
    """The editable surface's faces on its own disk: what the histograms count.

    ``flat`` (m, 3) isometric corners of each face, ``corners`` (m, 3) its vertices on the
    surface, ``disk`` (m, 3) those on the disk, ``areas`` (m,) on the source.
    """

    flat: ComplexArray
    corners: IntArray
    disk: IntArray
    areas: FloatArray
    bins: int

    def __post_init__(self) -> None:
        for name, dtype in (
            ("flat", np.complex128),
            ("corners", np.int64),
            ("disk", np.int64),
            ("areas", np.float64),
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype))

    def measure(self, corners: ComplexArray, image: ComplexArray) -> BeltramiHistogram:
        """Histogram of the map that takes each face's ``corners`` (m, 3) to ``image`` (m, 3)."""
        own = np.arange(corners.size).reshape(-1, 3)
        coefficient = beltrami_coefficient(corners, own, image.ravel())
        folded = folds(corners, own, image.ravel())
        return histogram(coefficient, self.areas, len(folded), self.bins)


def editable_faces(source: Prepared, bins: int) -> Editable:
    """The faces of the editable surface that the disk holds; hole fills are left out."""
    disk = source.disk.surface
    corners = source.surface.mesh.faces[disk.face]
    surface = Mesh(source.surface.mesh.vertices, corners)
    order = disk.mesh.faces[: len(disk.face)]
    same = disk.vertex[order]
    return Editable(
        flat_triangles(Mesh(source.surface.mesh.vertices, same)),
        same,
        order,
        face_areas(surface),
        bins,
    )


@dataclass(frozen=True, slots=True)
class Distortion:
    """One frame's histograms."""

    edited_to_disk: BeltramiHistogram
    plane: BeltramiHistogram
    surface: BeltramiHistogram
    similarity: HistogramSimilarity


def source_to_disk(source: Prepared, editable: Editable) -> BeltramiHistogram:
    """The source surface against its own disk (the paper's Fig. 13, before)."""
    return editable.measure(editable.flat, source.disk.z[editable.disk])


def frame_distortion(
    source: Prepared,
    editable: Editable,
    before: BeltramiHistogram,
    edited: FloatArray,
    plane: ComplexArray,
) -> Distortion:
    """An edited surface (n_surface, 3) and its plane (n_disk,) against the source's."""
    flat = flat_triangles(Mesh(edited, editable.corners))
    after = editable.measure(flat, plane[editable.disk])
    return Distortion(
        after,
        editable.measure(source.disk.z[editable.disk], plane[editable.disk]),
        editable.measure(editable.flat, flat),
        similarity(before, after),
    )
