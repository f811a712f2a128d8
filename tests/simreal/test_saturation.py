"""Rows at the end of a sensor's range: seen in a log that was clipped, in no other, and what they
lost.
"""

from dataclasses import replace

import numpy as np
import pytest

from ins.errors.catalogue import catalogue
from ins.errors.flight import cut_off
from ins.errors.telemetry import PARKED
from ins.units import DEG
from simreal.evidence.at_range import SECONDS_AT_RANGE, TIED_ROWS, share_at_range
from simreal.evidence.run_view import view_run
from tests.simreal.runs import FLIGHT, simulated, table, twin_of

GYRO = next(e for e in catalogue() if e.id == "gyro_saturation")


def clipped(limit_rad_s, axis=2):
    """A flight whose gyro reads no more than a limit, and the run as it was."""
    run = simulated(segments=FLIGHT, aids=True).run
    imu = run.imu.whole()
    dtheta = imu.dtheta_rad.copy()
    most = limit_rad_s * imu.dt_s
    dtheta[:, axis] = np.clip(dtheta[:, axis], -most, most)
    return replace(run, imu=replace(imu, dtheta_rad=dtheta)), run


def largest_rate(run, axis=2):
    imu = run.imu.whole()
    return float(np.abs(imu.dtheta_rad[:, axis] / imu.dt_s).max())


def test_a_clipped_gyro_is_seen_and_what_it_lost():
    limit = 0.9 * largest_rate(simulated(segments=FLIGHT, aids=True).run)
    run, plain = clipped(limit)
    view = view_run(run, 0, table(), twin_of())
    share = view.telemetry.at_range
    assert np.abs(share[:, 2]).max() == 1.0
    assert not share[:, [0, 1, 3, 4, 5]].any()
    assert GYRO.needs([view.telemetry], "gyro_z") == ""
    assert "range" in GYRO.needs([view.telemetry], "gyro_x")
    # the trace has the sign of what is missing, where something is
    imu, whole = run.imu.whole(), plain.imu.whole()
    second = np.searchsorted(view.seconds.end_s, imu.time_s - 1e-6)
    count = view.seconds.end_s.size
    missing = (imu.dtheta_rad - whole.dtheta_rad)[:, 2]
    lost = np.bincount(second, missing, minlength=count)[:count]
    trace = GYRO.traces(view.telemetry, "gyro_z", {})[0].gyro_rad_s[:, 2]
    assert np.array_equal(np.sign(trace), np.sign(np.where(np.abs(lost) > 1e-12, lost, 0.0)))
    assert np.abs(trace).max() == pytest.approx(DEG)


def test_no_other_flight_shows_rows_at_a_range():
    view = view_run(simulated(segments=FLIGHT, aids=True).run, 0, table(), twin_of())
    assert not view.telemetry.at_range.any()
    assert all("range" in GYRO.needs([view.telemetry], target) for target in GYRO.targets)


def test_a_largest_value_in_two_seconds_is_no_range():
    run = simulated(segments=FLIGHT, aids=True).run
    view = view_run(run, 0, table(), twin_of())
    moving = view.telemetry.kind != PARKED
    imu = run.imu.whole()
    rate = imu.dtheta_rad[:, 0] / imu.dt_s
    top = 2.0 * np.abs(rate).max()
    at = np.searchsorted(imu.time_s, view.seconds.end_s[moving][10 : 10 + SECONDS_AT_RANGE] - 0.05)
    for count, seen in ((SECONDS_AT_RANGE - 1, False), (SECONDS_AT_RANGE, True)):
        dtheta = imu.dtheta_rad.copy()
        dtheta[at[:count], 0] = top * imu.dt_s[at[:count]]
        share = share_at_range(replace(imu, dtheta_rad=dtheta), view.seconds.end_s, moving)
        assert bool(share[:, 0].any()) == seen


def topped(run, rows, *, step_rad_s=0.0):
    """The run with some rows of gyro x at one and the same largest rate, read in steps."""
    view = view_run(run, 0, table(), twin_of())
    moving = view.telemetry.kind != PARKED
    imu = run.imu.whole()
    rate = imu.dtheta_rad[:, 0] / imu.dt_s
    first = np.searchsorted(imu.time_s, view.seconds.end_s[moving][10] - 0.95)
    rate[first : first + rows] = 1.5 * np.abs(rate).max()
    if step_rad_s:
        rate = np.round(rate / step_rad_s) * step_rad_s
    dtheta = imu.dtheta_rad.copy()
    dtheta[:, 0] = rate * imu.dt_s
    read = replace(imu, dtheta_rad=dtheta)
    return share_at_range(read, view.seconds.end_s, moving)[:, 0]


def test_three_equal_rows_are_a_range_where_no_others_are_equal():
    """A landing drives a sensor to its end in one second; coarse converters repeat rows."""
    run = simulated(segments=FLIGHT, aids=True).run
    assert not topped(run, TIED_ROWS - 1).any()
    seen = topped(run, TIED_ROWS)
    assert np.count_nonzero(seen) == 1 and seen.max() == pytest.approx(0.1 * TIED_ROWS)
    coarse = 0.02 * largest_rate(run, axis=0)
    assert not topped(run, TIED_ROWS, step_rad_s=coarse).any()


def test_what_normal_rows_lose_at_a_limit():
    """Against drawn rows: 4e6 of them know the mean loss to 0.0004."""
    rows = np.random.default_rng(5).standard_normal(4_000_000)
    for a in (-1.0, 0.0, 1.5):
        share = float((rows >= a).mean())
        lost = float((rows - np.minimum(rows, a)).mean())
        assert cut_off(np.array([share]))[0] == pytest.approx(lost, abs=0.002)
    assert cut_off(np.array([-0.5, 0.0])) == pytest.approx([-1.0 / np.sqrt(2.0 * np.pi), 0.0])
