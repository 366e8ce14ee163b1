"""Starting poses: which rigid motions bring two surfaces roughly together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from engine.registration._lattice import lattice_of
from engine.registration._poses_kernels import settle_poses
from engine.registration._samples import Samples
from engine.types import FloatArray, IntArray

_ANCHORS = 6  # points of the smaller surface, of which one at least is thought to be on the other
_PLACES = 60  # points of the other per area of the smaller, where an anchor may lie
_SPINS = 18  # turns about the normal there
_CELL, _MARGIN = 0.03, 0.2
_SMOOTH = 40  # samples that a broad normal averages
_ALIKE = 0.05  # squared, in turn and shift together: poses that settle in the same place
_MANY = 20_000  # poses of which a share is kept; no more of more
_ROUNDS = (  # width of a match, samples of either, steps, share of the poses that is kept
    (0.12, 40, 0, 0.23),
    (0.12, 120, 0, 0.062),
    (0.10, 80, 3, 0.0155),
    (0.08, 150, 4, 0.0037),
    (0.05, 400, 6, 0.0025),
)


@dataclass(frozen=True, slots=True)
class Poses:
    """Rigid motions x -> R x + t, best first, and how much area matches under each.

    ``overlap``: matching area / area of both together.
    """

    rotation: FloatArray
    translation: FloatArray
    overlap: FloatArray


def starting_poses(source: Samples, target: Samples, areas: tuple[float, float]) -> Poses:
    """The best coarse poses of ``source`` on ``target``, surfaces of about unit size.

    Each of a few points of the smaller surface is laid on each of many places of the other,
    normals together, turned about them in small steps. The poses under which most area matches,
    both ways, take steps to nearby samples; the better ones go on with more samples and narrower
    matches.
    """
    if areas[1] < areas[0]:
        opposite = starting_poses(target, source, (areas[1], areas[0]))
        turned = np.swapaxes(opposite.rotation, 1, 2)
        shift = -np.einsum("pij,pj->pi", turned, opposite.translation)
        return Poses(turned, shift, opposite.overlap)
    poses = _laid_on(source, target, round(_PLACES * areas[1] / areas[0]))
    lattices = [lattice_of(samples.points, _CELL, _MARGIN) for samples in (source, target)]
    a, b = (source.points, source.normals), (target.points, target.normals)
    area = np.zeros(len(poses))
    tried = min(len(poses), _MANY)
    for width, count, steps, share in _ROUNDS:
        strides = (max(len(a[0]) // count, 1), max(len(b[0]) // count, 1))
        area = settle_poses(poses, a, lattices[0], b, lattices[1], strides, areas, width, steps)
        best, kept = np.argsort(-area, kind="stable"), round(share * tried)
        best = _apart(poses, best, kept) if steps else best[:kept]
        poses, area = np.ascontiguousarray(poses[best]), area[best]
    return Poses(poses[:, :, :3], poses[:, :, 3], area / (2 * sum(areas) - area))


def _apart(poses: FloatArray, order: IntArray, count: int) -> IntArray:
    """The first ``count`` of ``poses`` (p, 3, 4) in their ``order`` of which no two are alike."""
    chosen: list[int] = []
    while len(order) and len(chosen) < count:
        chosen.append(int(order[0]))
        order = order[((poses[order] - poses[order[0]]) ** 2).sum(axis=(1, 2)) > _ALIKE]
    return np.array(chosen, dtype=np.int64)


def _laid_on(source: Samples, target: Samples, places: int) -> FloatArray:
    """(anchors x places x spins, 3, 4): an anchor on a place, broad normals together."""
    on = _frames(source, _ANCHORS)
    there = _frames(target, places)
    angle = 2 * np.pi * np.arange(_SPINS) / _SPINS
    spin = np.zeros((_SPINS, 3, 3))
    spin[:, 0, 0] = spin[:, 1, 1] = np.cos(angle)
    spin[:, 1, 0] = np.sin(angle)
    spin[:, 0, 1] = -spin[:, 1, 0]
    spin[:, 2, 2] = 1
    rotation = np.einsum("pij,sjk,alk->apsil", there[:, :, :3], spin, on[:, :, :3], optimize=True)
    shift = there[None, :, None, :, 3] - np.einsum("apsij,aj->apsi", rotation, on[:, :, 3])
    return np.concatenate([rotation, shift[..., None]], axis=-1).reshape(-1, 3, 4)


def _frames(samples: Samples, count: int) -> FloatArray:
    """(count, 3, 4): spread points, with a frame whose third axis is the broad normal there."""
    tree = KDTree(samples.points)
    chosen = _spread(samples.points, min(count, len(samples.points)))
    near = tree.query(samples.points[chosen], k=min(_SMOOTH, len(samples.points)))[1]
    centre = samples.points[near].mean(axis=1)
    normal = samples.normals[near].sum(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(normal, least)
    first /= np.maximum(np.linalg.norm(first, axis=1), 1e-12)[:, None]
    return np.stack([first, np.cross(normal, first), normal, centre], axis=2)


def _spread(points: FloatArray, count: int) -> IntArray:
    """The numbers of ``count`` of the points: farthest ones, moved to the middle of their cells."""
    far = np.full(len(points), np.inf)
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmin())]
    while len(chosen) < count:
        far = np.minimum(far, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(far.argmax()))
    cell = KDTree(points[chosen]).query(points)[1]
    size = np.maximum(np.bincount(cell, minlength=count), 1)
    middle = np.stack([np.bincount(cell, points[:, k], count) / size for k in range(3)], axis=1)
    return np.asarray(KDTree(points).query(middle)[1], dtype=np.int64)
