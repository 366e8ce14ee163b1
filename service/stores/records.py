"""Meshes, edits, results and events in Postgres; an edit and its job in one transaction.

Every method is synchronous and safe to call from any thread. A lost connection is retried for
``patience`` seconds and then raises ``Unavailable``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from service.domain import (
    EditRecord,
    EditStatus,
    EventRecord,
    Json,
    MeshRecord,
    Page,
    ResultRecord,
)


class Records:
    """The database, as intentions."""

    def __init__(
        self,
        url: str,
        *,
        queue_limit: int = 1000,
        result_ttl: float = 604800.0,
        max_attempts: int = 3,
        patience: float = 15.0,
    ) -> None:
        raise NotImplementedError

    def close(self) -> None:
        """Give back all connections."""

    def ping(self) -> None:
        """Raise Unavailable unless the database answers now."""

    # meshes
    def create_mesh(
        self, *, name: str, format: str, bytes: int, sha256: str, blob_key: str, info: Json
    ) -> tuple[MeshRecord, bool]:
        """The mesh with these bytes and whether it is new; if not, delete your blob again."""
        raise NotImplementedError

    def find_mesh_by_sha(self, sha256: str) -> MeshRecord | None: ...
    def get_mesh(self, mesh_id: str) -> MeshRecord: ...
    def list_meshes(self, limit: int = 50, cursor: str | None = None) -> Page[MeshRecord]: ...
    def delete_mesh(self, mesh_id: str) -> MeshRecord:
        """Forget a mesh (the caller deletes its blob); Conflict while an unfinished edit uses it."""
        raise NotImplementedError

    # edits
    def create_edit(
        self,
        *,
        document: Json,
        meshes: Sequence[str],
        fingerprint: str,
        idempotency_key: str | None = None,
        tenant: str = "",
        summary: Json | None = None,
    ) -> tuple[EditRecord, bool]:
        """Accept and enqueue an edit, or return the first one with this idempotency key.

        NotFound for an unknown mesh, IdempotencyMismatch, QueueFull.
        """
        raise NotImplementedError

    def get_edit(self, edit_id: str) -> EditRecord: ...
    def list_edits(
        self, limit: int = 50, cursor: str | None = None, status: EditStatus | None = None
    ) -> Page[EditRecord]: ...
    def request_cancel(self, edit_id: str) -> EditRecord:
        """Idempotent: queued edits are canceled at once, running ones within a second."""
        raise NotImplementedError

    def delete_edit(self, edit_id: str) -> list[str]:
        """Forget a finished edit; returns the blob keys to delete. Conflict while unfinished."""
        raise NotImplementedError

    # results and events
    def list_results(self, edit_id: str) -> list[ResultRecord]:
        """Conflict (code ``not_ready``) until succeeded, Gone when expired."""
        raise NotImplementedError

    def get_result(self, edit_id: str, name: str) -> ResultRecord: ...
    def events_after(self, edit_id: str, seq: int = 0) -> list[EventRecord]: ...
    def wait_for_change(self, edit_id: str, seq: int, seconds: float) -> EditRecord:
        """The edit as soon as ``last_seq > seq`` or it is finished, else as it is in the end."""
        raise NotImplementedError

    def queue_counts(self) -> dict[str, int]:
        """How many edits there are in each status (for metrics)."""
        raise NotImplementedError

    # workers
    def claim_attempt(self, edit_id: str, job_id: int) -> EditRecord | None: ...
    def record_progress(self, edit_id: str, attempt: int, events: Sequence[Json]) -> bool: ...
    def publish(
        self, edit_id: str, attempt: int, results: Sequence[ResultRecord], summary: Json
    ) -> bool: ...
    def fail(self, edit_id: str, attempt: int, error: Json) -> bool: ...
    def finish_cancel(self, edit_id: str, attempt: int) -> bool: ...
    def release(self, edit_id: str, attempt: int) -> bool: ...
    def requeue_lost(self, stalled_seconds: float) -> dict[str, Any]: ...
