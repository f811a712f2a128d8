"""A short drive with simple numbers, for effects of accelerometers, vehicle, wheels, GNSS and
data.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ins.attitude import dcm_from_euler
from ins.earth import gravity_n, omega_ie_n
from ins.errors.telemetry import PARKED, ROLLING, Telemetry

LATITUDE_rad = np.deg2rad(45.0)
# s, m/s
SPEEDS = np.array(
    [(0, 0), (600, 0), (610, 10), (690, 10), (700, 5), (760, 5), (770, 0), (870, 0)]
).T
# s, rad/s
TURNS = np.array(
    [(640, 0), (643, 0.05), (670, 0.05), (673, 0), (710, 0), (713, -0.08), (737, -0.08), (740, 0)]
).T
END_s = 870.0


def still(heading_deg: float = 0.0, n: int = 600, dt_s: float = 1.0, **given: Any) -> Telemetry:
    """Level and at rest on one heading, from power-on."""
    zero = np.zeros(n)
    return _telemetry(
        dt_s * (np.arange(n) + 0.5),
        dt_s,
        zero,
        zero,
        np.full(n, np.deg2rad(heading_deg)),
        zero,
        **given,
    )


def drive(dt_s: float = 1.0, **given: Any) -> Telemetry:
    """Parked 600 s, 10 s at 1 m/s^2 to 10 m/s, right turn, 5 m/s, left turn, braking at 0.5 m/s^2,
    a stop of 100 s.
    """
    time = np.arange(0.5 * dt_s, END_s, dt_s)
    fine = np.arange(0.0, END_s + 0.01, 0.01)
    heading = np.concatenate([[0.0], np.cumsum(np.interp(fine[1:] - 0.005, *TURNS)) * 0.01])
    speed = np.interp(time, *SPEEDS)
    gain = np.gradient(np.interp(fine, *SPEEDS), fine)
    return _telemetry(
        time,
        dt_s,
        speed,
        np.interp(time, fine, gain),
        np.interp(time, fine, heading),
        np.interp(time, *TURNS),
        **given,
    )


def warm(run: Telemetry) -> NDArray:
    """Temperatures (n, 3) that rise by 10 degC and fall by more."""
    return np.repeat(25.0 + 10.0 * np.sin(run.time_s / 200.0)[:, None], 3, axis=1)


def rich_drive(dt_s: float = 1.0) -> Telemetry:
    """The drive with temperatures, GNSS and odometer."""
    T = warm(drive(dt_s))
    return drive(dt_s, temperature_degC=T, accel_degC=T, has_gnss=True, has_odometer=True)


def _telemetry(
    time: NDArray,
    dt_s: float,
    speed: NDArray,
    gain: NDArray,
    heading: NDArray,
    turn: NDArray,
    **given: Any,
) -> Telemetry:
    zero = np.zeros(time.size)
    C_nb = dcm_from_euler(zero, zero, heading)
    rate = np.einsum("nij,i->nj", C_nb, omega_ie_n(LATITUDE_rad)) + np.stack(
        [zero, zero, turn], axis=1
    )
    force = np.stack([gain, speed * turn, zero], axis=1) - gravity_n(LATITUDE_rad, 0.0)
    values: dict[str, Any] = dict(
        run_index=0,
        time_s=time,
        dt_s=dt_s,
        rate_rad_s=rate,
        force_m_s2=force,
        C_nb=C_nb,
        v_n_m_s=speed[:, None] * C_nb[:, :, 0],
        speed_m_s=speed,
        turn_rad_s=turn,
        kind=np.where(speed > 0, ROLLING, PARKED),
        lat_rad=LATITUDE_rad,
        height_m=0.0,
    )
    return Telemetry(**(values | given))
