"""What an edit is asked and what it answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol, TypeVar

import numpy as np

from engine.controls import ControlPoint
from engine.errors import EngineError
from engine.measures import BeltramiHistogram, HistogramSimilarity, SurfaceDistance
from engine.types import (
    ComplexArray,
    Correspondence,
    DiskMap,
    FloatArray,
    IntArray,
    MeshWarning,
    PlaneMap,
    Registration,
    Surface,
    SurfacePoints,
)

Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class Options:
    """The method's choices; ``"paper"`` in any of them is the paper's own algorithm, literally.

    ``registration="scaled"``: a target may have any size, not just another unit;
    ``registration_tolerance`` is the paper's τ. ``expression_prior="off"``: the correspondence
    uses nothing but the meshes of the request, not how faces are known to move.
    ``holes="kept"``: holes are not closed for the plane; their loops take the shapes that
    conformality gives them. Raises ``EngineError`` (``options``) for choices that exclude each
    other.
    """

    registration: Literal["default", "scaled", "paper"] = "default"
    registration_tolerance: float = 1e-3
    correspondence: Literal["default", "paper"] = "default"
    expression_prior: Literal["auto", "off"] = "auto"
    parameterization: Literal["default", "paper"] = "default"
    iteration: Literal["default", "minimal", "teichmueller", "paper", "paper_teichmueller"] = (
        "default"
    )
    restoration: Literal["default", "paper"] = "default"
    outer_boundary: Literal["default", "fixed", "matched", "sliding", "free", "paper"] = "default"
    passengers: Literal["default", "rigid", "stay", "paper"] = "default"
    holes: Literal["filled", "kept"] = "filled"

    def __post_init__(self) -> None:
        if self.literal_iteration and self.holes == "kept":
            raise EngineError(
                f"iteration {self.iteration!r} needs a disk without holes: with holes 'kept' use "
                "another iteration",
                code="options",
            )
        if self.literal_iteration and self.outer_boundary == "sliding":
            raise EngineError(
                f"iteration {self.iteration!r} has no sliding boundary: with outer_boundary "
                "'sliding' use another iteration",
                code="options",
            )

    @property
    def literal_iteration(self) -> bool:
        """Whether the plane is mapped by an algorithm as printed, on the whole disk."""
        return self.iteration in {"paper", "paper_teichmueller"}


@dataclass(frozen=True, slots=True)
class Keyframe:
    """A weight per target at a time; weights of targets that it leaves out are 0."""

    time: float
    weights: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class EditPlan:
    """What to do with a source and its targets.

    ``auto`` automatic control points are added to ``points`` (None: a sensible number, when
    there are targets). ``weights`` are eq. (7)'s alpha per target (None: 1 each);
    ``distances`` the paper's d_im per target in their place. ``frames`` meshes lead from the
    source at time 0 to the weights at time 1, or along ``keyframes``; None gives one mesh.
    """

    points: tuple[ControlPoint, ...] = ()
    auto: int | None = None
    weights: Mapping[str, float] | None = None
    distances: Mapping[str, float] = field(default_factory=dict[str, float])
    frames: int | None = None
    keyframes: tuple[Keyframe, ...] = ()
    histogram_bins: int = 50
    options: Options = field(default_factory=Options)


class Stages(Protocol):
    """How the pipeline tells where it is; a caller may also keep results between edits.

    Stages run side by side, in threads; what is within one of them does not.
    """

    def run(self, name: str, key: str, work: Callable[[], Value]) -> Value:
        """Do one piece of the stage ``name``; ``key`` identifies its inputs and choices."""
        ...

    def progress(self, name: str, fraction: float) -> None:
        """Say how much of a stage is done, in [0, 1]."""
        ...

    def iterations(self, name: str, count: int, residual: float) -> None:
        """Say how many iterations a stage took and where it ended."""
        ...


@dataclass(frozen=True, slots=True)
class Prepared:
    """One mesh, ready to be edited.

    ``surface`` and ``disk`` are in normalised coordinates: (file - ``centre``) / ``diagonal``.
    """

    surface: Surface
    disk: DiskMap
    centre: FloatArray
    diagonal: float
    warnings: tuple[MeshWarning, ...]

    def to_file(self, points: FloatArray) -> FloatArray:
        """Normalised points in the file's coordinates."""
        return points * self.diagonal + self.centre

    def from_file(self, points: FloatArray) -> FloatArray:
        """The file's points in normalised coordinates."""
        return (points - self.centre) / self.diagonal


@dataclass(frozen=True, slots=True)
class Match:
    """How a target's surface corresponds to the source's."""

    registration: Registration
    correspondence: Correspondence


@dataclass(frozen=True, slots=True)
class Controls:
    """The resolved control points, those of the request first, then the automatic ones.

    ``points`` on the source surface; ``snap`` the distance each was snapped, file units;
    ``plane`` (c,) their places on the source disk; ``plane_targets`` (targets, c) where each
    target has them; ``target_points`` per target on that target's surface.
    """

    names: tuple[str, ...]
    requested: int
    points: SurfacePoints
    snap: FloatArray
    plane: ComplexArray
    plane_targets: ComplexArray
    given: tuple[IntArray, ...]
    given_at: tuple[SurfacePoints, ...]


@dataclass(frozen=True, slots=True)
class Boundary:
    """How the outer boundary moves: its vertices, and per target their angles' shift.

    Empty ``vertices``: the boundary is free.
    """

    vertices: IntArray
    start: ComplexArray
    shifts: FloatArray

    def at(self, alpha: FloatArray) -> ComplexArray:
        """Plane positions for weights ``alpha`` (targets, b) or (targets, 1).

        Weights are cut to [0, 1] and to a sum of 1: between loops in order, all are in order.
        """
        inside = np.clip(alpha, 0.0, 1.0)
        inside = inside / np.maximum(inside.sum(axis=0), 1.0)
        return self.start * np.exp(1j * (inside * self.shifts).sum(axis=0))

    def freed(self) -> Boundary:
        """The boundary left to the map."""
        return Boundary(self.vertices[:0], self.start[:0], self.shifts[:, :0])


@dataclass(frozen=True, slots=True)
class SolvedPlanes:
    """The planes of an edit's targets: what holds them, the maps, and warm starts for more.

    ``maps`` per target on the source disk's own vertices, ``refined`` with the control points.
    """

    controls: Controls
    boundary: Boundary
    maps: tuple[PlaneMap, ...]
    refined: tuple[ComplexArray, ...]


@dataclass(frozen=True, slots=True)
class CarriedMesh:
    """The source carried to one target.

    ``vertices`` (n_file, 3) in the source file's frame, ``surface`` (n, 3) the editable ones in
    normalised coordinates; ``centre`` of the target file's bounding box.
    """

    name: str
    vertices: FloatArray
    surface: FloatArray
    centre: FloatArray
    warnings: tuple[MeshWarning, ...]
    match: Match
    turned_faces: IntArray


@dataclass(frozen=True, slots=True)
class CarriedTarget(CarriedMesh):
    """And its plane, and how far both surfaces are from each other, in the source file's unit."""

    plane: PlaneMap
    distance: SurfaceDistance


@dataclass(frozen=True, slots=True)
class PlacedPlane:
    """A solved plane: ``map`` on the disk, ``refined`` with points inserted.

    ``reached`` (c,): where the control points ended, ``residual`` from where they were sent at
    most; ``left_out`` names the automatic points that nothing held.
    """

    map: PlaneMap
    refined: ComplexArray
    reached: ComplexArray
    residual: float
    left_out: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class EditedMesh:
    """One edited mesh: ``vertices`` (n_file, 3) at one time of the way."""

    index: int
    time: float
    weights: Mapping[str, float]
    vertices: FloatArray
    turned_faces: IntArray


@dataclass(frozen=True, slots=True)
class Frame(EditedMesh):
    """And how its planes and its surface are distorted.

    ``control_points`` (c,) are their places in the edited plane; ``control_residual`` how far the
    farthest ended from eq. (7)'s T_i; ``left_out`` automatic points that were not held.
    """

    plane: PlaneMap
    control_points: ComplexArray
    control_residual: float
    left_out: tuple[str, ...]
    edited_to_disk: BeltramiHistogram
    plane_to_plane: BeltramiHistogram
    surface_to_surface: BeltramiHistogram
    similarity: HistogramSimilarity


@dataclass(frozen=True, slots=True)
class EditedMeshes:
    """The answer in meshes: every frame, and the source carried to every target."""

    source: Prepared
    controls: Controls
    targets: tuple[CarriedMesh, ...]
    frames: tuple[EditedMesh, ...]


@dataclass(frozen=True, slots=True)
class Edit(EditedMeshes):
    """The whole answer: the meshes, and what there is to know about them."""

    targets: tuple[CarriedTarget, ...]
    frames: tuple[Frame, ...]
    source_to_disk: BeltramiHistogram
