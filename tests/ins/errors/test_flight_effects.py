"""Effects of flight: sizes and signs by hand. That they are seen so: tests/simreal."""

import numpy as np
import pytest

from ins.errors.flight import FLIGHT_EFFECTS
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, MICRO_G, STANDARD_GRAVITY
from tests.ins.errors.vehicle_fixture import drive

BY_ID = {effect.id: effect for effect in FLIGHT_EFFECTS}
HPA = 898.75 - 1013.25  # of 1000 m, ISO 2533
BRAKES, CRUISES = 765, 680  # seconds at -0.5 m/s^2, and at 10 m/s on one heading


def flight():
    """The drive, 1000 m up: shaken by 0.1, 0.2 and 0.3 g, swung by 1, 2 and 3 deg/s."""
    n = drive().n
    return drive(
        vibration_m2_s4=np.tile((STANDARD_GRAVITY * np.array([0.1, 0.2, 0.3])) ** 2, (n, 1)),
        swing_rad2_s2=np.tile((DEG * np.array([1.0, 2.0, 3.0])) ** 2, (n, 1)),
        above_m=np.full(n, 1000.0),
        at_range=np.tile([0.0, -0.5, 0.0, 0.0, 0.0, 0.5], (n, 1)),
        has_gnss=True,
    )


def traces(key, target, **shape):
    return BY_ID[key].traces(flight(), target, shape)


@pytest.mark.parametrize(
    ("key", "target", "second", "expected"),
    [
        ("accel_vibration_rectification", "accel_y", 0, [MICRO_G * 0.04]),
        ("gyro_vibration_rectification", "gyro_y", 0, [DEG_PER_HOUR * 0.14]),
        ("coning_residual", "gyro_y", 0, [DEG_PER_HOUR * 1.0 * 3.0]),
        ("gyro_pressure_sensitivity", "gyro_z", 0, [DEG_PER_HOUR * HPA]),
        ("accel_pressure_sensitivity", "accel_x", 0, [MICRO_G * HPA]),
        ("accel_scale_asymmetry", "accel_x", BRAKES, [0.5e-6]),
        # half of the rows at the end lack 1, and of a swing 1 / sqrt(2 pi)
        ("gyro_saturation", "gyro_y", 0, [0.5 * DEG, 2.0 * DEG / np.sqrt(2 * np.pi)]),
        (
            "accel_saturation",
            "accel_z",
            0,
            [-0.5 * STANDARD_GRAVITY, -0.3 * STANDARD_GRAVITY / np.sqrt(2 * np.pi)],
        ),
    ],
)
def test_one_unit_of_each_coefficient(key, target, second, expected):
    kind, axis = target.split("_")
    name, other = ("gyro_rad_s", "accel_m_s2") if kind == "gyro" else ("accel_m_s2", "gyro_rad_s")
    found = traces(key, target)
    assert len(found) == len(expected)
    for trace, value in zip(found, expected):
        row = getattr(trace, name)[second]
        assert row["xyz".index(axis)] == pytest.approx(value, rel=2e-3)
        assert np.count_nonzero(row) == 1 and getattr(trace, other) is None


def test_a_fast_clock_stamps_where_the_vehicle_will_be():
    """After 680 s 1 ppm are 0.68 ms, 6.8 mm at 10 m/s; at one speed the velocity is right."""
    run, (trace,) = flight(), traces("gnss_clock_drift", "gnss")
    late_s = 1e-6 * run.time_s[CRUISES]
    np.testing.assert_allclose(trace.gnss_position_m[CRUISES], -late_s * run.v_n_m_s[CRUISES])
    speeds_up = 605  # 1 m/s^2 on heading 0
    assert trace.gnss_velocity_m_s[speeds_up, 0] == pytest.approx(-1e-6 * run.time_s[speeds_up])


def test_fixes_that_wander_have_the_velocity_of_it():
    run, found = flight(), traces("gnss_slow_error", "gnss", period_s=400.0)
    phase = 2 * np.pi * run.time_s / 400.0
    ways = [(np.sin(phase), 0), (np.cos(phase), 0), (np.sin(phase), 1), (np.cos(phase), 1)]
    for trace, (way, axis) in zip(found, ways, strict=True):
        np.testing.assert_allclose(trace.gnss_position_m[:, axis], way)
        moved = np.gradient(trace.gnss_position_m, run.time_s, axis=0)
        np.testing.assert_allclose(trace.gnss_velocity_m_s[1:-1], moved[1:-1], atol=1e-6)


def test_the_plumb_line_leans_with_the_way_from_the_site():
    run, (north, east) = flight(), traces("vertical_deflection_gradient", "site")
    far_m = np.linalg.norm(np.cumsum(run.v_n_m_s[:, :2], axis=0), axis=1)[CRUISES]
    leans = STANDARD_GRAVITY * ARCSEC * far_m / 1e5
    C_nb = run.C_nb[CRUISES]
    np.testing.assert_allclose(C_nb @ north.accel_m_s2[CRUISES], [leans, 0, 0], atol=1e-12)
    np.testing.assert_allclose(C_nb @ east.accel_m_s2[CRUISES], [0, leans, 0], atol=1e-12)
