"""Reading an imu stream in pieces: the same bits, faults, lines and hash as reading it whole,
however it is cut.
"""

import gzip
from dataclasses import replace
from functools import partial

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from alignment.motion.inertial import first_rest
from alignment.motion.seconds import seconds_of
from ins.columns import INCREMENT_COLUMNS, RATE_COLUMNS
from ins.records import ImuLog, InputError
from ins.strapdown.compensation import CorrectedImu, compensate, corrected
from tests.trajectories.run_cases import csv_run, imu_log
from trajectories.runs import directory as run_module
from trajectories.runs import stream_files
from trajectories.runs.checks import Findings
from trajectories.runs.directory import read_run, run_sha256
from trajectories.runs.imu_scan import Intervals
from trajectories.runs.imu_stream import ImuFile, jitter, load_imu
from trajectories.runs.stream_files import StreamFile, write_columns

ROWS = 1200
CUTS = [1, 2, 3, 101, 593, 1183]  # rows a piece of 1184: leftovers of one row among them
FIELDS = ("time_s", "dt_s", "dtheta_rad", "dv_m_s")


def columns_of(kind: str = "increments", *, rows: int = ROWS) -> dict[str, np.ndarray]:
    """A parked log at 100 Hz with jitter, a late stamp and dropouts, one before the last row."""
    log = imu_log(seconds=rows / 100)
    time_s = log.time_s + 2e-4 * np.random.default_rng(3).uniform(-1, 1, rows)
    time_s[200] += 0.006
    keep = np.ones(rows, bool)
    keep[301:311] = keep[593:596] = keep[802] = keep[-3:-1] = False
    values = np.hstack([log.dtheta_rad, log.dv_m_s]) * (100.0 if kind == "rates" else 1.0)
    names = RATE_COLUMNS if kind == "rates" else INCREMENT_COLUMNS
    return {"time_s": time_s[keep], **{name: values[keep, k] for k, name in enumerate(names)}}


def opened(path, columns, *, held_rows=0, group_rows=None, **options):
    """The source and findings of a stream written to `path`."""
    if group_rows:
        pq.write_table(pa.table(columns), path, row_group_size=group_rows)
    else:
        write_columns(path, columns)
    return read_source(path, held_rows=held_rows, **options)


def read_source(path, *, held_rows=0, piece_rows=stream_files.PIECE_ROWS, block_bytes=1 << 22):
    findings = Findings()
    stream = StreamFile(path, held_rows=held_rows, block_bytes=block_bytes)
    try:
        source, faults = load_imu(stream, findings, held_rows=held_rows, piece_rows=piece_rows)
    except InputError as error:
        return None, [], [str(error), *stream.notes]
    return source, faults, [item.text for item in findings.items] + stream.notes


def assert_same(a: ImuLog, b: ImuLog) -> None:
    assert a.source == b.source
    for name in FIELDS:
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), name


def joined(pieces) -> ImuLog:
    pieces = list(pieces)
    assert min(piece.rows for piece in pieces) >= 2
    return ImuLog(
        **{k: np.concatenate([getattr(p, k) for p in pieces]) for k in FIELDS},
        source=pieces[0].source,
    )


@pytest.mark.parametrize("kind", ["increments", "rates"])
@pytest.mark.parametrize("ending", ["parquet", "csv", "csv.gz"])
def test_pieces_hold_the_bits_of_the_whole(tmp_path, kind, ending):
    columns = columns_of(kind)
    path = tmp_path / f"imu.{ending}"
    whole, faults, lines = opened(path, columns, held_rows=10**6)
    assert isinstance(whole, ImuLog) and lines == [] and len(faults) == 4
    # of one and two rows each reading of all takes a second: test_the_hash_and_the_run_are_the_same
    for cut in CUTS[2:]:
        source, same_faults, lines = read_source(path, piece_rows=cut, block_bytes=cut * 80)
        assert isinstance(source, ImuFile) and same_faults == faults and lines == []
        assert source.rows == whole.rows
        assert source.start_s == whole.start_s
        assert source.end_s == whole.end_s
        assert source.rate_hz == whole.rate_hz and jitter(source) == jitter(whole)
        assert_same(source.whole(), whole)
        assert_same(joined(source.pieces()), whole)
        spans = [
            (3.0, 3.2),
            (whole.time_s[592], whole.time_s[594]),
            (-1.0, 0.1),
            (11.0, 99.0),
            (5.0, 11.37),
        ]
        # about the dropouts
        for start, end in spans if cut > 3 else spans[:2]:
            assert_same(source.between(start, end), whole.between(start, end))
            assert_same(joined(source.pieces(start, end)), whole.between(start, end))
        assert list(source.pieces(50.0, 60.0)) == []


def test_a_log_in_memory_comes_in_pieces_of_two_rows_or_more(monkeypatch):
    log = imu_log()
    monkeypatch.setattr("ins.records.PIECE_ROWS", 1333)
    assert [p.rows for p in log.pieces()] == [1333, 1333, 1334]
    assert_same(joined(log.pieces(3.0, 17.0)), log.between(3.0, 17.0))
    assert list(log.pieces(50.0, 60.0)) == []


@pytest.mark.parametrize("cut", CUTS)
def test_the_hash_and_the_run_are_the_same(tmp_path, cut, monkeypatch):
    path = csv_run(tmp_path / "run")
    write_columns(path / "imu.csv", columns_of())
    held = read_run(path)
    monkeypatch.setattr(run_module, "load_imu", partial(load_imu, piece_rows=cut))
    left = read_run(path, held_rows=100)
    assert isinstance(held.imu, ImuLog) and isinstance(left.imu, ImuFile)
    assert left.imu.piece_rows == cut
    assert left.sha256 == held.sha256 == run_sha256(replace(held, imu=held.imu.whole()))
    assert left.faults == held.faults


def regular_columns(rows: int = ROWS) -> dict[str, np.ndarray]:
    log = imu_log(seconds=rows / 100)
    return dict(
        zip(
            ("time_s", *INCREMENT_COLUMNS),
            [c.copy() for c in (log.time_s, *log.dtheta_rad.T, *log.dv_m_s.T)],
        )
    )


def back(columns, row):
    columns["time_s"][row] = columns["time_s"][row - 2]


def repeat(columns, row):
    columns["time_s"][row] = columns["time_s"][row - 1]


def gap(columns, row):
    columns["time_s"][row:] += 3.0


def hole(columns, row):
    columns["dtheta_y_rad"][row] = np.nan
    columns["dv_x_m_s"][row : row + 3] = np.inf


def no_time(columns, row):
    columns["time_s"][row] = np.nan


def half_rate(columns, row):
    columns["time_s"][row:] = columns["time_s"][row] + 0.02 * np.arange(
        columns["time_s"].size - row
    )


@pytest.mark.parametrize("damage", [back, repeat, gap, hole, no_time, half_rate])
def test_a_fault_at_a_border_is_named_as_in_the_whole(tmp_path, damage):
    """Row 601 (index 600) begins one of 300, ends one of 601, and stands alone in pieces of 1."""
    for row in (600, 2, 1199):
        columns = regular_columns()
        damage(columns, row)
        path = tmp_path / f"imu{row}.parquet"
        _, _, lines = opened(path, columns, held_rows=10**6)
        assert lines or (damage, row) in ((half_rate, 1199), (half_rate, 2))
        assert not lines or damage is half_rate or f"row {row + 1}" in lines[0]
        for cut in (1, 300, 599, 600, 601) if row == 600 else (300, 601):
            assert read_source(path, piece_rows=cut)[2] == lines


def test_a_rate_change_is_named_at_its_row(tmp_path):
    columns = regular_columns(4000)
    half_rate(columns, 2000)
    _, _, lines = opened(tmp_path / "imu.parquet", columns, piece_rows=1000)
    assert len(lines) == 1
    assert "row 2001: rate changes" in lines[0]


def cut_off(text):
    return text[:-9]


def broken_last(text):
    return text + b"1.5,2\n"


def broken_last_and_cut(text):
    return text + b"1.5,2\n0.3,0.2"


def blank_lines(text):
    return text.replace(b"\n0.02,", b"\n\n0.02,") + b"\n \n\n"


def windows(text):
    return text.replace(b"\n", b"\r\n")


def broken_inside(text):
    lines = text.split(b"\n")
    lines[300] = b"12.5,abc,0,0,0,0,0"
    return b"\n".join(lines)


def broken_before_the_last(text):
    return text + b"1.5,2\n" + text.split(b"\n")[1].replace(b"0.01,", b"99.0,") + b"\n"


@pytest.mark.parametrize(
    "change",
    [
        cut_off,
        broken_last,
        broken_last_and_cut,
        blank_lines,
        windows,
        broken_inside,
        broken_before_the_last,
    ],
)
@pytest.mark.parametrize("packed", [False, True])
def test_text_says_the_same_in_blocks(tmp_path, change, packed):
    path = tmp_path / "imu.csv"
    write_columns(path, regular_columns(310))
    text = change(path.read_bytes())
    path.write_bytes(text)
    if packed:
        path = tmp_path / "imu.csv.gz"
        data = gzip.compress(text, mtime=0)
        path.write_bytes(data[:-40] if change is cut_off else data)
    whole, _, lines = read_source(path, held_rows=10**6)
    for block_bytes in (1, 5000, 33_000):
        source, _, same = read_source(path, block_bytes=block_bytes, piece_rows=300)
        assert same == lines
        assert (source is None) == (whole is None)
        if whole is not None:
            assert_same(source.whole(), whole)
            assert_same(source.between(2.5, 3.5), whole.between(2.5, 3.5))


def test_a_line_without_end_is_refused(tmp_path):
    (tmp_path / "imu.csv").write_bytes(
        b"time_s," + b",".join(n.encode() for n in INCREMENT_COLUMNS) + b"\n" + b"1" * 5_000_000
    )
    _, _, lines = read_source(tmp_path / "imu.csv", block_bytes=1000)
    assert lines == ["imu.csv: a line of more than 1000000 bytes"]


def test_damaged_parquet_is_named(tmp_path):
    """Cut off: not a Parquet file. A flipped page: which column."""
    path = tmp_path / "imu.parquet"
    rng = np.random.default_rng(1)
    columns = {"time_s": imu_log().time_s} | {
        name: rng.standard_normal(4000) for name in INCREMENT_COLUMNS
    }
    pq.write_table(
        pa.table(columns), path, row_group_size=1000, compression="zstd", use_dictionary=False
    )
    data = path.read_bytes()
    meta = pq.ParquetFile(path).metadata.row_group(2).column(5)
    path.write_bytes(data[:-100])
    with pytest.raises(InputError, match=r"imu\.parquet"):
        StreamFile(path)
    at = meta.data_page_offset + 40
    path.write_bytes(data[:at] + bytes(50) + data[at + 50 :])
    for piece_rows in (100, 4000):
        _, _, lines = read_source(path, piece_rows=piece_rows)
        assert len(lines) == 1 and lines[0].startswith("imu.parquet: column dv_y_m_s: damaged")


def test_intervals_have_the_order_statistics_of_the_array():
    rng = np.random.default_rng(4)
    for size in (1, 2, 5, 400, 401):
        step = np.round(0.01 * (1 + 0.1 * rng.standard_normal(size)), 4)
        step[:: max(size // 3, 1)] += 0.02
        parts = [Intervals.of(part) for part in np.array_split(step, 3)]
        made = parts[0].joined(parts[1]).joined(parts[2])
        assert made.nominal_s == np.median(step)
        kept = step[step <= 1.5 * np.median(step)]
        assert made.jitter == pytest.approx(
            np.percentile(np.abs(kept / np.median(step) - 1), 99), rel=1e-12, abs=1e-15
        )


@pytest.mark.parametrize("cut", [50, 1000, 1001])
def test_the_first_rest_and_a_correction_do_not_see_the_pieces(tmp_path, cut):
    columns = columns_of(rows=12_000)
    moving = slice(0, 2500)
    columns["dv_x_m_s"][moving] += 0.01 * np.linspace(3.0, 0.0, 2500)
    whole, _, _ = opened(tmp_path / "imu.parquet", columns, held_rows=10**6)
    source, _, _ = read_source(tmp_path / "imu.parquet", piece_rows=cut)
    assert first_rest(seconds_of(source)) == first_rest(seconds_of(whole))
    assert first_rest(seconds_of(whole))[0] > 15.0

    def correct(piece):
        bias = 1e-6 * np.stack([np.sin(piece.time_s + k) for k in range(3)], axis=1)
        return compensate(
            piece,
            gyro_bias_rad_s=bias,
            gyro_scale_factor_ppm=(50.0, -20.0, 7.0),
            gyro_misalignment_mrad=(0.1, -0.2, 0.3, 0.4, -0.5, 0.6),
        )

    seen = corrected(source, correct)
    assert isinstance(seen, CorrectedImu)
    assert_same(joined(seen.pieces()), corrected(whole, correct))
    assert_same(seen.between(3.0, 9.0), corrected(whole, correct).between(3.0, 9.0))
    assert seen.rows == whole.rows
    assert seen.start_s == whole.start_s
    assert seen.end_s == whole.end_s
    assert seen.rate_hz == whole.rate_hz


def test_a_file_that_goes_away_is_bad_input(tmp_path):
    source, _, _ = opened(tmp_path / "imu.csv", columns_of())
    (tmp_path / "imu.csv").unlink()
    with pytest.raises(InputError, match=r"imu\.csv"):
        source.whole()
