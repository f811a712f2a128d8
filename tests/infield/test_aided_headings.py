"""Aided replay of logs whose heading nothing shows at once: headings all round, weighed by what
they explain; surveyed headings.
"""

from dataclasses import replace

import numpy as np
import pytest

from infield.replay.aided.flight import navigate_aided
from infield.reports.words.sentences import sentences
from ins.attitude import dcm_from_rotation_vector, wrap_pi
from ins.records import Run, Survey
from ins.units import DEG
from tests.infield.aided_cases import errors, flown, ideal, normalised, twin_of
from trajectories.runs.cut import cut_run
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


@pytest.mark.parametrize("flights", [4, pytest.param(30, marks=pytest.mark.slow)])
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
    """The same slow drive in body axes turned by 123 deg about the vertical: the same attitude of
    the vehicle.
    """
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


def test_constant_velocity_shows_no_heading():
    """Two minutes of steady cruise, and two of standing: refused, and why."""
    made = flown(ideal(180.0), twin_of("mems"), 1)
    for start_s, end_s in ((0.0, 170.0), (560.0, 600.0)):
        found = fly(cut_run(made.run, start_s, end_s))
        assert found.verdict == "refused" and "heading" in sentences(found.reasons)[0]


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
