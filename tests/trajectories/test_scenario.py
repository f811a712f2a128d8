"""Scenario files: what is packaged runs; each wrong key is named with its place."""

import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from ins.records import InputError
from ins.units import DEG
from tests.reference_motions import reference_motion
from trajectories.simulator.scenario import (
    SECTIONS,
    packaged_scenarios,
    read_scenario,
    scenario_from_dict,
    scenario_ideal,
    scenario_unit,
    simulate_scenario,
)
from trajectories.simulator.vehicle import EVENTS


def small(**changes):
    """A scenario of a minute, as a dict."""
    data = {
        "schema": "recal.scenario/1",
        "alignment_s": 20,
        "site": {"lat_deg": 45.0, "lon_deg": 7.0, "height_m": 250},
        "imu": {"rate_hz": 20},
        "thermal": {"start": "cold"},
        "motion": [
            {"segment": "park", "duration_s": 30},
            {"segment": "turn", "angle_deg": 90},
            {"segment": "stop", "duration_s": 5},
        ],
    }
    return {**data, **changes}


@pytest.mark.parametrize("name", packaged_scenarios())
def test_packaged_scenarios_are_read(name):
    scenario = read_scenario(name)
    chamber = name.startswith(("fog_ramp", "rlg_gradient"))  # many hours
    hours = name.startswith(("mems", "cold_flight"))
    rate_hz = 10 if chamber else 50 if hours else 100
    assert scenario.alignment_s == 600 and scenario.imu.rate_hz == rate_hz
    ideal = scenario_ideal(
        scenario_from_dict({**packaged(name), "imu": {"rate_hz": 10}}, name=name)
    )
    assert ideal.truth.motion.phases[0].phase == "alignment"
    assert ideal.speed_m_s[-1] == 0  # each ends at rest


def packaged(name):
    return tomllib.loads(
        (resources.files("trajectories.simulator") / "scenarios" / f"{name}.toml").read_text()
    )


def test_cold_parked_taxi_is_the_realistic_taxi():
    scenario = scenario_from_dict(
        {**packaged("cold_parked_taxi"), "imu": {"rate_hz": 10}}, name="x"
    )
    _, motion = reference_motion("realistic_taxi")
    t = np.linspace(0, motion.end_s, 2000)
    np.testing.assert_allclose(
        scenario_ideal(scenario).truth.motion.course_rad(t), motion.course_rad(t)
    )


def test_flight_reaches_its_height_and_comes_back():
    ideal = scenario_ideal(
        scenario_from_dict({**packaged("flight"), "imu": {"rate_hz": 10}}, name="x")
    )
    assert ideal.height_m.max() == pytest.approx(3250.0, abs=10.0)
    assert ideal.height_m[-1] == pytest.approx(250.0, abs=0.01)
    phases = [p.phase for p in ideal.truth.motion.phases]
    assert phases == [
        "alignment",
        "extended_alignment",
        "taxi",
        "takeoff",
        "flight",
        "landing",
        "taxi",
        "parked",
    ]


def test_every_section_reaches_the_run():
    data = small(
        seed=5,
        attitude={"heading_deg": 30.0, "roll_deg": 1.0, "pitch_deg": -2.0},
        run={"run_id": "R1", "tail": "D-ABCD", "start_utc": "2026-01-01T00:00:00Z"},
        unit={"imu_serial": "SN-7", "gyro_technology": "fog", "ageing_seed": 3},
        twin={"gyro_technology": "fog", "gyro": {"arw_deg_sqrt_h": 0.01}},
        streams={"gnss": True, "odometer": True},
        lever_arms_m={"wheel_reference": [1.0, 2.0, 3.0], "gnss": [4, 5, 6]},
        survey={"heading_deg": 30.0, "sigma_heading_deg": 0.01},
        disturbance=[{"event": "boarding", "time_s": 10, "roll_arcsec": 100}],
    )
    made, unit = simulate_scenario(scenario_from_dict(data, name="s.toml"))
    header = made.run.header
    assert header.run_id == "R1"
    assert header.tail == "D-ABCD"
    assert header.imu_serial == "SN-7"
    assert header.gyro_technology == "fog"
    assert header.wheel_reference_m == (1.0, 2.0, 3.0)
    assert header.gnss_lever_arm_m == (4.0, 5.0, 6.0)
    assert header.survey.heading_rad == pytest.approx(30 * DEG)
    assert header.survey.sigma_heading_rad == pytest.approx(0.01 * DEG)
    assert made.run.gnss is not None and made.run.odometer is not None
    assert made.reference.roll_rad[-1] - made.reference.roll_rad[0] == pytest.approx(
        100 * DEG / 3600, rel=0.05
    )
    assert made.reference.pitch_rad[0] == pytest.approx(-2 * DEG, abs=1e-6)
    assert unit.gyro_technology == "fog"


def test_seed_of_the_session_and_of_the_unit_are_apart():
    scenario = scenario_from_dict(small(seed=5), name="s.toml")
    a, b = simulate_scenario(scenario), simulate_scenario(scenario, seed=6)
    assert a[0].run.sha256 != b[0].run.sha256 and a[1].factory_table() == b[1].factory_table()
    assert a[0].run.header.run_id == "s-5"
    other = scenario_from_dict(small(unit={"ageing_seed": 2}), name="s.toml")
    assert scenario_unit(other).factory_table() != a[1].factory_table()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"schema": "recal.run/1"}, ["schema", "recal.scenario/1"]),
        ({"sites": {}}, ["unknown key sites"]),
        ({"site": {"lat_deg": 45.0, "lon_deg": 7.0}}, ["site", "height_m is missing"]),
        ({"site": {"lat_deg": "45", "lon_deg": 7.0, "height_m": 0.0}}, ["lat_deg", '"45"']),
        ({"imu": {"rate": 100}}, ["imu", "unknown key rate", "rate_hz"]),
        ({"motion": [{"segment": "taxy", "duration_s": 5}]}, ["motion[0]", "'taxy'", "straight"]),
        (
            {"motion": [{"segment": "park", "duration_s": 5, "radius_m": 4}]},
            ["motion[0]", "radius_m"],
        ),
        ({"motion": 5}, ["motion", "list"]),
        ({"thermal": {"start": "cold", "settled_degF": 90}}, ["thermal", "settled_degF"]),
        ({"thermal": {}}, ["thermal", "start"]),
        ({"twin": {"gyro_technology": "rlg", "gyro": {"arw": 1.0}}}, ["twin", "gyro.arw"]),
        ({"twin": {"gyro_technology": "rlg"}, "twin_file": "t.json"}, ["twin and twin_file"]),
        ({"disturbance": [{"event": "meteor"}]}, ["disturbance[0]", "meteor", "boarding"]),
        ({"lever_arms_m": {"gnss": [1.0, 2.0]}}, ["lever_arms_m", "gnss", "3 values"]),
        ({"alignment_s": float("nan")}, ["alignment_s", "finite"]),
    ],
)
def test_what_is_wrong_is_named(changes, words):
    with pytest.raises(InputError) as caught:
        scenario_from_dict(small(**changes), name="s.toml")
    assert str(caught.value).startswith("s.toml")
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_the_example_shows_every_section():
    path = Path(__file__).parents[2] / "examples" / "scenario.toml"
    scenario = read_scenario(path)
    assert set(SECTIONS) <= set(tomllib.loads(path.read_text()))
    assert {type(e) for e in scenario.events} == set(EVENTS.values())
    simulate_scenario(
        scenario_from_dict(
            {**tomllib.loads(path.read_text()), "imu": {"rate_hz": 10}}, name="example"
        )
    )


def test_unit_and_twin_must_be_of_one_technology_and_serial():
    twin = {"gyro_technology": "rlg", "imu_serial": "SN-1"}
    with pytest.raises(InputError, match=r"imu_serial.*SN-2.*SN-1"):
        scenario_unit(
            scenario_from_dict(small(twin=twin, unit={"imu_serial": "SN-2"}), name="s.toml")
        )
    with pytest.raises(InputError, match="gyro_technology"):
        scenario_unit(
            scenario_from_dict(small(twin=twin, unit={"gyro_technology": "fog"}), name="s.toml")
        )
    alone = scenario_from_dict(small(unit={"gyro_technology": "mems"}), name="s.toml")
    assert alone.twin.gyro.arw_deg_sqrt_h > 0.1 and scenario_unit(alone).gyro_technology == "mems"
    assert scenario_unit(scenario_from_dict(small(twin=twin), name="s.toml")).imu_serial == "SN-1"
