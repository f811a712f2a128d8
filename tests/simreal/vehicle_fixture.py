"""A short drive with simple numbers, for effects of accelerometers, vehicle, wheels, GNSS and data."""

import numpy as np
from numpy.typing import NDArray

from ins.attitude import dcm_from_euler
from ins.earth import gravity_n, omega_ie_n
from simreal.telemetry import PARKED, ROLLING, Telemetry

LATITUDE_rad = np.deg2rad(45.0)
PARKED_s, STOP_s = 600, 100  # at the start and at the end


def still(heading_deg: float = 0.0, n: int = 600, dt_s: float = 1.0, **given: object) -> Telemetry:
    """Level and at rest on one heading, from power-on."""
    speed, heading = np.zeros(n), np.full(n, np.deg2rad(heading_deg))
    return _telemetry(speed, heading, dt_s, np.full(n, PARKED), **given)


def drive(**given: object) -> Telemetry:
    """Parked 600 s, 20 s at 0.5 m/s^2 to 10 m/s, right turn, straight, left turn at half the speed, stop, parked 100 s."""
    speed_up, down = np.linspace(0.25, 9.75, 20), np.linspace(9.75, 5.25, 10)
    ten, five, brake = np.full(60, 10.0), np.full(60, 5.0), np.linspace(4.75, 0.25, 10)
    speed = np.concatenate([np.zeros(PARKED_s), speed_up, ten, down, five, brake, np.zeros(STOP_s)])
    turn = np.zeros(speed.size)
    turn[640:670], turn[710:740] = 0.05, -0.08
    kind = np.where(speed > 0, ROLLING, PARKED)
    return _telemetry(speed, np.cumsum(turn), 1.0, kind, **given)


def _telemetry(speed: NDArray, heading: NDArray, dt_s: float, kind: NDArray, **given: object) -> Telemetry:
    n = speed.size
    time = dt_s * (np.arange(n) + 0.5)
    C_nb = dcm_from_euler(np.zeros(n), np.zeros(n), heading)
    turn = np.gradient(heading, time)
    v_n = speed[:, None] * C_nb[:, :, 0]
    rate = np.einsum("nij,i->nj", C_nb, omega_ie_n(LATITUDE_rad)) + np.stack([0 * turn, 0 * turn, turn], axis=1)
    force_n = np.gradient(v_n, time, axis=0) - gravity_n(LATITUDE_rad, 0.0)
    force = np.einsum("nij,ni->nj", C_nb, force_n)
    values: dict = dict(
        run_index=0, time_s=time, dt_s=dt_s, rate_rad_s=rate, force_m_s2=force, C_nb=C_nb, v_n_m_s=v_n, speed_m_s=speed,
        turn_rad_s=turn, kind=kind, lat_rad=LATITUDE_rad, height_m=0.0,
    )  # fmt: skip
    return Telemetry(**(values | given))
