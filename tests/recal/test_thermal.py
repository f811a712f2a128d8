"""`recal thermal fog` from runs on disk: fitted on simulated chamber runs, refused, bad input; the
model applied to a run.
"""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from infield.thermal.compensation import batch_series, causal_series, less
from infield.thermal.fog.model import model_from_document
from infield.thermal.ramp_runs import ramp_run
from infield.thermometer.causal_rate import (
    CausalRate,
    QUIET_RATE_degC_min,
    causal_rates,
    time_constant_s,
)
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.records import InputError
from ins.twin_file import default_twin
from recal.cli.app import app
from tests.recal.verbs import simulate
from trajectories.runs.directory import read_run
from trajectories.simulator.scenario import read_scenario, scenario_unit

SCENARIO = """
schema = "recal.scenario/1"
seed = {seed}
alignment_s = 60
site = {{lat_deg = 45.0, lon_deg = 7.0, height_m = 250.0}}
attitude = {{heading_deg = 30.0, roll_deg = 1.0, pitch_deg = -2.0}}
imu = {{rate_hz = 10}}
unit = {{imu_serial = "SN-7", gyro_technology = "{technology}", shupe_deg_h_per_degC_min = [0.3, -0.2, 0.25]}}
motion = [{{segment = "park", duration_s = {seconds}}}]
{more}

[thermal]
start = "chamber"
start_degC = -10.0
end_degC = 35.0
rate_degC_min = {rate}
soak_s = 900
there_and_back = {back}
"""


def make(folder, name, *, rate, seed, back=True, technology="fog", more=""):
    seconds = 900 + (2 if back else 1) * (900 + 60 * 45 / rate)
    text = SCENARIO.format(
        seed=seed,
        rate=rate,
        back=str(back).lower(),
        seconds=seconds,
        technology=technology,
        more=more,
    )
    (folder / f"{name}.toml").write_text(text)
    simulate(str(folder / f"{name}.toml"), folder / name)
    return folder / name


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("chamber")
    survey = "survey = {heading_deg = 30.0, sigma_heading_deg = 0.005}"
    return folder, {
        "fast": make(folder, "fast", rate=1.5, seed=1),
        "slow": make(folder, "slow", rate=0.3, seed=2),
        "check": make(folder, "check", rate=1.0, seed=3),
        "heats": make(folder, "heats", rate=1.5, seed=4, back=False),
        "surveyed": make(folder, "surveyed", rate=1.5, seed=5, more=survey),
        "rlg": make(folder, "rlg", rate=3.0, seed=6, technology="rlg"),
    }


def run_fog(folder, *words):
    result = CliRunner().invoke(
        app, ["thermal", "fog", *map(str, words), "-o", str(folder / "out"), "--json"]
    )
    return result, (json.loads(result.stdout) if result.stdout.startswith("{") else None)


@pytest.fixture(scope="module")
def fitted(runs):
    folder, made = runs
    return run_fog(folder, "--fast", made["fast"], "--slow", made["slow"], "--check", made["check"])


def test_coefficients_of_simulated_chamber_runs(runs, fitted):
    """The truth has a tanh, the runs thermometers with noise, soaks, lags and Earth rate: 3 sigma
    over the grid.
    """
    folder, _ = runs
    result, document = fitted
    assert result.exit_code == 0 and document["verdict"] == "fitted" and not document["notes"]
    unit = scenario_unit(read_scenario(folder / "fast.toml"))
    for axis, a in document["axes"].items():
        T = np.array(a["temperature_degC"])
        true = unit.shupe_coefficient(axis, T)
        z = (np.array(a["K_delta_deg_h_per_degC_min"]) - true) / a[
            "sigma_K_delta_deg_h_per_degC_min"
        ]
        assert np.mean(np.abs(z) <= 3.0) >= 0.9 and np.sqrt(np.mean(z**2)) < 1.8, (axis, z)
        shape = unit.bias_deg_h(axis, T)
        z = (np.array(a["K_T_deg_h"]) - (shape - shape.mean())) / a["sigma_K_T_deg_h"]
        assert np.sqrt(np.mean(z**2)) < 1.8, (axis, z)
        # 0.8 on ramps without ends: its rates are not steady there
        assert 0.65 < a["document"]["gain"] < 0.88
        assert 0.9 < a["residual_over_sigma"] < 1.15
    (check,) = document["check"]
    assert all(
        row["ratio"] <= 1 / 3 and row["causal_ratio"] <= 1 / 3 for row in check["axes"].values()
    )
    assert {leg["direction"] for leg in document["runs"][0]["ramps"]} == {"up", "down"}


def test_the_model_takes_the_ramp_out_of_a_run_in_batch_and_in_real_time(runs, fitted):
    run = read_run(runs[1]["check"])
    model, imu = model_from_document(fitted[1]), run.imu.whole()
    twin = default_twin("fog")
    raw = ramp_run(run, twin)
    for compensated in (
        less(imu, batch_series(model, run.temperature, gyro_temperature(run.temperature))),
        less(imu, causal_series(model, run.temperature)),
    ):
        left = ramp_run(type(run)(**{**run.__dict__, "imu": compensated}), twin)
        for k in range(3):
            assert (
                np.std(left.bias_deg_h[left.steady, k]) <= np.std(raw.bias_deg_h[raw.steady, k]) / 3
            )
    future = type(run.temperature)(
        time_s=run.temperature.time_s,
        gyro_degC=np.where(
            (run.temperature.time_s > 3000.0)[:, None], 99.0, run.temperature.gyro_degC
        ),
    )
    spoiled = less(imu, causal_series(model, future))
    before = imu.time_s <= 3000.0
    # knows nothing of what comes
    np.testing.assert_array_equal(spoiled.dtheta_rad[before], compensated.dtheta_rad[before])


def test_a_surveyed_heading_gives_the_level_too(runs):
    folder, made = runs
    result, document = run_fog(folder, "--fast", made["surveyed"])
    unit = scenario_unit(read_scenario(folder / "surveyed.toml"))
    assert result.exit_code == 0 and document["runs"][0]["heading_known"]
    for axis, a in document["axes"].items():
        true = unit.bias_deg_h(axis, np.array(a["temperature_degC"])).mean()
        assert (
            a["level"]["known"]
            and abs(a["level"]["value_deg_h"] - true) <= 3.5 * a["level"]["sigma_deg_h"]
        ), axis
        assert a["level"]["sigma_deg_h"] < 0.01


def test_refusals_exit_4_and_say_what_is_needed(runs):
    folder, made = runs
    result, document = run_fog(folder, "--fast", made["heats"])
    assert result.exit_code == 4 and document["verdict"] == "refused" and document["axes"] == {}
    assert document["reason_codes"] == ["same_sign_ramps"]
    result, document = run_fog(folder, "--fast", made["fast"], "--slow", made["surveyed"])
    assert result.exit_code == 4 and document["reason_codes"] == ["equal_rates"]
    assert "Refused" in (folder / "out" / "thermal_fog.html").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fast", "--slow", "fast"), "the same run as"),
        (("rlg",), "gyro_technology 'rlg', needed 'fog'"),
        (("absent",), "absent"),
    ],
)
def test_bad_input_is_one_line(runs, words, said):
    made = runs[1]
    result = CliRunner().invoke(
        app, ["thermal", "fog", "--fast", *(str(made.get(w, w)) for w in words)]
    )
    assert isinstance(result.exception, InputError) and said in str(result.exception)
    assert "\n" not in str(result.exception)


def test_a_run_is_compensated_on_disk_and_raw_ones_of_other_units_are_not(runs, fitted):
    folder, made = runs
    words = ["thermal", "apply", str(folder / "out" / "thermal_fog.json")]
    path = folder / "model.json"
    path.write_text(json.dumps(fitted[1]))
    words[2] = str(path)
    result = CliRunner().invoke(
        app, [*words, str(made["check"]), "-o", str(folder / "left"), "--json"]
    )
    assert result.exit_code == 0 and json.loads(result.stdout)["share_inside"] > 0.8
    raw, left = (
        ramp_run(read_run(p), default_twin("fog")) for p in (made["check"], folder / "left")
    )
    assert np.all(
        np.std(left.bias_deg_h[raw.steady], axis=0)
        <= np.std(raw.bias_deg_h[raw.steady], axis=0) / 3
    )
    path.write_text(json.dumps({**fitted[1], "imu_serial": "SN-8"}))
    result = CliRunner().invoke(app, [*words, str(made["check"]), "-o", str(folder / "none")])
    assert isinstance(result.exception, InputError)
    assert "SN-8" in str(result.exception)
    assert not (folder / "none").exists()


def test_a_result_that_is_none_is_no_model(fitted):
    for change, said in (
        ({"schema": "x"}, "schema"),
        ({"verdict": "refused"}, "verdict"),
        ({"axes": {"x": {}}}, "axes"),
    ):
        with pytest.raises(InputError, match=said):
            model_from_document({**fitted[1], **change})


def test_the_time_constant_is_as_short_as_the_thermometers_allow():
    """Noise of 0.01 degC allows 10 to 20 s; stairs, much noise and short logs keep the usual 60."""
    rng, t = np.random.default_rng(2), np.arange(0.0, 900.0)
    ramp = (20.0 + 0.5 * t / 60.0)[:, None]
    fine = ramp + 0.01 * rng.standard_normal((t.size, 3))
    tau = time_constant_s(t, fine)
    assert 10.0 < tau < 20.0
    _, rate = causal_rates(t, fine, tau)
    assert np.std(rate[300:]) < 1.3 * QUIET_RATE_degC_min
    assert time_constant_s(t, 0.1 * np.round(10.0 * ramp)) == 60.0
    assert time_constant_s(t, ramp + rng.standard_normal((t.size, 3))) == 60.0
    assert time_constant_s(t[:20], fine[:20]) == 60.0
    later = np.where((t > 400.0)[:, None], 99.0, fine)
    assert time_constant_s(t, later) == tau  # knows nothing of what comes


def test_causal_rate_on_a_ramp_and_its_noise():
    t = np.arange(0.0, 3600.0)
    T, rate = causal_rates(t, (20.0 + 0.5 * t / 60.0)[:, None])
    np.testing.assert_allclose(rate[1:, 0], 0.5, rtol=1e-9)
    np.testing.assert_allclose(T[:, 0], 20.0 + 0.5 * t / 60.0, rtol=1e-9)
    noise = np.random.default_rng(1).standard_normal((40000, 1)) * 0.01
    _, rate = causal_rates(np.arange(40000.0), noise)
    w = np.exp(-1 / 60.0)
    assert np.std(rate[2000:]) == pytest.approx(
        60 * 0.01 * np.sqrt(2 * ((1 - w) / (1 + w)) ** 3), rel=0.1
    )
    late = CausalRate()
    seen = [
        late.feed(float(k), 20.0 if k < 600 else 20.0 + (k - 600) / 60.0)[1] for k in range(1500)
    ]
    assert seen[599] == pytest.approx(0.0, abs=1e-9)
    assert 0.5 < seen[750] < 1.0
    assert seen[1499] == pytest.approx(1.0, abs=1e-4)
    assert late.feed(1500.0, float("nan"))[1] == pytest.approx(1.0, abs=1e-4)
    with pytest.raises(ValueError, match="needed later"):
        late.feed(10.0, 20.0)
