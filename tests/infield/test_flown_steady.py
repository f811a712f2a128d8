"""The specific force without its noise, while it stays the same."""

import numpy as np

from infield.session.flown.steps import Steady

WHITE = 0.01**2


def followed(true, seed=1, unsure=0.0):
    """What is made of readings (n, 3) of a force with white noise, and the readings."""
    noise = np.sqrt(WHITE) * np.random.default_rng(seed).standard_normal(true.shape)
    steady = Steady()
    return np.array([steady.of(row, WHITE, unsure) for row in true + noise]), true + noise


def test_the_mean_of_a_force_that_stays_is_taken():
    true = np.tile([0.1, -0.2, -9.8], (800, 1))
    made, read = followed(true)
    # 1 / sqrt(800) of the noise; chance begins the mean anew once in a thousand steps
    assert np.abs(made[-1] - true[-1]).max() < 0.3 * np.sqrt(WHITE)
    assert np.std(made[400:] - true[400:]) < 0.2 * np.std(read[400:] - true[400:])


def test_a_step_is_followed_at_once_and_a_slow_change_within_ten_steps():
    true = np.tile([0.0, 0.0, -9.8], (200, 1))
    true[100:, 0] = 1.0
    made, read = followed(true)
    np.testing.assert_array_equal(made[100], read[100])
    ramp = np.tile([0.0, 0.0, -9.8], (400, 1))
    ramp[200:, 1] = 0.002 * np.arange(200)  # a fifth of the noise a step
    made, _ = followed(ramp)
    assert np.abs(made[200:, 1] - ramp[200:, 1]).max() < 20 * 0.002 + 4 * np.sqrt(WHITE)


def test_what_else_moves_a_reading_is_no_change_of_the_force():
    true = np.tile([0.0, 0.0, -9.8], (60, 1))
    true[30:, 0] = 0.08  # a tilt that a fix corrected
    plain, _ = followed(true)
    kept, _ = followed(true, unsure=np.array([0.05**2, 0.05**2, 0.0]))
    assert plain[30, 0] > 0.05 > 0.02 > kept[30, 0]
