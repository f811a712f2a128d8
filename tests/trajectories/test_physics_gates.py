"""What a quiet start says of sensors where the vehicle moves, and of axes that a map turned."""

from dataclasses import replace

import numpy as np
import pytest

from ins.records import AXES, GnssLog, ImuLog, Site
from trajectories.readers.rows.column_map import AxesKeys, axis_matrix
from trajectories.runs.checks import Findings
from trajectories.runs.physics_gates import AXIS_MAPS, CoSensors, check_physics, quiet_means

SITE = Site(lat_rad=0.8, lon_rad=0.1, height_m=200.0)
RATE_HZ, SECONDS = 50.0, 120.0


def log(f_m_s2=(0.0, 0.0, -9.81)) -> ImuLog:
    """Two minutes of a steady specific force, with noise."""
    rows = int(RATE_HZ * SECONDS)
    rng = np.random.default_rng(1)
    dt = np.full(rows, 1.0 / RATE_HZ)
    force = np.asarray(f_m_s2) + 0.02 * rng.standard_normal((rows, 3))
    return ImuLog(
        time_s=np.cumsum(dt),
        dt_s=dt,
        dtheta_rad=1e-4 * dt[:, None] * rng.standard_normal((rows, 3)),
        dv_m_s=force * dt[:, None],
    )


def fixes(moves_until_s: float, speed_m_s: float = 11.6) -> GnssLog:
    """A drive north at a constant speed that stops at a time."""
    t = np.arange(0.0, SECONDS)
    v = np.where(t < moves_until_s, speed_m_s, 0.02)[:, None] * np.array([1.0, 0.0, 0.0])
    zero = np.zeros(t.size)
    return GnssLog(time_s=t, lat_rad=0.8 + zero, lon_rad=0.1 + zero, height_m=zero, v_n_m_s=v)


def told(imu: ImuLog, beside: CoSensors) -> tuple[str, ...]:
    findings = Findings()
    check_physics(imu, site=SITE, technology="mems", label="log", findings=findings, beside=beside)
    return tuple(found.text for found in findings.items)


def test_a_steady_drive_is_no_rest():
    """At 11.6 m/s throughout: steady, and its speed is told; where it stands later, that is the
    rest; a receiver's noise moves nothing.
    """
    assert quiet_means(log()).speed_m_s is None
    steady = quiet_means(log(), CoSensors(gnss=fixes(1e9)))
    assert steady.speed_m_s == pytest.approx(11.6) and "11.6 m/s" in steady.where
    later = quiet_means(log(), CoSensors(gnss=fixes(52.0)))
    assert later.speed_m_s is None and later.start_s > 55.0
    noise = fixes(0.0)
    assert quiet_means(log(), CoSensors(gnss=noise)).start_s < 1.0


def test_a_moving_unit_is_tested_for_its_force_and_not_its_rate():
    beside = CoSensors(gnss=fixes(1e9))
    turning = replace(log(), dtheta_rad=log().dtheta_rad + 0.02 * log().dt_s[:, None])
    assert told(turning, beside) == ()
    assert "mean |w| at rest" in told(turning, CoSensors())[0]
    (text,) = told(log((0.0, 0.0, -1.0)), beside)
    assert "11.6 m/s" in text and "g? multiply by 9.80665" in text


@pytest.mark.parametrize("map_axes", [("x", "y", "z"), ("y", "-x", "z"), ("-z", "y", "x")])
@pytest.mark.parametrize("gravity_on", list(AXIS_MAPS))
def test_proposed_axes_start_from_the_maps_own(map_axes, gravity_on):
    """The proposal, put in the map in place of its axes, brings gravity on -z: raw forces read by
    the map, read again by what is proposed.
    """
    axis, sign = gravity_on
    seen = np.zeros(3)
    seen[AXES.index(axis)] = sign * 9.81
    of_map = axis_matrix(AxesKeys(**dict(zip(AXES, map_axes))))
    (text,) = told(log(tuple(seen)), CoSensors(axes=map_axes, gnss=fixes(0.0)))
    words = text.partition("axes ")[2] if "would put it" in text else ""
    words = words.partition(" would put")[0]
    words = words.partition(";")[0]
    proposed = dict(
        part.split(" = ") for part in words.removeprefix("? If z points up, axes ").split(", ")
    )
    keys = AxesKeys(**{name: value.strip('"') for name, value in proposed.items()})
    raw = of_map.T @ seen
    assert axis_matrix(keys) @ raw == pytest.approx([0.0, 0.0, -9.81])
    assert np.linalg.det(axis_matrix(keys)) == pytest.approx(1.0)


def test_accelerometers_that_read_too_little_are_accepted_by_name():
    """8 m/s^2 at rest: refused with the key that accepts it; accepted where the key covers it, and
    said; a share that does not cover it, and 1 g in g, stay errors.
    """
    short = log((0.0, 0.0, -8.0))
    (refused,) = told(short, CoSensors())
    assert "mean |f| at rest is 8.0" in refused and "accepted_accelerometer_scale 0.19" in refused
    (accepted,) = told(short, CoSensors(accepted_scale=0.2))
    assert "(-18 % of gravity): accepted" in accepted
    assert told(short, CoSensors(accepted_scale=0.1)) == (refused,)
    (in_g,) = told(log((0.0, 0.0, -1.0)), CoSensors(accepted_scale=0.3))
    assert "multiply by 9.80665" in in_g
    assert told(log(), CoSensors(accepted_scale=0.3)) == ()


@pytest.mark.parametrize("gravity_on", list(AXIS_MAPS))
def test_a_unit_may_stand_in_any_attitude(gravity_on):
    """On its side without fixes: taken with a warning; with fixes, or upside down: refused until
    run.json says so.
    """
    axis, sign = gravity_on
    seen = np.zeros(3)
    seen[AXES.index(axis)] = sign * 9.81

    def levels(beside: CoSensors) -> list[str]:
        findings = Findings()
        at = {"site": SITE, "technology": "mems", "label": "log", "findings": findings}
        check_physics(log(tuple(seen)), **at, beside=beside)
        return [found.level for found in findings.items]

    assert levels(CoSensors()) == (["error"] if axis == "z" else ["warning"])
    assert levels(CoSensors(gnss=fixes(0.0))) == ["error"]
    assert levels(CoSensors(gnss=fixes(0.0), any_attitude=True)) == ["warning"]
