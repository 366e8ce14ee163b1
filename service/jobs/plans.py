"""From the edit document to the engine's plan, and back to documents: addresses, keyframes."""

from __future__ import annotations

from dataclasses import replace

from pydantic import TypeAdapter

from engine.controls import (
    Address,
    ControlPoint,
    PolygonAddress,
    PositionAddress,
    VertexAddress,
)
from engine.pipeline import EditPlan, Keyframe, Options
from service import schemas

_ADDRESS: TypeAdapter[schemas.Address] = TypeAdapter(schemas.Address)


def address_of(document: object) -> Address:
    """An address as JSON gives it, as the engine's."""
    return engine_address(_ADDRESS.validate_python(document))


def engine_address(address: schemas.Address) -> Address:
    """A wire address as the engine's; landmarks must have been replaced by their places."""
    match address:
        case schemas.VertexAddress():
            return VertexAddress(address.vertex)
        case schemas.PolygonAddress():
            return PolygonAddress(address.polygon, tuple(address.barycentric))
        case schemas.PositionAddress():
            return PositionAddress(address.position, address.max_snap)
        case schemas.LandmarkAddress():
            raise ValueError(f"landmark {address.landmark!r} was not replaced by its place")


def engine_point(point: schemas.ControlPoint) -> ControlPoint:
    """A wire control point as the engine's."""
    return ControlPoint(
        name=point.name,
        at=engine_address(point.at),
        to={target: engine_address(address) for target, address in point.to.items()},
        weights=dict(point.weights),
        distances=dict(point.distance),
        fixed=point.fixed,
        move=point.move,
    )


def moved_plan(document: schemas.EditDocument, plan: EditPlan) -> EditPlan:
    """The document's ``plan`` with its points where they are to be moved on the targets."""
    points = tuple(
        replace(
            point,
            to={**point.to, **{name: engine_address(at) for name, at in asked.moved_to.items()}},
        )
        for point, asked in zip(plan.points, document.control_points.points, strict=True)
    )
    return replace(plan, points=points)


def engine_plan(document: schemas.EditDocument) -> EditPlan:
    """The whole document as the engine's plan, but for where points are moved on targets."""
    own = document.target_weights()
    return EditPlan(
        points=tuple(engine_point(point) for point in document.control_points.points),
        auto=document.control_points.auto,
        weights=own,
        distances=dict(document.distance),
        frames=document.frames,
        keyframes=tuple(
            Keyframe(key.time, own | dict(key.weights)) for key in document.keyframes or ()
        ),
        histogram_bins=document.output.histogram_bins,
        options=Options(**document.options.model_dump()),
    )
