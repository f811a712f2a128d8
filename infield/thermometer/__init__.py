"""Gyro temperatures of a run: smoothed with their covariance, and what is wrong with the
thermometers.
"""
