"""The rims of cavities that a part of a head was cut through, as far as it still has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from engine.correspondence._corners import lengthened
from engine.correspondence._curves import ClosedCurve
from engine.correspondence._loops import BEYOND_CORNERS, LEAST_VERTICES, LoopPair
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_GAP = 0.15  # between a rim and what is left of it, on average, in square roots of the area
_SAMPLES = 200  # of a lip, and places at which two pieces are compared
_PLACES = 40
_LEAST_SHARE, _LEAST_HELD = 0.1, 3  # of a rim's length, and of its vertices, that must be left


@dataclass(frozen=True, slots=True)
class _Arc:
    """The piece of a curve from arc length ``start`` on to ``end``, which may be past its end."""

    curve: ClosedCurve
    start: float
    end: float

    @property
    def length(self) -> float:
        return self.end - self.start

    def points(self) -> FloatArray:
        return self.curve.at(np.linspace(self.start, self.end, _PLACES))

    def held(self) -> tuple[IntArray, FloatArray]:
        """The curve's points (k,) on the piece, in order, and how far along it they lie."""
        along = np.mod(self.curve.parameters[:-1] - self.start, self.curve.length)
        order = np.argsort(along)
        inside = order[along[order] <= self.length]
        return inside, along[inside]


def open_rims(
    source: Mesh,
    holes: Sequence[IntArray],
    target: Mesh,
    borders: Sequence[IntArray],
    fresh: BoolArray,
) -> tuple[LoopPair, ...]:
    """Pairs for the ``holes`` of an aligned source of whose rims a part's ``borders`` have a piece.

    ``fresh`` (m,): the vertices of the target that lie on its border since a cavity was cut away.
    A stretch of those between others is what is left of a rim. It goes from where the source's lips
    are as far along the mouth to where they are that again, by the way that lies nearest to it.
    """
    curves = [ClosedCurve(source.vertices[hole]) for hole in holes]
    found: list[tuple[float, int, LoopPair]] = []
    for border in borders:
        goal = ClosedCurve(target.vertices[border])
        for arc in _stretches(goal, fresh[border]):
            for k, (hole, curve) in enumerate(zip(holes, curves, strict=True)):
                ours = _alike(curve, arc) if len(hole) >= LEAST_VERTICES else None
                if ours is not None:
                    gap = _gap(ours, arc)
                    found.append((gap, k, _paired(hole, ours, border, arc)))
    nearest = {k: pair for gap, k, pair in sorted(found, key=lambda one: -one[0]) if gap < _GAP}
    return tuple(nearest.values())


def _stretches(curve: ClosedCurve, fresh: BoolArray) -> list[_Arc]:
    """The stretches of a curve through points of which some (k,) are ``fresh``."""
    first = np.flatnonzero(fresh & ~np.roll(fresh, 1))
    last = np.flatnonzero(fresh & ~np.roll(fresh, -1))
    if len(first) and last[0] < first[0]:
        last = np.roll(last, -1)
    long = np.mod(last - first, len(fresh)) + 1 >= LEAST_VERTICES
    at, over = curve.parameters, curve.length
    arcs = (
        _Arc(curve, float(at[a]), float(at[b]) + over * bool(b < a))
        for a, b in zip(first[long], last[long], strict=True)
    )
    return [arc for arc in arcs if arc.length > 0]


def _alike(curve: ClosedCurve, arc: _Arc) -> _Arc | None:
    """The piece of a source's rim that the ``arc`` is what is left of, if there is any."""
    axis = curve.principal_axis()
    one, other = curve.corners(axis)
    other += curve.length * (other < one)
    lips = [np.linspace(one, other, _SAMPLES), np.linspace(other, one + curve.length, _SAMPLES)]
    along = [curve.at(lip) @ axis for lip in lips]
    ends = arc.points()[[0, -1]] @ axis
    places = [
        [float(lip[np.abs(way - end).argmin()]) for lip, way in zip(lips, along, strict=True)]
        for end in ends
    ]
    pieces = [
        _Arc(curve, start, start + float(np.mod(end - start, curve.length)))
        for start, end in product(*places)
    ]
    least = _LEAST_SHARE * curve.length
    long = [
        piece for piece in pieces if piece.length > least and len(piece.held()[0]) >= _LEAST_HELD
    ]
    return min(long, key=lambda piece: _gap(piece, arc), default=None)


def _gap(a: _Arc, b: _Arc) -> float:
    return float(np.linalg.norm(a.points() - b.points(), axis=1).mean())


def _paired(hole: IntArray, ours: _Arc, border: IntArray, theirs: _Arc) -> LoopPair:
    """The ``hole`` where it is ``ours``, from one end of ``theirs`` to the other."""
    curve = ours.curve
    led, at = ours.held()
    corners = np.array(curve.corners(curve.principal_axis()))
    corners = np.sort(np.mod(corners - ours.start, curve.length))
    along = lengthened(
        at,
        corners[corners < ours.length],
        (ours.length, theirs.length),
        power=BEYOND_CORNERS,
    )
    stretch = np.gradient(along) / np.maximum(np.gradient(at), 1e-300)
    trust = np.maximum(stretch, 1.0) ** -2.0
    return LoopPair(hole[led], border, theirs.curve, theirs.start + along, False, trust)
