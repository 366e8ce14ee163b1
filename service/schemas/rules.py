"""What an edit document must satisfy beyond its form, as far as no mesh is needed to say so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain, islice

from service.schemas.addresses import Address, PolygonAddress
from service.schemas.edits import ControlPoint, EditDocument
from service.schemas.problems import ProblemError

MAX_ERRORS = 100
BARYCENTRIC_TOLERANCE = 1e-6


def broken_rules(edit: EditDocument) -> list[ProblemError]:
    """The rules that the edit breaks (the first 100), with a pointer to the place."""
    found = chain(
        _names(edit), _targets(edit), _path(edit), _output(edit), _options(edit), _points(edit)
    )
    return list(islice(found, MAX_ERRORS))


def _names(edit: EditDocument) -> Iterator[ProblemError]:
    named = {
        "/targets": [target.name for target in edit.targets],
        "/control_points/points": [point.name for point in edit.control_points.points],
    }
    for pointer, names in named.items():
        first: dict[str, int] = {}
        for index, name in enumerate(names):
            if first.setdefault(name, index) != index:
                yield ProblemError(
                    pointer=f"{pointer}/{index}/name",
                    code="duplicate_name",
                    message=f"{name!r} is already the name of {pointer}/{first[name]}",
                    elements={"name": name, "first": first[name]},
                )


def _targets(edit: EditDocument) -> Iterator[ProblemError]:
    moved = any(point.move is not None for point in edit.control_points.points)
    if not edit.targets and not moved:
        yield ProblemError(
            pointer="/targets",
            code="nothing_to_do",
            message="The edit has neither a target nor a control point with a `move`; give one",
        )
    yield from _known("/weights", edit.weights, edit)
    yield from _known("/distance", edit.distance, edit)
    yield from _either("", edit.weights, edit.distance)


def _path(edit: EditDocument) -> Iterator[ProblemError]:
    keyframes = edit.keyframes or []
    if keyframes and edit.frames is None:
        yield ProblemError(
            pointer="/keyframes",
            code="frames_missing",
            message="`keyframes` needs `frames`: how many meshes to make along the path",
        )
    for index, keyframe in enumerate(keyframes):
        pointer = f"/keyframes/{index}"
        yield from _known(f"{pointer}/weights", keyframe.weights, edit)
        for name in keyframe.weights.keys() & edit.distance.keys():
            yield _weight_and_distance(f"{pointer}/weights", name)
        if index and keyframe.time <= keyframes[index - 1].time:
            yield ProblemError(
                pointer=f"{pointer}/time",
                code="times_not_increasing",
                message=f"time {keyframe.time:g} is not after {keyframes[index - 1].time:g}",
            )


def _output(edit: EditDocument) -> Iterator[ProblemError]:
    formats = edit.output.formats
    for index, format_ in enumerate(formats):
        if format_ in formats[:index]:
            yield ProblemError(
                pointer=f"/output/formats/{index}",
                code="duplicate_format",
                message=f"{format_!r} is there already",
            )


def _options(edit: EditDocument) -> Iterator[ProblemError]:
    iteration = edit.options.iteration
    if iteration not in {"paper", "paper_teichmueller"}:
        return
    for field, excluded in (("holes", "kept"), ("outer_boundary", "sliding")):
        if getattr(edit.options, field) == excluded:
            yield ProblemError(
                pointer=f"/options/{field}",
                code=f"iteration_excludes_{field}",
                message=f"iteration {iteration!r} cannot be had with {field} {excluded!r}: "
                "change one of them",
                elements={"iteration": iteration},
            )


def _points(edit: EditDocument) -> Iterator[ProblemError]:
    for index, point in enumerate(edit.control_points.points):
        pointer = f"/control_points/points/{index}"
        yield from _exclusive(pointer, point)
        yield from _either(pointer, point.weights, point.distance)
        yield from _barycentric(f"{pointer}/at", point.at)
        for field in ("to", "moved_to", "weights", "distance"):
            yield from _known(f"{pointer}/{field}", getattr(point, field), edit)
        for field, places in (("to", point.to), ("moved_to", point.moved_to)):
            for name, address in places.items():
                yield from _barycentric(f"{pointer}/{field}/{escaped(name)}", address)
        yield from _moved(f"{pointer}/moved_to", point, edit)


def _moved(pointer: str, point: ControlPoint, edit: EditDocument) -> Iterator[ProblemError]:
    for name in point.moved_to:
        if name not in point.to:
            yield ProblemError(
                pointer=f"{pointer}/{escaped(name)}",
                code="moved_to_without_to",
                message=f"the point has no `to` on {name!r} that it could be moved from",
                elements={"point": point.name, "target": name},
            )
    if point.moved_to and edit.options.restoration == "paper":
        yield ProblemError(
            pointer=pointer,
            code="restoration_excludes_moved_to",
            message="restoration 'paper' cannot be had with `moved_to`: change `to` itself",
            elements={"point": point.name},
        )


def _exclusive(pointer: str, point: ControlPoint) -> Iterator[ProblemError]:
    ruling = "fixed" if point.fixed else "move" if point.move is not None else None
    if ruling is None:
        return
    others = {
        "move": point.fixed and point.move is not None,
        "to": bool(point.to),
        "weights": bool(point.weights),
        "distance": bool(point.distance),
    }
    for field in (field for field, given in others.items() if given):
        yield ProblemError(
            pointer=f"{pointer}/{field}",
            code=f"{ruling}_excludes_{field}",
            message=f"a point with `{ruling}` has no `{field}`: leave one of them out",
            elements={"point": point.name},
        )


def _barycentric(pointer: str, address: Address) -> Iterator[ProblemError]:
    if not isinstance(address, PolygonAddress):
        return
    total = sum(address.barycentric)
    if abs(total - 1) > BARYCENTRIC_TOLERANCE:
        yield ProblemError(
            pointer=f"{pointer}/barycentric",
            code="barycentric_sum",
            message=f"barycentric weights must sum to 1, not {total:.9g}",
            elements={"sum": total},
        )


def _known(
    pointer: str, by_target: Mapping[str, object], edit: EditDocument
) -> Iterator[ProblemError]:
    known = [target.name for target in edit.targets]
    for name in by_target:
        if name not in known:
            yield ProblemError(
                pointer=f"{pointer}/{escaped(name)}",
                code="unknown_target",
                message=f"no target is named {name!r}; there is {known or 'none'}",
                elements={"name": name, "targets": known},
            )


def _either(
    pointer: str, weights: Mapping[str, float], distance: Mapping[str, float]
) -> Iterator[ProblemError]:
    for name in distance:
        if name in weights:
            yield _weight_and_distance(f"{pointer}/distance", name)


def _weight_and_distance(pointer: str, name: str) -> ProblemError:
    return ProblemError(
        pointer=f"{pointer}/{escaped(name)}",
        code="weight_and_distance",
        message=f"target {name!r} has a weight and a distance: leave one of them out",
        elements={"name": name},
    )


def escaped(token: str) -> str:
    """One reference token of a JSON pointer (RFC 6901)."""
    return token.replace("~", "~0").replace("/", "~1")
