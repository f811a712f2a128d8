"""When the vehicle stands, rolls, shakes or flies, told by the inertial rows, satellites, wheels
and declared phases.
"""
