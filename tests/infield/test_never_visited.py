"""What a limit of all merges leaves, by hand, and where sessions came."""

import numpy as np
import pytest

from benchmarks.never_visited import (
    COMMON_DEG_H,
    FLOWN_S,
    GRID_DEGC,
    LENGTH_DEGC,
    SESSIONS,
    SHAPE_DEG_H,
    left,
    never,
    temperatures,
)

VARIANCE = COMMON_DEG_H**2 + SHAPE_DEG_H**2


def test_one_reading_leaves_what_is_worked_by_hand():
    """Of a curve of variance p a reading of variance d leaves p - p^2 / (p + d) where it was taken,
    and p - c^2 / (p + d) 30 degC away, one length of correlation: c has exp(-1/2) of the shape.
    """
    d = 0.002**2
    P = left(np.array([10.0]), np.array([[d]]))
    here, away = np.searchsorted(GRID_DEGC, [10.0, 10.0 - LENGTH_DEGC])
    c = COMMON_DEG_H**2 + SHAPE_DEG_H**2 * np.exp(-0.5)
    assert P[here, here] == pytest.approx(VARIANCE - VARIANCE**2 / (VARIANCE + d))
    assert P[away, away] == pytest.approx(VARIANCE - c**2 / (VARIANCE + d))


def test_more_power_ons_leave_less_and_a_common_turn_on_stays():
    """At one temperature n power-ons of 0.003 deg/h are one of 0.003 / sqrt(n)."""
    n, turn_on = 4, 0.003**2
    P = left(np.full(n, 10.0), turn_on * np.eye(n))
    one = left(np.array([10.0]), np.array([[turn_on / n]]))
    np.testing.assert_allclose(P, one, rtol=1e-9, atol=1e-15)
    together = left(np.full(n, 10.0), turn_on * np.ones((n, n)) + 1e-12 * np.eye(n))
    assert np.diag(together).min() > np.diag(P).min()


def test_never_is_beyond_two_degrees_of_all_sessions():
    seen = temperatures(100, SESSIONS, 60.0)
    assert seen.shape == (SESSIONS, int(np.ceil((FLOWN_S - 30.0) / 60.0)))
    apart = np.abs(GRID_DEGC[never(100), None] - seen.ravel()).min(axis=1)
    assert apart.min() > 2.0 and never(100).sum() > 5
