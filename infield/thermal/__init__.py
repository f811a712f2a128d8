"""Thermal models before the table: fibre-optic ramps, ring-laser gradients, and a stored model
taken out of a log.
"""
