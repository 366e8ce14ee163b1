"""Uploaded meshes: one record per distinct file."""

from __future__ import annotations

import secrets
from collections.abc import Collection
from typing import Any

from sqlalchemy import Connection, Row, cast, delete, exists, select, update
from sqlalchemy.dialects.postgresql import JSONB, insert

from service.domain import Conflict, Json, MeshRecord, NotFound, Page
from service.stores import tables
from service.stores._pages import fetch_page
from service.stores.database import Database, row_values

_MESHES = tables.meshes


class MeshStore:
    """What is known of uploaded meshes."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create_mesh(
        self, *, name: str, format: str, bytes: int, sha256: str, blob_key: str, info: Json
    ) -> tuple[MeshRecord, bool]:
        """The mesh with these bytes, and whether it is new.

        If it is not, the record names the blob of the first upload: delete your own again.
        """
        values = {
            "id": f"msh_{secrets.token_hex(10)}",
            **{"name": name, "format": format, "bytes": bytes, "sha256": sha256},
            **{"blob_key": blob_key, "info": info},
        }

        def work(connection: Connection) -> tuple[MeshRecord, bool]:
            connection.execute(insert(_MESHES).values(values).on_conflict_do_nothing())
            row = connection.execute(select(_MESHES).where(_MESHES.c.sha256 == sha256)).one()
            return _mesh(row), row.id == values["id"]

        return self._database.run(work)

    def find_mesh_by_sha(self, sha256: str) -> MeshRecord | None:
        """The mesh with these bytes, if it was uploaded before."""
        query = select(_MESHES).where(_MESHES.c.sha256 == sha256)
        row = self._database.run(lambda connection: connection.execute(query).one_or_none())
        return None if row is None else _mesh(row)

    def get_mesh(self, mesh_id: str) -> MeshRecord:
        """One mesh, or NotFound."""
        query = select(_MESHES).where(_MESHES.c.id == mesh_id)
        row = self._database.run(lambda connection: connection.execute(query).one_or_none())
        if row is None:
            raise NotFound(f"there is no mesh {mesh_id}")
        return _mesh(row)

    def find_meshes(self, mesh_ids: Collection[str]) -> dict[str, MeshRecord]:
        """Those of the meshes that there are, by id."""
        query = select(_MESHES).where(_MESHES.c.id.in_(mesh_ids))
        rows = self._database.run(lambda connection: connection.execute(query).all())
        return {row.id: _mesh(row) for row in rows}

    def list_meshes(self, limit: int = 50, cursor: str | None = None) -> Page[MeshRecord]:
        """Meshes, newest first; InvalidCursor for a cursor that is none."""
        return self._database.run(
            lambda connection: fetch_page(
                connection, select(_MESHES), _MESHES, limit=limit, cursor=cursor, read=_mesh
            )
        )

    def set_landmarks(self, mesh_id: str, landmarks: Json) -> MeshRecord:
        """Keep ``landmarks`` (places by name) with a mesh, in place of any it has; or NotFound."""
        info = _MESHES.c.info.op("||")(cast({"landmarks": landmarks}, JSONB))
        change = update(_MESHES).where(_MESHES.c.id == mesh_id).values(info=info)

        def work(connection: Connection) -> MeshRecord:
            row = connection.execute(change.returning(_MESHES)).one_or_none()
            if row is None:
                raise NotFound(f"there is no mesh {mesh_id}")
            return _mesh(row)

        return self._database.run(work)

    def delete_mesh(self, mesh_id: str) -> MeshRecord:
        """Forget a mesh; the caller deletes its blob. Conflict while an unfinished edit uses it."""
        use = tables.edit_meshes
        unfinished = exists().where(
            use.c.mesh_id == mesh_id,
            use.c.edit_id == tables.edits.c.id,
            tables.edits.c.status.in_(("queued", "running")),
        )

        def work(connection: Connection) -> MeshRecord:
            row = connection.execute(
                select(_MESHES).where(_MESHES.c.id == mesh_id).with_for_update()
            ).one_or_none()
            if row is None:
                raise NotFound(f"there is no mesh {mesh_id}")
            if connection.execute(select(unfinished)).scalar_one():
                raise Conflict(f"an unfinished edit uses {mesh_id}", "mesh_in_use")
            connection.execute(delete(_MESHES).where(_MESHES.c.id == mesh_id))
            return _mesh(row)

        return self._database.run(work)


def _mesh(row: Row[Any]) -> MeshRecord:
    return MeshRecord(**row_values(row))
