"""Named unit factors: multiply a value in the named unit to get SI, divide to go back.

>>> 0.01 * DEG_PER_HOUR  # [rad/s]
4.84813681109536e-08
"""

from math import pi

DEG = pi / 180.0  # [rad], 0.0174533
ARCSEC = DEG / 3600.0  # [rad]
MILLIRADIAN = 1e-3  # [rad]
MILLISECOND = 1e-3  # [s]
MINUTE = 60.0  # [s]
HOUR = 3600.0  # [s], 60 minutes of 60
DEG_PER_HOUR = DEG / HOUR  # [rad/s]
DEG_PER_SQRT_HOUR = DEG / 60.0  # angle random walk [rad/sqrt(s)]
DEG_PER_HOUR_SQRT_HOUR = DEG / HOUR / 60.0  # rate random walk [rad/s/sqrt(s)]
STANDARD_GRAVITY = 9.80665  # CGPM 1901 [m/s^2]
# [m/s^2]; velocity random walk in ug/sqrt(Hz) times this is [m/s/sqrt(s)]
MICRO_G = 1e-6 * STANDARD_GRAVITY
MICRO_G_PER_SQRT_HOUR = MICRO_G / 60.0  # accelerometer rate random walk [m/s^2/sqrt(s)]
PPM = 1e-6
NAUTICAL_MILE = 1852.0  # [m]; International Hydrographic Conference, Monaco 1929
KNOT = NAUTICAL_MILE / HOUR  # [m/s]
