"""Alembic's entry: runs the revisions on the connection that ``migrate`` holds."""

from alembic import context

from service.stores.tables import metadata

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    version_table="schema_version",
)
context.run_migrations()
