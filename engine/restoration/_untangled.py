"""Faces that a move turned over or crushed, opened again as near to the move as they can be.

The patch around them is opened from several definitions of what is up, and grows while faces are
left; whatever leaves the fewest is kept.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from engine.restoration._elastic import Elastic
from engine.restoration._patch import Effort, Patch
from engine.restoration._skin import HeldSkin
from engine.types import FloatArray, IntArray

_RINGS = (8, 12, 16)  # around faces turned over, one after the other while some are left
_ROUNDS = (2, 3, 4)  # and rings whose common rotation then says what is up
_INERTIA = (0.5, 0.75, 0.35, 0.0)  # of what is up: an attempt each, until one succeeds
_NEAR = 0.004  # of the diagonal: how far faces opened in place take their surroundings along
_NEAR_RINGS = (4, 5, 6)  # and the rings around them that may move
_NONE = np.zeros(0, dtype=np.int64)
_LARGEST = 20_000  # vertices of a patch: beyond, seconds a step


class _State(NamedTuple):
    """A surface ``x`` (n, 3), and which of its faces are to be opened."""

    x: FloatArray
    turned: IntArray


class Untangler:
    """Opens faces of ``held`` skin.

    ``widths`` are the rings around faces turned over that may move, one after the other while some
    are left.
    """

    def __init__(self, held: HeldSkin, widths: tuple[int, ...] = _RINGS) -> None:
        self._held, self._widths = held, widths

    @classmethod
    def in_place(
        cls, elastic: Elastic, rest: FloatArray, points: sp.csr_array | None = None
    ) -> Untangler:
        """For a few faces of a surface that is right otherwise.

        ``rest`` (n, 3) is where faces count as undistorted; ``points`` (k, n) keep their places.
        """
        if points is None:
            points = sp.csr_array((0, len(rest)))
        return cls(HeldSkin.of(elastic, _NEAR * elastic.size, points, rest), _NEAR_RINGS)

    def untangled(
        self,
        moved: FloatArray,
        before: FloatArray | None = None,
        begin: FloatArray | None = None,
        effort: Effort | None = None,
    ) -> FloatArray:
        """``moved`` (n, 3) with fewer faces inverted or collapsed than it has, if it has any.

        ``moved`` minimises the skin's energy; ``begin`` (n, 3) is where to start if no more
        faces are so there. Faces that are so in ``before`` (n, 3) already are left alone (at rest
        none is); faces for which no room is found, with the ``effort`` that there is, stay as they
        are.
        """
        already = _NONE if before is None else self._held.orientation.turned(before)
        begins = (moved,) if begin is None else (begin, moved)
        start = min((self._state(x, already) for x in begins), key=_count)
        return self._opened(moved, start, already, effort or Effort())

    def _opened(
        self, moved: FloatArray, start: _State, already: IntArray, effort: Effort
    ) -> FloatArray:
        """The surface with the fewest faces to be opened that attempts from ``start`` lead to."""
        best = start
        for inertia in _INERTIA:
            if not len(best.turned):
                break
            best = min(best, self._attempted(moved, start, already, inertia, effort), key=_count)
        return best.x

    def _attempted(
        self, moved: FloatArray, state: _State, already: IntArray, inertia: float, effort: Effort
    ) -> _State:
        """``state``, near ``moved``, opened in ever larger patches."""
        near = (state.x != moved).any(axis=1)
        for rings, rounds in zip(self._widths, _ROUNDS, strict=False):
            near |= self._held.orientation.around(state.turned, rings)
            count = np.count_nonzero(near)
            if not len(state.turned) or count > _LARGEST or effort.left < count:
                break
            patch = Patch(self._held, near, already, rounds)
            state = self._state(patch.relaxed(moved, state.x, inertia, effort), already)
        return state

    def _state(self, x: FloatArray, already: IntArray) -> _State:
        return _State(x, np.setdiff1d(self._held.orientation.turned(x), already))


def _count(state: _State) -> int:
    return len(state.turned)
