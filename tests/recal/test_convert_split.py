"""`recal convert --split`: a run for each stretch of a log between its gaps."""

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from ins.records import InputError
from recal.cli.logs import convert as command
from tests.trajectories.run_cases import F_B, W_B
from trajectories.runs.directory import read_run

RATE_HZ = 50.0
MAP = """
[time]
column = "t"
[gyro]
columns = ["wx", "wy", "wz"]
unit = "rad/s"
[accel]
columns = ["fx", "fy", "fz"]
unit = "m/s2"
[axes]
x = "x"
y = "y"
z = "z"
[run]
imu_serial = "SN-1"
gyro_technology = "rlg"
start_utc = "2026-01-01T00:00:00Z"
[run.site]
lat_deg = 30.0
lon_deg = 7.0
height_m = 250.0
"""
app = typer.Typer()
app.command()(command)


@pytest.fixture
def invoke(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.toml").write_text(MAP)

    def run(*arguments):
        return CliRunner().invoke(app, ["log.csv", "--map", "map.toml", "--split", *arguments])

    return run


def write_log(path, *spans):
    """A parked log of rows within these spans [s]."""
    t = np.concatenate([np.arange(a, b, 1.0 / RATE_HZ) for a, b in spans])
    rng = np.random.default_rng(3)
    w = W_B + 1e-7 * rng.standard_normal((t.size, 3))
    f = F_B + 1e-4 * rng.standard_normal((t.size, 3))
    rows = np.column_stack([t, w, f])
    np.savetxt(path, rows, delimiter=",", header="t,wx,wy,wz,fx,fy,fz", comments="")


def test_each_stretch_becomes_a_run(invoke, tmp_path):
    """Forty and sixty seconds between gaps, and three that are too short: told, and no run."""
    write_log(tmp_path / "log.csv", (100.0, 140.0), (150.0, 153.0), (160.0, 220.0))
    result = invoke("-o", "runs", "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["schema"] == "recal.convert_split/1"
    assert [r["run"].replace("\\", "/") for r in found["runs"]] == ["runs/run-1", "runs/run-2"]
    assert [r["run_id"] for r in found["runs"]] == ["log-1", "log-2"]
    assert [round(r["duration_s"]) for r in found["runs"]] == [40, 60]
    (short,) = found["left_out"]
    assert short["from_s"] == 150.0 and "needed 10 s" in short["why"]
    assert read_run(tmp_path / "runs" / "run-2").imu.rows == 60 * RATE_HZ
    again = invoke("-o", "runs")  # the same log: its own runs may be replaced
    assert again.exit_code == 0 and "150.000" in again.output


def test_a_log_without_gaps_is_one_run(invoke, tmp_path):
    write_log(tmp_path / "log.csv", (0.0, 40.0))
    assert invoke("-o", "runs", "--run-id", "A").exit_code == 0
    assert [p.name for p in (tmp_path / "runs").iterdir()] == ["run-1"]
    assert read_run(tmp_path / "runs" / "run-1").header.run_id == "A-1"


def test_other_recordings_are_not_replaced(invoke, tmp_path):
    write_log(tmp_path / "log.csv", (0.0, 40.0))
    assert invoke("-o", "runs").exit_code == 0
    write_log(tmp_path / "log.csv", (0.0, 41.0))
    refused = invoke("-o", "runs")
    assert isinstance(refused.exception, InputError) and "run-1" in str(refused.exception)


def test_no_stretch_long_enough_is_named(invoke, tmp_path):
    write_log(tmp_path / "log.csv", (0.0, 5.0), (10.0, 16.0))
    refused = invoke("-o", "runs")
    assert isinstance(refused.exception, InputError)
    assert "--from-s" in str(refused.exception)
