"""Effects between IMU and position: GNSS antenna and delay, and what needs more than a log
(effects.md 2c, F01 to F05).
"""

from collections.abc import Sequence

import numpy as np

from ins.earth import omega_ie_n
from simreal.effects.base import Coefficient, Shape
from simreal.effects.parts.formula import FormulaEffect, OutOfReach, with_parts
from simreal.effects.parts.gyro_effect import one, several
from simreal.effects.parts.recordings import brakes, has_gnss, lacking, turns
from simreal.effects.telemetry import Telemetry, Trace
from simreal.effects.wheels import MILLISECOND


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
        FormulaEffect(
            "gnss_lever_arm_or_latency",
            "gnss_lever_arm_or_latency",
            ("gnss",),
            (*several("xy", "m", 0.1, 3.0), Coefficient("latency", "ms", 10.0, 200.0)),
            rivals=(
                "lever_arm",
                "airframe_flexure",
                "imu_size_effect",
                "false_standstill",
                "gnss_clock_drift",
                "gnss_slow_error",
            ),
            source="effects.md F02; true less logged",
            formula=gnss_antenna,
            need=needs_gnss_turns,
        )
    ),
    OutOfReach(
        "airframe_flexure",
        "airframe_flexure",
        ("vehicle",),
        one("mrad/g", 1.0, 5.0),
        rivals=("gnss_lever_arm_or_latency", "gyro_misalignment"),
        source="effects.md F03",
        need="flight with an attitude reference at the antenna",
    ),
    OutOfReach(
        "schuler_start_error",
        "schuler_start_error",
        ("vehicle",),
        several(("tilt_north", "tilt_east"), "arcsec", 5.0, 50.0),
        rivals=("vertical_deflection", "accel_thermal"),
        source="effects.md F04",
        need="the unit's own navigation output over 42 minutes or more",
    ),
    OutOfReach(
        "baro_lag",
        "baro_lag",
        ("vehicle",),
        one("% of climb", 1.0, 3.0),
        rivals=("accel_scale_factor",),
        source="effects.md F05",
        need="a barometer in a climb",
    ),
)
