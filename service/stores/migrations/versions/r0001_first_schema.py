"""Meshes, edits, their results and events, and the queue's tables."""

from __future__ import annotations

from alembic import op
from procrastinate.schema import SchemaManager

revision = "0001"
down_revision = None

_TABLES = """
CREATE TABLE meshes (
    id text PRIMARY KEY,
    name text NOT NULL,
    format text NOT NULL,
    bytes bigint NOT NULL,
    sha256 text NOT NULL UNIQUE,
    blob_key text NOT NULL,
    info jsonb NOT NULL DEFAULT '{}',
    created_at timestamptz NOT NULL DEFAULT clock_timestamp()
);
CREATE INDEX meshes_newest ON meshes (created_at, id);

CREATE TABLE edits (
    id text PRIMARY KEY,
    tenant text NOT NULL,
    status text NOT NULL
        CHECK (status IN ('queued', 'running', 'succeeded', 'failed', 'canceled')),
    document jsonb NOT NULL,
    fingerprint text NOT NULL,
    idempotency_key text,
    stages jsonb NOT NULL DEFAULT '[]',
    error jsonb,
    summary jsonb NOT NULL DEFAULT '{}',
    job_id bigint NOT NULL,
    attempt integer NOT NULL DEFAULT 0,
    losses integer NOT NULL DEFAULT 0,
    last_seq integer NOT NULL DEFAULT 0,
    cancel_requested boolean NOT NULL DEFAULT false,
    results_expired boolean NOT NULL DEFAULT false,
    created_at timestamptz NOT NULL DEFAULT clock_timestamp(),
    queued_at timestamptz NOT NULL DEFAULT clock_timestamp(),
    seen_at timestamptz,
    started_at timestamptz,
    finished_at timestamptz,
    expires_at timestamptz
);
CREATE INDEX edits_newest ON edits (created_at, id);
CREATE INDEX edits_by_status ON edits (status, created_at, id);
CREATE INDEX edits_unfinished ON edits (status, attempt, job_id)
    WHERE status IN ('queued', 'running');
CREATE INDEX edits_expiring ON edits (expires_at)
    WHERE expires_at IS NOT NULL AND NOT results_expired;
CREATE UNIQUE INDEX edits_idempotency ON edits (tenant, idempotency_key)
    WHERE idempotency_key IS NOT NULL;

CREATE TABLE edit_meshes (
    edit_id text NOT NULL REFERENCES edits ON DELETE CASCADE,
    mesh_id text NOT NULL REFERENCES meshes ON DELETE CASCADE,
    PRIMARY KEY (edit_id, mesh_id)
);
CREATE INDEX edit_meshes_by_mesh ON edit_meshes (mesh_id);

CREATE TABLE results (
    edit_id text NOT NULL REFERENCES edits ON DELETE CASCADE,
    name text NOT NULL,
    position integer NOT NULL,
    role text NOT NULL,
    meta jsonb NOT NULL DEFAULT '{}',
    media_type text NOT NULL,
    bytes bigint NOT NULL,
    sha256 text NOT NULL,
    blob_key text NOT NULL,
    PRIMARY KEY (edit_id, name)
);

CREATE TABLE events (
    edit_id text NOT NULL REFERENCES edits ON DELETE CASCADE,
    seq integer NOT NULL,
    type text NOT NULL,
    data jsonb NOT NULL,
    at timestamptz NOT NULL DEFAULT clock_timestamp(),
    PRIMARY KEY (edit_id, seq)
);
"""


def upgrade() -> None:
    """Create everything; the queue's part as its installed version ships it."""
    connection = op.get_bind()
    for script in (SchemaManager.get_schema(), _TABLES):
        connection.exec_driver_sql(script.replace("%", "%%"))
