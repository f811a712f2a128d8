"""Each number of a twin and of a scenario, set to what nobody meant: a run of finite values, or one
line that names the key.
"""

import copy
import json
from dataclasses import MISSING, fields

import numpy as np
import pytest

from ins.records import InputError
from ins.twin_file import TWIN_SECTIONS, default_twin, twin_to_dict
from tests.trajectories.test_scenario import small
from trajectories.simulator.scenario import SECTIONS, scenario_from_dict, simulate_scenario
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.vehicle import EVENTS

WRONG = (-1.0, np.nan, 1e308, "x", None)
SMALL = (0, 1e-300, 1e6)


def scenario(**changes) -> dict:
    motion = [{"segment": "park", "duration_s": 5}, {"segment": "turn", "angle_deg": 90}]
    short = {"alignment_s": 3, "imu": {"rate_hz": 10.0}, "motion": motion}
    return small(**{**short, "streams": {"gnss": True, "odometer": True}, **changes})


def filled(kind: type) -> dict:
    """Every number of a section: its default, 1 where it has none."""
    given = {f.name: 1.0 if f.default in (MISSING, None) else f.default for f in fields(kind)}
    return {k: v for k, v in given.items() if isinstance(v, int | float | tuple)}


def cases() -> dict[str, dict]:
    twin = {key: twin_to_dict(default_twin("rlg"))[key] for key in TWIN_SECTIONS}
    own = {"site", "imu", "streams", "run"}
    sections = {name: filled(kind) for name, kind in SECTIONS.items() if name not in own}
    sections["unit"] |= {"imu_serial": "SN-1", "gyro_technology": "rlg"}
    history = vars(thermal_history("cold"))
    thermal = {k: v for k, v in history.items() if isinstance(v, int | float | tuple)}
    found = {
        "twin": scenario(twin={"gyro_technology": "rlg", **twin}),
        "vehicle": scenario(twin={"gyro_technology": "rlg", "vehicle": twin["vehicle"]}),
        "sections": scenario(**sections),
        "thermal": scenario(thermal={"start": "cold", **thermal}),
    }
    for name, kind in EVENTS.items():
        found[name] = scenario(disturbance=[{"event": name, **filled(kind)}])
    return json.loads(json.dumps(found))


CASES = cases()
LONG = {"twin", "sections", "thermal"}  # 10 to 45 s
SWEPT = [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in CASES]


def places(value, place=()):
    """Where the numbers stand."""
    parts = value.items() if isinstance(value, dict) else enumerate(value)
    for key, part in parts:
        if isinstance(part, dict | list):
            yield from places(part, (*place, key))
        elif isinstance(part, int | float) and not isinstance(part, bool):
            yield (*place, key)


def changed(data, place, value):
    data = copy.deepcopy(data)
    inner = data
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return data


def is_finite(log) -> bool:
    arrays = [v for v in vars(log).values() if isinstance(v, np.ndarray)]
    return all(np.isfinite(values).all() for values in arrays)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("case", SWEPT)
def test_no_number_ends_in_a_traceback(case):
    base = CASES[case]
    simulate_scenario(scenario_from_dict(base, name="s.toml"))
    for place in places(base):
        if place[0] in scenario() and base[place[0]] == scenario()[place[0]]:
            continue
        for value in (*WRONG, *SMALL):
            try:
                read = scenario_from_dict(changed(base, place, value), name="s.toml")
                run = simulate_scenario(read)[0].run
            except InputError as error:
                assert "\n" not in str(error) and str(error).startswith("s.toml"), place
                continue
            logs = (run.imu, run.temperature, run.gnss, run.odometer)
            assert all(map(is_finite, logs)), (place, value)


def test_a_sway_of_any_period_has_its_declared_size():
    """Of an oscillator, critically damped too, by its velocities over many periods."""
    vehicle = {"lateral_noise_m_s": 0.0, "yaw_creep_arcsec_sqrt_h": 0.0, "sway_m_s": 2.0}
    for damping in (0.2, 1.0, 3.0):
        vehicle |= {"sway_hz": 0.5, "sway_damping": damping}
        twin = {"gyro_technology": "rlg", "vehicle": vehicle, "gnss": {"sigma_velocity_m_s": 0.0}}
        motion = [{"segment": "park", "duration_s": 4000}]
        data = scenario(twin=twin, motion=motion, streams={"gnss": True})
        run = simulate_scenario(scenario_from_dict(data, name="s.toml"))[0].run
        size = np.sqrt(np.mean(run.gnss.v_n_m_s[:, :2] ** 2))
        assert abs(size - 2.0) < 0.2, (damping, size)
