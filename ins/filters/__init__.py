"""Navigation filters: the error filter over time bins of gyro bias, the satellite-aided filter, and
their compiled loops.
"""
