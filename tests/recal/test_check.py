"""`recal check`: what it says, what it finds, its exit code."""

import json
from dataclasses import replace

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from recal.cli.check import command
from tests.infield.sessions import simulated
from tests.recal.verbs import check
from tests.trajectories.run_cases import csv_run, edit_json, lines, put_lines, set_cell
from trajectories.runs.directory import write_run

app = typer.Typer()
app.command()(command)


@pytest.fixture
def path(tmp_path):
    return csv_run(tmp_path / "run")


def run_check(path, *options):
    return CliRunner().invoke(app, [str(path), *options])


def temperatures(path, change) -> None:
    """Change the temperature values (rows, 3) of a run with an hour of them, one every 10 s."""
    rows = lines(path / "temperature.csv")
    time_s = np.arange(360) * 10.0
    noise = 0.01 * np.random.default_rng(3).standard_normal((360, 3))
    values = change(time_s, 20 + 20 * (1 - np.exp(-time_s / 1800))[:, None] + noise)
    body = [[repr(float(t)), *(repr(float(v)) for v in row)] for t, row in zip(time_s, values)]
    put_lines(path / "temperature.csv", [rows[0][:4], *body])


def warnings(path) -> list[str]:
    return [p["text"] for p in check(path)["problems"]]


def test_a_sound_run(path):
    said = run_check(path, "--json")
    result = json.loads(said.stdout)
    assert said.exit_code == 0 and said.stderr == ""
    assert (result["schema"], result["verdict"], result["problems"]) == ("recal.check/1", "ok", [])
    holds = result["holds"]
    assert holds["imu"]["rows"] == 4000
    assert holds["imu"]["rate_hz"] == pytest.approx(100)
    assert holds["imu"]["duration_s"] == pytest.approx(39.99)
    assert set(holds["temperature"]["range_degC"]) >= {"gyro_x", "gyro_z", "block"}
    assert [p["phase"] for p in holds["phases"]] == ["alignment", "parked"]
    assert holds["reference"]["rows"] == 5
    rest = holds["at_rest"]
    assert rest["size_f_m_s2"] == pytest.approx(rest["expected"]["f_m_s2"], abs=1e-3)
    assert rest["w_down_deg_h"] == pytest.approx(rest["expected"]["w_down_deg_h"], abs=0.2)
    assert rest["expected"]["w_down_deg_h"] == pytest.approx(
        -15.0411 * np.sin(np.radians(30)), abs=1e-3
    )
    assert len(result["sha256"]) == 64


def test_all_problems_are_listed_with_exit_code_3(path):
    set_cell(path / "imu.csv", row=10, column="dtheta_z_rad", value="nan")
    set_cell(path / "gnss.csv", row=4, column="lat_deg", value="91")
    set_cell(path / "reference.csv", row=2, column="time_s", value="0")
    edit_json(path, lambda data: data["site"].update(lat_deg=91))
    said = run_check(path, "--json")
    assert said.exit_code == 3
    result = json.loads(said.stdout)
    assert result["verdict"] == "bad_input" and result["sha256"] is None
    assert {p["text"].split(":")[0] for p in result["problems"]} == {
        "imu.csv",
        "gnss.csv",
        "reference.csv",
        "run.json",
    }
    quiet = run_check(path, "-q")
    assert quiet.exit_code == 3 and quiet.stdout == ""
    assert len(quiet.stderr.splitlines()) == 4


def test_a_missing_run(tmp_path):
    said = run_check(tmp_path / "nowhere", "--json")
    assert said.exit_code == 3
    assert "no such run directory" in json.loads(said.stdout)["problems"][0]["text"]


def test_another_serial_is_bad_input(path):
    assert run_check(path, "--serial", "SN-0042").exit_code == 0
    said = run_check(path, "--serial", "SN-0043")
    assert said.exit_code == 3
    assert "needed 'SN-0043'" in said.stdout


def put(values, rows, column, value):
    values[rows, column] = value
    return values


THERMOMETERS = [
    (lambda t, T: put(T, slice(100, 200), 1, 30.5), "gyro_y_degC is stuck at 30.5"),
    (lambda t, T: np.round(T), "gyro_x_degC has steps of 1 degC"),
    (lambda t, T: put(T, slice(200, None), 2, T[200:, 2] + 12), "gyro_z_degC jumps by +12.0"),
    (lambda t, T: put(T, slice(50, 53), 0, 0.0), "gyro_x_degC is exactly 0 in 3 rows"),
    (lambda t, T: 1.8 * T + 32, "degC: Fahrenheit?"),
    (lambda t, T: T + 273.15, "needed degC: kelvin?"),
]


@pytest.mark.parametrize(("change", "line"), THERMOMETERS)
def test_thermometer_faults_are_named(path, change, line):
    temperatures(path, change)
    assert any(line in text for text in warnings(path)), warnings(path)
    assert run_check(path).exit_code == (3 if "kelvin" in line else 0)


def shift_times(path, by_s):
    rows = lines(path)
    put_lines(path, [rows[0], *([repr(float(r[0]) + by_s), *r[1:]] for r in rows[1:])])


def test_other_oddities_are_warned_of(path):
    shift_times(path / "imu.csv", 10770.0)
    shift_times(path / "gnss.csv", 10770.0)
    shift_times(path / "odometer.csv", 10770.0)
    edit_json(path, lambda data: (data.update(weather="rain"), data.pop("applied_table_sha256")))
    edit_json(path, lambda data: data["site"].update(lon_deg=9.5))
    (path / "temprature.csv").write_text("a typing error")
    text = "\n".join(warnings(path))
    for part in (
        "imu: time_s starts at 10770",
        "temperature: time_s 0 to 39 s, imu 10770",
        "unknown key weather, not used",
        "applied_table_sha256 is missing, taken as null",
        "temprature.csv: not part of a run",
        "2.500 in longitude off",
    ):
        assert part in text, part


def test_jitter_is_reported_and_warned_of(path):
    rows = lines(path / "imu.csv")
    rng = np.random.default_rng(1)
    time_s = np.arange(1, 4001) * 0.01 + 0.002 * rng.uniform(-1, 1, 4000)
    put_lines(
        path / "imu.csv", [rows[0], *([repr(float(t)), *r[1:]] for t, r in zip(time_s, rows[1:]))]
    )
    result = check(path)
    assert 0.2 < result["holds"]["imu"]["jitter"] < 0.4
    assert any("time stamps jitter by" in p["text"] for p in result["problems"])


def test_a_run_that_never_rests_is_said_so(path):
    rows = lines(path / "imu.csv")
    raw = np.array(rows[1:], dtype=float)
    raw[:, 4] += 0.01 * 2.0 * np.sin(2 * np.pi * 0.05 * raw[:, 0])
    put_lines(path / "imu.csv", [rows[0], *([repr(v) for v in row] for row in raw.tolist())])
    assert any("first 600 s" in text for text in warnings(path))


def test_a_start_in_the_future_is_named_with_both_times(path):
    edit_json(path, lambda data: data.update(start_utc="2136-03-01T05:00:00Z"))
    said = check(path)
    assert said["verdict"] == "bad_input"
    (problem,) = said["problems"]
    assert problem["level"] == "suspect" and "2136-03-01T05:00:00Z" in problem["text"]


def test_temperatures_that_outlast_the_imu_are_of_another_run(tmp_path):
    """A session of 2,150 s beside temperatures of 3,600 s; those of 2,300 s may be its own."""
    run = simulated(seed=1).run
    log = run.temperature
    for until_s, named in ((2300.0, False), (3600.0, True)):
        time_s = np.arange(0.0, until_s)
        degC = 20.0 + 10.0 * (1.0 - np.exp(-time_s / 1800.0))
        degC = degC + 0.01 * np.random.default_rng(3).standard_normal((3, time_s.size))
        other = replace(
            log,
            time_s=time_s,
            gyro_degC=degC.T,
            accel_degC=None,
            block_degC=None,
            gradient_degC=None,
            ambient_degC=None,
        )
        folder = tmp_path / f"until-{until_s:g}"
        write_run(folder, replace(run, temperature=other))
        found = [p for p in check(folder)["problems"] if "another run" in p["text"]]
        assert bool(found) == named
        assert all(p["level"] == "suspect" for p in found)
