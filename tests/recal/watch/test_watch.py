"""A session from its first row to its update: the same bits, kills, the screen, the page."""

import json
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

import recal
from infield.session.reasons import SessionReason
from infield.table.file import json_text
from ins.records import InputError
from ins.verdicts import because
from recal.cli import update as commands
from recal.service.update import UpdateRequest, update_in_store
from recal.service.watch.interim import InterimRequest, advised, estimated, read
from recal.service.watch.monitor import Monitor, Phase
from recal.service.watch.part_rows import PartRows
from recal.service.watch.reasons import Wait, waits
from recal.service.watch.recording import Recording
from recal.service.watch.records import WatchState
from recal.service.watch.session import SHOWN_S, WAIT_S, WatchRequest, watch
from simreal.plan.ahead import TURN, Outlook, outlook, stay
from tests.recal.command import run as typed
from trajectories.readers.live.text_source import RunSource
from trajectories.runs.checks import Findings
from trajectories.runs.directory import read_run, write_run

MERGED_KEYS = ("observability", "points", "table_after", "heading_error", "runs", "verdict")


@pytest.fixture(scope="module")
def simulated():
    return recal.simulate("cold_parked_taxi", seed=7, rate_hz=10)


@pytest.fixture(scope="module")
def grown(simulated, tmp_path_factory):
    """The session as a directory of CSV."""
    path = tmp_path_factory.mktemp("grown") / "run"
    write_run(path, simulated.run, fmt="csv")
    (path / "phases.csv").unlink()
    return path


@pytest.fixture(scope="module")
def recorded(grown, tmp_path_factory):
    """The same, as a watch has recorded it."""
    out = tmp_path_factory.mktemp("recorded") / "out"
    recording = Recording(RunSource(grown), out)
    while batch := recording._source.read(0.0):
        recording.take(batch)
    recording.close()
    return out


def request_of(grown, out, **more):
    return WatchRequest(
        source=str(grown), run=out, idle_s=0.5, output=out.parent / "report", **more
    )


def test_the_end_is_the_update_of_the_file(grown, tmp_path):
    """Bit by bit, and by the rows that a file of rates holds."""
    store = f"sqlite:///{tmp_path}/no.db"
    watched = watch(request_of(grown, tmp_path / "out", store_url=store)).record
    direct = update_in_store(
        UpdateRequest(runs=[grown], store_url=store, output=tmp_path / "direct")
    ).record
    for key in MERGED_KEYS:
        assert getattr(watched, key) == getattr(direct, key), key


@pytest.fixture(scope="module")
def interim(recorded):
    """The estimate of all rows."""
    read([recorded])
    return estimated([recorded], InterimRequest(store_url="sqlite:///no.db"))


def test_the_interim_estimate_is_that_of_the_rows(recorded, interim):
    """At 10 Hz its sigmas are those of the update; the heading is that of the vehicle."""
    found = interim
    full = recal.update(recorded)
    for axis, gyro in found.gyros.items():
        assert gyro.sigma_now_deg_h == pytest.approx(full.axes[axis].sigma_after_deg_h, rel=0.01)
    assert found.verdict == "proposed"
    assert found.until_s == pytest.approx(4965.0, abs=1.0)
    # turned by 90, 90 and -90 deg
    assert abs((found.heading_deg - 90.0 + 180.0) % 360.0 - 180.0) < 4 * found.sigma_heading_deg


def test_temperatures_that_came_later_are_not_of_the_estimate(recorded, tmp_path):
    """The streams of a fast source grow while one after the other is read."""
    part = tmp_path / "part"
    shutil.copytree(recorded, part)
    lines = (part / "imu.csv").read_text().splitlines(keepends=True)
    (part / "imu.csv").write_text("".join(lines[:9001]))
    rows = PartRows(part)
    rows.read()
    run = rows.run(Findings())
    assert run.imu.end_s == pytest.approx(900.0, abs=0.2)
    assert run.imu.end_s - 2.0 < run.temperature.time_s[-1] <= run.imu.end_s


def test_a_stay_and_a_turn_bring_what_was_predicted(simulated):
    """Against the same session ten minutes later, and after a tow by 90 deg."""
    towed = recal.simulate("two_headings", seed=7, rate_hz=10)

    def updated(made, until_s):
        from benchmarks.outlook import seen_until

        return recal.update(seen_until(made.run, until_s), made.table, made.twin).estimate

    def sigma(result):
        return np.array([axis.sigma_after_deg_h for axis in result.sessions[0].seen])

    [ten] = outlook(updated(simulated, 1500.0), [stay(10.0)])
    np.testing.assert_allclose(ten.sigma_deg_h, sigma(updated(simulated, 2100.0)), rtol=0.1)
    [turned] = outlook(updated(towed, 4199.0), [TURN])
    np.testing.assert_allclose(turned.sigma_deg_h, sigma(updated(towed, 4560.0)), rtol=0.1)


def test_a_vehicle_that_people_left_is_predicted_to_stay_calm():
    """Boarding until minute 20, seen at minute 24: its tilt and its bumps do not begin again."""
    from benchmarks.outlook import WITHIN, predicted

    ratios = np.array(list(predicted(18)["ratios"].values()))
    assert ratios.shape == (2, 3)
    worst = np.abs(np.log(ratios)).max(axis=1)
    assert worst[0] <= np.log1p(WITHIN)
    # the jolts of boarding stand out more, the longer it is calm: 11 % after 20 min
    assert worst[1] <= np.log1p(1.5 * WITHIN)


def test_phases_and_a_gap_are_seen_from_the_rows(simulated, recorded):
    monitor = Monitor()
    seen = {}
    source = RunSource(recorded)
    while batch := source.read(0.0):
        for rows in batch:
            for k in range(0, len(rows), 10):
                monitor.take([rows.where(slice(k, k + 10))])
                if rows.stream == "imu":
                    seen[round(monitor.time_s)] = monitor.phase
    parked = [t for t in seen if t < 4200]
    assert np.mean([seen[t] in (Phase.ALIGNING, Phase.PARKED) for t in parked]) > 0.98
    legs = simulated.reference
    speed = np.linalg.norm(legs.v_n_m_s, axis=1)
    fast = [t for t in seen if np.interp(t - 2.0, legs.time_s, speed) > 3.0]
    assert np.mean([seen[t] is Phase.ROLLING for t in fast]) > 0.9
    assert monitor.faults(5.0)


def test_a_gap_that_no_run_may_hold_is_a_fault_for_five_minutes(grown):
    source, monitor = RunSource(grown), Monitor()
    [rows] = [rows for rows in source.read(0.0) if rows.stream == "imu"]
    monitor.take([rows.where(slice(0, 600))])
    assert not monitor.faults(0.0)
    later = rows.where(slice(0, 4000))
    monitor.take([later.where(slice(0, 600))])
    assert len(monitor.faults(0.0)) == 1
    monitor.take([later.where(slice(600, 4000))])
    assert not monitor.faults(0.0)


COMMAND = [sys.executable, "-m", "recal", "watch"]


def begun(grown, out, *more):
    """A watch as its own process."""
    words = [*COMMAND, str(grown), "-o", str(out), "--report", str(out.parent / "report"), *more]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.slow
def test_kills_lose_nothing(grown, tmp_path):
    """The source grows while the watch is killed again and again. One kill, without a process of
    its own, is that of test_recording.py.
    """
    kills, growing, out = 200, tmp_path / "growing", tmp_path / "out"
    growing.mkdir()
    names = ("run.json", "imu.csv", "temperature.csv")
    texts = {name: (grown / name).read_bytes() for name in names}
    (growing / "run.json").write_bytes(texts["run.json"])
    rng = random.Random(kills)
    for kill in range(1, kills + 1):
        for name in names[1:]:
            (growing / name).write_bytes(texts[name][: len(texts[name]) * kill // kills])
        process = begun(growing, out)
        time.sleep(rng.uniform(0.5, 8.0))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        if (out / "imu.csv").exists() and (out / "imu.csv").stat().st_size > 10_000:
            # readable as it was left, up to a last row that is cut
            assert read_run(out).imu.rows > 2
    process = begun(growing, out, "--idle-s", "1")
    process.communicate(timeout=300)
    assert process.returncode == 0
    assert read_run(out).sha256 == read_run(grown).sha256


def sent_rows(count, first_s):
    """HIGHRES_IMU at 100 Hz from a second of the boot clock on, in real time, to who listens."""
    from pymavlink.dialects.v20 import common

    encoder = common.MAVLink(None, srcSystem=1, srcComponent=1)
    bits = 0x3F | 1 << 12
    rest = (0.0, 0.0, -9.80665, 1e-5, 2e-5, -5e-5)
    for k in range(count):
        time_s = first_s + 0.01 * k
        message = encoder.highres_imu_encode(round(1e6 * time_s), *rest, *[0.0] * 6, 25.0, bits)
        yield time_s, message.pack(encoder)


@pytest.mark.parametrize("kills", [2, pytest.param(50, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["udp", "tcp"])
def test_a_kill_of_a_live_source_loses_a_second(tmp_path, kind, kills):
    """What was sent more than a second (`SHOWN_S`) before the kill is on the disk; the same command
    goes on, and the rows that came meanwhile are those of another part.
    """
    out, rng = tmp_path / "out", random.Random(kills)
    with socket.socket(type=socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = "--serial SN-1 --technology rlg --lat-deg 45.0 -q".split()
    begin_s = 100.0
    for kill in range(kills):
        words = [*COMMAND, f"{kind}:127.0.0.1:{port}", "-o", str(out), *options]
        words += ["--report", str(tmp_path / "report")]
        if kind == "tcp":
            listener = socket.create_server(("127.0.0.1", port))
            process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
            listener.settimeout(60.0)
            link = listener.accept()[0]
            listener.close()
        else:
            process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
            link = socket.socket(type=socket.SOCK_DGRAM)
            link.connect(("127.0.0.1", port))
        imu = (out if kill == 0 else out.with_name(f"out-{kill + 1}")) / "imu.csv"
        until_s = rng.uniform(2.0, 5.0)  # after the first row is on the disk
        sent, begun_s = [], None
        for time_s, packet in sent_rows(100_000, begin_s):
            try:
                link.send(packet)
            except ConnectionRefusedError:  # it does not listen yet
                pass
            sent.append((time.monotonic(), time_s))
            if begun_s is None and imu.exists():
                begun_s = time.monotonic()
            if begun_s is not None and time.monotonic() - begun_s > until_s:
                break
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        killed_s = time.monotonic()
        process.wait()
        link.close()
        shift_s = json.loads((imu.parent / "run.json").read_text())["conversion"]["time_shift_s"]
        last_s = read_run(imu.parent).imu.end_s + shift_s
        lost = [at for at, time_s in sent if time_s > last_s + 0.005]
        # a second, and what a busy machine needs to write it
        assert killed_s - min(lost, default=killed_s) < SHOWN_S + WAIT_S + 1.0
        begin_s = sent[-1][1] + 10.0
    assert len(list(tmp_path.glob("out*"))) == kills


def test_a_young_session_waits_and_is_not_refused(simulated):
    from benchmarks.outlook import seen_until

    young = recal.update(seen_until(simulated.run, 200.0), simulated.table, simulated.twin)
    [session] = young.estimate.sessions
    wait = waits(session.verdict.reasons, 200.0)
    assert wait.code is Wait.REST
    assert wait.values["left_s"] == pytest.approx(300.0 - 200.0, abs=2.0)
    # nothing but its length
    other = because(SessionReason.FILTER_LOST, fault="")
    assert waits([*session.verdict.reasons, other], 200.0) is None


def test_lines_come_at_once_and_with_the_time(grown, tmp_path):
    process = begun(grown, tmp_path / "out", "--idle-s", "0.5")
    first = process.stdout.readline()
    rest, _ = process.communicate(timeout=300)
    lines = [first, *rest.splitlines()]
    stamped = [line for line in lines if re.match(r"\d\d:\d\d:\d\dZ ", line)]
    assert stamped[0] == first
    assert len(stamped) > 5


def test_an_interrupt_ends_with_the_update(grown, tmp_path):
    out = tmp_path / "out"
    process = begun(grown, out, "--json")
    states = []
    for line in process.stdout:
        states.append(json.loads(line))
        if states[-1].get("rows", 0) >= 49_000:
            break
    process.send_signal(signal.SIGINT)
    rest, said = process.communicate(timeout=300)
    assert process.returncode == 0, said
    last = json.loads(rest.splitlines()[-1])
    assert states[0]["schema"] == "recal.watch/1"
    assert (last["verdict"], last["imu_serial"]) == ("proposed", "SN-0042")
    assert json.loads((tmp_path / "report" / "update.json").read_text()) == last


def test_an_interrupt_that_comes_twice_at_once_is_one(grown, tmp_path):
    process = begun(grown, tmp_path / "out", "--json")
    for line in process.stdout:
        if json.loads(line).get("rows", 0) >= 49_000:
            break
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=300)
    assert process.returncode == 0, said
    assert (tmp_path / "report" / "update.json").exists()


def test_a_second_interrupt_breaks_off(monkeypatch):
    monkeypatch.setattr(commands, "SAME_S", 0.0)
    with commands._until_interrupted() as stop:
        signal.raise_signal(signal.SIGINT)
        assert stop.is_set()
        time.sleep(0.01)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_what_was_broken_off_says_how_to_go_on(grown, tmp_path, monkeypatch):
    def broken_off(request):
        raise KeyboardInterrupt

    monkeypatch.setattr("recal.service.watch.session.watch", broken_off)
    done = typed("watch", grown, "-o", tmp_path / "out", "--report", tmp_path / "report", "-q")
    assert done.exit_code == 130
    assert f"recal update {tmp_path / 'out'}" in done.stderr


def test_a_unit_of_another_serial_is_refused_with_commit(grown, simulated, tmp_path):
    store = f"sqlite:///{tmp_path}/units.db"
    other = tmp_path / "other.json"
    other.write_text(json_text({**simulated.table_dict, "imu_serial": "SN-0099"}))
    assert typed("table", "import", other, "--store", store).exit_code == 0
    done = typed(
        *("watch", grown, "-o", tmp_path / "out", "--idle-s", 0.5, "--store", store, "--commit"),
        *("--report", tmp_path / "report", "-q"),
    )
    assert done.exit_code == 4


def test_a_full_disk_leaves_whole_rows(grown, tmp_path, monkeypatch):
    recording = Recording(RunSource(grown), tmp_path / "out")
    batch = recording._source.read(0.0)
    recording.take(batch)
    size = (tmp_path / "out" / "imu.csv").stat().st_size
    write = os.write

    def half(file, data):
        if len(data) < 100:
            raise OSError(28, "No space left on device")
        return write(file, data[: len(data) // 2])

    monkeypatch.setattr(os, "write", half)
    with pytest.raises(InputError):
        recording.take(recording._source.read(0.0))
    assert (tmp_path / "out" / "imu.csv").stat().st_size == size


def test_the_page_is_guarded_and_tells_the_state(interim, tmp_path):
    import httpx

    from recal.web.live import LivePage

    state = WatchState(
        runs=["out"],
        time_s=4965.0,
        rate_hz=10.0,
        phase="parked",
        rows=49_650,
        dropped={},
        gyro_degC=[30.0] * 3,
        visited_degC=[-4.0, 33.0],
        faults=[],
        estimate=interim,
    )
    with LivePage(0) as page, httpx.Client(base_url=page.url, timeout=30.0) as client:
        page.show(state)
        assert client.get("/").status_code == 200
        assert "sandbox" in client.get("/report").headers["content-security-policy"]
        assert client.get("/", headers={"host": "evil.example"}).status_code == 421
        with client.stream("GET", "/events") as events:
            told = json.loads(next(events.iter_lines()).removeprefix("data: "))
        assert [row[0] for row in told["gyros"]] == ["x", "y", "z"]
        with pytest.raises(InputError):
            LivePage(int(page.url.rsplit(":", 1)[1].strip("/")))


def test_a_recorded_log_is_sent_as_mavlink(grown, tmp_path):
    """Row by row, to who connects."""
    import threading

    from pymavlink.dialects.v20 import common

    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    received = bytearray()

    def take():
        for _ in range(100):
            try:
                link = socket.create_connection(("127.0.0.1", port))
                break
            except ConnectionRefusedError:
                time.sleep(0.1)
        with link:
            while piece := link.recv(1 << 16):
                received.extend(piece)

    taker = threading.Thread(target=take)
    taker.start()
    options = "--serial SN-0042 --technology rlg --lat-deg 45.000 --start-utc 2026-03-02T06:00:00Z"
    log = ["convert", grown / "imu.csv", *options.split(), "-o", tmp_path / "out"]
    done = typed(*log, "--live", "10000", "--to", f"tcp:127.0.0.1:{port}")
    taker.join()
    assert done.exit_code == 0, done.output
    messages = common.MAVLink(None).parse_buffer(bytes(received))
    assert len(messages) == read_run(tmp_path / "out").imu.rows
    assert typed(*log, "--split", "--to", "tcp:127.0.0.1:1").exit_code == 2


def test_advice_has_the_numbers_of_the_outlook():
    now, target = (0.004, 0.0075, 0.004), (0.003, 0.003, 0.003)
    stays = [
        Outlook(
            name="stay",
            duration_s=60.0 * m,
            sigma_deg_h=(0.004 / (1 + m / 10), 0.0075, 0.004 / (1 + m / 10)),
            gyro_degC=(30.0, 30.0, 30.0),
        )
        for m in (5.0, 10.0, 20.0, 40.0)
    ]
    turn = Outlook(
        name="turn", duration_s=360.0, sigma_deg_h=(0.0026, 0.003, 0.003), gyro_degC=(30.0,) * 3
    )
    found = advised(now, target, [*stays, turn])
    # 0.004 / (1 + m / 10) is 0.003 after 3.3 min, by straight information after 3.0
    assert found.plan_min in (3.0, 4.0)
    assert not found.enough
    assert any("0.0075 -> 0.0030" in line for line in found.lines)
    assert advised((0.001,) * 3, target, []).enough
    only_y = advised((0.002, 0.0075, 0.002), target, [*stays, turn])
    assert only_y.plan_min == 6.0
    assert only_y.plan_deg_h == turn.sigma_deg_h
