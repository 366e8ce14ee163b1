"""Weights below 0 and above 1, which ask for shapes that no target has.

Faces that the blend turns over or crushes there take less of what lies beyond: of an excess e of
the weight, a face of rate r is bent and stretched by (1 - exp(-r e)) / r. Skin that faces skin is
kept apart, and what is still turned over then is opened by repairs found once for each shape and
side; faces that are turned over in mixtures are opened step by step. Everything is continuous in
the weights, and within 0 ... 1 nothing changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from engine.linalg import Factor
from engine.restoration._blend import RETURNS, Blender
from engine.restoration._blend_kernels import damped_weights, deformations
from engine.restoration._contact import Contacts
from engine.restoration._opening import Opening
from engine.restoration._repair import Repair, repairs
from engine.restoration._thinned import ThinnedContacts
from engine.restoration._turned import Orientation
from engine.types import FloatArray

_EXCESSES = (0.125, 0.25, 0.375, 0.5)  # of the weight, at which no face may turn over
_RINGS = 1  # around faces that do, which are damped
_RATE = 4.0  # of damped faces
_REACH = 0.2  # of the diagonal: beyond, the surface is where the blend has it
_FORGIVEN = 0.1  # of a weight left to a face: what the blend could not meet counts less by then
_MIXED = 0.1  # weight of a second shape from which on faces that repairs leave are opened
_LARGE = 40_000  # vertices: larger meshes are parted on coarser ones, and no face is damped,
# for a few fine faces of less bend only make their neighbours turn over


@dataclass(frozen=True, slots=True)
class _Asked:
    """A blend of which faces may take less: its surface, and what its gradients are made of."""

    surface: FloatArray  # (n, 3)
    weights: FloatArray  # (k, m)
    gradients: FloatArray  # (m, 3, 2) of the surface
    extra: FloatArray  # (m, 3, 2) where weights change from vertex to vertex
    unmet: FloatArray  # (m, 3, 2) what the surface has more than the blend asks for,
    unreturned: FloatArray  # (m, 3, 2) and more than the blend turned to it


@dataclass(frozen=True, slots=True)
class _Side:
    """What one shape needs below 0 or above 1: the faces' rates (m,), and repairs."""

    rates: FloatArray
    repairs: list[Repair]


def _mixed(weights: FloatArray) -> float:
    """0 where ``weights`` (k,) or (k, n) ask for one shape alone, 1 where they ask for several."""
    most = np.sort(np.abs(weights).reshape(len(weights), -1).max(axis=1))
    return min(float(most[-2]) / _MIXED, 1.0) if len(most) > 1 else 0.0


class Extrapolator:
    """A ``blender`` of shapes that stays sane at weights from -0.5 to 1.5."""

    def __init__(self, blender: Blender) -> None:
        self.blender = blender
        self._sides: dict[tuple[int, bool], _Side] = {}

    def with_shapes(self, shapes: Mapping[int, FloatArray]) -> Extrapolator:
        """The same with other ``shapes`` (n, 3) at some indices."""
        return Extrapolator(self.blender.with_shapes(shapes))

    def at(self, weights: FloatArray) -> FloatArray:
        """The blend (n, 3) at ``weights`` (k,) or (k, n), as ``Blender.at``.

        Beyond 0 ... 1 faces that only the excess turns over stay open, as far as possible, and
        lips and lids do not pass through each other.
        """
        within = np.clip(weights, 0.0, 1.0)
        if np.array_equal(within, weights):
            return self.blender.at(weights)
        rates = self._no_rates()
        found: list[tuple[Repair, FloatArray]] = []
        for target, own in enumerate(weights):
            for above, excess in enumerate((np.maximum(-own, 0.0), np.maximum(own - 1.0, 0.0))):
                if excess.any():
                    side = self._side(target, bool(above))
                    rates[above, target] = side.rates
                    found += [(repair, excess) for repair in side.repairs]
        inner = self.blender.at(within)
        x = self._parted(weights, rates, inner)
        moves = np.zeros_like(x)
        for repair, excess in found:
            moves[repair.used] += repair.at(x, excess)
        x = x + moves
        mixed = _mixed(weights)
        return x + mixed * (self._opening.opened(x, inner) - x) if mixed else x

    @cached_property
    def _opening(self) -> Opening:
        return Opening(self.blender, self._orientation)

    @cached_property
    def _orientation(self) -> Orientation:
        return Orientation(self.blender.mesh)

    @cached_property
    def _contacts(self) -> Contacts | ThinnedContacts:
        mesh, shapes = self.blender.mesh, self.blender.shapes
        moves = self.blender.moves.sum(axis=0)
        if self._large:
            return ThinnedContacts(mesh, shapes, moves, self._orientation.rings)
        return Contacts(mesh, shapes, moves)

    @property
    def _large(self) -> bool:
        return len(self.blender.mesh.vertices) > _LARGE

    def _no_rates(self) -> FloatArray:
        return np.zeros((2, len(self.blender.shapes), len(self.blender.mesh.faces)))

    def _asked(self, weights: FloatArray, surface: FloatArray) -> _Asked:
        blender, mesh = self.blender, self.blender.mesh
        field = weights.reshape(len(weights), -1)
        faces = blender.face_weights(field)
        blended, stretch = blender.blended(faces, faces)
        extra = blender.transitions(field)
        gradients = deformations(mesh.faces, blender.frames, surface)
        met = gradients - extra
        returned = blender.returned(blended, stretch, extra, surface)
        return _Asked(surface, faces, gradients, extra, met - blended, met - returned)

    @cached_property
    def _factor(self) -> Factor:
        blender = self.blender
        return blender.held_factor(blender.areas / (_REACH * blender.size) ** 2 + blender.hold)

    def _damped(self, asked: _Asked, rates: FloatArray) -> FloatArray:
        """The surface (n, 3) whose faces take what ``rates`` (2, k, m), below and above, leave."""
        given, left = damped_weights(asked.weights, rates[0], rates[1])
        if not left.any():
            return asked.surface
        blender, part = self.blender, np.exp(-left / _FORGIVEN)[:, None, None]
        blended, stretch = blender.blended(given, asked.weights)
        change = blended + asked.extra + part * asked.unmet - asked.gradients
        x = asked.surface + self._factor.solve(blender.divergence(change))
        for _ in range(RETURNS):
            returned = blender.returned(blended, stretch, asked.extra, x)
            change = returned + asked.extra + part * asked.unreturned - asked.gradients
            x = asked.surface + self._factor.solve(blender.divergence(change))
        return x

    def _parted(self, weights: FloatArray, rates: FloatArray, within: FloatArray) -> FloatArray:
        """The surface (n, 3) with damped faces, skin that faces skin apart as ``within`` (n, 3)."""
        x = self.blender.at(weights)
        if rates.any():
            x = self._damped(self._asked(weights, x), rates)
        return self._contacts.parted(x, within)

    def _side(self, target: int, above: bool) -> _Side:
        if (target, above) not in self._sides:
            self._sides[target, above] = self._found(target, above)
        return self._sides[target, above]

    def _found(self, target: int, above: bool) -> _Side:
        mesh, orientation, rates = self.blender.mesh, self._orientation, self._no_rates()
        within = self.blender.shapes[target] if above else mesh.vertices
        already = orientation.turned(within)
        own = rates[int(above), target]

        def surfaces() -> Iterator[FloatArray]:
            for excess in _EXCESSES:
                weights = np.zeros(len(self.blender.shapes))
                weights[target] = 1.0 + excess if above else -excess
                yield self._parted(weights, rates, within)

        found = list(surfaces())
        turned = np.concatenate([orientation.turned(x) for x in found])
        turned = np.setdiff1d(turned, already)
        if len(turned) and not self._large:
            own[orientation.around(turned, _RINGS)[mesh.faces].any(axis=1)] = _RATE
            found = list(surfaces())
        return _Side(own, repairs(mesh, orientation, within, found, _EXCESSES))
