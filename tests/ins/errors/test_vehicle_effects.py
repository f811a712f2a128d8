"""Effects of accelerometers, vehicle, wheels, GNSS and data: values worked by hand, signs, needs,
and rows against seconds.
"""

from dataclasses import fields, replace

import numpy as np
import pytest

from ins.attitude import dcm_from_euler, dcm_from_rotation_vector, rotation_vector_from_dcm, skew
from ins.earth import gravity_n, omega_ie_n
from ins.errors.accelerometer import ACCELEROMETER
from ins.errors.base import Effect
from ins.errors.catalogue import OWN, catalogue, prior, rivals_of
from ins.errors.data import DATA_EFFECTS
from ins.errors.flight import FLIGHT_EFFECTS
from ins.errors.gyro import events as gyro_events
from ins.errors.gyro import noise as gyro_noise
from ins.errors.gyro import rate as gyro_rate
from ins.errors.gyro import thermal as gyro_thermal
from ins.errors.navigation import NAVIGATION_EFFECTS
from ins.errors.parts.formula import PartEffect
from ins.errors.platform import PLATFORM
from ins.errors.telemetry import AIRBORNE, PARKED, ROLLING, Telemetry, Trace, total
from ins.errors.wheels import WHEELS
from ins.records import InputError
from ins.units import ARCSEC, DEG_PER_HOUR, MICRO_G
from tests.ins.errors.vehicle_fixture import LATITUDE_rad, drive, rich_drive, still

LISTED = ACCELEROMETER + PLATFORM + WHEELS + NAVIGATION_EFFECTS + DATA_EFFECTS
ALL = [effect for effect in LISTED if effect.diagnosed]
PARTS = [effect for effect in catalogue() if isinstance(effect, PartEffect)]
BY_ID = {effect.id: effect for effect in ALL}
SHOWN = [effect for effect in ALL if not effect.out_of_reach]
CASES = [pytest.param(e, t, id=f"{e.id}-{t}") for e in SHOWN for t in e.targets]
g = float(gravity_n(LATITUDE_rad, 0.0)[2])
ARCMIN = 60.0 * ARCSEC
SMEARED = 0.15  # derivatives over two seconds, where rates begin to change with a kink
TINY = 1e-9  # m/s^2 and the like: Earth rate on a lever arm of a centimetre
EXACT = dict(rtol=1e-9, atol=1e-18)


def middle(effect: Effect, run: Telemetry) -> dict[str, float]:
    """A shape in the middle of its bounds, inside the run."""
    shape = {}
    for p in effect.shape:
        grid = p.grid(p.low, min(p.high, run.time_s[-1])) if p.of_time else p.grid()
        shape[p.name] = float(grid[len(grid) // 2])
    return shape


def traces(key: str, run: Telemetry, target: str = "", **shape: float) -> tuple[Trace, ...]:
    effect = BY_ID[key]
    return effect.traces(run, target or effect.targets[0], shape or middle(effect, run))


def arrays(trace: Trace) -> dict[str, np.ndarray]:
    values = {f.name: getattr(trace, f.name) for f in fields(trace)}
    return {name: v for name, v in values.items() if v is not None}


def test_only_a_gross_axis_error_has_a_prior_against_it():
    """A sign error of a gyro is 1000 sigmas and more; a scale factor of 10 ppm must not be called
    one. Kinds of one name share its prior, up to nine of them (e^-2.2).
    """
    assert {e.id for e in SHOWN if e.log_prior < -3.0} == {"axis_or_unit_error"}
    assert BY_ID["axis_or_unit_error"].log_prior < -5.0


def test_declarations_are_whole():
    gyro = (
        *gyro_events.GYRO_EVENTS,
        *gyro_noise.GYRO_NOISE,
        *gyro_rate.GYRO_RATE,
        *gyro_thermal.GYRO_THERMAL,
        *FLIGHT_EFFECTS,
    )
    names = {name for effect in (*ALL, *gyro) for name in (effect.name, effect.id)}
    assert len(BY_ID) == len(ALL)
    for effect in ALL:
        assert isinstance(effect, Effect) and effect.coefficients and effect.repeats in "REPS"
        assert set(effect.rivals) <= names - {effect.name}, effect.id
        assert np.prod([p.steps for p in effect.shape], initial=1) <= 24
        assert all(0 < c.low < c.high and c.unit for c in effect.coefficients)


def test_effects_of_one_name_differ_in_their_parameters():
    """A twin names coefficients, and they say which one is meant; of those that repeat from run to
    run in another way the twin's run_id does.
    """
    keys = [
        (e.name, t, frozenset(c.name for c in e.coefficients), e.repeats)
        for e in catalogue()
        for t in e.targets
    ]
    assert len({k for k in keys if k[0] != "slow_variation"}) == sum(
        k[0] != "slow_variation" for k in keys
    )


@pytest.mark.parametrize("part", PARTS, ids=lambda e: e.id)
def test_a_part_is_its_coefficient_of_the_whole(part):
    (whole,) = (e for e in catalogue() if e.id == part.whole)
    run = rich_drive()
    run = replace(run, table_deg_h=1e-4 * run.temperature_degC**2)
    shape, target = middle(part, run), part.targets[0]
    (found,), every = part.traces(run, target, shape), whole.traces(run, target, shape)
    (place,) = part.kept
    assert part.coefficients == (whole.coefficients[place],) and part.name == whole.name
    for name, value in arrays(found).items():
        np.testing.assert_array_equal(value, arrays(every[place])[name])
    assert part.needs([still()], target) == whole.needs([still()], target)


def test_what_estimators_assume_is_asked_by_recipe_part_and_technology():
    """One number of an error in all recipes that share its physics; what nobody carries is
    refused.
    """
    arm = {
        recipe: prior("gnss_lever_arm_or_latency", recipe, "arm").size
        for recipe in ("taxi", "flight", "replay")
    }
    assert arm == dict.fromkeys(("taxi", "flight", "replay"), 2.0)
    scale = prior("gyro_scale_factor", "flight")
    assert scale.each() == {"rlg": 5.0, "fog": 50.0, "mems": 5000.0}
    assert prior("gust_crab", "taxi").process == "Gauss-Markov, 10 s"
    with pytest.raises(TypeError, match="each technology"):
        _ = scale.size
    with pytest.raises(LookupError, match="gyro_bias_step: no prior of taxi"):
        prior("gyro_bias_step", "taxi")


def test_only_what_a_run_can_show_is_a_hypothesis():
    known = {source.id for source in OWN if not source.diagnosed}
    assert {"table_aged", "cross_wind_crab", "gyro_in_flight"} <= known
    assert not known & {effect.id for effect in catalogue()}


def test_rivals_are_declared_once_and_mutual():
    """In the whole catalogue; slow processes go by their ids."""
    rivals, declared = {}, {}
    for e in catalogue():
        called = e.id if e.name == "slow_variation" else e.name
        rivals.setdefault(called, set()).update(rivals_of(e))
        declared.setdefault(called, set()).update(e.rivals)
    one_sided = [(a, b) for a in rivals for b in rivals[a] if a not in rivals[b]]
    assert not one_sided and not any(name in rivals[name] for name in rivals)
    assert not [(a, b) for a in declared for b in declared[a] if a in declared[b]]
    assert (
        "gyro_common_mode" in rivals["clock_rate"]
        and "gyro_g2_sensitivity" in rivals["engine_start"]
    )


@pytest.mark.parametrize("effect,target", CASES)
def test_each_effect_adds_either_finite_traces_or_noise(effect, target):
    run = rich_drive()
    shape = middle(effect, run)
    found, noise = effect.traces(run, target, shape), effect.noise(run, target, shape)
    assert bool(found) != bool(noise)
    assert len(found) in (0, len(effect.coefficients)) and (
        not noise or len(effect.coefficients) == 1
    )
    for trace in found:
        values = arrays(trace)
        assert values and all(len(v) == run.n and np.isfinite(v).all() for v in values.values())
        assert any(np.any(v != 0.0) for v in values.values())
    assert all(n.profile is None or n.profile.shape == (run.n,) for n in noise)
    aloft = replace(run, force_m_s2=9.0 * run.force_m_s2, kind=np.full(run.n, AIRBORNE))
    assert effect.needs([run, aloft], target) == ""


@pytest.mark.parametrize("effect,target", CASES)
def test_rows_of_a_log_add_up_to_the_seconds_of_a_diagnosis(effect, target):
    rows, seconds = rich_drive(0.1), rich_drive(1.0)
    shape = middle(effect, seconds)
    for fine, coarse in zip(
        effect.traces(rows, target, shape), effect.traces(seconds, target, shape)
    ):
        for name, value in arrays(coarse).items():
            # ten-second means
            from_rows = arrays(fine)[name].reshape(87, 100, *value.shape[1:]).mean(axis=1)
            of_seconds = value.reshape(87, 10, *value.shape[1:]).mean(axis=1)
            assert (
                np.linalg.norm(from_rows - of_seconds)
                <= SMEARED * np.linalg.norm(of_seconds) + TINY
            ), name


@pytest.mark.parametrize("effect", [e for e in ALL if e.out_of_reach], ids=lambda e: e.id)
def test_what_no_log_shows_says_so_and_cannot_be_injected(effect):
    run = rich_drive()
    assert effect.needs([run], effect.targets[0]) != ""
    with pytest.raises(InputError, match=effect.name):
        effect.traces(run, effect.targets[0], {})


# ---- accelerometers


def test_accel_thermal_is_counted_from_25_degC():
    run = still(n=3, accel_degC=np.array([[25.0] * 3, [35.0] * 3, [15.0] * 3]))
    linear, quadratic = traces("accel_thermal", run, "accel_y")
    np.testing.assert_allclose(linear.accel_m_s2[:, 1], [0, 10 * MICRO_G, -10 * MICRO_G], **EXACT)
    np.testing.assert_allclose(
        quadratic.accel_m_s2[:, 1], [0, 100 * MICRO_G, 100 * MICRO_G], **EXACT
    )
    assert not linear.accel_m_s2[:, [0, 2]].any()


def test_accel_warmup_falls_to_1_over_e_after_tau():
    (trace,) = traces("accel_warmup_transient", still(), "accel_x", tau_s=300.5)
    assert trace.accel_m_s2[300, 0] == pytest.approx(MICRO_G / np.e, rel=1e-12)


def test_accel_hysteresis_splits_heating_from_cooling_by_twice_its_size():
    T = np.concatenate([np.linspace(20, 40, 300), np.linspace(40, 20, 300)])
    (trace,) = traces(
        "accel_thermal_hysteresis",
        still(accel_degC=np.repeat(T[:, None], 3, axis=1)),
        "accel_z",
        width_degC=4.0,
    )
    heating, cooling = trace.accel_m_s2[150, 2], trace.accel_m_s2[450, 2]
    assert trace.accel_m_s2[0, 2] == 0.0
    assert (heating, cooling) == (pytest.approx(MICRO_G), pytest.approx(-MICRO_G))


def test_accel_scale_factor_and_square_of_1_g():
    (scale,), (square,) = (
        traces("accel_scale_factor", still(), "accel_z"),
        traces("accel_g2_sensitivity", still(), "accel_z"),
    )
    np.testing.assert_allclose(scale.accel_m_s2[:, 2], -1e-6 * g)
    np.testing.assert_allclose(square.accel_m_s2[:, 2], MICRO_G * (g / 9.80665) ** 2)


def test_accel_misalignment_shows_the_other_two_axes_in_order():
    run = replace(still(n=2), force_m_s2=np.tile([1.0, 2.0, 3.0], (2, 1)))
    seen = {
        axis: [t.accel_m_s2[0, k] for t in traces(f"accel_misalignment_{axis}", run)]
        for k, axis in enumerate("xyz")
    }
    assert seen == {"x": [2e-3, 3e-3], "y": [1e-3, 3e-3], "z": [1e-3, 2e-3]}
    assert [c.name for c in BY_ID["accel_misalignment_y"].coefficients] == ["to_x", "to_z"]


def test_size_effect_is_50_ug_at_5_cm_and_a_tenth_of_a_radian_per_second():
    t = np.arange(10) + 0.5
    run = replace(still(n=10), rate_rad_s=np.stack([0 * t, 0 * t, 0.1 + 0 * t], axis=1))
    x, y, z = traces("imu_size_effect", run, "accel_x")
    # towards the axis of turning
    np.testing.assert_allclose(5 * x.accel_m_s2[:, 0] / MICRO_G, -51.0, atol=0.1)
    assert not y.accel_m_s2.any() and not z.accel_m_s2.any()
    spun_up = replace(run, rate_rad_s=np.stack([0 * t, 0 * t, 0.2 * t], axis=1))
    # w' x r
    np.testing.assert_allclose(
        traces("imu_size_effect", spun_up, "accel_y")[0].accel_m_s2[:, 1], 0.2 * 0.01
    )


def test_noise_of_the_accelerometers_is_in_the_units_of_the_twin():
    kinds = {
        key: BY_ID[key].noise(still(), "accel_y", {})[0]
        for key in ("accel_noise", "accel_bias_instability", "accel_rate_random_walk")
    }
    assert all(noise.channel == "accel_y" for noise in kinds.values())
    assert (kinds["accel_noise"].white, kinds["accel_bias_instability"].flicker) == (
        MICRO_G**2,
        MICRO_G**2,
    )
    # 1 ug after an hour
    assert kinds["accel_rate_random_walk"].walk * 3600 == pytest.approx(MICRO_G**2)


# ---- rotations of the vehicle


def test_a_rotation_is_that_of_the_nonlinear_attitude():
    """Gyro and accelerometer of a body that turns by exp(q), worked with rotation matrices on every
    second of the drive.
    """
    run, size = drive(), 50.0
    trace = traces("platform_settling", run, tau_s=400.0)[0].scaled(size)
    for k in (10, 100, 650, 725):
        ends = run.time_s[k] + np.array([-0.5, 0.0, 0.5])
        turned = [
            dcm_from_rotation_vector([size * ARCSEC * -np.expm1(-t / 400.0), 0, 0]) for t in ends
        ]
        force = turned[1].T @ run.force_m_s2[k] - run.force_m_s2[k]
        step = dcm_from_rotation_vector(run.rate_rad_s[k])
        rate = rotation_vector_from_dcm(turned[0].T @ step @ turned[2]) - run.rate_rad_s[k]
        np.testing.assert_allclose(trace.accel_m_s2[k], force, atol=1e-6 * g)
        np.testing.assert_allclose(
            trace.gyro_rad_s[k], rate, rtol=1e-3, atol=0.08 * (size * ARCSEC) ** 2
        )


def test_settling_of_100_arcsec_reads_as_rate_and_4_85_ug_per_arcsec():
    run = still(n=7200)
    roll, pitch = (t.scaled(100.0) for t in traces("platform_settling", run, tau_s=600.0))
    assert pitch.gyro_rad_s[:, 1].sum() / ARCSEC == pytest.approx(
        100.0 * -np.expm1(-12.0), rel=1e-6
    )
    ug = 100 * 4.8481 * g / 9.80665
    # nose up: forward accelerometer reads +
    assert pitch.accel_m_s2[-1, 0] / MICRO_G == pytest.approx(ug, rel=1e-4)
    assert roll.accel_m_s2[-1, 1] / MICRO_G == pytest.approx(-ug, rel=1e-4)  # right side down


@pytest.mark.parametrize("dt_s", [0.01, 1.0, 10.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_step_is_an_impulse_of_the_gyro_of_its_own_size(dt_s, axis):
    run = still(n=int(600 / dt_s), dt_s=dt_s)
    trace = traces("platform_step", run, onset_s=301.3)[axis]
    assert trace.gyro_rad_s[:, axis].sum() * dt_s == pytest.approx(ARCSEC, rel=1e-3)
    before, later = run.time_s < 300.8 - dt_s, run.time_s > 301.8 + dt_s
    assert not trace.gyro_rad_s[before].any() and not trace.accel_m_s2[before].any()
    assert np.abs(trace.gyro_rad_s[later, axis]).max() < 1e-9 * ARCSEC
    assert np.abs(trace.accel_m_s2[later]).max() == pytest.approx(0.0 if axis == 2 else g * ARCSEC)


def test_yaw_creep_is_on_gz_while_parked_only():
    run = drive()
    (trace,) = traces("platform_yaw_drift", run)
    np.testing.assert_allclose(trace.gyro_rad_s[run.parked, 2], DEG_PER_HOUR / 3600, rtol=1e-6)
    assert np.abs(trace.gyro_rad_s[run.rolling, 2]).max() < 1e-12
    assert np.abs(trace.accel_m_s2[:600]).max() < 1e-12
    # it rolls along its own axis: its way turns by the heading of 600 parked seconds
    north, east, _ = run.v_n_m_s[680]
    turned = 600.0 / 3600.0 * ARCSEC * np.array([-east, north, 0.0])
    np.testing.assert_allclose(trace.gnss_velocity_m_s[680], turned, rtol=1e-3)
    moved = np.gradient(trace.gnss_position_m, run.time_s, axis=0)
    np.testing.assert_allclose(moved[680], turned, rtol=1e-3)


@pytest.mark.parametrize("dt_s", [0.1, 1.0])
@pytest.mark.parametrize("tau_s", [300.0, 2000.0])
def test_yaw_creep_relaxes_while_parked_only(dt_s, tau_s):
    """Heading A (1 - exp(-t/tau)) after the first parked stretch of 600 s, then kept, then on with
    the clock.
    """
    run = drive(dt_s)
    (trace,) = traces("platform_yaw_creep", run, tau_s=tau_s)
    creep = np.cumsum(np.where(run.parked, trace.gyro_rad_s[:, 2], 0.0)) * dt_s / ARCSEC
    at = [round(t / dt_s) - 1 for t in (150.0, 600.0, 770.0, 870.0)]
    own = [1 - np.exp(-150.0 / tau_s), 1 - np.exp(-600.0 / tau_s)]
    after = np.exp(-770.0 / tau_s) - np.exp(-870.0 / tau_s)
    np.testing.assert_allclose(creep[at], [*own, own[1], own[1] + after], rtol=2e-3 * dt_s)
    assert np.abs(trace.gyro_rad_s[run.rolling, 2]).max() < 1e-12


def test_yaw_creep_counts_from_the_start_of_the_parked_stretch():
    run = still(n=1200)
    arrived = replace(run, kind=np.where(run.time_s < 400.0, ROLLING, PARKED))
    late, whole = (
        traces("platform_yaw_creep", r, tau_s=500.0)[0].gyro_rad_s[:, 2] for r in (arrived, run)
    )
    np.testing.assert_allclose(late[400:], whole[:-400], rtol=1e-9)
    assert not late[:399].any()


def test_mount_sag_follows_the_temperature_of_the_block():
    run = still(block_degC=25.0 + np.arange(600) / 60.0)
    roll, pitch = traces("platform_mount_sag", run)
    np.testing.assert_allclose(roll.gyro_rad_s[:, 0], ARCSEC / 60, rtol=1e-6)
    assert pitch.accel_m_s2[-1, 0] == pytest.approx(g * ARCSEC * 599 / 60)
    gyros = still(temperature_degC=np.repeat(25.0 + np.arange(600)[:, None] / 60.0, 3, axis=1))
    np.testing.assert_allclose(traces("platform_mount_sag", gyros)[1].accel_m_s2, pitch.accel_m_s2)


def test_engine_start_shifts_and_shakes_from_its_onset_on():
    run = still()
    y = traces("engine_start", run, onset_s=200.25)[1].accel_m_s2
    np.testing.assert_allclose(y[[199, 200, 201], 1], [0.0, 0.75 * MICRO_G, MICRO_G], **EXACT)
    assert not y[:, [0, 2]].any()
    noises = BY_ID["engine_start_noise"].noise(run, "vehicle", {"onset_s": 200.25})
    assert [n.channel for n in noises] == ["accel_x", "accel_y", "accel_z"]
    assert noises[0].white == MICRO_G**2 and noises[0].profile.sum() == pytest.approx(399.75)


def test_a_machine_that_never_stops_shakes_from_the_first_second_to_the_last():
    noises = BY_ID["platform_vibration"].noise(still(), "vehicle", {})
    assert [n.channel for n in noises] == ["accel_x", "accel_y", "accel_z"]
    assert all(n.white == MICRO_G**2 and n.profile is None for n in noises)


def test_sway_is_the_twins_own_and_rocking_is_seen_by_both_sensors():
    swaying = BY_ID["platform_sway"].noise(still(heading_deg=50.0), "vehicle", {})
    assert [n.channel for n in swaying] == ["accel_x", "accel_y", "accel_z"]
    np.testing.assert_allclose([n.sway for n in swaying], [1.0, 1.0, 0.0], atol=1e-12)
    pitched = replace(still(), C_nb=np.tile(dcm_from_euler(0.0, 0.02, 0.3), (600, 1, 1)))
    felt = [n.sway for n in BY_ID["platform_sway"].noise(pitched, "vehicle", {})]
    np.testing.assert_allclose(felt, [1 - 4e-4, 1.0, 4e-4], rtol=1e-3)
    rocking = {n.channel: n for n in BY_ID["platform_sway_rotation"].noise(still(), "vehicle", {})}
    assert rocking["gyro_y"].bounded == ARCSEC**2
    assert np.sqrt(rocking["accel_x"].white) == pytest.approx(g * ARCSEC)  # a second's mean


# ---- site


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 200.0])
def test_latitude_error_is_the_true_place_less_the_entered_one(heading_deg):
    run, true = still(heading_deg), LATITUDE_rad - ARCMIN
    (trace,) = traces("site_latitude_error", run)
    C_bn = dcm_from_euler(0.0, 0.0, np.deg2rad(heading_deg)).T
    rate, force = (f(true) - f(LATITUDE_rad) for f in (omega_ie_n, lambda L: -gravity_n(L, 0.0)))
    np.testing.assert_allclose(trace.gyro_rad_s[0], C_bn @ rate, rtol=3e-4, atol=1e-14)
    np.testing.assert_allclose(trace.accel_m_s2[0], C_bn @ force, rtol=1e-3, atol=1e-15)
    assert np.hypot(*trace.gyro_rad_s[0, :2]) / DEG_PER_HOUR == pytest.approx(0.003, rel=0.05)
    # a sea mile, reads south
    np.testing.assert_allclose(trace.gnss_position_m[0], [-1852.2, 0, 0], atol=0.1)


def test_deflection_pulls_the_proof_masses_the_other_way():
    north, east, anomaly = traces("vertical_deflection", still(heading_deg=90.0))
    # body y is south
    np.testing.assert_allclose(north.accel_m_s2[0], [0, g * ARCSEC, 0], atol=1e-15)
    np.testing.assert_allclose(east.accel_m_s2[0], [-g * ARCSEC, 0, 0], atol=1e-15)
    np.testing.assert_allclose(anomaly.accel_m_s2[0], [0, 0, -1e-5], atol=1e-15)


# ---- wheels


def test_odometer_scale_slip_and_delay():
    run = drive()
    np.testing.assert_allclose(traces("odometer_scale", run)[0].odometer_m_s, 1e-6 * run.speed_m_s)
    slip, late = (
        traces("wheel_slip", run)[0].odometer_m_s,
        traces("odometer_time_offset", run)[0].odometer_m_s,
    )
    assert slip[605] == pytest.approx(0.01 * 5.5)  # one per cent for each m/s^2
    assert slip[765] == pytest.approx(-0.01 * 2.25 * 0.5)  # braked: reads low
    assert (late[605], late[765]) == (pytest.approx(-1e-3), pytest.approx(0.5e-3))


def test_no_odometer_error_in_the_air():
    run = replace(drive(), kind=np.full(870, AIRBORNE))
    for key in (
        "odometer_scale",
        "odometer_boresight",
        "lever_arm",
        "side_slip",
        "wheel_slip",
        "odometer_time_offset",
    ):
        assert not any(v.any() for t in traces(key, run) for v in arrays(t).values()), key


def test_lever_arm_is_rigid_body_motion_about_the_point_that_does_not_slip():
    run, d = drive(), np.array([-2.0, 0.7, 0.0])  # true less logged
    x, y = traces("lever_arm", run)
    found = total([x.scaled(d[0]), y.scaled(d[1])])
    for k in (655, 725):
        w = np.array([0, 0, run.turn_rad_s[k]])
        # velocity of the logged point beside that of the true one, which has none to the side
        at_logged = -skew(w) @ d
        assert found.lateral_m_s[k] == pytest.approx(at_logged[1])
        # read at the true point, less at the logged one
        assert found.odometer_m_s[k] == pytest.approx(-at_logged[0])
    # right turn, logged ahead of the axle that does not slip: it moves to the right
    assert found.lateral_m_s[655] > 0


def test_boresight_and_side_slip_by_hand():
    run = drive()
    # 1 mrad at 10 m/s, to the right
    assert traces("odometer_boresight", run)[0].lateral_m_s[680] == pytest.approx(0.01)
    slip = traces("side_slip", run)[0].lateral_m_s
    # 1 mrad for 1 m/s^2, here 10 m/s x 0.05 rad/s
    assert slip[655] == pytest.approx(1e-3 * 10.0 * 0.5)
    assert slip[725] == pytest.approx(-1e-3 * 5.0 * 0.4)


def test_turns_at_two_speeds_tell_side_slip_from_a_lever_arm():
    def alike(run):
        lever, slip = (
            traces("lever_arm", run)[0].lateral_m_s,
            traces("side_slip", run)[0].lateral_m_s,
        )
        return abs(lever @ slip) / np.linalg.norm(lever) / np.linalg.norm(slip)

    run = drive()
    assert alike(replace(run, speed_m_s=np.where(run.rolling, 8.0, 0.0))) == pytest.approx(1.0)
    assert alike(run) < 0.95


def test_quantization_of_the_odometer_is_uniform_and_only_while_rolling():
    (noise,) = BY_ID["odometer_quantization"].noise(drive(), "odometer", {})
    steps = np.random.default_rng(1).uniform(0.0, 5.0, 100_000)
    error = np.round(steps / 0.01) * 0.01 - steps
    assert noise.channel == "odometer" and noise.sample == pytest.approx(error.var(), rel=0.02)
    np.testing.assert_array_equal(noise.profile == 1.0, drive().rolling)


def test_false_standstill_creeps_at_stops_after_a_drive():
    run = drive()
    (trace,) = traces("false_standstill", run)
    assert not trace.gnss_velocity_m_s[:770].any() and not trace.gnss_position_m[:770].any()
    np.testing.assert_allclose(trace.gnss_velocity_m_s[770:], 0.01 * run.C_nb[770:, :, 0])
    assert np.linalg.norm(trace.gnss_position_m[-1]) == pytest.approx(0.995)


# ---- GNSS


@pytest.mark.parametrize("axis", [0, 1])
def test_gnss_velocity_is_the_rate_of_its_position(axis):
    run = drive(0.05)
    arm = traces("gnss_lever_arm_or_latency", run)[axis]
    moved = np.gradient(arm.gnss_position_m, run.time_s, axis=0)
    np.testing.assert_allclose(arm.gnss_velocity_m_s, moved, atol=2e-4)
    assert np.abs(moved).max() == pytest.approx(0.08, rel=0.01)


def test_gnss_latency_shows_where_the_vehicle_was():
    run = drive()
    late = traces("gnss_lever_arm_or_latency", run)[2]
    k = 680  # 10 m/s, straight
    np.testing.assert_allclose(late.gnss_position_m[k], -0.001 * run.v_n_m_s[k])
    np.testing.assert_allclose(np.linalg.norm(late.gnss_velocity_m_s[605]), 1e-3)


# ---- data


def test_jitter_is_a_bounded_velocity_of_gravity_times_the_jitter():
    noises = {n.channel: n for n in BY_ID["timestamp_jitter"].noise(still(), "vehicle", {})}
    rng, dt, sigma = np.random.default_rng(2), 0.01, 1e-4
    stamps = dt * np.arange(50_001) + sigma * rng.standard_normal(50_001)
    read = g * dt / np.diff(stamps)  # increments are right, the times are not
    velocity = np.cumsum((read - g) * dt)
    # over a second: twice the variance of the bounded part
    change = velocity[100:] - velocity[:-100]
    spurious = (g * dt) * 2 * (sigma / dt) ** 2  # mean of 1 / (1 + x) is not 1
    expected = 2 * noises["accel_z"].bounded * (sigma / 1e-3) ** 2
    assert np.var(change - 100 * spurious) == pytest.approx(expected, rel=0.1)
    assert "accel_x" not in noises and noises["gyro_z"].bounded < 1e-14


def test_clock_rate_reads_high_on_everything():
    run = drive()
    (trace,) = traces("clock_rate", run)
    np.testing.assert_allclose(trace.gyro_rad_s, 1e-6 * run.rate_rad_s)
    np.testing.assert_allclose(trace.accel_m_s2, 1e-6 * run.force_m_s2)


def test_skew_shows_the_force_of_a_moment_ago():
    run = still(n=6000, dt_s=0.1)
    wave = np.stack([np.sin(0.5 * run.time_s), np.cos(0.3 * run.time_s), 0 * run.time_s], axis=1)
    (trace,) = traces("gyro_accel_skew", replace(run, force_m_s2=wave))
    earlier = run.time_s - 1e-3
    delayed = np.stack([np.sin(0.5 * earlier), np.cos(0.3 * earlier), 0 * earlier], axis=1)
    np.testing.assert_allclose(trace.accel_m_s2[1:-1], (delayed - wave)[1:-1], atol=1e-6)


def test_a_sign_error_is_minus_two_of_the_own_axis():
    run = drive()
    for target, truth in (("gyro_z", run.rate_rad_s), ("accel_y", run.force_m_s2)):
        k = "xyz".index(target[-1])
        own = traces("axis_or_unit_error", run, target)[k].scaled(-2.0)
        wrong = truth + (own.gyro_rad_s if target == "gyro_z" else own.accel_m_s2)
        np.testing.assert_allclose(wrong[:, k], -truth[:, k])
        np.testing.assert_array_equal(np.delete(wrong, k, 1), np.delete(truth, k, 1))


# ---- what recordings lack


ACCELERATIONS, ODOMETER = "braking and acceleration", "an odometer and "
PARKED_NEEDS = {
    "accel_thermal": "an accelerometer temperature",
    "accel_thermal_hysteresis": "an accelerometer temperature",
    "accel_scale_factor": ACCELERATIONS + ", or flight",
    "accel_g2_sensitivity": "flight",
    "accel_misalignment_x": "accelerations of the vehicle",
    "accel_misalignment_y": "accelerations of the vehicle",
    "accel_misalignment_z": "flight",
    "imu_size_effect": "turns",
    "platform_mount_sag": "a gyro or block temperature",
    "odometer_scale": ODOMETER + "taxi",
    "odometer_boresight": "taxi",
    "lever_arm": "turns",
    "side_slip": "turns",
    "wheel_slip": ODOMETER + ACCELERATIONS,
    "odometer_time_offset": ODOMETER + ACCELERATIONS,
    "odometer_quantization": ODOMETER + "taxi",
    "false_standstill": "GNSS and a stop after taxi",
    "gnss_lever_arm_or_latency": "GNSS and turns",
    "clock_rate": "turns",
    "gyro_accel_skew": ACCELERATIONS + ", or flight",
}


@pytest.mark.parametrize("effect", SHOWN, ids=lambda e: e.id)
def test_what_a_parked_run_lacks(effect):
    whole = effect.whole if isinstance(effect, PartEffect) else effect.id
    assert effect.needs([still()], effect.targets[0]) == PARKED_NEEDS.get(whole, "")


def test_stamps_are_off_by_less_than_the_interval_of_their_rows():
    jitter = next(e for e in catalogue() if e.name == "timestamp_jitter")
    assert jitter.most(0.01) == pytest.approx(10.0)  # ms
    others = [e for e in catalogue() if e.name != "timestamp_jitter"]
    assert all(e.most(0.01) == np.inf for e in others)
