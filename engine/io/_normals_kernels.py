"""Compiled sums of area vectors around the places that share a normal."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, FloatArray, IntArray


@kernel
def find_users(record: IntArray, corners: IntArray, user: IntArray) -> None:
    """``user[record[k]]`` becomes ``corners[k]`` of the last corner k with that record."""
    for k in range(len(record)):
        if record[k] >= 0:
            user[record[k]] = corners[k]


@kernel
def look_up(record: IntArray, group: IntArray, found: IntArray) -> None:
    """``found[k]`` becomes ``group[record[k]]``, -1 for a corner without a record."""
    for k in range(len(record)):
        found[k] = group[record[k]] if record[k] >= 0 else -1


@kernel
def sum_areas(
    vertices: FloatArray,
    corners: IntArray,
    offsets: IntArray,
    groups: IntArray,
    sums: FloatArray,
    lengths: FloatArray,
) -> None:
    """Add each polygon's area vector to ``sums`` (and its length) of each corner's group."""
    area = np.empty(3)
    for polygon in range(len(offsets) - 1):
        first, stop = offsets[polygon], offsets[polygon + 1]
        area[:] = 0.0
        origin = vertices[corners[first]] if stop > first else area
        for k in range(first + 1, stop - 1):
            a = vertices[corners[k]] - origin
            b = vertices[corners[k + 1]] - origin
            area[0] += 0.5 * (a[1] * b[2] - a[2] * b[1])
            area[1] += 0.5 * (a[2] * b[0] - a[0] * b[2])
            area[2] += 0.5 * (a[0] * b[1] - a[1] * b[0])
        length = np.sqrt(area[0] ** 2 + area[1] ** 2 + area[2] ** 2)
        for k in range(first, stop):
            group = groups[k]
            if group >= 0:
                lengths[group] += length
                for axis in range(3):
                    sums[group, axis] += area[axis]


@kernel
def mark_groups(
    vertices: FloatArray,
    moved: BoolArray,
    corners: IntArray,
    offsets: IntArray,
    groups: IntArray,
    first_vertex: IntArray,
    touched: BoolArray,
    shared: BoolArray,
) -> None:
    """Mark groups with a corner in a polygon that changed, and groups at several positions.

    ``first_vertex`` starts as -1 and takes a vertex of each group.
    """
    for polygon in range(len(offsets) - 1):
        changed = False
        for k in range(offsets[polygon], offsets[polygon + 1]):
            changed = changed or moved[corners[k]]
        for k in range(offsets[polygon], offsets[polygon + 1]):
            group = groups[k]
            if group < 0:
                continue
            touched[group] = touched[group] or changed
            if first_vertex[group] < 0:
                first_vertex[group] = corners[k]
            for axis in range(3):
                if vertices[corners[k], axis] != vertices[first_vertex[group], axis]:
                    shared[group] = True


@kernel
def renew(
    stored: FloatArray,
    group: IntArray,
    usable: BoolArray,
    before: FloatArray,
    after: FloatArray,
    records: IntArray,
    normals: FloatArray,
) -> int:
    """How many ``stored`` normals (k, 3) are finite and in a ``usable`` group: they go into
    ``records``, and into ``normals`` the unit vectors along ``after`` of their groups, on the side
    of ``before`` that they were on.
    """
    found = 0
    for k in range(len(stored)):
        own, old, new = stored[k], before[group[k]], after[group[k]]
        if usable[group[k]] and np.isfinite(own[0] + own[1] + own[2]):
            size = np.sqrt(new[0] ** 2 + new[1] ** 2 + new[2] ** 2)
            if own[0] * old[0] + own[1] * old[1] + own[2] * old[2] < 0.0:
                size = -size
            records[found] = k
            for axis in range(3):
                normals[found, axis] = new[axis] / size
            found += 1
    return found
