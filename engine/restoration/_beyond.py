"""Weights below 0 and above 1, which ask for shapes that no target has.

Faces that the blend turns over or crushes there take less of what lies beyond: of an excess e of
the weight, a face of rate r is bent and stretched by (1 - exp(-r e)) / r. Rates are found once for
each shape and side: those around faces that turn over rise, in growing neighbourhoods, until none
is left that the shape itself does not turn over. Everything is continuous in the weights, and
within 0 ... 1 nothing changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from engine.linalg import Factor
from engine.restoration._blend import RETURNS, Blender
from engine.restoration._blend_kernels import damped_weights, deformations
from engine.restoration._contact import Contacts
from engine.restoration._turned import Orientation
from engine.types import FloatArray, IntArray

_BELOW = (-0.1, -0.25, -0.5)  # the weights at which no face may turn over
_ABOVE = (1.02, 1.1, 1.25, 1.5)
_RINGS = (1, 2, 3, 4, 5, 6, 8, 10)  # around faces that do, one after the other while some are left
_RATE = 4.0  # of faces damped for the first time, and the factor of every other time
_REACH = 0.2  # of the diagonal: beyond, the surface is where the blend has it
_FORGIVEN = 0.1  # of a weight left to a face: what the blend could not meet counts less by then
_LARGEST = 40_000  # vertices: rates take some 20 blends a shape, seconds beyond


@dataclass(frozen=True, slots=True)
class _Asked:
    """A blend of which faces may take less: its surface, and what its gradients are made of."""

    surface: FloatArray  # (n, 3)
    weights: FloatArray  # (k, m)
    gradients: FloatArray  # (m, 3, 2) of the surface
    extra: FloatArray  # (m, 3, 2) where weights change from vertex to vertex
    unmet: FloatArray  # (m, 3, 2) what the surface has more than the blend asks for,
    unreturned: FloatArray  # (m, 3, 2) and more than the blend turned to it


class Extrapolator:
    """A ``blender`` of shapes that stays sane at weights from -0.5 to 1.5."""

    def __init__(self, blender: Blender) -> None:
        self.blender = blender
        self._rates: dict[tuple[int, bool], FloatArray] = {}

    def with_shapes(self, shapes: Mapping[int, FloatArray]) -> Extrapolator:
        """The same with other ``shapes`` (n, 3) at some indices."""
        return Extrapolator(self.blender.with_shapes(shapes))

    def at(self, weights: FloatArray) -> FloatArray:
        """The blend (n, 3) at ``weights`` (k,) or (k, n), as ``Blender.at``.

        Beyond 0 ... 1 faces that only the excess turns over stay open, as far as possible, and
        lips and lids do not pass through each other; on large meshes the blend is left alone.
        """
        surface = self.blender.at(weights)
        within = np.clip(weights, 0.0, 1.0)
        if np.array_equal(within, weights) or len(surface) > _LARGEST:
            return surface
        rates = np.zeros((2, len(weights), len(self.blender.mesh.faces)))
        for target, own in enumerate(weights):
            for above, beyond in enumerate((own.min() < 0.0, own.max() > 1.0)):
                if beyond:
                    rates[above, target] = self._rates_of(target, bool(above))
        damped = self._damped(self._asked(weights, surface), rates)
        return self._contacts.parted(damped, self.blender.at(within))

    @cached_property
    def _orientation(self) -> Orientation:
        return Orientation(self.blender.mesh)

    @cached_property
    def _contacts(self) -> Contacts:
        blender = self.blender
        return Contacts(blender.mesh, blender.shapes, blender.moves.sum(axis=0))

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

    def _rates_of(self, target: int, above: bool) -> FloatArray:
        if (target, above) not in self._rates:
            self._rates[target, above] = self._found(target, above)
        return self._rates[target, above]

    def _found(self, target: int, above: bool) -> FloatArray:
        """The rates (m,) of one shape's faces on one side."""
        blender, mesh = self.blender, self.blender.mesh
        within = blender.shapes[target] if above else mesh.vertices
        already = self._orientation.turned(within)
        asked: list[_Asked] = []
        for weight in _ABOVE if above else _BELOW:
            weights = np.zeros(len(blender.shapes))
            weights[target] = weight
            asked.append(self._asked(weights, blender.at(weights)))
        rates = np.zeros((2, len(blender.shapes), len(mesh.faces)))
        own = rates[int(above), target]
        best, fewest = own.copy(), len(mesh.faces)
        for rings in _RINGS:
            turned = self._turned(asked, rates, within, already)
            if len(turned) < fewest:
                best, fewest = own.copy(), len(turned)
            if not len(turned):
                break
            near = np.zeros(len(mesh.vertices), dtype=np.bool_)
            near[mesh.faces[turned]] = True
            near = self._orientation.rings.grown(near, rings)[mesh.faces].any(axis=1)
            own[near] = np.maximum(_RATE * own[near], _RATE)
        return best

    def _turned(
        self, asked: list[_Asked], rates: FloatArray, within: FloatArray, already: IntArray
    ) -> IntArray:
        """The faces that any of the blends turns over, but not those that are so ``already``."""
        parted = (self._contacts.parted(self._damped(one, rates), within) for one in asked)
        turned = np.concatenate([self._orientation.turned(x) for x in parted])
        return np.setdiff1d(turned, already)
