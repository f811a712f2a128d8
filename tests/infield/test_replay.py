"""Replaying a log with several tables: closed forms of the parked drift, truth known, refusals, the
page.
"""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from alignment.motion.kinds import Witness
from infield.replay.drift import REALIGN_M_S, drift_of
from infield.replay.free_inertial import TableChoice, heading_change, replay
from infield.replay.stops import StopInterval, stop_speed
from infield.reports.documents.replay import replay_document
from infield.reports.replay_page import render
from infield.session.pipeline import update_calibration
from infield.table.thermal_table import ThermalTable, default_table
from ins.documents import plain
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude, radii_of_curvature
from ins.records import AccelNoise, GyroNoise, Run, Site, TwinModel, VehicleNoise
from ins.units import DEG, DEG_PER_HOUR, HOUR, KNOT, MILLIRADIAN, NAUTICAL_MILE
from ins.verdicts import codes, sentences
from tests.scenarios.study import DEFAULT_TWIN, ideal, prior_table, table_to_zero
from trajectories.simulator.motions import Park, Pivot, Stop, Straight, Turn, lay
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
NO_NOISE = TwinModel(
    gyro=GyroNoise(
        arw_deg_sqrt_h=0.0,
        bias_instability_deg_h=0.0,
        rate_random_walk_deg_h_sqrt_h=0.0,
        turn_on_deg_h=0.0,
    ),
    accel=AccelNoise(
        vrw_ug_sqrt_hz=0.0, bias_instability_ug=0.0, rate_random_walk_ug_sqrt_h=0.0, turn_on_ug=0.0
    ),
    vehicle=VehicleNoise(sway_m_s=0.0, yaw_creep_arcsec_sqrt_h=0.0, lateral_noise_m_s=0.0),
)
QUIET = replace(
    DEFAULT_TWIN,
    gyro=GyroNoise(
        arw_deg_sqrt_h=2e-4,
        bias_instability_deg_h=0.0,
        rate_random_walk_deg_h_sqrt_h=0.0,
        turn_on_deg_h=0.0,
    ),
)
R = float(np.sqrt(np.prod(radii_of_curvature(SITE.lat_rad))))
SCHULER_RAD_S = float(np.sqrt(gravity_magnitude(SITE.lat_rad, SITE.height_m) / R))
ERROR_DEG_H = 0.01  # physics.md 6.3, 6.4: its reference case


def flat(**bias_deg_h: float) -> ThermalTable:
    """A table that reads the same at all temperatures."""
    table = prior_table(0.01)
    values = table.parameters.copy()
    for axis, value in bias_deg_h.items():
        values[table.values_of(axis)] = value
    return table.replaced(parameters=values)


def choices(active: ThermalTable, previous: ThermalTable | None = None) -> list[TableChoice]:
    named = [("active", active)] + ([("previous", previous)] if previous is not None else [])
    return [TableChoice(role=role, table=table, origin=f"test {role}") for role, table in named]


def simulated(
    motion,
    seed: int,
    *,
    heading_deg: float = 0.0,
    twin: TwinModel = NO_NOISE,
    ageing: float = 0.0,
    start: str = "ambient",
    site: Site = SITE,
    **streams,
) -> SimulatedRun:
    unit = aged_unit(
        np.random.default_rng(5),
        ageing_offset_deg_h=ageing,
        ageing_shape_deg_h=0.3 * ageing,
        table=table_to_zero(),
    )
    base = ideal_sensors(build_truth(motion, site, heading_rad=heading_deg * DEG), 10.0)
    return simulate_run(
        base,
        thermal_history(start),
        unit,
        twin,
        rng=np.random.default_rng(seed),
        plan=SessionPlan(**streams),
    )


@lru_cache(maxsize=4)
def parked(seconds: float, heading_deg: float = 0.0, **streams) -> SimulatedRun:
    """A perfect unit, parked, without noise: 10 min of alignment, then navigation."""
    return simulated(lay([Park(duration_s=seconds)]), 1, heading_deg=heading_deg, **streams)


def test_north_table_error_drifts_as_schuler_says():
    """0.01 deg/h of north gyro error: R u (1 - sin(wt)/(wt)) t, 0.60 NM/h over a Schuler period
    (physics.md 6.3).
    """
    period_s = 2 * np.pi / SCHULER_RAD_S
    run = parked(600.0 + period_s + 2.0).run
    found = replay(run, choices(flat(x=ERROR_DEG_H)), TwinModel())
    drift = found.tables[0].parked
    u = ERROR_DEG_H * DEG_PER_HOUR
    for seconds, tolerance in ((HOUR, 0.02), (period_s, 0.02)):
        part = slice(0, int(np.searchsorted(drift.time_s, seconds)))
        cut = drift_of(
            time_s=drift.time_s[part],
            position_m=drift.position_m[part],
            velocity_m_s=drift.velocity_m_s[part],
        )
        x = SCHULER_RAD_S * cut.time_s[-1]
        assert cut.rate_nm_h == pytest.approx(R * u / KNOT * (1 - np.sin(x) / x), rel=tolerance)
    assert cut.rate_nm_h == pytest.approx(0.60, abs=0.01)
    # true less table: the residual error is negative
    assert drift.position_m[-1, 1] < 0 < abs(drift.position_m[-1, 0])
    assert drift.speed_m_s.max() == pytest.approx(2 * R * u, rel=0.03)  # 0.618 m/s at 42 min


def test_east_table_error_turns_the_heading_and_does_not_drift():
    """psi = -eps_E / (Omega cosL), 0.94 mrad for 0.01 deg/h at 45 deg; no velocity error at that
    heading (6.4).
    """
    truth = parked(4200.0)
    result = replay(truth.run, choices(flat(y=ERROR_DEG_H)), TwinModel(), reference=truth.reference)
    flown = result.tables[0]
    psi = ERROR_DEG_H * DEG_PER_HOUR / (EARTH_RATE_RAD_S * np.cos(SITE.lat_rad))
    assert psi == pytest.approx(0.940 * MILLIRADIAN, rel=1e-3)
    assert flown.heading_error_rad == pytest.approx(psi, rel=0.02)
    assert flown.parked.rate_nm_h < 0.01


@pytest.mark.parametrize("heading_deg", [0.0, 130.0])
def test_tables_own_difference_predicts_heading_and_end_point(heading_deg):
    """The linear prediction against two nonlinear flights, all three gyros, varying over
    temperature.
    """
    old = prior_table(0.01)
    nodes = old.temperature_degC[0]
    curve = np.concatenate(
        [0.01 + 2e-4 * (nodes - 20.0), -0.007 + 1e-4 * nodes, 0.004 - 2e-4 * nodes]
    )
    new = old.replaced(parameters=curve)
    run = simulated(lay([Park(duration_s=4200.0)]), 1, heading_deg=heading_deg, start="cold").run
    result = replay(run, choices(new, old), TwinModel())
    seen, expected = heading_change(result)
    assert seen == pytest.approx(expected, abs=0.02 * MILLIRADIAN)
    moved = plain(replay_document(result, TwinModel(), store=None, version=""))["difference"][
        "parked_end_displacement_m"
    ]
    size = np.hypot(moved["north"]["expected"], moved["east"]["expected"])
    assert size > 400.0
    for axis in ("north", "east"):
        assert moved[axis]["seen"] == pytest.approx(moved[axis]["expected"], abs=0.01 * size)


@pytest.mark.slow
def test_predicted_sigma_is_honest():
    """Squared radial error over variance: 1 over seeded units: 99.9 % band, 1.3 dof each."""
    ratios = []
    for seed in range(60):
        rng = np.random.default_rng([seed, 7])
        unit = aged_unit(
            rng,
            ageing_offset_deg_h=0.01 * np.sqrt(0.7),
            ageing_shape_deg_h=0.01 * np.sqrt(0.3),
            table=table_to_zero(),
        )
        run = simulate_run(
            ideal("parked_only"), thermal_history("cold"), unit, DEFAULT_TWIN, rng=rng
        ).run
        flown = replay(run, choices(prior_table(0.01)), DEFAULT_TWIN).tables[0]
        ratios.append((flown.parked.radial_m[-1] / flown.predicted.sigma_radial_m[-1]) ** 2)
    dof = 1.3 * len(ratios)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], dof) / dof
    assert low < np.mean(ratios) < high


def true_table(truth: SimulatedRun, like: ThermalTable, unit_bias) -> ThermalTable:
    return like.replaced(
        parameters=np.concatenate([unit_bias(a, t) for a, t in zip("xyz", like.temperature_degC)])
    )


def test_update_drifts_less_and_the_true_table_least():
    """R28 with truth: one session, then parked ones on other headings; RMS of their NM/h."""
    unit = aged_unit(
        np.random.default_rng(5),
        ageing_offset_deg_h=0.012,
        ageing_shape_deg_h=0.0036,
        table=table_to_zero(),
    )
    session = simulated(
        lay([Park(duration_s=3000.0), Pivot(angle_deg=90.0), Park(duration_s=1500.0)]),
        11,
        twin=QUIET,
        ageing=0.012,
    )
    old = prior_table(0.012)
    update = update_calibration([session.run], old, QUIET)
    assert update.outcome == "accepted"
    true = true_table(session, old, unit.bias_deg_h)
    rates: dict[str, list[float]] = {"old": [], "new": [], "true": []}
    for seed, heading_deg in ((12, 20.0), (13, 150.0), (14, 260.0)):
        later = simulated(
            lay([Park(duration_s=3600.0)]), seed, heading_deg=heading_deg, twin=QUIET, ageing=0.012
        ).run
        for name, table in (("old", old), ("new", update.after), ("true", true)):
            rates[name].append(replay(later, choices(table), QUIET).tables[0].parked.rate_nm_h)
    rms = {name: float(np.sqrt(np.mean(np.square(r)))) for name, r in rates.items()}
    assert rms["true"] < rms["new"] < 0.5 * rms["old"], rms
    assert rms["old"] > 0.2


def test_measures_of_a_straight_drift():
    hours = np.arange(1, 601) / 60.0
    for rate, name in ((2.1, "2T+2"), (3.0, "3T+3"), (4.0, "beyond 3T+3")):
        position = rate * NAUTICAL_MILE * hours[:, None] * [0.6, 0.8]
        velocity = np.full((600, 2), rate * KNOT) * [0.6, 0.8]
        drift = drift_of(time_s=hours * HOUR, position_m=position, velocity_m_s=velocity)
        assert drift.rate_nm_h == pytest.approx(rate) and drift.rms_rate_nm_h == pytest.approx(rate)
        assert drift.drift_class == name and drift.hours == pytest.approx(10.0)
        assert drift.speed_m_s[0] == pytest.approx(rate * KNOT)


def test_a_class_is_lost_by_one_excursion():
    hours = np.arange(1, 61) / 60.0
    position = np.zeros((60, 2))
    position[30, 0] = (2 * hours[30] + 2.01) * NAUTICAL_MILE
    assert (
        drift_of(time_s=hours * HOUR, position_m=position, velocity_m_s=0 * position).drift_class
        == "3T+3"
    )


def test_realign_above_five_knots():
    def at(speed: float) -> bool:
        history = SimpleNamespace(time_s=np.arange(3.0), v_n_m_s=np.tile([0.0, speed, 0.0], (3, 1)))
        return stop_speed(history, StopInterval(0.0, 2.0, Witness.ROWS)).realign

    assert REALIGN_M_S == pytest.approx(2.572, abs=1e-3)
    assert at(5.01 * KNOT) and not at(4.99 * KNOT)


@pytest.mark.slow
def test_stops_and_outside_tracks_agree_with_truth():
    """Taxi and two stops: found where they are, their speed is the velocity error; GNSS and
    reference see one error, whatever the antenna's lever arm and however roughly the site was
    entered.
    """
    motion = lay(
        [
            Park(duration_s=1200.0),
            Straight(duration_s=60.0),
            Stop(duration_s=60.0),
            Turn(angle_deg=90.0),
            Straight(duration_s=40.0),
            Stop(duration_s=90.0),
        ]
    )
    twin = replace(
        NO_NOISE, gnss=replace(NO_NOISE.gnss, sigma_horizontal_m=1e-3, sigma_velocity_m_s=1e-4)
    )
    made = simulated(
        motion, 3, heading_deg=70.0, twin=twin, with_gnss=True, gnss_lever_arm_m=(3.0, -1.0, -2.0)
    )
    shifted = replace(SITE, lat_rad=SITE.lat_rad + 2e-5)  # 130 m
    run = replace(made.run, header=replace(made.run.header, site=shifted))
    flown = replay(
        run, choices(flat(x=0.05, y=0.03)), TwinModel(), reference=made.reference
    ).tables[0]
    assert [round(s.end_s - s.start_s, -1) for s in flown.stops] == [60.0, 90.0]
    for stop in flown.stops:
        standing = (made.reference.time_s >= stop.start_s) & (made.reference.time_s <= stop.end_s)
        # the last of the braking is within a window
        assert np.abs(made.reference.v_n_m_s[standing, :2]).max() < 0.3
        row = np.searchsorted(
            flown.reference.time_s + flown.history.time_s[0], 0.5 * (stop.start_s + stop.end_s)
        )
        assert stop.ground_speed_m_s == pytest.approx(flown.reference.speed_m_s[row], abs=0.02)
    assert flown.reference.radial_m[-1] > 50.0
    # rate and arm: means over an epoch
    for kind, tolerance in (("position_m", 0.3), ("velocity_m_s", 0.1)):
        np.testing.assert_allclose(
            getattr(flown.gnss, kind), getattr(flown.reference, kind), atol=tolerance
        )


@pytest.mark.parametrize("outside", ["gnss", "positions", "odometer", "imu"])
def test_a_steady_roll_is_no_stop_whoever_looks(outside):
    """5 m/s over the taxiway for three minutes: rest to the inertial rows, and a computed 9.7 kt
    that drift cannot reach without an acceleration; then a stop.
    """
    flown = replay(steady_roll(outside), choices(flat()), QUIET, aided=False)
    active = flown.tables[0]
    table = plain(replay_document(flown, QUIET, store=None, version="1"))["tables"][0]
    page = render(replay_document(flown, QUIET, store=None, version="1"))
    assert {s.seen_by for s in active.stops} == {"gnss" if outside == "positions" else outside}
    assert [round(s.end_s - s.start_s, -1) for s in active.stops] == [60.0]
    assert active.stops[0].ground_speed_m_s < 0.3
    assert not table["realign"]
    assert "realign: above" not in page


def steady_roll(outside: str) -> Run:
    """Park 12 min, roll at 5 m/s, stop for a minute; with positions and velocities, positions only,
    wheels or nothing.
    """
    motion = lay(
        [Park(duration_s=720.0), Straight(duration_s=180.0, speed_m_s=5.0), Stop(duration_s=60.0)]
    )
    twin = replace(QUIET, gnss=DEFAULT_TWIN.gnss)
    streams = {
        "with_gnss": outside in ("gnss", "positions"),
        "with_odometer": outside == "odometer",
    }
    run = simulated(motion, 4, heading_deg=70.0, twin=twin, with_phases=False, **streams).run
    if outside != "positions":
        return run
    return replace(run, gnss=replace(run.gnss, v_n_m_s=np.full_like(run.gnss.v_n_m_s, np.nan)))


# ---- what is refused, and what is flown all the same


def test_level_gyros_too_coarse_are_refused():
    run = parked(1200.0).run
    mems = replace(run, header=replace(run.header, gyro_technology="mems"))
    table = default_table(
        imu_serial="SN-0042", gyro_technology="mems", created_utc="2026-01-01T00:00:00Z"
    )
    result = replay(mems, choices(table), TwinModel(gyro_technology="mems"))
    assert result.verdict == "refused" and "no_heading" in codes(result.reasons)[0]
    assert result.tables[0].history is None


def test_latitude_beyond_gyrocompassing_is_refused():
    run = parked(1200.0).run
    polar = replace(run, header=replace(run.header, site=replace(SITE, lat_rad=79 * DEG)))
    result = replay(polar, choices(flat()), TwinModel())
    assert result.verdict == "refused" and "78.25" in sentences(result.reasons)[0]


def never_rests(run: Run) -> Run:
    """Rocked by 3 m/s^2 with a period of 37 s."""
    dv = np.array(run.imu.dv_m_s)
    dv[:, 0] += 3.0 * np.sin(2 * np.pi * run.imu.time_s / 37.0) * run.imu.dt_s
    return replace(run, imu=replace(run.imu, dv_m_s=dv))


def test_wrong_latitude_is_inconsistent_but_flown():
    run = parked(1800.0).run
    wrong = replace(run, header=replace(run.header, site=replace(SITE, lat_rad=46 * DEG)))
    result = replay(wrong, choices(flat()), TwinModel())
    assert result.verdict == "inconsistent" and "wrong_latitude" in codes(result.reasons)[-1]
    assert result.tables[0].parked is not None


# ---- the page
