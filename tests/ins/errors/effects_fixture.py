"""Small telemetry for the tests of effects: a parked hour that warms up, a taxi with turns, a roll
in flight.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ins.earth import omega_ie_n
from ins.errors.telemetry import AIRBORNE, PARKED, ROLLING, Telemetry
from ins.units import STANDARD_GRAVITY

LAT_RAD = np.deg2rad(45.0)


def heading_matrix(heading_rad: NDArray) -> NDArray:
    """C_nb (n, 3, 3) of a level body."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    C = np.zeros((heading_rad.size, 3, 3))
    C[:, 0, 0], C[:, 0, 1], C[:, 1, 0], C[:, 1, 1], C[:, 2, 2] = c, -s, s, c, 1.0
    return C


def parked_run(
    n: int = 3600,
    *,
    dt_s: float = 1.0,
    heading_deg: float = 30.0,
    start_degC: float = 5.0,
    rise_degC: float = 30.0,
    tau_s: float = 1200.0,
    run_index: int = 0,
) -> Telemetry:
    """Level and at rest; gyro k at start + rise (1 - exp(-t / tau)) + k; the table 2e-5 T^2 (1, 2,
    3) deg/h.
    """
    t = (np.arange(n) + 0.5) * dt_s
    C_nb = heading_matrix(np.full(n, np.deg2rad(heading_deg)))
    decay = np.exp(-t / tau_s)
    T = start_degC + rise_degC * (1 - decay)[:, None] + np.arange(3.0)
    return Telemetry(
        run_index=run_index,
        time_s=t,
        dt_s=dt_s,
        rate_rad_s=np.einsum("nji,j->ni", C_nb, omega_ie_n(LAT_RAD)),
        force_m_s2=np.tile([0.0, 0.0, -STANDARD_GRAVITY], (n, 1)),
        C_nb=C_nb,
        v_n_m_s=np.zeros((n, 3)),
        speed_m_s=np.zeros(n),
        turn_rad_s=np.zeros(n),
        kind=np.full(n, PARKED),
        lat_rad=LAT_RAD,
        height_m=250.0,
        temperature_degC=T,
        temperature_rate_degC_min=np.repeat((60 * rise_degC / tau_s * decay)[:, None], 3, axis=1),
        accel_degC=T + 1.0,
        gradient_degC=np.outer(decay, [2.0, -1.0, 1.5]),
        block_degC=T[:, 0] + 2.0,
        ambient_degC=np.full(n, start_degC),
        table_deg_h=2e-5 * T**2 * np.array([1.0, 2.0, 3.0]),
    )


def cooling_run(n: int = 3600, *, heading_deg: float = 120.0, run_index: int = 1) -> Telemetry:
    """The parked run, cooling from 45 to 20 degC at another heading."""
    return parked_run(
        n, heading_deg=heading_deg, start_degC=45.0, rise_degC=-25.0, run_index=run_index
    )


def taxi_run(
    n: int = 600, *, right_deg: float = 90.0, left_deg: float = 90.0, run_index: int = 0
) -> Telemetry:
    """5 m/s after a parked minute; a turn to the right and one to the left of 60 s each (0 deg:
    none).
    """
    run = parked_run(n, run_index=run_index)
    t, rate = run.time_s, np.zeros(n)
    rate[(t > 120) & (t < 180)] += np.deg2rad(right_deg) / 60
    rate[(t > 300) & (t < 360)] -= np.deg2rad(left_deg) / 60
    C_nb = heading_matrix(np.deg2rad(30.0) + np.cumsum(rate) * run.dt_s)
    speed = np.where(t > 60, 5.0, 0.0)
    force = run.force_m_s2 + np.stack([np.zeros(n), speed * rate, np.zeros(n)], axis=-1)
    own = np.stack([np.zeros(n), np.zeros(n), rate], axis=-1)
    return replace(
        run,
        rate_rad_s=np.einsum("nji,j->ni", C_nb, omega_ie_n(LAT_RAD)) + own,
        C_nb=C_nb,
        force_m_s2=force,
        v_n_m_s=speed[:, None] * C_nb[:, :, 0],
        speed_m_s=speed,
        turn_rad_s=rate,
        has_odometer=True,
        kind=np.where(t > 60, ROLLING, PARKED),
    )


def flight_run(n: int = 600, *, run_index: int = 0) -> Telemetry:
    """Airborne at 100 m/s: 40 deg of bank and back (x), a pull-up of 2 g and back (y), a turn each
    way (z).
    """
    run = taxi_run(n, run_index=run_index)
    rates, t = run.rate_rad_s.copy(), run.time_s
    for axis, start in ((0, 400), (1, 480)):
        rates[(t > start) & (t < start + 20), axis] += np.deg2rad(40.0) / 20
        rates[(t > start + 20) & (t < start + 40), axis] -= np.deg2rad(40.0) / 20
    force = run.force_m_s2 * np.where((t > 480) & (t < 520), 2.0, 1.0)[:, None]
    speed = np.full(n, 100.0)
    return replace(
        run,
        rate_rad_s=rates,
        force_m_s2=force,
        speed_m_s=speed,
        v_n_m_s=speed[:, None] * run.C_nb[:, :, 0],
        kind=np.full(n, AIRBORNE),
        has_gnss=True,
    )


def bare(run: Telemetry) -> Telemetry:
    """The run without any thermometer, table or heading."""
    return replace(
        run,
        temperature_degC=None,
        temperature_rate_degC_min=None,
        accel_degC=None,
        gradient_degC=None,
        block_degC=None,
        ambient_degC=None,
        table_deg_h=None,
        heading_known=False,
    )
