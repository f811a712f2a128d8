"""Attitude, heading and tilt rate from a log at rest, each with its sigma.

Reading order: `motion`, `coarse`, `gyrocompass`, `tilt_rate`, `result`.
"""
