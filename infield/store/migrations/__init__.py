"""Alembic migrations of the table store, shipped with the package; run by infield.store.table_store
on opening for writing.
"""
