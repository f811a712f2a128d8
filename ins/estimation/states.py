"""The layout of the estimator's base states, stated once for Python and for the compiled kernel.

A slice is of three components (north, east, down or body x, y, z) or, where it has two, of the
level pair. A number is one state. Symbols: CONVENTIONS.md; equations: `ins.estimation.error_model`.
The gyro bias of each time bin follows the base states, three to a bin; then whatever else a recipe
estimates.
"""

# Errors of the solution, which the kernel moves: its core, in its order.
W = slice(0, 2)  # velocity error against the true velocity in the computed frame, level [m/s]
W_DOWN = 2  # the same down; takes part where the height is estimated
POS = slice(3, 5)  # position error, level [m]
POS_DOWN = 5  # the same down; takes part where the height is estimated
THETA = slice(6, 9)  # drift angle [rad]
S = slice(9, 11)  # displacement error over the current step, body x and y [m]
LATERAL = 11  # lateral velocity of the vehicle beyond crab and lever arm [m/s]
CORE = 12

ACCEL = slice(12, 14)  # bias of the level accelerometers, body x and y [m/s^2]
ACCEL_Z = 14  # the same of the vertical one
KAPPA = 15  # lateral over forward velocity at the no-slip point (-crab) [rad]
LEVER_X = 16  # error of the lever arm from the no-slip point to the IMU along body x [m]
YAW = 17  # parked heading less its nominal value [rad]
ODOMETER = 18  # odometer scale error, reads high [-]
SCALE_Z = 19  # vertical gyro scale factor error [-]
CENTRE_LINE = 20  # error of the surveyed centre-line azimuth [rad]
THETA_START = slice(21, 24)  # clone of theta as it was at the start [rad]
THETA_CLONE = slice(24, 27)  # clone of theta at a time that the caller chooses [rad]
# What wind, tyres and installation may add while the vehicle rolls; known to be zero (no variance)
# unless the caller asks for them. All stand still; the caller may let one wander by `assign`.
WIND = slice(27, 29)  # crab by a steady wind, as the vector that body y is projected on: N, E [rad]
CRAB_TURN = 29  # crab that becomes another one as the vehicle turns [rad]
CRAB_GUST = 30  # crab by gusts [rad]
SLIP = 31  # lateral over forward velocity by lateral acceleration [rad/(m/s^2)]
WHEEL_Y = 32  # error of the lever arm from the no-slip point to the IMU along body y [m]
ODOMETER_DELAY = 33  # how much older than its stamp a speed is [s]
GNSS_ARM = slice(34, 36)  # error of the lever arm from the IMU to the antenna, body x, y [m]
GNSS_DELAY = 36  # how much older than its stamp a position of the receiver is [s]
GNSS_VELOCITY_DELAY = 37  # the same of its velocity [s]
GNSS_SLOW_POS = slice(38, 40)  # slow error of the receiver's positions, north and east [m]
GNSS_SLOW_VEL = slice(40, 42)  # slow error of its velocities, north and east [m/s]
BASE = 42  # number of base states: those above are 0 to 41
