"""The first parked stretch of a log by its raw seconds: found in a flight, cut where the unit is
turned, blind to a warm-up.
"""

import numpy as np
import pytest

from alignment.motion import inertial
from alignment.motion import parked_seconds as by_seconds
from alignment.motion.kinds import DISTURBED, STILL
from alignment.motion.seconds import seconds_of
from ins.records import ImuLog
from ins.units import DEG_PER_HOUR

RATE_HZ = 20.0
ARW_RAD_SQRT_S = 0.3 * np.pi / 180.0 / 60.0
VRW_M_S_SQRT_S = 100e-6 * 9.81


def log(
    seconds, rng, *, drift_deg_h_s=(0.0, 0.0, 0.0), bias_deg_h=(300.0, -800.0, 50.0), edit=None
):
    """A resting unit with a bias that drifts by so much each second; `edit` changes rates (n, 3)
    and forces (n, 3).
    """
    t = (1 + np.arange(int(seconds * RATE_HZ))) / RATE_HZ
    rate = (np.array(bias_deg_h) + np.outer(t, drift_deg_h_s)) * DEG_PER_HOUR
    force = np.tile([0.1, -0.2, -9.8], (t.size, 1))
    if edit is not None:
        edit(t, rate, force)
    dt = 1.0 / RATE_HZ
    return ImuLog(
        time_s=t,
        dt_s=np.full(t.size, dt),
        source="test",
        dtheta_rad=rate * dt + ARW_RAD_SQRT_S * np.sqrt(dt) * rng.standard_normal((t.size, 3)),
        dv_m_s=force * dt + VRW_M_S_SQRT_S * np.sqrt(dt) * rng.standard_normal((t.size, 3)),
    )


def quiet_stretches(imu, start_s, end_s):
    return inertial.quiet_stretches(seconds_of(imu).between(start_s, end_s))


def parked_seconds(imu, start_s, end_s):
    return by_seconds.parked_seconds(seconds_of(imu), start_s, end_s)


def shaken(t, rate, force):
    """At rest from 100 to 400 s only."""
    moving = (t < 100) | (t > 400)
    wave = np.sin(2 * np.pi * 0.7 * t[moving])
    rate[moving] += 0.02 * wave[:, None]
    force[moving] += 0.5 * wave[:, None]


def test_the_rest_is_found_between_motion():
    imu = log(600, np.random.default_rng(1), edit=shaken)
    start, end = quiet_stretches(imu, 0.0, 600.0)[0]
    assert start == pytest.approx(100, abs=12) and end == pytest.approx(400, abs=12)
    seconds = parked_seconds(imu, start, end)
    assert seconds.still.mean() > 0.9 and seconds.moved == ""
    mean, used = seconds.means(-np.inf, np.inf)
    assert used == pytest.approx(seconds.still.sum(), abs=1)
    limit = 5 * ARW_RAD_SQRT_S / np.sqrt(used)
    assert np.abs(mean[3:] - np.array([300.0, -800.0, 50.0]) * DEG_PER_HOUR).max() < limit


def test_a_warm_up_of_a_consumer_unit_is_rest():
    """600 deg/h in 160 s, as the real log apm_fixedwing_TestLog2 shows, is no motion."""
    imu = log(400, np.random.default_rng(2), drift_deg_h_s=(3.3, 4.6, 2.8))
    assert quiet_stretches(imu, 0.0, 400.0)[0] == pytest.approx((0.0, 400.0), abs=3)
    assert parked_seconds(imu, 0.0, 400.0).still.mean() > 0.97


def test_the_noise_is_read_off_the_log():
    seconds = parked_seconds(log(600, np.random.default_rng(3)), 0.0, 600.0)
    assert seconds.walk() == pytest.approx([ARW_RAD_SQRT_S] * 3, rel=0.12)


@pytest.mark.parametrize(("angle_rad", "ends"), [(0.3, True), (0.002, False)])
def test_a_turn_to_another_heading_ends_the_stretch(angle_rad, ends):
    def turned(t, rate, force):
        rate[(t > 200) & (t <= 202), 2] += angle_rad / 2.0

    seconds = parked_seconds(log(400, np.random.default_rng(4), edit=turned), 0.0, 400.0)
    assert (seconds.end_s[-1] < 201.5) == ends
    assert ("stands elsewhere" in seconds.moved) == ends
    kind = seconds.motion.kind
    assert (kind == STILL).sum() > 150 and ((kind == DISTURBED).any() or ends)


def test_a_tilt_ends_it_too():
    def tilted(t, rate, force):
        late = t > 250
        force[late] = [0.1, -0.2 - 9.8 * np.sin(0.1), -9.8 * np.cos(0.1)]
        rate[(t > 249.5) & late & (t <= 250.5), 0] += 0.1 / 0.5

    seconds = parked_seconds(log(400, np.random.default_rng(5), edit=tilted), 0.0, 400.0)
    assert seconds.end_s[-1] < 251 and "tilted by 0.1" in seconds.moved


def test_bumps_are_left_out():
    def bumped(t, rate, force):
        force[(t > 120) & (t <= 120.2), 1] += 1.0
        force[(t > 300) & (t <= 300.2), 0] -= 2.0

    seconds = parked_seconds(log(400, np.random.default_rng(6), edit=bumped), 0.0, 400.0)
    out = seconds.end_s[~seconds.still]
    assert np.any(np.abs(out - 121) < 1) and np.any(np.abs(out - 301) < 1) and out.size < 25


def test_what_never_rests_is_none():
    rng = np.random.default_rng(7)

    def flying(t, rate, force):
        rate += 0.1 * np.cumsum(rng.standard_normal((t.size, 3)), axis=0) / np.sqrt(t.size)
        force += 1.5 * rng.standard_normal((t.size, 3)) * np.sqrt(RATE_HZ)

    assert quiet_stretches(log(300, rng, edit=flying), 0.0, 300.0) == ()
    assert quiet_stretches(log(30, rng), 0.0, 30.0) == ()
