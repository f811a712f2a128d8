"""Clocks that wrap, are set, repeat, count from another epoch or in another unit: read as they went
on, or refused.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ins.records import InputError
from tests.trajectories.readers.hostile_rows import (
    DATELESS,
    GPS_LESS_UNIX_S,
    SECONDS,
    STEPS,
    UNIX_S,
    convert,
    noisy,
)
from tests.trajectories.readers.test_maps import FIXES, GNSS, N, csv_text
from trajectories.readers.rows.clocks import evened, going_on, gps_of_unix, unix_seconds

PERIODS = [
    ("32 bits of microseconds", 4294.967296),
    ("32 bits of milliseconds", 4_294_967.296),
    ("GPS week", 604_800.0),
    ("day", 86_400.0),
    ("hour", 3600.0),
    ("16 bits of milliseconds", 65.536),
    ("minute", 60.0),
]


@pytest.mark.parametrize(("name", "period_s"), PERIODS)
def test_a_clock_that_starts_again_goes_on(tmp_path, name, period_s):
    """30 s before the wrap and 30 s after it: no row dropped, none put elsewhere."""
    columns = noisy()
    columns["t"] = np.round((STEPS + period_s - 30.0) % period_s, 6)
    made = convert(tmp_path, columns)
    assert made.run.imu.rows == N and made.run.imu.end_s == pytest.approx(60.0, abs=1e-5)
    straight = convert(tmp_path, columns | {"t": STEPS})
    np.testing.assert_allclose(made.run.imu.dtheta_rad, straight.run.imu.dtheta_rad, rtol=1e-3)
    assert [n for n in made.record.notes if f"starts again at row 3001 ({name})" in n]
    assert len(made.record.notes) == 1


def test_everything_on_the_clock_wraps_with_it(tmp_path):
    """Fixes, temperatures and wheel in the log's rows, then in files of their own, over the wrap of
    32 bits of milliseconds.
    """
    columns, ticks = noisy(), (np.round(1e3 * STEPS) + 2**32 - 30_000) % 2**32
    slow = {"stamp": ticks[::100], **FIXES, "T": 20 + SECONDS / 10, "v": np.full(60, 3.0)}
    rows = columns | {"t": ticks} | {k: np.full(N, np.nan) for k in slow if k != "stamp"}
    for name in slow:
        if name != "stamp":
            rows[name][::100] = slow[name]
    keys = {
        "time": {"column": "t", "unit": "ms"},
        "gnss": GNSS,
        "temperature": {"columns": ["T"]},
        "odometer": {"column": "v"},
    }
    (tmp_path / "slow.csv").write_text(csv_text(slow))
    other = {"file": "slow.csv", "time": {"column": "stamp", "unit": "ms"}}
    apart = {"time": keys["time"]} | {
        k: {**keys[k], **other} for k in ("gnss", "temperature", "odometer")
    }
    for made in (convert(tmp_path, rows, keys), convert(tmp_path, columns | {"t": ticks}, apart)):
        for stream in (made.run.gnss, made.run.temperature, made.run.odometer):
            np.testing.assert_allclose(stream.time_s, SECONDS + 0.01, atol=1e-5)
        np.testing.assert_allclose(made.run.temperature.gyro_degC[:, 0], slow["T"])


@pytest.mark.parametrize("back_s", [18.0, 59.99, 999.0])
def test_a_clock_that_is_set_back_is_refused(tmp_path, back_s):
    """Half of the rows again before the others: nobody knows whether they were joined, swapped or
    the clock set.
    """
    columns = noisy()
    columns["t"] = 2000.0 + STEPS - back_s * (np.arange(N) >= 3000)
    with pytest.raises(
        InputError,
        match=rf"clock goes back by {back_s - 0.01:.3f} s at row 3001: .*--to-s or --from-s",
    ):
        convert(tmp_path, columns)
    made = convert(tmp_path, columns, {"from_s": 2000.0}) if back_s > 59 else None
    assert made is None or made.run.imu.rows == 3000


def test_one_garbled_time_costs_one_row(tmp_path):
    """Ahead by less than a second: the rows behind it are not late."""
    columns = noisy()
    columns["t"][1000] += 0.4957
    made = convert(tmp_path, columns)
    assert made.run.imu.rows == N - 1 and made.run.imu.dt_s.min() > 0.009
    assert "row 1001 dropped" in str(made.record.notes)
    columns = noisy()
    order = np.r_[0:500, 504, 500:504, 505:N]  # written early, and belongs where it says
    made = convert(tmp_path, {k: v[order] for k, v in columns.items()})
    assert made.run.imu.rows == N and "row 501 written late" in made.record.notes[0]


@pytest.mark.parametrize(
    ("stamps", "line"),
    [
        (np.round(STEPS, 1), "stamps too coarse\\? rate_hz in the map"),
        (np.round(STEPS), "stamps too coarse"),
        (1e3 * STEPS, r"rows 10 s apart \(median\)"),
        (1e-305 * STEPS, "rows 1e-307 s apart"),
        (0 * STEPS, "needed at least 2 with rising times"),
        (STEPS[::-1], "needed at least 2 with rising times"),
    ],
    ids=["0.1 s", "1 s", "ms as s", "hardly above 0", "constant", "backward"],
)
def test_stamps_that_are_no_clock(tmp_path, stamps, line):
    with pytest.raises(InputError, match=line):
        convert(tmp_path, noisy() | {"t": stamps + 0.0})


@pytest.mark.parametrize(
    ("epoch", "start_s", "year"),
    [("unix", 0.0, 1970), ("gps", 345_600.0, 1980), ("unix", 1.7e10, 2508)],
)
def test_a_clock_without_the_date_gives_none(tmp_path, epoch, start_s, year):
    """Seconds since boot or of the week under the name of an epoch: the date is asked for."""
    columns = noisy() | {"t": start_s + 0.01 + STEPS}
    keys = {"time": {"column": "t", "epoch": epoch}}
    with pytest.raises(InputError, match=r"start_utc \(--start-utc\)"):
        convert(tmp_path, columns, keys, DATELESS)
    assert convert(tmp_path, columns, keys).run.header.start_utc == "2026-03-01T05:00:00Z"


@pytest.mark.parametrize(("imu", "other"), [("unix", "gps"), ("gps", "unix"), ("gps", "gps")])
def test_utc_and_gps_time_are_brought_together(tmp_path, imu, other):
    """18 leap seconds: fixes stay beside the rows that they were taken with."""
    clock_s = {"unix": UNIX_S + STEPS, "gps": UNIX_S + GPS_LESS_UNIX_S + STEPS}
    (tmp_path / "gps.csv").write_text(csv_text({"stamp": clock_s[other][::100], **FIXES}))
    gnss = {**GNSS, "file": "gps.csv", "time": {"column": "stamp", "epoch": other}}
    made = convert(
        tmp_path,
        noisy() | {"t": clock_s[imu]},
        {"time": {"column": "t", "epoch": imu}, "gnss": gnss},
        DATELESS,
    )
    np.testing.assert_allclose(made.run.gnss.time_s, SECONDS + 0.01, atol=1e-5)
    assert made.run.header.start_utc == "2026-03-01T04:59:59.990Z"


def test_gps_time_of_utc_and_back():
    # around the leap second of 2017
    unix_s = np.array([1e9, 1_483_228_799.0, 1_483_228_800.0, 1.7e9])
    np.testing.assert_allclose(unix_seconds(gps_of_unix(unix_s)), unix_s)
    assert gps_of_unix(UNIX_S) == UNIX_S + GPS_LESS_UNIX_S


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([p for _, p in PERIODS]), st.floats(0, 1), st.integers(0, 2**32 - 1))
def test_any_wrapped_clock_goes_on(period_s, phase, seed):
    """From any start, with jitter and lost rows: the differences are those of the true times."""
    steps = np.random.default_rng(seed).uniform(0.005, 0.05, 6000)
    t = phase * period_s + np.cumsum(steps)
    out, found = going_on(t % period_s)
    np.testing.assert_allclose(np.diff(out), np.diff(t), atol=1e-6)
    assert len(found) == int(t[-1] // period_s) - int(t[0] // period_s)


def bursts(rng, rate_hz=100.0, seconds=60.0, of=4) -> np.ndarray:
    """Stamps of a host that reads a buffer of about so many rows at a time, 0.1 ms a row."""
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    last = np.flatnonzero(rng.random(t.size) < 1.0 / of)
    last = np.unique(np.append(last, t.size - 1))
    read = t[last][np.searchsorted(last, np.arange(t.size))]
    place = (
        np.arange(t.size) - np.append(0, last[:-1] + 1)[np.searchsorted(last, np.arange(t.size))]
    )
    return read + 0.0001 * place


def test_rows_stamped_in_bursts_are_spread_evenly(tmp_path):
    """Every row is kept, at the rate of the unit and not of the host's loop, within a buffer of its
    true time.
    """
    stamps = bursts(np.random.default_rng(1))
    even = evened(stamps)
    assert 1.0 / np.median(np.diff(even)) == pytest.approx(100.0, rel=0.01)
    off = even - np.arange(6000) / 100.0
    assert np.abs(off - np.mean(off)).max() < 0.1
    made = convert(tmp_path, noisy() | {"t": stamps[:N]})
    assert made.run.imu.rows == N and made.run.imu.rate_hz == pytest.approx(100.0, rel=0.01)
    assert made.run.faults == ()
    assert any("bursts" in note for note in made.record.notes)


def test_lost_rows_are_no_bursts():
    """60 % lost at random, and jitter of a third: stamps stay as they are."""
    rng, t = np.random.default_rng(1), np.arange(0.0, 60.0, 0.01)
    assert evened(t[rng.random(t.size) < 0.4]) is None
    assert evened(t + 0.003 * rng.random(t.size)) is None


@pytest.mark.parametrize(
    "keys", [{"from_s": 9e9}, {"to_s": 0.0}, {"from_s": 5040.0, "to_s": 5020.0}]
)
def test_a_stretch_that_the_log_does_not_have(tmp_path, keys):
    with pytest.raises(InputError, match=r"5000\.010 to 5060\.000 s"):
        convert(tmp_path, noisy(), keys)


def test_a_clock_set_back_within_a_long_log_is_refused_too(tmp_path):
    """150 of 18,000 rows have times that were written before: few, and a hole in the motion that
    no time shows. Half a second of them is read.
    """
    columns = {name: np.concatenate([values] * 3) for name, values in noisy().items()}
    steps = np.arange(3 * N) * 0.01
    rng = np.random.default_rng(3)
    columns["wz"] += 0.1 * rng.standard_normal(steps.size)  # no row is like another
    with pytest.raises(InputError, match=r"goes back by 1\.490 s at row 9001"):
        convert(tmp_path, columns | {"t": steps - 1.5 * (steps >= 90.0)})
    made = convert(tmp_path, columns | {"t": steps - 0.5 * (steps >= 90.0)})
    assert any("dropped: time repeats or goes back" in note for note in made.record.notes)
