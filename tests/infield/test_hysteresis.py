"""Heating against cooling: what a term does to the table, and what is not taken for one."""

from dataclasses import replace

import numpy as np
import pytest

from infield.session.budget import variance_budget
from infield.session.hysteresis import (
    ThermalTerm,
    heating_sense,
    joint_posterior,
    posterior_with,
    with_terms,
)
from infield.session.joint_update import Walk, likelihoods_of, with_thermal_terms
from infield.session.reasons import ThermalAction, ThermalKind, VarianceSource
from infield.session.results import UpdateResult
from infield.table.merge import merge_posterior
from infield.table.thermal_table import AgeingModel
from ins.verdicts import Outcome, sentence
from tests.scenarios.thermal_sessions import (
    SETTINGS,
    TWIN,
    aged_table,
    bins_of,
    draw,
    drawn_session,
    take,
    template,
)

WARM, COOL = 0, 9  # templates: a cold start and a cooling one


def pair(rate=0.0, *, seed=1, wrong=0.0):
    """A warm-up and a cooling session of one unit whose x reads `rate` per degC/min more; the
    second `wrong` on x.
    """
    rng = np.random.default_rng([seed, 170])
    table = aged_table()
    nodes, chosen = draw(table.covariance, rng), [template(WARM), template(COOL)]
    truths = []
    for one in chosen:
        data = bins_of(one, table)
        truths.append(data.bins.H @ nodes + rate * data.regressor(ThermalKind.RATE)[:, 0])
    truths[1][0::3] += wrong
    sessions, _ = take(table, chosen, truths, rng)
    return table, nodes, sessions


def test_sense_follows_the_change_over_three_degrees():
    up, down = np.linspace(20.0, 40.0, 401), np.linspace(40.0, 37.0, 61)
    sense = heating_sense(np.concatenate([up, down])[:, None])[:, 0]
    assert sense[0] == 0.0
    assert sense[60] == pytest.approx(1 - np.exp(-1.0), abs=1e-9)  # 3 degC after the start
    assert sense[400] == pytest.approx(1.0, abs=2e-3)
    assert sense[-1] == pytest.approx(2 * np.exp(-1.0) - 1, abs=2e-3)  # 3 degC after the turn


def test_joint_posterior_without_a_term_is_the_merge_one_after_the_other():
    table, _, sessions = pair()
    data = [bins_of(s, table) for s in sessions]
    joint = joint_posterior(table, data, ThermalKind.RATE, (False, False, False))
    current = table
    for session in sessions:
        d = bins_of(session, current)
        added = np.zeros_like(d.vector), np.zeros_like(d.information)
        current = merge_posterior(current, d.bins.H, *posterior_with(d, *added)).candidate
    assert joint.change == pytest.approx(current.parameters, abs=2e-5)
    assert joint.covariance == pytest.approx(current.covariance, abs=1e-7)


# a year of it: 5 times the sigma that one of these sessions has of a level gyro
AGEING = AgeingModel(common_deg_h_sqrt_year=0.02, shape_deg_h_sqrt_year=0.01)


def a_year_apart(sessions):
    """The sessions, each a year after the one before."""
    dated = []
    for k, session in enumerate(sessions):
        header = replace(session.run.header, start_utc=f"{2026 + k}-03-01T05:00:00Z")
        dated.append(replace(session, run=replace(session.run, header=header)))
    return dated


def test_sessions_a_year_apart_together_are_the_merge_one_after_the_other():
    """The table ages before each: 14 and 12 months. Aged up to the first alone, the joint table was
    surer than the one that was merged one after the other.
    """
    table, _, sessions = pair()
    dated = a_year_apart(sessions)
    data = likelihoods_of(dated, table, TWIN, SETTINGS, Walk(ageing=AGEING))
    joint = joint_posterior(table, data, ThermalKind.RATE, (False, False, False))
    current = table
    for session, months in zip(dated, (424.0 + 5.0 / 24.0, 365.0)):
        current = current.aged(months, AGEING)
        d = bins_of(session, current)
        added = np.zeros_like(d.vector), np.zeros_like(d.information)
        current = merge_posterior(current, d.bins.H, *posterior_with(d, *added)).candidate
    assert table.parameters + joint.change == pytest.approx(current.parameters, abs=2e-5)
    assert joint.covariance == pytest.approx(current.covariance, abs=1e-7)
    still = joint_posterior(
        table, [bins_of(s, table) for s in dated], ThermalKind.RATE, [False] * 3
    )
    x = table.values_of("x")
    assert np.diag(joint.covariance)[x].min() > 2.0 * np.diag(still.covariance)[x].min()


@pytest.mark.parametrize("ageing", [AgeingModel(), AGEING])
def test_a_fitted_rate_term_has_its_part_of_the_variance(ageing):
    table, _, sessions = pair(rate=0.05)
    dated, walk = a_year_apart(sessions), Walk(ageing=ageing)
    terms, judged, after = with_thermal_terms(dated, table, TWIN, SETTINGS, walk)
    assert terms[0].action is ThermalAction.RATE_TERM_FITTED
    runs = tuple(s.run for s in judged)
    result = UpdateResult(
        outcome=Outcome.ACCEPTED,
        reasons=(),
        before=table,
        after=after,
        sessions=tuple(judged),
        twin=TWIN,
        settings=SETTINGS,
        ageing=ageing,
        merged_runs=runs,
        terms=terms,
    )
    budget = variance_budget(result)
    P, added = after.covariance, sum(budget.parts.values())
    assert np.abs(added - P).max() < 1e-6 * np.diag(P).max()
    x = table.values_of("x")
    assert np.diag(budget.parts[VarianceSource.HEATING_AND_COOLING])[x].max() > 0.0


def test_a_rate_term_is_fitted_and_the_table_stays_free_of_it():
    table, nodes, sessions = pair(rate=0.05)
    terms, judged, after = with_thermal_terms(sessions, table, TWIN, SETTINGS)
    assert terms[0].action == "rate term fitted" and abs(terms[0].value - 0.05) < 3 * terms[0].sigma
    assert not terms[1].found and not terms[2].found
    assert all(s.verdict.accepted for s in judged) and after is not None
    x = table.values_of("x")
    z = (after.parameters - nodes)[x] / np.sqrt(np.diag(after.covariance)[x])
    assert np.max(np.abs(z)) < 3.5
    told = sentence(terms[0].reason)
    assert "rate term fitted: +0.0" in told and "steady temperature" in told


def test_without_a_term_the_sessions_stay_as_they_are():
    table, _, sessions = pair(seed=3)
    terms, judged, after = with_thermal_terms(sessions, table, TWIN, SETTINGS)
    assert [t.action for t in terms] == ["none found"] * 3
    assert after is None and all(a is b for a, b in zip(judged, sessions))


def test_a_wrong_session_is_not_explained_away():
    """0.06 deg/h on x in the cooling session alone: contradictory it stays, and the split is named
    as a possibility.
    """
    table, _, sessions = pair(seed=3, wrong=0.06)
    terms, judged, after = with_thermal_terms(sessions, table, TWIN, SETTINGS)
    assert [s.verdict.outcome for s in judged] == ["accepted", "inconsistent"]
    assert after is None
    assert terms[0].action is ThermalAction.SPLIT_OR_WRONG_SESSION


def test_a_sense_widens_and_a_rate_shifts():
    data = bins_of(template(WARM), aged_table())
    rate = ThermalTerm(
        axis="x",
        kind=ThermalKind.RATE,
        value=0.02,
        sigma=0.004,
        action=ThermalAction.RATE_TERM_FITTED,
    )
    sense = ThermalTerm(
        axis="y",
        kind=ThermalKind.SENSE,
        value=0.01,
        sigma=0.003,
        action=ThermalAction.SIGMA_WIDENED,
    )
    none = ThermalTerm(
        axis="z", kind=ThermalKind.RATE, value=0.5, sigma=0.3, action=ThermalAction.NONE_FOUND
    )
    mean, covariance = with_terms(data, (rate, sense, none))
    assert mean[0::3] == pytest.approx(0.02 * data.bins.rate_degC_min[:, 0])
    assert not mean[1::3].any() and not mean[2::3].any() and not covariance[2::3].any()
    assert covariance[0, 0] == pytest.approx((0.004 * data.bins.rate_degC_min[0, 0]) ** 2)
    assert covariance[-2, -2] == pytest.approx((0.01**2 + 0.003**2) * data.sense[-1, 1] ** 2)


def test_a_drawn_session_is_honest():
    """Mean squared normalised node error of 40 drawn sessions against their own truth."""
    rng, table = np.random.default_rng(40), aged_table()
    squares = []
    for k in range(40):
        nodes, one = draw(table.covariance, rng), template((WARM, COOL)[k % 2])
        found = drawn_session(one, table, bins_of(one, table).bins.H @ nodes, rng, day=1)
        e = found.merged.candidate.parameters - nodes
        squares.append(np.mean(e**2 / np.diag(found.merged.candidate.covariance)))
    assert 0.7 < np.mean(squares) < 1.35


@pytest.mark.parametrize("start", [WARM, COOL])
def test_a_gyro_that_aged_by_three_sigmas_does_not_look_like_a_term(start):
    """One session that only warms, or only cools: its sense is the table's own level. |z| of the
    term, mean of 12 draws, was 2.0 and 1.3 with the table's level believed; now it is noise (its
    mean has a sigma of 0.3).
    """
    off, z = 3.0 * np.hypot(0.006, 0.004), []
    for seed in range(12):
        rng, table = np.random.default_rng([seed, 171]), aged_table()
        chosen = template(start)
        truth = bins_of(chosen, table).bins.table_deg_h.copy()
        truth[0::3] += off
        sessions, _ = take(table, [chosen], [truth], rng)
        z.append(with_thermal_terms(sessions, table, TWIN, SETTINGS)[0][0].z)
    assert abs(np.mean(z)) < 0.9


def test_one_session_names_a_term_and_does_nothing_about_it():
    """0.3 deg/h per degC/min, beyond doubt in one warm-up: said, and the session is merged as if it
    were not there.
    """
    rng, table = np.random.default_rng([5, 172]), aged_table()
    chosen = template(WARM)
    data = bins_of(chosen, table)
    truth = data.bins.table_deg_h + 0.3 * data.regressor(ThermalKind.RATE)[:, 0]
    sessions, _ = take(table, [chosen], [truth], rng)
    terms, judged, after = with_thermal_terms(sessions, table, TWIN, SETTINGS)
    assert terms[0].action == "seen in one session" and not terms[0].found
    assert "not used unless another one shows it" in sentence(terms[0].reason)
    assert after is None and judged[0] is sessions[0]
