"""What a part of a face still shows of a hole that was cut through: a corner of it, on its border.

A chin whose neck is smooth leaves no trace in the shape when the jaw opens; the border then tells.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engine.correspondence._curves import ClosedCurve
from engine.correspondence._loops import LEAST_VERTICES, LoopPair
from engine.operators import unit_vectors, vertex_normals
from engine.types import FloatArray, IntArray, Mesh

# Lengths in square roots of the source's area.
_SPACING = 0.002  # of the places on the border that are looked at
# over how much a bend is measured: short of jags, and over a mouth wide open; of a loop's length
_REACH, _WIDE, _REACH_OF_LOOP = 0.05, 0.1, 0.12
_NEAR, _PER_LENGTH = 0.09, 5.0  # how far a corner may have moved, and what that counts in bends
_BEND, _ALIKE = 0.2, 0.5  # the least bend (1 - cos), the least cosine between its ways inwards
_SHOWN = 0.5  # how surely a corner's own place is within the target
_SHARE, _STRETCH = 0.4, 1.5  # of a lip beside its corner that leads, and how much it has stretched


def corners_on_border(
    source: Mesh, holes: Sequence[IntArray], within: FloatArray, target: Mesh, border: IntArray
) -> tuple[LoopPair, ...]:
    """Pairs for the ``holes`` of an aligned source of which the target's ``border`` has a corner.

    ``within`` (n,) in [0, 1]: how surely the target goes on around each source vertex.

    Where a slit ends the surface is around it on three sides. A place of the border where it
    likewise bends around what is missing, not only as jags do, in the same direction and nearby, is
    that corner; both lips then go along the border from there, a part of them that is likely to be
    left.
    """
    goal = ClosedCurve(target.vertices[border])
    places = np.arange(0.0, goal.length, _SPACING)
    up = vertex_normals(target)[border]
    sharply, widely = (_bends(goal, up, places, reach) for reach in (_REACH, _WIDE))
    bend = np.where(widely[0] > _BEND, (sharply[0] + widely[0]) / 2, 0.0)
    normals = vertex_normals(source)
    pairs: list[LoopPair] = []
    for hole in (one for one in holes if len(one) >= LEAST_VERTICES):
        curve = ClosedCurve(source.vertices[hole])
        corners = np.array(curve.corners(curve.principal_axis()))
        reach = min(_REACH, _REACH_OF_LOOP * curve.length)
        _, inwards = _bends(curve, normals[hole], corners, reach)
        for corner, inward in zip(corners[:, None], inwards, strict=True):
            if within[hole[curve.segment(corner)[0]]] < _SHOWN:
                continue
            place = _alike(goal.at(places) - curve.at(corner), inward, (bend, widely[1]))
            if place is not None:
                pairs.append(_lips(hole, curve, corner, border, goal, places[place]))
    return tuple(pairs)


def _bends(
    curve: ClosedCurve, normals: FloatArray, at: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """How much (m,) the ``curve`` bends around a gap at arc lengths (m,), and its way inwards.

    1 - cos of the turn over ``reach``, 0 where it bends around the surface, which it has on its
    left, with ``normals`` (k, 3) at its points; and the directions (m, 3) into the bend.
    """
    here, up = curve.at(at), normals[curve.segment(at)[0]]
    ways = here - curve.at(at - reach), curve.at(at + reach) - here
    behind, ahead = (
        unit_vectors(way - np.einsum("mi,mi->m", way, up)[:, None] * up) for way in ways
    )
    around_gap = np.einsum("mi,mi->m", np.cross(behind, ahead), up) > 0
    turn = 1 - np.einsum("mi,mi->m", behind, ahead)
    return np.where(around_gap, turn, 0.0), unit_vectors(ahead - behind)


def _alike(
    offsets: FloatArray, inward: FloatArray, bends: tuple[FloatArray, FloatArray]
) -> int | None:
    """Which of the border's ``bends`` at ``offsets`` (m, 3) from a corner is like it, if any."""
    bend, ways = bends
    far = np.linalg.norm(offsets, axis=1)
    likely = (far < _NEAR) & (bend > _BEND) & (ways @ inward > _ALIKE)
    if not likely.any():
        return None
    return int(np.where(likely, bend - _PER_LENGTH * far, -np.inf).argmax())


def _lips(
    hole: IntArray,
    curve: ClosedCurve,
    corner: FloatArray,
    border: IntArray,
    goal: ClosedCurve,
    place: float,
) -> LoopPair:
    """The ``hole`` beside its ``corner``, along the ``border`` from the ``place`` of that on."""
    half = curve.length / 2
    along = np.mod(curve.parameters[:-1] - corner + half, curve.length) - half
    order = np.argsort(along)
    led = order[np.abs(along[order]) <= max(_SHARE * half, np.abs(along).min())]
    parameters = place + _STRETCH * along[led]
    return LoopPair(hole[led], border, goal, parameters, False, np.ones(len(led)))
