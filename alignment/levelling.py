"""Level of a resting unit from its accelerometers alone, for gyros too uncertain to navigate
through the rest.

A gyro error e bends the computed velocity by g e t^2 / 2: at 20 deg/h 1.7 m/s after a minute, 171
m/s after ten. That is a taxi and then a flight to whoever looks for rest in it; gyros that find no
heading need no such solution.
"""

from dataclasses import replace

import numpy as np

from alignment.coarse import RestMeans
from alignment.motion.stillness import PIVOT_RAD_S
from alignment.reasons import AlignmentReason, AlignmentVerdict
from alignment.result import Alignment
from ins.attitude import level_angles
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from ins.noise import accel_densities
from ins.records import ImuSource, Phase, Site, TwinModel
from ins.twin_file import default_twin
from ins.units import DEG, DEG_PER_HOUR, MICRO_G
from ins.verdicts import Reason, because

LEVEL_S = 30.0  # the end of the rest, over which the specific force is averaged


def tilt_of_z(means: RestMeans) -> float:
    """Angle [rad] between the z axis and the vertical, up or down."""
    f_b = means.f_ib_b
    return float(np.arccos(min(abs(f_b[2]) / np.linalg.norm(f_b), 1.0)))


def turns(means: RestMeans) -> Reason | None:
    """What gyros that read far beyond Earth rate at rest may mean; None where they do not."""
    rate = float(np.linalg.norm(means.omega_ib_b))
    if rate <= PIVOT_RAD_S:
        return None
    return because(
        AlignmentReason.TURNS,
        rate_deg_h=rate / DEG_PER_HOUR,
        earth_deg_h=EARTH_RATE_RAD_S / DEG_PER_HOUR,
        as_degrees_deg_h=rate * DEG / DEG_PER_HOUR,
    )


def like_mems(twin: TwinModel, gyro_deg_h: float, usual_deg_h: float) -> tuple[TwinModel, Reason]:
    """The twin with the accelerometers of a MEMS unit, where gyros that far off belie their
    technology, and why.
    """
    why = because(
        AlignmentReason.LIKE_MEMS,
        sigma_deg_h=gyro_deg_h,
        usual_deg_h=usual_deg_h,
        technology=twin.gyro_technology,
    )
    return replace(twin, accel=default_twin("mems").accel), why


def level(
    imu: ImuSource,
    site: Site,
    twin: TwinModel,
    *,
    rest: tuple[float, float],
    gyro_sigma_rad_s: float,
    reason: Reason,
) -> Alignment:
    """Roll and pitch at the end of the rest, verdict "level_only" for the `reason` that heading was
    not found.

    Sigma: accelerometer turn-on bias and noise of the twin, widened by ``|f|`` less gravity, which
    is an error of theirs that anyone can see. Source: Groves (2013), section 5.6.1.
    """
    part = imu.between(max(rest[1] - LEVEL_S, rest[0]), rest[1])
    f_b = part.dv_m_s.sum(axis=0) / part.dt_s.sum()
    gravity = float(gravity_magnitude(site.lat_rad, site.height_m))
    excess = abs(float(np.linalg.norm(f_b)) - gravity)
    noise = accel_densities(twin.accel).white / np.sqrt(part.dt_s.sum())
    sigma = float(np.linalg.norm([twin.accel.turn_on_ug * MICRO_G, excess, noise])) / gravity
    turn_deg = gyro_sigma_rad_s * (rest[1] - rest[0]) / DEG
    alone = because(AlignmentReason.LEVEL_ALONE, turn_deg=turn_deg, rest_s=rest[1] - rest[0])
    roll, pitch = level_angles(f_b)
    return Alignment(
        verdict=AlignmentVerdict.LEVEL_ONLY,
        reasons=(reason, alone),
        time_s=rest[1],
        roll_rad=roll,
        pitch_rad=pitch,
        sigma_roll_rad=sigma,
        sigma_pitch_rad=sigma,
        duration_s=rest[1] - rest[0],
        phases=(Phase(phase="alignment", start_s=rest[0], end_s=rest[1]),),
    )
