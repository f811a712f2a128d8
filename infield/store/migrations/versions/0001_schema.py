"""Units, their append-only revisions, tags, and the runs that the active table holds.

Revision ID: 0001
Revises:
"""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "recal_unit",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("imu_serial", sa.String(200), nullable=False),
        sa.Column("gyro_technology", sa.String(20), nullable=False),
        sa.Column("gyro_mode", sa.String(200), nullable=False),
        sa.Column("twin_json", sa.Text),
        sa.Column("twin_sha256", sa.String(64)),
        sa.Column("twin_table_sha256", sa.String(64)),
        sa.UniqueConstraint("imu_serial", "gyro_technology", "gyro_mode", name="uq_recal_unit_key"),
    )
    op.create_table(
        "recal_revision",
        sa.Column("unit_id", sa.Integer, sa.ForeignKey("recal_unit.id"), primary_key=True),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("kind", sa.String(20), nullable=False),
        sa.Column("created_utc", sa.String(40), nullable=False),
        sa.Column("parent_sha256", sa.String(64)),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("table_json", sa.Text, nullable=False),
        sa.Column("runs_json", sa.Text, nullable=False),
        sa.Column("restored_number", sa.Integer),
        sa.Column("report_json", sa.Text),
        sa.Column("note", sa.Text, nullable=False),
        sa.Column("record_sha256", sa.String(64), nullable=False),
        sa.CheckConstraint(
            "kind IN ('factory', 'import', 'update', 'rollback')", name="ck_recal_revision_kind"
        ),
    )
    op.create_index("ix_recal_revision_sha256", "recal_revision", ["sha256"])
    op.create_table(
        "recal_tag",
        sa.Column("unit_id", sa.Integer, primary_key=True),
        sa.Column("name", sa.String(20), primary_key=True),
        sa.Column("number", sa.Integer, nullable=False),
        sa.ForeignKeyConstraint(
            ["unit_id", "number"],
            ["recal_revision.unit_id", "recal_revision.number"],
            name="fk_recal_tag_revision",
        ),
    )
    op.create_table(
        "recal_merged_run",
        sa.Column("unit_id", sa.Integer, sa.ForeignKey("recal_unit.id"), primary_key=True),
        sa.Column("run_sha256", sa.String(64), primary_key=True),
    )
