"""The layouts of the filters' state vectors, stated once for Python and for the compiled kernels.

A slice is of three components (north, east, down or body x, y, z) or, where it has two, of the
level pair. A number is one state. Symbols: CONVENTIONS.md; equations: `ins.filters.error_model`
(error filter) and `ins.filters.aided_kernel` (aided filter).
"""

# Error filter: its base states. The gyro bias of each time bin follows them, three to a bin.
W = slice(0, 2)  # velocity error against the true velocity in the computed frame [m/s]
POS = slice(2, 4)  # position error [m]
THETA = slice(4, 7)  # drift angle [rad]
S = slice(7, 9)  # displacement error over the current step, body x and y [m]
ACCEL = slice(9, 11)  # bias of the level accelerometers, body x and y [m/s^2]
KAPPA = 11  # lateral over forward velocity at the no-slip point (-crab) [rad]
LEVER_X = 12  # error of the lever arm from the no-slip point to the IMU along body x [m]
LATERAL = 13  # lateral velocity of the vehicle beyond crab and lever arm [m/s]
YAW = 14  # parked heading less its nominal value [rad]
ODOMETER = 15  # odometer scale error, reads high [-]
SCALE_Z = 16  # vertical gyro scale factor error [-]
CENTRE_LINE = 17  # error of the surveyed centre-line azimuth [rad]
THETA_START = slice(18, 21)  # clone of theta as it was at the start [rad]
THETA_CLONE = slice(21, 24)  # clone of theta at a time that the caller chooses [rad]
# What wind, tyres and installation may add while the vehicle rolls; known to be zero (no variance)
# unless the caller asks for them. All stand still; the caller may let one wander by `assign`.
WIND = slice(24, 26)  # crab by a steady wind, as the vector that body y is projected on: N, E [rad]
CRAB_TURN = 26  # crab that becomes another one as the vehicle turns [rad]
CRAB_GUST = 27  # crab by gusts [rad]
SLIP = 28  # lateral over forward velocity by lateral acceleration [rad/(m/s^2)]
WHEEL_Y = 29  # error of the lever arm from the no-slip point to the IMU along body y [m]
ODOMETER_DELAY = 30  # how much older than its stamp a speed is [s]
GNSS_ARM = slice(31, 33)  # error of the lever arm from the IMU to the antenna, body x, y [m]
GNSS_DELAY = 33  # how much older than its stamp a position of the receiver is [s]
GNSS_VELOCITY_DELAY = 34  # the same of its velocity [s]
GNSS_SLOW_POS = slice(35, 37)  # slow error of the receiver's positions, north and east [m]
GNSS_SLOW_VEL = slice(37, 39)  # slow error of its velocities, north and east [m/s]
BASE = 39  # number of base states: those above are 0 to 38

# Of these, the states that move, and those that only drive the moving ones, in the kernel's order.
MOVING_STATES = (0, 1, 2, 3, 4, 5, 6, 7, 8, LATERAL)
DRIVING_STATES = (9, 10, SCALE_Z)

# Aided filter.
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
