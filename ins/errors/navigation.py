"""Effects between IMU and position: GNSS antenna and delay, and what needs more than a log
(effects.md 2c, F01 to F05).
"""

from collections.abc import Sequence

import numpy as np

from ins.earth import omega_ie_n
from ins.errors.base import Coefficient, Shape, Words, error, one, several
from ins.errors.parts.formula import with_parts
from ins.errors.parts.recordings import brakes, has_gnss, lacking, turns
from ins.errors.prior import Prior
from ins.errors.telemetry import Telemetry, Trace
from ins.errors.wheels import MILLISECOND


def gnss_antenna(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Antenna at the logged lever arm plus l: C_nb l and C_nb (w_eb x l); a fix of dt ago: -v dt
    and -v' dt.

    Left out: l along body z, which a level vehicle shows in heights only, and those are not
    compared.
    """
    C_nb = run.C_nb
    w_eb_b = run.rate_rad_s - np.einsum("nij,i->nj", C_nb, omega_ie_n(run.lat_rad))
    arms = tuple(
        Trace(
            gnss_position_m=C_nb[:, :, axis],
            gnss_velocity_m_s=np.einsum("nij,nj->ni", C_nb, np.cross(w_eb_b, np.eye(3)[axis])),
        )
        for axis in range(2)
    )
    late = Trace(
        gnss_position_m=-MILLISECOND * run.v_n_m_s,
        gnss_velocity_m_s=-MILLISECOND * run.rate_of(run.v_n_m_s),
    )
    return (*arms, late)


def needs_gnss_turns(runs: Sequence[Telemetry], target: str) -> str:
    seen = [run for run in runs if run.has_gnss] or runs
    return lacking((has_gnss(runs), "GNSS"), (turns(seen) or brakes(seen), "turns"))


NAVIGATION_EFFECTS = (
    *with_parts(
        error(
            "F02",
            "gnss_lever_arm_or_latency",
            ("gnss",),
            (*several("xy", "m", 0.1, 3.0), Coefficient("latency", "ms", 10.0, 200.0)),
            formula=gnss_antenna,
            priors=(
                Prior(
                    "taxi flight replay",
                    "m",
                    2.0,
                    part="arm",
                    source="0.1 to 3 m where it is off, on aircraft of any size; a flight under"
                    " 0.3 m and a replay under 1 m found the same",
                ),
                Prior(
                    "taxi flight replay",
                    "s",
                    0.3,
                    part="latency",
                    source="receivers lag by 0.1 to 0.2 s (u-blox 5: positions 0.13, velocities"
                    " 0.21 s; autopilots assume 0.11 to 0.22 s), loggers add theirs",
                ),
            ),
            need=needs_gnss_turns,
            rivals=("airframe_flexure", "gnss_clock_drift", "gnss_slow_error"),
            source="true less logged",
            words=Words(
                what="The antenna is not where the run says, or fixes are late.",
                brought_on_by="Turns for the arm, speed for the latency.",
                size="100 ms at 10 m/s are 1 m along the way.",
                remedy="Measure the antenna's arm; take the receiver's pulse for time.",
            ),
        )
    ),
    error(
        "F03",
        "airframe_flexure",
        ("vehicle",),
        one("mrad/g", 1.0, 5.0),
        out_of_reach="flight with an attitude reference at the antenna",
        source="bending between IMU and antenna",
        words=Words(
            what="The airframe bends between unit and antenna.",
            brought_on_by="Load factor, fuel that is used up.",
            size="1 mrad over 5 m moves the antenna by 5 mm.",
            remedy="Mount unit and antenna on one frame.",
        ),
    ),
    error(
        "F04",
        "schuler_start_error",
        ("vehicle",),
        several(("tilt_north", "tilt_east"), "arcsec", 5.0, 50.0),
        out_of_reach="the unit's own navigation output over 42 minutes or more",
        source="tilt, velocity and bias at the start of free inertial",
        words=Words(
            what="An error of level or velocity at the start swings with the Schuler period of "
            "84 min.",
            brought_on_by="Free-inertial navigation of 42 minutes and more.",
            size="10 arcsec of tilt swing the velocity by 0.38 m/s.",
            remedy="Align longer; level on a vehicle that does not settle.",
        ),
    ),
    error(
        "F05",
        "baro_lag",
        ("vehicle",),
        one("% of climb", 1.0, 3.0),
        out_of_reach="a barometer in a climb",
        source="lag and scale of the height",
        words=Words(
            what="The barometric height is late, or off by a share of the climb.",
            brought_on_by="Climbs and descents.",
            size="2 % of a climb of 1,000 m are 20 m.",
            remedy="Calibrate the static pressure system; use GNSS height.",
        ),
    ),
)
