"""Where the passes over a session begin that has no first rest: on the aided solution of its first
half hour, smoothed.

Only the place of linearisation is taken from it. The filter of the session begins there with wide
priors, that of the heading withdrawn at its end, so that no fix counts twice.

Decision: docs/decisions/0060-unknown-heading.md.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from alignment.motion.seconds import seconds_of
from alignment.motion.speeds import find_stands
from alignment.motion.stillness import TAKE_OFF_M_S
from infield.aided.flight import aided_noise
from infield.aided.flights import Beginning, Flights, options_of
from infield.aided.headings import HeadingOpen, Sky
from infield.aided.noise import Model, NoiseScales
from infield.aided.reasons import StartMethod
from infield.aided.smoothing import smooth_flight
from infield.session.flown.flight import LEAST_FLOWN_S, RunInputs
from infield.session.reasons import FlightReason
from ins.filters.aided_records import Antenna, fixes_of
from ins.filters.states import AIDED_THETA
from ins.records import GnssLog, ImuSource, NavState, Run, Site
from ins.verdicts import Reason, because

# of log that the start is sought on; chosen: gyrocompassing under way, a ring-laser unit of the
# default table knows its heading to 0.7 mrad by then (0.0078 deg/h over 10.6 deg/h of Earth rate)
SOUGHT_S = 1800.0
# 1 sigma of heading that a start may be off: of three of them the second order, 0.5 (3 sigma)^2, is
# 5 % of a sigma
START_HEADING_RAD = 0.01


@dataclass(frozen=True, kw_only=True)
class MovingStart:
    """Where a session begins in motion, and what is taken off there.

    gyro_rad_s (3,), accel_m_s2 (3,): biases of the smoothed solution; sigma_heading_rad: of it.
    """

    state: NavState
    gyro_rad_s: NDArray
    accel_m_s2: NDArray
    method: StartMethod
    sigma_heading_rad: float


def fast_before(log: GnssLog, rest: Where | None) -> NDArray:
    """Which fixes (n,) are of a vehicle in the air, before a rest where there is one."""
    fast = np.linalg.norm(log.v_n_m_s[:, :2], axis=1) > TAKE_OFF_M_S
    return np.asarray(fast if rest is None else fast & (log.time_s < rest[0]))


def begins_in_motion(run: Run, rest: Where | None) -> bool:
    """Whether a log flies with a receiver before its first rest, or has none."""
    if run.gnss is None:
        return False
    times = run.gnss.time_s[fast_before(run.gnss, rest)]
    return bool(times.size and times[-1] - times[0] >= LEAST_FLOWN_S)


def find_moving_start(known: RunInputs, imu: ImuSource, log: GnssLog) -> MovingStart | Reason:
    """The start of a run that begins in motion; what is missing where it cannot be found.

    imu: compensated; log: usable fixes.
    """
    twin, header, priors = known.twin, known.run.header, known.settings.flight
    sought = imu.between(imu.start_s, min(imu.start_s + SOUGHT_S, imu.end_s))
    gnss = twin.gnss
    declared_m = gnss.sigma_horizontal_m, gnss.sigma_vertical_m, gnss.sigma_velocity_m_s
    fixes = fixes_of(
        log, horizontal_m=declared_m[0], vertical_m=declared_m[1], velocity_m_s=declared_m[2]
    )
    stands = find_stands(seconds_of(sought), fixes)
    technology = header.gyro_technology
    antenna = Antenna(
        lever_arm_m=np.asarray(header.gnss_lever_arm_m, dtype=float),
        covariance=np.diag([priors.antenna_m] * 3 + [priors.delay_s] * 2) ** 2,
    )
    noise = replace(
        aided_noise(twin), deflection_rad=priors.deflection_rad, deflection_m=priors.deflection_m
    )
    nodes = [np.diag(known.table.covariance)[known.table.values_of(k)].max() for k in range(3)]
    sky = Sky(
        imu=sought,
        fixes=fixes,
        twin=twin,
        noise=noise,
        options=options_of(technology, stands),
        gyro_sigma_deg_h=np.hypot(np.sqrt(nodes), twin.gyro.turn_on_deg_h),
        lever_arm_m=antenna.lever_arm_m,
    )
    begin = Beginning(sky=sky, header=header, rest=None, stands=stands)
    flights = Flights(sought, fixes, noise, declared_m, stands, technology, begin)
    flights = replace(flights, declared_other_m=declared_m[:2])
    found = flights.start(antenna)
    if isinstance(found, Reason):
        return because(FlightReason.NOT_NAVIGATED, why=found)
    if found.method is StartMethod.ALL_HEADINGS:
        assert isinstance(begin.heading, HeadingOpen)
        return because(FlightReason.NOT_NAVIGATED, why=begin.heading.why)
    slow = NoiseScales(
        slow=priors.slow_position_m / declared_m[0],
        slow_other=priors.slow_position_m / declared_m[0],
        slow_s=priors.slow_position_s,
        slow_velocity=priors.slow_velocity_m_s / declared_m[2],
        slow_velocity_s=priors.slow_velocity_s,
    )
    best = smooth_flight(flights, found, Model(antenna=antenna, scales=slow))
    sigma = float(np.sqrt(best.variance[0, AIDED_THETA.stop - 1]))
    if sigma > START_HEADING_RAD:
        return because(
            FlightReason.HEADING_UNSEEN,
            sigma_rad=sigma,
            limit_rad=START_HEADING_RAD,
            sought_s=sought.end_s - sought.start_s,
        )
    place = Site(
        lat_rad=float(best.lat_rad[0]),
        lon_rad=float(best.lon_rad[0]),
        height_m=float(best.height_m[0]),
    )
    state = NavState(
        time_s=float(best.time_s[0]), site=place, v_n_m_s=best.v_n_m_s[0], C_nb=best.C_nb[0]
    )
    return MovingStart(
        state=state,
        gyro_rad_s=best.gyro_bias_rad_s[0],
        accel_m_s2=best.accel_bias_m_s2[0],
        method=found.method,
        sigma_heading_rad=sigma,
    )
