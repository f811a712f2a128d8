"""Columns of foreign logs as the streams of a run: inertial rows, fixes, velocities, temperatures,
wheels.
"""
