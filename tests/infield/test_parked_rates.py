"""Zero-rate biases of parked MEMS units: Earth rate, its one common error, refusals, and the
statistics of the table.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from infield.reports.documents.parked import stretch_words, zero_rate
from infield.reports.documents.update import update_document
from infield.session.parked.rates import no_heading
from infield.session.parked.zero_rate import unknown_sigma_deg_h
from infield.session.pipeline import UnitHistory
from infield.table.file import table_sha256, table_to_dict
from infield.table.thermal_table import default_table
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.attitude import dcm_from_euler
from ins.documents import plain
from ins.earth import EARTH_RATE_RAD_S
from ins.errors.catalogue import prior
from ins.records import Survey
from ins.units import DEG, DEG_PER_HOUR
from ins.verdicts import codes, sentences
from tests.infield.mems_sessions import TWIN, blank, session, squared_error, unit, updated
from tests.infield.sessions import true_bias, with_header

OMEGA = EARTH_RATE_RAD_S / DEG_PER_HOUR
LEVEL = OMEGA * np.cos(45 * DEG)


def mean_error(simulated, estimate):
    """Posterior mean bias of the session less the true one (3,) and its covariance (3, 3)."""
    weight = estimate.bins.duration_s / estimate.bins.duration_s.sum()
    rows = np.kron(weight, np.eye(3))
    off = (
        estimate.mean_deg_h
        + estimate.bins.table_deg_h
        - true_bias(simulated, estimate.bins.edges_s)
    )
    return rows @ off, rows @ estimate.covariance @ rows.T


@lru_cache(maxsize=1)
def first():
    """A session and what an update makes of it."""
    simulated = session(1)
    return simulated, updated([simulated.run])


def document_of(result):
    before = table_to_dict(result.before)
    return plain(update_document(result, version="test", table_before=before))


def test_an_unknown_heading_leaves_its_part_of_earth_rate_and_no_more():
    for heading_deg in (0.0, 90.0, 225.0):
        simulated = session(1, heading_deg=heading_deg)
        found = updated([simulated.run]).sessions[0].estimate
        off, P = mean_error(simulated, found)
        # all but level
        north_b = np.array([np.cos(heading_deg * DEG), -np.sin(heading_deg * DEG), 0.0])
        # roll and pitch of 0.03 rad, noise of 0.4 deg/h
        assert off == pytest.approx(LEVEL * north_b, abs=1.3)
        assert np.sqrt(np.diag(P)) == pytest.approx([LEVEL / np.sqrt(2)] * 2 + [0.40], rel=0.1)


def test_a_surveyed_heading_takes_it_away():
    simulated = session(1, heading_deg=225.0)
    survey = Survey(heading_rad=225.0 * DEG, sigma_heading_rad=2.0 * DEG)
    found = updated([with_header(simulated.run, survey=survey)]).sessions[0].estimate
    off, P = mean_error(simulated, found)
    assert np.abs(off).max() < 1.5 and np.sqrt(np.diag(P)).max() < 0.7
    assert off @ np.linalg.solve(P, off) < chi2.ppf(0.999, 3)


def test_the_common_error_is_one_of_the_session():
    """Differences between points of a level gyro are known far better: Earth rate cancels."""
    points = first()[1].sessions[0].points
    x = np.flatnonzero(points.axis_index == 0)
    one, last = x[0], x[-1]
    C = points.covariance
    assert np.sqrt(C[one, one]) == pytest.approx(7.6, abs=0.5)
    assert np.sqrt(C[one, one] + C[last, last] - 2 * C[one, last]) < 3.0


def test_the_choice_between_heading_and_none():
    run = first()[0].run
    temperature = gyro_temperature(run.temperature)
    assert no_heading(run, blank(), temperature, TWIN)
    good = default_table(
        imu_serial="SN-1",
        gyro_technology="mems",
        created_utc="2026-01-01T00:00:00Z",
        sigma_deg_h=0.5,
    )
    steady = replace(TWIN, gyro=replace(TWIN.gyro, turn_on_deg_h=0.5))
    assert not no_heading(run, good, temperature, steady)
    assert not no_heading(with_header(run, gyro_technology="fog"), blank(), temperature, TWIN)


def test_a_log_that_was_compensated_already_is_named():
    truth, run = unit(6), session(6).run
    steep = truth.factory_table(np.arange(-40.0, 71.0, 10.0))
    slope = 4.0 * (np.array(steep["axes"]["x"]["temperature_degC"]) - 30.0)
    before = blank()
    beta = before.parameters.copy()
    for k in range(3):
        beta[before.values_of(k)] += slope
    # the unit has no such slope in this log: somebody subtracted it
    held = before.replaced(parameters=beta)
    result = updated([run], held)
    assert result.outcome == "inconsistent"
    assert any("compensated_before" in code for code in codes(result.reasons))
    sha256 = table_sha256(table_to_dict(held))
    history = UnitHistory(applied_table=lambda s: held)
    again = updated([with_header(run, applied_table_sha256=sha256)], held, history=history)
    assert again.outcome == "accepted"


def test_a_level_beyond_the_turn_on_is_named():
    quiet = replace(TWIN, gyro=replace(TWIN.gyro, turn_on_deg_h=1.0))
    first = updated([session(7, twin=quiet).run], twin=quiet)
    loud = replace(TWIN, gyro=replace(TWIN.gyro, turn_on_deg_h=300.0))
    second = updated([session(7, 1, twin=loud).run], first.after, twin=quiet)
    assert second.outcome == "inconsistent"
    assert "its level does not" in " ".join(sentences(second.reasons))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda run: replace(run, imu=run.imu.between(0.0, 45.0), phases=()), "needed 60 s"),
        (lambda run: replace(run, temperature=None), "no gyro temperature"),
        (lambda run: with_header(run, level_removed=True), 'gyro_offsets = "add_back"'),
    ],
)
def test_refusals(change, reason):
    result = updated([change(first()[0].run)])
    assert result.outcome == "refused" and reason in sentences(result.reasons)[0]
    assert document_of(result)["decision_rule"].startswith(
        "A session of gyros that find no heading"
    )


def test_a_noisy_unit_is_taken_as_it_is_and_a_shaking_one_refused():
    noisy = replace(TWIN, gyro=replace(TWIN.gyro, arw_deg_sqrt_h=1.0))
    run = session(1, twin=noisy).run
    found = updated([run]).sessions[0].estimate
    assert found.parked.noise_scale == pytest.approx(5.0, rel=0.15)
    assert found.parked.walk_deg_sqrt_h == pytest.approx([1.0] * 3, rel=0.15)
    tiny = replace(TWIN, gyro=replace(TWIN.gyro, arw_deg_sqrt_h=0.02))
    assert "too_noisy" in codes(updated([run], twin=tiny).reasons)[0]


def test_flicker_that_the_twin_declares_is_no_excess_noise():
    """Seconds that its flicker makes three times as noisy as its white noise would."""
    gyro = replace(TWIN.gyro, arw_deg_sqrt_h=0.05, bias_instability_deg_h=15.0)
    twin = replace(TWIN, gyro=gyro)
    found = updated([session(1, twin=twin).run], twin=twin).sessions[0]
    assert found.verdict.accepted
    assert found.estimate.parked.noise_scale == pytest.approx(1.0, abs=0.15)


def test_an_unknown_unit_gets_the_sigma_that_it_shows():
    run = first()[0].run
    temperature = gyro_temperature(run.temperature)
    plain = unknown_sigma_deg_h(run, TWIN, temperature, 30.0)
    size = np.abs(first()[1].sessions[0].estimate.parked.rate_deg_h).max()
    assert plain == pytest.approx(max(30.0, size - 15.0), abs=15.0)
    T = temperature.at(run.imu.time_s)[:, 0]
    steep = replace(
        run,
        imu=replace(
            run.imu,
            dtheta_rad=run.imu.dtheta_rad
            + (60.0 * (T - T[0]) * DEG_PER_HOUR * run.imu.dt_s)[:, None],
        ),
    )
    assert unknown_sigma_deg_h(steep, TWIN, temperature, 30.0) > 20 * 60.0
    table = default_table(
        imu_serial="SN-1",
        gyro_technology="mems",
        created_utc="2026-01-01T00:00:00Z",
        sigma_deg_h=unknown_sigma_deg_h(steep, TWIN, temperature, 30.0),
    )
    assert updated([steep], table).outcome == "accepted"
    assert updated([steep]).outcome == "inconsistent"


def statistics(seeds):
    """Squared normalised errors of tables and of session means, their degrees of freedom, how many
    sessions contradict.
    """
    table, mean, contradicting = np.zeros(2), np.zeros(2), 0
    for seed in seeds:
        simulated = session(seed)
        result = updated([simulated.run])
        off, P = mean_error(simulated, result.sessions[0].estimate)
        mean += off @ np.linalg.solve(P, off), 3
        contradicting += result.outcome == "inconsistent"
        candidate = result.sessions[0].merged.candidate
        table += squared_error(candidate, unit(seed))
    return table, mean, contradicting


def within(found, probability=0.999):
    low, high = chi2.ppf([0.5 - probability / 2, 0.5 + probability / 2], found[1])
    return low < found[0] < high


def test_a_few_runs_have_honest_errors():
    table, mean, _ = statistics(range(100, 106))
    assert within(table) and within(mean)


@pytest.mark.slow
def test_two_hundred_runs_have_honest_errors():
    """99.9 % chi-square bounds on 1800 and 600 degrees of freedom; 1 in 1000 sessions may
    contradict its table.
    """
    table, mean, contradicting = statistics(range(200, 400))
    assert within(table), table[0] / table[1]
    assert within(mean), mean[0] / mean[1]
    assert contradicting <= 4  # 0.8 expected: two tests of 99.9 %, three axes


def lying(run, roll_deg):
    """The run of a unit whose axes were turned about x: the same gyros at another attitude."""
    turn = dcm_from_euler(roll_deg * DEG, 0.0, 0.0)
    imu = run.imu.whole()
    turned = replace(imu, dtheta_rad=imu.dtheta_rad @ turn, dv_m_s=imu.dv_m_s @ turn)
    return replace(run, imu=turned, sha256=f"turned-{roll_deg}-{run.sha256}")


def test_sessions_of_any_attitude_feed_one_table():
    """On its side a unit measures its biases about its own axes; what the specific force may add
    there is in the sigma of each gyro, as one constant of the session.
    """
    simulated = session(3, heading_deg=30.0)
    for roll_deg in (90.0, 180.0):
        run = lying(simulated.run, roll_deg)
        (taken,) = updated([run]).sessions
        assert taken.verdict.accepted
        e = taken.estimate
        assert abs(np.degrees(e.alignment.roll_rad)) == pytest.approx(roll_deg, abs=3.0)
        level = updated([simulated.run]).sessions[0].estimate
        added = np.diag(e.bins.own) - np.diag(level.bins.own)
        tilt = 2.0 - 2.0 * np.cos(roll_deg * DEG)
        sigma = prior("gyro_g_sensitivity", "attitude").of("mems")
        assert added == pytest.approx(np.full(added.size, tilt * sigma**2), rel=0.1)
        assert "roll" in " ".join(stretch_words(zero_rate(e)))
