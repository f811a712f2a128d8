"""Rows of wheels, standstill and surveys against central differences of a nonlinear vehicle: it
rolls in a turn, gathers speed and slips, its solution has errors of attitude and place. No block is
left out.
"""

import numpy as np
import pytest

from ins.attitude import dcm_from_euler, dcm_from_rotation_vector
from ins.earth import (
    SEMI_MAJOR_AXIS_M,
    dcm_en,
    ecef_from_geodetic,
    geodetic_from_ecef,
    gravity_magnitude,
    omega_ie_n,
)
from ins.estimation import states
from ins.estimation.measurements import gravity, standstill, survey, wheels
from ins.units import DEG

LAT, LON, HEIGHT_M = 50 * DEG, 7 * DEG, 900.0
HEADING_RAD = 1.1
C_NB = dcm_from_euler(0.0, 0.0, HEADING_RAD)
SPEED_M_S, GAIN_M_S2, DT_S = 8.0, 0.7, 1.0
RATE_B = np.array([0.02, -0.03, 0.25])
DECLARED_ARM_M = np.array([-3.0, 0.4, 1.5])  # from the unit to the no-slip point
AZIMUTH_RAD = HEADING_RAD - 0.03  # of the surveyed line
LINE_M = 8.0
SWING = 50
SIZE = 51
# block: its states, and how far each is moved
BLOCKS = {
    "position": (range(3, 5), 10.0),
    "attitude": (range(states.THETA.start, states.THETA.stop), 1e-4),
    "way": (range(states.S.start, states.S.stop), 1e-2),
    "crab": ([states.KAPPA], 1e-3),
    "wind": (range(states.WIND.start, states.WIND.stop), 1e-3),
    "crab that turns": ([states.CRAB_TURN], 1e-3),
    "gusts": ([states.CRAB_GUST], 1e-3),
    "side slip": ([states.SLIP], 1e-3),
    "arm along": ([states.LEVER_X], 0.1),
    "arm across": ([states.WHEEL_Y], 0.1),
    "odometer scale": ([states.ODOMETER], 1e-3),
    "odometer delay": ([states.ODOMETER_DELAY], 1e-2),
    "turn of the vehicle": ([states.YAW], 1e-4),
    "line": ([states.CENTRE_LINE], 1e-4),
    "swing": ([SWING], 1e-2),
}
# of the largest coefficient in the row's unit: the sphere of the error model
SHARE, ROUND_EARTH = 1e-4, 1e-8


def whole(value):
    return np.atleast_1d(np.asarray(value, dtype=float))


def place_of(x):
    """Latitude and longitude of the solution with errors of x."""
    C_en = dcm_en(LAT, LON)
    p_e = ecef_from_geodetic(LAT, LON, HEIGHT_M) + C_en @ [*x[3:5], 0.0]
    return geodetic_from_ecef(p_e)[:2]


def attitude(x, C_nb=C_NB):
    """Attitude of that solution, where the true one is C_nb."""
    C_en = dcm_en(LAT, LON)
    return dcm_en(*place_of(x)).T @ C_en @ dcm_from_rotation_vector(x[states.THETA]) @ C_nb


def rolled(x):
    """Way of the no-slip point as the solution has it with the declared arm: the wheels roll along
    their crab, the unit turns about them.
    """
    slip = x[states.SLIP] * SPEED_M_S * RATE_B[2] + x[states.WIND] @ C_NB[:2, 1]
    crab = x[states.KAPPA] + x[states.CRAB_TURN] + x[states.CRAB_GUST] + slip
    speed_b = SPEED_M_S * np.array([np.cos(crab), np.sin(crab), 0.0])
    arm_m = DECLARED_ARM_M - [x[states.LEVER_X], x[states.WHEEL_Y], 0.0]
    unit_b = (speed_b - np.cross(RATE_B, arm_m)) * DT_S + [*x[states.S], 0.0]
    way_b = unit_b + np.cross(RATE_B * DT_S, DECLARED_ARM_M)
    return wheels.PointWay(way_b[None], whole(RATE_B[2] * DT_S), whole(DT_S), C_NB[None])


def read_wheels(x):
    """Way by an odometer that reads its scale too much and late; the speed is SPEED_M_S in the
    middle of the step.
    """
    late_s = x[states.ODOMETER_DELAY]
    return (1.0 + x[states.ODOMETER]) * (SPEED_M_S - GAIN_M_S2 * late_s) * DT_S


def lateral(x):
    return wheels.lateral(rolled(x), 1.0)


def forward(x):
    return wheels.forward(rolled(x), whole(read_wheels(x)), whole(GAIN_M_S2 * DT_S), 1.0)


def stood(x):
    """A step of rolling, then two of standing; the vehicle swings along body y."""
    moved = np.array([[5.0, 1.0, 0.0], [0.0, 0.0, 0.0], [*x[states.S], 0.0]])
    moved[2, 1] += 0.5 * x[SWING]
    way = standstill.way_since_stop(moved, np.array([False, True, True]))
    return standstill.place(way[1:], whole(1.0), ({}, {SWING: 0.5}))


def kept_heading(x):
    turned = dcm_from_rotation_vector([0.0, 0.0, x[states.YAW]]) @ C_NB
    return standstill.heading(attitude(x, turned)[None], C_NB[None], 1.0, **sphere())


def surveyed(x):
    C_nb = attitude(x)
    heading = whole(np.arctan2(C_nb[1, 0], C_nb[0, 0]))
    return survey.heading(heading, HEADING_RAD, 1.0, **sphere())


def on_line(x):
    """The vehicle rolls along the true line, body x along HEADING_RAD."""
    along_b = C_NB.T @ [np.cos(AZIMUTH_RAD), np.sin(AZIMUTH_RAD), 0.0]
    way_n = attitude(x) @ (LINE_M * along_b + [*x[states.S], 0.0])
    azimuth = whole(AZIMUTH_RAD + x[states.CENTRE_LINE])
    return survey.cross_track(way_n[None], C_NB[None], azimuth, 1.0, **sphere())


def sphere():
    return {"lat_rad": whole(LAT), "radius_m": whole(SEMI_MAJOR_AXIS_M + HEIGHT_M)}


KINDS = {
    "lateral": lateral,
    "forward": forward,
    "place": stood,
    "heading": kept_heading,
    "surveyed heading": surveyed,
    "cross track": on_line,
}


def values(kind, x):
    return np.array([whole(z)[0] for z in KINDS[kind](x).z])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("block", BLOCKS)
def test_rows_are_the_derivative_of_the_residual(block, kind):
    where, size = BLOCKS[block]
    H = KINDS[kind](np.zeros(SIZE)).rows
    for state in where:
        step = size * np.eye(SIZE)[state]
        slope = (values(kind, step) - values(kind, -step)) / (2.0 * size)
        row = np.array([whole(row.get(state, 0.0))[0] for row in H])
        assert row == pytest.approx(slope, abs=SHARE * np.abs(slope).max() + ROUND_EARTH)


def test_every_state_of_the_rows_is_in_a_block():
    asked = {state for where, _ in BLOCKS.values() for state in where}
    for kind in KINDS:
        for row in KINDS[kind](np.zeros(SIZE)).rows:
            assert set(row) <= asked


@pytest.mark.parametrize("kind", KINDS)
def test_a_perfect_solution_leaves_nothing(kind):
    assert values(kind, np.zeros(SIZE)) == pytest.approx(0.0, abs=1e-12)


def test_ways_are_counted_from_the_last_stop():
    moved = np.arange(21.0).reshape(7, 3)
    still = np.array([True, True, False, True, True, False, True])
    way = standstill.way_since_stop(moved, still)
    expected = [[0.0, 1.0], [3.0, 5.0], [9.0, 10.0], [21.0, 23.0], [18.0, 19.0]]
    assert way == pytest.approx(np.array(expected))


TILTED = dcm_from_euler(0.3, -0.2, HEADING_RAD)


def at_rest(phi, north_rad):
    C_nb = dcm_from_rotation_vector(phi) @ TILTED
    return gravity.rest_readings(C_nb, lat_rad=LAT + north_rad, height_m=HEIGHT_M)


@pytest.mark.parametrize("sensor", ["rate", "force"])
@pytest.mark.parametrize("axis", range(3))
def test_readings_at_rest_by_attitude(sensor, axis):
    phi = 1e-4 * np.eye(3)[axis]
    slope = (getattr(at_rest(phi, 0.0), sensor) - getattr(at_rest(-phi, 0.0), sensor)) / 2e-4
    of_phi = getattr(at_rest(np.zeros(3), 0.0), f"{sensor}_of_phi")[:, axis]
    assert of_phi == pytest.approx(slope, rel=1e-6, abs=1e-10)
    assert np.linalg.norm(slope) > 1e-5 or (sensor, axis) == ("force", 2)


def test_readings_at_rest_by_latitude():
    none = np.zeros(3)
    slope = (at_rest(none, 1e-4).rate - at_rest(none, -1e-4).rate) / 2e-4
    assert at_rest(none, 0.0).rate_of_latitude == pytest.approx(slope, rel=1e-6)


def test_readings_at_rest_are_gravity_and_earth_rate():
    level = gravity.rest_readings(np.eye(3), lat_rad=LAT, height_m=HEIGHT_M)
    assert level.rate == pytest.approx(omega_ie_n(LAT))
    assert level.force == pytest.approx([0.0, 0.0, -gravity_magnitude(LAT, HEIGHT_M)])
