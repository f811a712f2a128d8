"""The gyro half of the catalogue: each effect against a value worked by hand, its needs, its
limits, its continuity.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from infield.thermometer.gyro_temperature import gyro_temperature
from ins.errors.base import AXIS, GYROS, Effect
from ins.errors.gyro.compensation import COMPENSATION, table_slope
from ins.errors.gyro.events import GYRO_EVENTS
from ins.errors.gyro.noise import GYRO_NOISE
from ins.errors.gyro.rate import GYRO_RATE
from ins.errors.gyro.thermal import GYRO_THERMAL
from ins.errors.parts.thermal_memory import lagged
from ins.errors.telemetry import total
from ins.records import InputError, TemperatureLog
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, HOUR, STANDARD_GRAVITY
from tests.ins.errors.effects_fixture import bare, cooling_run, flight_run, parked_run, taxi_run
from trajectories.simulator.imperfections import sensitivity

EFFECTS = {e.id: e for e in GYRO_EVENTS + GYRO_THERMAL + GYRO_RATE + GYRO_NOISE + COMPENSATION}
TURN_RAD_S = 90 * DEG / 60  # of the taxi
ONE_PART = 1e-9
SETS = {
    "parked": [parked_run(600)],
    "parked and cooling": [parked_run(2000), cooling_run(2000)],
    "taxi": [taxi_run()],
    "flight": [flight_run()],
    "bare taxi": [bare(taxi_run())],
    "bare": [bare(parked_run(300))],
    "one instant": [parked_run(1)],
}


def shape_of(effect, share=0.4, **given):
    """Values of the shape parameters between their bounds."""
    return {p.name: p.low + share * (p.high - p.low) for p in effect.shape} | given


def series(key, run, target="gyro_y", index=0, **shape):
    """Series in deg/h on the target's own gyro; the other two must be zero."""
    effect = EFFECTS[key]
    gyro = effect.traces(run, target, shape_of(effect, **shape))[index].gyro_rad_s
    assert not np.delete(gyro, AXIS[target], axis=1).any()
    return gyro[:, AXIS[target]] / DEG_PER_HOUR


def still(run, degC, rate_degC_min=0.0):
    """The run with all gyros at one temperature."""
    return replace(
        run,
        temperature_degC=np.full((run.n, 3), degC),
        temperature_rate_degC_min=np.full((run.n, 3), rate_degC_min),
    )


def turning(rate_rad_s, n=10):
    """A run that turns about all three axes at one rate."""
    return replace(parked_run(n), rate_rad_s=np.full((n, 3), rate_rad_s))


# the catalogue as a whole


def test_the_gyro_half_is_complete():
    named = {e.name for e in EFFECTS.values()}
    # three slow processes share one name; two faults of the compensation
    assert len(named) == 29 - 3 + 1 + 2
    assert all(isinstance(e, Effect) for e in EFFECTS.values())
    assert len(EFFECTS) == len(GYRO_EVENTS + GYRO_THERMAL + GYRO_RATE + GYRO_NOISE + COMPENSATION)
    assert {e.repeats for e in EFFECTS.values()} == {"R", "E", "S", "P"}


@pytest.mark.parametrize("key", EFFECTS)
@pytest.mark.parametrize("held", SETS)
def test_finite_traces_or_a_need_in_words(key, held):
    effect, runs = EFFECTS[key], SETS[held]
    for target in effect.targets:
        if need := effect.needs(runs, target):
            assert not need.endswith(".") and len(need) < 80
            continue
        for run in runs:
            traces = effect.traces(run, target, shape_of(effect))
            noises = effect.noise(run, target, shape_of(effect))
            assert (len(traces), len(noises)) == (
                (0, 1) if effect.repeats == "S" else (len(effect.coefficients), 0)
            )
            for trace in traces:
                assert trace.gyro_rad_s.shape == (run.n, 3) and np.isfinite(trace.gyro_rad_s).all()
                assert trace.accel_m_s2 is None and trace.temperature_degC is None
            for noise in noises:
                assert noise.channel == target and (
                    noise.profile is None or np.all(noise.profile >= 0)
                )


@pytest.mark.parametrize("key", [k for k, e in EFFECTS.items() if e.shape and e.repeats != "S"])
def test_continuous_in_the_shape(key):
    """The refinement needs a residual without jumps: a thousandth of the parameter moves the trace
    by little.
    """
    effect, run = EFFECTS[key], taxi_run() if key == "gyro_lock_in" else parked_run()
    if key == "gyro_thermal_hysteresis":
        run = cooling_run()
    for p in effect.shape:
        middle = 1000.3 if p.of_time else float(np.sqrt(p.low * p.high))
        near = middle + (0.01 if p.of_time else 1e-3 * middle)
        before, after = (
            effect.traces(run, effect.targets[-1], {p.name: v}) for v in (middle, near)
        )
        for a, b in zip(before, after):
            moved = np.linalg.norm(b.gyro_rad_s - a.gyro_rad_s)
            assert 0 < moved < 0.05 * np.linalg.norm(a.gyro_rad_s)


# temperature


@pytest.mark.parametrize(
    ("key", "deg_h"),
    [("gyro_thermal_linear", -5.0), ("gyro_thermal_quadratic", 25.0), ("gyro_thermal_rate", 0.3)],
)
def test_terms_of_temperature_at_20_degC(key, deg_h):
    np.testing.assert_allclose(series(key, still(parked_run(5), 20.0, 0.3)), deg_h, rtol=ONE_PART)


def test_rate_is_derived_where_the_run_does_not_hold_it():
    run = parked_run()
    derived = series("gyro_thermal_rate", replace(run, temperature_rate_degC_min=None))
    np.testing.assert_allclose(derived[1:-1], series("gyro_thermal_rate", run)[1:-1], rtol=1e-6)


def test_gradient_is_the_reading_of_the_gyro_itself():
    run = replace(parked_run(4), gradient_degC=np.tile([1.0, 2.0, 3.0], (4, 1)))
    np.testing.assert_allclose(series("gyro_thermal_gradient", run, "gyro_z"), 3.0, rtol=ONE_PART)


def test_each_gyro_has_its_own_temperature():
    run = parked_run(5)
    x, z = (series("gyro_thermal_linear", run, target) for target in ("gyro_x", "gyro_z"))
    np.testing.assert_allclose(z - x, 2.0)


def test_lag_of_a_ramp_and_of_an_exponential():
    t = np.arange(0.0, 7200.0)
    ramp = lagged(t, 20.0 + 0.01 * t, 300.0)
    np.testing.assert_allclose(ramp, 20.0 + 0.01 * t - 3.0 * (1 - np.exp(-t / 300.0)), atol=1e-9)
    # T = exp(-t / a): the lag b adds (b/a) / (1 - b/a) (exp(-t/a) - exp(-t/b)) to it
    a, b = 1200.0, 300.0
    expected = np.exp(-t / a) + (b / a) / (1 - b / a) * (np.exp(-t / a) - np.exp(-t / b))
    np.testing.assert_allclose(lagged(t, np.exp(-t / a), b), expected, atol=1e-6)


def test_short_lag_is_a_term_in_the_rate():
    run, tau_s = parked_run(), 5.0
    lag = series("gyro_thermal_lag", run, tau_s=tau_s)
    rate = series("gyro_thermal_rate", run) / 60.0  # deg/h per degC/s
    # next term: tau / 1200 s
    np.testing.assert_allclose(lag[60:], -tau_s * rate[60:], rtol=1.1 * tau_s / 1200.0)


def test_lag_does_not_depend_on_the_instants():
    fine, coarse = parked_run(36_000, dt_s=0.1), parked_run(360, dt_s=10.0)
    a, b = (series("gyro_thermal_lag", run, tau_s=300.0) for run in (fine, coarse))
    np.testing.assert_allclose(
        np.interp(coarse.time_s, fine.time_s, a), b, atol=0.03 * np.abs(b).max()
    )
    gap = np.r_[0:1200, 1800:3600]
    run = parked_run()
    holed = replace(run, time_s=run.time_s[gap], temperature_degC=run.temperature_degC[gap])
    after = series("gyro_thermal_lag", holed, tau_s=300.0)[-900:]
    np.testing.assert_allclose(
        after, series("gyro_thermal_lag", run, tau_s=300.0)[-900:], atol=0.02 * np.abs(b).max()
    )


def test_hysteresis_is_half_of_the_split():
    up_and_down = np.concatenate([np.linspace(20, 40, 2001), np.linspace(40, 20, 2001)])
    run = replace(parked_run(4002), temperature_degC=np.repeat(up_and_down[:, None], 3, axis=1))
    found = series("gyro_thermal_hysteresis", run, width_degC=4.0)
    assert found[0] == pytest.approx(0.0, abs=ONE_PART)  # at rest in the middle
    np.testing.assert_allclose(found[[1000, 2000, 3500]], [1.0, 1.0, -1.0], rtol=ONE_PART)
    # 2 degC after the reversal: half of the way
    assert found[2001 + 200] == pytest.approx(0.0, abs=1e-6)


def test_warmup_from_power_on():
    found = series("gyro_warmup_transient", parked_run(), tau_s=600.0)
    assert found[599] == pytest.approx(np.exp(-599.5 / 600.0), rel=ONE_PART)


def test_mode_hop_is_periodic_in_temperature():
    for degC, sine, cosine in (
        (25.0, 0.0, 1.0),
        (26.0, 1.0, 0.0),
        (29.0, 0.0, 1.0),
        (23.0, 0.0, -1.0),
    ):
        run = still(parked_run(2), degC)
        found = [series("gyro_mode_hop", run, index=k, period_degC=4.0)[0] for k in range(2)]
        assert found == pytest.approx([sine, cosine], abs=ONE_PART)


def test_grid_of_the_period_finds_a_period_between_its_points():
    """Over 40 degC, sine and cosine at the nearest grid point hold most of a wave half a step
    away.
    """
    effect = EFFECTS["gyro_mode_hop"]
    grid = effect.shape[0].grid()
    worst = 2.0 / (1.0 / grid[4] + 1.0 / grid[5])
    T = np.linspace(5.0, 45.0, 2000)
    run = replace(parked_run(2000), temperature_degC=np.repeat(T[:, None], 3, axis=1))
    A = np.stack(
        [series("gyro_mode_hop", run, index=k, period_degC=grid[4]) for k in range(2)], axis=1
    )
    wave = np.sin(2 * np.pi * T / worst + 0.4)
    kept = A @ np.linalg.lstsq(A, wave, rcond=None)[0]
    assert np.linalg.norm(kept) > 0.75 * np.linalg.norm(wave)


# power-on, time, events


def test_constant_and_ramp():
    run = parked_run()
    np.testing.assert_allclose(series("gyro_turn_on_bias", run), 1.0)
    np.testing.assert_allclose(
        series("gyro_rate_ramp", run)[[0, 1799]], [0.5 / HOUR, 1799.5 / HOUR]
    )


def test_step_takes_its_part_of_the_interval():
    found = series("gyro_bias_step", parked_run(8), onset_s=3.25)
    np.testing.assert_allclose(found, [0, 0, 0, 0.75, 1, 1, 1, 1])


def test_common_mode_is_one_step_on_all_gyros():
    (trace,) = EFFECTS["gyro_common_mode"].traces(parked_run(4), "gyro_x", {"onset_s": 2.0})
    np.testing.assert_allclose(
        trace.gyro_rad_s / DEG_PER_HOUR, np.repeat([[0.0], [0.0], [1.0], [1.0]], 3, axis=1)
    )


# rotation, specific force, field


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_scale_errors_of_a_taxi_turn(sense):
    """1 ppm of 1.5 deg/s is 0.0054 deg/h."""
    run = still(turning(sense * TURN_RAD_S), 35.0)
    assert series("gyro_scale_factor", run)[0] == pytest.approx(sense * 0.0054)
    assert series("gyro_scale_asymmetry", run)[0] == pytest.approx(0.0054)
    assert series("gyro_scale_thermal", run)[0] == pytest.approx(sense * 0.054)


@pytest.mark.parametrize(("axis", "names"), [("x", "yz"), ("y", "xz"), ("z", "xy")])
def test_misalignment_is_the_twins(axis, names):
    """1 mrad of 10 deg/h is 0.01 deg/h; the two rates come in the order of the names."""
    effect = EFFECTS[f"gyro_misalignment_{axis}"]
    assert [c.name for c in effect.coefficients] == [f"to_{name}" for name in names]
    for k, name in enumerate(names):
        rates = {n: 10.0 * DEG_PER_HOUR * (n == name) for n in "xyz"}
        run = replace(parked_run(3), rate_rad_s=np.tile([rates[n] for n in "xyz"], (3, 1)))
        found = [
            series(f"gyro_misalignment_{axis}", run, f"gyro_{axis}", index=i)[0] for i in range(2)
        ]
        assert found == pytest.approx([0.01 * (i == k) for i in range(2)], rel=ONE_PART)


def test_scale_and_misalignment_are_those_of_the_simulator():
    """Against the matrix of trajectories.simulator.imperfections, rate by rate."""
    run, entries = flight_run(), np.array([0.1, -0.2, 0.3, 0.05, -0.07, 0.02])
    expected = run.rate_rad_s @ (sensitivity([5.0, -7.0, 11.0], entries) - np.eye(3)).T
    scale = [
        t.scaled(k)
        for k, g in zip((5.0, -7.0, 11.0), GYROS)
        for t in EFFECTS["gyro_scale_factor"].traces(run, g, {})
    ]
    cross = [
        t for a in "xyz" for t in EFFECTS[f"gyro_misalignment_{a}"].traces(run, f"gyro_{a}", {})
    ]
    added = total([*scale, *(t.scaled(k) for k, t in zip(entries, cross))]).gyro_rad_s
    np.testing.assert_allclose(added, expected, atol=1e-16)


def test_g_sensitivities_in_a_2_g_turn():
    run = replace(
        parked_run(3),
        force_m_s2=np.tile([0.0, 0.1 * STANDARD_GRAVITY, -2.0 * STANDARD_GRAVITY], (3, 1)),
    )
    assert [series("gyro_g_sensitivity", run, index=k)[0] for k in range(3)] == pytest.approx(
        [0.0, 0.1, -2.0]
    )
    assert series("gyro_g2_sensitivity", run)[0] == pytest.approx(4.01 - 1.0)
    assert series("gyro_g2_sensitivity", parked_run(3))[0] == pytest.approx(0.0, abs=ONE_PART)


@pytest.mark.parametrize(
    ("heading", "x", "y"),
    [(0.0, 0.2, 0.0), (90.0, 0.0, -0.2), (180.0, -0.2, 0.0), (270.0, 0.0, 0.2)],
)
def test_magnetic_field_in_body_axes(heading, x, y):
    run = parked_run(2, heading_deg=heading)
    found = [series("gyro_magnetic_sensitivity", run, index=k)[0] for k in range(2)]
    assert found == pytest.approx([x, y], abs=ONE_PART)


def test_dead_zone():
    def added(deg_h):
        return series("gyro_lock_in", turning(deg_h * DEG_PER_HOUR), threshold_deg_h=100.0)[0]

    assert [added(50.0), added(-50.0)] == pytest.approx([-50.0, 50.0])  # no output at all
    assert [added(125.0), added(-125.0)] == pytest.approx([75.0 - 125.0, 125.0 - 75.0])  # 3-4-5
    assert added(1e5) == pytest.approx(-(100.0**2) / 2e5, rel=1e-5)


# noise


@pytest.mark.parametrize(
    ("key", "name", "value"),
    [
        ("gyro_quantization", "bounded", ARCSEC**2 / 12),
        # an hour of it: 1 deg RMS, DEG^2 = white 3600 s
        ("gyro_angle_random_walk", "white", (DEG / 60.0) ** 2),
        ("gyro_bias_instability", "flicker", (DEG / 3600.0) ** 2),
        # an hour of it: 1 deg/h RMS
        ("gyro_rate_random_walk", "walk", (DEG / 3600.0) ** 2 / 3600.0),
        ("gyro_gauss_markov", "markov", (DEG / 3600.0) ** 2),
        ("gyro_noise_thermal", "white", (DEG / 60.0) ** 2),
    ],
)
def test_noise_of_one_unit(key, name, value):
    effect = EFFECTS[key]
    (noise,) = effect.noise(parked_run(10), "gyro_z", shape_of(effect))
    kinds = ("white", "flicker", "walk", "markov", "bounded", "sway", "sample")
    assert {k: getattr(noise, k) for k in kinds} == pytest.approx(
        {k: value * (k == name) for k in kinds}, rel=ONE_PART, abs=0.0
    )
    assert not effect.coefficients[0].signed


def test_quantisation_is_that_of_the_simulator():
    """Rounding the accumulated angle to pulses of 1 arcsec leaves the variance declared as
    bounded.
    """
    angle = np.cumsum(np.abs(np.random.default_rng(3).normal(5.0, 2.0, 200_000)))
    (noise,) = EFFECTS["gyro_quantization"].noise(parked_run(10), "gyro_x", {})
    # sigma 0.2 %
    assert np.var((np.round(angle) - angle) * ARCSEC) == pytest.approx(noise.bounded, rel=0.02)


def test_noise_profiles():
    def profile(run, share):
        return EFFECTS["gyro_noise_thermal"].noise(run, "gyro_x", {"rate_share": share})[0].profile

    run = still(parked_run(3), 45.0, 2.0)
    np.testing.assert_allclose(profile(run, 0.0), np.e)
    np.testing.assert_allclose(profile(run, 1.0), 4.0)
    np.testing.assert_allclose(profile(run, 0.5), 0.5 * np.e + 2.0)


def test_noise_of_time_is_a_ramp_with_a_bend_over_the_rest():
    """Of mean 1, exp(2 slope) from end to end, whatever the run."""
    run = parked_run(101)

    def profile(slope, bend):
        shape = {"slope": slope, "bend": bend}
        return EFFECTS["gyro_noise_of_time"].noise(run, "gyro_x", shape)[0].profile

    for slope, bend in ((2.0, 0.0), (0.0, -2.0), (-1.0, 2.0)):
        assert profile(slope, bend).mean() == pytest.approx(1.0)
        assert profile(slope, bend)[-1] / profile(slope, bend)[0] == pytest.approx(
            np.exp(2.0 * slope)
        )
    assert profile(0.0, -2.0)[50] / profile(0.0, -2.0)[0] == pytest.approx(np.exp(3.0))
    assert EFFECTS["gyro_noise_of_time"].needs([run], "gyro_x") == ""


def test_markov_time_scans_50_to_1000_s():
    effect = EFFECTS["gyro_gauss_markov"]
    np.testing.assert_allclose(effect.shape[0].grid(), [50, np.sqrt(50 * 1000), 1000])
    assert effect.noise(parked_run(3), "gyro_x", {"tau_s": 200.0})[0].markov_tau_s == 200.0


# compensation


def test_misapplied_table_is_the_table():
    run = parked_run(5)
    np.testing.assert_allclose(
        series("compensation_misapplied", run, "gyro_z"), run.table_deg_h[:, 2]
    )


def test_slow_thermometers_shift_the_table():
    """Readings 60 s late against the true temperatures: the table at the true ones less the table
    at the readings.
    """
    run, tau_s = parked_run(), 60.0
    # T = T_read + tau dT_read/dt
    true = run.temperature_degC + tau_s / 60.0 * run.temperature_rate_degC_min
    np.testing.assert_allclose(
        lagged(run.time_s, true[:, 0], tau_s)[600:], run.temperature_degC[600:, 0], atol=1e-3
    )
    expected = 2e-5 * true**2 * np.array([1.0, 2.0, 3.0]) - run.table_deg_h
    (trace,) = EFFECTS["temperature_sensor_error_lag"].traces(run, "temperature", {})
    found = tau_s * trace.gyro_rad_s / DEG_PER_HOUR
    # second order: (tau dT/dt) / (2 T)
    np.testing.assert_allclose(found[1:-1], expected[1:-1], rtol=0.15)
    np.testing.assert_allclose(found[2400:-1], expected[2400:-1], rtol=0.005)


@pytest.mark.parametrize("run", [parked_run(), cooling_run()], ids=["warming", "cooling"])
def test_thermometers_that_read_high_shift_the_table(run):
    """The gyros are 0.5 degC colder than they read: the table there less the table at the
    readings.
    """
    true = run.temperature_degC - 0.5
    expected = 2e-5 * true**2 * np.array([1.0, 2.0, 3.0]) - run.table_deg_h
    (trace,) = EFFECTS["temperature_sensor_error_offset"].traces(run, "temperature", {})
    # 0.25 degC of 5 in the slope
    np.testing.assert_allclose(0.5 * trace.gyro_rad_s / DEG_PER_HOUR, expected, rtol=0.06)
    flat = replace(run, temperature_degC=np.full((run.n, 3), 20.0))
    assert not any(
        t.gyro_rad_s.any()
        for t in EFFECTS["temperature_sensor_error"].traces(flat, "temperature", {})
    )


def test_slope_of_a_table_does_not_take_up_noise():
    """Readings that stand still for half of the hour: noise of 0.01 degC moves neither slope nor
    offset.
    """
    run = parked_run()
    T = np.where(run.time_s[:, None] < 1800.0, run.temperature_degC, run.temperature_degC[1800])
    T = T + 0.01 * np.random.default_rng(2).standard_normal(T.shape)
    slope = table_slope(replace(run, temperature_degC=T, table_deg_h=2e-5 * T**2)) / DEG_PER_HOUR
    np.testing.assert_allclose(slope, 4e-5 * T, atol=2e-5)


@pytest.mark.parametrize(
    ("tau_s", "curve", "exact"), [(100.0, 0.0, 0.01), (300.0, 0.0, 0.01), (300.0, 2e-5, 0.1)]
)
def test_lag_of_a_simulated_thermometer_comes_back(tau_s, curve, exact):
    """True ramp and exponential, read by slow, noisy, rounded thermometers and smoothed as in a
    diagnosis.
    """
    t = np.arange(3600) + 0.5
    true = 5.0 + 8.0 * t / HOUR - 20.0 * np.expm1(-t / 900.0)
    noise = 0.01 * np.random.default_rng(1).standard_normal((t.size, 3))
    log = TemperatureLog(time_s=t, gyro_degC=np.round(lagged(t, true, tau_s)[:, None] + noise, 2))
    smooth = gyro_temperature(log)
    rate = np.stack(
        [np.interp(t, smooth.time_s, smooth.rate_degC_min[:, k]) for k in range(3)], axis=1
    )

    def table(T):
        return 2e-3 * T + curve * (T - 15.0) ** 2

    T = smooth.at(t)
    run = replace(
        parked_run(), temperature_degC=T, temperature_rate_degC_min=rate, table_deg_h=table(T)
    )
    added = table(true)[:, None] - table(T)
    (trace,) = EFFECTS["temperature_sensor_error_lag"].traces(run, "temperature", {})
    found = trace.gyro_rad_s / DEG_PER_HOUR
    size = np.sum(found * added) / np.sum(found**2)
    assert size == pytest.approx(tau_s, rel=exact)
    assert np.sqrt(np.mean((added - size * found) ** 2)) < exact * np.abs(added).max()


def test_a_parabola_about_any_centre():
    """k (T - 10)^2 is k (T - 25)^2 + 30 k (T - 25), and a constant."""
    run = parked_run()
    square, line = (series("gyro_thermal_parabola", run, index=k) for k in range(2))
    T = run.temperature_degC[:, 1]
    np.testing.assert_allclose(square + 30.0 * line + 225.0, (T - 10.0) ** 2, rtol=1e-9)
    assert [c.name for c in EFFECTS["gyro_thermal_parabola"].coefficients] == [
        "coefficient",
        "linear",
    ]


# needs


def test_parked_runs_need_turns():
    runs = [parked_run()]
    assert EFFECTS["gyro_scale_factor"].needs(runs, "gyro_z") == "turns"
    assert EFFECTS["gyro_scale_asymmetry"].needs(runs, "gyro_z") == "left and right turns"
    assert EFFECTS["gyro_scale_thermal"].needs(runs, "gyro_z") == "turns at two temperatures"
    assert EFFECTS["gyro_misalignment_x"].needs(runs, "gyro_x") == "turns or several headings"
    assert EFFECTS["gyro_lock_in"].needs(runs, "gyro_z") == "slow rotation through zero"


def test_a_taxi_turns_the_vertical_gyro_only():
    runs = [taxi_run()]
    assert EFFECTS["gyro_scale_factor"].needs(runs, "gyro_z") == ""
    assert EFFECTS["gyro_scale_factor"].needs(runs, "gyro_x") == "turns about its own axis"
    assert EFFECTS["gyro_misalignment_x"].needs(runs, "gyro_x") == ""
    assert EFFECTS["gyro_scale_factor"].needs([flight_run()], "gyro_x") == ""


def test_starts_on_several_headings_show_a_wild_scale_factor_of_a_level_gyro():
    first, parked = taxi_run(), parked_run()
    turned = Rotation.from_euler("z", 100.0, degrees=True).as_matrix()
    other = replace(first, C_nb=turned @ first.C_nb)
    assert EFFECTS["gyro_scale_factor"].needs([first, other], "gyro_x") == ""
    assert (
        EFFECTS["gyro_scale_factor"].needs(
            [parked, replace(parked, C_nb=turned @ parked.C_nb)], "gyro_x"
        )
        != ""
    )


def test_turns_to_one_side_do_not_show_an_asymmetry():
    right = taxi_run(left_deg=0.0)
    assert EFFECTS["gyro_scale_factor"].needs([right], "gyro_z") == ""
    assert EFFECTS["gyro_scale_asymmetry"].needs([right], "gyro_z") == "left and right turns"
    assert EFFECTS["gyro_scale_asymmetry"].needs([right, taxi_run(right_deg=0.0)], "gyro_z") == ""


def test_needs_of_temperature():
    warm, cold = still(parked_run(), 30.0), still(parked_run(), 10.0)
    assert (
        EFFECTS["gyro_thermal_linear"].needs([warm], "gyro_x") == "a gyro temperature that changes"
    )
    assert EFFECTS["gyro_thermal_linear"].needs([warm, cold], "gyro_x") == ""
    assert (
        EFFECTS["gyro_thermal_lag"].needs([warm, cold], "gyro_x")
        == "a gyro temperature that changes within a run"
    )
    assert (
        EFFECTS["gyro_thermal_linear"].needs([warm, bare(cold)], "gyro_x") == "a gyro temperature"
    )
    assert (
        EFFECTS["gyro_thermal_hysteresis"]
        .needs([parked_run()], "gyro_x")
        .startswith("temperature rising and falling")
    )
    assert EFFECTS["gyro_thermal_hysteresis"].needs([parked_run(), cooling_run()], "gyro_x") == ""
    no_gradient = replace(parked_run(), gradient_degC=None)
    words = "a temperature difference reading (gradient_y_degC)"
    assert EFFECTS["gyro_thermal_gradient"].needs([no_gradient], "gyro_y") == words


def test_what_no_log_of_this_format_holds():
    assert EFFECTS["gyro_supply_voltage"].needs([flight_run()], "gyro_x") == "housekeeping voltages"
    assert EFFECTS["gyro_dither_coning"].needs([flight_run()], "gyro_x") == "raw data at 500 Hz"
    assert EFFECTS["gyro_dither_coning"].needs([parked_run(dt_s=0.002)], "gyro_x") == ""


@pytest.mark.parametrize(
    ("key", "target", "bare_needs"),
    [
        ("gyro_thermal_linear", "gyro_x", "a gyro temperature"),
        ("gyro_thermal_rate", "gyro_x", "a gyro temperature"),
        ("gyro_thermal_gradient", "gyro_x", "a temperature difference reading (gradient_x_degC)"),
        ("gyro_scale_thermal", "gyro_z", "a gyro temperature"),
        ("compensation_misapplied", "gyro_x", "a thermal table and a gyro temperature"),
        ("temperature_sensor_error", "temperature", "a thermal table and a gyro temperature"),
    ],
)
def test_every_run_must_hold_the_stream(key, target, bare_needs):
    """What repeats is fitted to all runs, so one without the stream is enough to lack it."""
    runs = [
        taxi_run(),
        replace(taxi_run(right_deg=60.0), temperature_degC=taxi_run().temperature_degC + 10.0),
    ]
    assert EFFECTS[key].needs(runs, target) == ""
    assert EFFECTS[key].needs([*runs, bare(taxi_run())], target) == bare_needs


def test_needs_do_not_count_samples_for_seconds():
    """At 10 Hz: a turn of 9 deg is none, 20 minutes are not 30, and one run at 1 Hz shows
    quantisation.
    """
    fast = replace(taxi_run(right_deg=90.0), dt_s=0.1, time_s=0.1 * taxi_run().time_s)
    assert EFFECTS["gyro_scale_factor"].needs([fast], "gyro_z") == "turns"
    assert (
        EFFECTS["gyro_bias_instability"].needs([parked_run(12_000, dt_s=0.1)], "gyro_x")
        == "a run of 30 minutes"
    )
    assert EFFECTS["gyro_gauss_markov"].needs([parked_run(540)], "gyro_x") == "a run of 10 minutes"
    assert EFFECTS["gyro_gauss_markov"].needs([parked_run(540), parked_run(660)], "gyro_x") == ""
    assert (
        EFFECTS["gyro_quantization"].needs([parked_run(60, dt_s=10.0), parked_run(60)], "gyro_x")
        == ""
    )
    assert (
        EFFECTS["gyro_dither_coning"].needs([parked_run(9, dt_s=0.002), parked_run(9)], "gyro_x")
        == "raw data at 500 Hz"
    )


@pytest.mark.parametrize(
    "key", ["gyro_thermal_linear", "gyro_thermal_gradient", "compensation_misapplied"]
)
def test_injection_without_its_stream_is_refused(key):
    with pytest.raises(InputError, match="run 0: no "):
        EFFECTS[key].traces(bare(parked_run(5)), "gyro_y", {})
