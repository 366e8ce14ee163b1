"""Per-pose loops behind :mod:`engine.registration._poses`."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray

Triple = tuple[float, float, float]
Lattice = tuple[FloatArray, float, IntArray, IntArray]  # low corner, cell, shape, sample per cell

_AGREE = 0.5  # cosine between the normals of samples that match
_SIDEWAYS = 0.1  # weight of a match's tangential part in a step
_DAMPING = 1e-3


@kernel
def named_sample(x: float, y: float, z: float, lattice: Lattice) -> int:
    """The sample that the lattice names at a point, -1 outside of it."""
    low, cell, shape, nearest = lattice
    i = int(np.floor((x - low[0]) / cell))
    j = int(np.floor((y - low[1]) / cell))
    k = int(np.floor((z - low[2]) / cell))
    if i < 0 or i >= shape[0] or j < 0 or j >= shape[1] or k < 0 or k >= shape[2]:
        return -1
    return int(nearest[(i * shape[1] + j) * shape[2] + k])


@kernel
def _turned(pose: FloatArray, v: Triple) -> Triple:
    """``v`` turned by the rotation of ``pose``."""
    x, y, z = v
    return (
        pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z,
        pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z,
        pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z,
    )


@kernel
def _turned_back(pose: FloatArray, v: Triple) -> Triple:
    """``v`` turned by the inverse of the rotation of ``pose``."""
    x, y, z = v
    return (
        pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z,
        pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z,
        pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z,
    )


@kernel
def _add_equations(
    x: Triple, y: Triple, m: Triple, weight: float, row: FloatArray, H: FloatArray, g: FloatArray
) -> None:
    """Pull the source's point, now at ``x``, to ``y`` along its normal ``m``, sideways a little.

    Of ``H`` the lower triangle is summed.
    """
    for axis in range(4):  # three axes, little, then the normal
        for k in range(3):
            row[3 + k] = m[k] if axis == 3 else (1.0 if axis == k else 0.0)
        row[0] = x[1] * row[5] - x[2] * row[4]
        row[1] = x[2] * row[3] - x[0] * row[5]
        row[2] = x[0] * row[4] - x[1] * row[3]
        r = 0.0
        for k in range(3):
            r += row[3 + k] * (y[k] - x[k])
        w = weight if axis == 3 else _SIDEWAYS * weight
        for a in range(6):
            g[a] += w * row[a] * r
            for b in range(a + 1):
                H[a, b] += w * row[a] * row[b]


@kernel
def add_matches(
    pose: FloatArray,
    forward: bool,
    moving: tuple[FloatArray, FloatArray],
    stride: int,
    fixed: tuple[FloatArray, FloatArray],
    lattice: Lattice,
    width: float,
    gather: bool,
    H: FloatArray,
    g: FloatArray,
) -> float:
    """The share of ``moving`` samples (points, normals) that meet ``fixed`` ones under ``pose``.

    ``forward``: the source moves by the pose; else the target moves by its inverse. With
    ``gather`` adds the normal equations of the small motion that follows the pose to ``H`` (6, 6),
    its lower triangle, and ``g`` (6,).
    """
    points, normals = moving
    others, other_normals = fixed
    row = np.empty(6)
    share, count = 0.0, 0
    shift = pose[0, 3], pose[1, 3], pose[2, 3]
    for i in range(0, len(points), stride):
        count += 1
        p = points[i, 0], points[i, 1], points[i, 2]
        n = normals[i, 0], normals[i, 1], normals[i, 2]
        if forward:
            x, y, z = _turned(pose, p)
            x, y, z = x + shift[0], y + shift[1], z + shift[2]
        else:
            x, y, z = _turned_back(pose, (p[0] - shift[0], p[1] - shift[1], p[2] - shift[2]))
        hit = named_sample(x, y, z, lattice)
        if hit < 0:
            continue
        q = others[hit, 0], others[hit, 1], others[hit, 2]
        square = (x - q[0]) ** 2 + (y - q[1]) ** 2 + (z - q[2]) ** 2
        if square >= width * width:
            continue
        m = other_normals[hit, 0], other_normals[hit, 1], other_normals[hit, 2]
        turned = _turned(pose, n) if forward else _turned_back(pose, n)
        if turned[0] * m[0] + turned[1] * m[1] + turned[2] * m[2] < _AGREE:
            continue
        closeness = 1.0 - square / (width * width)
        share += closeness
        if not gather:
            continue
        weight = closeness * closeness / len(points) * stride
        if forward:
            _add_equations((x, y, z), q, m, weight, row, H, g)
        else:
            x, y, z = _turned(pose, q)
            moved = x + shift[0], y + shift[1], z + shift[2]
            _add_equations(moved, p, n, weight, row, H, g)
    return share / count


@kernel
def solve_positive(H: FloatArray, g: FloatArray) -> None:
    """Solve H x = g for symmetric positive H, by Cholesky; ``g`` becomes x, ``H`` is used up."""
    n = len(g)
    for j in range(n):
        for i in range(j, n):
            for k in range(j):
                H[i, j] -= H[i, k] * H[j, k]
            if i == j:
                H[j, j] = np.sqrt(H[j, j])
            else:
                H[i, j] /= H[j, j]
        for k in range(j):
            g[j] -= H[j, k] * g[k]
        g[j] /= H[j, j]
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            g[j] -= H[k, j] * g[k]
        g[j] /= H[j, j]


@kernel
def turn(pose: FloatArray, step: FloatArray) -> None:
    """Follow ``pose`` by the rotation vector ``step[:3]`` and the shift ``step[3:]``, in place."""
    square = step[0] ** 2 + step[1] ** 2 + step[2] ** 2
    angle = np.sqrt(square)
    s = np.sin(angle) / angle if angle > 1e-12 else 1.0
    c = (1.0 - np.cos(angle)) / square if angle > 1e-12 else 0.5
    for j in range(4):
        x, y, z = pose[0, j], pose[1, j], pose[2, j]
        along = c * (step[0] * x + step[1] * y + step[2] * z)
        rest = 1.0 - c * square
        pose[0, j] = rest * x + s * (step[1] * z - step[2] * y) + along * step[0]
        pose[1, j] = rest * y + s * (step[2] * x - step[0] * z) + along * step[1]
        pose[2, j] = rest * z + s * (step[0] * y - step[1] * x) + along * step[2]
    for k in range(3):
        pose[k, 3] += step[3 + k]


@kernel
def settle_poses(
    poses: FloatArray,
    source: tuple[FloatArray, FloatArray],
    source_lattice: Lattice,
    target: tuple[FloatArray, FloatArray],
    target_lattice: Lattice,
    strides: tuple[int, int],
    areas: tuple[float, float],
    width: float,
    steps: int,
) -> FloatArray:
    """Take ``steps`` steps of every pose (k, 3, 4), in place; the area (k,) that matches then."""
    area = np.empty(len(poses))
    H, g = np.empty((6, 6)), np.empty(6)
    for i in range(len(poses)):
        for step in range(steps + 1):
            H[:] = 0.0
            g[:] = 0.0
            more = step < steps
            ours = add_matches(
                poses[i], True, source, strides[0], target, target_lattice, width, more, H, g
            )
            theirs = add_matches(
                poses[i], False, target, strides[1], source, source_lattice, width, more, H, g
            )
            area[i] = ours * areas[0] + theirs * areas[1]
            if not more or H[5, 5] == 0.0:
                break
            for k in range(6):
                H[k, k] *= 1.0 + _DAMPING
                H[k, k] += 1e-12
            solve_positive(H, g)
            turn(poses[i], g)
    return area
