"""Files that somebody else sends: runs, tables, twins, scenarios and maps, damaged or made to harm;
each costs one clear line.

What a fuzz of run directories found, and limits: depth, size, growth when unpacked, rows a byte,
paths that leave their folder.
"""

import gzip
import json
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import typer
from typer.testing import CliRunner

from infield.table.file import read_table_dict
from ins.documents import to_json
from ins.json_file import MAX_DEPTH, MAX_JSON_BYTES, read_json_object, read_toml
from ins.records import InputError
from ins.twin_file import read_twin, table_path, twin_to_dict
from recal.cli.diagnose import command as diagnose_command
from recal.service.check import check as check_run
from recal.service.inputs.unit_inputs import TwinModel
from tests.recal.verbs import check
from tests.trajectories.readers import damage
from tests.trajectories.run_cases import csv_run, full_run, imu_log, reference_log
from trajectories.runs import limits
from trajectories.runs.directory import read_run, write_run
from trajectories.simulator.scenario import read_scenario

NORMAL, LONG = 5, 300  # mutations of each file
FORMATS = ("csv", "parquet", "csv.gz")
SHORT = {"imu": imu_log(seconds=12)}


def short_run(path: Path, fmt: str = "csv") -> Path:
    write_run(path, full_run(**SHORT), reference=reference_log(), fmt=fmt)
    return path


# Run directories


def judged(run: Path) -> str:
    """The verdict of `check`, which never raises; `read_run` agrees with it."""
    with damage.bounded():
        result = check(run)
        lines = check_run(run).lines()
        assert all("\n" not in line for line in lines) and json.loads(to_json(result))
        try:
            read_run(run)
        except InputError as error:
            assert result["verdict"] == "bad_input" and "\n" not in str(error)
    return result["verdict"]


def fuzzed(run: Path, count: int, seed: int) -> dict[str, dict[str, int]]:
    out: dict[str, dict[str, int]] = {}
    for file in sorted(run.iterdir()):
        data, counts = file.read_bytes(), dict.fromkeys(("ok", "warnings", "bad_input"), 0)
        for k in range(count):
            file.write_bytes(damage.damaged(data, np.random.default_rng([seed, k])))
            try:
                counts[judged(run)] += 1
            except Exception as error:
                raise AssertionError(
                    f"{file.name}: seed {seed}, mutation {k}: {type(error).__name__}: {error}"
                ) from error
        file.write_bytes(data)
        out[file.name] = counts
    return out


@pytest.mark.parametrize("fmt", FORMATS)
def test_damaged_runs_are_judged(tmp_path, fmt):
    fuzzed(short_run(tmp_path / "run", fmt), NORMAL, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("fmt", FORMATS)
def test_many_damaged_runs_are_judged(tmp_path, fmt):
    """Prints the verdicts; run with `-m slow -s`."""
    print(f"\n{fmt}: {fuzzed(short_run(tmp_path / 'run', fmt), LONG, seed=2)}")


def imu_columns(rows: int = 400) -> dict:
    return dict(zip(damage.COLUMNS, damage.table(rows).T))


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (
            {"gyro_x_rad_s": lambda v: v.astype(str)},
            "column gyro_x_rad_s holds string, needed float64",
        ),
        ({"gyro_x_rad_s": lambda v: [[x] for x in v]}, "column gyro_x_rad_s holds list"),
        ({"time_s": lambda v: v * 1e308}, "column time_s: got inf"),
        ({"accel_z_m_s2": lambda v: v * 1e300}, "column accel_z_m_s2: got -9.79"),
        ({"time_s": lambda v: (v * 100).astype("datetime64[s]")}, "column time_s holds timestamp"),
        ({"gyro_y_rad_s": lambda v: v > 0}, "column gyro_y_rad_s holds bool"),
    ],
)
def test_wrong_types_and_huge_numbers(tmp_path, change, line):
    run = short_run(tmp_path / "run", "parquet")
    with np.errstate(over="ignore"):
        columns = {
            name: change[name](v) if name in change else v for name, v in imu_columns().items()
        }
    pq.write_table(pa.table(columns), run / "imu.parquet")
    assert judged(run) == "bad_input"
    assert any(line in p["text"] for p in check(run)["problems"])


def test_a_parquet_of_more_rows_than_its_bytes_can_hold(tmp_path, monkeypatch):
    """2e6 zeros in some kilobytes; the limit is lowered so that no larger file is needed."""
    run = short_run(tmp_path / "run", "parquet")
    rows = 2_000_000
    pq.write_table(
        pa.table({name: np.zeros(rows) for name in damage.COLUMNS}),
        run / "imu.parquet",
        compression="zstd",
    )
    monkeypatch.setattr(limits, "SMALL_BYTES", 1000)
    assert (run / "imu.parquet").stat().st_size < 80_000
    assert judged(run) == "bad_input"
    assert any(f"bytes in {rows} rows unpacked" in p["text"] for p in check(run)["problems"])


def test_a_gzip_that_grows_without_end(tmp_path, monkeypatch):
    """A thousandfold; again with a lowered limit."""
    monkeypatch.setattr(limits, "SMALL_BYTES", 1 << 20)
    run = short_run(tmp_path / "run", "csv.gz")
    head = gzip.decompress((run / "imu.csv.gz").read_bytes()).split(b"\n")
    row = b"0.01," + b"0" * 900_000 + b",0,0,0,0,-0.1\n"
    with gzip.open(run / "imu.csv.gz", "wb") as packed:
        packed.write(head[0] + b"\n")
        for _ in range(30):
            packed.write(row)
    assert 30 * len(row) > limits.MAX_GROWTH * (run / "imu.csv.gz").stat().st_size
    assert judged(run) == "bad_input"
    assert any("--max-unpacked-mb" in p["text"] for p in check(run)["problems"])


def test_files_that_are_none(tmp_path):
    """A pipe would be waited for, a link followed, a directory opened."""
    for name, make in {
        "pipe": lambda path: os.mkfifo(path),
        "link": lambda path: path.symlink_to("/etc/passwd"),
        "folder": lambda path: path.mkdir(),
        "loop": lambda path: path.symlink_to(path.name),
    }.items():
        for file in ("run.json", "gnss.csv", "phases.csv"):
            run = csv_run(tmp_path / f"{name}-{file}")
            (run / file).unlink()
            make(run / file)
            assert judged(run) == "bad_input", (name, file)
            assert "root:" not in to_json(check(run))


# JSON and TOML


DEEP = 100_000


@pytest.mark.parametrize("depth", [MAX_DEPTH + 1, 900, DEEP])
def test_deep_json(tmp_path, depth):
    path = tmp_path / "a.json"
    path.write_text('{"a": [[[[[[[1]]]]]]]}')
    assert read_json_object(path)["a"] == [[[[[[[1]]]]]]]
    for deep in ('{"a": ' + "[" * depth + "]" * depth + "}", '{"a":' * depth + "1" + "}" * depth):
        path.write_text(deep)
        with pytest.raises(InputError, match=r"a\.json"):
            read_json_object(path)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * DEEP + "]" * DEEP,
        ".".join("a" * 2000) + " = 1",
        "[" + ".".join("ab" * 500) + "]",
    ],
    ids=[*"abc"],
)
def test_deep_toml(tmp_path, text):
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"a\.toml"):
        read_toml(path)
    with pytest.raises(InputError, match=r"a\.toml: (not valid TOML|\d+ bytes)"):
        read_scenario(path)


def table_dict() -> dict:
    axis = {
        "temperature_degC": [0.0, 20.0, 40.0],
        "bias_deg_h": [0.01, 0.02, 0.03],
        "sigma_deg_h": [0.01, 0.01, 0.01],
    }
    return {
        "schema": "recal.table/1",
        "imu_serial": "SN-1",
        "gyro_technology": "rlg",
        "created_utc": "2026-03-01T05:00:00Z",
        "interpolation": "linear",
        "axes": {k: axis for k in "xyz"},
        "covariance": None,
        "provenance": {"parent_sha256": None, "runs": []},
    }


WILD = (
    None,
    True,
    [],
    {},
    "",
    "x" * 300,
    10**400,
    -1,
    1e308,
    0.5,
    [1e308] * 3,
    {"a": 1},
    "\x1b[31m",
    [[1.0]],
    "2026-99-99",
)


def replaced(value, rng):
    """The value with one part of it, somewhere, replaced by something else, taken out, or with
    something added.
    """
    if isinstance(value, dict) and value and rng.random() < 0.8:
        key = list(value)[rng.integers(len(value))]
        if rng.random() < 0.15:
            return {k: v for k, v in value.items() if k != key}
        if rng.random() < 0.1:
            return {**value, "unheard": 1}
        return {**value, key: replaced(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.7:
        k = rng.integers(len(value))
        return [*value[:k], replaced(value[k], rng), *value[k + 1 :]]
    return WILD[rng.integers(len(WILD))]


@pytest.mark.parametrize("read", [read_table_dict, read_twin], ids=["table", "twin"])
def test_tables_and_twins_with_anything_in_them(tmp_path, read):
    whole = (
        table_dict()
        if read is read_table_dict
        else twin_to_dict(TwinModel(imu_serial="SN-1", table="table.json"))
    )
    path, refused = tmp_path / "a.json", 0
    for k in range(160):
        rng = np.random.default_rng([7, k])
        path.write_text(json.dumps(replaced(whole, rng)))
        if k % 2:
            path.write_bytes(damage.damaged(path.read_bytes(), rng))
        try:
            read(path)
        except InputError as error:
            refused += 1
            assert str(error).startswith(str(path))
            assert "\n" not in str(error)
            assert "\x1b" not in str(error)
    assert 80 < refused < 160


# Paths


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "/etc/passwd", "inside/../../table.json", "link.json", "a\0b"]
)
def test_a_twin_opens_nothing_but_its_own_table(tmp_path, name):
    """Read, the first line of such a file would be shown in the complaint about it."""
    folder = tmp_path / "twin"
    folder.mkdir()
    (folder / "link.json").symlink_to("/etc/passwd")
    twin = TwinModel(imu_serial="SN-1", table=name, source="twin.json")
    with pytest.raises(InputError, match="leaves the folder of the twin"):
        table_path(twin, folder)
    own = TwinModel(table="tables/t.json")
    with pytest.raises(InputError, match=r"'tables/t\.json'"):
        table_path(own, folder)
    (folder / "tables").mkdir()
    (folder / "tables" / "t.json").touch()
    assert table_path(own, folder) == folder / "tables/t.json"
    (folder / "twin.json").write_text(json.dumps(twin_to_dict(twin)))
    app = typer.Typer()
    app.command()(diagnose_command)
    run = csv_run(tmp_path / "run")
    said = CliRunner().invoke(
        app, [str(run), "--twin", str(folder / "twin.json"), "-o", str(tmp_path / "out")]
    )
    assert isinstance(said.exception, InputError) and "leaves the folder" in str(said.exception)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('{"a": 1' + "0" * 5000 + "}", "not valid JSON"),
        ('{"\\ud800": 1}', "half a character in a text"),
        ('{"a": ["\\udfff"]}', "half a character in a text"),
        ('{"a": NaN}', "NaN is not a number in JSON"),
        ('{"a": 1, "a": 2}', "appears twice"),
        ("[1]", "needed an object"),
        ('"' + "a" * 10, "not valid JSON"),
        ("\x00", "not valid JSON"),
        ('{"a": "' + "b" * MAX_JSON_BYTES + '"}', f"more than {MAX_JSON_BYTES} bytes"),
    ],
)
def test_odd_json(tmp_path, text, line):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=line):
        read_json_object(tmp_path / "a.json")
