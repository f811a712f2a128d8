"""`recal simulate`: a run on disk that reads back as it was made; the unit's table and truth beside
it.
"""

import csv
import json

import numpy as np
import pytest

from infield.table.file import read_table_dict
from ins.records import InputError
from tests.recal.verbs import simulate
from trajectories.runs.directory import read_reference, read_run

SCENARIO = """
schema = "recal.scenario/1"
seed = 3
alignment_s = 20
site = {lat_deg = 45.0, lon_deg = 7.0, height_m = 250.0}
imu = {rate_hz = 50}
thermal = {start = "ambient"}
motion = [{segment = "park", duration_s = 60}, {segment = "turn", angle_deg = 90}, {segment = "stop", duration_s = 5}]
"""


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(SCENARIO)
    return path


def test_run_table_and_truth_are_written_and_fit(scenario, tmp_path):
    result = simulate(
        str(scenario),
        tmp_path / "run",
        table_out=tmp_path / "table.json",
        truth=tmp_path / "truth.csv",
        seed=8,
    )
    assert result["seed"] == 8 and result["rate_hz"] == pytest.approx(50.0)
    run, reference = read_run(tmp_path / "run"), read_reference(tmp_path / "run")
    assert run.header.run_id == "short-8" and reference is not None and not run.faults
    assert [p.phase for p in run.phases] == ["alignment", "extended_alignment", "taxi"]
    assert read_table_dict(tmp_path / "table.json")["imu_serial"] == run.header.imu_serial
    rows = list(csv.DictReader((tmp_path / "truth.csv").read_text().splitlines()))
    assert [float(r["time_s"]) for r in rows] == list(np.arange(len(rows)))
    read = np.array([float(r["gyro_x_degC"]) for r in rows])
    np.testing.assert_allclose(run.temperature.gyro_degC[:, 0], read, atol=0.06)


def test_same_seed_gives_the_same_files(scenario, tmp_path):
    for name in ("a", "b"):
        simulate(str(scenario), tmp_path / name)
    a, b = read_run(tmp_path / "a"), read_run(tmp_path / "b")
    assert a.sha256 == b.sha256
    assert all(
        f.read_bytes() == (tmp_path / "b" / f.name).read_bytes() for f in (tmp_path / "a").iterdir()
    )


def test_a_table_that_is_given_is_the_units_and_must_be_of_its_serial(scenario, tmp_path):
    simulate(str(scenario), tmp_path / "run", table_out=tmp_path / "table.json")
    simulate(
        str(scenario),
        tmp_path / "again",
        table=tmp_path / "table.json",
        table_out=tmp_path / "copy.json",
    )
    assert read_table_dict(tmp_path / "copy.json") == read_table_dict(tmp_path / "table.json")
    twin = {
        "schema": "recal.twin/1",
        "gyro_technology": "rlg",
        "imu_serial": "SN-1",
        "table": "table.json",
    }
    (tmp_path / "twin.json").write_text(json.dumps(twin))
    with pytest.raises(InputError, match=r"SN-0042.*SN-1"):
        simulate(str(scenario), tmp_path / "third", twin=tmp_path / "twin.json")
    assert not (tmp_path / "third").exists()


def test_trouble_with_the_outputs_is_named(scenario, tmp_path):
    with pytest.raises(InputError, match=r"truth.csv: cannot be written"):
        simulate(str(scenario), tmp_path / "run", truth=tmp_path / "nowhere" / "truth.csv")


def test_the_twins_effects_are_in_the_run_its_reference_and_its_truth(scenario, tmp_path):
    effects = [
        {"effect": "gyro_thermal_linear", "target": "gyro_y", "parameters": {"coefficient": 0.5}},
        {
            "effect": "platform_settling",
            "target": "vehicle",
            "parameters": {"roll": 200.0, "pitch": 0.0, "tau_s": 20.0},
        },
    ]
    for name, listed in (("clean", []), ("spoilt", effects)):
        twin = {"schema": "recal.twin/1", "gyro_technology": "rlg", "effects": listed}
        (tmp_path / f"{name}.json").write_text(json.dumps(twin))
        simulate(
            str(scenario),
            tmp_path / name,
            twin=tmp_path / f"{name}.json",
            truth=tmp_path / f"{name}.csv",
        )
    clean, spoilt = (read_run(tmp_path / name).imu.whole() for name in ("clean", "spoilt"))
    T = np.interp(
        clean.time_s,
        *zip(
            *((float(r["time_s"]), float(r["gyro_y_degC"])) for r in _rows(tmp_path / "clean.csv"))
        ),
    )
    parked = clean.time_s < 59.0
    added_deg_h = np.degrees(np.mean((spoilt.dtheta_rad - clean.dtheta_rad)[parked, 1])) * 3600 * 50
    assert added_deg_h == pytest.approx(0.5 * (T[parked].mean() - 25.0), abs=0.05)
    before, after = (read_reference(tmp_path / name) for name in ("clean", "spoilt"))
    turned = np.degrees(after.roll_rad - before.roll_rad)[590] * 3600
    assert turned == pytest.approx(200.0 * (1 - np.exp(-59.1 / 20.0)), abs=0.5)
    biases = [
        float(_rows(tmp_path / f"{name}.csv")[30]["gyro_y_bias_deg_h"])
        for name in ("clean", "spoilt")
    ]
    assert biases[1] - biases[0] == pytest.approx(
        0.5 * (np.interp(30.0, clean.time_s, T) - 25.0), abs=0.01
    )


def test_a_wrong_effect_is_named_and_nothing_is_written(scenario, tmp_path):
    wrong = {
        "effect": "gyro_thermal_linear",
        "target": "gyro_y",
        "parameters": {"coefficient": "hot"},
    }
    (tmp_path / "twin.json").write_text(
        json.dumps({"schema": "recal.twin/1", "gyro_technology": "rlg", "effects": [wrong]})
    )
    with pytest.raises(InputError, match=r"parameters.coefficient: got 'hot'"):
        simulate(str(scenario), tmp_path / "run", twin=tmp_path / "twin.json")
    assert not (tmp_path / "run").exists()


def _rows(path):
    return list(csv.DictReader(path.read_text().splitlines()))
