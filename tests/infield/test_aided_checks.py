"""Logs that speak against themselves or their header in aided replay: said, left out, or
`inconsistent`.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from infield.aided.antenna import BOTH, NOTHING_FREED, Freed, antenna_sigmas, material
from infield.aided.checks import contradicted
from infield.aided.flight import aided_noise, navigate_aided, warming_walk
from infield.aided.flights import Flights
from infield.aided.noise import Flown, Model
from infield.aided.reasons import AidedNote, AidedReason, Widened
from infield.session.log import find_rest
from ins.filters.aided_records import Antenna, Fixes, fixes_of
from ins.records import Run, Site, TemperatureLog
from ins.units import MICRO_G
from ins.verdicts import codes, sentences
from tests.infield.aided_cases import (
    SITE,
    errors,
    flown,
    gauss_markov,
    ideal,
    late_velocities,
    normalised,
    twin_of,
)

PARK_S = 180.0


def fly(run: Run, technology: str):
    rest = find_rest(run) if technology == "rlg" else None
    return navigate_aided(run, run.imu, twin_of(technology), rest=rest, gyro_sigma_deg_h=None)


def turned(run: Run, C: np.ndarray, lever_arm_m=(0.0, 0.0, 0.0)) -> Run:
    """The run of a unit whose axes are C of the vehicle's."""
    imu = replace(run.imu, dtheta_rad=run.imu.dtheta_rad @ C.T, dv_m_s=run.imu.dv_m_s @ C.T)
    arm = tuple(float(v) for v in C @ np.asarray(run.header.gnss_lever_arm_m))
    return replace(run, imu=imu, header=replace(run.header, gnss_lever_arm_m=arm))


def correlated(run: Run, seed: int, sigma_m_s: float, time_s: float) -> Run:
    """The run with a Gauss-Markov error on its velocities beside the white one."""
    gnss = run.gnss
    e = gauss_markov(gnss.time_s, np.random.default_rng([seed, 79]), sigma_m_s, time_s)
    return replace(run, gnss=replace(gnss, v_n_m_s=gnss.v_n_m_s + e))


@pytest.mark.parametrize(
    ("technology", "flights"),
    [
        pytest.param("mems", 4, marks=pytest.mark.slow),
        pytest.param("rlg", 4, marks=pytest.mark.slow),
    ],
)
def test_correlated_velocities_are_found_and_in_the_sigmas(technology, flights):
    """0.1 m/s over 6 s on velocities of 0.03 m/s: white noise alone left velocity errors of three
    sigmas and more.
    """
    ratios = []
    for seed in range(flights):
        made = flown(ideal(PARK_S), twin_of(technology), 400 + seed)
        found = fly(correlated(made.run, seed, 0.1, 6.0), technology)
        assert found.verdict == "aided" and found.scales.slow_velocity > 1.0
        assert "slow error of the velocities" in sentences(found.notes)[-1]
        ratios.append(normalised(made, found.history, 200))
    assert (np.mean(ratios, axis=0) < 1.8).all()


def test_velocities_older_than_positions_are_told_apart():
    """Velocity is 0.4 s late and whose position is not: no lever arm is made of it."""
    made = flown(ideal(PARK_S), twin_of("rlg"), 7)
    gnss = made.run.gnss
    late = replace(gnss, v_n_m_s=late_velocities(made, gnss.time_s, gnss.v_n_m_s, 0.4))
    found = fly(replace(made.run, gnss=late), "rlg")
    antenna = found.antenna.antenna
    assert found.antenna.freed == (False, True) and "velocities are 40" in sentences(found.notes)[0]
    off = np.array([antenna.delay_s, antenna.velocity_delay_s - 0.4]) / antenna_sigmas(antenna)[3:]
    assert np.abs(off).max() < 3.0
    assert (
        np.mean(errors(made, found.history)[200:, :3] ** 2 / found.history.variance[200:, :3]) < 2.0
    )


def test_left_handed_units_are_inconsistent():
    made = flown(ideal(PARK_S), twin_of("mems"), 3)
    mirrored = fly(turned(made.run, np.diag([1.0, -1.0, 1.0])), "mems")
    assert mirrored.verdict in ("inconsistent", "refused")


@pytest.mark.slow
def test_units_of_a_wrong_scale_are_inconsistent():
    made = flown(ideal(PARK_S), twin_of("rlg"), 3)
    scaled = replace(made.run, imu=replace(made.run.imu, dtheta_rad=1.01 * made.run.imu.dtheta_rad))
    found = fly(scaled, "rlg")
    assert found.verdict == "inconsistent"
    assert any("scale factor" in reason for reason in sentences(found.reasons))


@pytest.mark.parametrize("flights", [1, pytest.param(8, marks=pytest.mark.slow)])
def test_shaken_accelerometers_make_no_gyro_noise(flights):
    """White noise of 32 times the declared on the accelerometers alone: found there, and the gyros
    keep theirs; with one factor for both, attitudes walked 8 times as far as they do. Errors are
    those of the sigmas.
    """
    ratios = []
    for seed in range(flights):
        made = flown(ideal(PARK_S), twin_of("mems"), 60 + seed)
        imu = made.run.imu
        density = 32.0 * twin_of("mems").accel.vrw_ug_sqrt_hz * MICRO_G
        shake = np.random.default_rng([seed, 61]).standard_normal(imu.dv_m_s.shape)
        dv = imu.dv_m_s + density * np.sqrt(imu.dt_s)[:, None] * shake
        header = replace(made.run.header, gyro_technology="mems")
        found = fly(replace(made.run, imu=replace(imu, dv_m_s=dv), header=header), "mems")
        assert found.verdict == "aided" and found.scales.white <= 4.0
        assert 8.0 <= found.scales.accel_white <= 128.0
        assert "white noise of the accelerometers" in sentences(found.notes)[-1]
        ratios.append(normalised(made, found.history, 60))
    assert (np.mean(ratios, axis=0) > 0.3).all() and (np.mean(ratios, axis=0) < 2.0).all()


@pytest.mark.slow
def test_shaken_accelerometers_make_no_delay():
    """White noise of 128 times the declared on the accelerometers: the fixes are as late as they
    say. With each step's own acceleration as what a delay is seen by, the noise of the
    accelerometers in the velocities was taken for one of 95 +- 9 ms, and positions were off by 6
    sigmas.
    """
    made = flown(ideal(PARK_S), twin_of("mems"), 60)
    imu = made.run.imu
    density = 128.0 * twin_of("mems").accel.vrw_ug_sqrt_hz * MICRO_G
    shake = np.random.default_rng([0, 61]).standard_normal(imu.dv_m_s.shape)
    dv = imu.dv_m_s + density * np.sqrt(imu.dt_s)[:, None] * shake
    header = replace(made.run.header, gyro_technology="mems")
    found = fly(replace(made.run, imu=replace(imu, dv_m_s=dv), header=header), "mems")
    assert found.antenna.freed == NOTHING_FREED
    assert (normalised(made, found.history, 60) < 4.0).all()


def fixes(run: Run):
    noise = twin_of("mems").gnss
    assert run.gnss is not None
    return fixes_of(
        run.gnss,
        horizontal_m=noise.sigma_horizontal_m,
        vertical_m=noise.sigma_vertical_m,
        velocity_m_s=noise.sigma_velocity_m_s,
    )


def falling(run: Run, speed_m_s: float) -> Run:
    """A receiver that tells a speed downward for 40 s which its positions do not go."""
    gnss = run.gnss
    told = (gnss.time_s > 400.0) & (gnss.time_s <= 440.0)
    v_n = gnss.v_n_m_s + np.where(told, speed_m_s, 0.0)[:, None] * np.array([0.0, 0.0, 1.0])
    return replace(run, gnss=replace(gnss, v_n_m_s=v_n))


def test_velocities_that_are_not_the_way_of_the_positions_are_found():
    """10 m/s downward for 40 s, of that component alone; nothing of sound flights, of a leap, of a
    wild position and of a wild velocity.
    """
    for seed in range(4):
        assert contradicted(fixes(flown(ideal(PARK_S), twin_of("mems"), seed).run)) is None
    sound = flown(ideal(PARK_S), twin_of("mems"), 1).run
    seen = contradicted(fixes(falling(sound, 10.0)))
    assert seen is not None and seen.components == "down"
    rows = seen.rows
    assert rows.sum() == pytest.approx(50, abs=12) and not rows[sound.gnss.time_s < 388.0].any()
    gnss, after = sound.gnss, sound.gnss.time_s > 400.0
    leapt = gnss.lat_rad + np.where(after, 300.0 / 6.37e6, 0.0)
    wild = gnss.lat_rad + np.where(np.arange(after.size) == 400, 200.0 / 6.37e6, 0.0)
    fast = gnss.v_n_m_s + np.where(np.arange(after.size) == 400, 50.0, 0.0)[:, None]
    for other in (
        replace(gnss, lat_rad=leapt),
        replace(gnss, lat_rad=wild),
        replace(gnss, v_n_m_s=fast),
    ):
        assert contradicted(fixes(replace(sound, gnss=other))) is None


# WGS-84: semi-major axis [m] and squared eccentricity
A_M, E2 = 6378137.0, (2.0 - 1.0 / 298.257223563) / 298.257223563
CRUISE_M = 10_000.0


def radii(lat):
    """Radii of the ways north and east at cruise height [m]; the east one times cos(lat)."""
    across = A_M / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)
    along = across * (1.0 - E2) / (1.0 - E2 * np.sin(lat) ** 2)
    return along + CRUISE_M, (across + CRUISE_M) * np.cos(lat)


def long_flight(lat_deg, course_deg, turn_deg) -> Fixes:
    """An hour of perfect fixes at 230 m/s on a course that turns evenly: the way of the velocities
    on the ellipsoid, by the midpoint rule.
    """
    t = np.arange(0.0, 3600.5, 0.5)
    course = np.radians(course_deg + turn_deg * t / t[-1])
    v_n = 230.0 * np.column_stack([np.cos(course), np.sin(course), np.zeros(t.size)])
    place = np.radians(np.tile([lat_deg, 7.0], (t.size, 1)))
    for k in range(0, t.size - 2, 2):
        place[k + 1] = place[k] + 0.5 * v_n[k, :2] / radii(place[k, 0])
        place[k + 2] = place[k] + v_n[k + 1, :2] / radii(place[k + 1, 0])
    lat, lon = place[::2].T
    level, up = radii(lat)[1], (A_M / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)) * (1.0 - E2) + CRUISE_M
    return Fixes(
        time_s=t[::2],
        r_e_m=np.column_stack([level * np.cos(lon), level * np.sin(lon), up * np.sin(lat)]),
        v_n_m_s=v_n[::2],
        sigma_position_m=np.ones((lat.size, 3)),
        sigma_velocity_m_s=np.full((lat.size, 3), 0.05),
    )


@pytest.mark.parametrize(
    ("lat_deg", "course_deg", "turn_deg"),
    [(45.0, 90.0, 0.0), (70.0, -90.0, 0.0), (30.0, 0.0, 0.0), (-60.0, 225.0, 0.0), (83.0, 0, 360)],
)
def test_long_flights_do_not_contradict_themselves(lat_deg, course_deg, turn_deg):
    """Perfect fixes; with sums in each fix's own north and east it was 89 to 248 sigmas. Half an
    hour later velocities of 10 m/s eastward that the positions do not go are found, and they alone.
    """
    fixes = long_flight(lat_deg, course_deg, turn_deg)
    assert contradicted(fixes) is None
    wrong = (fixes.time_s > 1800.0) & (fixes.time_s <= 1840.0)
    east = np.where(wrong, 10.0, 0.0)[:, None] * np.array([0.0, 1.0, 0.0])
    seen = contradicted(replace(fixes, v_n_m_s=fixes.v_n_m_s + east))
    assert seen is not None and seen.components == "east" and seen.sigmas > 10.0
    assert seen.rows[wrong].all() and not seen.rows[np.abs(fixes.time_s - 1820.0) > 31.0].any()


def test_widened_fixes_have_a_start_of_their_own():
    """A copy of the flights with other fixes begins with these, not with the start of the old."""
    run = flown(ideal(PARK_S), twin_of("mems"), 1).run
    narrow = fixes(run)
    wide = replace(narrow, sigma_position_m=100.0 * narrow.sigma_position_m)
    begun = []

    def begin(late, lever_arm_m):
        begun.append(float(late.sigma_position_m[0, 0] / narrow.sigma_position_m[0, 0]))
        return AidedReason.NO_FIXES

    noise, antenna = aided_noise(twin_of("mems")), Antenna(lever_arm_m=np.zeros(3))
    flights = Flights(run.imu, narrow, noise, (0.5, 0.75, 0.03), (), "mems", begin)
    flights.start(antenna)
    other = replace(flights, fixes=wide)
    other.start(antenna)
    other.start(antenna)
    assert begun == [1.0, 100.0]


def test_a_missed_temperature_warms_nothing():
    """A ramp of 1 degC/min, gyro z 20 degC warmer: with a row that no thermometer has, rows that x
    alone misses, and a thermometer that never reads, the walk is that of the ramp.
    """
    t = np.arange(0.0, 1200.0, 10.0)
    degC = np.column_stack([t / 60.0, t / 60.0, t / 60.0 + 20.0])
    ramp = warming_walk(TemperatureLog(time_s=t, gyro_degC=degC))
    assert ramp == pytest.approx(np.sqrt(960.0) / 60.0)  # the longest lag, 16 min
    missed = degC.copy()
    missed[30], missed[50:60, 0], missed[-1] = np.nan, np.nan, np.nan
    assert warming_walk(TemperatureLog(time_s=t, gyro_degC=missed)) == pytest.approx(ramp, rel=0.02)
    missed[:, 2] = np.nan
    assert warming_walk(TemperatureLog(time_s=t, gyro_degC=missed)) == pytest.approx(ramp, rel=0.02)
    silent = np.full(degC.shape, np.nan)
    assert warming_walk(TemperatureLog(time_s=t, gyro_degC=silent)) == 0.0


@pytest.mark.slow
def test_contradicting_velocities_lose_their_weight():
    """The velocities of that component are widened, for the sensors and the positions contradict
    them; the solution is within its sigmas, and the page says it.
    """
    made = flown(ideal(PARK_S), twin_of("mems"), 1)
    found = fly(falling(made.run, 10.0), "mems")
    assert found.verdict == "aided"
    (widened,) = [note for note in found.notes if note.code is AidedNote.FIXES_WIDENED]
    assert widened.values["components"] == "down" and widened.values["whose"] is Widened.VELOCITY
    assert (normalised(made, found.history, 60) < 2.0).all()


def test_delays_that_no_receiver_has_are_not_taken():
    """A public copter whose receiver tells nothing of the motion was flown with positions that come
    5.9 s before their time, and was 7.6 sigmas off.
    """
    late = Antenna(lever_arm_m=np.zeros(3), delay_s=-5.9, velocity_delay_s=-2.2)
    far = Antenna(lever_arm_m=np.array([-15.0, 12.0, -33.0]))
    usual = Antenna(lever_arm_m=np.array([0.0, 0.0, -6.0]), delay_s=0.4, velocity_delay_s=0.4)
    taken = []
    for end, freed in (
        (late, Freed(arm=False, delay=True)),
        (far, Freed(arm=True, delay=False)),
        (usual, BOTH),
    ):
        flight = Flown(Model(antenna=end), SimpleNamespace(antenna=end))
        taken.append(material(flight, Antenna(lever_arm_m=np.zeros(3)), freed, 0.5))
    assert taken == [False, False, True]


@pytest.mark.slow
def test_accelerometers_that_move_with_the_shaking_are_followed():
    """From 300 s on the airframe shakes with 3 m/s^2, and the vertical accelerometer reads 2 m/s^2
    less: no noise of the sensors explains it, the shaking does; errors are within the sigmas.
    """
    made = flown(ideal(PARK_S), twin_of("mems"), 3)
    imu = made.run.imu
    shakes = np.where((imu.time_s > 300.0) & (imu.time_s < 500.0), 1.0, 0.0)[:, None]
    noise = 3.0 * np.random.default_rng([3, 62]).standard_normal(imu.dv_m_s.shape)
    dv = imu.dv_m_s + imu.dt_s[:, None] * shakes * (noise + np.array([0.0, 0.0, 2.0]))
    header = replace(made.run.header, gyro_technology="mems")
    found = fly(replace(made.run, imu=replace(imu, dv_m_s=dv), header=header), "mems")
    assert found.verdict == "aided" and found.scales.stirred > 0.0
    assert "noise_taken" in codes(found.notes)
    assert (normalised(made, found.history, 60) < 3.0).all()


def test_unit_turned_about_the_vertical_is_told():
    made = flown(ideal(PARK_S), twin_of("mems"), 2)
    assert not any("off_the_track" in code for code in codes(fly(made.run, "mems").notes))
    # body x to the left: heading - track = -90
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    notes = sentences(fly(turned(made.run, quarter), "mems").notes)
    assert any("-90 deg off the track" in note for note in notes)


def test_site_elsewhere_is_told():
    made = flown(ideal(PARK_S), twin_of("mems"), 2)
    away = Site(lat_rad=SITE.lat_rad + 500.0 / 6.37e6, lon_rad=SITE.lon_rad, height_m=SITE.height_m)
    notes = sentences(
        fly(replace(made.run, header=replace(made.run.header, site=away)), "mems").notes
    )
    assert [note for note in notes if "from the site of run.json" in note and "50" in note]


def test_stuck_receiver_is_left_out():
    """Thirty seconds of the same fix at speed: rejected for long, once taken for a new start."""
    made = flown(ideal(PARK_S), twin_of("mems"), 5)
    gnss = made.run.gnss
    held = np.where(
        (gnss.time_s > 420.0) & (gnss.time_s <= 450.0),
        np.searchsorted(gnss.time_s, 420.0 + 1e-6) - 1,
        np.arange(gnss.time_s.size),
    )
    stuck = replace(
        gnss,
        lat_rad=gnss.lat_rad[held],
        lon_rad=gnss.lon_rad[held],
        height_m=gnss.height_m[held],
        v_n_m_s=gnss.v_n_m_s[held],
    )
    found = fly(replace(made.run, gnss=stuck), "mems")
    assert found.verdict == "aided"
    assert "repeated_fixes" in codes(found.notes)[0]
    assert (
        np.mean(errors(made, found.history)[60:, :3] ** 2 / found.history.variance[60:, :3]) < 2.0
    )
