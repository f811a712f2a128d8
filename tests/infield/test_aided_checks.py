"""Logs that speak against themselves or their header in aided replay: said, left out, or
`inconsistent`.
"""

from dataclasses import replace

import numpy as np
import pytest

from infield.aided.antenna import NOTHING_FREED, antenna_sigmas
from infield.aided.flight import navigate_aided
from infield.reports.words.sentences import sentences
from infield.session.log import find_rest
from ins.records import Run, Site
from ins.units import MICRO_G
from tests.infield.aided_cases import (
    SITE,
    errors,
    flown,
    gauss_markov,
    ideal,
    late_velocities,
    normalised,
    twin_of,
)

PARK_S = 180.0


def fly(run: Run, technology: str):
    rest = find_rest(run) if technology == "rlg" else None
    return navigate_aided(run, run.imu, twin_of(technology), rest=rest, gyro_sigma_deg_h=None)


def turned(run: Run, C: np.ndarray, lever_arm_m=(0.0, 0.0, 0.0)) -> Run:
    """The run of a unit whose axes are C of the vehicle's."""
    imu = replace(run.imu, dtheta_rad=run.imu.dtheta_rad @ C.T, dv_m_s=run.imu.dv_m_s @ C.T)
    arm = tuple(float(v) for v in C @ np.asarray(run.header.gnss_lever_arm_m))
    return replace(run, imu=imu, header=replace(run.header, gnss_lever_arm_m=arm))


def correlated(run: Run, seed: int, sigma_m_s: float, time_s: float) -> Run:
    """The run with a Gauss-Markov error on its velocities beside the white one."""
    gnss = run.gnss
    e = gauss_markov(gnss.time_s, np.random.default_rng([seed, 79]), sigma_m_s, time_s)
    return replace(run, gnss=replace(gnss, v_n_m_s=gnss.v_n_m_s + e))


@pytest.mark.parametrize(
    ("technology", "flights"),
    [
        pytest.param("mems", 4, marks=pytest.mark.slow),
        pytest.param("rlg", 4, marks=pytest.mark.slow),
    ],
)
def test_correlated_velocities_are_found_and_in_the_sigmas(technology, flights):
    """0.1 m/s over 6 s on velocities of 0.03 m/s: white noise alone left velocity errors of three
    sigmas and more.
    """
    ratios = []
    for seed in range(flights):
        made = flown(ideal(PARK_S), twin_of(technology), 400 + seed)
        found = fly(correlated(made.run, seed, 0.1, 6.0), technology)
        assert found.verdict == "aided" and found.scales.slow_velocity > 1.0
        assert "slow error of the velocities" in sentences(found.notes)[-1]
        ratios.append(normalised(made, found.history, 200))
    assert (np.mean(ratios, axis=0) < 1.8).all()


def test_velocities_older_than_positions_are_told_apart():
    """A receiver whose velocity is 0.4 s late and whose position is not: no lever arm is made of
    it.
    """
    made = flown(ideal(PARK_S), twin_of("rlg"), 7)
    gnss = made.run.gnss
    late = replace(gnss, v_n_m_s=late_velocities(made, gnss.time_s, gnss.v_n_m_s, 0.4))
    found = fly(replace(made.run, gnss=late), "rlg")
    antenna = found.antenna.antenna
    assert found.antenna.freed == (False, True) and "velocities are 40" in sentences(found.notes)[0]
    off = np.array([antenna.delay_s, antenna.velocity_delay_s - 0.4]) / antenna_sigmas(antenna)[3:]
    assert np.abs(off).max() < 3.0
    assert (
        np.mean(errors(made, found.history)[200:, :3] ** 2 / found.history.variance[200:, :3]) < 2.0
    )


def test_left_handed_units_are_inconsistent():
    made = flown(ideal(PARK_S), twin_of("mems"), 3)
    mirrored = fly(turned(made.run, np.diag([1.0, -1.0, 1.0])), "mems")
    assert mirrored.verdict in ("inconsistent", "refused")


@pytest.mark.slow
def test_units_of_a_wrong_scale_are_inconsistent():
    made = flown(ideal(PARK_S), twin_of("rlg"), 3)
    scaled = replace(made.run, imu=replace(made.run.imu, dtheta_rad=1.01 * made.run.imu.dtheta_rad))
    found = fly(scaled, "rlg")
    assert found.verdict == "inconsistent" and any(
        "scale factor" in reason for reason in sentences(found.reasons)
    )


@pytest.mark.parametrize("flights", [1, pytest.param(8, marks=pytest.mark.slow)])
def test_shaken_accelerometers_make_no_gyro_noise(flights):
    """White noise of 32 times the declared on the accelerometers alone: found there, and the gyros
    keep theirs; with one factor for both, attitudes walked 8 times as far as they do. Errors are
    those of the sigmas.
    """
    ratios = []
    for seed in range(flights):
        made = flown(ideal(PARK_S), twin_of("mems"), 60 + seed)
        imu = made.run.imu
        density = 32.0 * twin_of("mems").accel.vrw_ug_sqrt_hz * MICRO_G
        shake = np.random.default_rng([seed, 61]).standard_normal(imu.dv_m_s.shape)
        dv = imu.dv_m_s + density * np.sqrt(imu.dt_s)[:, None] * shake
        header = replace(made.run.header, gyro_technology="mems")
        found = fly(replace(made.run, imu=replace(imu, dv_m_s=dv), header=header), "mems")
        assert found.verdict == "aided" and found.scales.white <= 4.0
        assert 8.0 <= found.scales.accel_white <= 128.0
        assert "white noise of the accelerometers" in sentences(found.notes)[-1]
        ratios.append(normalised(made, found.history, 60))
    assert (np.mean(ratios, axis=0) > 0.3).all() and (np.mean(ratios, axis=0) < 2.0).all()


@pytest.mark.slow
def test_shaken_accelerometers_make_no_delay():
    """White noise of 128 times the declared on the accelerometers: the fixes are as late as they
    say. With each step's own acceleration as what a delay is seen by, the noise of the
    accelerometers in the velocities was taken for one of 95 +- 9 ms, and positions were off by 6
    sigmas.
    """
    made = flown(ideal(PARK_S), twin_of("mems"), 60)
    imu = made.run.imu
    density = 128.0 * twin_of("mems").accel.vrw_ug_sqrt_hz * MICRO_G
    shake = np.random.default_rng([0, 61]).standard_normal(imu.dv_m_s.shape)
    dv = imu.dv_m_s + density * np.sqrt(imu.dt_s)[:, None] * shake
    header = replace(made.run.header, gyro_technology="mems")
    found = fly(replace(made.run, imu=replace(imu, dv_m_s=dv), header=header), "mems")
    assert found.antenna.freed == NOTHING_FREED
    assert (normalised(made, found.history, 60) < 4.0).all()


def test_unit_turned_about_the_vertical_is_told():
    made = flown(ideal(PARK_S), twin_of("mems"), 2)
    assert not any("off the track" in note for note in sentences(fly(made.run, "mems").notes))
    # body x to the left: heading - track = -90
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    notes = sentences(fly(turned(made.run, quarter), "mems").notes)
    assert any("-90 deg off the track" in note for note in notes)


def test_site_elsewhere_is_told():
    made = flown(ideal(PARK_S), twin_of("mems"), 2)
    away = Site(lat_rad=SITE.lat_rad + 500.0 / 6.37e6, lon_rad=SITE.lon_rad, height_m=SITE.height_m)
    notes = sentences(
        fly(replace(made.run, header=replace(made.run.header, site=away)), "mems").notes
    )
    assert [note for note in notes if "from the site of run.json" in note and "50" in note]


def test_stuck_receiver_is_left_out():
    """Thirty seconds of the same fix at speed: rejected for long, it used to be taken for a new
    start.
    """
    made = flown(ideal(PARK_S), twin_of("mems"), 5)
    gnss = made.run.gnss
    held = np.where(
        (gnss.time_s > 420.0) & (gnss.time_s <= 450.0),
        np.searchsorted(gnss.time_s, 420.0 + 1e-6) - 1,
        np.arange(gnss.time_s.size),
    )
    stuck = replace(
        gnss,
        lat_rad=gnss.lat_rad[held],
        lon_rad=gnss.lon_rad[held],
        height_m=gnss.height_m[held],
        v_n_m_s=gnss.v_n_m_s[held],
    )
    found = fly(replace(made.run, gnss=stuck), "mems")
    assert (
        found.verdict == "aided"
        and "30 fixes from 421.0 to 450.0 s are left out" in sentences(found.notes)[0]
    )
    assert (
        np.mean(errors(made, found.history)[60:, :3] ** 2 / found.history.variance[60:, :3]) < 2.0
    )
