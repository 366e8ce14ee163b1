"""Rotation-aware blending of shapes in one triangulation.

Each shape's deformation gradient on a face is a rotation times a stretch; weights act on the
rotation's logarithm and on the stretch, and a Poisson equation joins the faces again (after Sumner
et al., "Mesh-based inverse kinematics", 2005). Where neighbours' rotations differ, no surface has
them all, and faces come out short: each then turns to how it lies on the joined surface, and they
are joined once more. An opening jaw so follows an arc and keeps its size.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence

import numpy as np

from engine._halfedge_kernels import opposite_halfedges
from engine.errors import RestorationError
from engine.linalg import ElementPattern, Factor, Keep
from engine.restoration._apart_kernels import (
    least_stretches,
    relative_rotations,
    rotation_logarithms,
    rotations_and_stretches,
    unwrap_rotations,
)
from engine.restoration._blend_kernels import (
    Parts,
    blended_gradients,
    blended_stretches,
    divergence,
    face_means,
    returned_gradients,
    transition_gradients,
)
from engine.restoration._elastic import diagonal, positive_areas
from engine.restoration._frames import frames_of
from engine.restoration._rotation_kernels import nearest_rotations
from engine.types import FloatArray, Mesh

_BRANCH_SURE = 2.0  # radians: turned less than this against its shape, a face's branch is clear
_FLOOR = 0.5  # of the least stretch among the shapes: extrapolation may not go far below
_LEAST_FLOOR = 1e-6  # a shape that crushes a face says nothing about how far it may go
RETURNS = 2  # of the rotations to how the joined faces lie
_FAR = 0.7  # of a face's size: lying otherwise by more than this, it is left as blended
_STILL = 2e-3  # of the diagonal: moved less than this, a vertex counts as still
_STILL_LENGTH = 0.05  # of the diagonal: over this still vertices hold their surroundings
_DRIFT = 1e-4  # holds the whole in place where nothing is still; too weak to bend an arc


class Blender:
    """A source and its shapes, decomposed and factored once, blended at any weights.

    ``shapes``: vertex positions (n, 3) of each shape in the source's triangulation. ``keep``: of
    the analysis, which depends on the triangulation alone. ``moves`` (k, n): how far each vertex
    goes. ``hold`` (n,): how firmly still vertices keep to the linear blend.
    """

    def __init__(self, mesh: Mesh, shapes: Sequence[FloatArray], keep: Keep | None = None) -> None:
        self.mesh = mesh
        self.shapes = tuple(shapes)
        odd = [i for i, shape in enumerate(shapes) if shape.shape != mesh.vertices.shape]
        if odd or not self.shapes:
            raise RestorationError(
                f"blending needs at least one shape, each with {len(mesh.vertices)} vertices; "
                f"{len(odd)} of {len(self.shapes)} have another number",
                code="shape",
                elements={"shapes": odd},
            )
        self.frames = frames_of(mesh)
        self.areas = positive_areas(mesh)
        self.size = diagonal(mesh.vertices)
        pattern = ElementPattern(mesh.faces, len(mesh.vertices))
        self._symbolic = pattern.analyse(keep)
        hats, areas = self.frames.hats, self.frames.areas
        self._stiffness = pattern.assemble(
            np.einsum("m,mia,mja->mij", areas, hats, hats, optimize=True)
        )
        across = opposite_halfedges(mesh.faces, len(mesh.vertices))
        self._neighbours = np.where(across < 0, -1, across // 3).reshape(-1, 3)
        self.moves = np.stack([np.linalg.norm(s - mesh.vertices, axis=1) for s in self.shapes])
        self._parts = self._taken_apart()
        self.hold, self._factor = self._held(self.moves.sum(axis=0))

    def _taken_apart(self) -> Parts:
        apart = [self._apart(shape) for shape in self.shapes]
        whole, omega, stretch = (np.stack(part) for part in zip(*apart, strict=True))
        return Parts(whole, omega, stretch, _floors(stretch))

    def _apart(self, shape: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """One shape's rigid rotation (3,), and relative rotations and stretches (m, 3)."""
        turns, stretch, mean = rotations_and_stretches(self.mesh.faces, self.frames, shape)
        common = nearest_rotations(mean[None])
        omega = rotation_logarithms(relative_rotations(common[0], turns))
        unwrap_rotations(omega, self._neighbours, _BRANCH_SURE)
        return rotation_logarithms(common)[0], omega, stretch

    def with_shapes(self, shapes: Mapping[int, FloatArray]) -> Blender:
        """The same with other ``shapes`` (n, 3) at some indices: only those are decomposed."""
        other = copy.copy(self)
        every, moves = list(self.shapes), self.moves.copy()
        parts = [part.copy() for part in self._parts[:3]]
        for index, shape in shapes.items():
            every[index] = shape
            moves[index] = np.linalg.norm(shape - self.mesh.vertices, axis=1)
            for part, new in zip(parts, self._apart(shape), strict=True):
                part[index] = new
        other.shapes, other.moves = tuple(every), moves
        other._parts = Parts(parts[0], parts[1], parts[2], _floors(parts[2]))
        other.hold, other._factor = other._held(moves.sum(axis=0))
        return other

    def _held(self, moves: FloatArray) -> tuple[FloatArray, Factor]:
        """How firmly each vertex (n,) keeps to the linear blend, and the Poisson factor."""
        still = 1.0 / np.square(1.0 + np.square(moves / (_STILL * self.size)))
        firmness = still / np.square(_STILL_LENGTH * self.size) + _DRIFT / self.size**2
        hold = self.areas * firmness
        return hold, self.held_factor(hold)

    def held_factor(self, hold: FloatArray) -> Factor:
        """The Poisson equation's matrix, vertices held by ``hold`` (n,), factored."""
        data = self._stiffness.copy()
        data[self._symbolic.diagonal] += hold
        return self._symbolic.factor(data)

    def at(self, weights: FloatArray) -> FloatArray:
        """The blend (n, 3) at ``weights`` (k,) per shape, or (k, n) per shape and vertex.

        All weights 0 give the source and a single weight 1 gives that shape, bit for bit; the
        blend is continuous in the weights everywhere, also outside [0, 1].
        """
        weights = np.asarray(weights, dtype=np.float64)
        n = len(self.mesh.vertices)
        if weights.shape not in ((len(self.shapes),), (len(self.shapes), n)):
            raise RestorationError(
                f"{len(self.shapes)} shapes need weights ({len(self.shapes)},) or "
                f"({len(self.shapes)}, {n}), not {weights.shape}",
                code="shape",
            )
        corner = self._corner(weights)
        if corner is not None:
            return corner.copy()
        field = np.broadcast_to(weights.reshape(len(weights), -1), (len(weights), n))
        hold, factor = self.hold, self._factor
        if weights.ndim == 2:
            hold, factor = self._held((np.abs(field) * self.moves).sum(axis=0))
        linear = self.mesh.vertices.copy()
        for weight, shape in zip(field, self.shapes, strict=True):
            linear += weight[:, None] * (shape - self.mesh.vertices)
        held = hold[:, None] * linear
        faces = self.face_weights(field)
        blended, stretch = self.blended(faces, faces)
        extra = self.transitions(field)
        x = factor.solve(self.divergence(blended + extra) + held)
        for _ in range(RETURNS):
            gradients = self.returned(blended, stretch, extra, x)
            x = factor.solve(self.divergence(gradients + extra) + held)
        return x

    def face_weights(self, field: FloatArray) -> FloatArray:
        """The weights (k, m) of the faces, of a ``field`` (k, n) or of numbers (k, 1)."""
        if field.shape[1] == 1 or not field.strides[1]:
            return np.repeat(field[:, :1], len(self.mesh.faces), axis=1)
        return face_means(self.mesh.faces, field)

    def blended(self, weights: FloatArray, common: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Deformation gradients (m, 3, 2) and stretches (m, 3) at ``weights`` (k, m).

        ``common`` (k, m) are the weights of the shapes' rigid rotations.
        """
        stretch = blended_stretches(self._parts, weights)
        return blended_gradients(self.frames, self._parts, stretch, weights, common), stretch

    def transitions(self, field: FloatArray) -> FloatArray:
        """What comes on top of the blended gradients (m, 3, 2).

        Where the weights ``field`` (k, n) change from vertex to vertex, the surface stretches
        between what they move and what they leave, by displacement times their slope: without
        this a point of weight 1 would fall short of its shape.
        """
        if field.shape[1] == 1 or not field.strides[1]:
            return np.zeros((len(self.mesh.faces), 3, 2))
        moves = np.stack(self.shapes) - self.mesh.vertices
        return transition_gradients(self.mesh.faces, self.frames, moves, field)

    def returned(
        self, blended: FloatArray, stretch: FloatArray, extra: FloatArray, x: FloatArray
    ) -> FloatArray:
        """The ``blended`` gradients (m, 3, 2) turned to how the faces lie on ``x`` (n, 3)."""
        faces = self.mesh.faces
        return returned_gradients(faces, self.frames, stretch, x, blended, extra, _FAR)

    def divergence(self, gradients: FloatArray) -> FloatArray:
        """The Poisson equation's right side (n, 3) for deformation ``gradients`` (m, 3, 2)."""
        return divergence(self.mesh.faces, self.frames, gradients, len(self.mesh.vertices))

    def _corner(self, weights: FloatArray) -> FloatArray | None:
        """The shape that ``weights`` ask for unblended, if they do."""
        plain = weights.reshape(len(weights), -1)
        used = plain.any(axis=1)
        if not used.any():
            return self.mesh.vertices
        (which,) = np.nonzero(used)
        if len(which) == 1 and (plain[which[0]] == 1.0).all():
            return self.shapes[which[0]]
        return None


def _floors(stretch: FloatArray) -> FloatArray:
    return np.maximum(_FLOOR * np.minimum(1.0, least_stretches(stretch)), _LEAST_FLOOR)


def blend(mesh: Mesh, shapes: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
    """One blend of ``shapes``; ``Blender`` is for more than one."""
    return Blender(mesh, shapes).at(weights)
