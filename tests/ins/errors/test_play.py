"""The play operator against its definition, step by step."""

import numpy as np
import pytest

from ins.errors.parts.play import heating_sense, play


def step_by_step(values, half_width):
    out, held = [], values[0]
    for value in values:
        held = min(value + half_width, max(value - half_width, held))
        out.append(held)
    return np.array(out)


def noisy_day(n, seed=3):
    """A swing of 30 degC read with noise and rounding of 0.01 degC."""
    rng = np.random.default_rng(seed)
    return np.round(20.0 + 15.0 * np.sin(np.arange(n) / n * 7.0) + 0.01 * rng.standard_normal(n), 2)


SERIES = {
    "noisy": noisy_day(3600),
    "a walk": np.cumsum(np.random.default_rng(4).standard_normal(1025)),
    "one": np.array([3.0]),
    "two": np.array([3.0, -3.0]),
    "flat": np.full(7, 2.0),
    "up": np.arange(64.0),
}


@pytest.mark.parametrize("name", SERIES)
@pytest.mark.parametrize("half_width", [0.005, 0.25, 5.0, 100.0])
def test_the_same_number_as_step_by_step(name, half_width):
    values = SERIES[name]
    np.testing.assert_array_equal(play(values, half_width), step_by_step(values, half_width))


def test_the_rows_of_a_long_log_are_all_followed():
    """No thinning out: exact at 100 Hz too."""
    values = noisy_day(120_000)
    np.testing.assert_array_equal(play(values, 0.02), step_by_step(values, 0.02))


def test_sense_stays_between_its_ends_and_starts_in_the_middle():
    sense = heating_sense(noisy_day(3600), 2.0)
    assert sense[0] == 0.0 and (sense.min(), sense.max()) == (
        pytest.approx(-1.0),
        pytest.approx(1.0),
    )
