"""What errors of the list depend on (`ins.errors.telemetry`), of a run that stands or is navigated.

The diagnosis and an update ask an error for its trace on the same quantities.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.session.log import table_series
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.attitude import euler_from_dcm, wrap_pi
from ins.earth import gravity_magnitude, omega_ie_n
from ins.errors.telemetry import PARKED, Telemetry
from ins.records import NavHistory, Run


def standing(run: Run, time_s: NDArray, C_nb: NDArray) -> Telemetry:
    """A run that stands at all its instants.

    Parameters
    ----------
    run : Run
    time_s : ndarray, shape (n,)
        Middles of seconds.
    C_nb : ndarray, shape (3, 3)

    Returns
    -------
    telemetry : Telemetry
        Without temperatures.
    """
    site, n = run.header.site, time_s.size
    force_n = [0.0, 0.0, -float(gravity_magnitude(site.lat_rad, site.height_m))]
    return Telemetry(
        run_index=0,
        time_s=time_s,
        dt_s=1.0,
        rate_rad_s=np.tile(C_nb.T @ omega_ie_n(site.lat_rad), (n, 1)),
        force_m_s2=np.tile(C_nb.T @ force_n, (n, 1)),
        C_nb=np.tile(C_nb, (n, 1, 1)),
        v_n_m_s=np.zeros((n, 3)),
        speed_m_s=np.zeros(n),
        turn_rad_s=np.zeros(n),
        kind=np.full(n, PARKED),
        lat_rad=site.lat_rad,
        height_m=site.height_m,
        has_gnss=run.gnss is not None,
        has_odometer=run.odometer is not None,
        above_m=_above(run, time_s),
    )


def navigated(run: Run, history: NavHistory, kind: NDArray) -> Telemetry:
    """A run along its navigation solution, at the middles of its first n epochs.

    Parameters
    ----------
    run : Run
    history : NavHistory
        Epochs of a second.
    kind : ndarray of int, shape (n,)
        PARKED, ROLLING or AIRBORNE.

    Returns
    -------
    telemetry : Telemetry
        Without temperatures.
    """
    until, rows = slice(kind.size + 1), slice(1, kind.size + 1)
    dt_s = np.diff(history.time_s[until])
    C_nb = history.C_nb_dt[rows] / dt_s[:, None, None]
    moving = kind != PARKED
    v_n = np.where(moving[:, None], history.displacement_n_m[rows] / dt_s[:, None], 0.0)
    turned = wrap_pi(np.diff(euler_from_dcm(history.C_nb[until])[2]))
    return replace(
        standing(run, history.time_s[rows] - 0.5 * dt_s, history.C_nb[0]),
        rate_rad_s=history.dtheta_b_rad[rows] / dt_s[:, None],
        force_m_s2=np.einsum("nji,nj->ni", C_nb, history.dv_f_n_m_s[rows] / dt_s[:, None]),
        C_nb=C_nb,
        v_n_m_s=v_n,
        speed_m_s=np.einsum("nj,nj->n", C_nb[:, :, 0], v_n),
        turn_rad_s=np.where(moving, turned / dt_s, 0.0),
        kind=kind,
    )


def thermal(
    run: Run, table: ThermalTable | None, temperature: GyroTemperature, t: NDArray
) -> Mapping[str, Any]:
    """Temperatures at the seconds, by field of the telemetry; those beside the gyros' as read,
    straight between readings.
    """
    assert run.temperature is not None
    log, T = run.temperature, temperature.at(t)
    rate = np.stack(
        [np.interp(t, temperature.time_s, temperature.rate_degC_min[:, k]) for k in range(3)],
        axis=1,
    )
    out = {"temperature_degC": T, "temperature_rate_degC_min": rate, "accel_degC": T}
    for name in ("accel_degC", "gradient_degC", "block_degC", "ambient_degC"):
        values = getattr(log, name)
        if values is not None and np.isfinite(values).sum() > 1:
            columns = [_smooth(t, log.time_s, column) for column in np.atleast_2d(values.T)]
            out[name] = columns[0] if values.ndim == 1 else np.stack(columns, axis=1)
    if table is not None:
        out["table_deg_h"] = table_series(table, temperature)(t)
    return out


def _above(run: Run, t: NDArray) -> NDArray | None:
    """Height over the site at the seconds, straight between fixes."""
    gnss = run.gnss
    if gnss is None:
        return None
    good = np.isfinite(gnss.height_m)
    if not good.any():
        return None
    height_m = np.interp(t, gnss.time_s[good], gnss.height_m[good])
    return np.asarray(height_m - gnss.height_m[good][0])


def _smooth(t: NDArray, time_s: NDArray, values: NDArray) -> NDArray:
    """Readings at other times, means over a minute (thermal masses are slower; thermometers are
    coarse).
    """
    good = np.isfinite(values)
    if good.sum() < 2:
        return np.zeros_like(t)
    raw = np.interp(t, time_s[good], values[good])
    half = 30
    padded = np.concatenate(
        [2 * raw[0] - raw[1 : half + 1][::-1], raw, 2 * raw[-1] - raw[-half - 1 : -1][::-1]]
    )
    return np.convolve(padded, np.ones(2 * half + 1) / (2 * half + 1), mode="valid")
