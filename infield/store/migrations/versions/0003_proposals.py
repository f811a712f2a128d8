"""Updates put forward for review, and what was decided about them.

Revision ID: 0003
Revises: 0002
"""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "recal_proposal",
        sa.Column("unit_id", sa.Integer, sa.ForeignKey("recal_unit.id"), primary_key=True),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("proposed_utc", sa.String(40), nullable=False),
        sa.Column("proposed_by", sa.String(200), nullable=False),
        sa.Column("parent_sha256", sa.String(64), nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("report_sha256", sa.String(64), nullable=False),
        sa.Column("runs_json", sa.Text, nullable=False),
        sa.Column("note", sa.Text, nullable=False),
        sa.Column("table_json", sa.Text, nullable=False),
        sa.Column("report_json", sa.Text, nullable=False),
        sa.Column("first_table_json", sa.Text),
        sa.Column("record_sha256", sa.String(64), nullable=False),
    )
    op.create_table(
        "recal_decision",
        sa.Column("unit_id", sa.Integer, primary_key=True),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("proposal_number", sa.Integer, nullable=False),
        sa.Column("verdict", sa.String(20), nullable=False),
        sa.Column("decided_utc", sa.String(40), nullable=False),
        sa.Column("decided_by", sa.String(200), nullable=False),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("revision_number", sa.Integer),
        sa.Column("record_sha256", sa.String(64), nullable=False),
        sa.ForeignKeyConstraint(
            ["unit_id", "proposal_number"],
            ["recal_proposal.unit_id", "recal_proposal.number"],
            name="fk_recal_decision_proposal",
        ),
        sa.UniqueConstraint("unit_id", "proposal_number", name="uq_recal_decision_proposal"),
        sa.CheckConstraint("verdict IN ('approved', 'rejected')", name="ck_recal_decision_verdict"),
    )
