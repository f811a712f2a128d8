"""Is a log of the unit that it names? Marks of a session, the comparison with its history, and a
log that says wrongly that it was compensated.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from infield.reports.documents.session import session_document
from infield.session.identity.history import likeness
from infield.session.identity.marks import FORCE, UnitMarks, unit_marks
from infield.session.log import applied_table_of
from infield.session.one_run import OnRecord, take_run
from infield.session.reasons import SessionReason, WrongFact
from ins.documents import plain
from ins.records import InputError
from ins.units import DEG, MICRO_G
from ins.verdicts import Outcome, codes
from tests.infield.sessions import SETTINGS, TWIN, estimate_of, factory, simulated

READ = ("gyro_x_degC", "gyro_y_degC", "gyro_z_degC", "accel_x_degC", "accel_y_degC", "accel_z_degC")
NAMES = (*READ, FORCE, "accel_x_ug", "accel_y_ug")
PLACE = (45 * DEG, 7 * DEG)
# of the truth here: what repeats not, then what is the unit's own
SCATTER = np.array([*6 * [0.1], 40.0, 30.0, 30.0])
OWN = np.array([*6 * [0.3], 100.0, 100.0, 100.0])
NONE = np.zeros(9)


def drawn(rng, own, *, scale=1.0, warm=None):
    """A session of a unit: its own marks, the weather, what does not repeat, a part of its heat."""
    warm = rng.uniform(0.0, 1.0) if warm is None else warm
    heat = np.array([1.0, 2.0, 0.5, *6 * [0.0]])
    degC = np.array([*6 * [1.0], 0.0, 0.0, 0.0])
    value = own + scale * SCATTER * rng.standard_normal(9) + 20.0 * rng.standard_normal() * degC
    pattern = (1.0 - warm) * (heat - heat.sum() / 6.0 * degC)
    P = np.diag(SCATTER**2) + 1e4 * np.outer(degC, degC)
    return UnitMarks(NAMES, value + warm * heat, P, pattern, *PLACE)


def test_sound_sessions_are_rarely_beyond_the_limit_and_never_the_others():
    """Of 400 sessions 0.5 % may lie beyond by the rule, 2; 9 would be one in 4,000; of other units
    nine in ten do: biases find 94 of 100, the two together 99 and more.
    """
    rng = np.random.default_rng(5)
    wrong, missed, count = 0, 0, 400
    for _ in range(count):
        unit, other = (OWN * rng.standard_normal(9) for _ in range(2))
        known = [drawn(rng, unit) for _ in range(2)]
        wrong += not likeness(drawn(rng, unit), known).same
        missed += likeness(drawn(rng, other), known).same
    assert wrong <= 8 and missed <= 0.1 * count


def test_a_history_that_scatters_more_than_declared_widens_the_comparison():
    rng = np.random.default_rng(7)
    wide = [drawn(rng, NONE, scale=4.0) for _ in range(6)]
    assert sum(not likeness(drawn(rng, NONE, scale=4.0), wide).same for _ in range(40)) <= 3


def test_what_cannot_be_compared_says_nothing():
    rng = np.random.default_rng(8)
    now = drawn(rng, NONE)
    assert likeness(now, []) is None and likeness(None, [now]) is None
    one = now.of(("gyro_x_degC",))
    assert likeness(one, [now]) is None  # one thermometer alone tells the weather
    assert likeness(now.of((FORCE,)), [now]).dof == 1
    assert likeness(now, [now.of((FORCE,)), now]).sessions == 2


def marks_of(run):
    return unit_marks(run, TWIN, estimate_of(run))


def test_the_marks_of_a_session_are_what_was_put_into_it():
    run, raised = simulated(seed=3).run, np.array([0.0, 0.0, 200.0])
    imu, log = run.imu, run.temperature
    dv = imu.dv_m_s - raised * MICRO_G * imu.dt_s[:, None]
    gyro = log.gyro_degC + [0.5, 0.0, 0.0]
    changed = replace(run, imu=replace(imu, dv_m_s=dv), temperature=replace(log, gyro_degC=gyro))
    before, after = marks_of(run), marks_of(changed)
    moved = dict(zip(before.names, after.value - before.value))
    assert moved[FORCE] == pytest.approx(200.0, abs=1.0)
    assert moved["gyro_x_degC"] == pytest.approx(0.5, abs=1e-6)
    assert moved["gyro_y_degC"] == pytest.approx(0.0, abs=1e-6)
    assert {"accel_x_ug", "accel_y_ug"} <= set(before.names)  # the taxi turns


def test_level_accelerometers_show_where_the_vehicle_turns():
    """120 micro-g on y, of a twin that says so: the mark is the whole bias, whatever the twin."""
    run, imu = simulated(seed=3).run, simulated(seed=3).run.imu
    dv = imu.dv_m_s + np.array([0.0, 60.0, 0.0]) * MICRO_G * imu.dt_s[:, None]
    plain_marks, marks = marks_of(run), marks_of(replace(run, imu=replace(imu, dv_m_s=dv)))
    k = marks.names.index("accel_y_ug")
    sigma = np.sqrt(marks.covariance[k, k])
    assert marks.value[k] - plain_marks.value[k] == pytest.approx(60.0, abs=sigma)


def test_another_unit_is_found_and_its_own_log_is_not():
    run = simulated(seed=3).run
    known = [marks_of(simulated(seed=seed).run) for seed in (1, 2)]
    own = take_run(run, factory(), TWIN, SETTINGS, False, OnRecord(known))
    assert own.verdict.accepted and own.likeness.same
    log = run.temperature
    other = replace(run, temperature=replace(log, gyro_degC=log.gyro_degC + [1.0, -0.8, 0.0]))
    found = take_run(other, factory(), TWIN, SETTINGS, False, OnRecord(known))
    assert found.verdict.outcome is Outcome.INCONSISTENT and found.merged is None
    (reason, *_) = found.verdict.reasons
    assert reason.code is SessionReason.UNLIKE_THE_UNIT
    assert "unlike_the_unit" in codes([reason])[0]
    document = plain(session_document(found))
    assert json.loads(json.dumps(document))["unit_marks"]["sessions"] == 2
    unasked = replace(SETTINGS, check_unit=False)
    assert take_run(other, factory(), TWIN, unasked, False, OnRecord(known)).verdict.accepted


def declared(run):
    return replace(run, header=replace(run.header, applied_table_sha256="a" * 64))


def test_a_raw_log_that_is_declared_compensated_is_found_or_teaches_nothing():
    """The log has its table added once too often; where that is large it convicts, where it is
    small the session learns nothing along it.
    """
    run, table = simulated(seed=3).run, factory()
    for share, accepted in ((3.0, False), (0.2, True)):
        applied = table.replaced(parameters=share * table.parameters)
        bias = applied.settled_deg_h(
            np.stack([run.temperature.gyro_degC[:, k] for k in range(3)], 1)
        )
        at = np.stack(
            [np.interp(run.imu.time_s, run.temperature.time_s, column) for column in bias.T], 1
        )
        dtheta = run.imu.dtheta_rad + at * DEG / 3600.0 * run.imu.dt_s[:, None]
        wrong = declared(replace(run, imu=replace(run.imu, dtheta_rad=dtheta)))
        found = take_run(wrong, table, TWIN, SETTINGS, False, OnRecord((), applied))
        assert found.verdict.accepted == accepted
        if accepted:
            assert [s.fact for s in found.doubted][:1] == [WrongFact.COMPENSATION]
            sound = take_run(run, table, TWIN, SETTINGS, False)
            pattern = found.doubted[0].pattern
            W = [np.linalg.inv(one.estimate.covariance) for one in (found, sound)]
            assert pattern @ W[0] @ pattern < pattern @ W[1] @ pattern


def test_a_table_of_another_unit_is_bad_input():
    run = declared(simulated(seed=3).run)
    other = factory().replaced(imu_serial="SN-7")
    with pytest.raises(InputError, match=r"is a table of unit SN-7, needed one of SN-0042"):
        applied_table_of(run, lambda sha256: other)
