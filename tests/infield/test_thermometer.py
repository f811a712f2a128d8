"""Gyro temperatures: coarse thermometers, their rates, and stuck ones."""

from dataclasses import replace

import numpy as np
import pytest

from infield.thermometer.gyro_temperature import gyro_temperature, too_short
from ins.records import TemperatureLog
from ins.verdicts import sentence, sentences
from trajectories.simulator.thermal import STARTS, thermal_history

HOUR = np.arange(4200.0)


def log_of(gyro_degC, time_s=HOUR):
    return TemperatureLog(time_s=time_s, gyro_degC=gyro_degC)


def warm_up():
    return thermal_history("cold").at(HOUR).gyro_degC


@pytest.mark.parametrize(("step_degC", "worst"), [(0.01, 0.05), (0.1, 0.1), (1.0, 0.5)])
def test_temperature_of_a_coarse_thermometer(step_degC, worst):
    """1 degC steps over a cold start: within half a step everywhere, 0.3 degC RMS."""
    true = warm_up()
    found = gyro_temperature(log_of(np.round(true / step_degC) * step_degC))
    error = found.at(HOUR) - true
    assert np.abs(error[100:-100]).max() < worst
    assert np.sqrt(np.mean(error**2)) < 0.6 * worst
    assert found.unusable == ()


@pytest.mark.parametrize(("step_degC", "part"), [(0.01, 0.02), (0.1, 0.1)])
def test_rate_of_a_coarse_thermometer(step_degC, part):
    """R4: dT/dt of a 0.1 degC thermometer within 10 % of the true RMS rate."""
    true = warm_up()
    rate = 60.0 * np.gradient(true, HOUR, axis=0)
    T = gyro_temperature(log_of(np.round(true / step_degC) * step_degC))
    found = np.stack([np.interp(HOUR, T.time_s, r) for r in T.rate_degC_min.T], axis=1)
    inner = slice(60, -60)
    error = np.sqrt(np.mean((found - rate)[inner] ** 2))
    assert error < part * np.sqrt(np.mean(rate[inner] ** 2))


def test_a_straight_ramp_comes_back_exactly():
    T = np.stack([20 + HOUR / 600, 20 - HOUR / 1200, 20 + HOUR / 6000], axis=1)
    found = gyro_temperature(log_of(T))
    assert found.at(HOUR) == pytest.approx(T, abs=1e-6)
    assert found.rate_degC_min == pytest.approx(
        np.tile([0.1, -0.05, 0.01], (len(found.time_s), 1)), abs=1e-6
    )


def test_stuck_axes_are_named():
    T = warm_up()
    T[:, 1] = 25.0
    assert gyro_temperature(log_of(T)).unusable == ("y",)
    assert gyro_temperature(log_of(np.full((4200, 3), 25.0))).unusable == ("x", "y", "z")


def test_a_constant_temperature_is_accepted_by_name():
    """One reading throughout is the temperature, to a step that cannot be seen; not where another
    thermometer of the unit moves.
    """
    found = gyro_temperature(replace(log_of(np.full((4200, 3), 25.0)), constant=True))
    assert found.unusable == () and np.abs(found.temperature_degC - 25.0).max() < 0.5
    assert {f.kind for f in found.faults} == {"constant"}
    bins = found.of_bins(np.array([0.0, 300.0, 4100.0]))
    sigma = np.sqrt(bins.covariance[0].diagonal())
    assert np.all((sigma > 0.05) & (sigma < 0.5)), sigma
    T = warm_up()
    T[:, 1] = 25.0
    assert gyro_temperature(replace(log_of(T), constant=True)).unusable == ("y",)


def test_one_reading_over_ten_minutes_is_no_sign_of_a_stuck_thermometer():
    t = np.arange(599.0)
    assert gyro_temperature(log_of(np.full((599, 3), 25.0), t)).unusable == ()


def frozen(start, *, at_s, held_s, step_degC, noise_degC):
    """A unit whose thermometers, the block's too, all repeat what they read at a time."""
    t = np.arange(float(at_s + held_s))
    true = thermal_history(start).at(t)
    rng = np.random.default_rng(5)

    def read(T):
        noisy = T + noise_degC * rng.standard_normal(T.shape)
        read = step_degC * np.round(noisy / step_degC)
        read[at_s:] = read[at_s]
        return read

    return TemperatureLog(
        time_s=t, gyro_degC=read(true.gyro_degC), block_degC=read(true.block_degC)
    )


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize(
    ("step_degC", "noise_degC", "held_s"), [(0.01, 0.01, 180), (0.1, 0.05, 300)]
)
def test_a_unit_whose_thermometers_all_freeze_is_named_by_its_own_past(
    start, step_degC, noise_degC, held_s
):
    """Frozen from 600 s on: nothing was said for 600 s of it, as no other thermometer moved, and
    biases of a warm-up were taught to the table at one temperature.
    """
    log = frozen(start, at_s=600, held_s=held_s, step_degC=step_degC, noise_degC=noise_degC)
    found = gyro_temperature(log)
    (fault,) = found.faults
    assert fault.column == "temperature" and fault.kind == "stuck"
    assert fault.start_s == pytest.approx(600.0, abs=20.0)
    assert found.unusable == () and found.covered(730.0, 600.0 + held_s).max() == 0.0
    whole = frozen(start, at_s=600 + held_s, held_s=1, step_degC=step_degC, noise_degC=noise_degC)
    assert not gyro_temperature(whole).faults


def test_a_warm_up_that_stops_within_a_step_is_named_without_any_noise():
    frozen_log = frozen("cold", at_s=200, held_s=200, step_degC=0.1, noise_degC=0.0)
    assert [f.column for f in gyro_temperature(frozen_log).faults] == ["temperature"]


@pytest.mark.parametrize("step_degC", [0.01, 0.1, 0.5])
@pytest.mark.parametrize("settles_s", [5.0, 60.0, 600.0])
def test_a_unit_in_equilibrium_repeats_its_reading_honestly(step_degC, settles_s):
    """A thermometer without noise: after the unit has settled it never changes again."""
    T = np.tile(40.003 - 15.0 * np.exp(-HOUR / settles_s), (3, 1)).T + [
        0.0,
        0.004,
        0.31 * step_degC,
    ]
    assert not any(f.kind == "stuck" for f in gyro_temperature(log_of(grid(T, step_degC))).faults)


def test_a_coarse_thermometer_at_the_edge_of_its_step_is_not_stuck_in_the_middle():
    """Steps of 0.5 degC flicker at 20.25 degC by noise of 0.05, and for an hour no more at 20.0."""
    T = 20.25 - 0.25 * np.clip((HOUR - 300.0) / 200.0, 0.0, 1.0)
    noise = 0.05 * np.random.default_rng(1).standard_normal((HOUR.size, 3))
    assert {f.kind for f in gyro_temperature(log_of(grid(T[:, None] + noise, 0.5))).faults} <= {
        "coarse"
    }


def test_a_hole_between_two_alike_readings_holds_nothing():
    """Readings of 25.00 degC on both sides of 10 min without any: no change was missed."""
    T = 25.0 + 0.01 * np.random.default_rng(4).standard_normal((HOUR.size, 3))
    T[[1000, 1601]] = 25.0
    kept = (HOUR <= 1000.0) | (HOUR >= 1601.0)
    found = gyro_temperature(log_of(grid(T, 0.01)[kept], HOUR[kept]))
    assert [f.kind for f in found.faults] == ["hole"]


def grid(T, step_degC):
    return step_degC * np.round(T / step_degC)


def test_ends_are_held_and_a_span_is_never_empty():
    T = gyro_temperature(log_of(warm_up()))
    assert np.array_equal(T.at(np.array([-50.0, 9000.0])), T.temperature_degC[[0, -1]])
    for span in (T.between(100.0, 100.2), T.between(9000.0, 9300.0), T.between(-30.0, -10.0)):
        assert T.temperature_degC[span].shape[0] >= 1


def test_a_span_without_readings_is_not_usable_and_takes_its_shape_from_the_others():
    T = warm_up() + 0.01 * np.random.default_rng(2).standard_normal((4200, 3))
    T[1000:2500, 1] = 0.0
    found = gyro_temperature(log_of(T))
    assert found.unusable == () and [f.kind for f in found.faults] == ["zero"]
    assert found.covered(0.0, 900.0) == pytest.approx([1.0, 1.0, 1.0], abs=0.01)
    assert found.covered(1200.0, 2300.0) == pytest.approx([1.0, 0.0, 1.0], abs=0.01)
    inside = np.arange(1100.0, 2400.0)
    assert np.abs(found.at(inside) - warm_up()[1100:2400])[:, 1].max() < 1.0


@pytest.mark.parametrize(
    ("scale", "word"),
    [(lambda T: 1.8 * T + 32, "Fahrenheit"), (lambda T: 0.1 * T, "ten times too small")],
)
def test_a_wrong_scale_leaves_the_axis_out(scale, word):
    T = warm_up()
    T[:, 2] = scale(T[:, 2])
    found = gyro_temperature(log_of(T))
    assert found.unusable == ("z",)
    assert any(
        word in said and "the axis is left out" in said
        for said in sentences(s.reason for s in found.left_out())
    )
    assert np.abs(found.at(HOUR) - warm_up())[:, 2].max() < 4.0  # the others' mean stands in


def with_others(gyro_off_degC, **others):
    """Gyros off by so much beside the thermometers named, which read the truth."""
    at = thermal_history("cold").at(HOUR)
    true = {"block_degC": at.block_degC, "ambient_degC": at.ambient_degC}
    kept = {name: true[name] for name, wanted in others.items() if wanted}
    return TemperatureLog(time_s=HOUR, gyro_degC=at.gyro_degC + gyro_off_degC, **kept)


@pytest.mark.parametrize("off_degC", [-20.0, 20.0])
def test_gyros_that_agree_with_each_other_and_not_with_the_block_are_not_believed(off_degC):
    found = gyro_temperature(with_others(off_degC, block_degC=True))
    assert found.unusable == ("x", "y", "z")
    assert gyro_temperature(with_others(0.0, block_degC=True)).unusable == ()


def test_a_block_that_does_not_live_speaks_against_nobody():
    log = with_others(20.0, block_degC=True)
    dead = TemperatureLog(time_s=HOUR, gyro_degC=log.gyro_degC, block_degC=np.full(HOUR.size, 20.0))
    assert gyro_temperature(dead).unusable == ()


def test_gyros_colder_than_the_air_at_the_end_are_not_believed():
    """The unit settles at 34 degC in air of -5 degC: 55 degC too low is colder than the air."""
    assert gyro_temperature(with_others(-55.0, ambient_degC=True)).unusable == ("x", "y", "z")
    assert gyro_temperature(with_others(-20.0, ambient_degC=True)).unusable == ()


def test_a_unit_that_comes_from_a_cold_cruise_is_believed_on_warm_ground():
    """Air of -40 degC aloft and 20 degC after landing: the unit, at 2 degC, still warms up. All its
    thermometers were dropped once.
    """
    landed = np.clip((HOUR - HOUR[-1] + 900.0) / 300.0, 0.0, 1.0)
    log = TemperatureLog(
        time_s=HOUR,
        gyro_degC=np.stack([-8.0 + 10.0 * landed + 0.1 * k for k in range(3)], axis=1),
        ambient_degC=-40.0 + 60.0 * landed,
    )
    assert gyro_temperature(log).unusable == ()


def washed(jump_degC=0.0, seconds=150.0, noise_degC=0.02):
    """A board at 35.4 degC, from 30 s on in the wash of a propeller: 2.4 degC colder with 6 s, then
    slowly on; with a jump of its thermometer at 90 s.
    """
    t = np.arange(0.0, seconds)
    since = np.maximum(t - 30.0, 0.0)
    true = 35.4 + 2.4 * np.expm1(-since / 6.0) - 0.03 * since
    rng = np.random.default_rng(3)
    read = true + jump_degC * (t > 90.0) + noise_degC * rng.standard_normal(t.size)
    return log_of(np.stack([read] * 3, axis=1), t), true


def test_a_board_that_cools_in_the_wash_of_a_propeller_is_believed():
    """0.9 degC in 3 s are no jump within 2.4 in 20: the unit's temperature is followed. A jump of
    the same size of the thermometer alone is told still, as no side of it is known to be right.
    """
    log, true = washed()
    found = gyro_temperature(log)
    assert found.unusable == () and not found.faults
    assert np.abs(found.at(log.time_s)[5:-5, 0] - true[5:-5]).max() < 0.4
    jumped, _ = washed(jump_degC=-1.0)
    told = gyro_temperature(jumped)
    assert len(told.unusable) == 3
    assert "jumps by -1.0 degC at 91.0 s" in told.faults[0].text


def test_one_row_is_held():
    found = gyro_temperature(log_of(np.array([[20.0, 21.0, 22.0]]), np.array([5.0])))
    assert found.at(np.array([0.0, 100.0])) == pytest.approx(np.tile([20.0, 21.0, 22.0], (2, 1)))
    assert "12 rows over 59.9 s, needed at least 10 rows over 60 s" in sentence(
        too_short(log_of(np.ones((12, 3)), np.linspace(0.0, 59.97, 12)))
    )
    assert "1 row over 0 s, needed at least 10 rows over 60 s" in sentence(
        too_short(log_of(np.ones((1, 3)), np.array([5.0])))
    )
