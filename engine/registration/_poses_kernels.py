"""Per-pose loops behind :mod:`engine.registration._poses`."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray

Lattice = tuple[FloatArray, float, IntArray, IntArray]  # low corner, cell, shape, sample per cell

_AGREE = 0.5  # cosine between the normals of samples that match
_SIDEWAYS = 0.1  # weight of a match's tangential part in a step
_DAMPING = 1e-3


@kernel
def named_sample(p: FloatArray, lattice: Lattice) -> int:
    """The sample that the lattice names at ``p``, -1 outside of it."""
    low, cell, shape, nearest = lattice
    place = 0
    for k in range(3):
        i = int(np.floor((p[k] - low[k]) / cell))
        if i < 0 or i >= shape[k]:
            return -1
        place = place * shape[k] + i
    return nearest[place]


@kernel
def _apply(pose: FloatArray, point: FloatArray, moved: FloatArray) -> None:
    """``moved`` becomes the image of ``point`` under ``pose``."""
    for k in range(3):
        moved[k] = pose[k, 3]
        for j in range(3):
            moved[k] += pose[k, j] * point[j]


@kernel
def _add_equations(
    x: FloatArray,
    y: FloatArray,
    m: FloatArray,
    weight: float,
    row: FloatArray,
    H: FloatArray,
    g: FloatArray,
) -> None:
    """Pull the source's point, now at ``x``, to ``y`` along its normal ``m``, sideways a little."""
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
            for b in range(6):
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
    ``gather`` adds the normal equations of the small motion that follows the pose to ``H`` (6, 6)
    and ``g`` (6,).
    """
    points, normals = moving
    others, other_normals = fixed
    x, n = np.empty(3), np.empty(3)
    row = np.empty(6)
    share, count = 0.0, 0
    for i in range(0, len(points), stride):
        count += 1
        for k in range(3):
            x[k] = pose[k, 3] if forward else 0.0
            n[k] = 0.0
            for j in range(3):
                if forward:
                    x[k] += pose[k, j] * points[i, j]
                    n[k] += pose[k, j] * normals[i, j]
                else:
                    x[k] += pose[j, k] * (points[i, j] - pose[j, 3])
                    n[k] += pose[j, k] * normals[i, j]
        hit = named_sample(x, lattice)
        if hit < 0:
            continue
        square, cosine = 0.0, 0.0
        for k in range(3):
            square += (x[k] - others[hit, k]) ** 2
            cosine += n[k] * other_normals[hit, k]
        if cosine < _AGREE or square >= width * width:
            continue
        closeness = 1.0 - square / (width * width)
        share += closeness
        if not gather:
            continue
        weight = closeness * closeness / len(points) * stride
        if forward:
            _add_equations(x, others[hit], other_normals[hit], weight, row, H, g)
        else:
            _apply(pose, others[hit], x)
            _add_equations(x, points[i], normals[i], weight, row, H, g)
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
