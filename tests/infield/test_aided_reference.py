"""An aided solution as what errors are linearised about: increments between its rows, the errors
that setting it anew adds, and the axes of a step.
"""

from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

from ins.attitude import dcm_from_rotation_vector
from ins.earth import SEMI_MAJOR_AXIS_M
from ins.estimation.error_filter import ErrorFilter
from ins.estimation.error_model import ProcessNoise
from ins.estimation.measurements.antenna import moved_by
from ins.estimation.tape import Tape
from ins.filters.reference import Rows, reference
from ins.records import ImuLog
from tests.infield import mems_away

FROM_S, UNTIL_S = mems_away.PARKED_S + 60.0, mems_away.PARKED_S + 260.0
VRW, SIGMA_V_M_S = 1e-3, 0.02  # of the accelerometers, of the solution's velocity
FIX_S = np.arange(FROM_S + 0.37, UNTIL_S, 0.7)


@lru_cache(maxsize=1)
def flown():
    """Take-off, climb and turns: increments, and the truth at their ends."""
    made = mems_away.ideal()
    t = made.time_s
    imu = ImuLog(
        time_s=t,
        dt_s=np.full(t.size, 1.0 / made.rate_hz),
        dtheta_rad=made.dtheta_rad,
        dv_m_s=made.dv_m_s,
    )
    place = np.column_stack([made.lat_rad, made.lon_rad, made.height_m])
    return imu, SimpleNamespace(time_s=t, place=place, v_n=made.v_n_m_s, C_nb=made.C_nb)


def solution(truth, dp=0.0, dv=0.0, phi=0.0):
    """Rows a second apart, off by errors (R, 3)."""
    step = round(1.0 / (truth.time_s[1] - truth.time_s[0]))
    first = int(np.searchsorted(truth.time_s, FROM_S - 1e-6))
    rows = slice(first, int(np.searchsorted(truth.time_s, UNTIL_S)), step)
    v_n, C_nb = truth.v_n[rows] + dv, truth.C_nb[rows]
    place = moved_by(truth.place[rows], np.broadcast_to(dp, v_n.shape))
    return Rows(
        truth.time_s[rows],
        place,
        v_n,
        dcm_from_rotation_vector(np.broadcast_to(phi, v_n.shape)) @ C_nb,
        np.full(v_n.shape, SIGMA_V_M_S**2),
    )


def over(imu, rows):
    return reference(imu, rows, FIX_S, [slice(0, rows.time_s.size)], VRW)


def test_a_true_solution_is_set_anew_by_nothing():
    imu, truth = flown()
    made = over(imu, solution(truth))
    # with gravity, Coriolis and transport of the row before it was 5e-4 m/s and 3e-7 rad
    assert np.abs(made.shift[:, :3]).max() < 2e-5
    assert np.abs(made.shift[:, 3:6]).max() < 5e-4
    assert np.abs(made.shift[:, 6:]).max() < 5e-8
    at = np.searchsorted(truth.time_s, made.end_s - 1e-6)
    assert np.abs(made.end.v_n - truth.v_n[at]).max() < 1e-4
    assert np.abs(made.end.C_nb - truth.C_nb[at]).max() < 2e-7
    seen = made.fix[made.fix >= 0]
    np.testing.assert_array_equal(seen, np.flatnonzero(FIX_S <= made.end_s[-1]))
    late = made.end_s[made.fix >= 0] - FIX_S[seen]
    assert late.min() > -1e-6 and late.max() < 0.05 + 1e-6


def test_errors_of_the_solution_are_carried_from_row_to_row():
    """Rows off by errors of their own, each drawn anew: the filter's errors, never told them but
    the first, end as the last row's.
    """
    imu, truth = flown()
    count, rng = solution(truth).time_s.size, np.random.default_rng(5)
    dp, dv = 3.0 * rng.standard_normal((count, 3)), 0.2 * rng.standard_normal((count, 3))
    phi = 1e-3 * rng.standard_normal((count, 3))
    rows = solution(truth, dp, dv, phi)
    north, east, _ = dp.T / SEMI_MAJOR_AXIS_M
    theta = phi - np.column_stack([-east, north, east * np.tan(rows.place[:, 0])])
    made = over(imu, rows)
    about = made.travels_n[made.closes]
    errors = np.hstack([dv - np.cross(theta, about), dp, theta])
    silent = ProcessNoise(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    flt = ErrorFilter(
        sigma0={}, noise=silent, bias_mean=np.zeros(3), bias_covariance=np.zeros((3, 3))
    )
    flt.x[:9] = errors[0]
    flt.run(Tape(made.steps(np.zeros(made.dt_s.size, dtype=np.int64))))
    off = flt.x[:9] - errors[-1]
    # second order: 200 settings of 1e-3 rad at 60 m/s and under a specific force of 10 m/s^2
    assert np.abs(off[6:]).max() < 5e-5
    assert np.abs(off[:3]).max() < 0.05 and np.abs(errors[:, :3]).max() > 0.2
    assert np.abs(off[3:6]).max() < 3.0


def test_noise_of_a_solution_is_no_motion_to_be_linearised_about():
    """Straight ahead, noise of the velocities is gone from what the errors are linearised about;
    a turn is followed at once.
    """
    imu, truth = flown()
    rows = solution(truth)
    noise = SIGMA_V_M_S * np.random.default_rng(7).standard_normal(rows.v_n_m_s.shape)
    made = over(imu, solution(truth, dv=noise))
    travels = made.travels_n[made.closes]
    turns = np.abs(np.gradient(rows.v_n_m_s, axis=0)).max(axis=1) > 0.5
    calm = ~np.convolve(turns, np.ones(5), mode="same").astype(bool)
    straight = calm[1:] & calm[:-1]
    followed, of = (np.diff(rows, axis=0)[straight] for rows in (travels - rows.v_n_m_s, noise))
    assert calm.sum() > 60 and turns.sum() > 20
    assert abs(np.sum(followed * of) / np.sum(of**2)) < 0.05  # 1 of the solution itself
    assert np.abs(travels - rows.v_n_m_s)[turns].max() < 1.0


def test_the_axes_of_a_step_are_their_mean_over_it():
    """Constant rate, 20 deg a step: against the mean of a thousand attitudes."""
    angle = np.radians(20.0) * np.array([0.3, -0.2, 0.93])
    C = dcm_from_rotation_vector([0.2, -0.1, 1.0])
    t = np.arange(1, 401) / 100.0
    imu = ImuLog(
        time_s=t,
        dt_s=np.full(t.size, 0.01),
        dtheta_rad=np.tile(0.01 * angle, (t.size, 1)),
        dv_m_s=np.zeros((t.size, 3)),
    )
    s = np.arange(1.0, 4.0)
    rows = Rows(
        s,
        np.tile([0.7, 0.0, 0.0], (3, 1)),
        np.zeros((3, 3)),
        np.stack([C @ dcm_from_rotation_vector(angle * of) for of in s]),
        np.full((3, 3), SIGMA_V_M_S**2),
    )
    made = reference(imu, rows, np.zeros(0), [slice(0, 3)], VRW)
    share = (np.arange(1000) + 0.5) / 1000
    mean = np.mean([rows.C_nb[0] @ dcm_from_rotation_vector(angle * u) for u in share], axis=0)
    assert made.dt_s == pytest.approx([0.0, 1.0, 1.0])
    assert np.abs(made.C_mean[1] - mean).max() < 2e-3  # of 0.17 at the step's start
    assert np.abs(rows.C_nb[0] - mean).max() > 0.1
