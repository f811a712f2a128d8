"""How receivers number the quality of their fixes, on the scale of a run (`ins.records.FixType`).

What a scale does not tell, or a number that stands for no quality, is NaN: unknown.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ins.records import FixType

Scale = Mapping[int, FixType]

# GPS_FIX_TYPE of MAVLink; GPS.Status of ArduPilot; fix_type of PX4 (sensor_gps.msg), whose 8 is an
# extrapolated fix, and 8 of MAVLink a precise point position
AUTOPILOT: Scale = {3: FixType.SINGLE, 4: FixType.DIFFERENTIAL, 5: FixType.FLOAT, 6: FixType.FIXED}
# Q of a solution file: RTKLIB ver. 2.4.2 manual, appendix B.1
RTKLIB: Scale = {
    1: FixType.FIXED,
    2: FixType.FLOAT,
    3: FixType.DIFFERENTIAL,  # by satellite
    4: FixType.DIFFERENTIAL,
    5: FixType.SINGLE,
    6: FixType.FLOAT,  # precise point positioning: carrier phases, ambiguities not fixed
}
# GNSS fix of a VectorNav unit (VN-200 and VN-300 user manuals, GNSS1.GnssFix)
VECTORNAV: Scale = {
    3: FixType.SINGLE,
    4: FixType.DIFFERENTIAL,  # by satellite
    7: FixType.FLOAT,
    8: FixType.FIXED,
}
# status of sensor_msgs/NavSatStatus; 2, by a station on the ground, is what drivers of receivers
# write for float and for fixed alike
ROS: Scale = {0: FixType.SINGLE, 1: FixType.DIFFERENTIAL, 2: FixType.FLOAT}
# "Position or Velocity Type" of OEM7 (page of BESTPOS); types of the filter (INS_...) are no fixes
NOVATEL: Scale = {
    16: FixType.SINGLE,
    17: FixType.DIFFERENTIAL,
    18: FixType.DIFFERENTIAL,  # by satellite
    32: FixType.FLOAT,
    33: FixType.FLOAT,
    34: FixType.FLOAT,
    48: FixType.FIXED,
    49: FixType.FIXED,
    50: FixType.FIXED,
    68: FixType.FLOAT,  # precise point positioning, while it converges and after
    69: FixType.FLOAT,
    77: FixType.FLOAT,
    78: FixType.FLOAT,
}
# the same types as lines have them
NOVATEL_NAMES: Mapping[str, int] = {
    "SINGLE": 16,
    "PSRDIFF": 17,
    "WAAS": 18,
    "L1_FLOAT": 32,
    "IONOFREE_FLOAT": 33,
    "NARROW_FLOAT": 34,
    "L1_INT": 48,
    "WIDE_INT": 49,
    "NARROW_INT": 50,
    "PPP_CONVERGING": 68,
    "PPP": 69,
    "PPP_BASIC_CONVERGING": 77,
    "PPP_BASIC": 78,
}
# quality indicator of GGA sentences (NMEA 0183): 6 is dead reckoning, 7 and 8 are no measurement
NMEA: Scale = {
    1: FixType.SINGLE,
    2: FixType.DIFFERENTIAL,
    3: FixType.SINGLE,  # of the precise service
    4: FixType.FIXED,
    5: FixType.FLOAT,
}
BY_NAME: Mapping[str, Scale] = {"autopilot": AUTOPILOT, "rtklib": RTKLIB, "nmea": NMEA}


def fix_types(numbers: NDArray, scale: Scale) -> NDArray:
    """Types (n,) of a receiver's own numbers, NaN for what its scale does not have."""
    found = np.full(numbers.shape, np.nan)
    for number, kind in scale.items():
        found[numbers == number] = kind
    return found
