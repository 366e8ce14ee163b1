"""A source surface at the resolutions of a fit, made once for all its targets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from hashlib import blake2b

from engine.correspondence._levels import Level, build_level
from engine.correspondence._spreading import Spreading
from engine.correspondence._static import AROUND
from engine.types import IntArray, Mesh

_COARSE, _FINE = 1000, 2300  # vertices that carry the free displacement
_COMPARED = 12_000  # vertices at most that are compared with the target
_KEPT = 2  # pyramids; targets with and without cavities want one each

_recent: dict[bytes, Pyramid] = {}


@dataclass(frozen=True)
class Pyramid:
    """The surface ``mesh`` with its ``loops``: what is ``seen`` of it, and two levels of that."""

    mesh: Mesh
    loops: tuple[IntArray, ...]

    @classmethod
    def of(cls, mesh: Mesh, loops: tuple[IntArray, ...]) -> Pyramid:
        """The pyramid of a surface; that of an equal one if it was wanted a moment ago."""
        digest = blake2b(digest_size=16)
        for array in (mesh.vertices, mesh.faces, *loops):
            digest.update(str(array.shape).encode() + array.tobytes())
        key = digest.digest()
        pyramid = _recent.pop(key, None) or cls(mesh, loops)
        _recent[key] = pyramid
        if len(_recent) > _KEPT:
            del _recent[next(iter(_recent))]
        return pyramid

    @cached_property
    def seen(self) -> Level:
        """What is compared with the target."""
        return build_level(self.mesh, self.loops, _COMPARED)

    @cached_property
    def seen_loops(self) -> tuple[IntArray, ...]:
        """The loops on what is seen."""
        return self.seen.restricted(self.loops)

    @cached_property
    def spread(self) -> Spreading:
        """What averages values over what is seen, as far as skin must rest together."""
        return Spreading.over(self.seen.mesh, AROUND)

    @cached_property
    def fine(self) -> Level:
        """The fine level of what is seen."""
        return build_level(self.seen.mesh, self.seen_loops, _FINE)

    @cached_property
    def coarse(self) -> Level:
        """The coarse level, made from the fine one, as a level of what is seen."""
        loops = self.fine.restricted(self.seen_loops)
        return build_level(self.fine.mesh, loops, _COARSE).below(self.fine)
