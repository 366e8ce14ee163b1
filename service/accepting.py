"""From an edit document to an accepted edit: references resolved, every fault named."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter

from service.dependencies import is_id
from service.domain import EditRecord, MeshRecord
from service.schemas import (
    Address,
    EditDocument,
    InvalidDocumentError,
    LandmarkAddress,
    Place,
    Places,
    PolygonAddress,
    ProblemError,
    VertexAddress,
    broken_rules,
)
from service.schemas.rules import escaped
from service.stores.records import Records

_COUNTS = {"vertex": "vertices", "polygon": "polygons"}
_PLACES: TypeAdapter[Places] = TypeAdapter(Places)


class Faults(list[ProblemError]):
    """The faults found so far."""

    def add(self, pointer: str, code: str, message: str, **elements: Any) -> None:
        """One more."""
        self.append(ProblemError(pointer=pointer, code=code, message=message, elements=elements))

    def refuse(self) -> None:
        """Raise InvalidDocumentError if there are any."""
        if self:
            raise InvalidDocumentError(self)


def landmarks_of(mesh: MeshRecord) -> Places:
    """The landmarks that a mesh was given."""
    return _PLACES.validate_python(mesh.info.get("landmarks", {}))


def load_meshes(records: Records, edit: EditDocument, faults: Faults) -> dict[str, MeshRecord]:
    """The meshes that the edit refers to, by id; unknown ones are faults."""
    references = edit.meshes()
    found = records.find_meshes({name for _, name in references if is_id(name)})
    for pointer, reference in references:
        if reference not in found:
            faults.add(
                pointer,
                "unknown_mesh",
                f"there is no mesh {reference!r}: upload it, or send it in the same request as "
                "multipart/form-data",
                mesh=reference,
            )
    return found


def place(address: Address, mesh: MeshRecord, pointer: str, faults: Faults) -> Address:
    """The address with a landmark replaced by its place; indices beyond the mesh are faults."""
    match address:
        case LandmarkAddress(landmark=name):
            known: Mapping[str, Place] = landmarks_of(mesh)
            if name not in known:
                faults.add(
                    f"{pointer}/landmark",
                    "unknown_landmark",
                    f"mesh {mesh.id} has no landmark {name!r}; "
                    f"give it one with PUT /v1/meshes/{mesh.id}/landmarks",
                    landmark=name,
                    known=sorted(known)[:100],
                )
                return address
            return known[name]
        case VertexAddress(vertex=index):
            _in_range("vertex", index, mesh, pointer, faults)
        case PolygonAddress(polygon=index):
            _in_range("polygon", index, mesh, pointer, faults)
        case _:
            pass
    return address


def _in_range(kind: str, index: int, mesh: MeshRecord, pointer: str, faults: Faults) -> None:
    plural = _COUNTS[kind]
    count = int(mesh.info[plural])
    if index >= count:
        faults.add(
            f"{pointer}/{kind}",
            f"{kind}_out_of_range",
            f"{kind} {index} does not exist: mesh {mesh.id} has {count} {plural}, from 0",
            index=index,
            count=count,
        )


def resolve(edit: EditDocument, meshes: Mapping[str, MeshRecord], faults: Faults) -> EditDocument:
    """The edit with every landmark replaced by its place on its mesh."""
    by_target = {target.name: meshes.get(target.mesh) for target in edit.targets}
    source = meshes.get(edit.source)
    points = list(edit.control_points.points)
    for index, point in enumerate(points):
        pointer = f"/control_points/points/{index}"
        at = point.at if source is None else place(point.at, source, f"{pointer}/at", faults)
        placed: dict[str, object] = {"at": at}
        for field, places in (("to", point.to), ("moved_to", point.moved_to)):
            placed[field] = {
                name: address
                if (mesh := by_target.get(name)) is None
                else place(address, mesh, f"{pointer}/{field}/{escaped(name)}", faults)
                for name, address in places.items()
            }
        points[index] = point.model_copy(update=placed)
    control_points = edit.control_points.model_copy(update={"points": points})
    return edit.model_copy(update={"control_points": control_points})


def check(records: Records, edit: EditDocument) -> tuple[EditDocument, list[MeshRecord]]:
    """The edit as it would run, and its meshes; InvalidDocumentError with all that is wrong."""
    faults = Faults(broken_rules(edit))
    meshes = load_meshes(records, edit, faults)
    resolved = resolve(edit, meshes, faults)
    faults.refuse()
    return resolved, list(meshes.values())


def accept(
    records: Records, edit: EditDocument, idempotency_key: str | None
) -> tuple[EditRecord, bool]:
    """The accepted edit, and whether it is new (not the answer to a repeated request)."""
    resolved, meshes = check(records, edit)
    return records.create_edit(
        document=resolved.model_dump(mode="json"),
        meshes=[mesh.id for mesh in meshes],
        fingerprint=fingerprint(edit),
        idempotency_key=idempotency_key,
    )


def fingerprint(edit: EditDocument) -> str:
    """Equal for documents that ask for the same, however they were written down."""
    canonical = json.dumps(edit.model_dump(mode="json"), sort_keys=True)
    return hashlib.sha256(canonical.encode()).hexdigest()
