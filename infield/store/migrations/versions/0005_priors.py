"""Priors learnt from a fleet's sessions, and what was decided about them; append-only.

Revision ID: 0005
Revises: 0004
"""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

TABLES = ("recal_priors", "recal_priors_decision")
# the function is that of migration 0004
GUARD = (
    "CREATE TRIGGER recal_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON {table} "
    "EXECUTE FUNCTION recal_append_only()"
)


def upgrade() -> None:
    op.create_table(
        "recal_priors",
        sa.Column("gyro_technology", sa.String(20), primary_key=True),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("learnt_utc", sa.String(40), nullable=False),
        sa.Column("learnt_by", sa.String(200), nullable=False),
        sa.Column("note", sa.Text, nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("priors_json", sa.Text, nullable=False),
        sa.Column("record_sha256", sa.String(64), nullable=False),
    )
    op.create_table(
        "recal_priors_decision",
        sa.Column("gyro_technology", sa.String(20), primary_key=True),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("priors_number", sa.Integer, nullable=False),
        sa.Column("verdict", sa.String(20), nullable=False),
        sa.Column("decided_utc", sa.String(40), nullable=False),
        sa.Column("decided_by", sa.String(200), nullable=False),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("record_sha256", sa.String(64), nullable=False),
        sa.ForeignKeyConstraint(
            ["gyro_technology", "priors_number"],
            ["recal_priors.gyro_technology", "recal_priors.number"],
            name="fk_recal_priors_decision",
        ),
        sa.CheckConstraint("verdict IN ('approved', 'rejected')", name="ck_recal_priors_verdict"),
    )
    if op.get_bind().dialect.name == "postgresql":
        for table in TABLES:
            op.execute(GUARD.format(table=table))
