"""Several stretches of rest in one log of a MEMS unit: what they share, what is left out, and
honest sums of squares.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from alignment.motion import turn_between
from infield.reports.documents.update import update_document
from infield.reports.documents.update_records import update_of
from infield.reports.update_page import update_html
from infield.session.bins import make_bins
from infield.session.parked.stretches import stationary_segments
from infield.session.parked.zero_rate import unknown_sigma_deg_h
from infield.session.reasons import ParkedReason
from infield.session.settings import SessionSettings
from infield.table.file import table_to_dict
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.documents import plain
from ins.earth import EARTH_RATE_RAD_S
from ins.records import GnssLog, Survey
from ins.units import DEG, DEG_PER_HOUR
from ins.verdicts import codes, sentence
from tests.infield.mems_flights import COLD_S, WARM_S, flight, landed
from tests.infield.mems_sessions import TWIN, blank, session, squared_error, unit, updated
from tests.infield.sessions import with_header

LEVEL = EARTH_RATE_RAD_S / DEG_PER_HOUR * np.cos(45 * DEG)
COLD_degC, WARM_degC = 21.5, 41.0


@lru_cache(maxsize=1)
def first():
    simulated = flight(1, turn_deg=90.0)
    return simulated, updated([simulated.run])


def estimate_of(run, **options):
    return updated([run], **options).sessions[0].estimate


def document_of(result):
    return plain(update_document(result, version="test", table_before=table_to_dict(result.before)))


def errors(simulated, estimate):
    """Errors of the session's mean and of warm less cold (3,), with their covariances (3, 3)."""
    bins, stretch = estimate.bins, estimate.parked.stretch
    spans = [
        (simulated.bias_time_s > a) & (simulated.bias_time_s <= b)
        for a, b in zip(bins.start_s, bins.end_s)
    ]
    truth = np.concatenate([simulated.gyro_bias_true_deg_h[rows].mean(axis=0) for rows in spans])
    off = estimate.mean_deg_h + bins.table_deg_h - truth
    mean = bins.duration_s / bins.duration_s.sum()
    change = (stretch == 1) / np.sum(stretch == 1) - (stretch == 0) / np.sum(stretch == 0)
    rows = [np.kron(weight, np.eye(3)) for weight in (mean, change)]
    return [(A @ off, A @ estimate.covariance @ A.T) for A in rows]


def test_both_stretches_are_used_and_nothing_of_the_flight():
    simulated, result = first()
    bins, p = result.sessions[0].estimate.bins, result.sessions[0].estimate.parked
    end = simulated.run.imu.end_s
    assert [round(s.seconds.dt_s.sum()) for s in p.stretches] == pytest.approx(
        [COLD_S, WARM_S], abs=8
    )
    assert bins.end_s[p.stretch == 0].max() <= COLD_S
    assert bins.start_s[p.stretch == 1].min() >= end - WARM_S
    assert bins.prior.shape == (3 * len(bins.start_s),) * 2 and len(bins.start_s) == 5
    points = result.sessions[0].points
    assert points.temperature_degC.max() > 38.0 and points.temperature_degC.min() < 23.0
    assert not np.any((points.time_s > COLD_S) & (points.time_s < end - WARM_S))


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 180.0, -60.0])
def test_the_turn_between_is_found_and_decides_what_is_common(turn_deg):
    p = estimate_of(flight(3, turn_deg=turn_deg).run).parked
    turn = p.turns[0]
    off = (turn.heading_rad / DEG - turn_deg + 180.0) % 360.0 - 180.0
    assert turn.told and abs(off) < 3.0 * turn.sigma_rad / DEG and turn.sigma_rad < 10.0 * DEG
    shared = p.earth.covariance[0, 3] / p.earth.covariance[0, 0]
    assert shared == pytest.approx(np.cos(turn.heading_rad), abs=0.03)
    assert np.linalg.eigvalsh(p.earth.covariance).min() > -1e-9


def test_an_untold_turn_takes_the_larger_uncertainty_of_both(monkeypatch):
    monkeypatch.setattr(turn_between, "TOLD_RAD", 0.0)
    p = estimate_of(first()[0].run).parked
    C = p.earth.covariance
    assert np.sqrt(C[0, 0]) == pytest.approx(LEVEL, rel=0.01) and abs(C[0, 3]) < 0.01
    f = np.array([1.0, 0, 0, 1.0, 0, 0]) / 2, np.array([1.0, 0, 0, -1.0, 0, 0])
    mean, change = (v @ C @ v for v in f)
    # unchanged; half a turn
    assert mean >= 0.5 * LEVEL**2 * 0.998 and change >= 2.0 * LEVEL**2 * 0.998


def test_a_clipped_gyro_or_dropouts_do_not_tell_the_turn():
    """Cut at the end of the range about the vertical alone, which down never shows; some rows lost
    and held over.
    """
    run = first()[0].run
    away = np.flatnonzero((run.imu.time_s > COLD_S) & (run.imu.time_s < run.imu.end_s - WARM_S))
    rate = run.imu.dtheta_rad.copy()
    rate[away, 2] = np.clip(rate[away, 2], None, np.sort(rate[away, 2])[-40])
    rate[away[2000:2005], 2] = rate[away, 2].max()
    clipped = estimate_of(replace(run, imu=replace(run.imu, dtheta_rad=rate))).parked
    assert len(clipped.stretches) == 2 and not clipped.turns[0].told
    kept = np.ones(run.imu.time_s.size, bool)
    for k in range(200, 8200, 400):
        kept[away[k] : away[k] + 4] = False
    t = run.imu.time_s[kept]
    dt = np.diff(t, prepend=t[0] - 0.1)
    held = replace(
        run.imu,
        time_s=t,
        dt_s=dt,
        dtheta_rad=run.imu.dtheta_rad[kept] * (dt / 0.1)[:, None],
        dv_m_s=run.imu.dv_m_s[kept] * (dt / 0.1)[:, None],
    )
    assert not estimate_of(replace(run, imu=held)).parked.turns[0].told


def test_a_surveyed_heading_follows_the_turn_and_no_further(monkeypatch):
    simulated = flight(5, heading_deg=120.0, turn_deg=90.0)
    run = with_header(
        simulated.run, survey=Survey(heading_rad=120.0 * DEG, sigma_heading_rad=2.0 * DEG)
    )
    told = estimate_of(run)
    (mean, P), (change, Q) = errors(simulated, told)
    assert np.sqrt(np.diag(P)).max() < 1.5
    assert np.abs(mean).max() < 5.0
    assert np.sqrt(np.diag(Q)).max() < 5.0
    assert mean @ np.linalg.solve(P, mean) < chi2.ppf(0.999, 3)
    assert change @ np.linalg.solve(Q, change) < chi2.ppf(0.999, 3)
    monkeypatch.setattr(turn_between, "TOLD_RAD", 0.0)
    p = estimate_of(run).parked
    assert p.earth.heading_deg_h == pytest.approx([0.0, LEVEL / np.sqrt(2)])
    # only the vertical part, on a tilt of 0.03
    assert p.earth.known[1, :2] == pytest.approx([0.0, 0.0], abs=0.5)


def test_down_is_measured_in_each_stretch():
    """It stands otherwise after landing: the vertical part of Earth rate goes with gravity."""
    simulated = flight(6, turn_deg=0.0)
    run = simulated.run
    late = run.imu.time_s > run.imu.end_s - WARM_S - 5.0
    tilt = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])  # on its side
    imu = replace(
        run.imu,
        dtheta_rad=np.where(late[:, None], run.imu.dtheta_rad @ tilt.T, run.imu.dtheta_rad),
        dv_m_s=np.where(late[:, None], run.imu.dv_m_s @ tilt.T, run.imu.dv_m_s),
    )
    p = estimate_of(replace(run, imu=imu)).parked
    assert p.earth.down_b[0] == pytest.approx([0, 0, 1], abs=0.05)
    assert p.earth.down_b[1] == pytest.approx([0, 1, 0], abs=0.05)
    assert p.earth.known[1, 1] == pytest.approx(
        -EARTH_RATE_RAD_S / DEG_PER_HOUR * np.sin(45 * DEG), abs=0.1
    )
    assert not p.turns[0].told and p.turns[0].closure_rad > 1.0  # the gyros did not see it fall


def with_gnss(run, velocity):
    """GNSS at 1 Hz, velocity (n, 2) north and east as a function of time (n,)."""
    t = np.arange(1.0, run.imu.end_s)
    v = np.column_stack([velocity(t), np.zeros(t.size)]) + np.random.default_rng(1).normal(
        0.0, 0.03, (t.size, 3)
    )
    none = np.zeros(t.size)
    return replace(
        run, gnss=GnssLog(time_s=t, lat_rad=none + 45 * DEG, lon_rad=none, height_m=none, v_n_m_s=v)
    )


def circle(t):
    return 0.8 * np.column_stack([np.cos(0.1 * t), np.sin(0.1 * t)])


@pytest.mark.parametrize(
    ("late", "said"),
    [
        (lambda t: np.column_stack([np.full(t.size, 3.0), 0 * t]), "up to 3.1 m/s"),
        (circle, "up to 0.9 m/s"),
        (lambda t: np.column_stack([np.full(t.size, 0.3), 0 * t]), "0.30 m/s on the mean"),
    ],
)
def test_a_rest_that_satellites_see_moving_is_left_out(late, said):
    run = first()[0].run
    moving = with_gnss(run, lambda t: late(t) * ((t > COLD_S) & (t < run.imu.end_s))[:, None])
    rests = stationary_segments(moving)
    assert len(rests.stretches) == 1 and rests.stretches[0][1] < COLD_S + 1.0
    assert said in sentence(rests.left_out[0].reason)
    result = updated([moving])
    assert result.outcome == "accepted"
    assert any(said in span["reason"] for span in document_of(result)["excluded"])
    standing = with_gnss(run, lambda t: np.zeros((t.size, 2)))
    assert len(stationary_segments(standing).stretches) == 2
    whole = stationary_segments(
        with_gnss(run, lambda t: np.column_stack([np.full(t.size, 3.0), 0 * t]))
    )
    assert whole.stretches == ()
    assert whole.why.code is ParkedReason.NO_REST
    assert "GNSS" in sentence(whole.why)


def test_a_shaken_rest_is_left_out_and_the_other_used():
    run = first()[0].run
    late = (run.imu.time_s > run.imu.end_s - WARM_S)[:, None]
    rng = np.random.default_rng(2)
    shaken = replace(
        landed(run),
        imu=replace(
            run.imu,
            dtheta_rad=run.imu.dtheta_rad + late * rng.normal(0.0, 3e-4, run.imu.dtheta_rad.shape),
        ),
    )
    p = estimate_of(shaken).parked
    assert len(p.stretches) == 1
    assert "too_noisy" in codes([p.left_out[0].reason])[0]


def test_what_follows_a_turn_on_the_spot_is_a_stretch_of_its_own():
    simulated = session(4)
    run = simulated.run
    turning = ((run.imu.time_s > 1500.0) & (run.imu.time_s <= 1502.0))[:, None]
    imu = replace(
        run.imu, dtheta_rad=run.imu.dtheta_rad + turning * np.array([0.0, 0.0, 0.5 * np.pi / 20.0])
    )
    p = estimate_of(replace(run, imu=imu, phases=())).parked
    assert len(p.stretches) == 2 and p.stretches[1].seconds.end_s[-1] > 2390.0
    assert "turned by 1.6 rad" in p.stretches[0].seconds.moved
    assert p.turns[0].heading_rad == pytest.approx(0.5 * np.pi, abs=0.02)
    assert p.turns[0].sigma_rad < 0.05


def test_an_unknown_unit_is_as_wide_as_its_warm_stretch_shows():
    run = first()[0].run
    temperature = gyro_temperature(run.temperature)
    T = temperature.at(run.imu.time_s)[:, 0]
    bent = (60.0 * np.maximum(T - 30.0, 0.0) * DEG_PER_HOUR * run.imu.dt_s)[:, None]
    steep = replace(run, imu=replace(run.imu, dtheta_rad=run.imu.dtheta_rad + bent))
    assert unknown_sigma_deg_h(steep, TWIN, temperature, 30.0) > 500.0


def statistics(seeds, **options):
    """Squared normalised errors of session means, of warm less cold and of tables, with their
    degrees of freedom.
    """
    mean, change, table, contradicting = np.zeros(2), np.zeros(2), np.zeros(2), 0
    for seed in seeds:
        simulated = flight(seed, **options)
        result = updated([simulated.run])
        found = result.sessions[0]
        for total, (off, P) in zip((mean, change), errors(simulated, found.estimate)):
            total += off @ np.linalg.solve(P, off), 3
        table += squared_error(found.merged.candidate, unit(seed), (COLD_degC, 32.0, WARM_degC))
        contradicting += result.outcome == "inconsistent"
    return mean, change, table, contradicting


def bounds(found, probability=0.999):
    return chi2.ppf([0.5 - probability / 2, 0.5 + probability / 2], found[1])


def test_a_few_flights_have_honest_errors():
    *sums, _ = statistics(range(100, 106))
    assert all(low < total[0] < high for total in sums for low, high in [bounds(total)])


@pytest.mark.slow
@pytest.mark.parametrize("turn_deg", [None, 0.0, 180.0])
def test_two_hundred_flights_have_honest_errors(turn_deg):
    """99.9 % chi-square bounds on 600, 600 and 1800 degrees of freedom, headings at random, as they
    were, and opposite.
    """
    *sums, contradicting = statistics(range(1000, 1200), turn_deg=turn_deg)
    for total in sums:
        low, high = bounds(total)
        assert low < total[0] < high, total[0] / total[1]
    assert contradicting <= 4


@pytest.mark.slow
@pytest.mark.parametrize("turn_deg", [None, 0.0, 180.0])
def test_untold_turns_are_not_overconfident(turn_deg, monkeypatch):
    monkeypatch.setattr(turn_between, "TOLD_RAD", 0.0)
    *sums, _ = statistics(range(1000, 1200), turn_deg=turn_deg)
    assert all(total[0] < bounds(total)[1] for total in sums)


def test_one_stretch_is_estimated_as_ever():
    """A log of one stretch, bit by bit: equal bins, one common error of all points, a document
    without a word of stretches.
    """
    run = session(1).run
    result = updated([run])
    e = result.sessions[0].estimate
    p, temperature = e.parked, gyro_temperature(run.temperature)
    start, end = float(p.stretches[0].seconds.start_s[0]), float(p.stretches[0].seconds.end_s[-1])
    table = blank().extended_to(
        float(temperature.temperature_degC.min()), float(temperature.temperature_degC.max())
    )
    bins = make_bins(
        table, temperature, TWIN, SessionSettings(bin_s=60.0), start_s=start, end_s=end
    )
    assert np.array_equal(bins.prior, e.bins.prior) and np.array_equal(bins.edges_s, e.bins.edges_s)
    white = p.walk_deg_sqrt_h**2 / (np.maximum(p.used_s, 1.0)[:, None] / 3600.0)
    R = np.kron(np.ones((40, 40)), p.earth.covariance) + np.diag(white.ravel())
    gain = np.linalg.solve(bins.prior + R, bins.prior).T
    assert np.array_equal(gain @ p.rate_deg_h.ravel(), e.mean_deg_h)
    assert not {"stretches", "left_out"} & set(document_of(result)["sessions"][0]["zero_rate"])


def test_the_report_lists_each_stretch():
    found = document_of(first()[1])
    zero_rate = found["sessions"][0]["zero_rate"]
    cold, warm = zero_rate["stretches"]
    assert cold["duration_s"] == pytest.approx(COLD_S, abs=8.0)
    assert warm["duration_s"] == pytest.approx(WARM_S, abs=8.0)
    assert warm["start_s"] > 1300.0
    assert warm["temperature_degC"][0] > 38.0
    assert cold["turned_deg"] is None
    assert warm["turned_deg"] == pytest.approx(90.0, abs=15.0)
    assert zero_rate["bins"] == cold["bins"] + warm["bins"] == 5
    covered = sum(row["seconds"] for row in found["sessions"][0]["coverage"] if row["axis"] == "x")
    assert covered == pytest.approx(COLD_S + WARM_S, abs=20.0)
    heading = {
        r["axis"]: r["sigma_deg_h"]
        for r in found["uncertainty_budget"]
        if "unknown heading" in r["term"]
    }
    # a quarter turn between 3 and 2 min
    assert heading["x"] == pytest.approx(LEVEL / np.sqrt(2) * 0.72, rel=0.1)
    page = update_html(update_of(found))
    assert "2 stretches of rest" in page and "deg, by the gyros" in page
