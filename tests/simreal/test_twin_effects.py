"""The `effects` of a twin file: read, refused with the key that is wrong, and what they add to a
run.
"""

from dataclasses import replace

import numpy as np
import pytest

from ins.errors.catalogue import catalogue
from ins.records import InputError
from ins.twin_file import default_twin
from ins.units import DEG_PER_HOUR, MICRO_G
from simreal.declared.declared_noise import without_excess
from simreal.declared.twin_effects import parse_effects, twin_extra_noise, twin_traces
from tests.ins.errors.effects_fixture import parked_run


def twin_with(*effects):
    return replace(default_twin("rlg"), effects=effects, source="twin.json")


def item(effect, target, **parameters):
    return {"effect": effect, "target": target, "parameters": parameters}


def test_a_cause_of_a_diagnosis_can_be_pasted_and_means_the_plain_number():
    pasted = item(
        "gyro_thermal_rate",
        "gyro_y",
        coefficient={"value": 0.03, "sigma": 0.004, "unit": "deg/h per degC/min"},
    )
    plain = item("gyro_thermal_rate", "gyro_y", coefficient=0.03)
    assert parse_effects(twin_with(pasted)) == parse_effects(twin_with(plain))
    run = parked_run()
    trace = twin_traces(parse_effects(twin_with(pasted)), run, "any")
    np.testing.assert_allclose(
        trace.gyro_rad_s[:, 1], 0.03 * DEG_PER_HOUR * run.temperature_rate_degC_min[:, 1]
    )
    assert not trace.gyro_rad_s[:, [0, 2]].any() and trace.accel_m_s2 is None


def test_effects_add_up_and_an_event_belongs_to_its_run():
    step = item("gyro_bias_step", "gyro_x", coefficient=0.02, onset_s=1000.0, run_id="second")
    ramp = item("gyro_rate_ramp", "gyro_x", coefficient=0.01)
    effects, run = parse_effects(twin_with(step, ramp)), parked_run()
    first, second = (
        twin_traces(effects, run, name).gyro_rad_s[:, 0] / DEG_PER_HOUR
        for name in ("first", "second")
    )
    np.testing.assert_allclose(first, 0.01 * run.time_s / 3600.0)
    np.testing.assert_allclose(second - first, 0.02 * (run.time_s > 1000.0), atol=1e-12)


def test_a_free_function_is_straight_between_its_nodes():
    T = item(
        "unknown_function_of_temperature",
        "gyro_z",
        nodes=[0.0, 40.0],
        values=[0.0, 0.08],
        unit="deg/h",
    )
    t = item(
        "unknown_function_of_time",
        "accel_x",
        nodes=[0.0, 1800.0, 3600.0],
        values=[0.0, 50.0, 0.0],
        unit="ug",
    )
    of_run = item(
        "unknown_function_of_run", "gyro_x", nodes=["a", "b"], values=[0.01, -0.02], unit="deg/h"
    )
    run = parked_run()
    trace = twin_traces(parse_effects(twin_with(T, t, of_run)), run, "b")
    np.testing.assert_allclose(
        trace.gyro_rad_s[:, 2], 0.002 * DEG_PER_HOUR * run.temperature_degC[:, 2], rtol=1e-9
    )
    np.testing.assert_allclose(trace.accel_m_s2[900, 0], 50.0 * run.time_s[900] / 1800.0 * MICRO_G)
    np.testing.assert_allclose(trace.gyro_rad_s[:, 0], -0.02 * DEG_PER_HOUR)


def test_turn_on_biases_are_written_by_run():
    each = item(
        "gyro_turn_on_bias",
        "gyro_x",
        **{"coefficient[a]": {"value": 0.01, "unit": "deg/h"}, "coefficient[b]": -0.02},
    )
    effects = parse_effects(twin_with(each))
    for run_id, size in (("a", 0.01), ("b", -0.02)):
        trace = twin_traces(effects, parked_run(), run_id)
        np.testing.assert_allclose(trace.gyro_rad_s[:, 0], size * DEG_PER_HOUR)
    assert twin_traces(effects, parked_run(), "c").gyro_rad_s is None


def test_noise_has_a_signed_square_and_slow_kinds_go_by_their_process():
    walk = item("slow_variation", "gyro_x", process="gyro_rate_random_walk", coefficient=0.01)
    by_id = item("gyro_rate_random_walk", "gyro_x", coefficient=0.01)
    less = item("gyro_angle_random_walk", "gyro_y", coefficient=-0.001)
    effects = parse_effects(twin_with(walk, by_id, less))
    extra = twin_extra_noise(effects)
    found = [e.effect.id for e in extra]
    assert found == ["gyro_rate_random_walk", "gyro_rate_random_walk", "gyro_angle_random_walk"]
    np.testing.assert_allclose([e.square for e in extra], [1e-4, 1e-4, -1e-6])
    assert twin_traces(effects, parked_run(), "any").gyro_rad_s is None


def test_kinds_of_one_name_are_told_apart_by_their_coefficients():
    part = item("platform_settling", "vehicle", roll=20.0, tau_s=300.0)
    whole = item("platform_settling", "vehicle", roll=20.0, pitch=0.0, tau_s=300.0)
    one, both = (
        twin_traces(parse_effects(twin_with(raw)), parked_run(), "any") for raw in (part, whole)
    )
    np.testing.assert_array_equal(one.gyro_rad_s, both.gyro_rad_s)
    names = [
        item("platform_sway", "vehicle", rotation=50.0),
        item("platform_sway", "vehicle", coefficient=0.002),
        item("engine_start", "vehicle", noise=30.0, onset_s=60.0),
    ]
    ids = [e.effect.id for e in parse_effects(twin_with(*names))]
    assert ids == ["platform_sway_rotation", "platform_sway", "engine_start_noise"]


def test_what_each_run_has_of_its_own_is_written_and_read_back():
    """A settling whose size differs from run to run, as a diagnosis prints it: one item a run, each
    with the time constant that they share.
    """
    whole = item("platform_settling", "vehicle", tau_s=700.0, **{"pitch[a]": 20.0, "pitch[b]": 9.0})
    read = parse_effects(twin_with(whole))
    found = [(e.run_id, e.coefficients, e.shape["tau_s"]) for e in read]
    assert found == [("a", (20.0,), 700.0), ("b", (9.0,), 700.0)]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (item("gyro_thermal_liner", "gyro_x", coefficient=1.0), "got 'gyro_thermal_liner'"),
        (item("gyro_thermal_linear", "gyro_w", coefficient=1.0), "got 'gyro_w'"),
        (item("gyro_thermal_linear", "gyro_x"), "coefficient: got nothing"),
        (item("gyro_thermal_lag", "gyro_x", coefficient=1.0), r"tau_s: got nothing, .* \[s\]"),
        (item("gyro_thermal_lag", "gyro_x", coefficient=1.0, tau_s=-3.0), "tau_s: got -3.0"),
        (item("gyro_thermal_linear", "gyro_x", coeficient=1.0), "coeficient: got 'coeficient'"),
        (
            item("gyro_thermal_linear", "gyro_x", coefficient={"value": 1.0, "unit": "ppm"}),
            "unit: got 'ppm'",
        ),
        (item("gyro_thermal_linear", "gyro_x", coefficient="much"), "coefficient: got 'much'"),
        (item("slow_variation", "gyro_x", coefficient=1.0), "process: got nothing"),
        (item("sculling_residual", "accel_x", coefficient=1.0), "got 'sculling_residual'"),
        (
            item("unknown_function_of_time", "gyro_x", nodes=[1, 0], values=[1, 2], unit="deg/h"),
            "nodes: ",
        ),
        (
            item("unknown_function_of_time", "gyro_x", nodes=[0, 1], values=[1, 2], unit="ug"),
            "unit: got 'ug'",
        ),
    ],
)
def test_what_is_wrong_is_named_with_file_item_and_key(wrong, said):
    good = item("gyro_rate_ramp", "gyro_x", coefficient=0.01)
    with pytest.raises(InputError, match=rf"^twin.json: effects\[1\]: .*{said}") as error:
        parse_effects(twin_with(good, wrong))
    assert "\n" not in str(error.value)


def test_less_noise_on_one_axis_lowers_the_twin_and_gives_the_others_their_part_back():
    twin = twin_with(item("gyro_angle_random_walk", "gyro_y", coefficient=-0.0012))
    lowered, added = without_excess(twin, parse_effects(twin), "any")
    declared = twin.gyro.arw_deg_sqrt_h
    left = np.sqrt(declared**2 - 0.0012**2)
    assert lowered.gyro.arw_deg_sqrt_h == pytest.approx(left) and lowered.effects == ()
    assert {e.target: e.coefficients[0] for e in added} == pytest.approx(
        {"gyro_x": 0.0012, "gyro_z": 0.0012}
    )


def test_noise_that_is_not_declared_cannot_be_taken_away():
    twin = twin_with(
        item(
            "slow_variation", "gyro_y", process="gyro_gauss_markov", coefficient=-0.01, tau_s=100.0
        )
    )
    with pytest.raises(InputError, match=r"coefficient -0.01, needed 0 or more"):
        without_excess(twin, parse_effects(twin), "any")


def test_every_effect_of_the_catalogue_can_be_written_and_read_back():
    """By its name, as the diagnosis writes it; those that no log shows are refused."""
    for effect in catalogue():
        if effect.out_of_reach:
            continue
        numbers = {c.name: c.low for c in effect.coefficients} | {
            p.name: p.high for p in effect.shape
        }
        process = {"process": effect.id} if effect.name == "slow_variation" else {}
        for target in effect.targets:
            (read,) = parse_effects(twin_with(item(effect.name, target, **numbers, **process)))
            assert read.target == target
            if read.effect.id != effect.id:  # the same, but for how it repeats
                assert read.effect.repeats != effect.repeats
                given = read.effect, effect
                one, other = (e.traces(parked_run(), target, read.shape)[0] for e in given)
                np.testing.assert_array_equal(one.gyro_rad_s, other.gyro_rad_s)
            assert read.coefficients == tuple(c.low for c in effect.coefficients)
