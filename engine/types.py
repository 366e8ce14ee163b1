"""The frozen values that flow between the stages; invariants are checked when one is made.

Arrays are read-only, C-contiguous, ``float64``, ``complex128`` or ``int64``. Faces are triangles,
counter-clockwise seen from outside. Boundary loops run with the surface on their left.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engine.errors import EngineError

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def frozen_array(values: ArrayLike, dtype: Any) -> NDArray[Any]:
    """A read-only C-contiguous array; shares memory with ``values`` where that is possible."""
    array = np.ascontiguousarray(values, dtype=dtype).view()
    array.flags.writeable = False
    return array


def _freeze(value: object, **arrays: tuple[ArrayLike, Any]) -> None:
    for name, (values, dtype) in arrays.items():
        object.__setattr__(value, name, frozen_array(values, dtype))


@dataclass(frozen=True, slots=True)
class Mesh:
    """A triangle mesh: ``vertices`` (n, 3) finite, in any length unit; ``faces`` (m, 3)."""

    vertices: FloatArray
    faces: IntArray

    def __post_init__(self) -> None:
        _freeze(self, vertices=(self.vertices, np.float64), faces=(self.faces, np.int64))
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3:
            raise EngineError(f"vertices must be (n, 3), not {self.vertices.shape}", code="shape")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise EngineError(f"faces must be (m, 3), not {self.faces.shape}", code="shape")
        if not np.isfinite(self.vertices).all():
            bad = np.flatnonzero(~np.isfinite(self.vertices).all(axis=1))
            raise EngineError(
                f"{len(bad)} vertices have coordinates that are not finite, first {bad[0]}",
                code="not_finite",
                elements={"vertices": bad[:100].tolist()},
            )
        if self.faces.size and not (
            self.faces.min() >= 0 and self.faces.max() < len(self.vertices)
        ):
            bad = np.flatnonzero(((self.faces < 0) | (self.faces >= len(self.vertices))).any(1))
            raise EngineError(
                f"{len(bad)} faces refer to vertices that do not exist, first face {bad[0]}",
                code="index_out_of_range",
                elements={"faces": bad[:100].tolist(), "vertex_count": len(self.vertices)},
            )

    def moved(self, vertices: FloatArray) -> Mesh:
        """The same faces over other vertex positions."""
        return Mesh(vertices, self.faces)


@dataclass(frozen=True, slots=True)
class MeshWarning:
    """Something unusual that was handled: a stable ``code``, a sentence, how often, where first.

    ``elements`` names what ``first`` (at most 10 indices) counts: vertices, faces, loops, lines.
    """

    code: str
    message: str
    elements: str
    count: int
    first: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Surface:
    """The editable surface of a file: one connected oriented manifold, with its boundary.

    ``mesh`` holds the surface's own welded vertices and cleaned faces. ``vertex_of`` (n_file,)
    gives the surface vertex of each file vertex, -1 for those elsewhere (passengers, unused);
    ``face_of`` (m,) the file's triangle behind each surface face. ``loops`` are the boundary
    loops, the outer one first; empty for a closed surface.
    """

    mesh: Mesh
    vertex_of: IntArray
    face_of: IntArray
    loops: tuple[IntArray, ...]

    def __post_init__(self) -> None:
        _freeze(self, vertex_of=(self.vertex_of, np.int64), face_of=(self.face_of, np.int64))
        object.__setattr__(self, "loops", tuple(frozen_array(x, np.int64) for x in self.loops))
        if len(self.face_of) != len(self.mesh.faces):
            raise EngineError("face_of must name one file triangle per surface face", code="shape")

    @property
    def closed(self) -> bool:
        """Whether the surface has no boundary."""
        return not self.loops


@dataclass(frozen=True, slots=True)
class Opening:
    """How a closed surface was opened, apart from which of its triangles are left.

    ``vertices`` (c, 3) and ``faces`` (k, 3), which come after those of the disk, are the part of
    the surface between the disk, which ends at edges, and the curve ``boundary`` on which it was
    to be opened; none where there is no such curve. ``bearing`` (3,), seen from ``centre`` (3,),
    is a direction of the surface by which its plane can be turned; 0 if it has none.
    """

    vertices: FloatArray
    faces: IntArray
    boundary: IntArray
    centre: FloatArray
    bearing: FloatArray

    def __post_init__(self) -> None:
        _freeze(
            self,
            vertices=(self.vertices, np.float64),
            faces=(self.faces, np.int64),
            boundary=(self.boundary, np.int64),
            centre=(self.centre, np.float64),
            bearing=(self.bearing, np.float64),
        )


@dataclass(frozen=True, slots=True)
class DiskSurface:
    """A topological disk made of a surface: holes closed for the plane, or a closed one opened.

    ``mesh``: its vertices are the surface's ``vertex`` (n_disk,) in that order, -1 for vertices
    that only close holes. Its first ``len(face)`` faces are the surface's faces ``face``; the
    rest close holes and never reach a result. ``boundary`` is the outer boundary loop; ``holes``
    are the loops of holes that were kept, none unless that was asked for. ``opening`` says how a
    closed surface was opened.
    """

    mesh: Mesh
    boundary: IntArray
    vertex: IntArray
    face: IntArray
    holes: tuple[IntArray, ...] = ()
    opening: Opening | None = None

    def __post_init__(self) -> None:
        _freeze(
            self,
            boundary=(self.boundary, np.int64),
            vertex=(self.vertex, np.int64),
            face=(self.face, np.int64),
        )
        object.__setattr__(self, "holes", tuple(frozen_array(x, np.int64) for x in self.holes))
        if len(self.vertex) != len(self.mesh.vertices) or len(self.face) > len(self.mesh.faces):
            raise EngineError("a disk names each of its vertices once", code="shape")


@dataclass(frozen=True, slots=True)
class DiskMap:
    """A bijection of a disk surface onto the closed unit disk: ``z`` (n_disk,) complex."""

    surface: DiskSurface
    z: ComplexArray

    def __post_init__(self) -> None:
        _freeze(self, z=(self.z, np.complex128))
        if self.z.shape != (len(self.surface.mesh.vertices),):
            raise EngineError("a disk map has one plane position per vertex", code="shape")


@dataclass(frozen=True, slots=True)
class Similarity:
    """x -> scale * rotation @ x + translation; ``rotation`` (3, 3) proper, ``scale`` > 0."""

    rotation: FloatArray
    translation: FloatArray
    scale: float = 1.0

    def __post_init__(self) -> None:
        _freeze(
            self,
            rotation=(self.rotation, np.float64),
            translation=(self.translation, np.float64),
        )
        if self.rotation.shape != (3, 3) or self.translation.shape != (3,) or self.scale <= 0:
            raise EngineError("a similarity is a 3x3 rotation, a 3-vector and a scale > 0")

    def __call__(self, points: FloatArray) -> FloatArray:
        """Apply to ``points`` (..., 3)."""
        return self.ways(points) + self.translation

    def ways(self, between: FloatArray) -> FloatArray:
        """Apply to the ways (..., 3) ``between`` points."""
        return self.scale * (between @ self.rotation.T)

    def inverse(self) -> Similarity:
        """The similarity that undoes this one."""
        turned = self.rotation.T
        return Similarity(turned, -(turned @ self.translation) / self.scale, 1.0 / self.scale)


@dataclass(frozen=True, slots=True)
class Registration:
    """Rigid registration (Algorithm 2).

    ``source_from_target`` carries target points into the source's frame; ``rms`` (k,) is E_R
    after each iteration, eq. (4), in source units; ``matching_rate`` is MR, eq. (5).
    """

    source_from_target: Similarity
    rms: FloatArray
    matching_rate: float
    iterations: int
    converged: bool

    def __post_init__(self) -> None:
        _freeze(self, rms=(self.rms, np.float64))

    @property
    def target_from_source(self) -> Similarity:
        """The opposite direction: carries source points into the target's frame."""
        return self.source_from_target.inverse()


@dataclass(frozen=True, slots=True)
class SurfacePoints:
    """Points on a mesh: ``face`` (k,) and ``barycentric`` (k, 3), summing to 1."""

    face: IntArray
    barycentric: FloatArray

    def __post_init__(self) -> None:
        _freeze(self, face=(self.face, np.int64), barycentric=(self.barycentric, np.float64))
        if self.barycentric.shape != (len(self.face), 3):
            raise EngineError("each point has one face and three weights", code="shape")

    def __len__(self) -> int:
        return len(self.face)

    def on(self, mesh: Mesh) -> FloatArray:
        """Their positions (k, 3) on ``mesh``."""
        corners = mesh.vertices.take(mesh.faces.take(self.face, axis=0), axis=0)
        return np.einsum("ki,kij->kj", self.barycentric, corners)


@dataclass(frozen=True, slots=True)
class Correspondence:
    """For each source surface vertex a point on the target surface, and how sure that is.

    ``confidence`` (n,) in [0, 1]; 0 says that the target does not have this point. ``heights``
    (n, 3) lead from the points to the skin that the target's faces stand for, flat or rough, in the
    target's frame.
    """

    points: SurfacePoints
    confidence: FloatArray
    heights: FloatArray
    mode: str = field(default="")

    def __post_init__(self) -> None:
        _freeze(
            self,
            confidence=(self.confidence, np.float64),
            heights=(self.heights, np.float64),
        )
        if self.confidence.shape != self.points.face.shape:
            raise EngineError("one confidence per source vertex", code="shape")
        if self.heights.shape != (len(self.points), 3):
            raise EngineError("one height, a 3-vector, per source vertex", code="shape")

    def on(self, target: Mesh) -> FloatArray:
        """Where (n, 3) the source's vertices are on the skin of the ``target``."""
        return self.points.on(target) + self.heights


@dataclass(frozen=True, slots=True)
class PlaneMap:
    """A map of the source disk into the plane under control points (Algorithm 4).

    ``z`` (n_disk,) edited plane positions; ``mu`` (m_disk,) Beltrami coefficient of the map
    plane -> plane per face; ``residuals`` (k,) max |nu_{n+1} - nu_n| per iteration; ``folds``
    the faces whose signed area is not positive (empty unless a literal algorithm was asked for).
    """

    z: ComplexArray
    mu: ComplexArray
    residuals: FloatArray
    solves: int
    converged: bool
    folds: IntArray

    def __post_init__(self) -> None:
        _freeze(
            self,
            z=(self.z, np.complex128),
            mu=(self.mu, np.complex128),
            residuals=(self.residuals, np.float64),
            folds=(self.folds, np.int64),
        )
