"""The edit document: what a client asks for. What needs no mesh is checked here and in rules.py."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, field_validator

from service.schemas.addresses import Address
from service.schemas.common import (
    MAX_FRAMES,
    MAX_POINTS,
    MAX_TARGETS,
    Length,
    Name,
    Request,
    Vector,
)

MAX_AUTO = 1_000
Weight = Annotated[float, Field(ge=-2, le=3)]
MeshReference = Annotated[str, Field(min_length=1, max_length=255, pattern=r"^[^\x00-\x1f]+$")]
TargetWeights = Annotated[dict[Name, Weight], Field(max_length=MAX_TARGETS)]
TargetDistances = Annotated[dict[Name, Length], Field(max_length=MAX_TARGETS)]
Format = Literal["source", "obj", "ply", "glb"]


class Target(Request):
    """An expression that the source can be edited towards."""

    mesh: MeshReference
    """The id of an uploaded mesh; in a multipart request also the name of a file in it."""
    name: Name
    """What weights and control points call it."""


class ControlPoint(Request):
    """A point of the source, and where it goes.

    With neither `fixed` nor `move` it follows eq. (7) towards the targets.
    """

    name: Name = Field(default_factory=str)
    """Unique; `point-<index>` where it is left out."""
    at: Address
    """Where it lies on the source."""
    to: Annotated[dict[Name, Address], Field(max_length=MAX_TARGETS)] = Field(default_factory=dict)
    """Where it lies on a target. Where this is silent, the registration finds it."""
    moved_to: Annotated[dict[Name, Address], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict
    )
    """Where it goes on a target in place of `to`. What `to` led to stays and is bent around the
    point, in a fraction of a second; another `to` has everything found anew."""
    weights: TargetWeights = Field(default_factory=dict)
    """Its own weights, in place of the edit's."""
    distance: TargetDistances = Field(default_factory=dict)
    """The paper's d_im, in the source's unit, in place of a weight."""
    fixed: bool = False
    """It stays where it is."""
    move: Vector | None = None
    """It is carried by this vector, in the source's unit."""


class ControlPoints(Request):
    """Points that are given, and how many more the service chooses itself."""

    points: Annotated[list[ControlPoint], Field(max_length=MAX_POINTS)] = Field(
        default_factory=list["ControlPoint"]
    )
    auto: Annotated[int, Field(ge=0, le=MAX_AUTO)] | None = None
    """How many points the service chooses. With neither `points` nor `auto` it chooses a
    sensible number."""

    @field_validator("points")
    @classmethod
    def _name_the_unnamed(cls, points: list[ControlPoint]) -> list[ControlPoint]:
        return [
            point if point.name else point.model_copy(update={"name": f"point-{index}"})
            for index, point in enumerate(points)
        ]


class Keyframe(Request):
    """The weights at one time of the path."""

    time: Annotated[float, Field(ge=0, le=1e6)]
    weights: TargetWeights
    """Targets left out keep the edit's own weight."""


class Output(Request):
    """Which files the edit makes, beside the report."""

    formats: Annotated[list[Format], Field(min_length=1, max_length=4)] = Field(
        default_factory=lambda: ["source"]
    )
    """`source`: the source's own format and layout; `glb`: one file with a morph target per
    target and the frames as an animation."""
    histogram_bins: Annotated[int, Field(ge=1, le=1000)] = 50
    figures: bool = True
    """`false`: the same meshes without planes, histograms, distances and the bundle, and a report
    without them. For a client that shows the face while somebody drags a slider or a point."""


class Options(Request):
    """The method's choices. `paper` is the paper's own algorithm, literally."""

    holes: Literal["filled", "kept"] = "filled"
    """`kept`: holes are not closed for the plane; the inner loops take the shapes that
    conformality gives them. Not with an `iteration` of the paper's."""
    registration: Literal["default", "scaled", "paper"] = "default"
    """`default` finds any pose, and units that differ by a power of ten; `scaled` finds any scale,
    too."""
    registration_tolerance: Annotated[float, Field(gt=0, le=1)] = 1e-3
    """The paper's τ: the smaller, the later the registration ends."""
    correspondence: Literal["default", "paper"] = "default"
    expression_prior: Literal["auto", "off"] = "auto"
    """`auto`: where a face model fits the source, its expressions tell how skin is likely to move;
    `off`: nothing is used but the meshes of the request."""
    parameterization: Literal["default", "paper"] = "default"
    iteration: Literal["default", "minimal", "teichmueller", "paper", "paper_teichmueller"] = (
        "default"
    )
    """The plane map. `minimal`: nearly the least maximum of |μ|; `teichmueller`: |μ| nearly even.
    Neither folds. `paper_teichmueller`: the fixed-point iteration for an even |μ|, literally."""
    restoration: Literal["default", "paper"] = "default"
    outer_boundary: Literal["default", "fixed", "matched", "sliding", "free", "paper"] = "default"
    """`sliding`: it slides along the circle, in order. Not with an `iteration` of the paper's."""
    passengers: Literal["default", "rigid", "stay", "paper"] = "default"
    """Parts of the file beside the edited surface. `paper` is `stay`."""


class EditDocument(Request):
    """What to edit, towards what, by which points, how far, and which files to make of it."""

    model_config = ConfigDict(json_schema_extra={"required": ["source"]})

    source: MeshReference
    """The id of an uploaded mesh; in a multipart request also the name of a file in it."""
    targets: Annotated[list[Target], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=list["Target"]
    )
    """May be empty when at least one control point has a `move`."""
    control_points: ControlPoints = Field(default_factory=ControlPoints)
    weights: TargetWeights = Field(default_factory=dict)
    """The paper's alpha of eq. (7) per target; all 0 is the source, exactly. Without `weights`
    and `distance` every target has weight 1; beside them, a target left out has 0."""
    distance: TargetDistances = Field(default_factory=dict)
    """The paper's d_im per target, in the source's unit, in place of a weight."""
    frames: Annotated[int, Field(ge=2, le=MAX_FRAMES)] | None = None
    """This many meshes along the way, the source (time 0) and the weights given (time 1) both
    included. Without it: one mesh."""
    keyframes: Annotated[list[Keyframe], Field(min_length=2, max_length=MAX_FRAMES)] | None = None
    """Any path, sampled at `frames` equal steps from the first to the last time."""
    output: Output = Field(default_factory=Output)
    options: Options = Field(default_factory=Options)

    def target_weights(self) -> dict[str, float]:
        """The edit's weight of every target that has no `distance`."""
        silent = 0.0 if self.weights or self.distance else 1.0
        return {
            target.name: self.weights.get(target.name, silent)
            for target in self.targets
            if target.name not in self.distance
        }

    def meshes(self) -> list[tuple[str, str]]:
        """Each mesh that the edit refers to: (JSON pointer, reference), the source first."""
        return [
            ("/source", self.source),
            *((f"/targets/{i}/mesh", target.mesh) for i, target in enumerate(self.targets)),
        ]

    def with_meshes(self, ids: dict[str, str]) -> Self:
        """The same edit with mesh ids in place of the references that ``ids`` knows."""
        targets = [
            target.model_copy(update={"mesh": ids.get(target.mesh, target.mesh)})
            for target in self.targets
        ]
        return self.model_copy(
            update={"source": ids.get(self.source, self.source), "targets": targets}
        )
