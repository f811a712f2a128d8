"""Aided replay of logs whose heading nothing shows at once: headings all round, weighed by what
they explain; surveyed headings.
"""

from dataclasses import replace

import numpy as np
import pytest

from infield.aided.flight import navigate_aided
from infield.aided.open_heading import mixed
from ins.attitude import dcm_from_rotation_vector, wrap_pi
from ins.records import Run, Survey
from ins.units import DEG
from ins.verdicts import codes, sentences
from tests.cut import cut_run
from tests.infield.aided_cases import errors, flown, ideal, normalised, twin_of
from trajectories.simulator.segments import Segment, Stop, Straight, Turn

PARK_S = 60.0
SLOW: tuple[Segment, ...] = (
    Straight(duration_s=50.0, speed_m_s=1.5),
    Turn(angle_deg=90.0, speed_m_s=1.5),
    Straight(duration_s=50.0, speed_m_s=1.5),
    Stop(duration_s=15.0),
    Turn(angle_deg=-60.0, speed_m_s=1.2),
    Stop(duration_s=15.0),
    Straight(duration_s=40.0, speed_m_s=1.5),
)


def slow(seed: int):
    """A vehicle that never goes faster than 1.5 m/s, at a heading of its own."""
    return flown(ideal(PARK_S, SLOW, heading_deg=(137.0 * seed) % 360), twin_of("mems"), 700 + seed)


def fly(run: Run):
    return navigate_aided(run, run.imu, twin_of("mems"), rest=None, gyro_sigma_deg_h=None)


def heading_ratios(made, found) -> tuple[float, float]:
    """Heading error over sigma at the start, as taken, and at the end."""
    error, sigma = errors(made, found.history)[:, 8], np.sqrt(found.history.variance[:, 8])
    return error[0] / found.found.sigma_heading_rad, error[-1] / sigma[-1]


@pytest.mark.parametrize("flights", [2, pytest.param(30, marks=pytest.mark.slow)])
def test_slow_vehicle_starts_where_its_log_begins(flights):
    """Never 2 m/s: refused before. Heading error over the start's sigma, which is three of those
    that were found, has RMS 0.15 to 0.8; at the end over the filter's own 0.5 to 1.5; none beyond
    three, and position, velocity and attitude are within their sigmas.
    """
    starts, ends, ratios = [], [], []
    for seed in range(flights):
        made = slow(seed)
        found = fly(made.run)
        assert found.verdict == "aided" and found.found.method == "several headings", found.reasons
        assert found.history.time_s[0] < 20.0
        start, end = heading_ratios(made, found)
        starts.append(start)
        ends.append(end)
        ratios.append(normalised(made, found.history, 60))
    assert np.abs(starts).max() < 1.5 and np.abs(ends).max() < 3.0
    assert 0.15 < np.sqrt(np.mean(np.square(starts))) < 0.8
    assert 0.4 < np.sqrt(np.mean(np.square(ends))) < 1.5
    assert (np.mean(ratios, axis=0) > 0.3).all() and (np.mean(ratios, axis=0) < 1.8).all()


def test_heading_by_parts_of_the_compass_does_not_matter():
    """The same slow drive in body axes turned by 123 deg about the vertical: the same attitude."""
    made = slow(1)
    C = dcm_from_rotation_vector(np.array([0.0, 0.0, 123.0 * DEG]))
    imu = made.run.imu
    arm = tuple(float(v) for v in C @ np.asarray(made.run.header.gnss_lever_arm_m))
    turned = replace(
        made.run,
        imu=replace(imu, dtheta_rad=imu.dtheta_rad @ C.T, dv_m_s=imu.dv_m_s @ C.T),
        header=replace(made.run.header, gnss_lever_arm_m=arm),
    )
    one, other = fly(made.run), fly(turned)
    C_one, C_other = one.history.C_nb[-1], other.history.C_nb[-1] @ C
    heading = [np.arctan2(c[1, 0], c[0, 0]) for c in (C_one, C_other)]
    sigma = np.sqrt(one.history.variance[-1, 8])
    assert abs(wrap_pi(heading[0] - heading[1])) < sigma


def test_standing_shows_no_heading():
    """Nothing is flown where nothing moves, and why."""
    made = flown(ideal(180.0), twin_of("mems"), 1)
    found = fly(cut_run(made.run, 0.0, 170.0))
    assert found.verdict == "refused" and "heading" in sentences(found.reasons)[0]


@pytest.mark.parametrize("flights", [4, pytest.param(30, marks=pytest.mark.slow)])
def test_constant_velocity_is_flown_from_all_headings(flights):
    """Forty seconds of steady cruise, which show no heading: refused before. The heading's sigma is
    at first that of a compass of which nothing is known, 104 deg, and never one that its error
    contradicts; positions and velocities are as good as their sigmas say.
    """
    turned, ratios = [], []
    for seed in range(flights):
        made = flown(ideal(180.0), twin_of("mems"), 40 + seed)
        found = fly(cut_run(made.run, 560.0, 600.0))
        assert found.verdict == "aided" and found.found.method == "all headings"
        assert found.grade == "degraded" and {str(w.why) for w in found.weak} >= {"heading_wide"}
        assert "no_velocity_change" in codes(found.notes)[0]
        history = found.history
        off, sigma = errors(made, history), np.sqrt(history.variance)
        assert 95.0 < sigma[0, 8] / DEG < 110.0 and sigma[-1, 8] / DEG > 20.0
        turned.append(off[-1, 8] / sigma[-1, 8])
        ratios.append(np.mean((off[5:, :6] / sigma[5:, :6]) ** 2))
    assert np.abs(turned).max() < 3.0
    assert 0.3 < np.mean(ratios) < 1.6


def test_mixture_of_two_flights_worked_by_hand():
    """Headings 0 and 90 deg, alike: 45 deg, sigma of the flights and 45 deg from either. 0 and
    180 deg have no mean: the likelier one, and the other as far as it is. Places 2 m apart at
    weights 0.7 and 0.3: 0.6 m of the way, with 0.7 0.3 2^2 m^2 more.
    """
    made = flown(ideal(180.0), twin_of("mems"), 1)
    one = fly(cut_run(made.run, 60.0, 420.0)).history
    turn = dcm_from_rotation_vector(np.array([0.0, 0.0, 90.0 * DEG]))
    north = replace(one, C_nb=np.broadcast_to(np.eye(3), one.C_nb.shape))
    alike = np.full((one.time_s.size, 2), 0.5)
    both = mixed([north, replace(north, C_nb=north.C_nb @ turn)], alike)
    heading = np.arctan2(both.C_nb[:, 1, 0], both.C_nb[:, 0, 0])
    assert heading == pytest.approx(45.0 * DEG)
    assert both.phi_covariance[:, 2, 2] == pytest.approx(
        one.phi_covariance[:, 2, 2] + (45.0 * DEG) ** 2
    )
    weights = np.tile([0.7, 0.3], (one.time_s.size, 1))
    back = replace(north, C_nb=north.C_nb @ turn @ turn, height_m=one.height_m - 2.0)
    both = mixed([north, back], weights)
    assert both.C_nb == pytest.approx(north.C_nb, abs=1e-12)
    assert both.variance[:, 8] == pytest.approx(one.variance[:, 8] + 0.3 * np.pi**2)
    assert both.height_m == pytest.approx(one.height_m - 0.6, abs=1e-6)
    assert both.variance[:, 2] == pytest.approx(one.variance[:, 2] + 0.7 * 0.3 * 4.0, rel=1e-5)


@pytest.mark.parametrize("off_sigmas", [0.0, 1.5])
def test_surveyed_heading_starts_a_parked_log(off_sigmas):
    """Surveyed to 1 deg while parked: the log starts at its beginning, with that sigma, and the
    filter makes it better.
    """
    made, sigma = slow(2), 1.0 * DEG
    true = float(made.reference.heading_rad[0])
    survey = Survey(heading_rad=true + off_sigmas * sigma, sigma_heading_rad=sigma)
    found = fly(replace(made.run, header=replace(made.run.header, survey=survey)))
    assert found.verdict == "aided" and found.found.method == "surveyed heading"
    assert found.history.time_s[0] < 10.0 and found.found.sigma_heading_rad == sigma
    assert heading_ratios(made, found)[0] == pytest.approx(off_sigmas, abs=0.2)
    assert abs(heading_ratios(made, found)[1]) < 3.0
    assert (normalised(made, found.history, 60) < 4.0).all()
