"""What is known of a pair of surfaces once their poses agree."""

from __future__ import annotations

from dataclasses import dataclass

from engine.correspondence._fitting import Target
from engine.correspondence._loops import LoopPair
from engine.correspondence._pyramid import Pyramid
from engine.types import BoolArray, FloatArray, IntArray, Mesh


@dataclass(frozen=True, slots=True)
class AlignedPair:
    """What is known of a rigidly aligned pair before it is fitted.

    ``pyramid`` is the source's surface, ``mesh`` what is compared of it, ``loops`` its own there,
    the outer one first; ``loop_pairs`` are those that the target has as well, ``borders`` all of
    the target's. So many ``cavities`` have been cut from the source and from the target; vertices
    of the latter are ``fresh`` (m,) that lie on a border since then.
    ``exposed`` (n,) is given for what a sensor saw: how surely each source vertex can be seen at
    all. ``led``: by landmarks; ``known``: how such a face moves; ``coarse``: the target;
    ``refined``: the source, whose own faces were.
    """

    pyramid: Pyramid
    target: Target
    loop_pairs: tuple[LoopPair, ...]
    borders: tuple[IntArray, ...]
    cavities: tuple[int, int]
    fresh: BoolArray | None = None
    exposed: FloatArray | None = None
    led: bool = False
    known: bool = False
    coarse: bool = False
    blurred: float = 0.0
    refined: bool = False

    @property
    def mesh(self) -> Mesh:
        """What is compared of the source."""
        return self.pyramid.seen.mesh

    @property
    def loops(self) -> tuple[IntArray, ...]:
        """Its loops."""
        return self.pyramid.seen_loops
