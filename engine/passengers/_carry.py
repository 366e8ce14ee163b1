"""What is in the file but not on the edited surface: eyeballs, teeth, tongue, lashes, debris.

Solid bodies ride rigidly on the skin near them. Soft skin is a poor guide to the bone beneath:
lids close over an eye that stays, lips part from teeth that stay. So the fit of the motion is
robust, and skin that stretches counts little. Sheets bend between the solids and the skin that
they are attached to.
"""

from __future__ import annotations

import numpy as np

from engine.passengers._attach import Passengers
from engine.passengers._motions import Motions, belongs, between, moved, robust_motions, two_motions
from engine.passengers._soft import follow
from engine.types import BoolArray, FloatArray, IntArray

SOFT_STRETCH = 0.1
"""Relative change of length at which skin counts half."""


def carry(passengers: Passengers, before: FloatArray, after: FloatArray) -> FloatArray:
    """New positions (n, 3) of all file vertices when the surface moves ``before`` -> ``after``.

    Vertices on the surface take its new positions, bodies move by a rotation and a translation
    each, loose vertices by their neighbour's displacement. Whatever rides on skin that did not
    move keeps its coordinates bit for bit. Continuous in ``after``.
    """
    apart = before != after
    changed = apart[:, 0] | apart[:, 1] | apart[:, 2]
    result = passengers.vertices.copy()
    on = np.flatnonzero(passengers.vertex_of >= 0)
    on = on[changed[passengers.vertex_of[on]]]
    result[on] = after[passengers.vertex_of[on]]
    drawn = changed[passengers.beside]
    loose, beside = passengers.loose[drawn], passengers.beside[drawn]
    result[loose] += after[beside] - before[beside]
    if changed.any():
        _carry_bodies(passengers, before, after, changed, result)
    return result


def _carry_bodies(
    p: Passengers, before: FloatArray, after: FloatArray, changed: BoolArray, result: FloatArray
) -> None:
    soft = p.soft
    by_body = np.zeros((0 if soft is None else len(soft.vertices), 3))
    if len(p.start) > 1:
        motions = _body_motions(p, before, after)
        drawn = changed[p.support]
        drawn = np.add.reduceat(drawn.astype(np.int64), p.start[:-1]) > 0
        riders = np.flatnonzero(p.body >= 0)
        riders = riders[drawn[p.body[riders]]]
        result[riders] = moved(motions, p.body[riders], p.vertices[riders])
        if soft is not None:
            led = drawn[soft.body]
            rest = p.vertices[soft.vertices[led]]
            by_body[led] = moved(motions, soft.body[led], rest) - rest
    if soft is not None:
        by_skin = after[soft.skin] - before[soft.skin]
        result[soft.vertices] += follow(soft, by_body, by_skin)


def _body_motions(p: Passengers, before: FloatArray, after: FloatArray) -> Motions:
    """The skin's around each body; the jaw's for those beside which skin goes with the jaw."""
    firm = 1 / (1 + (_stretch(p.edges, before, after) / SOFT_STRETCH) ** 2)
    start, support, bones = p.start[:-1], p.support, p.bones
    old, new = before[support], after[support]
    own = robust_motions(old, new, p.weight * firm[support], start)
    sample = bones.sample
    found = two_motions(before[sample], after[sample], bones.weight * firm[sample], bones.near)
    if found is None:
        return own
    first, second, reach = found
    one = np.zeros(len(support), dtype=np.int64)
    off = [np.linalg.norm(moved(motion, one, old) - new, axis=1) for motion in (first, second)]
    closeness = p.closeness * firm[support]
    closeness /= np.repeat(np.add.reduceat(closeness, start), np.diff(p.start))
    return between(own, second, belongs(off[0], off[1], reach, closeness, start))


def _stretch(edges: IntArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Per surface vertex, the root mean square relative change of length of its edges."""
    old = np.linalg.norm(before[edges[:, 0]] - before[edges[:, 1]], axis=1)
    new = np.linalg.norm(after[edges[:, 0]] - after[edges[:, 1]], axis=1)
    ends = edges.reshape(-1)
    change = np.bincount(ends, np.repeat((new - old) ** 2, 2), len(before))
    length = np.bincount(ends, np.repeat(old**2, 2), len(before))
    return np.sqrt(change / np.where(length > 0, length, 1))
