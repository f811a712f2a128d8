"""Tables of the store (SQLAlchemy Core); `migrations` beside it creates them, a test compares both.

Names begin with `recal_` because a fleet's PostgreSQL database may hold other people's tables.
"""

from sqlalchemy import (
    CheckConstraint,
    Column,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
)

SCHEMA_REVISION = "0006"  # the newest migration
# older stores that a reading command opens as they are
READABLE = ("0001", "0002", "0003", "0004", "0005", SCHEMA_REVISION)
# by triggers on PostgreSQL, 0004 to 0006
GUARDED = (
    "recal_contradiction",
    "recal_decision",
    "recal_policy",
    "recal_priors",
    "recal_priors_decision",
    "recal_proposal",
    "recal_revision",
)
metadata = MetaData()

# One gyro triad: the key that a table belongs to, and the twin record that its noise model comes
# from.
unit = Table(
    "recal_unit",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("imu_serial", String(200), nullable=False),
    Column("gyro_technology", String(20), nullable=False),
    Column("gyro_mode", String(200), nullable=False),
    Column("twin_json", Text),
    Column("twin_sha256", String(64)),
    Column("twin_table_sha256", String(64)),  # the table that was imported with the twin
    UniqueConstraint("imu_serial", "gyro_technology", "gyro_mode", name="uq_recal_unit_key"),
)

# Append-only. record_sha256 covers the row and the record before it, so a changed row breaks the
# chain.
revision = Table(
    "recal_revision",
    metadata,
    Column("unit_id", Integer, ForeignKey("recal_unit.id"), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("kind", String(20), nullable=False),
    Column("created_utc", String(40), nullable=False),
    Column("parent_sha256", String(64)),
    Column("sha256", String(64), nullable=False),
    Column("table_json", Text, nullable=False),  # canonical text, what sha256 is over
    # runs that this revision merged: [[run_id, sha256], ...]
    Column("runs_json", Text, nullable=False),
    Column("restored_number", Integer),  # rollback: whose table this is
    Column("report_json", Text),
    Column("note", Text, nullable=False),
    Column("record_sha256", String(64), nullable=False),
    CheckConstraint(
        "kind IN ('factory', 'import', 'update', 'rollback')", name="ck_recal_revision_kind"
    ),
    Index("ix_recal_revision_sha256", "sha256"),
)

tag = Table(
    "recal_tag",
    metadata,
    Column("unit_id", Integer, primary_key=True),
    Column("name", String(20), primary_key=True),  # factory, active
    Column("number", Integer, nullable=False),
    ForeignKeyConstraint(
        ["unit_id", "number"],
        ["recal_revision.unit_id", "recal_revision.number"],
        name="fk_recal_tag_revision",
    ),
)

# Runs that the active table holds: none can be merged twice; a rollback takes its own out again.
merged_run = Table(
    "recal_merged_run",
    metadata,
    Column("unit_id", Integer, ForeignKey("recal_unit.id"), primary_key=True),
    Column("run_sha256", String(64), primary_key=True),
)

# Append-only: sessions that contradicted the table and changed nothing, so that the next ones can
# be compared with them.
contradiction = Table(
    "recal_contradiction",
    metadata,
    Column("unit_id", Integer, ForeignKey("recal_unit.id"), primary_key=True),
    Column("run_sha256", String(64), primary_key=True),
    Column("recorded_utc", String(40), nullable=False),
    Column("table_sha256", String(64), nullable=False),  # the active table that it contradicted
    Column("evidence_json", Text, nullable=False),
    Column("record_sha256", String(64), nullable=False),  # over the unit and the row
)

# Append-only: updates put forward for review. The hashes of the texts are in record_sha256, the
# texts are not, so that a list of proposals need not read them; record_sha256 covers the row and
# the unit's record before it.
proposal = Table(
    "recal_proposal",
    metadata,
    Column("unit_id", Integer, ForeignKey("recal_unit.id"), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("proposed_utc", String(40), nullable=False),
    Column("proposed_by", String(200), nullable=False),
    Column("parent_sha256", String(64), nullable=False),  # the table that it was made from
    Column("sha256", String(64), nullable=False),
    Column("report_sha256", String(64), nullable=False),
    Column("runs_json", Text, nullable=False),  # as in recal_revision
    Column("note", Text, nullable=False),
    Column("table_json", Text, nullable=False),
    Column("report_json", Text, nullable=False),
    # where the unit was unknown: the table it was made from, parent_sha256 being its hash
    Column("first_table_json", Text),
    Column("record_sha256", String(64), nullable=False),
)

# Append-only: what a person decided about a proposal, once. record_sha256 covers the row, the
# proposal's record and the unit's decision before it.
decision = Table(
    "recal_decision",
    metadata,
    Column("unit_id", Integer, primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("proposal_number", Integer, nullable=False),
    Column("verdict", String(20), nullable=False),
    Column("decided_utc", String(40), nullable=False),
    Column("decided_by", String(200), nullable=False),
    Column("reason", Text, nullable=False),
    Column("revision_number", Integer),  # approved: the revision that it became
    Column("record_sha256", String(64), nullable=False),
    ForeignKeyConstraint(
        ["unit_id", "proposal_number"],
        ["recal_proposal.unit_id", "recal_proposal.number"],
        name="fk_recal_decision_proposal",
    ),
    UniqueConstraint("unit_id", "proposal_number", name="uq_recal_decision_proposal"),
    CheckConstraint("verdict IN ('approved', 'rejected')", name="ck_recal_decision_verdict"),
)

# Append-only: what the sessions of a technology were found to say of its units. record_sha256
# covers the row (its text by sha256) and the technology's record before it.
priors = Table(
    "recal_priors",
    metadata,
    Column("gyro_technology", String(20), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("learnt_utc", String(40), nullable=False),
    Column("learnt_by", String(200), nullable=False),
    Column("note", Text, nullable=False),
    Column("sha256", String(64), nullable=False),
    Column("priors_json", Text, nullable=False),
    Column("record_sha256", String(64), nullable=False),
)

# Append-only: the last approval of a technology names the priors that are in use; priors that were
# in use before may be approved again.
priors_decision = Table(
    "recal_priors_decision",
    metadata,
    Column("gyro_technology", String(20), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("priors_number", Integer, nullable=False),
    Column("verdict", String(20), nullable=False),
    Column("decided_utc", String(40), nullable=False),
    Column("decided_by", String(200), nullable=False),
    Column("reason", Text, nullable=False),
    Column("record_sha256", String(64), nullable=False),
    ForeignKeyConstraint(
        ["gyro_technology", "priors_number"],
        ["recal_priors.gyro_technology", "recal_priors.number"],
        name="fk_recal_priors_decision",
    ),
    CheckConstraint("verdict IN ('approved', 'rejected')", name="ck_recal_priors_verdict"),
)

# Append-only: who may approve in this store, the last row in force. record_sha256 covers the row
# and the record before it.
policy = Table(
    "recal_policy",
    metadata,
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("approval", String(20), nullable=False),
    Column("set_utc", String(40), nullable=False),
    Column("set_by", String(200), nullable=False),
    Column("reason", Text, nullable=False),
    Column("record_sha256", String(64), nullable=False),
    CheckConstraint("approval IN ('one_person', 'two_people')", name="ck_recal_policy_approval"),
)
