"""Vertex normals of an edited mesh, for the places where a file keeps them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.io._mesh_file import MeshFile
from engine.types import BoolArray, FloatArray, IntArray

CONCENTRATED = 0.95


@dataclass(frozen=True, slots=True)
class StoredNormals:
    """Normals ``values`` (k, 3) of a file and the one that each polygon corner uses (c,), or -1."""

    values: FloatArray
    corner_normals: IntArray


def vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(n, 3) area-weighted unit normals; (0, 0, 1) for vertices without any area around them."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    crosses = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    return _unit(_sums(faces.reshape(-1), crosses, len(vertices)), np.array([0.0, 0.0, 1.0]))


def renewed_normals(
    file: MeshFile, vertices: FloatArray, stored: StoredNormals
) -> tuple[IntArray, FloatArray]:
    """The stored normals that the edit to ``vertices`` changes, and their new values.

    A normal is the sum of the area vectors of the polygon corners that use it, which keeps
    creases and flat shading as the file has them, on the side of the surface that it was on.
    Equal normals at one position (seams of texture coordinates) stay equal. Left alone are
    normals of polygons that did not change, and those shared by places that now disagree about
    their direction.
    """
    used = stored.corner_normals >= 0
    polygon = np.repeat(np.arange(file.polygon_count), np.diff(file.offsets))[used]
    corner, record = file.corners[used], stored.corner_normals[used]
    if not len(record):
        return np.empty(0, np.int64), np.empty((0, 3))
    representative = np.zeros(len(stored.values), np.int64)
    representative[record] = corner
    old = file.mesh.vertices
    group = _equal_rows(np.hstack([stored.values, old[representative]]))
    corner_group, groups = group[record], int(group.max()) + 1

    changed = _changed_polygons(file, vertices)
    touched = np.bincount(corner_group, changed[polygon], groups) > 0
    areas = _polygon_areas(file, vertices)[polygon]
    sums = _sums(corner_group, areas, groups)
    group_vertex = np.zeros(groups, np.int64)
    group_vertex[corner_group] = corner
    apart = (old[corner] != old[group_vertex[corner_group]]).any(axis=1)
    shared = np.bincount(corner_group, apart, groups) > 0
    total = np.bincount(corner_group, np.linalg.norm(areas, axis=1), groups)
    length = np.linalg.norm(sums, axis=1)
    usable = touched & (length > 0) & (~shared | (length >= CONCENTRATED * total))

    before = _sums(corner_group, _polygon_areas(file, old)[polygon], groups)
    records = np.flatnonzero(usable[group] & np.isfinite(stored.values).all(axis=1))
    outward = np.einsum("ki,ki->k", before[group[records]], stored.values[records])
    new = _unit(sums[group[records]], np.zeros(3))
    return records, np.where(outward[:, None] < 0, -new, new)


def _sums(index: IntArray, values: FloatArray, count: int) -> FloatArray:
    return np.stack([np.bincount(index, values[:, k], count) for k in range(3)], axis=1)


def _unit(vectors: FloatArray, otherwise: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), otherwise)


def _polygon_areas(file: MeshFile, vertices: FloatArray) -> FloatArray:
    """(p, 3) area vectors of the polygons."""
    faces = file.mesh.faces
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return _sums(file.polygon_of, 0.5 * np.cross(b - a, c - a), file.polygon_count)


def _changed_polygons(file: MeshFile, vertices: FloatArray) -> BoolArray:
    moved = (vertices != file.mesh.vertices).any(axis=1)
    polygon = np.repeat(np.arange(file.polygon_count), np.diff(file.offsets))
    return np.bincount(polygon, moved[file.corners], file.polygon_count) > 0


def _equal_rows(rows: FloatArray) -> IntArray:
    """(k,) a number per row, the same for equal rows; rows with NaN are equal to none."""
    order = np.lexsort(rows.T)
    new = np.ones(len(rows), bool)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    group = np.empty(len(rows), np.int64)
    group[order] = np.cumsum(new) - 1
    return group
