"""The layout of the aided filter's state vector, stated once for Python and for its kernels.

A slice is of three components (north, east, down or body x, y, z) or, where it has two, of the
level pair. A number is one state. Symbols: CONVENTIONS.md; equations:
`ins.filters.aided_kernel`.
"""

AIDED_POS = slice(0, 3)  # position error, north, east, down [m]
AIDED_VEL = slice(3, 6)  # velocity error, north, east, down [m/s]
AIDED_THETA = slice(6, 9)  # attitude error of C_eb, north, east, down [rad]
AIDED_GYRO = slice(9, 12)  # gyro bias beyond what is taken off, body axes [rad/s]
AIDED_ACCEL = slice(12, 15)  # the same of the accelerometers, body axes [m/s^2]
AIDED_MOTION = 15  # number of the states above, which are put out with each row
AIDED_GYRO_SCALE = slice(15, 18)  # scale errors of the gyros, read high [-]
AIDED_MISALIGNED = slice(18, 24)  # of gyro x to y and z, y to x and z, z to x and y [rad]
AIDED_ACCEL_SCALE = slice(24, 27)  # scale errors of the accelerometers [-]
AIDED_DEFLECTION = slice(27, 29)  # deflected vertical beyond what is taken off, north, east [rad]
AIDED_DRIVING = 29  # number of the states above, which move or drive what moves
AIDED_SLOW_POS = slice(29, 32)  # slow error of the fixes' positions, north, east, down [m]
AIDED_SLOW_OTHER = slice(32, 35)  # the same of fixes of the other type [m]
AIDED_SLOW_VEL = slice(35, 38)  # slow error of the fixes' velocities, north, east, down [m/s]
AIDED_LEVER = slice(38, 41)  # error of the lever arm from the IMU to the antenna, body axes [m]
AIDED_DELAY = 41  # error of the delay of the positions [s]
AIDED_VELOCITY_DELAY = 42  # error of the delay of the velocities [s]
AIDED_STATES = 43

# The gyro that reads, and the axis that it reads of, for each of the six misalignments.
READING_GYRO, READ_AXIS = (0, 0, 1, 1, 2, 2), (1, 2, 0, 2, 0, 1)
