"""Fixes left out of an aided flight on purpose: not used, scored, and honest; how a vehicle goes
meanwhile.
"""

import numpy as np
import pytest

from infield.aided import flight
from infield.aided.flight import Aiding, navigate_aided
from infield.aided.left_out import OutageScore, usual_motion, with_usual_motion
from ins.earth import displacement_ned
from ins.filters.aided_records import Fixes
from ins.records import InputError
from ins.verdicts import codes
from tests.infield.aided_cases import flown, ideal, twin_of
from tests.infield.car_cases import street
from trajectories.simulator.segments import Segment, Turn

PARK_S = 180.0
SPAN = (350.0, 410.0)


def fly(seed: int, *spans):
    made, twin = flown(ideal(PARK_S), twin_of("mems"), 800 + seed), twin_of("mems")
    run = made.run
    found = navigate_aided(
        run, run.imu, twin, rest=None, gyro_sigma_deg_h=None, aiding=Aiding(left_out=spans)
    )
    return made, found


def test_score_is_the_error_against_the_truth():
    """A minute without fixes: the fixes there are unseen, and the error against them is that
    against the truth but for their own noise (0.5 m).
    """
    made, found = fly(1, SPAN)
    (score,), history = found.outage_scores, found.history
    inside = (history.fix_time_s >= SPAN[0]) & (history.fix_time_s <= SPAN[1])
    assert (history.used[inside] == 0).all() and score.fixes == inside.sum()
    rows = (history.time_s >= SPAN[0]) & (history.time_s <= SPAN[1])
    ref, t = made.reference, history.time_s[rows]
    off = displacement_ned(
        history.lat_rad[rows],
        history.lon_rad[rows],
        lat0_rad=np.interp(t, ref.time_s, ref.lat_rad),
        lon0_rad=np.interp(t, ref.time_s, ref.lon_rad),
        height0_m=np.interp(t, ref.time_s, ref.height_m),
    )
    true = np.linalg.norm(off, axis=1)
    assert score.rms_level_m == pytest.approx(np.sqrt(np.mean(true**2)), abs=0.6)
    assert score.end_level_m == pytest.approx(true[-1], abs=2.0)
    assert score.sigma_end_level_m > 5.0
    assert [w.why for w in found.weak] == ["outage"]


def test_errors_in_outages_are_within_their_sigmas():
    """Four flights of two outages: error over sigma, RMS over all, 0.5 to 1.5."""
    ratios = []
    for seed in range(4):
        _, found = fly(seed, (300.0, 330.0), (450.0, 510.0))
        ratios += [score.error_over_sigma for score in found.outage_scores]
    assert len(ratios) == 8 and 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.5
    assert max(ratios) < 3.0


def test_stretches_that_cannot_be_scored_are_named():
    with pytest.raises(InputError, match="outage 600:60: ends at 660 s, needed a stretch within"):
        fly(1, (600.0, 660.0))
    with pytest.raises(InputError, match="no satellite fix in it"):
        fly(1, (300.2, 300.4))


SECONDS = np.arange(1.0, 1201.0)


def moving(v_n_m_s: np.ndarray) -> Fixes:
    """Twenty minutes of fixes at these velocities."""
    ones = np.ones((SECONDS.size, 3))
    return Fixes(
        time_s=SECONDS,
        r_e_m=7e6 * ones,
        v_n_m_s=v_n_m_s,
        sigma_position_m=ones,
        sigma_velocity_m_s=0.1 * ones,
    )


def wandering(sigma_m_s: float, lasts_s: float, seed: int) -> np.ndarray:
    """Velocities (1200, 3) that are a first-order process, level and half as large down."""
    rng, fades = np.random.default_rng(seed), np.exp(-1.0 / lasts_s)
    v = np.zeros((SECONDS.size, 3))
    for k in range(1, SECONDS.size):
        v[k] = fades * v[k - 1] + np.sqrt(1.0 - fades**2) * rng.standard_normal(3)
    return sigma_m_s * v * [1.0, 1.0, 0.5]


def test_the_usual_motion_is_the_size_and_time_constant_of_velocities():
    """A process of 4 m/s and 12 s: 95 % of the level speeds, 2.45 sigmas, for one component, and
    the time constant to half of it (20 min are 100 of them); nothing of a cruise or a parked
    vehicle.
    """
    found = [usual_motion(moving(wandering(4.0, 12.0, seed))) for seed in range(4)]
    assert np.mean([f.level_m_s for f in found]) == pytest.approx(4.0 * 2.45, rel=0.2)
    assert np.mean([f.lasts_s for f in found]) == pytest.approx(12.0, rel=0.5)
    noise = 0.1 * np.random.default_rng(1).standard_normal((SECONDS.size, 3))
    assert usual_motion(moving(noise + [200.0, 0.0, 0.0])) is None
    assert usual_motion(moving(noise)) is None


def test_what_is_usual_is_asked_without_fixes_alone():
    """Velocities of zero once a second from 3 s on behind the last one, with the variance of white
    noise that does the same; with fixes throughout nothing changes, and the receiver's rows alone
    come back.
    """
    fixes = moving(wandering(4.0, 12.0, 1))
    usual = usual_motion(fixes)
    same, own = with_usual_motion(fixes, usual, 1200.0)
    assert same is fixes and own.all()
    v_n = fixes.v_n_m_s.copy()
    v_n[300:330] = np.nan
    more, own = with_usual_motion(moving(v_n), usual, 1202.0)
    added = more.time_s[~own]
    assert (np.diff(more.time_s) > 0.0).all() and np.array_equal(more.time_s[own], SECONDS)
    assert added.min() >= 300.0 + 3.0 and added.max() <= 331.0 and added.size == 28
    assert (more.v_n_m_s[~own] == 0.0).all() and np.isnan(more.r_e_m[~own]).all()
    variance = 2.0 * usual.lasts_s * usual.level_m_s**2
    assert more.sigma_velocity_m_s[~own][0, 0] ** 2 == pytest.approx(variance)


def strolls(seed: int) -> tuple[Segment, ...]:
    """Forty legs of 6 to 14 s at 2 to 5 m/s, each after a turn to either side or about."""
    rng, legs = np.random.default_rng([seed, 8]), []
    for _ in range(40):
        legs.append(street(rng.uniform(2.0, 5.0), rng.uniform(6.0, 14.0)))
        legs.append(Turn(angle_deg=float(rng.choice([-150.0, -90.0, 90.0, 150.0])), speed_m_s=2.0))
    return tuple(legs)


@pytest.mark.slow
def test_a_vehicle_that_wanders_goes_on_as_usual(monkeypatch):
    """Three drives of two outages of 60 s: what is usual takes errors and sigmas down, and the
    errors are those of the sigmas; the receiver's fixes alone are in the history.
    """
    spans = ((250.0, 310.0), (400.0, 460.0))
    found: dict[bool, list[OutageScore]] = {True: [], False: []}
    for usual in found:
        if not usual:
            monkeypatch.setattr(flight, "usual_motion", lambda fixes: None)
        for seed in range(3):
            run = flown(ideal(60.0, strolls(seed)), twin_of("mems"), seed, "mems").run
            flew = navigate_aided(
                run,
                run.imu,
                twin_of("mems"),
                rest=None,
                gyro_sigma_deg_h=None,
                aiding=Aiding(left_out=spans),
            )
            assert ("usual_motion" in codes(flew.notes)) is usual
            assert flew.history.fix_time_s.size == flew.every.time_s.size
            found[usual] += flew.outage_scores
    mean = {k: np.mean([s.rms_level_m**2 for s in scores]) for k, scores in found.items()}
    sigma = {k: np.mean([s.sigma_end_level_m for s in scores]) for k, scores in found.items()}
    assert mean[True] < mean[False] and sigma[True] < sigma[False]
    over = [s.error_over_sigma for s in found[True]]
    assert 0.5 < np.sqrt(np.mean(np.square(over))) < 1.5 and max(over) < 3.0
