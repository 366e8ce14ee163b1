"""What the service answers."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import ConfigDict, Field

from service.domain import EditStatus
from service.schemas.addresses import Place
from service.schemas.common import Answer, Vector
from service.schemas.edits import EditDocument
from service.schemas.problems import Problem

UnitGuess = Literal["m", "cm", "mm", "µm", "unknown"]


class Warned(Answer):
    """Something unusual that was handled."""

    code: str
    message: str
    elements: str
    """What `first` counts: vertices, faces, loops, lines."""
    count: int
    first: list[int] = Field(default_factory=list)


class MeshInfo(Answer):
    """What an inspection finds in a file."""

    format: Literal["obj", "ply"]
    vertices: int
    polygons: int
    triangles: int
    components: int
    boundary_loops: int
    boundary_loop_lengths: list[int] = Field(default_factory=list)
    """Edges of each boundary loop of the editable surface, the longest first."""
    euler_characteristic: int
    bounding_box: tuple[Vector, Vector]
    """Its lowest and highest corner."""
    unit_guess: UnitGuess
    """The unit in which a face would have this size; `unknown` where it would in none."""
    warnings: list[Warned] = Field(default_factory=list["Warned"])


class Mesh(MeshInfo):
    """An uploaded mesh."""

    id: str
    name: str
    bytes: int
    sha256: str
    created_at: datetime
    landmarks: dict[str, Place] = Field(default_factory=dict)
    """Named places that control points may refer to."""


class MeshPage(Answer):
    """A piece of the list of meshes, newest first."""

    items: list[Mesh]
    next_cursor: str | None


class SnappedPoint(Answer):
    """Where an address lies on the surface."""

    name: str | None = None
    polygon: int
    barycentric: list[float]
    position: Vector
    snap_distance: float
    vertex: int | None = None
    """The vertex of the file, where the point is one."""


class SnappedPoints(Answer):
    """The points in the order in which they were asked for."""

    points: list[SnappedPoint]


class Stage(Answer):
    """One step of the engine."""

    model_config = ConfigDict(frozen=True, extra="allow")

    name: str
    status: str
    progress: float = 0.0
    seconds: float | None = None
    cached: bool = False
    iterations: int | None = None
    residual: float | None = None


class Result(Answer):
    """One result file."""

    name: str
    role: str
    target: str | None = None
    frame: int | None = None
    weights: dict[str, float] | None = None
    media_type: str
    bytes: int
    sha256: str
    href: str


class ResultPage(Answer):
    """The result files of an edit."""

    items: list[Result]
    next_cursor: str | None


class EditLinks(Answer):
    """Where the edit's parts are."""

    self: str
    events: str
    results: str
    cancel: str


class Edit(Answer):
    """An edit as it stands."""

    id: str
    status: EditStatus
    queue_position: int | None = None
    """How many edits are ahead of it, while it is queued."""
    stages: list[Stage]
    """In the order in which the engine runs them."""
    document: EditDocument | None = None
    """The edit as it was accepted: mesh ids and places in place of file names and landmarks; not
    in lists."""
    summary: dict[str, Any] = Field(default_factory=dict)
    """What came out, in brief: the resolved control points, warnings, figures."""
    error: Problem | None = None
    """Why it failed."""
    results: list[Result] | None = None
    """Its result files, once it has succeeded and until they expire; not in lists."""
    attempt: int
    created_at: datetime
    started_at: datetime | None = None
    finished_at: datetime | None = None
    expires_at: datetime | None = None
    """When its results are removed."""
    links: EditLinks


class EditPage(Answer):
    """A piece of the list of edits, newest first."""

    items: list[Edit]
    next_cursor: str | None


class WarnedAt(Warned):
    """Something unusual in one of an edit's meshes."""

    pointer: str
    """Where the edit document names the mesh."""


class InputMesh(Answer):
    """A mesh that an edit uses."""

    mesh: str
    unit_guess: UnitGuess


class InputMeshes(Answer):
    """The meshes that an edit uses."""

    source: InputMesh
    targets: dict[str, InputMesh]


class Validation(Answer):
    """What an edit would do."""

    model_config = ConfigDict(frozen=True, extra="allow")

    valid: Literal[True] = True
    document: EditDocument
    """The edit as it would run."""
    inputs: InputMeshes
    warnings: list[WarnedAt] = Field(default_factory=list["WarnedAt"])


class EventData(Answer):
    """The data of a server-sent event."""

    model_config = ConfigDict(frozen=True, extra="allow")

    type: str
    at: datetime


class Ready(Answer):
    """Whether the service can do its work."""

    status: Literal["live", "ready"]


class Version(Answer):
    """Which service this is."""

    name: str
    version: str
    api: str
