"""A log at rest as blocks of a minute: their noise, what is bumped, and Earth rate in them."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from infield.thermal.ramp_runs import ramp_run
from ins.earth import EARTH_RATE_RAD_S
from ins.records import Survey
from ins.units import DEG, DEG_PER_HOUR
from tests.infield.azimuth_cases import SITE, TWIN, simulated
from trajectories.simulator.segments import Park

HEADING_DEG = 30.0
EARTH_deg_h = EARTH_RATE_RAD_S / DEG_PER_HOUR
NORTH_deg_h = EARTH_deg_h * np.cos(SITE.lat_rad)
TEN_UG = 1e-5  # the least tilt that accelerometers are trusted with [rad]


@lru_cache(maxsize=1)
def made():
    return simulated((Park(duration_s=3600.0),), HEADING_DEG)


def parked():
    return made().run


def surveyed(sigma_rad):
    survey = Survey(heading_rad=HEADING_DEG * DEG, sigma_heading_rad=sigma_rad)
    return replace(parked(), header=replace(parked().header, survey=survey))


def test_the_noise_of_a_block_is_the_random_walk_of_a_minute():
    found = ramp_run(parked(), TWIN)
    assert found.time_s.size == 60 and found.excluded == ()
    walk = TWIN.gyro.arw_deg_sqrt_h / np.sqrt(1.0 / 60.0)
    assert found.sigma_deg_h == pytest.approx(walk, rel=0.25)  # of 360 sums: known to 6 %
    scatter = np.std(np.diff(found.bias_deg_h, axis=0), axis=0) / np.sqrt(2.0)
    assert found.sigma_deg_h == pytest.approx(scatter, rel=0.4)


def test_a_bump_is_left_out_and_moves_no_block():
    imu = parked().imu.whole()
    knocked = np.array(imu.dtheta_rad)
    row = int(np.searchsorted(imu.time_s, 1805.0))
    knocked[row, 1] += 2e-5  # 0.07 deg/h of a minute
    found = ramp_run(replace(parked(), imu=replace(imu, dtheta_rad=knocked)), TWIN)
    (span,) = found.excluded
    assert span.start_s <= 1805.0 <= span.end_s and span.end_s - span.start_s < 21.0
    assert found.bias_deg_h == pytest.approx(
        ramp_run(parked(), TWIN).bias_deg_h, abs=4 * found.sigma_deg_h.max()
    )


def test_a_surveyed_heading_leaves_the_biases_of_the_unit():
    known, unknown = ramp_run(surveyed(1e-3), TWIN), ramp_run(parked(), TWIN)
    true = made().gyro_bias_true_deg_h.mean(axis=0)
    # misaligned by 0.3 mrad, which Earth rate makes 0.005 deg/h of
    assert known.bias_deg_h.mean(axis=0) == pytest.approx(true, abs=0.01)
    along = NORTH_deg_h * np.array([np.cos(HEADING_DEG * DEG), -np.sin(HEADING_DEG * DEG)])
    left = (unknown.bias_deg_h - known.bias_deg_h).mean(axis=0)
    assert left[:2] == pytest.approx(along, abs=0.05) and abs(left[2]) < 0.05


def test_what_earth_rate_may_have_left_is_in_the_sigma_of_the_level():
    free, rough, sure = (ramp_run(r, TWIN) for r in (parked(), surveyed(1e-3), surveyed(1e-9)))
    # anywhere in the horizontal plane: 1 / sqrt(2) RMS; a vertical axis has the tilt's share
    tilt = np.hypot(*free.roll_pitch_rad)
    assert free.level_sigma_deg_h[:2] == pytest.approx(NORTH_deg_h / np.sqrt(2), rel=1e-3)
    assert free.level_sigma_deg_h[2] == pytest.approx(NORTH_deg_h * tilt / np.sqrt(2), rel=0.02)
    across = NORTH_deg_h * 1e-3 * np.array([np.sin(HEADING_DEG * DEG), np.cos(HEADING_DEG * DEG)])
    assert rough.level_sigma_deg_h[:2] == pytest.approx(across, rel=0.01)
    assert sure.level_sigma_deg_h == pytest.approx(EARTH_deg_h * TEN_UG, rel=0.01)
