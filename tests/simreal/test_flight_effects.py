"""Effects of flight: made row by row in another form than the catalogue's signature, and seen as
the signature in the whitened rows of a flight.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from ins.errors.catalogue import catalogue
from ins.errors.flight import FLIGHT_EFFECTS, pressure_change_hpa
from ins.errors.telemetry import AIRBORNE, Trace, on_axis
from ins.units import MICRO_G, STANDARD_GRAVITY
from simreal.evidence.run_view import view_run
from simreal.evidence.whitened import Evidence
from simreal.inference.bank import shapes_of
from tests.simreal.runs import FLIGHT, simulated, table, twin_of

DIAGNOSED = [effect for effect in FLIGHT_EFFECTS if effect.diagnosed]
BY_ID = {effect.id: effect for effect in FLIGHT_EFFECTS}
ALIKE = 0.98  # |cos| of a planted effect and its signature: 4 % of the energy may differ
SWING_RAD_S = 0.01  # of the mount's angles
SHAKE_M_S2 = 1.5  # of the mount in flight, where the gyros of a real unit see 0.1 to 0.3 g


@lru_cache(maxsize=1)
def flown():
    """A flight whose mount shakes while it is airborne, as it is seen, and its evidence."""
    session = simulated(segments=FLIGHT, aids=True)
    run = session.run
    imu = run.imu.whole()
    rng = np.random.default_rng(18)
    clean = view_run(run, 0, table(), twin_of())
    air = np.interp(imu.time_s, clean.telemetry.time_s, clean.telemetry.kind == AIRBORNE) > 0.5
    shake = SHAKE_M_S2 * air[:, None] * rng.standard_normal(imu.dv_m_s.shape)
    # of one row to the next: nothing is left of it over a second
    shake -= np.roll(shake, 1, axis=0)
    swing = SWING_RAD_S * shake / SHAKE_M_S2
    shaken = replace(
        imu,
        dv_m_s=imu.dv_m_s + shake * imu.dt_s[:, None],
        dtheta_rad=imu.dtheta_rad + swing * imu.dt_s[:, None],
    )
    view = view_run(replace(run, imu=shaken), 0, table(), twin_of())
    return view, Evidence([view], twin_of()), imu, shake


def by_seconds(rows):
    """Means of rows (n, ...) over the seconds of the flight."""
    view, _, imu, _ = flown()
    at = np.searchsorted(view.seconds.end_s, imu.time_s - 1e-6)
    at = np.minimum(at, view.seconds.end_s.size - 1)
    count = np.bincount(at, minlength=view.seconds.end_s.size)
    columns = rows.reshape(len(rows), -1).T
    sums = [np.bincount(at, c, view.seconds.end_s.size) for c in columns]
    return np.stack(sums, axis=1) / np.maximum(count, 1)[:, None]


def squares_of_rows(axis):
    """K2 a^2 of every row: what a quadratic sensor does."""
    _, _, _, shake = flown()
    return Trace(accel_m_s2=on_axis(by_seconds(shake[:, axis] ** 2)[:, 0], axis))


def gyro_that_feels_power():
    _, _, _, shake = flown()
    power = np.cumsum(np.linalg.norm(shake, axis=1) ** 2)
    return Trace(gyro_rad_s=on_axis(by_seconds(np.diff(power, prepend=0.0))[:, 0], 1))


def gyro_that_sums_cones_wrongly():
    """The sizes of the other two axes' swings, row by row, multiplied."""
    _, _, _, shake = flown()
    cone = np.abs(shake[:, 0]) * np.abs(shake[:, 1])
    return Trace(gyro_rad_s=on_axis(by_seconds(cone)[:, 0], 2))


def columns_of_air():
    """Pressure summed up layer by layer: dp = -rho g dh, T falling by 6.5 degC a km."""
    view, _, _, _ = flown()
    telemetry = view.telemetry
    heights = np.arange(0.0, 6000.0, 5.0)
    p = [1013.25]
    for h in heights[:-1]:
        p.append(p[-1] * (1.0 - 9.80665 * 5.0 / (287.05 * (288.15 - 0.0065 * (h + 2.5)))))
    at = np.interp(telemetry.height_m + telemetry.above_m, heights, p)
    return at - np.interp(telemetry.height_m, heights, p)


def one_sense_stretched():
    """Each row is measured with the scale of its own sense."""
    view, _, _, _ = flown()
    force = view.telemetry.force_m_s2[:, 0]
    read = np.where(force > 0, force * 1.001, force * 0.999)
    return Trace(accel_m_s2=on_axis(read - force, 0))


def stamped_by_a_fast_clock():
    """Where the vehicle was when the receiver says that it is there."""
    view, _, _, _ = flown()
    t = view.telemetry
    way = np.cumsum(t.v_n_m_s, axis=0)
    true_s = t.time_s * (1.0 - 1e-3)
    moved = np.stack([np.interp(true_s, t.time_s, c) for c in way.T], axis=1) - way
    return Trace(gnss_position_m=moved, gnss_velocity_m_s=np.gradient(moved, axis=0))


def fixes_on_a_circle(period_s=800.0):
    """A reflection that goes round: a turning pointer."""
    view, _, _, _ = flown()
    pointer = 2.0 * np.exp(2j * np.pi * view.telemetry.time_s / period_s)
    way = np.stack([pointer.real, pointer.imag, np.zeros(pointer.size)], axis=1)
    return Trace(gnss_position_m=way, gnss_velocity_m_s=np.gradient(way, axis=0))


def plumb_line_that_turns_north():
    """Gravity turned about east, by an angle that grows with the way flown."""
    view, _, _, _ = flown()
    t = view.telemetry
    way = np.linalg.norm(np.cumsum(t.v_n_m_s[:, :2], axis=0), axis=1)
    angle = 1e-9 * way
    force_n = STANDARD_GRAVITY * np.stack(
        [np.sin(angle), np.zeros(t.n), 1.0 - np.cos(angle)], axis=1
    )
    return Trace(accel_m_s2=(np.swapaxes(t.C_nb, 1, 2) @ force_n[:, :, None])[:, :, 0])


PLANTED = {
    "accel_vibration_rectification": ("accel_x", lambda: squares_of_rows(0)),
    "gyro_vibration_rectification": ("gyro_y", gyro_that_feels_power),
    "coning_residual": ("gyro_z", gyro_that_sums_cones_wrongly),
    "gyro_pressure_sensitivity": ("gyro_x", lambda: Trace(gyro_rad_s=on_axis(columns_of_air(), 0))),
    "accel_pressure_sensitivity": (
        "accel_y",
        lambda: Trace(accel_m_s2=on_axis(columns_of_air(), 1)),
    ),
    "accel_scale_asymmetry": ("accel_x", one_sense_stretched),
    "gnss_clock_drift": ("gnss", stamped_by_a_fast_clock),
    "gnss_slow_error": ("gnss", fixes_on_a_circle),
    "vertical_deflection_gradient": ("site", plumb_line_that_turns_north),
}


@pytest.mark.parametrize("key", PLANTED)
def test_an_effect_of_flight_made_otherwise_is_its_signature(key):
    view, evidence, _, _ = flown()
    target, planted = PLANTED[key]
    shape = {"period_s": 800.0} if key == "gnss_slow_error" else {}
    seen = evidence.whiten([[planted()]])[:, 0]
    columns = evidence.whiten([list(BY_ID[key].traces(view.telemetry, target, shape))])
    fitted = columns @ np.linalg.lstsq(columns, seen, rcond=None)[0]
    assert np.linalg.norm(fitted) > ALIKE * np.linalg.norm(seen) > 0.0


def test_a_bias_of_the_vertical_accelerometer_that_was_seen_at_rest_is_no_gap_in_flight():
    """Banked, a part of it is level: 80 ug were 5 sigmas of the fixes (an accel_scale_factor)."""
    view, evidence, _, _ = flown()
    bias = Trace(accel_m_s2=on_axis(np.full(view.telemetry.n, 80.0 * MICRO_G), 2))
    seen = evidence.whiten([[bias]])[:, 0]
    # its turn-on sigma is 30 ug: 2.7 sigma at rest, which then is known to a few micro-g
    assert np.linalg.norm(seen[~evidence.followed]) == pytest.approx(80.0 / 30.0, rel=0.1)
    assert np.linalg.norm(seen[evidence.followed]) < 0.5


def test_effects_of_flight_ask_for_a_flight_with_a_receiver():
    view, _, _, _ = flown()
    parked = view_run(simulated().run, 0, table(), twin_of()).telemetry
    for effect in DIAGNOSED:
        if effect.id.endswith("saturation"):  # any motion shows it: test_saturation.py
            continue
        for target in effect.targets:
            assert "flight" in effect.needs([parked], target)
            lacks = effect.needs([view.telemetry], target)
            assert lacks in ("", "20 km of way"), effect.id


@pytest.mark.slow
def test_a_flight_shows_twelve_effects_and_more_in_its_innovations():
    """Each leaves 5 % of its whitened energy or more in the rows that follow the parked ones."""
    view, evidence, _, _ = flown()
    found = set()
    for effect in catalogue():
        for target in effect.targets:
            if effect.needs([view.telemetry], target) or effect.name in found:
                continue
            traces = effect.traces(view.telemetry, target, shapes_of(effect, view.telemetry)[0])
            seen = evidence.whiten([list(traces[:1])])
            energy = float(np.sum(seen[evidence.followed] ** 2))
            if traces and energy > 0.05 * float(np.sum(seen**2)):
                found.add(effect.name)
    assert {e.name for e in DIAGNOSED} - {"vertical_deflection_gradient"} <= found
    assert len(found) >= 20


def test_pressure_falls_as_the_standard_says():
    view, _, _, _ = flown()
    telemetry = replace(view.telemetry, above_m=np.full(view.telemetry.n, 1000.0), height_m=0.0)
    # ISO 2533: 898.75 hPa at 1000 m
    assert pressure_change_hpa(telemetry) == pytest.approx(898.75 - 1013.25, abs=0.1)
