"""Alembic environment: runs on the connection that infield.store.table_store hands over, inside its
transaction.
"""

from alembic import context

from infield.store.schema import metadata

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    render_as_batch=True,
    transactional_ddl=True,
)
with context.begin_transaction():
    context.run_migrations()
