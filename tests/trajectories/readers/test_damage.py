"""Every reader on damaged logs: a log of finite values in the order of time with what was dropped
named, or one InputError.
"""

from pathlib import Path

import numpy as np
import pytest

from ins.records import InputError
from tests.trajectories.readers import damage
from tests.trajectories.readers.damage import SAMPLES, Sample
from trajectories.readers.columns.imu_columns import converted
from trajectories.readers.registry import ConvertedLog, read_log, readers
from trajectories.readers.rows.column_map import LogOptions, column_map

pytestmark = pytest.mark.usefixtures("forked")
NORMAL, LONG = 10, 3000  # mutations of each sample
IDS = [s.name for s in SAMPLES]


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, tuple[bytes, ConvertedLog]]:
    """Bytes of each sample and the log in them."""
    out = {}
    for sample in SAMPLES:
        path = tmp_path_factory.mktemp("whole") / f"log{sample.suffix}"
        sample.write(path)
        out[sample.name] = (
            path.read_bytes(),
            read_log(path, LogOptions({"format": sample.reader, **sample.options}))[1],
        )
    return out


def test_every_reader_has_a_sample():
    assert {s.reader for s in SAMPLES} == {r.name for r in readers()}


@pytest.mark.parametrize("sample", SAMPLES, ids=IDS)
def test_the_samples_are_whole_and_known_by_content(whole, tmp_path, sample):
    data, log = whole[sample.name]
    assert damage.ROWS - 1 <= log.imu.rows <= damage.ROWS and log.faults == ()
    (tmp_path / f"log{sample.suffix}").write_bytes(data)
    detected = [r.name for r in readers() if r.detect(tmp_path / f"log{sample.suffix}")]
    assert detected[:1] == [sample.reader] or sample.reader in ("text", "binary", "mat")


def outcome(sample: Sample, path: Path, before: ConvertedLog, options: dict | None = None) -> str:
    """How a damaged log ends: "read", "told" or "refused". Fails on anything but a good log or one
    line that says why.
    """
    with damage.bounded():
        for reader in readers():
            assert reader.detect(path) in (True, False)
        try:
            own = {"format": sample.reader, **sample.options}
            _, log = read_log(path, LogOptions(own if options is None else options))
        except InputError as error:
            assert str(error) and "\n" not in str(error) and len(str(error)) < 1000
            return "refused"
    check_log(log)
    told = set(log.notes) - set(before.notes)
    # a late stamp before an early one is no hole
    dt = np.append(log.imu.dt_s, 1 / log.imu.rate_hz) * log.imu.rate_hz
    # rows lost at either end leave no trace in most formats
    hole = np.any((dt[1:-1] > 1.6) & (dt[1:-1] + dt[2:] > 2.6))
    assert not hole or told or log.faults, "rows are gone and nothing says so"
    return "told" if told or log.faults else "read"


def check_log(log: ConvertedLog) -> None:
    """Finite, plausible, in order; texts of one line."""
    imu = log.imu
    for values in (imu.time_s, imu.dt_s, imu.dtheta_rad, imu.dv_m_s):
        assert np.isfinite(values).all()
    assert np.all(np.diff(imu.time_s) > 0) and np.all(imu.dt_s > 0) and imu.dt_s.max() <= 1.0 + 1e-9
    # a stamp may be a little off
    over_s = np.maximum(imu.dt_s, np.median(imu.dt_s))[:, None] * (1 + 1e-9)
    assert np.all(np.abs(imu.dtheta_rad) <= damage.PLAUSIBLE_RAD_S * over_s)
    assert np.all(np.abs(imu.dv_m_s) <= damage.PLAUSIBLE_M_S2 * over_s)
    for stream in (log.gnss, log.temperature, log.odometer, log.reference):
        if stream is not None:
            assert np.isfinite(stream.time_s).all() and np.all(np.diff(stream.time_s) > 0)
            assert stream.time_s[0] >= 0 and stream.time_s[-1] <= imu.end_s + 1e-9
    if log.gnss is not None:
        assert np.isfinite(log.gnss.v_n_m_s).all() and np.all(np.abs(log.gnss.lat_rad) <= np.pi / 2)
    if log.temperature is not None:
        assert np.all((log.temperature.gyro_degC >= -60) & (log.temperature.gyro_degC <= 125))
    assert all("\n" not in text for text in (*log.notes, *(s.reason for s in log.faults)))


def mutations(
    sample: Sample, data: bytes, before: ConvertedLog, path: Path, count: int, seed: int
) -> dict:
    counts = dict.fromkeys(("read", "told", "refused"), 0)
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        path.write_bytes(damage.damaged(data, rng))
        try:
            counts[outcome(sample, path, before)] += 1
        except Exception as error:
            raise AssertionError(
                f"{sample.name}: seed {seed}, mutation {k}: {type(error).__name__}: {error}"
            ) from error
    return counts


@pytest.mark.parametrize("sample", SAMPLES, ids=IDS)
def test_damage_is_read_or_refused(whole, tmp_path, sample):
    mutations(sample, *whole[sample.name], tmp_path / f"log{sample.suffix}", NORMAL, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("sample", SAMPLES, ids=IDS)
def test_much_damage_is_read_or_refused(whole, tmp_path, sample):
    """Prints how the mutations ended; run with `-m slow -s`."""
    print(
        f"\n{sample.name}:"
        f" {mutations(sample, *whole[sample.name], tmp_path / f'log{sample.suffix}', LONG, seed=2)}"
    )


@pytest.mark.parametrize("sample", SAMPLES, ids=IDS)
def test_cut_off_at_every_share(whole, tmp_path, sample):
    """What is before the cut counts: never fewer rows for a later cut, where the format lets one
    read from the front.
    """
    data, before = whole[sample.name]
    rows = []
    for share in np.linspace(0.02, 0.98, 5):
        path = tmp_path / f"log{sample.suffix}"
        path.write_bytes(data[: int(share * len(data))])
        rows.append(_rows(sample, path, before))
    if sample.reader not in ("parquet", "ros") and "gz" not in sample.suffix:
        assert rows == sorted(rows)


def _rows(sample: Sample, path: Path, before: ConvertedLog) -> int:
    if outcome(sample, path, before) == "refused":
        return 0
    return read_log(path, LogOptions({"format": sample.reader, **sample.options}))[1].imu.rows


def test_the_guard_sees_hangs_and_memory(monkeypatch):
    monkeypatch.setattr(damage, "HANG_S", 1)
    with pytest.raises(damage.Hung), damage.bounded():
        while True:
            pass
    with pytest.raises(MemoryError), damage.bounded():
        np.ones(damage.MEMORY_BYTES // 4)


# Faults of rows: what a logger, a radio link or a careless export does, on the columns that every
# reader hands on


def noisy_columns(*, seconds: float = 20.0, seed: int = 8) -> dict[str, np.ndarray]:
    rows = damage.table(round(100 * seconds))
    rows[:, 1:4] += 0.1 * np.sin(rows[:, :1] * [1.0, 1.3, 1.7])  # no row is like another
    return dict(zip(damage.COLUMNS, rows.T.copy()))


def convert(columns: dict[str, np.ndarray]) -> ConvertedLog:
    log = converted(dict(columns), column_map(LogOptions(damage.NAMED)), label="log", notes=[])
    check_log(log)
    return log


def turned(log: ConvertedLog) -> np.ndarray:
    return log.imu.dtheta_rad.sum(axis=0)


@pytest.mark.parametrize("burst", [1, 8, 60])
def test_a_quarter_of_the_packets_lost(burst):
    """At random and in bursts: every hole is named, bridged, the span kept."""
    rng = np.random.default_rng(burst)
    columns = noisy_columns()
    whole = convert(columns)
    n = columns["time_s"].size
    starts = rng.choice(n // burst, size=n // burst // 4, replace=False) * burst
    lost = (starts[:, None] + np.arange(burst)).ravel()
    kept = np.setdiff1d(np.arange(n), lost[(lost > 0) & (lost < n - 1)])
    if np.max(np.diff(columns["time_s"][kept])) > 1.0:  # bursts that touch each other
        with pytest.raises(
            InputError, match=r"gap of 1\.\d+ s after row \d+ \(log time .*--from-s"
        ):
            convert({k: v[kept] for k, v in columns.items()})
        return
    log = convert({k: v[kept] for k, v in columns.items()})
    assert log.imu.end_s == pytest.approx(whole.imu.end_s)
    spans = [(s.start_s, s.end_s) for s in log.faults]
    assert sum(int(s.reason.split()[1]) for s in log.faults) == n - kept.size
    holes = log.imu.time_s[1:][log.imu.dt_s[1:] > 0.015]
    assert all(any(a < t <= b for a, b in spans) for t in holes)
    # 0.1 rad/s over each hole
    assert np.abs(turned(log) - turned(whole)).max() < 0.1 * burst * 0.01 * np.sqrt(n / burst)


@pytest.mark.parametrize(
    ("value", "why"), [(np.nan, "missing"), (1e38, "beyond"), (-np.inf, "missing"), (3e5, "beyond")]
)
def test_corrupt_rows_are_named_and_only_those_are_gone(value, why):
    columns = noisy_columns()
    rows = np.random.default_rng(5).choice(np.arange(1, 1999), size=15, replace=False)
    for k in rows:
        columns[damage.COLUMNS[1 + k % 6]][k] = value
    log = convert(columns)
    assert log.imu.rows == 2000 - 15
    assert any(f"dropped: {why}" in note for note in log.notes) and log.faults
    columns["gyro_x_rad_s"][:400] = value
    with pytest.raises(InputError, match=rf"rows are damaged \(first row 1: {why}"):
        convert(columns)
