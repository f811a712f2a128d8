"""Rows of sources to run directories: what is kept, dropped, counted, and gone on with."""

import os
import random
import struct
import threading
import time

import numpy as np
import pytest

import recal
from ins.columns import GYRO_DEGC, RATE_COLUMNS
from ins.records import InputError
from recal.service.watch.feed import packets
from recal.service.watch.recording import Recording
from recal.service.watch.session import WatchRequest, _ByFix, _table, opened
from trajectories.readers.live import mavlink_source
from trajectories.readers.live.rows import Dropped, Order, Rows
from trajectories.readers.live.text_source import Lines, RunSource
from trajectories.runs.directory import inspect_run, read_run, write_run
from trajectories.runs.recorder import Recorder, run_text


@pytest.fixture(scope="module")
def run():
    """Seventy minutes at rest at 10 Hz."""
    return recal.simulate("parked_only", seed=7, rate_hz=10).run


@pytest.fixture(scope="module")
def grown(run, tmp_path_factory):
    """The run as a directory of CSV."""
    path = tmp_path_factory.mktemp("grown") / "run"
    write_run(path, run, fmt="csv")
    (path / "phases.csv").unlink()
    return path


def drained(source, recording, most=10**9):
    """Record what a source has now."""
    taken = []
    while most > 0:
        batch = source.read(0.0)
        if not batch:
            break
        taken += recording.take(batch)
        most -= 1
    return taken


def request_of(path, **more):
    given = {"serial": "SN-0042", "technology": "rlg", "lat_deg": 45.0, "store_url": "sqlite:///no"}
    return WatchRequest(**{"source": "-", "run": path, **given, **more})


def test_a_run_directory_is_kept_bit_by_bit(grown, tmp_path):
    source = RunSource(grown)
    recording = Recording(source, tmp_path / "out")
    drained(source, recording)
    recording.close()
    assert read_run(tmp_path / "out").sha256 == read_run(grown).sha256
    assert not recording.dropped


def test_a_recording_goes_on_after_a_kill(grown, tmp_path):
    """Cut at any byte of any stream, as a kill or a full disk leaves it."""
    whole = read_run(grown).sha256
    rng = random.Random(4)
    for number in range(8):
        out = tmp_path / f"out-of-{number}"
        source = RunSource(grown)
        recording = Recording(source, out)
        drained(source, recording, most=1)
        recording.close()
        for file in out.glob("*.csv"):
            os.truncate(file, rng.randrange(1, file.stat().st_size))
        source = RunSource(grown)
        recording = Recording(source, out)
        drained(source, recording)
        recording.close()
        assert read_run(out).sha256 == whole
        assert len(recording.parts) == 1


def test_a_table_becomes_the_run_that_convert_makes(run, tmp_path, monkeypatch):
    """By its times, rates and temperatures: to the rounding of the shift."""
    w = run.imu.whole()
    names = ("time_s", *RATE_COLUMNS, *GYRO_DEGC)
    degC = np.array(
        [np.interp(w.time_s, run.temperature.time_s, c) for c in run.temperature.gyro_degC.T]
    )
    rates = np.hstack([w.dtheta_rad, w.dv_m_s]) / w.dt_s[:, None]
    rows = np.column_stack([w.time_s + 500.0, rates, degC.T])[:6000]
    text = "\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n"
    path = tmp_path / "log.csv"
    path.write_text(text)
    source = _table(request_of(tmp_path / "out"), path)
    recording = Recording(source, tmp_path / "out")
    drained(source, recording)
    recording.close()
    header = {"imu_serial": "SN-0042", "gyro_technology": "rlg", "lat_deg": 45.0}
    header |= {"lon_deg": 0.0, "height_m": 0.0, "start_utc": "2026-03-01T05:00:00Z"}
    made = recal.convert(path, header=header).run
    kept = read_run(tmp_path / "out")
    rounding = 1e-9
    assert kept.imu.rows == made.imu.rows
    np.testing.assert_allclose(kept.imu.whole().time_s, made.imu.whole().time_s, atol=rounding)
    np.testing.assert_allclose(
        kept.imu.whole().dtheta_rad, made.imu.whole().dtheta_rad, rtol=1e-9, atol=1e-15
    )
    both = min(kept.temperature.time_s.size, made.temperature.time_s.size)
    assert both > 590
    assert (
        np.abs(kept.temperature.gyro_degC[both // 2] - made.temperature.gyro_degC[both // 2]).max()
        < 0.01
    )


def test_rows_out_of_order_are_dropped_and_counted():
    order = Order(1.0)

    def of(times):
        values = np.zeros((len(times), 7))
        values[:, 0], values[:, 6] = times, -9.8
        return Rows("imu", ("time_s", *RATE_COLUMNS), values)

    kept = [part for part, _ in order.take(of([0.1, 0.2, 0.2, 0.15, 0.3, 1e9, 0.4, np.nan, 0.5]))]
    times = np.concatenate([part.time_s for part in kept])
    np.testing.assert_array_equal(times, [0.1, 0.2, 0.3, 0.4, 0.5])
    assert order.dropped == {
        Dropped.DUPLICATE: 1,
        Dropped.LATE: 1,
        Dropped.STAMP: 1,
        Dropped.VALUE: 1,
    }


def test_a_gap_begins_another_run(run, tmp_path):
    out = tmp_path / "out"
    w = run.imu.whole()
    rates = np.hstack([w.dtheta_rad, w.dv_m_s]) / w.dt_s[:, None]
    values = np.column_stack([w.time_s, rates])

    class Two:
        dropped, rereads = {}, False

        def header(self):
            return run.header

        def run_json(self):
            return None

    recording = Recording(Two(), out)
    columns = ("time_s", *RATE_COLUMNS)
    recording.take([Rows("imu", columns, values[:500])])
    recording.take([Rows("imu", columns, values[700:1200])])
    recording.close()
    assert [p.name for p in recording.parts] == ["out", "out-2"]
    first, second = (inspect_run(p).run for p in recording.parts)
    assert (first.imu.rows, second.imu.rows) == (500, 500)
    assert second.imu.start_s == pytest.approx(0.1)
    assert second.header.run_id != first.header.run_id


def test_what_is_no_recording_is_not_written_to(run, tmp_path):
    text = run_text(run.header, "source", 0.0)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    with pytest.raises(InputError):
        Recorder(tmp_path / "other", text)
    write_run(tmp_path / "made", run)
    with pytest.raises(InputError):
        Recorder(tmp_path / "made", text)


class Packets:
    """A link that gives packets some at a time."""

    def __init__(self, data, each=50):
        self._parts = [data[k : k + each] for k in range(0, len(data), each)]

    def read(self, wait_s):
        return self._parts.pop(0) if self._parts else None

    def close(self):
        pass


def mavlink(monkeypatch, data, out, address="udp:127.0.0.1:1"):
    """A source of these packets, recorded."""
    monkeypatch.setattr(mavlink_source, "opened", lambda address: Packets(data))
    source = mavlink_source.MavlinkSource(address, _ByFix(request_of(out)))
    recording = Recording(source, out)
    while (batch := source.read(0.0)) is not None:
        recording.take(batch)
    recording.close()
    return recording


def sent(run, count):
    found = []
    for _, packet in packets(run):
        found.append(packet)
        if len(found) == count:
            break
    return found


def test_mavlink_gives_the_rates_that_were_sent(run, tmp_path, monkeypatch):
    mavlink(monkeypatch, sent(run, 3000), tmp_path / "out")
    kept, true = read_run(tmp_path / "out").imu.whole(), run.imu.whole()
    assert kept.rows == 3000
    float32 = 1e-7  # of a value
    np.testing.assert_allclose(
        kept.dtheta_rad, true.dtheta_rad[:3000], rtol=5 * float32, atol=1e-12
    )
    np.testing.assert_allclose(kept.dv_m_s, true.dv_m_s[:3000], rtol=5 * float32, atol=1e-7)


def test_a_serial_line_gives_the_rates_that_were_sent(run, tmp_path):
    """Through a pair of pseudo terminals, in pieces that end within messages, until it hangs up."""
    pty = pytest.importorskip("pty")
    near, far = pty.openpty()
    out, count = tmp_path / "out", 3000
    source = opened(request_of(out, source=f"serial:{os.ttyname(far)}:921600"))
    data = b"".join(sent(run, count))

    def write():
        for k in range(0, len(data), 1000):
            os.write(near, data[k : k + 1000])

    writer = threading.Thread(target=write)
    writer.start()
    recording = Recording(source, out)
    rows, until_s = 0, time.monotonic() + 60.0
    while rows < count and time.monotonic() < until_s:
        rows += sum(len(part) for part in recording.take(source.read(0.1)) if part.stream == "imu")
    writer.join()
    os.close(far)
    os.close(near)  # as a plug that is pulled
    while time.monotonic() < until_s and source.read(0.1) is not None:
        pass
    assert source.read(0.1) is None
    recording.close()
    source.close()
    kept, true = read_run(out).imu.whole(), run.imu.whole()
    assert (kept.rows, recording.dropped) == (count, {})
    float32 = 5e-7  # of a value, five roundings
    np.testing.assert_allclose(kept.dtheta_rad, true.dtheta_rad[:count], rtol=float32, atol=1e-12)


def mutated(data, rng, count):
    """Packets with bytes changed, cut, doubled, in another order, and of nothing."""
    found = []
    for k in range(count):
        packet = bytearray(data[k % len(data)])
        kind = rng.randrange(8)
        if kind == 0:
            for _ in range(rng.randrange(1, 6)):
                packet[rng.randrange(len(packet))] = rng.randrange(256)
        elif kind == 1:
            del packet[rng.randrange(len(packet)) :]
        elif kind == 2:
            packet = bytearray(rng.randbytes(rng.randrange(300)))
        elif kind == 3:
            packet = resealed(packet, rng)
        found.append(bytes(packet))
        if kind == 4:
            found.append(bytes(packet))
        if kind == 5 and len(found) > 3:
            found[-1], found[-3] = found[-3], found[-1]
    return found


def resealed(packet, rng):
    """A payload changed under a right checksum: values that no sensor gives."""
    from pymavlink.dialects.v20 import common

    at = 10 + rng.randrange(max(len(packet) - 16, 1))
    packet[at : at + 4] = struct.pack("<f", rng.choice([np.nan, np.inf, 1e30, -1e9]))
    seal = common.x25crc(bytes(packet[1:-2]))
    seal.accumulate(bytes([common.MAVLink_highres_imu_message.crc_extra]))
    packet[-2:] = struct.pack("<H", seal.crc)
    return packet


@pytest.mark.parametrize("address", ["udp:127.0.0.1:1", "tcp:127.0.0.1:1"])
@pytest.mark.parametrize("count", [1000, pytest.param(50_000, marks=pytest.mark.slow, id="all")])
def test_mutated_messages_are_dropped(run, tmp_path, monkeypatch, address, count):
    """No crash, every row that is kept is one that was sent, and what is dropped is counted."""
    data = mutated(sent(run, count), random.Random(1), count)
    recording = mavlink(monkeypatch, data, tmp_path / "out", address)
    sent_rates = {float(np.float32(v)) for v in (run.imu.whole().dtheta_rad[:, 0] * 10.0)}
    parts = [np.loadtxt(p / "imu.csv", delimiter=",", skiprows=1) for p in recording.parts]
    assert all(np.all(np.diff(part[:, 0]) > 0) for part in parts)
    kept = np.concatenate(parts)
    untouched = 0.5  # of the messages, by the kinds of damage; resynchronisation costs few of them
    assert len(kept) > 0.9 * untouched * count
    known = np.mean([value in sent_rates for value in kept[:, 1]])
    assert known > 0.9
    assert {Dropped.GARBAGE, Dropped.VALUE} <= {Dropped(k) for k in recording.dropped}


def test_standard_input_ends_with_its_last_row(monkeypatch):
    read, write = os.pipe()
    os.write(write, b"one\ntwo")
    os.close(write)
    lines = Lines(None)
    monkeypatch.setattr(lines, "_file", read)
    found = []
    while not lines.ended:
        found += lines.read(1.0)
    assert found == [b"one", b"two"]


@pytest.mark.parametrize("name", ["nothing-here", "udp:127.0.0.1", "serial:/dev/none:57600"])
def test_a_source_that_is_not_there(name, tmp_path):
    with pytest.raises(InputError):
        opened(request_of(tmp_path / "out", source=name))
