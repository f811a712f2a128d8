"""Lever arm, delay and slow errors of the fixes: found where they are wrong, left where they are
right, said where unseen.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from infield.aided.antenna import antenna_sigmas
from infield.aided.flight import navigate_aided
from infield.reports.documents.aided import aided_document
from infield.session.log import find_rest
from ins.records import Run
from ins.verdicts import codes, sentences
from tests.infield.aided_cases import LEVER_M, SITE, flown, gauss_markov, ideal, normalised, twin_of
from trajectories.simulator.segments import Straight

PARK_S = 180.0


def fly(made, technology: str, run: Run | None = None, **header):
    run = run or made.run
    run = replace(run, header=replace(run.header, **header))
    rest = find_rest(run) if technology == "rlg" else None
    return navigate_aided(run, run.imu, twin_of(technology), rest=rest, gyro_sigma_deg_h=None)


def late(run: Run, seconds: float) -> Run:
    return replace(run, gnss=replace(run.gnss, time_s=run.gnss.time_s + seconds))


def off_of(antenna, delay_s: float) -> np.ndarray:
    """Errors of a found antenna over their sigmas (5,)."""
    off = [
        *(antenna.lever_arm_m - LEVER_M),
        antenna.delay_s - delay_s,
        antenna.velocity_delay_s - delay_s,
    ]
    return np.asarray(off) / antenna_sigmas(antenna)


def slow_error(run: Run, seed: int, sigma_m: float, time_s: float) -> Run:
    """The run with a Gauss-Markov error on its positions."""
    gnss = run.gnss
    e = gauss_markov(gnss.time_s, np.random.default_rng([seed, 78]), sigma_m, time_s)
    lat = gnss.lat_rad + e[:, 0] / 6.37e6
    lon = gnss.lon_rad + e[:, 1] / 6.37e6 / np.cos(SITE.lat_rad)
    return replace(
        run, gnss=replace(gnss, lat_rad=lat, lon_rad=lon, height_m=gnss.height_m - e[:, 2])
    )


@pytest.mark.parametrize("flights", [3, pytest.param(6, marks=pytest.mark.slow)])
@pytest.mark.parametrize("technology", ["mems", pytest.param("rlg", marks=pytest.mark.slow)])
def test_wrong_lever_arm_is_found_and_its_sigma_is_the_solutions(technology, flights):
    """The arm is 4 m wrong in a random direction: taken, within its sigma, no factor on the noise,
    errors within sigmas.
    """
    found, errors_arm, ratios = [], [], []
    for seed in range(flights):
        made = flown(ideal(PARK_S), twin_of(technology), seed)
        off = np.random.default_rng([seed, 77]).standard_normal(3)
        wrong = np.array(LEVER_M) + 4.0 * off / np.linalg.norm(off)
        result = fly(made, technology, gnss_lever_arm_m=tuple(wrong))
        found.append((result.verdict, result.antenna.freed.arm, result.scales.fitted))
        antenna = result.antenna.antenna
        errors_arm.append((antenna.lever_arm_m - LEVER_M) / antenna_sigmas(antenna)[:3])
        ratios.append(normalised(made, result.history, 200 if technology == "rlg" else 60))
        assert "lever_arm_taken" in codes(result.notes)[0] and result.antenna.gain_nats > 50.0
        assert not aided_document(result, None).consistency.is_test
    assert found == [("aided", True, False)] * flights
    assert np.sum(np.square(errors_arm)) < chi2.isf(5e-4, 3 * flights)
    mean = np.mean(ratios, axis=0)
    assert (mean > 0.2).all() and (mean < 2.0).all()


@pytest.mark.parametrize("flights", [5, pytest.param(15, marks=pytest.mark.slow)])
@pytest.mark.parametrize("technology", ["mems", pytest.param("rlg", marks=pytest.mark.slow)])
def test_right_antenna_and_white_receiver_are_left_alone(technology, flights):
    """Flights with the default flicker: nothing taken, nothing fitted; what the fixes show
    of the arm is the arm.
    """
    shown = []
    for seed in range(flights):
        made = flown(ideal(PARK_S), twin_of(technology), 100 + seed)
        result = fly(made, technology)
        assert result.antenna.freed == (False, False)
        assert not result.scales.fitted
        assert result.notes == ()
        seen = result.antenna.seen
        shown.append(off_of(seen, 0.0))
    assert np.mean(np.square(shown)) < 2.0 and antenna_sigmas(seen)[:3].max() < 0.4


def test_arm_and_delay_wrong_at_once_and_a_clock_that_is_early():
    made = flown(ideal(PARK_S), twin_of("mems"), 3)
    result = fly(made, "mems", late(made.run, 0.12), gnss_lever_arm_m=(0.5, 0.5, -1.0))
    antenna = result.antenna.antenna
    assert result.antenna.freed == (True, True) and len(result.notes) == 2
    assert np.abs(off_of(antenna, 0.12)).max() < 3.0
    early = fly(made, "mems", late(made.run, -0.08))
    assert early.antenna.freed == (False, True) and "younger" in sentences(early.notes)[0]
    assert early.antenna.antenna.delay_s == pytest.approx(-0.08, abs=0.03)


def test_straight_drive_does_not_show_the_arm_and_says_so():
    """At one heading the arm is an offset of the position: not seen, its sigma stays the prior's,
    nothing is taken.
    """
    base = ideal(60.0, (Straight(duration_s=200.0, speed_m_s=15.0),))
    made = flown(base, twin_of("rlg"), 2)
    result = fly(made, "rlg", gnss_lever_arm_m=(4.0, -0.5, -1.0))
    assert result.verdict == "aided" and result.antenna.freed == (False, False)
    assert antenna_sigmas(result.antenna.seen)[:3].min() > 0.5


@pytest.mark.parametrize(
    ("technology", "sigma_m", "flights"),
    [
        pytest.param("mems", 0.5, 4, marks=pytest.mark.slow),
        pytest.param("rlg", 2.0, 4, marks=pytest.mark.slow),
    ],
)
def test_slow_error_of_the_receiver_is_found_and_widens_the_position(technology, sigma_m, flights):
    """As large as the fixes' sigma and four times: without it the squared position error was 10 and
    70 times its variance.
    """
    ratios = []
    for seed in range(flights):
        made = flown(ideal(PARK_S), twin_of(technology), seed)
        result = fly(made, technology, slow_error(made.run, seed, sigma_m, 100.0))
        scales = result.scales
        assert scales.slow * 0.5 == pytest.approx(sigma_m, rel=0.6)
        assert scales.white <= 4.0
        assert scales.walk == 1.0
        assert result.antenna.freed == (False, False) and "slow error" in sentences(result.notes)[0]
        ratios.append(normalised(made, result.history, 200 if technology == "rlg" else 60)[0])
    assert 0.05 < np.mean(ratios) < 2.0
