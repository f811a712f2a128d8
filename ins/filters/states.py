"""The order of an aided solution's errors in its covariance, computed - true. CONVENTIONS.md has
their symbols; the estimator's own state is laid out in `ins.filters.aided_tape`.
"""

AIDED_POS = slice(0, 3)  # position error, north, east, down [m]
AIDED_VEL = slice(3, 6)  # velocity error, north, east, down [m/s]
AIDED_THETA = slice(6, 9)  # attitude error of C_eb, north, east, down [rad]
AIDED_GYRO = slice(9, 12)  # gyro bias beyond what is taken off, body axes [rad/s]
AIDED_ACCEL = slice(12, 15)  # the same of the accelerometers, body axes [m/s^2]
AIDED_MOTION = 15  # number of these errors
