"""Vertex normals of an edited mesh, for the places where a file keeps them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.io import _normals_kernels as kernels
from engine.io._mesh_file import MeshFile
from engine.topology import position_classes
from engine.types import FloatArray, IntArray

CONCENTRATED = 0.95


@dataclass(frozen=True, slots=True)
class StoredNormals:
    """Normals ``values`` (k, 3) of a file and the one that each polygon corner uses (c,), or -1."""

    values: FloatArray
    corner_normals: IntArray


def vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(n, 3) area-weighted unit normals; (0, 0, 1) for vertices without any area around them."""
    sums, lengths = np.zeros(vertices.shape), np.zeros(len(vertices))
    corners, offsets = faces.reshape(-1), 3 * np.arange(len(faces) + 1)
    kernels.sum_areas(vertices, corners, offsets, corners, sums, lengths)
    return _unit(sums, np.array([0.0, 0.0, 1.0]))


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
    old, record = file.mesh.vertices, stored.corner_normals
    user = np.zeros(len(stored.values), np.int64)
    kernels.find_users(record, file.corners, user)
    group = _equal_rows(np.hstack([stored.values, old[user]]))
    count = int(group.max(initial=-1)) + 1
    corner_group = np.empty(len(record), np.int64)
    kernels.look_up(record, group, corner_group)

    touched, shared = np.zeros(count, bool), np.zeros(count, bool)
    first_vertex = np.full(count, -1, np.int64)
    moved = np.logical_or.reduce([a != b for a, b in zip(vertices.T, old.T, strict=True)])
    kernels.mark_groups(
        old, moved, file.corners, file.offsets, corner_group, first_vertex, touched, shared
    )
    before, _ = _area_sums(file, old, corner_group, count)
    after, lengths = _area_sums(file, vertices, corner_group, count)
    size = np.linalg.norm(after, axis=1)
    usable = touched & (size > 0) & (~shared | (size >= CONCENTRATED * lengths))
    records, normals = np.empty(len(group), np.int64), np.empty(stored.values.shape)
    found = kernels.renew(stored.values, group, usable, before, after, records, normals)
    return records[:found], normals[:found]


def _area_sums(
    file: MeshFile, vertices: FloatArray, groups: IntArray, count: int
) -> tuple[FloatArray, FloatArray]:
    sums, lengths = np.zeros((count, 3)), np.zeros(count)
    kernels.sum_areas(vertices, file.corners, file.offsets, groups, sums, lengths)
    return sums, lengths


def _unit(vectors: FloatArray, otherwise: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), otherwise)


def _equal_rows(rows: FloatArray) -> IntArray:
    """(k,) a number per row, the same for equal rows; rows with NaN are equal to none."""
    first = position_classes(rows)
    number = np.cumsum(first == np.arange(len(rows))) - 1
    return number[first]
