"""A twin of a run made by the same simulator: it must agree with the run in means and variances,
channel by channel.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import f as f_distribution

from infield.session.navigated import SessionSettings, estimate_session, find_rest, session_end
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.records import ImuLog, InputError
from simreal.twin.replicate import replicate, replicates, simulate_twin, twin_basis
from simreal.twin.run_motion import estimate_motion
from tests.simreal.runs import PARKED_S, TAXI, simulated, table, twin_of
from trajectories.runs.cut import cut_run
from trajectories.runs.directory import read_run, write_run

DEG_H, MICRO_G = np.pi / 180 / 3600, 9.80665e-6
PARKED_SPAN = (5.0, PARKED_S - 15.0)
EFFECT = {"effect": "gyro_rate_ramp", "target": "gyro_y", "parameters": {}}


def increments(run, span, seconds):
    """Sums over blocks of some seconds, (n, 6)."""
    log = run.imu.between(*span)
    rows = np.hstack([log.dtheta_rad, log.dv_m_s])
    block = round(seconds * 10.0)
    return rows[: len(rows) // block * block].reshape(-1, block, 6).sum(axis=1)


def variance(run, seconds):
    """Of block means about their neighbours, (6,), and its degrees of freedom: free of slow
    drift.
    """
    blocks = increments(run, PARKED_SPAN, seconds)
    second = np.diff(blocks, n=2, axis=0)
    return np.mean(second**2, axis=0) / 6.0, 0.5 * len(second)


@pytest.mark.parametrize("technology", ["rlg", "mems"])
def test_parked_means_agree_within_what_a_power_on_adds(technology):
    twin, sim = twin_of(technology), simulated(4, TAXI, 37.0, technology)
    made = list(replicates(sim.run, table(technology), twin, 6, np.random.default_rng(1)))
    span = PARKED_SPAN[1] - PARKED_SPAN[0]
    real, mean = (increments(run, PARKED_SPAN, 1.0).mean(axis=0) for run in (sim.run, made[0]))
    mean = np.mean([increments(run, PARKED_SPAN, 1.0).mean(axis=0) for run in made], axis=0)
    gyro, accel = twin.gyro, twin.accel
    level = np.cos(np.radians(45.0)) * 15.04 * DEG_H
    slow = (
        np.hypot(gyro.turn_on_deg_h, 2 * gyro.bias_instability_deg_h)
        + gyro.rate_random_walk_deg_h_sqrt_h * 0.6
    )
    gyro_sigma = np.hypot(slow, gyro.arw_deg_sqrt_h / np.sqrt(span / 3600.0)) * DEG_H
    accel_sigma = np.hypot(accel.turn_on_ug, 2 * accel.bias_instability_ug) * MICRO_G
    assert np.abs(real - mean)[:3].max() < 4 * gyro_sigma * np.sqrt(7 / 6) + (
        level if technology == "mems" else 0.0
    )
    assert np.abs(real - mean)[3:].max() < 4 * accel_sigma * np.sqrt(7 / 6)


@pytest.mark.parametrize("seconds", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("technology", ["rlg", "mems"])
def test_parked_variances_agree(technology, seconds):
    """F test of each channel at 0.01 %, on either side; second differences cost some of the degrees
    of freedom.
    """
    sim = simulated(4, TAXI, 37.0, technology)
    made = replicates(sim.run, table(technology), twin_of(technology), 8, np.random.default_rng(2))
    real, dof = variance(sim.run, seconds)
    each = [variance(run, seconds)[0] for run in made]
    low, high = f_distribution.ppf([1e-4, 1 - 1e-4], dof, 8 * dof)
    ratio = real / np.mean(each, axis=0)
    assert np.all((low < ratio) & (ratio < high)), ratio


def test_the_test_sees_a_noise_ten_percent_too_large():
    sim, twin = simulated(4), twin_of()
    loud = replace(twin, gyro=replace(twin.gyro, arw_deg_sqrt_h=1.1 * twin.gyro.arw_deg_sqrt_h))
    real, dof = variance(sim.run, 0.1)
    each = [
        variance(run, 0.1)[0]
        for run in replicates(sim.run, table(), loud, 8, np.random.default_rng(2))
    ]
    ratio = (real / np.mean(each, axis=0))[:3]
    assert np.all(ratio < f_distribution.ppf(1e-4, dof, 8 * dof))


def test_streams_and_times_are_those_of_the_run():
    run = simulated(3, TAXI, 200.0, aids=True).run
    made = simulate_twin(
        estimate_motion(run, table(), twin_of()), run, table(), twin_of(), np.random.default_rng(3)
    )
    assert made.header == run.header and made.phases == run.phases
    for name in ("imu", "temperature", "gnss", "odometer"):
        assert np.array_equal(getattr(made, name).time_s, getattr(run, name).time_s)
    assert np.array_equal(made.imu.dt_s, run.imu.dt_s)
    parked = simulated(3, TAXI, 200.0).run
    bare = next(
        replicates(
            replace(parked, temperature=None), table(), twin_of(), 1, np.random.default_rng(3)
        )
    )
    assert bare.gnss is None and bare.odometer is None and bare.temperature is None


def test_aids_and_temperatures_agree_with_the_run():
    run, twin = simulated(3, TAXI, 200.0, aids=True).run, twin_of()
    made = next(replicates(run, table(), twin, 1, np.random.default_rng(4)))
    d_lat = (made.gnss.lat_rad - run.gnss.lat_rad) * 6.37e6
    assert np.std(d_lat) == pytest.approx(np.sqrt(2) * twin.gnss.sigma_horizontal_m, rel=0.15)
    assert np.std(made.gnss.v_n_m_s - run.gnss.v_n_m_s) == pytest.approx(
        np.sqrt(2) * twin.gnss.sigma_velocity_m_s, rel=0.15
    )
    speed = made.odometer.speed_m_s - run.odometer.speed_m_s
    assert np.std(speed) == pytest.approx(np.sqrt(2) * twin.odometer.noise_m_s, rel=0.15)
    warm = made.temperature.gyro_degC - run.temperature.gyro_degC
    noise = np.hypot(twin.temperature.noise_degC, twin.temperature.resolution_degC / np.sqrt(12))
    assert np.std(warm) == pytest.approx(np.sqrt(2) * noise, rel=0.15)
    assert np.std(made.temperature.block_degC - run.temperature.block_degC) == pytest.approx(
        np.sqrt(2) * noise, rel=0.15
    )


def test_the_table_gives_the_thermal_bias():
    """With a table off by 0.05 deg/h the replicates differ from the run by that."""
    sim, twin = simulated(4), twin_of()
    shifted = table().replaced(parameters=table().parameters + 0.05)
    basis = twin_basis(sim.run, shifted, twin, motion=estimate_motion(sim.run, table(), twin))
    same = twin_basis(sim.run, table(), twin, motion=basis.motion)
    one, two = (replicate(b, np.random.default_rng(5)).imu.dtheta_rad for b in (basis, same))
    assert (one - two) / 0.1 / DEG_H == pytest.approx(0.05, abs=1e-6)


def test_a_unit_that_had_subtracted_a_table():
    """The twin's unit subtracts it as well; a table that nobody knows is refused."""
    raw, sha256 = simulated(4).run, "ab" * 32
    applied = table().replaced(parameters=np.full_like(table().parameters, 0.07))
    imu = replace(raw.imu, dtheta_rad=raw.imu.dtheta_rad - 0.07 * DEG_H * raw.imu.dt_s[:, None])
    run = replace(raw, imu=imu, header=replace(raw.header, applied_table_sha256=sha256))
    with pytest.raises(InputError, match="unknown"):
        twin_basis(run, table(), twin_of())
    one = next(
        replicates(
            run,
            table(),
            twin_of(),
            1,
            np.random.default_rng(5),
            applied_table={sha256: applied}.__getitem__,
        )
    )
    two = next(replicates(raw, table(), twin_of(), 1, np.random.default_rng(5)))
    assert one.header == run.header
    parked = raw.imu.time_s < PARKED_S - 15
    off = (two.imu.dtheta_rad - one.imu.dtheta_rad)[parked] / 0.1 / DEG_H
    assert off.mean(axis=0) == pytest.approx(0.07, abs=1e-3)


def test_the_navigation_filter_sees_the_same_innovations():
    """Parked, side slip, stops and odometer: NIS of the run over that of its replicates, kind by
    kind (F test, 0.01 %).
    """
    run, twin = simulated(5, TAXI, 200.0, aids=True).run, twin_of()
    real = tally(run, twin)
    made = [tally(r, twin) for r in replicates(run, table(), twin, 4, np.random.default_rng(11))]
    assert {"still", "lateral", "odometer", "gnss", "heading held"} <= set(real.dof)
    for kind, dof in real.dof.items():
        all_dof = sum(m.dof[kind] for m in made)
        ratio = (real.nis[kind] / dof) / (sum(m.nis[kind] for m in made) / all_dof)
        # innovations are not quite independent
        low, high = f_distribution.ppf([1e-4, 1 - 1e-4], 0.5 * dof, 0.5 * all_dof)
        assert low < ratio < high, (kind, ratio)


def tally(run, twin):
    found = estimate_session(
        run,
        table(),
        gyro_temperature(run.temperature),
        twin,
        SessionSettings(),
        rest=find_rest(run),
        end_s=session_end(run),
    )
    return found.solution.filter.tally


def test_a_log_with_lost_and_shifted_rows():
    """Rows lost, stamps that jitter, a late start: the twin has the same rows, and the same angle
    in all.
    """
    sim, rng = simulated(4), np.random.default_rng(6)
    log = sim.run.imu
    kept = np.sort(rng.choice(np.arange(50, log.rows), size=log.rows - 400, replace=False))
    t = log.time_s[kept] + rng.uniform(-0.02, 0.02, kept.size)
    edges = np.searchsorted(log.time_s, log.time_s[kept], side="right")
    total = np.vstack([np.zeros(6), np.cumsum(np.hstack([log.dtheta_rad, log.dv_m_s]), axis=0)])
    rows = np.diff(total[edges], axis=0)
    uneven = ImuLog(time_s=t[1:], dt_s=np.diff(t), dtheta_rad=rows[:, :3], dv_m_s=rows[:, 3:])
    run = replace(sim.run, imu=uneven)
    basis = twin_basis(run, table(), twin_of())
    made = replicate(basis, np.random.default_rng(7))
    assert not basis.even and np.array_equal(made.imu.time_s, uneven.time_s)
    quiet = (uneven.time_s > 10) & (uneven.time_s < PARKED_S - 15)
    rate = made.imu.dtheta_rad[quiet].sum(axis=0) / uneven.dt_s[quiet].sum()
    real = uneven.dtheta_rad[quiet].sum(axis=0) / uneven.dt_s[quiet].sum()
    assert np.abs(rate - real).max() < 0.03 * DEG_H


def test_a_log_that_starts_late():
    """Cut at 300 s, on the same clock: the same stands, and a twin at the same times with the same
    turns.
    """
    sim = simulated(4)
    run = cut_run(sim.run, 300.0, sim.run.imu.end_s)
    motion = estimate_motion(run, table(), twin_of())
    assert motion.origin_s == pytest.approx(300.0, abs=0.2)
    whole = estimate_motion(sim.run, table(), twin_of())
    assert np.array(motion.stands)[1:] == pytest.approx(np.array(whole.stands)[1:], abs=1.5)
    made = simulate_twin(motion, run, table(), twin_of(), np.random.default_rng(12))
    assert np.array_equal(made.imu.time_s, run.imu.time_s)
    turn, real = (np.cumsum(r.imu.dtheta_rad[:, 2]) for r in (made, run))
    # a slip of one sample in a turn of 0.16 rad/s would be 0.016
    assert np.abs(turn - real).max() < 1e-3


def test_a_replicate_does_not_depend_on_how_many_are_made():
    run = simulated(4).run
    few, many = (
        list(replicates(run, table(), twin_of(), n, np.random.default_rng(8))) for n in (1, 3)
    )
    assert np.array_equal(few[0].imu.dtheta_rad, many[0].imu.dtheta_rad)
    assert not np.array_equal(many[0].imu.dtheta_rad, many[1].imu.dtheta_rad)


def test_effects_are_injected_or_refused():
    run, twin = simulated(4).run, twin_of(effects=(EFFECT,))
    with pytest.raises(InputError, match="gyro_rate_ramp"):
        next(replicates(run, table(), twin, 1, np.random.default_rng(9)))
    seen = []

    def inject(simulated_run, effects, rng):
        seen.append(effects)
        return replace(simulated_run, sha256="injected")

    made = next(replicates(run, table(), twin, 1, np.random.default_rng(9), inject=inject))
    assert made.sha256 == "injected" and seen == [(EFFECT,)]


def test_a_reference_stream_changes_nothing(tmp_path):
    sim = simulated(4)
    bits = []
    for name, reference in (("with", sim.reference), ("without", None)):
        write_run(tmp_path / name, sim.run, reference=reference)
        made = next(
            replicates(read_run(tmp_path / name), table(), twin_of(), 1, np.random.default_rng(10))
        )
        bits.append(np.hstack([made.imu.dtheta_rad, made.imu.dv_m_s]))
    assert np.array_equal(*bits)
