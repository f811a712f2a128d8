"""Aided replay: starts parked and moving, units without a gyrocompass, standstills, noise and
latency found, refusals.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from alignment.motion.seconds import seconds_of
from alignment.motion.speeds import find_stands
from infield.aided.flight import aided_noise, navigate_aided
from infield.aided.noise import capped_nis
from infield.aided.velocity_match import match_velocity
from infield.replay.free_inertial import TableChoice, replay
from infield.session.log import find_rest
from ins.filters.aided_filter import level_sigmas
from ins.filters.aided_records import fixes_of
from ins.noise import flicker_walk
from ins.records import TwinModel
from ins.units import DEG, DEG_PER_HOUR, DEG_PER_HOUR_SQRT_HOUR
from ins.verdicts import codes, sentences
from tests.cut import cut_run
from tests.infield.aided_cases import LEVER_M, SITE, errors, flown, ideal, normalised, twin_of
from tests.infield.flight_errors import FlightErrors, with_flight_errors
from tests.infield.test_replay import choices, flat, never_rests
from trajectories.simulator.segments import Park, Stop, Straight, Turn

PARK_S = 180.0


def aided(made, run, twin: TwinModel, *, gyrocompass: bool):
    rest = find_rest(run) if gyrocompass else None
    return navigate_aided(run, run.imu, twin, rest=rest, gyro_sigma_deg_h=None)


def fixes(run, twin):
    noise = twin.gnss
    return fixes_of(
        run.gnss,
        horizontal_m=noise.sigma_horizontal_m,
        vertical_m=noise.sigma_vertical_m,
        velocity_m_s=noise.sigma_velocity_m_s,
    )


def test_parked_start_with_a_navigation_grade_unit():
    twin, made = twin_of("rlg"), flown(ideal(PARK_S), twin_of("rlg"), 1)
    found = aided(made, made.run, twin, gyrocompass=True)
    assert found.verdict == "aided"
    assert found.found.method == "gyrocompass"
    assert not found.scales.fitted
    assert found.history.time_s[0] < 5.0 and found.stands[0][1] == pytest.approx(PARK_S, abs=4.0)
    assert (normalised(made, found.history, 60) < 3.0).all()
    roll, pitch, heading = level_sigmas(found.history.phi_covariance, found.history.C_nb)[-1] / DEG
    plumb_deg = 5.0 / 3600.0  # deflection of the vertical that is reckoned with
    assert max(roll, pitch) < plumb_deg and heading < 0.01


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_mems_unit_finds_its_heading_once_it_moves(seed):
    """The gyrocompass refuses; the velocities show the heading within three declared sigmas, and
    the filter makes it better.
    """
    twin, made = twin_of("mems"), flown(ideal(PARK_S), twin_of("mems"), seed)
    found = aided(made, made.run, twin, gyrocompass=False)
    history = found.history
    assert found.verdict == "aided"
    assert found.found.method == "velocity matching"
    assert not found.scales.fitted
    assert found.found.span[1] > PARK_S
    first = abs(errors(made, history)[0, 8])
    assert first < 3.0 * found.found.sigma_heading_rad
    seen = level_sigmas(history.phi_covariance, history.C_nb)[-1, 2]
    assert seen < 0.2 * found.found.sigma_heading_rad
    assert (normalised(made, history, 60) < 4.0).all()


@pytest.mark.parametrize("technology", ["mems", "rlg"])
def test_log_that_never_rests_starts_in_motion(technology):
    twin, made = twin_of(technology), flown(ideal(PARK_S), twin_of(technology), 4)
    run = cut_run(made.run, PARK_S + 80.0, PARK_S + 400.0)
    found = aided(made, run, twin, gyrocompass=False)
    assert found.verdict == "aided" and found.stands == ()
    theta = errors(made, found.history)[:, 6:9]
    assert np.abs(theta[-1, :2]).max() < 0.2 * DEG and np.abs(theta[-1, 2]) < 1.5 * DEG
    assert (normalised(made, found.history, 60) < 4.0).all()


@pytest.mark.parametrize(
    ("technology", "moving", "flights", "band"),
    [
        ("rlg", False, 3, (0.35, 1.8)),
        ("mems", True, 3, (0.35, 1.8)),
        *(
            pytest.param(technology, moving, 12, (0.55, 1.35), marks=pytest.mark.slow)
            for technology in ("rlg", "mems")
            for moving in (False, True)
        ),
    ],
)
def test_sigmas_are_those_of_the_errors_with_flicker(technology, moving, flights, band):
    """Flights with the twin's whole noise, scales and misalignments, from the apron and cut out of
    the flight: squared error over variance of position, velocity and attitude is one. A flight's
    rows are not independent; means of twelve on other seeds are 0.80 to 1.03, and the band of three
    is twice as wide.
    """
    ratios, twin = [], twin_of(technology)
    for seed in range(flights):
        made = flown(ideal(PARK_S), twin, 300 + seed, technology)
        run = cut_run(made.run, PARK_S + 80.0, PARK_S + 400.0) if moving else made.run
        found = aided(made, run, twin, gyrocompass=technology == "rlg" and not moving)
        ratios.append(normalised(made, found.history, 60))
    mean = np.mean(ratios, axis=0)
    assert (mean > band[0]).all() and (mean < band[1]).all()


def test_tilts_over_a_deflected_vertical_are_off_by_what_they_say():
    """Four ring-laser flights over 5 arcsec: squared attitude error over variance is about one. On
    other seeds (60) the mean is 0.80; it was 2.30 while the filter knew of no deflection.
    """
    twin, ratios = twin_of("rlg"), []
    for seed in range(4):
        rng = np.random.default_rng([seed, 55])
        made = flown(ideal(PARK_S), twin, 340 + seed, "rlg")
        made = with_flight_errors(made, ideal(PARK_S), FlightErrors(deflection_arcsec=5.0), rng)
        found = aided(made, made.run, twin, gyrocompass=True)
        ratios.append(normalised(made, found.history, 60)[2])
    assert 0.3 < np.mean(ratios) < 1.4


def test_parked_logs_and_few_fixes_are_refused():
    twin, made = twin_of("mems"), flown(ideal(PARK_S), twin_of("mems"), 1)
    found = aided(made, cut_run(made.run, 0.0, 170.0), twin, gyrocompass=False)
    assert found.verdict == "refused" and "heading" in sentences(found.reasons)[0]
    assert found.history is None
    few = replace(
        made.run,
        gnss=type(made.run.gnss)(
            **{k: None if v is None else v[:5] for k, v in vars(made.run.gnss).items()}
        ),
    )
    assert (
        "5 satellite fixes within the imu log, needed 10"
        in sentences(aided(made, few, twin, gyrocompass=False).reasons)[0]
    )


def test_match_is_as_good_as_it_says():
    """Attitude from 30 s of climb and turn over 20 seeds of MEMS: heading error over sigma has RMS
    0.4 to 1.2 (noise of neighbouring pairs is opposed, which the sigma does not count on).
    """
    twin, ratios = twin_of("mems"), []
    for seed in range(20):
        made = flown(ideal(PARK_S), twin, seed)
        log = made.run.imu.between(PARK_S + 90.0, PARK_S + 120.0)
        bias = made.gyro_bias_true_deg_h[int(PARK_S + 100.0)] * DEG_PER_HOUR
        found = match_velocity(
            log,
            fixes(made.run, twin),
            lever_arm_m=np.array(LEVER_M),
            gyro_bias_rad_s=bias,
            sigma_gyro_rad_s=7.3e-5,
        )
        k = int(np.argmin(np.abs(made.reference.time_s - log.time_s[-1])))
        heading = np.arctan2(found.C_nb[1, 0], found.C_nb[0, 0])
        error = np.angle(np.exp(1j * (heading - made.reference.heading_rad[k])))
        ratios.append(error / found.sigma_heading_rad)
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 1.2


def test_stands_are_found_where_receiver_and_sensors_agree():
    base = ideal(
        60.0,
        (
            Straight(duration_s=40.0),
            Stop(duration_s=40.0),
            Turn(angle_deg=90.0),
            Straight(duration_s=60.0),
            Stop(duration_s=5.0),
            Park(duration_s=30.0),
        ),
    )
    twin, made = twin_of("mems"), flown(base, twin_of("mems"), 2)
    spans = find_stands(seconds_of(made.run.imu), fixes(made.run, twin))
    assert len(spans) == 3
    speed = np.linalg.norm(made.reference.v_n_m_s[:, :2], axis=1)
    for start, end in spans:
        rows = (made.reference.time_s >= start) & (made.reference.time_s <= end)
        assert speed[rows].max() < 0.015
    # a receiver that says it rolls
    rolling = replace(made.run.gnss, v_n_m_s=made.run.gnss.v_n_m_s + [3.0, 0.0, 0.0])
    assert find_stands(seconds_of(made.run.imu), fixes(replace(made.run, gnss=rolling), twin)) == ()


@pytest.mark.slow
def test_latency_and_noise_of_the_receiver_are_found():
    """Fixes stamped 0.25 s late, four times as noisy as declared: both found; declared NIS kept."""
    twin = twin_of("mems")
    loud = replace(
        twin,
        gnss=replace(
            twin.gnss, sigma_horizontal_m=2.0, sigma_vertical_m=3.0, sigma_velocity_m_s=0.12
        ),
    )
    made = flown(ideal(PARK_S), loud, 6)
    log = replace(
        made.run.gnss,
        time_s=made.run.gnss.time_s + 0.25,
        sigma_horizontal_m=None,
        sigma_vertical_m=None,
        sigma_velocity_m_s=None,
    )
    late = replace(made.run, gnss=log)
    found = aided(made, late, twin, gyrocompass=False)
    antenna = found.antenna.antenna
    assert found.antenna.freed == (False, True)
    assert antenna.delay_s == pytest.approx(0.25, abs=3 * np.sqrt(antenna.covariance[3, 3]))
    assert 3.0 < found.scales.position < 5.0 and 3.0 < found.scales.velocity < 5.5
    assert found.declared_nis[0] > 5.0 and codes(found.notes)[0] == "delay_taken"
    assert np.abs(errors(made, found.history)[-1, :2]).max() < 3.0


def test_replay_carries_both_and_leaves_free_inertial_alone():
    made = flown(ideal(700.0), twin_of("rlg"), 1)
    twin = twin_of("rlg")
    with_it, without = (replay(made.run, choices(flat()), twin, aided=on) for on in (True, False))
    assert without.aided is None
    assert with_it.aided.verdict == "aided"
    assert with_it.aided.found.method == "gyrocompass"
    for name in ("lat_rad", "v_n_m_s", "C_nb"):
        np.testing.assert_array_equal(
            *(getattr(r.tables[0].history, name) for r in (with_it, without))
        )
    assert replay(replace(made.run, gnss=None), choices(flat()), twin).aided is None


def test_replay_of_a_unit_that_only_gnss_can_fly():
    made, twin = flown(ideal(PARK_S), twin_of("mems"), 2), twin_of("mems")
    header = replace(made.run.header, gyro_technology="mems")
    run = replace(made.run, header=header, temperature=None)
    table = [TableChoice(role="active", table=None, origin="none")]
    found = replay(run, table, twin)
    assert found.verdict == "replayed" and found.aided.verdict == "aided"
    assert any("no_free_inertial_flight" in code for code in codes(found.notes))
    assert replay(run, table, twin, aided=False).verdict == "refused"
    gnss = run.gnss
    leap = np.where(gnss.time_s > 400.0, 300.0 / 6.4e6, 0.0)
    leaps = replay(replace(run, gnss=replace(gnss, lat_rad=gnss.lat_rad + leap)), table, twin)
    assert leaps.verdict == "replayed" and leaps.aided.verdict == "aided"
    assert leaps.aided.grade == "degraded"
    (weak,) = [w for w in leaps.aided.weak if w.why == "positions_leap"]
    assert 400.0 < weak.start_s < 415.0
    wild = np.random.default_rng(2).uniform(-300.0, 300.0, gnss.time_s.size) / 6.4e6
    wild = np.where(np.arange(gnss.time_s.size) % 3 == 0, wild, 0.0)
    third = replay(replace(run, gnss=replace(gnss, lat_rad=gnss.lat_rad + wild)), table, twin)
    assert third.verdict == third.aided.verdict == third.aided.grade == "inconsistent"
    assert "satellite positions rejected, needed at most 25%" in sentences(third.reasons)[-1]
    moving = replay(never_rests(cut_run(run, 0.0, 160.0, site=SITE)), table, twin)
    assert moving.verdict == "refused" and moving.aided.verdict == "refused"


def test_flicker_becomes_a_walk_of_the_same_allan_variance():
    """Where white noise N^2/t meets the floor (0.664 B)^2, K^2 t/3 meets both; an hour at most, a
    minute at least.
    """
    B, N = 1.0, 0.664 * np.sqrt(900.0)
    K = flicker_walk(B, N)
    assert K**2 / 3600.0 * 900.0 / 3.0 == pytest.approx((0.664 * B) ** 2)
    assert flicker_walk(0.0, N) == 0.0 and flicker_walk(B, 1e9) == pytest.approx(np.sqrt(3) * 0.664)
    assert flicker_walk(B, 0.0) == flicker_walk(B, 0.1)
    assert aided_noise(twin_of("rlg", flicker=False)).gyro_walk == pytest.approx(
        0.002 * DEG_PER_HOUR_SQRT_HOUR
    )


def test_rejects_tell_the_noise_only_where_they_are_most():
    """One in twenty is left out; one in five moves the noise as little as the median does (as a
    mean, it made a leap of 20 m a noise of 5 m, with a sigma of 0.4 m and an error of 8 m); more
    than half are the noise.
    """
    nis, used = np.full((100, 2), 3.0), np.full((100, 2), 2)
    nis[:5, 0], used[:5, 0] = 1e4, 1
    nis[:20, 1], used[:20, 1] = 1e4, 1
    history = SimpleNamespace(nis=nis, used=used)
    assert capped_nis(history, 0) == pytest.approx(1.0)
    assert capped_nis(history, 1) == pytest.approx(3.0 / chi2.median(3))
    nis[:60, 1], used[:60, 1] = 1e4, 1
    assert capped_nis(history, 1) > 1e3
