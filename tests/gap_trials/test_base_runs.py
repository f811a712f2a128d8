"""Runs without effect, from both sources: noise as declared, truth that agrees with other authors,
taxis as planned.
"""

import numpy as np
import pytest

from benchmarks.gap_trials import outside
from benchmarks.gap_trials.processes import flicker
from benchmarks.gap_trials.seen import turned_back
from ins.earth import gravity_magnitude, omega_ie_n
from ins.records import ImuLog, NavState, Site
from ins.strapdown.mechanization import navigate
from ins.units import DEG_PER_HOUR, MICRO_G
from tests.gap_trials.cases import SHORT_S


def residuals(trial, number):
    """Parked rows less Earth rate, gravity and the table: gyro [deg/h], accel [micro-g], (n, 3)."""
    seen, run = trial.seen[number], trial.runs_without[number]
    parked = seen.time_s <= seen.taxi_s - 1.0
    earth_b = turned_back(seen.C_nb, omega_ie_n(seen.lat_rad))
    table = np.stack(
        [
            np.interp(
                seen.gyro_degC[:, k],
                trial.table["axes"][a]["temperature_degC"],
                trial.table["axes"][a]["bias_deg_h"],
            )
            for k, a in enumerate("xyz")
        ],
        axis=-1,
    )
    gyro = (run.imu.dtheta_rad / seen.dt_s - earth_b) / DEG_PER_HOUR - table
    down = np.array([0.0, 0.0, -1.0]) * gravity_magnitude(seen.lat_rad, seen.height_m)[:, None]
    accel = (run.imu.dv_m_s / seen.dt_s - turned_back(seen.C_nb, down)) / MICRO_G
    return gyro[parked], accel[parked]


def allan_variance(rows, count):
    """Of means over `count` rows, not overlapping; (axes,), and how many differences went in."""
    means = rows[: len(rows) // count * count].reshape(-1, count, rows.shape[1]).mean(axis=1)
    return 0.5 * np.mean(np.diff(means, axis=0) ** 2, axis=0), len(means) - 1


def test_parked_gyros_have_the_declared_noise(parked):
    """Allan variance N^2 / tau at 1 and 10 s (flicker adds 0.1 %), slope -1/2 of the deviation, on
    x and y.

    On z the creep of the heading adds its own walk of angle: 0.00083 to 0.002 deg/sqrt(h).
    """
    gyro = [residuals(parked, k)[0] for k in range(4)]
    angle_walks = np.array(
        [parked.twin.gyro.arw_deg_sqrt_h, parked.twin.vehicle.yaw_creep_arcsec_sqrt_h / 3600.0]
    )
    per_hour = np.sqrt(angle_walks[0] ** 2 + np.array([0, 0, 1]) * angle_walks[1] ** 2) * 60.0
    found = {}
    for count, tau_s in ((10, 1.0), (100, 10.0)):
        values, numbers = zip(*(allan_variance(rows, count) for rows in gyro))
        found[count] = np.mean(values, axis=0)
        expected = (
            per_hour**2 / tau_s + 2 * np.log(2) / np.pi * parked.twin.gyro.bias_instability_deg_h**2
        )
        # relative, non-overlapping Allan variance of white noise
        spread = np.sqrt(3.0 / sum(numbers))
        assert found[count] == pytest.approx(expected, rel=4 * spread)
    assert np.log10(found[100] / found[10]) / 2 == pytest.approx([-0.5] * 3, abs=0.04)
    means = np.array([rows.mean(axis=0) for rows in gyro])
    assert np.abs(means).max() < 5 * 0.006  # turn-on 0.003, flicker and walk: no table error left


def test_parked_accelerometers_have_the_declared_noise(parked):
    """z: white; x and y: sway of an oscillator, increments of variance 2 rms^2 (1 - rho(dt)), and
    white.
    """
    accel = [residuals(parked, k)[1] for k in range(4)]
    seen, twin = parked.seen[0], parked.twin
    white = twin.accel.vrw_ug_sqrt_hz**2 / seen.dt_s
    w, z = 2 * np.pi * twin.vehicle.sway_hz, twin.vehicle.sway_damping
    wd = w * np.sqrt(1 - z**2)
    rho = np.exp(-z * w * seen.dt_s) * (
        np.cos(wd * seen.dt_s) - z * w / wd * np.sin(wd * seen.dt_s)
    )
    sway = 2 * twin.vehicle.sway_m_s**2 * (1 - rho) / (seen.dt_s * MICRO_G) ** 2
    variance = np.mean([rows[1:].var(axis=0) for rows in accel], axis=0)
    assert variance[2] == pytest.approx(white, rel=0.03)
    assert variance[:2] == pytest.approx(white + sway, rel=0.05)
    slow = np.mean([allan_variance(rows, 100)[0] for rows in accel], axis=0)
    assert slow[2] == pytest.approx(twin.accel.vrw_ug_sqrt_hz**2 / 10.0, rel=0.2)


def test_slow_noise_has_its_spectrum():
    """The flicker of the trials: PSD B^2 / (2 pi f) over a decade and a half, by averaged
    periodograms.
    """
    rng, n, dt = np.random.default_rng(1), 2**13, 0.1
    x = np.stack([flicker(rng, n, instability=2.0, dt_s=dt) for _ in range(60)])
    window = np.hanning(n)
    spectra = np.abs(np.fft.rfft((x - x.mean(axis=1, keepdims=True)) * window)) ** 2
    power = spectra.mean(axis=0) * dt / np.sum(window**2)
    f = np.fft.rfftfreq(n, dt)
    for low, high in ((0.02, 0.06), (0.06, 0.2), (0.2, 0.6)):
        band = (f >= low) & (f < high)
        assert np.mean(power[band] * f[band]) == pytest.approx(2.0**2 / (2 * np.pi), rel=0.08)


def test_pyins_and_trajectories_agree_on_a_parked_unit():
    """Two authors' increments of one attitude: 1e-6 deg/h, 0.3 micro-g (pyins has gravity to first
    order in height).
    """
    path = outside.ideal_path(90.0, 1, SHORT_S, False)
    earth_b = turned_back(path.C_nb, omega_ie_n(path.lat_rad)) * outside.DT_S
    down_b = turned_back(
        path.C_nb,
        np.array([0.0, 0.0, 1.0]) * gravity_magnitude(path.lat_rad, path.height_m)[:, None],
    )
    assert np.mean(
        path.dtheta_rad - earth_b, axis=0
    ) / outside.DT_S / DEG_PER_HOUR == pytest.approx(np.zeros(3), abs=1e-6)
    assert np.mean(
        path.dv_m_s + down_b * outside.DT_S, axis=0
    ) / outside.DT_S / MICRO_G == pytest.approx(np.zeros(3), abs=0.3)


def test_increments_of_pyins_navigate_to_its_own_truth():
    """Ten minutes of taxi by our mechanization: 0.1 mm/s level, 2 mm/s in the free vertical."""
    path = outside.ideal_path(90.0, 1, SHORT_S, True)
    first = 2900
    rest = slice(first + 1, None)
    imu = ImuLog(
        time_s=path.time_s[rest],
        dt_s=np.full(path.time_s[rest].size, outside.DT_S),
        dtheta_rad=path.dtheta_rad[rest],
        dv_m_s=path.dv_m_s[rest],
    )
    site = Site(
        lat_rad=path.lat_rad[first], lon_rad=path.lon_rad[first], height_m=path.height_m[first]
    )
    start = NavState(
        time_s=path.time_s[first], site=site, v_n_m_s=path.v_n_m_s[first], C_nb=path.C_nb[first]
    )
    history = navigate(imu, start, epoch_s=1.0)
    rows = np.round(history.time_s / outside.DT_S).astype(int) - 1
    off = np.abs(history.v_n_m_s - path.v_n_m_s[rows]).max(axis=0)
    assert off[0] < 1e-4 and off[1] < 1e-4 and off[2] < 4e-3
