"""Largest resident memory and CPU time of `recal convert` and `recal check` on files that are made
to take a machine down.

    python benchmarks/reading_limits.py [--only NAME ...] [--folder FOLDER]

Each file is small and unpacks to much: gzip text, a MATLAB matrix, the streams of a run directory,
Parquet columns of one value, and lines that are long. Each command runs in a process of its own,
with its address space limited to ADDRESS_BYTES and its time to LIMIT_S; its ru_maxrss is the
figure. The rules: at most ALLOWED_MB plus twice the rows kept, and one line of error.
"""

import argparse
import gzip
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

ADDRESS_BYTES = 6_000_000_000
LIMIT_S = 180.0
ALLOWED_MB = 500.0
PART_ROWS = 100_000
COLUMNS = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
RUN_OPTIONS = (
    "--serial=SN-1 --technology=rlg --start-utc=2026-03-01T05:00:00Z --lat-deg=45 --lon-deg=7"
    " --height-m=250"
).split()

LAUNCH = """
import os, subprocess, sys, time
start = time.perf_counter()
child = subprocess.Popen(sys.argv[1:])
_, status, usage = os.wait4(child.pid, 0)
print(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0, os.waitstatus_to_exitcode(status))
"""


class Attack(NamedTuple):
    """A file: how it is made in a folder, and the arguments of `recal` that read it."""

    name: str
    make: Callable[[Path], None]
    arguments: tuple[str, ...]


class Use(NamedTuple):
    """What a command took, how it ended, and its last line."""

    cpu_s: float
    peak_mb: float
    code: int
    line: str


def gzipped(path: Path, head: str, parts: Iterator[bytes]) -> None:
    """Write a gzip file of a head line and parts of text."""
    with gzip.open(path, "wb", compresslevel=6) as file:
        file.write(f"{head}\n".encode())
        for part in parts:
            file.write(part)


def imu_rows(rows: int) -> Iterator[bytes]:
    """Text rows of an IMU whose values repeat every 5 rows, about 38 bytes each."""
    tail = [f",1e-05,{k}e-06,0,{k}.5,-0.01,-9.81\n" for k in range(5)]
    for first in range(0, rows, PART_ROWS):
        count = min(PART_ROWS, rows - first)
        yield "".join(f"{(first + k) / 200:.3f}{tail[k % 5]}" for k in range(count)).encode()


def constant_rows(row: str, rows: int) -> Iterator[bytes]:
    """The same row again and again."""
    part = (row + "\n").encode() * PART_ROWS
    for _ in range(rows // PART_ROWS):
        yield part


def csv_gz(rows: int) -> Callable[[Path], None]:
    """A compressed CSV of so many rows."""
    return lambda folder: gzipped(folder / "log.csv.gz", COLUMNS, imu_rows(rows))


def csv_zeros(rows: int) -> Callable[[Path], None]:
    """A compressed CSV of zeros."""
    return lambda folder: gzipped(
        folder / "log.csv.gz", COLUMNS, constant_rows("0,0,0,0,0,0,0", rows)
    )


def mat_bytes(rows: int) -> Callable[[Path], None]:
    """A MATLAB matrix `imu` of one-byte zeros, declared as doubles."""

    def make(folder: Path) -> None:
        import struct
        import zlib

        pack = zlib.compressobj(9)
        name = struct.pack("<HH4s", 1, 3, b"imu\0")
        size = rows * 7
        body = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, rows, 7) + name
        length = len(body) + 8 + size + (-size % 8)
        packed = pack.compress(struct.pack("<II", 14, length) + body + struct.pack("<II", 2, size))
        left = size + (-size % 8)
        for first in range(0, left, 1 << 20):
            packed += pack.compress(bytes(min(1 << 20, left - first)))
        packed += pack.flush()
        head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
        (folder / "log.mat").write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)

    return make


def run_stream(name: str, head: str, parts: Callable[[], Iterator[bytes]]) -> Callable:
    """A run directory of 20 s with one stream that is made to harm."""

    def make(folder: Path) -> None:
        from tests.trajectories.run_cases import full_run, imu_log
        from trajectories.runs.directory import write_run

        write_run(folder / "run", full_run(imu=imu_log(seconds=20)), fmt="csv")
        for old in (folder / "run").glob(f"{name}.*"):
            old.unlink()
        gzipped(folder / "run" / f"{name}.csv.gz", head, parts())

    return make


def parquet_stream(rows: int) -> Callable[[Path], None]:
    """A run directory whose odometer is a Parquet file of so many equal rows."""

    def make(folder: Path) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        run_stream("odometer", "time_s,speed_m_s", lambda: iter(()))(folder)
        (folder / "run" / "odometer.csv.gz").unlink()
        zeros = pa.array(np.zeros(rows))
        pq.write_table(
            pa.table({"time_s": zeros, "speed_m_s": zeros}), folder / "run" / "odometer.parquet"
        )

    return make


def long_line(sign: str, count: int, name: str = "log.txt") -> Callable[[Path], None]:
    """Rows of numbers between white space, one of them with a run of a sign in it."""

    def make(folder: Path) -> None:
        rows = [f"{k / 200:.3f} 0 0 0 0 0 -9.81" for k in range(1000)]
        rows[500] = rows[500].replace(" ", sign * count, 1)
        (folder / name).write_text(COLUMNS.replace(",", " ") + "\n" + "\n".join(rows) + "\n")
        named = COLUMNS.split(",")
        (folder / "map.toml").write_text(
            f'format = "text"\ntime = {{column = "time_s"}}\n'
            f'gyro = {{columns = {named[1:4]}, unit = "rad/s"}}\n'
            f'accel = {{columns = {named[4:]}, unit = "m/s2"}}\n'
        )

    return make


CONVERT = ("convert", "log.csv.gz", *RUN_OPTIONS)
TEXT = ("convert", "log.txt", "--map=map.toml", *RUN_OPTIONS)
CHECK = ("check", "run")
ODOMETER = "time_s,speed_m_s"
TEMPERATURE = "time_s,gyro_x_degC,gyro_y_degC,gyro_z_degC"
ATTACKS = (
    Attack("csv-900MB", csv_gz(24_000_000), CONVERT),
    Attack("csv-280MB", csv_gz(7_500_000), CONVERT),
    Attack("csv-zeros-280MB", csv_zeros(20_000_000), CONVERT),
    Attack("mat-36M-rows", mat_bytes(36_000_000), ("convert", "log.mat", *RUN_OPTIONS)),
    Attack(
        "odometer-75M-rows",
        run_stream("odometer", ODOMETER, lambda: constant_rows("1,2", 75_000_000)),
        CHECK,
    ),
    Attack(
        "phases-30M-rows",
        run_stream("phases", "phase,start_s,end_s", lambda: constant_rows("taxi,1,2", 30_000_000)),
        CHECK,
    ),
    Attack(
        "temperature-37M-rows",
        run_stream("temperature", TEMPERATURE, lambda: constant_rows("1,2,2,2", 37_000_000)),
        CHECK,
    ),
    Attack(
        "gnss-15M-rows",
        run_stream(
            "gnss",
            "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s",
            lambda: constant_rows("1,2,2,2,0,0,0", 15_000_000),
        ),
        CHECK,
    ),
    Attack("parquet-90M-rows", parquet_stream(90_000_000), CHECK),
    Attack("spaces-25k", long_line(" ", 25_000), TEXT),
    Attack("spaces-900k", long_line(" ", 900_000), TEXT),
)


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_BYTES, ADDRESS_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (int(LIMIT_S), int(LIMIT_S)))


def read(attack: Attack, folder: Path) -> Use:
    """Run `recal` on a file that is there."""
    more = ["-o", "out"] if attack.arguments[0] == "convert" else []
    command = [sys.executable, "-m", "recal", *attack.arguments, *more]
    done = subprocess.run(
        [sys.executable, "-c", LAUNCH, *command],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=10 * LIMIT_S,
        preexec_fn=_limited,
    )
    cpu_s, peak_mb, code = done.stdout.split()[-3:]
    said = (done.stderr or done.stdout).strip().splitlines()
    return Use(float(cpu_s), float(peak_mb), int(code), said[-1] if said else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=[])
    options = parser.parse_args()
    for attack in ATTACKS:
        if options.only and attack.name not in options.only:
            continue
        with tempfile.TemporaryDirectory() as folder:
            attack.make(Path(folder))
            files = [path for path in Path(folder).rglob("*") if path.is_file()]
            size_mb = sum(path.stat().st_size for path in files) / 1e6
            try:
                use = read(attack, Path(folder))
            except subprocess.TimeoutExpired:
                print(f"{attack.name:22s} {size_mb:7.2f} MB: more than {LIMIT_S:g} s", flush=True)
                continue
        print(
            f"{attack.name:22s} {size_mb:7.2f} MB: {use.cpu_s:6.1f} s CPU, {use.peak_mb:6.0f} MB,"
            f" exit {use.code}: {use.line[:150]}",
            flush=True,
        )


if __name__ == "__main__":
    main()
