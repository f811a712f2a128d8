"""Clipping and shocks are found and taken out of a parked log; what a vehicle really does is left
alone.
"""

from dataclasses import replace

import numpy as np
import pytest

from alignment.motion import imu_faults
from alignment.motion.seconds import seconds_of
from tests.alignment.parked import ideal_of, simulate
from tests.faults import clipped_accelerometer, stuck_at_full_scale
from tests.infield.sessions import PARKED as HALF_HOUR
from tests.infield.sessions import estimate_of, simulated
from tests.scenarios.gate_study import swaying
from trajectories.runs.imu_stream import imu_log
from trajectories.simulator.environments.kinds import Environment
from trajectories.simulator.segments import Park, Stop, Straight
from trajectories.simulator.vehicle import Boarding, Bump, Gust, Push

PARK = (Park(duration_s=600.0),)


def parked(seed=1, sway_m_s=0.001, segments=PARK, **options):
    return simulate(ideal_of(segments), seed, twin=swaying(sway_m_s), **options).run


def repair(imu):
    return imu_faults.repair(imu, seconds_of(imu), 0.0, imu.end_s)


def left(run, fixed):
    """Net angle [rad] and velocity [m/s] by which a repaired log differs from the true one."""
    return (fixed.dtheta_rad - run.imu.dtheta_rad).sum(axis=0), (fixed.dv_m_s - run.imu.dv_m_s).sum(
        axis=0
    )


@pytest.mark.parametrize("sway_m_s", [0.001, 0.02])
@pytest.mark.parametrize(
    ("sensor", "axis", "rows", "total", "reason"),
    [
        ("gyro", "x", 5, 0.05, "clipping"),
        ("gyro", "z", 5, -0.05, "clipping"),
        ("gyro", "y", 1, 0.3, "shock"),
        ("accelerometer", "x", 5, 0.5, "clipping"),
        ("accelerometer", "y", 1, -0.1, "shock"),
        ("accelerometer", "z", 4, -8.0, "clipping"),
    ],
)
def test_what_a_burst_leaves_is_taken_out(sway_m_s, sensor, axis, rows, total, reason):
    run = parked(sway_m_s=sway_m_s)
    bad = stuck_at_full_scale(run, sensor=sensor, axis=axis, at_s=300.3, rows=rows, total=total)
    fixed, (fault,) = repair(bad.imu)
    assert fault.reason == reason
    assert fault.start_s <= 300.3
    assert fault.end_s >= 300.3 + 0.1 * rows
    assert fault.end_s - fault.start_s < 6.0
    turn, velocity = left(run, fixed)
    assert np.abs(turn).max() < 3.0 * fault.turn_sigma_rad
    assert np.abs(velocity[:2]).max() < 4.0 * fault.velocity_sigma_m_s
    assert abs(velocity[2]) < 0.01


@pytest.mark.parametrize(
    "event",
    [
        Boarding(time_s=300.0, roll_arcsec=60.0, pitch_arcsec=-40.0, heading_arcsec=20.0),
        Gust(time_s=300.0, duration_s=30.0, sway_m_s=0.1),
        Bump(time_s=300.0, velocity_m_s=0.5),
        Push(time_s=300.0, distance_m=3.0, speed_m_s=0.2),
        Push(time_s=300.0, distance_m=-8.0, ramp_s=1.0, turn_deg=0.8),
    ],
    ids=["loading", "gust", "bump", "push", "push and turn"],
)
@pytest.mark.parametrize("sway_m_s", [0.001, 0.02])
@pytest.mark.parametrize("seed", range(3))
def test_a_real_event_is_not_repaired(event, sway_m_s, seed):
    run = parked(seed, sway_m_s, events=[event])
    fixed, faults = repair(run.imu)
    assert not [f for f in faults if f.reason]
    turn, velocity = left(run, fixed)
    assert not turn.any() and not velocity.any()


@pytest.mark.parametrize(
    "segments",
    [
        (*PARK, Straight(duration_s=200.0)),
        (*PARK, Straight(duration_s=100.0, speed_m_s=0.5), Stop(duration_s=60.0)),
    ],
)
def test_driving_off_is_not_repaired(segments):
    assert not [f for f in repair(parked(segments=segments).imu)[1] if f.reason]


def test_a_quiet_log_comes_back_itself():
    run = parked()
    fixed, faults = repair(run.imu)
    assert fixed is run.imu and faults == ()


def test_a_clipped_bump_leaves_no_velocity():
    """A shock of 2 m/s to and fro in 0.9 s whose peaks, unlike its slopes, are beyond the range."""
    bump = Bump(time_s=300.0, velocity_m_s=2.0, duration_s=0.9)
    run = parked(events=[bump])
    fixed, faults = repair(clipped_accelerometer(run, axis="x", limit_m_s2=5.0).imu)
    assert [f.reason for f in faults] in (["clipping"], ["shock"])
    assert abs(left(run, fixed)[1][0]) < 4.0 * faults[0].velocity_sigma_m_s


@pytest.mark.parametrize("sway_m_s", [0.001, 0.02])
@pytest.mark.parametrize("source", ["rates", "increments"])
def test_lost_rows_do_not_hold_one_row_of_sway(sway_m_s, source):
    """0.7 s are lost; held over by the next row's rate alone, 20 mm/s of sway leave 0.1 m/s."""
    run = parked(sway_m_s=sway_m_s)
    keep = (run.imu.time_s < 300.25) | (run.imu.time_s > 300.95)
    columns = [
        column[keep] / (run.imu.dt_s[keep, None] if source == "rates" else 1.0)
        for column in (run.imu.dtheta_rad, run.imu.dv_m_s)
    ]
    held, _ = imu_log(run.imu.time_s[keep], *columns, source=source)
    fixed, (fault,) = repair(held)
    assert fault.reason == "dropout" and fault.start_s < 300.25 and 300.95 < fault.end_s
    moved = fixed.dv_m_s.sum(axis=0) - run.imu.dv_m_s.sum(axis=0)
    turned = fixed.dtheta_rad.sum(axis=0) - run.imu.dtheta_rad.sum(axis=0)
    assert np.abs(moved[:2]).max() < 4.0 * fault.velocity_sigma_m_s
    assert np.abs(turned).max() < 3.0 * fault.turn_sigma_rad


@pytest.mark.parametrize(("total", "known"), [(0.001, False), (0.004, True)])
def test_a_turn_that_only_the_vertical_gyro_felt_widens_the_heading(total, known):
    """In one row: Earth rate cannot tell within ten minutes. A small one might be real about an
    axis close to the gyro's: nobody knows, and the sigma says so. A large one would have been felt.
    """
    run = parked()
    bad = stuck_at_full_scale(run, sensor="gyro", axis="z", at_s=300.3, rows=1, total=total)
    fixed, (fault,) = repair(bad.imu)
    left = abs(fixed.dtheta_rad[:, 2].sum() - run.imu.dtheta_rad[:, 2].sum())
    if known:
        assert fault.reason == "shock" and left < 4.0 * fault.turn_sigma_rad < 1e-4
    else:
        assert fault.turn_sigma_rad == pytest.approx(total, rel=0.05)


def test_a_turn_of_a_turntable_is_kept():
    """20 deg in 20 s about the vertical gyro's own axis: no other sensor feels it, and it is real
    all the same, for no gyro sticks for so long.
    """
    run = parked()
    turn = np.array(run.imu.dtheta_rad)
    rows = slice(*np.searchsorted(run.imu.time_s, [300.0, 320.0]))
    turn[rows, 2] += np.radians(20.0) / (rows.stop - rows.start)
    turned = replace(run.imu, dtheta_rad=turn)
    fixed, _ = repair(turned)
    assert np.array_equal(fixed.dtheta_rad, turn)


def test_a_real_turn_in_one_row_is_kept():
    """Felt by a level gyro: the unit stands half a degree off the axis of the turn."""
    run = parked()
    columns = [np.array(run.imu.dv_m_s), np.array(run.imu.dtheta_rad)]
    row = np.searchsorted(run.imu.time_s, 300.3)
    columns[1][row] += 0.004 * np.array([0.009, 0.0, 1.0])
    turned = replace(run.imu, dv_m_s=columns[0], dtheta_rad=columns[1])
    fixed, faults = repair(turned)
    left = fixed.dtheta_rad[:, 2].sum() - run.imu.dtheta_rad[:, 2].sum()
    widened = max((fault.turn_sigma_rad for fault in faults), default=0.0)
    assert left == pytest.approx(0.004, abs=1e-5) or widened > 0.003


@pytest.mark.parametrize(
    ("sensor", "axis", "total"),
    [("gyro", "x", 0.05), ("gyro", "z", -0.05), ("accelerometer", "x", 0.5)],
)
def test_a_session_goes_on_after_a_burst(sensor, axis, total):
    """Used to end the parked time at the burst: too short, refused."""
    run = simulated(1, HALF_HOUR).run
    before = estimate_of(run)
    after = estimate_of(
        stuck_at_full_scale(run, sensor=sensor, axis=axis, at_s=800.3, rows=5, total=total)
    )
    (span,) = after.solution.motion.excluded()
    assert span.reason == "clipping" and span.start_s < 800.3 and 830.8 < span.end_s < 850.0
    sigma = np.sqrt(np.diag(before.covariance))
    assert np.sqrt(np.mean(((after.mean_deg_h - before.mean_deg_h) / sigma) ** 2)) < 0.25
    assert np.all(np.sqrt(np.diag(after.covariance)) < 1.03 * sigma)


def test_the_crest_of_a_swell_is_no_shock():
    """A moored ship rolls by three times its RMS now and then, over seconds."""
    for seed in range(3):
        run = parked(seed, environments=(Environment(kind="ship"),))
        assert repair(run.imu)[1] == ()
