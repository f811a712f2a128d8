"""Readers of flight logs: each turns one format into a run."""
