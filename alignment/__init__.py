"""Attitude, heading and tilt rate from a log at rest, each with its sigma.

Reading order: stillness, coarse, gyrocompass, tilt_rate, result.
"""
