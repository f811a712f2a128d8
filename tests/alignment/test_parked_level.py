"""Motion of a parked vehicle as noise with a level: found where it is, honest, and free of charge
where there is none.

Truth is `tests.alignment.rough_parking` (pyins): tilt steps of people, doors that ring, gusts as a
damped resonance with a slow part; none of it has the form that is fitted (white, walk, strays).
"""

import numpy as np
import pytest
from scipy.stats import chi2

from alignment import gyrocompass, level_fit
from alignment.motion import kinds, level
from alignment.motion.kinds import Disturbance
from alignment.motion.stillness import Motion
from alignment.reasons import WITH_HEADING
from ins.attitude import wrap_pi
from ins.twin_file import default_twin
from tests.alignment.rough_parking import ABOARD, QUIET, parked

TWIN = default_twin("rlg")
SIGMA_DEG_H = np.full(3, 0.01)


def aligned(seed, seconds, rough, **options):
    log = parked(np.random.default_rng([seed, 2026]), seconds, rough, **options)
    return log, gyrocompass.align(log.imu, log.site, TWIN, bias_sigma_deg_h=SIGMA_DEG_H)


def heading_error_rad(log, result):
    row = int(np.argmin(np.abs(log.imu.time_s - result.time_s)))
    return float(wrap_pi(result.heading_rad - log.heading_rad[row]))


@pytest.mark.parametrize("runs", [12, pytest.param(100, marks=pytest.mark.slow)])
def test_two_minutes_with_people_on_board_end_in_an_honest_heading(runs):
    """At least 90 % have a heading; squared error over variance within its 99.9 % band, sigma at
    most twice that of the same two minutes without anybody.
    """
    logs = [aligned(seed, 120.0, ABOARD) for seed in range(runs)]
    found = [(log, result) for log, result in logs if result.verdict in WITH_HEADING]
    assert len(found) >= 0.9 * runs
    z = [heading_error_rad(log, result) / result.sigma_heading_rad for log, result in found]
    assert chi2.ppf(0.0005, len(z)) < np.sum(np.square(z)) < chi2.ppf(0.9995, len(z))
    calm = aligned(0, 120.0, QUIET)[1]
    assert np.median([r.sigma_heading_rad for _, r in found]) < 2.0 * calm.sigma_heading_rad
    assert all(result.used_share > 0.9 for _, result in found)


def test_quiet_data_pay_nothing():
    """The level costs a calm vehicle less than 2 % of its heading's sigma."""
    for seed in range(3):
        result = aligned(seed, 600.0, QUIET)[1]
        assert result.level.sigma_cost < 1.02
        assert result.level.unit_noise == 1.0


def test_innovations_alike_for_several_steps_say_as_much_as_one():
    """White innovations count each; those of a first-order process with correlation 0.8 count as
    1 + 2 (0.8 + 0.64 + ...) = 9 together, of which the lags above 0.25 are summed.
    """
    rng = np.random.default_rng(1)
    white = rng.standard_normal((400, 1))
    assert level_fit._alike(white) == 1.0
    slow = np.zeros((4000, 1))
    for k in range(1, 4000):
        slow[k] = 0.8 * slow[k - 1] + 0.6 * rng.standard_normal()
    expected = 1.0 + 2.0 * sum(0.8**lag for lag in range(1, 7))
    assert level_fit._alike(slow) == pytest.approx(expected, rel=0.2)
    assert level_fit._alike(slow[:5]) == 1.0


def motion_of(kind, cause):
    n = len(kind)
    return Motion(np.arange(n, dtype=float), np.array(kind), np.zeros(n), 0.001, np.array(cause))


def test_shakes_are_absorbed_but_pushes_and_faults_are_not(monkeypatch):
    monkeypatch.setattr(level, "_sways", lambda *_: False)
    monkeypatch.setattr(level, "_stays", lambda *_: False)
    n = 60
    for cause, after in (
        (Disturbance.BUMP, kinds.STILL),
        (Disturbance.LOADING, kinds.STILL),
        (Disturbance.GUST, kinds.STILL),
        (Disturbance.PUSH, kinds.DISTURBED),
        (Disturbance.CLIPPING, kinds.DISTURBED),
    ):
        kind, causes = [kinds.STILL] * n, [""] * n
        kind[20:30] = [kinds.DISTURBED] * 10
        causes[20:30] = [cause] * 10
        assert (level.standing(None, motion_of(kind, causes)).kind[20:30] == after).all(), cause


def test_what_shakes_beside_rolling_is_its_start_or_stop(monkeypatch):
    monkeypatch.setattr(level, "_sways", lambda *_: False)
    monkeypatch.setattr(level, "_stays", lambda *_: False)
    kind, causes = [kinds.STILL] * 60, [""] * 60
    kind[20:30], causes[20:30] = [kinds.DISTURBED] * 10, [Disturbance.MOTION] * 10
    kind[30:60] = [kinds.ROLLING] * 30
    found = level.standing(None, motion_of(kind, causes)).kind[20:30]
    assert (found[-5:] == kinds.DISTURBED).all() and (found[:3] == kinds.STILL).all()
