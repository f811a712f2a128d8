"""PostgreSQL refuses to change or delete rows of what is append-only, also for the owner of the
tables.

On SQLite there is nothing to do: whoever can open the file can write it, and `recal table verify`
finds it.

Revision ID: 0004
Revises: 0003

Decision: docs/decisions/0022-sqlite-journal.md.
"""

from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

FUNCTION = """
CREATE FUNCTION recal_append_only() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION '% is append-only: % refused', TG_TABLE_NAME, TG_OP
        USING ERRCODE = 'insufficient_privilege';
END $$
"""
# One for each statement, so that an UPDATE that matches no row is refused too.
GUARDS = (
    (
        "CREATE TRIGGER recal_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON recal_revision "
        "EXECUTE FUNCTION recal_append_only()"
    ),
    (
        "CREATE TRIGGER recal_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON"
        " recal_contradiction EXECUTE FUNCTION recal_append_only()"
    ),
    (
        "CREATE TRIGGER recal_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON recal_proposal "
        "EXECUTE FUNCTION recal_append_only()"
    ),
    (
        "CREATE TRIGGER recal_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON recal_decision "
        "EXECUTE FUNCTION recal_append_only()"
    ),
)


def upgrade() -> None:
    if op.get_bind().dialect.name != "postgresql":
        return
    op.execute(FUNCTION)
    for guard in GUARDS:
        op.execute(guard)
