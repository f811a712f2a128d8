"""Rows of satellite fixes against central differences of a nonlinear antenna: the unit on the
ellipsoid, attitude by rotation vectors, an arm, a body that turns and speeds up. No block is left
out.
"""

import numpy as np
import pytest

from ins.attitude import dcm_from_euler, dcm_from_rotation_vector
from ins.earth import dcm_en, ecef_from_geodetic, geodetic_from_ecef
from ins.estimation import states
from ins.estimation.measurements import fix
from ins.estimation.measurements.antenna import Antenna, AntennaMotion, RowSums
from ins.records import ImuLog
from ins.units import DEG

PLACE = np.array([50 * DEG, 7 * DEG, 900.0])
C_NB = dcm_from_euler(0.2, -0.1, 1.1)
V_N, ACCELERATION_N = np.array([55.0, -40.0, 3.0]), np.array([1.5, -0.7, 0.4])
RATE_B = np.array([0.15, -0.1, 0.3])
ARM_M = np.array([3.0, -2.0, -1.5])
OF = fix.ReceiverStates(
    arm=range(50, 53),
    delay=[53],
    velocity_delay=[54],
    slow_position=range(55, 58),
    slow_velocity=range(58, 61),
)
# block: its states, and how far each is moved
BLOCKS = {
    "velocity": ([0, 1, states.W_DOWN], 0.1),
    "position": ([3, 4, states.POS_DOWN], 10.0),
    "attitude": (range(states.THETA.start, states.THETA.stop), 1e-4),
    "arm": (OF.arm, 0.2),
    "delay": (OF.delay, 1e-3),
    "velocity delay": (OF.velocity_delay, 1e-3),
    "slow position": (OF.slow_position, 1.0),
    "slow velocity": (OF.slow_velocity, 0.1),
}
# of the largest coefficient in the row's unit: the sphere of the error model, 0.7 % of v / R
SHARE, ROUND_EARTH = 1e-4, 2e-6


def frames():
    return ecef_from_geodetic(*PLACE), dcm_en(PLACE[0], PLACE[1])


def antenna_at(time_s, arm_m):
    """The true antenna: Earth-fixed place, and velocity NED at the unit."""
    r_e, C_en = frames()
    C_nb = C_NB @ dcm_from_rotation_vector(RATE_B * time_s)
    moved = V_N * time_s + 0.5 * ACCELERATION_N * time_s**2 + C_nb @ arm_m
    return r_e + C_en @ moved, V_N + ACCELERATION_N * time_s + C_nb @ np.cross(RATE_B, arm_m)


def measured(x):
    """Place and velocity as the receiver says them, with arm, delays and slow errors of x."""
    arm_m = ARM_M + x[list(OF.arm)]
    place_e = antenna_at(-x[OF.delay[0]], arm_m)[0] + frames()[1] @ x[list(OF.slow_position)]
    v_n = antenna_at(-x[OF.velocity_delay[0]], arm_m)[1] + x[list(OF.slow_velocity)]
    return tuple(np.atleast_1d(a) for a in geodetic_from_ecef(place_e)), v_n[None]


def computed(x):
    """The solution with errors w, p, theta of x."""
    r_e, C_en = frames()
    lat, lon, height = geodetic_from_ecef(r_e + C_en @ x[3:6])
    theta = x[states.THETA]
    C_nb = dcm_en(lat, lon).T @ C_en @ dcm_from_rotation_vector(theta) @ C_NB
    pull_b = np.cross(RATE_B, np.cross(RATE_B, ARM_M))
    return AntennaMotion(
        place=np.array([[lat, lon, height]]),
        v_n=(C_nb @ C_NB.T @ (V_N + x[0:3]))[None],
        C_nb=C_nb[None],
        rate_b=RATE_B[None],
        acceleration_n=(ACCELERATION_N + C_NB @ pull_b)[None],
    )


def read(kind, x, *, antenna=None, level=False, moves=True):
    """z (c,) and rows of a kind of fix."""
    antenna = antenna or Antenna(ARM_M)
    places, v_n = measured(x)
    if kind == "position":
        z, rows = fix.position(computed(x), antenna, places, OF, level=level)
    else:
        motion = computed(x)
        about = motion.v_n + motion.swing_n(antenna.arm_m) if moves else np.zeros((1, 3))
        z, rows = fix.velocity(motion, antenna, v_n, OF, about_n=about, level=level)
    return z[:, 0], rows


@pytest.mark.parametrize("level", [True, False])
@pytest.mark.parametrize("kind", ["position", "velocity"])
@pytest.mark.parametrize("block", BLOCKS)
def test_rows_are_the_derivative_of_the_residual(block, kind, level):
    where, size = BLOCKS[block]
    H = read(kind, np.zeros(61), level=level)[1]
    assert len(H) == (2 if level else 3)
    for state in where:
        step = size * np.eye(61)[state]
        minus, plus = (read(kind, sign * step, level=level)[0] for sign in (-1.0, 1.0))
        slope = (plus - minus) / (2.0 * size)
        row = np.array([np.ravel(row.get(state, 0.0))[0] for row in H])
        assert row == pytest.approx(slope, abs=SHARE * np.abs(slope).max() + ROUND_EARTH)


def test_every_state_of_the_rows_is_in_a_block():
    asked = {state for where, _ in BLOCKS.values() for state in where}
    for kind in ("position", "velocity"):
        for row in read(kind, np.zeros(61))[1]:
            assert set(row) <= asked


def test_a_perfect_solution_leaves_nothing():
    for kind in ("position", "velocity"):
        assert read(kind, np.zeros(61))[0] == pytest.approx(np.zeros(3), abs=5e-6)


def test_what_was_found_goes_back_into_the_residual():
    """About an arm and delays that were found, z is what the states about the declared explain:
    all but the product of delay and change of the arm's swing.
    """
    x = np.zeros(61)
    x[list(OF.arm)] = 0.4, -0.3, 0.1
    found = Antenna(ARM_M + x[list(OF.arm)], found_m=x[list(OF.arm)])
    for kind in ("position", "velocity"):
        z, rows = read(kind, x, antenna=found)
        explained = [sum(np.ravel(a)[0] * x[state] for state, a in row.items()) for row in rows]
        assert z == pytest.approx(explained, abs=1e-5)


def test_a_standing_vehicle_shows_no_attitude_in_its_velocity():
    for row in read("velocity", np.zeros(61), moves=False)[1]:
        for state in BLOCKS["attitude"][0]:
            assert not np.any(row.get(state, 0.0))


def test_sums_between_two_pieces_of_a_log_are_those_of_the_rows_before(monkeypatch):
    """1 rad/s and 2 m/s^2 for 4 s, none for 5 s, then 4 s; also before and after the log."""
    monkeypatch.setattr("ins.records.PIECE_ROWS", 4)
    ends, rows = np.array([1.0, 2.0, 3.0, 4.0, 10.0, 11.0, 12.0, 13.0]), np.ones((8, 3))
    log = ImuLog(time_s=ends, dt_s=np.ones(8), dtheta_rad=rows, dv_m_s=2.0 * rows)
    sums = RowSums(log).at(np.array([12.5, 6.0, -1.0, 2.5, 20.0, 8.9]))[:, :6]
    seconds = np.array([7.5, 4.0, 0.0, 2.5, 8.0, 4.0])
    assert sums == pytest.approx(seconds[:, None] * np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0]))
