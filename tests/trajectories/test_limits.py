"""What small files may ask of a machine: memory and time, whatever they say of themselves."""

import gzip
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

import recal
from ins.records import InputError
from tests.trajectories.run_cases import csv_run, full_run
from trajectories.readers.columns.layouts import read_columns
from trajectories.readers.columns.text_columns import text_columns
from trajectories.readers.registry import read_log
from trajectories.readers.rows.column_map import LayoutKeys, LogOptions
from trajectories.runs import limits
from trajectories.runs.directory import inspect_run, write_run
from trajectories.runs.limits import most_unpacked, unpack_limit
from trajectories.runs.stream_files import write_columns
from trajectories.runs.text_rows import text_size

ROOT = Path(recal.__file__).parent.parent
IMU = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
STREAMS = {
    "odometer": ("time_s,speed_m_s", "1,2"),
    "temperature": ("time_s,gyro_x_degC,gyro_y_degC,gyro_z_degC", "1,2,2,2"),
    "gnss": ("time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s", "1,2,2,2,0,0,0"),
    "phases": ("phase,start_s,end_s", "taxi,1,2"),
}
UNPACKED = 200_000_000  # bytes of text in some hundred kilobytes


def bomb(path, head, row):
    """A gzip file of equal members: it is written at once, and unpacks to UNPACKED bytes."""
    part = f"{row}\n".encode() * (1_000_000 // (len(row) + 1))
    member = gzip.compress(part)
    path.write_bytes(gzip.compress(f"{head}\n".encode()) + member * (UNPACKED // len(part)))
    assert path.stat().st_size < UNPACKED / 200


CHILD = """
import json, resource, sys
from pathlib import Path
from ins.records import InputError
from trajectories.readers.registry import read_log
from trajectories.readers.rows.column_map import LogOptions
from trajectories.runs.directory import inspect_run
said = []
for path in map(Path, sys.argv[1:]):
    try:
        if path.is_dir():
            said.append([line for line in inspect_run(path).errors if "needed at most" in line])
        else:
            read_log(path, LogOptions({}))
            said.append([])
    except InputError as error:
        said.append([str(error)])
peak = [line for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line]
print(json.dumps([said, int(peak[0].split()[1]) / 1000]))
"""


def test_files_that_unpack_to_much_are_refused_and_take_no_memory(tmp_path):
    """Text, its rows as numbers, a matrix of bytes, the streams of a run directory, in one process
    whose largest resident memory is that of its libraries.
    """
    bomb(tmp_path / "log.csv.gz", IMU, "0,0,0,0,0,0,0")
    savemat(
        tmp_path / "log.mat",
        {"imu": {"t": np.zeros((9_000_000, 1), np.int8), "wb": np.zeros((9_000_000, 3), np.int8)}},
        do_compression=True,
    )
    paths = [tmp_path / "log.csv.gz", tmp_path / "log.mat"]
    for name, (head, row) in STREAMS.items():
        run = csv_run(tmp_path / name)
        for old in run.glob(f"{name}.*"):
            old.unlink()
        bomb(run / f"{name}.csv.gz", head, row)
        paths.append(run)
    done = subprocess.run(
        [sys.executable, "-c", CHILD, *map(str, paths)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    said, peak_mb = json.loads(done.stdout)
    for path, lines in zip(paths, said):
        assert len(lines) == 1 and "needed at most" in lines[0], (path.name, lines)
    assert peak_mb < 300.0


def test_parquet_columns_of_one_value(tmp_path):
    """Two million rows in a kilobyte; a word of a megabyte, named ten thousand times."""
    run = csv_run(tmp_path / "run")
    for name in ("odometer", "phases"):
        for old in run.glob(f"{name}.*"):
            old.unlink()
    zeros = np.zeros(18_000_000)
    pq.write_table(pa.table({"time_s": zeros, "speed_m_s": zeros}), run / "odometer.parquet")
    # without Arrow's schema the file says that the words are plain text
    words = pa.DictionaryArray.from_arrays(np.zeros(900, np.int32), ["x" * 1_000_000])
    table = pa.table({"phase": words, "start_s": zeros[:900], "end_s": zeros[:900]})
    pq.write_table(table, run / "phases.parquet", store_schema=False)
    said = " ".join(inspect_run(run).errors)
    assert "odometer.parquet" in said and "18000000 rows" in said
    assert "phases.parquet: column phase" in said


def test_the_limit_is_raised_by_an_option(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "SMALL_BYTES", 1000)
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(b"0,1\n" * 100_000))
    packed = path.stat().st_size
    assert most_unpacked(packed) == max(1000, limits.MAX_GROWTH * packed)
    with pytest.raises(InputError, match=r"^a.csv.gz: .* \(recal --max-unpacked-mb raises it\)$"):
        text_size(path, 2)
    with unpack_limit(1), pytest.raises(InputError, match="needed at most 1000000"):
        text_size(path, 2)  # 400 kB of text, 1.6 MB of numbers
    with unpack_limit(2):
        assert text_size(path, 2).lines == 100_000
    with pytest.raises(InputError):
        text_size(path, 2)
    for wrong in ("x", "0", "-1", "1e3", "10000000"):
        monkeypatch.setenv(limits.VARIABLE, wrong)
        with pytest.raises(InputError, match=f"{limits.VARIABLE}: got '{wrong}', needed 1 to"):
            most_unpacked(1)


@pytest.mark.parametrize("ending", ("csv", "csv.gz", "parquet"))
def test_what_is_held_in_memory_is_bounded(tmp_path, monkeypatch, ending):
    """Streams that are held whole, and the columns of a log; the increments of a run are read by
    pieces and may be longer.
    """
    run = tmp_path / "run"
    write_run(run, full_run(), fmt=ending)
    rows, columns = full_run().imu.rows, (*IMU.split(","), "late_s")
    log = tmp_path / f"log.{ending}"
    write_columns(log, {name: np.arange(1.0, rows + 1) for name in columns})
    layout = LayoutKeys(format="parquet" if ending == "parquet" else "csv")
    assert len(read_columns(log, layout, columns)[0]["late_s"]) == rows
    monkeypatch.setattr(limits, "HELD_BYTES", 40 * 3 * 8)  # the odometer's 40 rows of 2 fit
    assert inspect_run(run).streams.imu.rows == rows
    told = [f"{name}.{ending}: 40 or more rows of" for name in ("temperature", "gnss")]
    errors = inspect_run(run).errors
    assert len(errors) == 2 and all(map(str.startswith, errors, told))
    with pytest.raises(InputError, match=rf"^{log.name}: 4000 or more rows of 8 numbers"):
        read_columns(log, layout, columns)
    with unpack_limit(1):
        assert not inspect_run(run).errors
        assert len(read_columns(log, layout, columns)[0]["late_s"]) == rows


# Time by the length of a line


SHORT, LONG = 100_000, 1_000_000
SIGNS = [" ", "\t", " \t", "\r", " \r", ",", ", ", "#", "1", "-", '"', "PSINS", "FMT, 128,", "\x0b"]
MOST_RATIO = 40.0  # of the times of ten times the length: linear 10, quadratic 100
LEAST_S = 0.05  # what the clock of a process tells from nothing on a busy machine


def cpu_s(read, path):
    start = time.process_time()
    try:
        read(path)
    except InputError as error:
        assert "\n" not in str(error)
    return time.process_time() - start


def as_columns(path):
    layout = LayoutKeys(format="text", comment="#", header_lines=1)
    text_columns(path, layout, IMU.split(","))


@pytest.mark.parametrize("read", [as_columns, lambda path: read_log(path, LogOptions({}))])
@pytest.mark.parametrize("sign", SIGNS, ids=range(len(SIGNS)))
def test_time_is_linear_in_the_length_of_a_line(tmp_path, sign, read):
    """A line of a megabyte of one sign, in the middle of a row."""
    taken = []
    for size in (SHORT, LONG):
        rows = [f"{k / 200:.3f} 0 0 0 0 0 -9.81" for k in range(200)]
        rows[100] = rows[100].replace(" ", " " + sign * (size // len(sign)), 1)
        path = tmp_path / f"log-{size}.txt"
        path.write_text(f"{IMU.replace(',', ' ')}\n" + "\n".join(rows) + "\n", newline="")
        taken.append(min(cpu_s(read, path) for _ in range(2)))
    assert taken[1] < MOST_RATIO * max(taken[0], LEAST_S)
