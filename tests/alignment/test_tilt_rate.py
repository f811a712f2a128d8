"""Tilt rates over windows: noise, gaps, and the sigma's closed form (physics.md 6.3; accuracy in
test_physics_numbers).
"""

from dataclasses import replace

import numpy as np
import pytest

from alignment.tilt_rate import WALK_FACTOR, tilt_rates
from ins.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR
from tests.alignment.parked import ideal_of, parked_history, simulate
from trajectories.simulator.segments import Park

HALF_HOUR = (Park(duration_s=1800.0),)
ARW = 0.002 * DEG_PER_SQRT_HOUR


def history():
    return parked_history(simulate(ideal_of(HALF_HOUR), 1).run)


def rates(h, still=None, **options):
    still = np.ones(len(h.time_s), bool) if still is None else still
    return tilt_rates(h, still, arw=ARW, velocity_sigma_m_s=1e-3, **options)


def test_windows_follow_each_other():
    found = rates(history())
    assert [r.time_s for r in found] == pytest.approx([150.0, 450.0, 750.0, 1050.0, 1350.0, 1650.0])
    assert {r.window_s for r in found} == {300.0}


def test_a_window_that_is_a_quarter_disturbed_is_skipped():
    h = history()
    still = ~((h.time_s > 300.0) & (h.time_s <= 380.0))
    assert [r.time_s for r in rates(h, still)] == pytest.approx(
        [150.0, 750.0, 1050.0, 1350.0, 1650.0]
    )
    still = ~((h.time_s > 300.0) & (h.time_s <= 370.0))
    assert len(rates(h, still)) == 6


def test_sigma_in_closed_form():
    """ARW 0.002 deg/sqrt(h): 0.0069 deg/h in 300 s before the parabola's factor; 5 mm/s: 0.0018
    deg/h (6.3).
    """
    h = history()
    walk = rates(h)[0].sigma_rad_s / DEG_PER_HOUR
    assert walk == pytest.approx(np.hypot(0.0069 * np.sqrt(WALK_FACTOR), 0.0018 / 5), rel=0.01)
    first = tilt_rates(h, np.ones(len(h.time_s), bool), arw=0.0, velocity_sigma_m_s=5e-3)[0]
    assert first.sigma_rad_s / DEG_PER_HOUR == pytest.approx(0.0018, rel=0.03)


def test_scatter_of_the_windows_is_their_sigma():
    """Angle random walk and a constant: 60 windows, chi-square 99.9 % (120 degrees of freedom)."""
    h, rng, g = history(), np.random.default_rng(3), 9.806
    z = []
    for _ in range(10):
        angle = np.cumsum(ARW * rng.standard_normal((len(h.time_s), 2)), axis=0)
        v = np.zeros_like(h.v_n_m_s)
        v[:, 0], v[:, 1] = -np.cumsum(g * angle[:, 1]), np.cumsum(g * angle[:, 0])
        for r in tilt_rates(
            replace(h, v_n_m_s=v), np.ones(len(h.time_s), bool), arw=ARW, velocity_sigma_m_s=1e-6
        ):
            z += [r.u_north_rad_s / r.sigma_rad_s, r.u_east_rad_s / r.sigma_rad_s]
    assert len(z) == 120
    assert 0.63 < np.mean(np.square(z)) < 1.48
