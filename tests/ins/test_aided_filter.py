"""The aided filter: its covariance against the nonlinear solution and filterpy, NEES over seeds,
gate, outage, cuts.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from infield.aided.flight import aided_noise
from ins import kalman
from ins.attitude import dcm_from_euler, dcm_from_rotation_vector, euler_from_dcm
from ins.earth import dcm_en, ecef_from_geodetic, geodetic_from_ecef, gravity_magnitude
from ins.filters.aided_filter import first_about, level_sigmas, solved
from ins.filters.aided_records import AidedNoise, AidedOptions, AidedStart, Antenna, fixes_of
from ins.filters.aided_tape import Task
from ins.filters.states import AIDED_ACCEL as ACCEL
from ins.filters.states import AIDED_GYRO as GYRO
from ins.filters.states import AIDED_POS as POS
from ins.filters.states import AIDED_THETA as THETA
from ins.filters.states import AIDED_VEL as VEL
from ins.records import InputError, NavState, Site
from ins.units import DEG_PER_HOUR, MICRO_G
from tests.infield.aided_cases import (
    LEVER_M,
    SITE,
    drawn_scales,
    errors,
    flown,
    gauss_markov,
    ideal,
    late_velocities,
    motion_errors,
    nees,
    twin_of,
)
from trajectories.simulator.segments import Climb, Cruise, TakeOff, TurnFlight

SILENT = AidedNoise(arw=0.0, vrw=0.0, gyro_walk=0.0, accel_walk=0.0)
START_S = 1.0
ANTENNA = Antenna(lever_arm_m=np.array(LEVER_M))


def truth_at(made, time_s: float = START_S, error=None) -> NavState:
    """The truth at a time, off by errors (15,) [computed - true]."""
    e = np.zeros(15) if error is None else error
    ref = made.reference
    k = int(np.argmin(np.abs(ref.time_s - time_s)))
    C_en = dcm_en(ref.lat_rad[k], ref.lon_rad[k])
    place = ecef_from_geodetic(ref.lat_rad[k], ref.lon_rad[k], ref.height_m[k]) + C_en @ e[POS]
    lat, lon, height = (float(a) for a in geodetic_from_ecef(place))
    back = dcm_en(lat, lon).T @ C_en  # Earth-frame errors, resolved where the solution now is
    C_nb = dcm_from_rotation_vector(e[THETA]) @ dcm_from_euler(
        ref.roll_rad[k], ref.pitch_rad[k], ref.heading_rad[k]
    )
    return NavState(
        time_s=float(ref.time_s[k]),
        site=Site(lat_rad=lat, lon_rad=lon, height_m=height),
        v_n_m_s=back @ (ref.v_n_m_s[k] + e[VEL]),
        C_nb=back @ C_nb,
    )


def begun(state, covariance) -> AidedStart:
    """A start that takes no biases off."""
    zero = np.zeros(3)
    return AidedStart(
        state=state, gyro_bias_rad_s=zero, accel_bias_m_s2=zero, covariance=covariance
    )


def fixes_from(made, twin):
    noise = twin.gnss
    return fixes_of(
        made.run.gnss,
        horizontal_m=noise.sigma_horizontal_m,
        vertical_m=noise.sigma_vertical_m,
        velocity_m_s=noise.sigma_velocity_m_s,
    )


def navigated(made, start, noise, fixes, **options):
    return at_antenna(made, start, noise, fixes, ANTENNA, **options)


def at_antenna(made, start, noise, fixes, antenna, **options):
    task = Task(
        start=start, noise=noise, fixes=fixes, antenna=antenna, options=AidedOptions(**options)
    )
    return solved(first_about(made.run.imu, task), task)


def prior(twin) -> np.ndarray:
    """Sigmas (15,) of the Monte Carlo's starts."""
    gyro, accel = twin.gyro.turn_on_deg_h * DEG_PER_HOUR, twin.accel.turn_on_ug * MICRO_G
    return np.concatenate([[1, 1, 1.5], [0.1] * 3, [0.01, 0.01, 0.05], [gyro] * 3, [accel] * 3])


def monte_carlo(technology: str, seed: int):
    twin = twin_of(technology, flicker=False)
    made, sigma = flown(ideal(), twin, seed, technology), prior(twin)
    error = sigma * np.random.default_rng([seed, 9]).standard_normal(15)
    error[GYRO] = error[ACCEL] = 0.0  # the turn-on of the simulated unit is that error
    start = begun(truth_at(made, error=error), np.diag(sigma**2))
    return made, navigated(made, start, aided_noise(twin, technology), fixes_from(made, twin))


QUIET_TWIN = replace(
    twin_of("rlg", flicker=False),
    gyro=replace(
        twin_of("rlg").gyro,
        arw_deg_sqrt_h=0.0,
        bias_instability_deg_h=0.0,
        rate_random_walk_deg_h_sqrt_h=0.0,
        turn_on_deg_h=0.0,
    ),
    accel=replace(
        twin_of("rlg").accel,
        vrw_ug_sqrt_hz=0.0,
        bias_instability_ug=0.0,
        rate_random_walk_ug_sqrt_h=0.0,
        turn_on_ug=0.0,
    ),
)


@pytest.mark.parametrize("state", ["position", "velocity", "theta", "gyro", "accel"])
def test_covariance_follows_the_nonlinear_solution(state):
    """A start that is off by e, without noise or fixes: P = e e' becomes e(t) e(t)' of the
    solution, over 4 min of flight.
    """
    rows = {"position": POS, "velocity": VEL, "theta": THETA, "gyro": GYRO, "accel": ACCEL}[state]
    size = {
        "position": 50.0,
        "velocity": 0.2,
        "theta": 1e-3,
        "gyro": 20 * DEG_PER_HOUR,
        "accel": 500 * MICRO_G,
    }[state]
    made, e = flown(ideal(), QUIET_TWIN, 1), np.zeros(15)
    e[rows] = size * np.array([0.7, -1.0, 0.4])
    none = fixes_from(made, QUIET_TWIN)
    none = replace(none, r_e_m=none.r_e_m * np.nan, v_n_m_s=none.v_n_m_s * np.nan)
    zero = np.zeros(3)

    def run(error):
        start = AidedStart(
            state=truth_at(made, 100.0, error),
            gyro_bias_rad_s=zero - error[GYRO],
            accel_bias_m_s2=zero - error[ACCEL],
            covariance=np.outer(e, e),
        )
        return navigated(made, start, SILENT, none)

    off, true = run(e), run(np.zeros(15))
    rows = [120, 240]
    seen = motion_errors(made.reference, off)[rows] - motion_errors(made.reference, true)[rows]
    for part, floor in ((POS, 0.05), (VEL, 2e-3), (THETA, 2e-7)):
        for k, row in enumerate(rows):
            sigma = np.sqrt(np.trace(off.covariance[row][part, part]))
            assert np.linalg.norm(seen[k, part]) == pytest.approx(sigma, rel=0.03, abs=floor)
            both = seen[k, part] @ off.covariance[row][part, part] @ seen[k, part]
            assert both == pytest.approx(
                np.linalg.norm(seen[k, part]) ** 2 * sigma**2, rel=0.05, abs=floor**4
            )


def deflected(made, angle_rad):
    """The run where gravity pulls north and east (2,) by an angle beyond the model."""
    imu, ref = made.run.imu, made.reference
    roll, pitch, yaw = (
        np.interp(imu.time_s, ref.time_s, np.unwrap(angle))
        for angle in (ref.roll_rad, ref.pitch_rad, ref.heading_rad)
    )
    pull = gravity_magnitude(SITE.lat_rad, SITE.height_m) * np.array([*angle_rad, 0.0])
    felt = np.einsum("nji,j->ni", dcm_from_euler(roll, pitch, yaw), pull)
    pushed = replace(imu, dv_m_s=imu.dv_m_s - imu.dt_s[:, None] * felt)
    return replace(made, run=replace(made.run, imu=pushed))


def exact_start(made):
    """The truth at 100 s, known to be that."""
    return begun(truth_at(made, 100.0), np.diag([0.0] * 15))


@pytest.mark.parametrize("axis", ["north", "east"])
def test_covariance_follows_a_deflected_vertical(axis):
    """One of 1 mrad that stays, without other noise or fixes, over 4 min of flight."""
    made = flown(ideal(), QUIET_TWIN, 1)
    none = fixes_from(made, QUIET_TWIN)
    none = replace(none, r_e_m=none.r_e_m * np.nan, v_n_m_s=none.v_n_m_s * np.nan)
    noise = replace(SILENT, deflection_rad=1e-3, deflection_m=1e12)
    angle = 1e-3 * np.array([axis == "north", axis == "east"])
    start = exact_start(made)
    true = navigated(made, start, noise, none)
    off = navigated(deflected(made, angle), start, noise, none)
    k = ("north", "east").index(axis)
    for row in (120, 240):
        sigma = np.sqrt(np.diag(true.covariance[row]))
        seen = motion_errors(made.reference, off) - motion_errors(made.reference, true)
        assert abs(seen[row, k]) == pytest.approx(sigma[k], rel=0.03)
        assert abs(seen[row, 3 + k]) == pytest.approx(sigma[3 + k], rel=0.03)


def test_a_deflected_vertical_is_found_and_taken_off():
    """1 mrad with the attitude known: 100 s after the last fix it would have moved the solution by
    0.5 g 1.2e-3 (100 s)^2 = 60 m, were it not taken off; sigmas of fixes make a few metres of it.
    """
    made = deflected(flown(ideal(), QUIET_TWIN, 1), np.array([1e-3, -0.7e-3]))
    fixes = fixes_from(made, QUIET_TWIN)
    hole = np.where(fixes.time_s > 300.0, np.nan, 0.0)[:, None]
    fixes = replace(fixes, r_e_m=fixes.r_e_m + hole, v_n_m_s=fixes.v_n_m_s + hole)
    noise = replace(SILENT, deflection_rad=1e-3, deflection_m=1e12)
    history = navigated(made, exact_start(made), noise, fixes)
    row = int(np.searchsorted(history.time_s, 400.0))
    found = motion_errors(made.reference, history)[row, :2]
    assert history.time_s[row] < 402.0 and np.linalg.norm(found) < 8.0
    assert (found**2 / history.variance[row, :2] < chi2.isf(1e-4, 1)).all()


@pytest.mark.parametrize("technology", ["rlg", "mems"])
def test_nees_and_nis_over_seeds(technology):
    """Ten flights of 8 min, scales and misalignments in their truth: NEES of all 15 states at 4
    times, of the scales at the end; NIS of each kind: 99.9 % bands.
    """
    made = [monte_carlo(technology, seed) for seed in range(10)]
    at = [60, 180, 300, 480]
    mean = np.mean([nees(*pair)[at] for pair in made])
    # times of one flight are not independent
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 15 * len(made)) / (15 * len(made))
    assert low < mean < high
    off = [drawn_scales(technology, seed) - pair[1].scales for seed, pair in enumerate(made)]
    scales = [e @ np.linalg.solve(pair[1].scales_covariance, e) for e, pair in zip(off, made)]
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 12 * len(made))
    assert low < np.sum(scales) < high
    for kind in range(2):
        nis = np.concatenate([h.nis[:, kind][np.isfinite(h.nis[:, kind])] for _, h in made])
        low, high = kalman.nis_band(3 * nis.size, 0.999)
        assert low < nis.mean() / 3 < high


@pytest.mark.slow
@pytest.mark.parametrize("technology", ["rlg", "mems"])
def test_nees_over_many_seeds(technology):
    """150 flights; each block of three states on its own as well, at the end of the flight."""
    found = []
    for seed in range(150):
        made, history = monte_carlo(technology, 1000 + seed)
        e, P = errors(made, history)[-1], history.covariance[-1]
        blocks = [e[b] @ np.linalg.solve(P[b, b], e[b]) / 3 for b in (POS, VEL, THETA, GYRO, ACCEL)]
        found.append([nees(made, history)[-1], *blocks])
    mean = np.mean(found, axis=0)
    print(technology, np.round(mean, 3))
    for value, dof in zip(mean, [15, 3, 3, 3, 3, 3]):
        low, high = chi2.ppf([5e-4, 1 - 5e-4], dof * len(found)) / (dof * len(found))
        assert low < value < high


def test_biases_of_accelerometers_move_with_the_shaking():
    """An airframe that begins to shake with 3 m/s^2: the sigmas of the biases grow to as much
    within seconds, not before.
    """
    twin, made = twin_of("mems"), flown(ideal(), twin_of("mems"), 3)
    imu = made.run.imu
    shakes = 3.0 * np.random.default_rng(5).standard_normal(imu.dv_m_s.shape)
    shakes *= (imu.time_s > 200.0)[:, None]
    dv = imu.dv_m_s + imu.dt_s[:, None] * shakes
    made = replace(made, run=replace(made.run, imu=replace(imu, dv_m_s=dv)))
    start = begun(truth_at(made), np.diag(prior(twin) ** 2))
    none = fixes_from(made, twin)
    none = replace(none, r_e_m=none.r_e_m * np.nan, v_n_m_s=none.v_n_m_s * np.nan)
    still, stirred = (
        navigated(made, start, replace(aided_noise(twin), stirred=by), none) for by in (0.0, 1.0)
    )
    more = np.sqrt(stirred.variance[:, ACCEL] - still.variance[:, ACCEL]).max(axis=1)
    before, after = (np.searchsorted(still.time_s, t) for t in (199.0, 215.0))
    assert more[before] < 0.2 and more[after] == pytest.approx(3.0, rel=0.2)
    assert stirred.shaking[0] < 0.1 and stirred.shaking[1] == pytest.approx(3.0, rel=0.5)


def test_gyro_noise_tells_no_scale():
    """Eight minutes of rest and straight ways with gyros 64 times as noisy: scales that nothing
    turned keep their prior, where noise that is taken for turns tells them to a third of it.
    """
    twin = twin_of("mems", flicker=False)
    gyro = replace(twin.gyro, arw_deg_sqrt_h=64.0 * twin.gyro.arw_deg_sqrt_h)
    twin = replace(twin, gyro=gyro)
    straight = (
        TakeOff(lift_off_speed_m_s=40.0),
        Climb(height_m=300.0, rate_m_s=5.0, speed_m_s=60.0),
        Cruise(duration_s=360.0),
    )
    made = flown(ideal(60.0, straight), twin, 2, "mems")
    start = begun(truth_at(made), np.diag(prior(twin) ** 2))
    noise = aided_noise(twin, "mems")
    history = navigated(made, start, noise, fixes_from(made, twin))
    sigma = np.sqrt(np.diag(history.scales_covariance))[[0, 2]]  # roll and yaw: none is flown
    assert sigma == pytest.approx(noise.gyro_scale, rel=1e-3)


def test_outage_coasts_with_growing_sigma_and_ends_within_it():
    """Two minutes without fixes: sigma of position grows by far, and the first fix afterwards is
    within four of them.
    """
    twin = twin_of("mems", flicker=False)
    made = flown(ideal(), twin, 4)
    gone = (made.run.gnss.time_s > 300.0) & (made.run.gnss.time_s <= 420.0)
    fixes = fixes_from(made, twin)
    hole = np.where(gone[:, None], np.nan, 0.0)
    fixes = replace(fixes, r_e_m=fixes.r_e_m + hole, v_n_m_s=fixes.v_n_m_s + hole)
    start = begun(truth_at(made), np.diag(prior(twin) ** 2))
    history = navigated(made, start, aided_noise(twin), fixes)
    sigma = np.sqrt(history.variance[:, :2].sum(axis=1))
    inside = (history.time_s > 300.5) & (history.time_s < 420.5)
    assert np.all(np.diff(sigma[inside]) > 0) and sigma[inside][-1] > 20 * sigma[inside][0]
    assert (history.used[gone] == 0).all()
    back = int(np.flatnonzero(~gone & (fixes.time_s > 420.0))[0])
    assert history.used[back, 0] == 2
    assert np.abs(history.residual[back, :2] / history.sigma[back, :2]).max() < 4.0


def test_gross_fixes_are_rejected_and_a_lasting_shift_is_followed_and_told():
    twin = twin_of("mems", flicker=False)
    made = flown(ideal(), twin, 5)
    fixes, t = fixes_from(made, twin), made.run.gnss.time_s
    start = begun(truth_at(made), np.diag(prior(twin) ** 2))
    single, lasting = np.isin(np.round(t), [200, 260, 261]), t > 350.0
    for wrong, reset in ((single, False), (lasting, True)):
        moved = replace(fixes, r_e_m=fixes.r_e_m + np.where(wrong[:, None], 300.0, 0.0))
        history = navigated(made, start, aided_noise(twin), moved, reset_s=10.0)
        assert (history.used[wrong & (t < 355.0), 0] == 1).all()
        assert (history.used[~wrong & (t > START_S + 1), 0] == 2).all()
        # the velocities went on to fit: a leap (4), whose size is in the sigma; nothing begun anew
        leaps = np.flatnonzero(history.used[:, 0] == 4)
        assert (leaps.size == 1 and 360.0 <= t[leaps[0]] <= 363.0) if reset else leaps.size == 0
        assert not (history.used[:, 0] == 3).any()
        after = history.variance[history.time_s > 365.0, :2].sum(axis=1)
        if reset:  # before, 300 m off at a sigma of centimetres
            assert np.sqrt(after).min() > 100.0


def test_a_lasting_shift_without_velocities_is_begun_anew():
    """Nothing tells whether the solution or the fixes leapt: the solution follows, and says so."""
    twin = twin_of("mems", flicker=False)
    made = flown(ideal(), twin, 5)
    fixes, t = fixes_from(made, twin), made.run.gnss.time_s
    start = begun(truth_at(made), np.diag(prior(twin) ** 2))
    shift = np.where((t > 350.0)[:, None], 300.0, 0.0)
    moved = replace(fixes, r_e_m=fixes.r_e_m + shift, v_n_m_s=fixes.v_n_m_s * np.nan)
    history = navigated(made, start, aided_noise(twin), moved, reset_s=10.0)
    resets = np.flatnonzero(history.used[:, 0] == 3)
    assert resets.size == 1 and 360.0 <= t[resets[0]] <= 363.0


def fitted_start(made, twin):
    """The truth, known as well as the Monte Carlo's starts are."""
    return begun(truth_at(made), np.diag(prior(twin) ** 2))


def gated(fixes_changed):
    """A MEMS flight whose filter is begun anew after 10 s: fixes (n,) as changed, and history."""
    twin = twin_of("mems", flicker=False)
    made = flown(ideal(), twin, 5)
    fixes = fixes_changed(fixes_from(made, twin))
    start = fitted_start(made, twin)
    return made, navigated(made, start, aided_noise(twin), fixes, reset_s=10.0)


def seen_at(fixes, seconds):
    return np.isin(np.round(fixes.time_s), seconds)[:, None]


def without_fixes(fixes, gone):
    hole = np.where(gone, np.nan, 0.0)
    return replace(fixes, r_e_m=fixes.r_e_m + hole, v_n_m_s=fixes.v_n_m_s + hole)


OUTAGE = np.arange(201, 212)


def test_an_outage_does_not_disarm_the_gate():
    """A fix 1 km off, 11 s without fixes, a fix 1 km off: both are rejected. The second was taken,
    500 m off, for the outage ran the clock of rejected fixes.
    """

    def wild(fixes):
        fixes = without_fixes(fixes, seen_at(fixes, OUTAGE))
        far = np.where(seen_at(fixes, [200, 212]), 1000.0 / np.sqrt(3.0), 0.0)
        return replace(fixes, r_e_m=fixes.r_e_m + far)

    made, history = gated(wild)
    k = int(np.argmin(np.abs(history.fix_time_s - 212.0)))
    assert (history.used[[k - 12, k], 0] == 1).all() and history.nis[k, 0] > 1e4
    assert (history.used[k + 1 :] == 2).all()
    assert np.abs(errors(made, history)[210:, :3]).max() < 5.0


def test_a_fix_that_fits_is_no_leap_and_velocities_keep_their_gate():
    """After a fix 1 km off and 11 s without fixes come velocities 50 m/s off without a position:
    rejected. Then positions that fit: used, no leap.
    """

    def wild(fixes):
        fixes = without_fixes(fixes, seen_at(fixes, OUTAGE))
        far = np.where(seen_at(fixes, [200]), 1000.0, 0.0)
        alone = seen_at(fixes, [212, 213, 214])
        hole, fast = np.where(alone, np.nan, 0.0), np.where(alone, 50.0, 0.0)
        return replace(fixes, r_e_m=fixes.r_e_m + far + hole, v_n_m_s=fixes.v_n_m_s + fast)

    made, history = gated(wild)
    k = int(np.argmin(np.abs(history.fix_time_s - 212.0)))
    assert (history.used[k : k + 3, 1] == 1).all()
    assert (history.used[k + 3 :] == 2).all()
    assert np.abs(errors(made, history)[210:, :3]).max() < 5.0


@pytest.mark.parametrize("every_s", [1, 4, 15])
def test_a_lasting_leap_is_followed_however_seldom_fixes_come(every_s):
    """300 m from 350 s on: no sooner than after 10 s, and after five fixes in a row at most that
    are further apart.
    """

    def leapt(fixes):
        seldom = np.round(fixes.time_s) % every_s != 0
        far = np.where((fixes.time_s > 350.0)[:, None], 300.0, 0.0)
        fixes = without_fixes(fixes, seldom[:, None])
        return replace(fixes, r_e_m=fixes.r_e_m + far)

    _, history = gated(leapt)
    leaps = history.fix_time_s[history.used[:, 0] == 4]
    assert leaps.size == 1 and not (history.used[:, 0] == 3).any()
    assert 360.0 <= leaps[0] <= 352.0 + max(11.0, 6.0 * every_s)


def test_a_lost_filter_is_begun_anew():
    """A solution 3.6 km and 50 m/s off that takes itself for good: begun anew after 10 s."""
    twin = twin_of("mems", flicker=False)
    made = flown(ideal(), twin, 5)
    error = np.zeros(15)
    error[POS], error[VEL] = [3000.0, -2000.0, 100.0], [40.0, 30.0, 0.0]
    start = replace(fitted_start(made, twin), state=truth_at(made, error=error))
    fixes = fixes_from(made, twin)
    history = navigated(made, start, aided_noise(twin), fixes, reset_s=10.0)
    anew = history.fix_time_s[history.used[:, 0] == 3]
    assert anew.size == 1 and 10.0 <= anew[0] <= 14.0
    assert np.abs(errors(made, history)[60:, :3]).max() < 10.0


def merged(imu, rows: int, first: int):
    """The log with `rows` of its rows summed to one, the first of them alone in one of `first`."""
    ends = np.arange(first, imu.rows + 1, rows)
    starts = np.concatenate([[0], ends[:-1]])
    total = [
        np.stack([a[i:j].sum(axis=0) for i, j in zip(starts, ends)])
        for a in (imu.dt_s, imu.dtheta_rad, imu.dv_m_s)
    ]
    return replace(
        imu, time_s=imu.time_s[ends - 1], dt_s=total[0], dtheta_rad=total[1], dv_m_s=total[2]
    )


def test_fix_within_a_long_row_is_met_at_its_own_time():
    """Rows of 0.5 s that end 0.3 s after each fix, a take-off at 2.5 m/s^2, nothing wrong:
    residuals of centimetres, where an acceleration forgotten would leave 0.11 m.
    """
    quiet = replace(
        QUIET_TWIN,
        gnss=replace(
            QUIET_TWIN.gnss, sigma_horizontal_m=1e-6, sigma_vertical_m=1e-6, sigma_velocity_m_s=1e-6
        ),
    )
    made = flown(ideal(), quiet, 1)
    start = begun(truth_at(made), np.zeros((15, 15)))
    fixes = fixes_from(made, quiet)
    long = replace(made, run=replace(made.run, imu=merged(made.run.imu, 5, 3)))
    found = navigated(long, start, SILENT, fixes)
    speed = np.linalg.norm(fixes.v_n_m_s, axis=1)
    rolling = (np.gradient(speed) > 2.0) & (speed > 10.0)
    assert rolling.sum() >= 8
    assert np.abs(found.residual[rolling, :3]).max() < 0.06
    assert np.abs(found.residual[rolling, 3:]).max() < 0.05


def drawn_start(made, twin, rng):
    """A start that is off by a draw of its covariance, biases as they are."""
    wide = prior(twin)
    error = wide * rng.standard_normal(15)
    error[GYRO] = error[ACCEL] = 0.0
    return begun(truth_at(made, error=error), np.diag(wide**2))


@pytest.mark.parametrize("estimated", [True, False])
def test_antenna_and_slow_error_are_in_the_covariance(estimated):
    """Ten flights with lever arm (1 m), delays (0.1 s) and slow error (1 m, 200 s) drawn: NEES of
    the 15 states, of the antenna, and NIS, with the antenna estimated and considered; a considered
    one keeps its prior.
    """
    twin, sigma = twin_of("mems", flicker=False), np.array([1.0, 1.0, 1.0, 0.1, 0.1])
    noise = replace(aided_noise(twin), slow_level_m=1.0, slow_down_m=1.0)
    means, antennas, ratios = [], [], []
    for seed in range(10):
        made, rng = flown(ideal(), twin, seed), np.random.default_rng([seed, 11])
        off = sigma * rng.standard_normal(5)
        start, fixes = drawn_start(made, twin, rng), fixes_from(made, twin)
        slow = gauss_markov(fixes.time_s, rng, 1.0, 200.0)
        C = dcm_en(made.run.header.site.lat_rad, made.run.header.site.lon_rad)
        v_n = late_velocities(made, fixes.time_s, fixes.v_n_m_s, off[4] - off[3])
        fixes = replace(
            fixes, time_s=fixes.time_s + off[3], r_e_m=fixes.r_e_m + slow @ C.T, v_n_m_s=v_n
        )
        antenna = Antenna(
            lever_arm_m=LEVER_M + off[:3], covariance=np.diag(sigma**2), estimated=estimated
        )
        history = at_antenna(made, start, noise, fixes, antenna)
        means.append(nees(made, history)[[180, 300, 480]])
        ratios.append(np.nanmean(history.nis, axis=0) / 3.0)
        end = history.antenna
        e = np.concatenate(
            [end.lever_arm_m - LEVER_M, [end.delay_s - off[3], end.velocity_delay_s - off[4]]]
        )
        antennas.append(e @ np.linalg.solve(end.covariance, e))
        if not estimated:
            np.testing.assert_array_equal(end.covariance, antenna.covariance)
            np.testing.assert_array_equal(end.lever_arm_m, antenna.lever_arm_m)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 150) / 150
    assert low < np.mean(means) < high
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 50)
    assert low < np.sum(antennas) < high
    if estimated:  # considered errors last, so that the innovations of a flight are large together
        assert (0.9 < np.mean(ratios, axis=0)).all() and (np.mean(ratios, axis=0) < 1.1).all()


@pytest.mark.parametrize("told", [True, False])
def test_each_type_of_fixes_has_a_slow_error_of_its_own(told):
    """Ten flights whose fixes change between two types every 5 to 40 s, each with its own slow
    error (3 m and 0.3 m, 200 s), which goes on while the other type is there: NEES of the 15
    states and NIS at the changes. With one slow error for both the fixes at the changes contradict
    it by far.
    """
    twin = twin_of("mems", flicker=False)
    sizes = {"slow_level_m": 3.0, "slow_down_m": 3.0}
    noise = replace(aided_noise(twin), **sizes, slow_other_level_m=0.3, slow_other_down_m=0.3)
    means, at_changes = [], []
    for seed in range(10):
        made, rng = flown(ideal(), twin, 40 + seed), np.random.default_rng([seed, 13])
        start, fixes = drawn_start(made, twin, rng), fixes_from(made, twin)
        changes = np.cumsum(rng.uniform(5.0, 40.0, 200))
        other = np.searchsorted(changes, fixes.time_s) % 2 == 1
        both = [gauss_markov(fixes.time_s, rng, sigma, 200.0) for sigma in (3.0, 0.3)]
        C = dcm_en(made.run.header.site.lat_rad, made.run.header.site.lon_rad)
        off = np.where(other[:, None], both[1], both[0])
        fixes = replace(fixes, r_e_m=fixes.r_e_m + off @ C.T, other_type=other & told)
        history = navigated(made, start, noise, fixes)
        means.append(nees(made, history)[[180, 300, 480]])
        late = np.flatnonzero(np.diff(other)) + 1
        at_changes.extend(history.nis[late, 0][np.isfinite(history.nis[late, 0])])
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 150) / 150
    jumps = kalman.nis_band(3 * len(at_changes), 0.999)
    if told:
        assert low < np.mean(means) < high
        assert jumps[0] < np.mean(at_changes) / 3.0 < jumps[1]
    else:
        assert np.mean(at_changes) / 3.0 > 2.0


def test_roll_pitch_heading_sigmas_are_those_of_their_errors():
    """Monte Carlo of small NED attitude errors at a steep attitude."""
    rng = np.random.default_rng(2)
    root = 1e-4 * rng.standard_normal((3, 3))
    C = dcm_from_euler(0.4, -0.7, 2.0)
    phi = rng.standard_normal((20000, 3)) @ root.T
    angles = np.stack(euler_from_dcm(dcm_from_rotation_vector(phi) @ C), axis=1) - np.stack(
        euler_from_dcm(C)
    )
    sigma = level_sigmas((root @ root.T)[None], C[None])[0]
    np.testing.assert_allclose(angles.std(axis=0), sigma, rtol=0.03)


def test_bad_input_is_named():
    twin = twin_of("rlg")
    made = flown(ideal(), twin, 1)
    good = begun(truth_at(made), np.eye(15))
    fixes = fixes_from(made, twin)
    with pytest.raises(InputError, match="positive semidefinite"):
        navigated(made, replace(good, covariance=-np.eye(15)), SILENT, fixes)
    with pytest.raises(InputError, match="needed a second of rows"):
        short = replace(made, run=replace(made.run, imu=made.run.imu.between(0.0, 1.5)))
        navigated(short, good, SILENT, fixes)
    bad = np.array(made.run.imu.dv_m_s)
    bad[40, 1] = np.nan
    with pytest.raises(InputError, match="row"):
        holed = replace(made, run=replace(made.run, imu=replace(made.run.imu, dv_m_s=bad)))
        navigated(holed, good, SILENT, fixes)


def test_a_straight_flight_shows_no_heading():
    """Ten minutes of straight and level flight of a MEMS unit after a turn: the heading's sigma
    with fixes is that without them, to 5 %. Noise of the specific force, taken for motion that the
    fixes do not confirm, made it 0.63 of that.
    """
    segments = (TakeOff(), Climb(height_m=300.0, rate_m_s=5.0, speed_m_s=60.0))
    segments = (*segments, TurnFlight(angle_deg=120.0), Cruise(duration_s=600.0))
    twin = twin_of("mems", flicker=False)
    made, sigma = flown(ideal(60.0, segments), twin, 1, "mems"), prior(twin)
    start = begun(truth_at(made), np.diag(sigma**2))
    fixes = fixes_from(made, twin)
    gone = np.where(fixes.time_s > fixes.time_s[-1] - 500.0, np.nan, 0.0)[:, None]
    without = replace(fixes, r_e_m=fixes.r_e_m + gone, v_n_m_s=fixes.v_n_m_s + gone)
    noise = aided_noise(twin, "mems")
    held, free = (navigated(made, start, noise, f) for f in (fixes, without))
    ratio = np.sqrt(held.variance[-1, 8] / free.variance[-1, 8])
    assert 0.95 < ratio < 1.02
