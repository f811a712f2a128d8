"""Sessions that contradicted the table, remembered for the ones that follow.

Revision ID: 0002
Revises: 0001
"""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "recal_contradiction",
        sa.Column("unit_id", sa.Integer, sa.ForeignKey("recal_unit.id"), primary_key=True),
        sa.Column("run_sha256", sa.String(64), primary_key=True),
        sa.Column("recorded_utc", sa.String(40), nullable=False),
        sa.Column("table_sha256", sa.String(64), nullable=False),
        sa.Column("evidence_json", sa.Text, nullable=False),
        sa.Column("record_sha256", sa.String(64), nullable=False),
    )
