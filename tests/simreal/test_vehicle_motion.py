"""A parked vehicle that people move: its turns are no effect of a sensor."""

from dataclasses import replace

import numpy as np
import pytest

import recal
from ins.attitude import dcm_from_euler, dcm_from_rotation_vector, rotation_vector_from_dcm
from ins.earth import gravity_magnitude, omega_ie_n
from ins.errors.telemetry import Trace
from ins.records import ImuLog, Site
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, MICRO_G
from simreal.evidence.noise_model import ChannelNoise
from simreal.evidence.run_view import view_run
from simreal.evidence.seconds import Seconds
from simreal.evidence.vehicle_motion import BIN_S, bends_of, motion_of, to_the_end, turned_back
from simreal.evidence.whitened import RunEvidence
from simreal.inference.diagnosis import DiagnosisSettings, diagnose
from tests.infield import mems_sessions
from trajectories.simulator.environments.kinds import Environment

SITE = Site(lat_rad=45 * DEG, lon_rad=0.1, height_m=200.0)
N = 1800


def tilted():
    """Seconds of a vehicle that tilts by 200 arcsec and rocks, and its attitude at the end."""
    g = np.array([0.0, 0.0, -float(gravity_magnitude(SITE.lat_rad, SITE.height_m))])
    t = np.arange(2 * N + 1) * 0.5
    way = np.outer(t / N, [150.0, -200.0, 20.0]) + np.outer(np.sin(0.7 * t), [5.0, 3.0, 1.0])
    C_nb = dcm_from_euler(0.01, -0.02, 1.0) @ dcm_from_rotation_vector(way * ARCSEC)
    C_ib = dcm_from_rotation_vector(np.outer(t, omega_ie_n(SITE.lat_rad))) @ C_nb
    rate = rotation_vector_from_dcm(C_ib[:-1:2].transpose(0, 2, 1) @ C_ib[2::2])
    mean = np.hstack([rate, C_nb[1::2].transpose(0, 2, 1) @ g])
    end_s = 1.0 + np.arange(N)
    seconds = Seconds(end_s, mean, np.zeros((N, 6)), np.full(N, 10), 0.1, np.zeros(6, bool))
    return seconds, C_nb[-1]


def test_turns_of_the_vehicle_are_taken_out():
    seconds, C_end = tilted()
    about = dcm_from_rotation_vector(np.array([1e-3, -1e-3, 8e-3])) @ C_end
    still, C_nb = turned_back(seconds, (0.0, float(N)), about, SITE, finds_north=True)
    assert np.abs(rotation_vector_from_dcm(C_nb @ C_end.T)).max() < 1e-5
    # the middle of a second is not half its turn: 0.6 arcsec; the tilt is 250 arcsec
    assert np.ptp(still.mean[:, 3:], axis=0).max() < 4e-5
    known, _ = turned_back(seconds, (0.0, float(N)), C_end, SITE, finds_north=False)
    assert np.ptp(known.mean[:, 3:], axis=0).max() < 4e-5


def rolling(hz, arcsec, rate_hz=20):
    """Seconds of a vehicle that rolls so fast, its rows, and its attitude at the end."""
    g = np.array([0.0, 0.0, -float(gravity_magnitude(SITE.lat_rad, SITE.height_m))])
    t = np.arange(2 * 600 * rate_hz + 1) / (2.0 * rate_hz)
    C_nb = dcm_from_rotation_vector(
        np.outer(arcsec * ARCSEC * np.sin(2 * np.pi * hz * t), [1, 0, 0])
    )
    C_ib = dcm_from_rotation_vector(np.outer(t, omega_ie_n(SITE.lat_rad))) @ C_nb
    dtheta = rotation_vector_from_dcm(C_ib[:-1:2].transpose(0, 2, 1) @ C_ib[2::2])
    force = C_nb[1::2].transpose(0, 2, 1) @ g
    dt = np.full(len(dtheta), 1.0 / rate_hz)
    rows = ImuLog(time_s=t[2::2], dt_s=dt, dtheta_rad=dtheta, dv_m_s=force / rate_hz)
    mean = np.hstack([dtheta * rate_hz, force]).reshape(600, rate_hz, 6).mean(axis=1)
    flat = np.zeros((600, 6))
    seconds = Seconds(
        1.0 + np.arange(600), mean, flat, np.full(600, rate_hz), 0.05, np.zeros(6, bool)
    )
    return seconds, rows, C_nb[-1]


def test_a_roll_of_a_hertz_is_no_slow_tilt():
    """Half turns sample it once a second: 0.99 Hz would read as a period of 100 s."""
    seconds, rows, C_end = rolling(0.99, 40.0)

    def slow_ug(bends):
        at = (0.0, 600.0), C_end, SITE
        still, _ = turned_back(seconds, *at, finds_north=False, bends=bends)
        return float(np.ptp(still.mean[:, 4].reshape(-1, 20).mean(axis=1)) / MICRO_G)

    assert slow_ug(None) > 200.0
    assert slow_ug(bends_of(rows, seconds.end_s)) < 2.0


def test_means_of_a_rate_become_means_of_its_integral_to_the_end():
    rate = np.array([1.0, 2.0, 0.5])
    assert to_the_end(3) @ rate == pytest.approx(
        [BIN_S * (0.5 + 2.0 + 0.5), BIN_S * (1.0 + 0.5), BIN_S * 0.25]
    )


def test_how_a_place_and_a_heading_stray_is_read_off_the_means():
    rng = np.random.default_rng(4)
    bins, C_nb = 4000, np.eye(3)
    means = np.zeros((6, bins))
    noises = tuple(ChannelNoise(white=1e-14) for _ in range(6))
    means += 1e-7 / np.sqrt(BIN_S) * rng.standard_normal(means.shape)
    means[4] += np.diff(2e-3 * rng.standard_normal(bins + 1)) / BIN_S
    means[2] += np.diff(3e-6 * rng.standard_normal(bins + 1)) / BIN_S
    means[2] += 1e-6 * rng.standard_normal(bins)
    means[2, 77] += 1e-4
    found = motion_of(means, C_nb, SITE, noises)
    assert np.sqrt(found.jitter[4].mean()) == pytest.approx(2e-3, rel=0.05)
    assert np.median(found.white[2]) == pytest.approx(1e-12, rel=0.2)
    assert found.white[2, 77] > 25e-10 and not found.white[4].any()
    sigma = np.sqrt(np.diag(found.covariance(4)))
    assert np.median(sigma) == pytest.approx(np.sqrt(2.0) * 2e-3 / BIN_S, rel=0.1)


@pytest.fixture(scope="module")
def boarded():
    return {
        kind: recal.simulate("parked_only", seed=71, rate_hz=10, environments=[kind])
        for kind in ("boarding", "refuelling")
    }


def test_a_gyro_is_read_as_well_on_a_vehicle_that_moves(boarded):
    """The same constant, with the same sigma, as on a vehicle that stands."""
    quiet = recal.simulate("parked_only", seed=71, rate_hz=10)

    def read(made, moved):
        view = view_run(made.run, 0, made.table, made.twin, moved=moved)
        evidence = RunEvidence(replace(view, history=None), made.twin)
        rate = np.zeros((view.telemetry.n, 3))
        rate[:, 0] = DEG_PER_HOUR
        (column,) = evidence.whiten([Trace(gyro_rad_s=rate)]).T
        return column @ evidence.z / (column @ column), 1.0 / np.linalg.norm(column)

    value, sigma = read(quiet, False)
    for made in boarded.values():
        there, as_sure = read(made, True)
        assert as_sure == pytest.approx(sigma, rel=0.05)
        assert abs(there - value) < 0.3 * sigma


@pytest.mark.parametrize("kind", ["boarding", "refuelling"])
def test_people_on_board_are_no_effect_of_a_gyro(boarded, kind):
    made = boarded[kind]
    found = diagnose([made.run], made.twin, made.table, DiagnosisSettings(replicates=100))
    assert {c.effect for c in found.causes} <= {"table_aged"}
    assert not found.unexplained.present
    assert any("people" in note for note in found.notes)


def test_wind_on_a_unit_that_finds_no_north_is_no_noise_of_its_gyros():
    gusty = (Environment(kind="gusty", strength=2.0),)
    made = mems_sessions.session(3, heading_deg=30.0, environments=gusty)
    view = view_run(made.run, 0, None, mems_sessions.TWIN, moved=True)
    assert not view.motion.level.any() and np.median(view.motion.jitter[0]) > 0.0
    how = DiagnosisSettings(replicates=100)
    found = diagnose([made.run], mems_sessions.TWIN, mems_sessions.blank(), how)
    assert not {c.effect for c in found.causes if c.target.startswith("gyro")}
    assert any("wind" in note for note in found.notes)
