"""Every reader on damaged logs: a log of finite values in the order of time with what was dropped named, or one InputError."""

from pathlib import Path

import numpy as np
import pytest

from ins.records import InputError
from tests.trajectories.readers import damage
from tests.trajectories.readers.damage import SAMPLES, Sample
from trajectories.readers.registry import ConvertedLog, read_log, readers

NORMAL, LONG = 30, 3000  # mutations of each sample
IDS = [s.name for s in SAMPLES]


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, tuple[bytes, ConvertedLog]]:
    """Bytes of each sample and the log in them."""
    out = {}
    for sample in SAMPLES:
        path = tmp_path_factory.mktemp("whole") / f"log{sample.suffix}"
        sample.write(path)
        out[sample.name] = path.read_bytes(), read_log(path, {"format": sample.reader, **sample.options})[1]
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
    """How a damaged log ends: "read", "told" or "refused". Fails on anything but a good log or one line that says why."""
    with damage.bounded():
        for reader in readers():
            assert reader.detect(path) in (True, False)
        try:
            _, log = read_log(path, {"format": sample.reader, **sample.options} if options is None else options)
        except InputError as error:
            assert str(error) and "\n" not in str(error) and len(str(error)) < 1000
            return "refused"
    check_log(log)
    told = set(log.notes) - set(before.notes)
    lost = log.imu.rows < before.imu.rows
    assert not lost or told or log.faults or _stretch(log, before), "rows are gone and nothing says so"
    return "told" if told or log.faults else "read"


def _stretch(log: ConvertedLog, before: ConvertedLog) -> bool:
    """Whether it is a stretch of the whole log: cut off at the ends of rows, front or back, which no file shows."""
    first = log.imu.time_s[1] + log.time_shift_s - before.time_shift_s
    k, n = int(np.argmin(np.abs(before.imu.time_s - first))), log.imu.rows - 1
    pairs = ((log.imu.dtheta_rad, before.imu.dtheta_rad), (log.imu.dv_m_s, before.imu.dv_m_s))
    return all(a[1:].shape == b[k : k + n].shape and np.allclose(a[1:], b[k : k + n], rtol=1e-5, atol=1e-12) for a, b in pairs)


def check_log(log: ConvertedLog) -> None:
    """Finite, plausible, in order; texts of one line."""
    imu = log.imu
    for values in (imu.time_s, imu.dt_s, imu.dtheta_rad, imu.dv_m_s):
        assert np.isfinite(values).all()
    assert np.all(np.diff(imu.time_s) > 0) and np.all(imu.dt_s > 0) and imu.dt_s.max() <= 1.0 + 1e-9
    assert np.all(np.abs(imu.dtheta_rad) <= damage.PLAUSIBLE_RAD_S * imu.dt_s[:, None] * (1 + 1e-9))
    assert np.all(np.abs(imu.dv_m_s) <= damage.PLAUSIBLE_M_S2 * imu.dt_s[:, None] * (1 + 1e-9))
    for stream in (log.gnss, log.temperature, log.odometer, log.reference):
        if stream is not None:
            assert np.isfinite(stream.time_s).all() and np.all(np.diff(stream.time_s) > 0)
            assert stream.time_s[0] >= 0 and stream.time_s[-1] <= imu.end_s + 1e-9
    if log.gnss is not None:
        assert np.isfinite(log.gnss.v_n_m_s).all() and np.all(np.abs(log.gnss.lat_rad) <= np.pi / 2)
    if log.temperature is not None:
        assert np.all((log.temperature.gyro_degC >= -60) & (log.temperature.gyro_degC <= 125))
    assert all("\n" not in text for text in (*log.notes, *(s.reason for s in log.faults)))


def mutations(sample: Sample, data: bytes, before: ConvertedLog, path: Path, count: int, seed: int) -> dict:
    counts = dict.fromkeys(("read", "told", "refused"), 0)
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        path.write_bytes(damage.damaged(data, rng))
        try:
            counts[outcome(sample, path, before)] += 1
        except Exception as error:
            raise AssertionError(f"{sample.name}: seed {seed}, mutation {k}: {type(error).__name__}: {error}") from error
    return counts


@pytest.mark.parametrize("sample", SAMPLES, ids=IDS)
def test_damage_is_read_or_refused(whole, tmp_path, sample):
    mutations(sample, *whole[sample.name], tmp_path / f"log{sample.suffix}", NORMAL, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("sample", SAMPLES, ids=IDS)
def test_much_damage_is_read_or_refused(whole, tmp_path, sample):
    """Prints how the mutations ended; run with `-m slow -s`."""
    print(f"\n{sample.name}: {mutations(sample, *whole[sample.name], tmp_path / f'log{sample.suffix}', LONG, seed=2)}")


@pytest.mark.parametrize("sample", SAMPLES, ids=IDS)
def test_cut_off_at_every_share(whole, tmp_path, sample):
    """What is before the cut counts: never fewer rows for a later cut, where the format lets one read from the front."""
    data, before = whole[sample.name]
    rows = []
    for share in np.linspace(0.02, 0.98, 9):
        path = tmp_path / f"log{sample.suffix}"
        path.write_bytes(data[: int(share * len(data))])
        rows.append(_rows(sample, path, before))
    if sample.reader not in ("parquet", "ros") and "gz" not in sample.suffix:
        assert rows == sorted(rows)


def _rows(sample: Sample, path: Path, before: ConvertedLog) -> int:
    if outcome(sample, path, before) == "refused":
        return 0
    return read_log(path, {"format": sample.reader, **sample.options})[1].imu.rows


def test_the_guard_sees_hangs_and_memory(monkeypatch):
    monkeypatch.setattr(damage, "HANG_S", 1)
    with pytest.raises(damage.Hung), damage.bounded():
        while True:
            pass
    with pytest.raises(MemoryError), damage.bounded():
        np.ones(damage.MEMORY_BYTES // 4)
