"""Starting poses: which of many rotations brings two surfaces roughly together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from engine.registration._procrustes import best_rotations
from engine.registration._samples import Samples
from engine.types import FloatArray

_STARTS = 600
_ROUNDS = ((2, 40, 100), (2, 80, 16), (3, 200, 16))  # steps, samples, poses kept
_OVERLAP = 0.8


@dataclass(frozen=True, slots=True)
class Poses:
    """Rigid motions x -> R x + t, best first, with the trimmed misfit that each leaves."""

    rotation: FloatArray
    translation: FloatArray
    misfit: FloatArray


def spread_rotations(count: int) -> FloatArray:
    """``count`` evenly spread rotations (super-Fibonacci spirals, Alexa 2022), identity first."""
    s = np.arange(count) + 0.5
    r, q = np.sqrt(s / count), np.sqrt(1 - s / count)
    alpha, beta = 2 * np.pi * s / np.sqrt(2), 2 * np.pi * s / 1.533751168755204288118041
    x, y, z, w = r * np.sin(alpha), r * np.cos(alpha), q * np.sin(beta), q * np.cos(beta)
    rotations = np.empty((count + 1, 3, 3))
    rotations[0] = np.eye(3)
    rotations[1:, 0] = np.stack(
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)), 1
    )
    rotations[1:, 1] = np.stack(
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)), 1
    )
    rotations[1:, 2] = np.stack(
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)), 1
    )
    return rotations


def starting_poses(source: Samples, target: Samples, size: float) -> Poses:
    """The best coarse poses of ``source`` on ``target``; ``size`` is a length both share.

    All starts run at once through a few trimmed point-to-point steps in (position, normal); the
    better ones go on with more samples.
    """
    weight = 0.3 * size
    tree = KDTree(np.hstack((target.points, weight * target.normals)))
    rotation = spread_rotations(_STARTS)
    shift = target.points.mean(axis=0) - rotation @ source.points.mean(axis=0)
    poses = Poses(rotation, shift, np.zeros(len(rotation)))
    for steps, samples, kept in _ROUNDS:
        for _ in range(steps):
            poses = _step(tree, target, source.every(samples), poses, weight)
        best = np.argsort(poses.misfit, kind="stable")[:kept]
        poses = Poses(poses.rotation[best], poses.translation[best], poses.misfit[best])
    return poses


def _step(tree: KDTree, target: Samples, moving: Samples, poses: Poses, weight: float) -> Poses:
    """One trimmed point-to-point step of each pose; the misfit is that before the step."""
    turned = np.swapaxes(poses.rotation, 1, 2)
    points = moving.points @ turned + poses.translation[:, None]
    query = np.concatenate((points, weight * (moving.normals @ turned)), axis=2)
    distance, index = tree.query(query.reshape(-1, 6))
    distance = distance.reshape(points.shape[:2])
    images = target.points[index].reshape(points.shape)
    limit = np.quantile(distance, _OVERLAP, axis=1)
    w = (distance <= limit[:, None]).astype(float)
    w /= w.sum(axis=1, keepdims=True)
    centre = w @ moving.points
    image_centre = np.einsum("pk,pki->pi", w, images)
    rotation = best_rotations(moving.points - centre[:, None], images - image_centre[:, None], w)
    translation = image_centre - np.einsum("pij,pj->pi", rotation, centre)
    return Poses(rotation, translation, (w * distance).sum(axis=1))
