"""Whether the approver of a proposal must be another person than its proposer; append-only.

Revision ID: 0006
Revises: 0005
"""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

# the function is that of migration 0004
GUARD = (
    "CREATE TRIGGER recal_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON recal_policy "
    "EXECUTE FUNCTION recal_append_only()"
)


def upgrade() -> None:
    op.create_table(
        "recal_policy",
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("approval", sa.String(20), nullable=False),
        sa.Column("set_utc", sa.String(40), nullable=False),
        sa.Column("set_by", sa.String(200), nullable=False),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("record_sha256", sa.String(64), nullable=False),
        sa.CheckConstraint(
            "approval IN ('one_person', 'two_people')", name="ck_recal_policy_approval"
        ),
    )
    if op.get_bind().dialect.name == "postgresql":
        op.execute(GUARD)
