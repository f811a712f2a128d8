"""Velocities and wheels in other units, orders and signs than the map says, against the positions
of a vehicle that drives.
"""

import re

import numpy as np
import pytest

from ins.earth import displacement_ned
from ins.records import GnssLog, OdometerLog
from tests.infield.aided_cases import flown, ideal, twin_of
from trajectories.readers.conversion_checks import _pairs, check_streams
from trajectories.runs.checks import Findings

TIME_S = np.arange(1.0, 121.0)


def driven(*, climb_m_s: float = 0.0, noise: float = 0.0, change=lambda v: v) -> GnssLog:
    """Two minutes on a circle at 12 m/s, a fix a second, its velocity changed."""
    rng = np.random.default_rng(6)
    heading = 0.02 * TIME_S
    v = np.column_stack(
        [12 * np.cos(heading), 12 * np.sin(heading), np.full(TIME_S.size, -climb_m_s)]
    )
    north, east = 12 / 0.02 * np.sin(heading), -12 / 0.02 * np.cos(heading)
    return GnssLog(
        time_s=TIME_S,
        lat_rad=0.7 + (north + noise * rng.standard_normal(120)) / 6.36e6,
        lon_rad=np.full(120, 0.2)
        + (east + noise * rng.standard_normal(120)) / 6.386e6 / np.cos(0.7),
        height_m=300 + climb_m_s * TIME_S,
        v_n_m_s=change(v),
    )


def lines(gnss, odometer=None) -> list[str]:
    findings = Findings()
    check_streams(gnss, odometer, label="log", findings=findings)
    return findings.errors


def test_the_yardstick_is_right():
    """12 m/s along the circle, chord and arc alike to 2e-5, on the ellipsoid to half a percent."""
    way, v = _pairs(driven(climb_m_s=1.0))
    np.testing.assert_allclose(way, v, atol=0.1)
    one = displacement_ned(
        np.array([0.7]), np.array([0.2]), lat0_rad=0.7 - 1e-5, lon0_rad=0.2, height0_m=0.0
    )
    assert one[0, 0] == pytest.approx(63.6, abs=0.1)


CHANGES = [
    (
        lambda v: v[:, [1, 0, 2]],
        r"^log: velocities of the fixes are \d+% off .*: east taken for north \(frame\?\)\?$",
    ),
    (lambda v: -v, "signs turned round"),
    (lambda v: 3.6 * v, ": km/h taken for m/s"),
    (lambda v: v / 3.6, "m/s taken for km/h"),
    (lambda v: v * 3600 / 1852, ": kn taken for m/s"),
    (lambda v: 1e3 * v, "mm/s taken for m/s"),
    (lambda v: 3.6 * v[:, [1, 0, 2]], r"east taken for north \(frame\?\), km/h taken for m/s"),
]


@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize(("change", "line"), CHANGES)
def test_velocities_that_are_not_those_of_the_positions(change, line, noise):
    (found,) = lines(driven(change=change, noise=noise))
    assert re.search(line, found)
    assert lines(driven(noise=noise)) == []


def test_up_taken_for_down():
    (line,) = lines(driven(climb_m_s=2.0, change=lambda v: v * [1, 1, -1]))
    assert "up taken for down" in line
    assert lines(driven(climb_m_s=2.0)) == []
    assert lines(driven(change=lambda v: v * [1, 1, -1])) == []


@pytest.mark.parametrize(
    ("factor", "cause"),
    [(3.6, "km/h taken for m/s"), (1 / 3.6, "m/s taken for km/h"), (2.237, "mph"), (1e-2, "cm/s")],
)
def test_a_wheel_in_another_unit(factor, cause):
    wheel = OdometerLog(time_s=np.arange(0.0, 125.0, 0.1), speed_m_s=np.full(1250, 12.0 * factor))
    (found,) = lines(driven(), wheel)
    assert found.startswith(f"log: the wheel reads {factor:.3g} times the speed of the fixes: ")
    assert cause in found
    for scale in (0.93, 1.0, 1.06, 1.3):  # worn or wrong tyres are no unit
        assert (
            lines(driven(), OdometerLog(time_s=wheel.time_s, speed_m_s=np.full(1250, 12.0 * scale)))
            == []
        )


@pytest.mark.parametrize("technology", ["rlg", "mems"])
def test_flights_and_parked_logs_are_left_alone(technology):
    """A lever arm, a receiver's noise, turns and climbs; and standing still, where anything may be
    said of nothing.
    """
    run = flown(ideal(60.0), twin_of(technology), 3).run
    assert lines(run.gnss) == []
    still = GnssLog(
        time_s=TIME_S,
        lat_rad=np.full(120, 0.7) + 1e-7 * np.random.default_rng(1).standard_normal(120),
        lon_rad=np.full(120, 0.2),
        height_m=np.full(120, 300.0),
        v_n_m_s=np.zeros((120, 3)),
    )
    assert lines(still) == [] and lines(None) == []
