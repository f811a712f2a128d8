"""A store of an older schema, or none, brought to the newest one: what each schema added.

Every schema so far added tables, and those of append-only rows get a trigger on PostgreSQL; a
schema that changes a table needs a step of its own in `upgrade`.

Decision: docs/decisions/0045-append-only-triggers.md.
"""

from sqlalchemy import Connection, delete, insert, text

from infield.store.schema import GUARDED, SCHEMA_REVISION, TABLES_SINCE, version

GUARDED_SINCE = "0004"
FUNCTION = """
CREATE FUNCTION recal_append_only() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION '% is append-only: % refused', TG_TABLE_NAME, TG_OP
        USING ERRCODE = 'insufficient_privilege';
END $$
"""
# One for each statement, so that an UPDATE that matches no row is refused too.
GUARD = (
    "CREATE TRIGGER recal_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON {table}"
    " EXECUTE FUNCTION recal_append_only()"
)


def upgrade(c: Connection, found: str | None) -> None:
    """Add what a store of the schema `found` lacks (None: everything), in the caller's transaction.

    PostgreSQL then refuses to change or delete rows of what is append-only, also for the owner of
    the tables. On SQLite whoever can open the file can write it, and `recal table verify` finds it.
    """
    before = found or ""
    new = [table for since, tables in TABLES_SINCE.items() if since > before for table in tables]
    for table in new:
        table.create(c, checkfirst=False)
    if c.dialect.name == "postgresql":
        unguarded = {table.name for table in new}
        if before < GUARDED_SINCE:
            c.execute(text(FUNCTION))
            unguarded = set(GUARDED)
        for name in sorted(unguarded & set(GUARDED)):
            c.execute(text(GUARD.format(table=name)))
    version.create(c, checkfirst=True)
    c.execute(delete(version))
    c.execute(insert(version).values(version_num=SCHEMA_REVISION))
