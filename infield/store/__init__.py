"""The table store: append-only revisions, proposals, contradictions, verification, on SQLite or
PostgreSQL.
"""
