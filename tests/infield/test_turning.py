"""The turn rate at an instant against turns whose rate is known in closed form."""

import numpy as np
import pytest

from infield.session.navigated.turning import rate_at

DOWN = np.array([0.0, 0.0, 1.0])


def steps(angle, ends_s):
    """Starts, ends and turns (k, 3) about down of steps between some times."""
    return ends_s[:-1], ends_s[1:], np.diff(angle(ends_s))[:, None] * DOWN


def test_a_rate_that_changes_evenly_is_exact_anywhere():
    t = np.arange(0.0, 8.0)
    rate, off = rate_at(*steps(lambda s: 0.02 * s**2, t), np.array([0.4, 3.0, 5.7, 7.0]))
    assert rate[:, 2] == pytest.approx([0.016, 0.12, 0.228, 0.28], abs=1e-12)
    assert off == pytest.approx(0.0, abs=1e-12)


def test_a_turn_is_begun_within_two_seconds():
    """Heading 0.08 (u^6 - 3 u^5 + 2.5 u^4) 2 s: the rate goes to 0.16 rad/s by a smooth step. The
    mean of the second is off by up to 0.07.
    """
    peak, blend_s, begins_s = 0.16, 2.0, 4.3

    def angle(s):
        u = np.clip((s - begins_s) / blend_s, 0.0, 1.0)
        whole = peak * blend_s * (u**6 - 3 * u**5 + 2.5 * u**4)
        return whole + peak * np.maximum(s - begins_s - blend_s, 0.0)

    def rate(s):
        u = np.clip((s - begins_s) / blend_s, 0.0, 1.0)
        return peak * u**3 * (10 - 15 * u + 6 * u * u)

    t = np.concatenate([[0.0, 3.0], np.arange(4.0, 13.0)])
    fixes = np.arange(3.5, 11.5, 0.1)
    got, off = rate_at(*steps(angle, t), fixes)
    error = got[:, 2] - rate(fixes)
    means = (
        np.diff(angle(t))[np.searchsorted(t, fixes) - 1] / np.diff(t)[np.searchsorted(t, fixes) - 1]
    )
    assert np.abs(means - rate(fixes)).max() > 0.06
    assert np.abs(error).max() < 0.02
    # the sigma is of the errors' size, and gone in the steady turn
    entering = (fixes > begins_s - 0.8) & (fixes < begins_s + blend_s + 0.8)
    assert 0.3 < np.sqrt(np.mean(error[entering] ** 2) / np.mean(off[entering, 2] ** 2)) < 1.2
    assert off[fixes > begins_s + blend_s + 3.0].max() < 0.002


def test_fewer_steps_than_a_spline_needs_have_their_mean_and_know_it():
    rate, off = rate_at(
        np.array([0.0, 1.0]), np.array([1.0, 3.0]), np.outer([0.1, 0.4], DOWN), np.array([1.0, 3.0])
    )
    assert rate[:, 2] == pytest.approx([0.1, 0.2]) and off[:, 2] == pytest.approx([0.1, 0.2])
