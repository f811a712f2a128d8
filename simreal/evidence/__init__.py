"""Runs as whitened rows: the parked stretch, what follows it, fixes, and the noise that the twin
declares.
"""
