"""Control points: how they are addressed, resolved, weighted (eq. 7) and chosen automatically."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from engine.errors import ControlPointError
from engine.locate import PointLocator
from engine.types import (
    BoolArray,
    ComplexArray,
    FloatArray,
    IntArray,
    Mesh,
    Surface,
    SurfacePoints,
    frozen_array,
)

DEFAULT_MAX_SNAP = 0.01  # of the bounding-box diagonal


@dataclass(frozen=True, slots=True)
class VertexAddress:
    """A vertex of the file, 0-based."""

    vertex: int


@dataclass(frozen=True, slots=True)
class PolygonAddress:
    """A point on a polygon of the file: weights of its first three corners, or of all of them."""

    polygon: int
    barycentric: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class PositionAddress:
    """A point in space, snapped to the surface when it is at most ``max_snap`` away.

    Both in the file's units; ``max_snap`` defaults to 1 % of the bounding-box diagonal.
    """

    position: tuple[float, float, float]
    max_snap: float | None = None


Address = VertexAddress | PolygonAddress | PositionAddress


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """One control point of a request: where it is, where it goes, and how strongly.

    ``to`` gives its position on a target, by target name; where it is silent the correspondence
    finds it. ``weights`` and ``distances`` (the paper's d_im, in the source's units) override the
    edit's own for this point. ``fixed`` keeps it in place; ``move`` carries it by that vector.
    """

    name: str
    at: Address
    to: Mapping[str, Address] = field(default_factory=dict[str, Address])
    weights: Mapping[str, float] = field(default_factory=dict[str, float])
    distances: Mapping[str, float] = field(default_factory=dict[str, float])
    fixed: bool = False
    move: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class AddressedMesh:
    """A file's mesh with what addresses refer to: ``first_face`` (p,) of each polygon's fan."""

    mesh: Mesh
    first_face: IntArray
    polygon_of: IntArray
    surface: Surface

    def __post_init__(self) -> None:
        object.__setattr__(self, "first_face", frozen_array(self.first_face, np.int64))
        object.__setattr__(self, "polygon_of", frozen_array(self.polygon_of, np.int64))

    @cached_property
    def locator(self) -> PointLocator:
        """Finds the nearest points of the editable surface."""
        return PointLocator(self.surface.mesh)

    @cached_property
    def diagonal(self) -> float:
        """Of the bounding box of the file's mesh."""
        return float(np.linalg.norm(np.ptp(self.mesh.vertices, axis=0)))


def vertices_near(mesh: Mesh, first_face: IntArray, addresses: Sequence[Address]) -> IntArray:
    """The file vertices that the addresses touch: they say which component is meant."""
    found: list[int] = []
    positions: list[tuple[float, float, float]] = []
    for address in addresses:
        match address:
            case VertexAddress(vertex) if 0 <= vertex < len(mesh.vertices):
                found.append(vertex)
            case PolygonAddress(polygon) if (
                0 <= polygon < len(first_face) and first_face[polygon] >= 0
            ):
                found.append(int(mesh.faces[first_face[polygon], 0]))
            case PositionAddress(position):
                positions.append(position)
            case _:
                continue
    if not positions:
        return np.asarray(found, dtype=np.int64)
    used = np.flatnonzero(np.bincount(mesh.faces.ravel(), minlength=len(mesh.vertices)))
    nearest = KDTree(mesh.vertices[used]).query(np.asarray(positions))[1]
    return np.concatenate([np.asarray(found, dtype=np.int64), used[nearest]])


def resolve(
    addresses: Sequence[Address], names: Sequence[str], file: AddressedMesh
) -> tuple[SurfacePoints, FloatArray]:
    """Where the addresses lie on the editable surface, and how far each was snapped.

    Raises ControlPointError naming every address that cannot be resolved: ``vertex`` or
    ``polygon`` out of range, a point on another component, a position too far away.
    """
    points, distances, problems = resolve_each(addresses, file)
    if problems:
        raise refusal([(names[index], *problem) for index, problem in problems.items()])
    return points, distances


def resolve_each(
    addresses: Sequence[Address], file: AddressedMesh
) -> tuple[SurfacePoints, FloatArray, dict[int, tuple[str, str]]]:
    """As ``resolve``, with code and message of each address that cannot be resolved.

    The place and the distance of such a one mean nothing.
    """
    count = len(addresses)
    if not count:
        return SurfacePoints(np.zeros(0, np.int64), np.zeros((0, 3))), np.zeros(0), {}
    positions = np.empty((count, 3))
    limits = np.full(count, np.inf)
    problems: dict[int, tuple[str, str]] = {}
    for index, address in enumerate(addresses):
        problem = _position(address, file, positions, index)
        if problem:
            problems[index] = problem
            positions[index] = file.mesh.vertices[0]
        elif isinstance(address, PositionAddress):
            limit = address.max_snap
            limits[index] = DEFAULT_MAX_SNAP * file.diagonal if limit is None else limit
        else:
            limits[index] = 1e-9 * file.diagonal
    points, distances = file.locator.nearest(positions)
    for index in np.flatnonzero(distances > limits).tolist():
        problems[index] = _too_far(addresses[index], distances, limits, index)
    good = [None if index in problems else address for index, address in enumerate(addresses)]
    return _exact_vertices(good, points, file.surface), distances, problems


def refusal(problems: Sequence[tuple[str, str, str]]) -> ControlPointError:
    """The error about points that cannot be resolved: name, code and message of each."""
    name, code, message = problems[0]
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return ControlPointError(
        f"control point {name!r}: {message}{more}",
        code=code,
        elements={"points": [name for name, _, _ in problems]},
    )


def _position(
    address: Address, file: AddressedMesh, positions: FloatArray, index: int
) -> tuple[str, str] | None:
    """Write the address's position; or say (code, message) why there is none."""
    mesh = file.mesh
    match address:
        case VertexAddress(vertex):
            if not 0 <= vertex < len(mesh.vertices):
                return "vertex_out_of_range", (
                    f"vertex {vertex} does not exist: the file has {len(mesh.vertices)} vertices"
                )
            positions[index] = mesh.vertices[vertex]
        case PolygonAddress(polygon, barycentric):
            if not 0 <= polygon < len(file.first_face):
                return "polygon_out_of_range", (
                    f"polygon {polygon} does not exist: the file has {len(file.first_face)}"
                )
            corners = _polygon_corners(file, polygon)
            if len(barycentric) not in {3, len(corners)} or len(corners) < 3:
                return "barycentric_size", (
                    f"polygon {polygon} has {len(corners)} corners: give 3 weights (its first "
                    f"three corners) or {len(corners)}, not {len(barycentric)}"
                )
            weights = np.asarray(barycentric)
            if (weights < 0).any() or abs(weights.sum() - 1) > 1e-6:
                return "barycentric_sum", "barycentric weights must be 0 or more and sum to 1"
            corners = corners[: len(weights)]
            positions[index] = (weights / weights.sum()) @ mesh.vertices[corners]
        case PositionAddress(position):
            positions[index] = position
    return None


def _polygon_corners(file: AddressedMesh, polygon: int) -> IntArray:
    first = int(file.first_face[polygon])
    if first < 0:
        return np.empty(0, dtype=np.int64)
    last = int(np.searchsorted(file.polygon_of, polygon, side="right"))
    fan = file.mesh.faces[first:last]
    return np.concatenate([fan[0, :2], fan[:, 2]])


def _too_far(
    address: Address, distances: FloatArray, limits: FloatArray, index: int
) -> tuple[str, str]:
    if isinstance(address, PositionAddress):
        return "snap_too_far", (
            f"position is {distances[index]:.6g} from the surface, more than max_snap = "
            f"{limits[index]:.6g}; move it closer or raise max_snap"
        )
    return "not_on_surface", (
        "the point lies on another component than the editable surface; put all control points "
        "on one component"
    )


def _exact_vertices(
    addresses: Sequence[Address | None], points: SurfacePoints, surface: Surface
) -> SurfacePoints:
    """Vertex addresses become exact corners: weight 1 on one corner, 0 on the others."""
    barycentric = points.barycentric.copy()
    for index, address in enumerate(addresses):
        if isinstance(address, VertexAddress):
            corners = surface.mesh.faces[points.face[index]]
            hit = corners == surface.vertex_of[address.vertex]
            if hit.any():
                barycentric[index] = hit / hit.sum()
    return SurfacePoints(points.face, barycentric)


def distance_weights(distance: float, lengths: FloatArray, targets: int) -> FloatArray:
    """Eq. (7): alpha = d_im / ((k-1) d_ij) for points that travel ``lengths`` to the target.

    At most 1, and 0 where the point does not travel (d_ij -> 0): a point never overshoots.
    """
    travels = lengths > 1e-12 * max(float(lengths.max(initial=0.0)), 1e-300)
    alpha = np.divide(distance, targets * lengths, out=np.zeros_like(lengths), where=travels)
    return np.minimum(alpha, 1.0)


def interpolate_controls(
    start: ComplexArray, ends: Sequence[ComplexArray], alpha: FloatArray
) -> ComplexArray:
    """Eq. (7): T_i = t_i + sum_j alpha_ij (t^j_i - t_i); ``alpha`` is (targets, points)."""
    moved = start.copy()
    for end, weight in zip(ends, alpha, strict=True):
        moved += weight * (end - start)
    return moved


def spread_points(
    positions: FloatArray, importance: FloatArray, count: int, taken: IntArray, allowed: BoolArray
) -> IntArray:
    """``count`` vertices spread over the surface, denser where ``importance`` (n,) >= 0 is high.

    Farthest-point sampling in which distances are stretched by 1 + importance, from the points
    ``taken`` on; only ``allowed`` vertices are chosen. Deterministic. May return fewer.
    """
    stretch = np.where(allowed, 1.0 + importance, 0.0)
    nearest = np.full(len(positions), np.inf)
    for vertex in taken:
        nearest = np.minimum(nearest, np.linalg.norm(positions - positions[vertex], axis=1))
    chosen: list[int] = []
    for _ in range(count):
        score = stretch if np.isinf(nearest[0]) else nearest * stretch
        vertex = int(np.argmax(score))
        if score[vertex] <= 0:
            break
        chosen.append(vertex)
        nearest = np.minimum(nearest, np.linalg.norm(positions - positions[vertex], axis=1))
    return np.asarray(chosen, dtype=np.int64)
