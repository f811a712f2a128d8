"""Wrong facts: the closed form against the full computation, chance, and whole sessions."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from scipy.stats import chi2

from alignment.reasons import AlignmentReason
from infield.session.acceptance import contradict, with_likeness
from infield.session.one_run import OnRecord, take_run
from infield.session.reasons import SessionReason, WrongFact
from infield.session.wrong_facts import (
    SessionInformation,
    Suspicion,
    _doubts,
    _lags,
    force_off_gravity,
    suspicions,
    with_suspicions,
    without_lag,
)
from ins.units import DEG, DEG_PER_HOUR, MILLIRADIAN
from ins.verdicts import Outcome, because
from tests.infield.sessions import (
    PARKED,
    SETTINGS,
    TAXI,
    TWIN,
    estimate,
    estimate_of,
    factory,
    simulated,
)

SCALE, CLOCK, STEP_deg_h = 0.02, 2e-3, 0.15


def measured(rng, prior, noise, pattern, size):
    """A session drawn from its prior with a wrong fact in it, and what a filter makes of it."""
    n = len(prior)
    bias = rng.multivariate_normal(np.zeros(n), prior)
    seen = bias + size * pattern + rng.multivariate_normal(np.zeros(n), noise)
    gain = prior @ np.linalg.inv(prior + noise)
    return SessionInformation(prior, gain @ seen, prior - gain @ prior)


def cases():
    rng = np.random.default_rng(5)
    A, B = rng.standard_normal((2, 9, 9))
    return rng, A @ A.T / 9 + 0.1 * np.eye(9), 0.3 * B @ B.T / 9 + 0.2 * np.eye(9)


def test_evidence_is_that_of_the_measurement_itself():
    """g and M are S^-1 y and S^-1 of the innovation y with S = C + R, never formed here."""
    rng, prior, noise = cases()
    learnt = measured(rng, prior, noise, np.ones(9), 2.0)
    g, M = learnt.evidence()
    S = prior + noise
    assert pytest.approx(np.linalg.inv(S), abs=1e-10) == M
    seen = np.linalg.solve(prior @ np.linalg.inv(S), learnt.mean)
    assert g == pytest.approx(np.linalg.solve(S, seen), abs=1e-10)


def test_widening_is_the_filter_run_again_under_the_wider_prior():
    rng, prior, noise = cases()
    learnt = measured(rng, prior, noise, np.ones(9), 0.0)
    doubt = np.outer(np.arange(9.0), np.arange(9.0))
    seen = np.linalg.solve(prior @ np.linalg.inv(prior + noise), learnt.mean)
    wider = prior + doubt
    gain = wider @ np.linalg.inv(wider + noise)
    found = learnt.widened(doubt)
    assert found.mean == pytest.approx(gain @ seen, abs=1e-9)
    assert found.covariance == pytest.approx(wider - gain @ wider, abs=1e-9)


def test_size_over_sigma_is_standard_normal_where_nothing_is_wrong():
    rng, prior, noise = cases()
    pattern, count = rng.standard_normal(9), 400
    z = []
    for _ in range(count):
        g, M = measured(rng, prior, noise, pattern, 0.0).evidence()
        z.append(pattern @ g / np.sqrt(pattern @ M @ pattern))
    low, high = chi2.ppf([0.001, 0.999], count)
    assert low < np.sum(np.square(z)) < high


def wrong(name):
    """A sound session with one fact made wrong, and the sign of its size."""
    run = simulated(seed=3).run
    site, imu = run.header.site, run.imu
    if name is WrongFact.LATITUDE:
        entered = replace(site, lat_rad=site.lat_rad + 0.4 * DEG)
        return replace(run, header=replace(run.header, site=entered))
    dtheta = imu.dtheta_rad.copy()
    if name is WrongFact.GYRO_SCALE:
        dtheta[:, 0] *= 1.0 + SCALE
    if name is WrongFact.GYRO_STEP:
        late = imu.time_s > 900.0
        dtheta[late, 1] += STEP_deg_h * DEG_PER_HOUR * imu.dt_s[late]
    if name is WrongFact.GYRO_AXES:
        dtheta -= np.cross([0.0, 8.0 * MILLIRADIAN, 0.0], dtheta)
    return replace(run, imu=replace(imu, dtheta_rad=dtheta))


@pytest.mark.parametrize(
    ("fact", "axis", "size"),
    [
        (WrongFact.LATITUDE, "", 0.4),
        (WrongFact.GYRO_SCALE, "x", SCALE),
        (WrongFact.GYRO_STEP, "y", STEP_deg_h),
        (WrongFact.GYRO_AXES, "y", 8.0),
    ],
)
def test_a_wrong_fact_is_found_with_its_size(fact, axis, size):
    """Far beyond doubt: the fact itself is among those convicted, and its size is right."""
    found = suspicions(estimate_of(wrong(fact)))
    own = [s for s in found if s.fact is fact and s.axis == axis and s.convicts]
    assert own, [(s.fact, s.axis, s.size, s.sigma) for s in found]
    best = max(own, key=lambda s: abs(s.sigmas))
    assert best.size == pytest.approx(size, abs=max(5.0 * best.sigma, 0.15 * abs(size)))
    if fact is WrongFact.GYRO_STEP:
        assert best.at_s == pytest.approx(900.0, abs=SETTINGS.bin_s)


@pytest.mark.parametrize("seed", [1, 3])
@pytest.mark.parametrize("off_deg", [2.0, -2.0, 0.3])
@pytest.mark.parametrize("segments", [TAXI, PARKED])
def test_a_wrong_latitude_is_said_once(seed, off_deg, segments):
    """47 deg for 45: a second line blamed gyros turned by 35 mrad, or a scale 5.5 % off, and a
    third the noise of the unit.
    """
    run = simulated(seed, segments).run
    site = replace(run.header.site, lat_rad=run.header.site.lat_rad + off_deg * DEG)
    moved = replace(run, header=replace(run.header, site=site))
    result = take_run(moved, factory(), TWIN, SETTINGS, repeated=False)
    assert result.verdict.outcome is Outcome.INCONSISTENT
    assert [r.code for r in result.verdict.reasons] == [AlignmentReason.WRONG_LATITUDE]


def test_a_latitude_and_turned_gyros_that_leave_the_same_are_rivals_in_one_sentence():
    """One heading: whichever came first by rounding was blamed alone. A fact that explains the
    session plainly better is blamed alone still, beside an alignment that doubts the latitude too.
    """
    pattern = np.ones(3)
    nan = float("nan")
    latitude = Suspicion(WrongFact.LATITUDE, "", nan, 0.1, 0.01, 3.8, True, pattern)
    turned = Suspicion(WrongFact.GYRO_AXES, "y", nan, -1.7453, 0.17452, 3.8, True, pattern)
    against = contradict(because(SessionReason.FORCE_OFF_GRAVITY))
    for order in ([latitude, turned], [turned, latitude]):
        (_, said) = with_likeness(against, order).reasons
        assert said.values["fact"] is WrongFact.LATITUDE_OR_AXES and said.values["axis"] == "y"
    better = replace(turned, sigma=0.1)
    wrong_place = contradict(because(AlignmentReason.WRONG_LATITUDE))
    for verdict in (against, wrong_place):
        (_, said) = with_likeness(verdict, [better, latitude]).reasons
        assert said.values["fact"] is WrongFact.GYRO_AXES
    assert with_likeness(wrong_place, [turned, latitude]) == wrong_place


def test_a_sound_session_is_not_convicted():
    assert not [s for s in suspicions(estimate()) if s.convicts]


def test_what_a_session_does_not_show_accuses_nobody():
    """A vehicle that never moves does not show gyros turned about its vertical: with the share of
    information not asked for, rounding accused them of 17 rad.
    """
    found = suspicions(estimate(seed=5, segments=PARKED))
    assert not [s for s in found if s.convicts]
    assert all(s.sigma < 0.5 / MILLIRADIAN for s in found if s.fact is WrongFact.GYRO_AXES)


def test_a_convicted_session_changes_nothing_and_says_why():
    result = take_run(wrong(WrongFact.GYRO_STEP), factory(), TWIN, SETTINGS, repeated=False)
    assert result.verdict.outcome is Outcome.INCONSISTENT
    assert any(r.code is SessionReason.LIKE_A_WRONG_FACT for r in result.verdict.reasons)
    assert result.merged is None


def test_a_doubted_session_teaches_less_along_the_fact_alone():
    """A step below the bound: sigma grows for the gyro that may have stepped, and for no other."""
    run = simulated(seed=3).run
    dtheta = run.imu.dtheta_rad.copy()
    late = run.imu.time_s > 900.0
    before = estimate_of(run)
    for step in np.arange(0.01, 0.15, 0.005):
        stepped = dtheta.copy()
        stepped[late, 1] += step * DEG_PER_HOUR * run.imu.dt_s[late]
        plain = estimate_of(replace(run, imu=replace(run.imu, dtheta_rad=stepped)))
        after, doubted = with_suspicions(plain)
        if doubted:
            break
    assert doubted and doubted[0].fact is WrongFact.GYRO_STEP
    own, other = after.covariance - before.covariance, slice(0, None, 3)
    assert np.diag(own)[1::3].max() > 0.0
    assert np.abs(np.diag(own)[other]).max() < 0.05 * np.diag(before.covariance)[other].max()


def test_a_clock_that_runs_fast_shows_in_gravity():
    run, at_rest = simulated(seed=3).run, estimate()
    assert force_off_gravity(run, TWIN, at_rest) is None
    fast = replace(run.imu, dt_s=run.imu.dt_s * (1.0 + CLOCK))
    reason = force_off_gravity(replace(run, imu=fast), TWIN, at_rest)
    assert reason is not None and reason.code is SessionReason.FORCE_OFF_GRAVITY
    assert reason.values["excess_ug"] == pytest.approx(-1e6 * CLOCK, rel=0.15)


def test_a_doubted_step_leaves_neither_side_of_it_as_the_truth():
    """A sound session of 17 bins drew a step of 3.6 sigma; with the later side alone in doubt the
    earlier one taught the table 4.4 sigma of error.
    """
    pattern = np.zeros((6, 3))
    pattern[4:, 1] = 1.0
    step = Suspicion(WrongFact.GYRO_STEP, "y", 1200.0, 0.02, 0.005, 4.2, False, pattern.ravel())
    early, late = np.array(_doubts(step)).reshape(2, 6, 3)[::-1]
    assert np.sum(early[:, [0, 2]] ** 2 + late[:, [0, 2]] ** 2) == 0.0
    assert early[:, 1] ** 2 + late[:, 1] ** 2 == pytest.approx(0.5 * 0.02**2)
    turned = replace(step, fact=WrongFact.LATITUDE, axis="")
    (alone,) = _doubts(turned)
    assert alone == pytest.approx(0.02 * pattern.ravel())


def less(run, bias_deg_h):
    """The run less a bias (seconds, 3) [deg/h] at the seconds of its thermometers."""
    imu, seconds = run.imu, run.temperature.time_s
    at = np.stack([np.interp(imu.time_s, seconds, b) for b in bias_deg_h.T], axis=1)
    dtheta = imu.dtheta_rad - at * DEG_PER_HOUR * imu.dt_s[:, None]
    return replace(run, imu=replace(imu, dtheta_rad=dtheta))


def test_a_compensated_log_that_is_declared_raw_is_found():
    """Less its whole table: 7 of 60 such logs were committed beyond 4 sigma."""
    run, table = simulated(seed=3).run, factory()
    compensated = less(run, table.settled_deg_h(run.temperature.gyro_degC))
    known = OnRecord(stored=table)
    found = take_run(compensated, table, TWIN, SETTINGS, False, known)
    assert found.verdict.outcome is Outcome.INCONSISTENT
    (reason, *_) = found.verdict.reasons
    assert reason.values["fact"] is WrongFact.COMPENSATED_BEFORE
    assert reason.values["size"] == pytest.approx(1.0, abs=4.0 * reason.values["sigma"])


def test_a_gyro_that_stepped_is_remembered_as_a_step():
    """x lower by 0.05 deg/h since the table was made, and a warm-up: a doubt of a lag, or of a step
    within the session, had let it pass.
    """
    run = simulated(seed=1).run
    step = np.tile([0.05, 0.0, 0.0], (run.temperature.time_s.size, 1))
    known = OnRecord(stored=factory())
    found = take_run(less(run, step), factory(), TWIN, SETTINGS, False, known)
    assert found.verdict.outcome is Outcome.INCONSISTENT and found.merged is not None
    assert [r.code for r in found.verdict.reasons] == [SessionReason.AGAINST_TABLE]
    assert not found.doubted


def lagging(degC, lag_s):
    """What a first-order lag makes of temperatures (n, 3), one a second, by Euler's rule."""
    felt = degC.copy()
    for k in range(1, len(degC)):
        felt[k] = felt[k - 1] + (degC[k - 1] - felt[k - 1]) / lag_s
    return felt


def test_a_lag_of_a_gyro_is_doubted_and_its_session_widened():
    """0.005 deg/h per degC and 600 s on gyro y as it warms from cold."""
    run = simulated(seed=3, start="cold").run
    degC = run.temperature.gyro_degC
    late = (lagging(degC, 600.0) - degC) * [0.0, 0.005, 0.0]
    before = estimate_of(less(run, -late))
    after, doubted = with_suspicions(before)
    assert (doubted[0].fact, doubted[0].axis) == (WrongFact.THERMAL_LAG, "y")
    assert doubted[0].size == pytest.approx(0.005, abs=4.0 * doubted[0].sigma)
    wider = np.sqrt(np.diag(after.covariance) / np.diag(before.covariance)).reshape(-1, 3)
    assert wider[:, 1].max() > 1.1 and wider[:, [0, 2]].max() < 1.05
    back = without_lag(after, doubted)
    assert back.mean_deg_h == pytest.approx(before.mean_deg_h, abs=1e-9)
    assert back.covariance == pytest.approx(before.covariance, abs=1e-9)


def test_the_pattern_of_a_lag_is_that_of_its_differential_equation():
    """At the middle of bins of five minutes, within 5 % of its largest value."""
    bins, run = estimate(seed=1).bins, simulated(seed=1).run
    degC, seconds = run.temperature.gyro_degC, run.temperature.time_s
    behind = lagging(degC, 600.0) - degC
    for k, pattern in enumerate(_lags(bins)):
        exact = np.interp(bins.centre_s, seconds, behind[:, k])
        assert pattern.bias_deg_h[:, k] == pytest.approx(exact, abs=0.05 * np.abs(exact).max())


def test_a_session_of_the_future_is_refused():
    run = simulated(seed=3).run
    start = datetime.fromisoformat(run.header.start_utc)
    for now, refused in ((start - timedelta(days=2), True), (start - timedelta(hours=14), False)):
        record = OnRecord(now=now.astimezone(UTC))
        found = take_run(run, factory(), TWIN, SETTINGS, False, record)
        codes = [reason.code for reason in found.verdict.reasons]
        assert (codes == [SessionReason.STARTS_IN_FUTURE]) == refused
        assert found.verdict.accepted != refused
