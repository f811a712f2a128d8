"""`recal thermal rlg` from runs on disk: fitted on simulated chamber runs, refused, bad input,
files.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from infield.thermal.gradient_runs import gradient_lines, gradient_run
from ins.records import InputError, TemperatureLog
from ins.twin_file import default_twin
from ins.units import DEG, DEG_PER_HOUR
from recal.cli.app import app
from tests.recal.verbs import simulate
from trajectories.runs.directory import read_run, write_run
from trajectories.simulator.scenario import read_scenario, scenario_unit
from trajectories.simulator.thermal import first_order_rise

SCENARIO = """
schema = "recal.scenario/1"
seed = {seed}
alignment_s = 60
site = {{lat_deg = 45.0, lon_deg = 7.0, height_m = 250.0}}
attitude = {{heading_deg = 30.0, roll_deg = 1.0, pitch_deg = -2.0}}
imu = {{rate_hz = 10}}
motion = [{{segment = "park", duration_s = {seconds}}}]

[unit]
imu_serial = "SN-7"
gyro_technology = "{technology}"
thermal_rate_deg_h_per_degC_min = [0.05, -0.04, 0.06]
thermal_rate_slope_deg_h_per_degC2_min = [0.0008, 0.0, -0.0009]
gradient_deg_h_per_degC = [0.04, 0.03, -0.03]

[thermal]
start = "chamber"
start_degC = -10.0
end_degC = 30.0
rate_degC_min = {rate}
soak_s = 900
there_and_back = {back}
side_degC = {heater}
side_period_s = 2700
side_gradient = {side}
"""
SIDES = {
    "a": [0.8, -0.3, 0.2],
    "b": [-0.2, 0.7, 0.4],
    "c": [0.3, 0.4, -0.8],
    "check": [0.5, 0.4, -0.6],
}


def make(folder, name, *, rate=1.5, seed=1, back=True, technology="rlg", heater=5.0):
    seconds = 900 + (2 if back else 1) * (900 + 60 * 40 / rate)
    text = SCENARIO.format(
        seed=seed,
        rate=rate,
        back=str(back).lower(),
        seconds=seconds,
        technology=technology,
        heater=heater,
        side=SIDES.get(name, [0.5, 0.5, 0.5]),
    )
    (folder / f"{name}.toml").write_text(text)
    simulate(str(folder / f"{name}.toml"), folder / name)
    return folder / name


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("chamber")
    made = {
        name: make(folder, name, rate=rate, seed=k)
        for k, (name, rate) in enumerate((("a", 1.5), ("b", 2.0), ("c", 1.2), ("check", 1.7)))
    }
    made["warms"] = make(folder, "warms", rate=0.5, back=False, heater=0.0)
    made["fog"] = make(folder, "fog", rate=3.0, technology="fog")
    return folder, made


def run_rlg(folder, *words):
    result = CliRunner().invoke(
        app, ["thermal", "rlg", *map(str, words), "-o", str(folder / "out"), "--json"]
    )
    return result, (json.loads(result.stdout) if result.stdout.startswith("{") else None)


@pytest.fixture(scope="module")
def fitted(runs):
    folder, made = runs
    return run_rlg(folder, made["a"], made["b"], made["c"], "--check", made["check"])


def test_terms_of_simulated_chamber_runs(runs, fitted):
    """The truth is a spline with a wave, the runs have thermometers with noise and steps, lags,
    heaters and Earth rate.
    """
    folder, _ = runs
    result, document = fitted
    assert result.exit_code == 0 and document["verdict"] == "fitted" and not document["notes"]
    unit = scenario_unit(read_scenario(folder / "a.toml"))
    reference = document["reference_temperature_degC"]
    for k, (axis, a) in enumerate(document["axes"].items()):
        slope = unit.thermal_rate_slope_deg_h_per_degC2_min[k]
        true = {
            "K4": unit.thermal_rate_deg_h_per_degC_min[k] + slope * (reference - 20.0),
            "K5": slope,
            f"K6{axis}": unit.gradient_deg_h_per_degC[k],
        }
        for name, value in true.items():
            term = a["terms"][name]
            if term["state"] == "used":
                assert abs(term["value"] - value) < 4.0 * term["sigma"], (axis, name)
        assert a["terms"]["K4"]["state"] == a["terms"][f"K6{axis}"]["state"] == "used"
        assert a["condition"]["used"] < a["condition"]["limit"]
        assert np.array(a["covariance"]).shape == (8, 8)
    (check,) = document["check"]
    for row in check["axes"].values():
        assert row["over_temperature_only"] <= 0.5
        assert row["causal_after_deg_h"] <= 0.5 * row["temperature_only_deg_h"]


def follows(values, tau_s):
    """First-order lag of values a second apart, by its recursion."""
    out, keep = np.array(values, dtype=float), np.exp(-1.0 / tau_s)
    for i in range(1, out.size):
        out[i] = values[i] + keep * (out[i - 1] - values[i])
    return out


def heated(run, seed):
    """The run with gyros of white noise and 0.8 deg/h per degC of a heater's line, which its
    thermometer reads 600 s late in steps of 0.15 degC.
    """
    second = np.arange(0.0, run.imu.end_s + 1.0)
    line = follows(np.where(second % 1200.0 < 600.0, 6.0, 0.0), 1200.0)
    imu, log = run.imu.whole(), run.temperature
    bias = 0.8 * np.interp(imu.time_s, second, line) * DEG_PER_HOUR * imu.dt_s
    white = 0.002 * DEG * np.sqrt(imu.dt_s / 3600.0)
    gyro = np.random.default_rng(seed).standard_normal(imu.dtheta_rad.shape) * white[:, None]
    gyro[:, 0] += bias
    read = 0.15 * np.round(follows(line, 600.0) / 0.15)
    lines = np.full_like(log.gyro_degC, np.nan)
    lines[:, 0] = np.interp(log.time_s, second, read)
    return replace(
        run, imu=replace(imu, dtheta_rad=gyro), temperature=replace(log, gradient_degC=lines)
    )


def test_a_heater_whose_thermometer_lags_by_ten_minutes(runs):
    folder, made = runs
    for seed, name in enumerate(("a", "b", "check")):
        write_run(folder / f"late-{name}", heated(read_run(made[name]), seed))
    fitted_to = (folder / "late-a", folder / "late-b")
    result, document = run_rlg(folder, *fitted_to, "--check", folder / "late-check")
    assert result.exit_code == 0
    found = document["axes"]["x"]
    assert abs(found["lag"]["lines_s"] - 600.0) < 4.0 * found["lag"]["sigma_lines_s"]
    left = document["check"][0]["axes"]["x"]
    assert left["after_deg_h"] < 0.25 * left["before_deg_h"]
    assert left["after_deg_h"] < left["causal_after_deg_h"] < left["before_deg_h"]


def test_without_a_gradient_column_it_fits_and_says_so(runs):
    folder, made = runs
    run = read_run(made["a"])
    write_run(
        folder / "bare", replace(run, temperature=replace(run.temperature, gradient_degC=None))
    )
    result, document = run_rlg(folder, folder / "bare")
    assert result.exit_code == 0 and "no gradient column" in document["notes"][0]
    assert all(a["terms"]["K6x"]["state"] == "no data" for a in document["axes"].values())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("a", "a"), "the same run as"),
        (("fog",), "gyro_technology 'fog', needed 'rlg'"),
        (("absent",), "absent"),
    ],
)
def test_bad_input_is_one_line(runs, words, said):
    made = runs[1]
    result = CliRunner().invoke(app, ["thermal", "rlg", *(str(made.get(w, w)) for w in words)])
    assert isinstance(result.exception, InputError) and said in str(result.exception)
    assert "\n" not in str(result.exception)


def test_a_compensated_run_is_no_raw_run_and_the_part_has_a_name(runs, fitted):
    folder, made = runs
    model = folder / "model.json"
    model.write_text(json.dumps(fitted[1]))
    words = ["thermal", "apply", str(model), str(made["check"]), "-o", str(folder / "left")]
    assert CliRunner().invoke(app, words).exit_code == 0
    twin = default_twin("rlg")
    raw, left = (
        gradient_run(read_run(p), twin).blocks.bias_deg_h[20:]
        for p in (made["check"], folder / "left")
    )
    # minute means in real-time order, 0.0155 white
    assert np.all(np.std(left, axis=0) < 0.6 * np.std(raw, axis=0))
    result, _ = run_rlg(folder, folder / "left")
    assert isinstance(result.exception, InputError)
    assert "removed_thermal_model" in str(result.exception)
    result = CliRunner().invoke(app, [*words, "--part", "some"])
    assert isinstance(result.exception, InputError)
    assert "needed all or rates" in str(result.exception)


def test_a_line_in_steps_is_smoothed_as_a_thermometer_is():
    """A heater's exponential read in steps of 0.25 degC: within a fifth of a step, where readings
    are off by up to a half.
    """
    t = np.arange(0.0, 7200.0)
    true = 4.0 * first_order_rise(t, 1500.0)
    read = 0.25 * np.round((true + 0.02 * np.random.default_rng(1).standard_normal(t.size)) / 0.25)
    gradient = np.column_stack([read, np.full_like(t, np.nan), read])
    lines = gradient_lines(
        TemperatureLog(time_s=t, gyro_degC=np.zeros((t.size, 3)), gradient_degC=gradient)
    )
    assert lines.logged == ("x", "z")
    found = lines.at(t)
    assert np.sqrt(np.mean((found[:, 0] - true)[300:] ** 2)) < 0.05 and np.std(read - true) > 0.06
    np.testing.assert_array_equal(found[:, 1], 0.0)
