"""Run directories: what is written comes back bit for bit, whole or not at all, and truth stays
apart.
"""

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ins.columns import RATE_COLUMNS, degrees_exact
from ins.records import FixType, InputError, Run
from ins.units import DEG
from tests.trajectories.run_cases import (
    F_B,
    SITE,
    W_B,
    csv_run,
    edit_json,
    full_run,
    header,
    imu_log,
    lines,
    put_lines,
    reference_log,
    set_cell,
)
from trajectories.runs import directory as run_module
from trajectories.runs.directory import FORMATS, read_reference, read_run, write_run
from trajectories.runs.stream_files import StreamFile, write_columns


def same(a, b) -> bool:
    """Equal to the last bit, field by field."""
    pairs = zip(vars(a).values(), vars(b).values())
    return all(np.array_equal(x, y) if isinstance(x, np.ndarray) else x == y for x, y in pairs)


@pytest.mark.parametrize("fmt", FORMATS)
def test_types_of_fixes_come_back_and_need_not_be_known(tmp_path, fmt):
    run = full_run()
    types = np.resize([FixType.SINGLE, np.nan, FixType.FIXED], run.gnss.time_s.size)
    write_run(tmp_path / "run", replace(run, gnss=replace(run.gnss, fix_type=types)), fmt=fmt)
    read = read_run(tmp_path / "run").gnss
    np.testing.assert_array_equal(read.fix_type, types)
    assert read.time_s.size == run.gnss.time_s.size


@pytest.mark.parametrize("fmt", FORMATS)
def test_written_runs_come_back_bit_for_bit(tmp_path, fmt):
    write_run(tmp_path / "first", full_run(), reference=reference_log(), fmt=fmt)
    first = read_run(tmp_path / "first")
    assert first.header == header()
    assert all(
        np.array_equal(getattr(first.imu, k), getattr(imu_log(), k))
        for k in ("time_s", "dtheta_rad", "dv_m_s")
    )
    assert same(first.temperature, full_run().temperature)
    assert first.phases == full_run().phases
    write_run(tmp_path / "second", first, fmt=fmt)
    second = read_run(tmp_path / "second")
    for stream in ("imu", "temperature", "gnss", "odometer"):
        assert same(getattr(first, stream), getattr(second, stream)), stream
    assert second.sha256 == first.sha256
    assert read_reference(tmp_path / "first").heading_rad[0] == pytest.approx(1.2, abs=1e-15)
    assert read_reference(tmp_path / "second") is None


def test_a_run_never_carries_its_reference(tmp_path):
    path = csv_run(tmp_path / "run")
    held = vars(read_run(path))
    assert not any("reference" in key for key in held)
    (path / "reference.csv").write_text("damaged")
    read_run(path)  # truth is not even opened
    with pytest.raises(InputError, match=r"reference\.csv"):
        read_reference(path)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False, width=64), min_size=1, max_size=20)
)
def test_no_digit_is_lost_in_a_stream_file(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("streams")
    for ending in ("parquet", "csv", "csv.gz"):
        path = folder / f"odometer.{ending}"
        write_columns(path, {"time_s": np.arange(len(values)) + 0.1, "speed_m_s": np.array(values)})
        assert StreamFile(path).column("speed_m_s").tobytes() == np.array(values).tobytes()


@settings(max_examples=200, deadline=None)
@given(
    st.integers(min_value=-360 * 10**8, max_value=360 * 10**8),
    st.floats(min_value=-360, max_value=360),
)
def test_degrees_of_a_file_survive_radians(typed, stored):
    """A typed decimal comes back as typed; any stored number gives the same radians again."""
    assert degrees_exact(typed / 1e8 * DEG) == typed / 1e8
    assert degrees_exact(stored * DEG) * DEG == stored * DEG


def test_missing_values_are_empty_in_csv_and_nan_in_memory(tmp_path):
    write_columns(
        tmp_path / "a.csv", {"time_s": np.array([1.0, 2.0]), "block_degC": np.array([np.nan, 20.5])}
    )
    assert (tmp_path / "a.csv").read_text() == "time_s,block_degC\n1,\n2,20.5\n"
    assert np.isnan(StreamFile(tmp_path / "a.csv").column("block_degC")[0])


def test_rates_are_means_over_the_interval_that_ends_at_their_time(tmp_path):
    path = csv_run(tmp_path / "run")
    rows = lines(path / "imu.csv")
    rates = [[row[0], *(repr(100.0 * float(v)) for v in row[1:])] for row in rows[1:]]
    put_lines(path / "imu.csv", [["time_s", *RATE_COLUMNS], *rates])
    imu = read_run(path).imu
    assert imu.source == "rates"
    assert imu.dt_s[0] == pytest.approx(0.01)
    np.testing.assert_allclose(imu.dtheta_rad, imu_log().dtheta_rad, rtol=1e-9)
    np.testing.assert_allclose(imu.dv_m_s.sum(axis=0), F_B * 40.0, atol=1e-3)


def test_uneven_rates_are_integrated_with_the_logged_interval(tmp_path):
    rng = np.random.default_rng(2)
    time_s = np.cumsum(0.01 * (1 + 0.05 * rng.uniform(-1, 1, 4000)))
    columns = {"time_s": time_s} | {n: np.full(4000, v) for n, v in zip(RATE_COLUMNS, [*W_B, *F_B])}
    path = csv_run(tmp_path / "run")
    (path / "imu.csv").unlink()
    write_columns(path / "imu.parquet", columns)
    imu = read_run(path).imu
    np.testing.assert_allclose(
        imu.dv_m_s[1:].sum(axis=0), F_B * (time_s[-1] - time_s[0]), rtol=1e-12
    )


def test_the_hash_knows_the_recording_not_its_packing(tmp_path):
    write_run(tmp_path / "a", full_run(), fmt="parquet")
    write_run(
        tmp_path / "b", full_run(header=header(run_id="R2", tail="other"), phases=()), fmt="csv"
    )
    put_lines(tmp_path / "b" / "imu.csv", [row[::-1] for row in lines(tmp_path / "b" / "imu.csv")])
    known = read_run(tmp_path / "a").sha256
    assert read_run(tmp_path / "b").sha256 == known
    set_cell(tmp_path / "b" / "temperature.csv", row=7, column="gyro_y_degC", value="20.0000001")
    assert read_run(tmp_path / "b").sha256 != known
    write_run(tmp_path / "c", full_run(header=header(imu_serial="SN-0043")))
    assert read_run(tmp_path / "c").sha256 != known


def test_a_failed_write_leaves_nothing_and_keeps_the_old_run(tmp_path, monkeypatch):
    write_run(tmp_path / "run", full_run())
    before = {p.name: p.read_bytes() for p in (tmp_path / "run").iterdir()}

    def full_disk(path, columns):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(run_module, "write_columns", full_disk)
    for name in ("run", "new"):
        with pytest.raises(InputError, match="No space left"):
            write_run(tmp_path / name, full_run(header=header(run_id="R9")))
    assert [p.name for p in tmp_path.iterdir()] == ["run"]
    assert {p.name: p.read_bytes() for p in (tmp_path / "run").iterdir()} == before


def test_the_old_run_comes_back_when_the_new_one_cannot_take_its_place(tmp_path, monkeypatch):
    write_run(tmp_path / "run", full_run())
    rename = Path.rename

    def failing(self, target):
        if self.parent == tmp_path and target == tmp_path / "run":
            raise OSError(5, "Input/output error")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(InputError, match="Input/output error"):
        write_run(tmp_path / "run", full_run(header=header(run_id="R2")))
    monkeypatch.undo()
    assert read_run(tmp_path / "run").header.run_id == "R1"
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_a_run_is_replaced_but_nothing_else_is(tmp_path):
    write_run(tmp_path / "run", full_run(), reference=reference_log())
    write_run(tmp_path / "run", full_run(header=header(run_id="R2"), gnss=None), fmt="csv")
    assert read_run(tmp_path / "run").header.run_id == "R2"
    found = sorted(p.name for p in (tmp_path / "run").iterdir())
    assert found == ["imu.csv", "odometer.csv", "phases.csv", "run.json", "temperature.csv"]
    assert [p.name for p in tmp_path.iterdir()] == ["run"]
    (tmp_path / "empty").mkdir()
    write_run(tmp_path / "empty", full_run())
    (tmp_path / "run" / "notes.txt").write_text("mine")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "imu.csv").write_text("mine")
    (tmp_path / "file").write_text("mine")
    for name, why in (
        ("run", "holds notes.txt"),
        ("photos", "holds no run.json"),
        ("file", "not a run directory"),
    ):
        with pytest.raises(InputError, match=why):
            write_run(tmp_path / name, full_run())
    assert (tmp_path / "file").read_text() == "mine"


def test_repaired_stretches_are_listed(tmp_path):
    """Lost rows, missing temperatures, fixes without a position: each is in faults."""
    path = csv_run(tmp_path / "run")
    rows = lines(path / "imu.csv")
    put_lines(path / "imu.csv", rows[:1001] + rows[1011:])
    set_cell(path / "temperature.csv", row=5, column="gyro_x_degC", value="")
    set_cell(path / "gnss.csv", row=8, column="vn_m_s", value="nan")
    set_cell(path / "gnss.csv", row=9, column="lat_deg", value="0")
    set_cell(path / "gnss.csv", row=9, column="lon_deg", value="0")
    read = read_run(path)
    reasons = {fault.reason: (fault.start_s, fault.end_s) for fault in read.faults}
    assert reasons["dropout: 10 imu rows lost"] == pytest.approx((10.0, 10.11))
    assert reasons["temperature: row 5 dropped, missing values"] == (4.0, 4.0)
    assert reasons["gnss: rows 8 to 9 dropped, missing values or position 0, 0"] == (7.0, 8.0)
    assert len(read.faults) == 3
    assert read.temperature.time_s.size == 39 and read.gnss.time_s.size == 38


def test_increments_cover_a_dropout(tmp_path):
    """Ten lost rows would be 1 m/s of lost gravity; a sum must not count twice."""
    path = csv_run(tmp_path / "run")
    rows = lines(path / "imu.csv")
    put_lines(path / "imu.csv", rows[:1001] + rows[1011:])
    lost = read_run(path).imu
    np.testing.assert_allclose(lost.dv_m_s.sum(axis=0), F_B * 40.0, atol=1e-3)
    np.testing.assert_allclose(lost.dtheta_rad.sum(axis=0), W_B * 40.0, atol=5e-6)
    summed = np.array(rows[1001:1012], dtype=float)[:, 1:].sum(axis=0)
    put_lines(
        path / "imu.csv", rows[:1001] + [[rows[1011][0], *map(repr, summed.tolist())]] + rows[1012:]
    )
    kept = read_run(path).imu
    np.testing.assert_allclose(kept.dv_m_s[1000], summed[3:], rtol=1e-15)


def test_a_cut_off_file_is_read_up_to_the_cut(tmp_path):
    path = csv_run(tmp_path / "run")
    text = (path / "imu.csv").read_bytes()
    (path / "imu.csv").write_bytes(text[:-9])  # in the middle of the last number
    assert read_run(path).imu.time_s.size == 3999
    (path / "imu.csv").unlink()
    packed = gzip.compress(text, mtime=0)
    (path / "imu.csv.gz").write_bytes(packed[: len(packed) // 2])
    imu = read_run(path).imu
    assert 1000 < imu.time_s.size < 3000
    assert np.array_equal(imu.dtheta_rad, imu_log().dtheta_rad[: imu.time_s.size])


def test_minimal_run(tmp_path):
    """Only what formats.md calls required, whole numbers as integers, survey absent."""
    path = tmp_path / "run"
    write_run(path, Run(header=header(), imu=imu_log(seconds=5)))
    site = {"lat_deg": 30, "lon_deg": 7, "height_m": 250}
    edit_json(
        path, lambda data: (data.pop("survey"), data.pop("gyro_mode"), data.update(site=site))
    )
    read = read_run(path)
    assert read.header.site == replace(SITE, sigma_lat_rad=0.5 * DEG)  # whole degrees
    assert read.temperature is None and read.gnss is None and read.phases == ()


@pytest.mark.parametrize("name", ("temperature", "gnss", "odometer"))
def test_a_row_without_its_time_is_dropped_and_named(tmp_path, name):
    path, without = csv_run(tmp_path / "a"), csv_run(tmp_path / "b")
    file = f"{name}.csv"
    for row in (1, 20, 40):
        set_cell(path / file, row=row, column="time_s", value="")
    rows = lines(without / file)
    put_lines(without / file, [rows[0], *rows[2:20], *rows[21:40]])
    found = read_run(path)
    log, clean = getattr(found, name), getattr(read_run(without), name)
    assert all(np.array_equal(v, getattr(clean, k), equal_nan=True) for k, v in arrays(log).items())
    spans = [(span.start_s, span.end_s) for span in found.faults]
    assert spans == [(1.0, 1.0), (19.0, 19.0), (38.0, 38.0)]
    assert all("no time_s" in span.reason for span in found.faults)


def arrays(log):
    return {key: value for key, value in vars(log).items() if isinstance(value, np.ndarray)}


def test_a_type_that_no_fix_has_is_refused_by_its_row(tmp_path):
    run = full_run()
    types = np.full(run.gnss.time_s.size, float(FixType.FLOAT))
    write_run(tmp_path / "run", replace(run, gnss=replace(run.gnss, fix_type=types)), fmt="csv")
    set_cell(tmp_path / "run" / "gnss.csv", row=4, column="fix_type", value="2")
    with pytest.raises(InputError, match=r"row 4.*line 5.*fix_type.*got 2.*needed 3"):
        read_run(tmp_path / "run")
