"""A fitted thermal model before the table: update, replay, and runs of `thermal apply`; the
sessions' truth has the terms.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from infield.reports.documents.rlg import rlg_document
from infield.store.table_store import TableStore
from infield.thermal.rlg.gradients import fit_gradients
from infield.thermal.stored_model import (
    prepared,
    read_thermal_model,
    removal,
    with_model_sigma,
    without_rates,
)
from ins.documents import to_json
from ins.records import InputError
from ins.twin_file import default_twin
from recal.cli.app import app
from tests.infield.gradient_cases import TWIN, Unit, three_runs
from tests.recal.verbs import simulate
from trajectories.runs.directory import read_run
from trajectories.simulator.scenario import read_scenario, scenario_unit

RATE, SLOPE, GRADIENT = [0.035, -0.028, 0.04], [0.0006, 0.0, -0.0007], [0.03, 0.025, -0.02]
SCENARIO = f"""
schema = "recal.scenario/1"
seed = 3
alignment_s = 600
site = {{lat_deg = 45.0, lon_deg = 7.0, height_m = 250.0}}
imu = {{rate_hz = 20}}
thermal = {{start = "cold"}}

[unit]
imu_serial = "SN-1"
gyro_technology = "rlg"
ageing_seed = 6
thermal_rate_deg_h_per_degC_min = {RATE}
thermal_rate_slope_deg_h_per_degC2_min = {SLOPE}
gradient_deg_h_per_degC = {GRADIENT}

[[motion]]
segment = "park"
duration_s = 2400

[[motion]]
segment = "turn"
angle_deg = 90

[[motion]]
segment = "taxi"
duration_s = 120
speed_m_s = 9.5

[[motion]]
segment = "stop"
duration_s = 60
"""


@pytest.fixture(scope="module", autouse=True)
def without_drawings():
    yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A session in run/, its unit's factory table in a store, and a model fitted to minute means of
    the same terms.
    """
    path = tmp_path_factory.mktemp("use")
    (path / "session.toml").write_text(SCENARIO)
    simulate(str(path / "session.toml"), path / "run", table_out=path / "table.json")
    rng = np.random.default_rng(1)
    unit = Unit(rng)
    # RATE holds at 20 degC, K4 of Unit at 25
    unit.K4, unit.K5 = np.array(RATE) + 5.0 * np.array(SLOPE), np.array(SLOPE)
    unit.K6 = np.diag(GRADIENT)
    study = fit_gradients(three_runs(rng, unit), TWIN)
    (path / "model.json").write_text(to_json(rlg_document(study, version="")))
    return path


def store(folder, name):
    url = f"sqlite:///{folder}/{name}.db"
    with TableStore.open(url, create=True) as opened:
        opened.import_table(json.loads((folder / "table.json").read_text()))
    return url


def recal(*words):
    result = CliRunner().invoke(app, list(map(str, words)))
    return result, (json.loads(result.stdout) if result.stdout.startswith("{") else None)


@pytest.fixture(scope="module")
def updated(folder):
    url = store(folder, "with")
    result, document = recal(
        "update",
        folder / "run",
        "--store",
        url,
        "--thermal-model",
        folder / "model.json",
        "-o",
        folder / "update",
        "--commit",
        "--json",
    )
    assert result.exit_code == 0, result.output
    return url, document


def test_update_with_the_model_finds_the_settled_bias(folder, updated):
    unit = scenario_unit(read_scenario(folder / "session.toml"))
    _, document = updated
    used = document["thermal_model"]
    assert used["part"] == "rates"
    assert used["runs"][0]["rms_deg_h"]["x"] > 0.03 > used["runs"][0]["sigma_deg_h"]["x"]
    assert document["noise_model"]["gyro"]["turn_on_deg_h"] > default_twin("rlg").gyro.turn_on_deg_h
    for axis in "xy":
        after = document["table_after"]["axes"][axis]
        T = np.array(after["temperature_degC"])
        error = np.array(after["bias_deg_h"]) - unit.bias_deg_h(axis, T)
        z = (error / np.hypot(after["sigma_deg_h"], 0.003))[2:5]
        assert np.all(np.abs(z) < 3.0), (axis, z)
        residual = used["residual_table"][axis]
        model = read_thermal_model(folder / "model.json").model
        settled = model.settled_deg_h(np.repeat(T[:, None], 3, axis=1))[:, "xyz".index(axis)]
        np.testing.assert_allclose(
            np.array(residual["bias_deg_h"]) + settled, after["bias_deg_h"], atol=1e-12
        )
    assert document["table_after"]["provenance"]["thermal_model_sha256"] == used["sha256"]
    assert "thermal_model_sha256" not in document["table_before"]["provenance"]
    page = (folder / "update" / "update.html").read_text()
    assert "--thermal-model" in page and used["sha256"] in page
    assert "Thermal model before the table" in page and "left the log before the table" in page


def test_without_the_model_the_same_session_contradicts_the_table(folder):
    result, document = recal(
        "update", folder / "run", "--store", store(folder, "without"), "-o", folder / "no", "--json"
    )
    assert result.exit_code == 5
    assert document["verdict"] == "inconsistent"
    assert "thermal_model" not in document


def test_a_run_of_thermal_apply_goes_through_update_and_is_known_again(folder, updated):
    """Rates out, or all out and the settled part put back: the same points; and the recording is
    the one merged before.
    """
    url, document = updated
    model = folder / "model.json"
    for part, words in (("rates", []), ("all", ["--thermal-model", model])):
        done, said = recal(
            "thermal",
            "apply",
            model,
            folder / "run",
            "-o",
            folder / part,
            "--part",
            part,
            "--batch",
            "--json",
        )
        assert done.exit_code == 0 and said["part"] == part
        header = json.loads((folder / part / "run.json").read_text())["removed_thermal_model"]
        assert header["part"] == part and header["run_sha256"] == document["runs"][0]["sha256"]
        fresh = store(folder, f"fresh-{part}")
        result, again = recal(
            "update", folder / part, "--store", fresh, "-o", folder / "u", "--json", *words
        )
        assert result.exit_code == 0, result.output
        difference = [
            a["bias_deg_h"] - b["bias_deg_h"] for a, b in zip(again["points"], document["points"])
        ]
        # "all" takes the settled part out smoothed and gets it back causal
        assert np.max(np.abs(difference)) < 1e-3
        result, again = recal(
            "update", folder / part, "--store", url, "-o", folder / "u", "--json", *words
        )
        assert result.exit_code == 4 and again["reason_codes"] == ["of_run.already_merged"]
    result, _ = recal("update", folder / "all", "--store", url, "-o", folder / "u")
    assert isinstance(result.exception, InputError)
    assert "as a whole, needed that model" in str(result.exception)
    for words in (("misalignment", folder / "all", folder / "all"), ("align", folder / "all")):
        result, _ = recal(*words, "--store", url, "-o", folder / "u")
        assert isinstance(result.exception, InputError) and "was taken out whole" in str(
            result.exception
        ), words
    result, _ = recal("thermal", "apply", model, folder / "all", "-o", folder / "twice")
    assert isinstance(result.exception, InputError)
    assert "needed the raw run" in str(result.exception)


def test_replay_with_the_model_drifts_less(folder, updated):
    url, _ = updated
    drift = {}
    for words in ((), ("--thermal-model", folder / "model.json")):
        _, document = recal(
            "replay", folder / "run", "--store", url, "-o", folder / "replay", "--json", *words
        )
        drift[bool(words)] = document["tables"][0]["parked"]["rms_rate_nm_h"]
        assert ("thermal_model" in document) == bool(words)
    assert drift[True] < 0.3 * drift[False]
    assert "left the log before the table" in (folder / "replay" / "replay.html").read_text()


def test_what_is_not_known_of_the_terms_widens_the_turn_on_by_hand(folder):
    twin, run = default_twin("rlg"), read_run(folder / "run")
    stored = read_thermal_model(folder / "model.json")
    found = replace(removal(run, stored), sigma_deg_h={"x": 0.004, "y": 0.001, "z": 0.0})
    assert with_model_sigma(twin, [found]).gyro.turn_on_deg_h == pytest.approx(0.005)  # 3-4-5
    assert with_model_sigma(twin, []) is twin
    left, gone = without_rates(run, None)
    assert left is run and gone is None and prepared([run], None) == ([run], [])


def test_a_model_of_another_unit_or_of_lines_that_are_not_logged_is_bad_input(folder):
    run, model = read_run(folder / "run"), json.loads((folder / "model.json").read_text())
    stored = read_thermal_model(folder / "model.json")
    with pytest.raises(InputError, match=r"gradient_x_degC.*gradient_y_degC.*gradient_z_degC"):
        without_rates(
            replace(run, temperature=replace(run.temperature, gradient_degC=None)), stored
        )
    for change, said in (
        ({"imu_serial": "SN-2"}, "SN-2"),
        ({"schema": "x"}, "schema"),
        ({"verdict": "refused"}, "verdict"),
        ({"axes": {"x": {}}}, "terms cannot be read"),
        ({"axes": {}}, "needed some of"),
    ):
        (folder / "bad.json").write_text(json.dumps({**model, **change}))
        with pytest.raises(InputError, match=said):
            without_rates(run, read_thermal_model(folder / "bad.json"))
