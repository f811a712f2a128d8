"""The aided solution against truth that owes the simulator nothing: a car profile of Groves's, its
sensors by closed forms.
"""

import numpy as np
import pytest

from infield.aided.flight import navigate_aided
from ins.attitude import euler_from_dcm, wrap_pi
from ins.earth import displacement_ned
from ins.filters.aided_filter import level_sigmas
from ins.records import GnssLog, ImuLog, Run, RunHeader, Site
from ins.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G
from tests.infield.aided_cases import twin_of
from tests.ins.inertial_truth import ideal_imu
from tests.ins.test_mechanization_oracle import DATA, profile

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="../shared/data is not beside the project"
)
GYRO_BIAS = np.array([20.0, -35.0, 25.0]) * DEG_PER_HOUR
ACCEL_BIAS = np.array([2000.0, -1500.0, 1000.0]) * MICRO_G


def measured(seed: int):
    """A MEMS unit in a car, in motion from the first row on; fixes at 2 Hz; the profile's rows."""
    rng, twin = np.random.default_rng(seed), twin_of("mems", flicker=False)
    rows, motion = profile(2)
    ideal = ideal_imu(motion, np.linspace(0.0, rows[-1, 0], len(rows)))
    shape, root = ideal.dtheta_rad.shape, np.sqrt(ideal.dt_s)[:, None]
    gyro = twin.gyro.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR * root * rng.standard_normal(shape)
    accel = twin.accel.vrw_ug_sqrt_hz * MICRO_G * root * rng.standard_normal(shape)
    dt = ideal.dt_s[:, None]
    imu = ImuLog(
        time_s=ideal.time_s,
        dt_s=ideal.dt_s,
        dtheta_rad=ideal.dtheta_rad + GYRO_BIAS * dt + gyro,
        dv_m_s=ideal.dv_m_s + ACCEL_BIAS * dt + accel,
    )
    k = np.arange(50, len(rows), 50)
    noise = rng.standard_normal((6, k.size))
    level, down, speed = (
        getattr(twin.gnss, f"sigma_{name}")
        for name in ("horizontal_m", "vertical_m", "velocity_m_s")
    )
    lat = rows[k, 1] * DEG
    v_n = np.stack([np.interp(rows[k, 0], rows[:, 0], column) for column in rows[:, 4:7].T], axis=1)
    gnss = GnssLog(
        time_s=rows[k, 0],
        lat_rad=lat + level * noise[0] / 6.38e6,
        lon_rad=rows[k, 2] * DEG + level * noise[1] / (6.38e6 * np.cos(lat)),
        height_m=rows[k, 3] + down * noise[2],
        v_n_m_s=v_n + speed * noise[3:].T,
    )
    site = Site(lat_rad=float(lat[0]), lon_rad=float(rows[0, 2]) * DEG, height_m=float(rows[0, 3]))
    header = RunHeader(
        run_id="groves",
        tail="",
        imu_serial="g",
        gyro_technology="mems",
        site=site,
        start_utc="2026-01-01T00:00:00Z",
    )
    return Run(header=header, imu=imu, gnss=gnss), rows, twin


def test_groves_car_is_navigated_with_honest_sigmas():
    """175 s at 30 m/s, started in motion: roll and pitch to 0.3 deg, heading to 2 deg, errors
    within their sigmas.
    """
    ratios = []
    for seed in range(4):
        run, rows, twin = measured(seed)
        found = navigate_aided(run, run.imu, twin, rest=None, gyro_sigma_deg_h=None)
        assert found.verdict == "aided" and found.found.method == "velocity matching", found.reasons
        history = found.history
        k = np.round(100 * history.time_s).astype(int)
        attitude = wrap_pi(np.stack(euler_from_dcm(history.C_nb), axis=1) - rows[k, 7:10] * DEG)
        level = displacement_ned(
            history.lat_rad,
            history.lon_rad,
            lat0_rad=rows[k, 1] * DEG,
            lon0_rad=rows[k, 2] * DEG,
            height0_m=rows[k, 3],
        )
        assert np.abs(attitude[-20:, :2]).max() < 0.3 * DEG
        assert np.abs(attitude[-20:, 2]).max() < 2.0 * DEG
        assert np.abs(level[20:]).max() < 3.0
        sigma = level_sigmas(history.phi_covariance, history.C_nb)
        ratios.append(
            [
                np.mean((attitude[20:] / sigma[20:]) ** 2),
                np.mean(level[20:] ** 2 / history.variance[20:, :2]),
            ]
        )
        nis = history.nis[np.isfinite(history.nis[:, 0])].mean(axis=0) / 3
        assert (nis > 0.8).all() and (nis < 1.3).all()
    assert 0.1 < np.mean(ratios, axis=0)[0] < 3.0 and 0.3 < np.mean(ratios, axis=0)[1] < 3.0
