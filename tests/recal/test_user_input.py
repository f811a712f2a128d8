"""What users hand over by mistake or on purpose: pipes, devices and damaged texts in each place
where a command takes a file, control characters in names. Each costs one line and exit code 3.
"""

import json
import os
import shutil
import signal
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from ins.records import InputError, TemperatureLog
from ins.user_input import LONGEST_PRINTED, one_line, visible
from recal.cli.app import app
from recal.cli.console import BAD_INPUT_EXIT, print_lines, say
from recal.service.results.pages import page_environment
from tests.trajectories.run_cases import csv_run, header, imu_log

TWIN = {"schema": "recal.twin/1", "gyro_technology": "rlg"}
AXIS = {"temperature_degC": [0, 10], "bias_deg_h": [0, 0], "sigma_deg_h": [0.01, 0.01]}
TABLE = {
    "schema": "recal.table/1",
    "imu_serial": "SN-0042",
    "gyro_technology": "rlg",
    "gyro_mode": "dithered",
    "created_utc": "2026-01-01T00:00:00Z",
    "interpolation": "linear",
    "axes": {axis: AXIS for axis in "xyz"},
    "covariance": None,
    "provenance": {"parent_sha256": None, "runs": []},
}
AZIMUTHS = "heading_deg,bias_x_deg_h,bias_y_deg_h,bias_z_deg_h\n" + "".join(
    f"{k},0.01,-0.02,0.03\n" for k in (0, 90, 180, 270)
)
MAP = """
time = {column = "time_s"}
gyro = {columns = ["dtheta_x_rad", "dtheta_y_rad", "dtheta_z_rad"], unit = "rad"}
accel = {columns = ["dv_x_m_s", "dv_y_m_s", "dv_z_m_s"], unit = "m/s"}
[gnss]
time = {column = "time_s"}
position = {columns = ["lat_deg", "lon_deg", "height_m"], unit = "deg"}
"""
HELD = "BAD"  # stands for the file that is wrong
# Each place where a command takes a file or a folder: its name, and how it is called.
PLACES = {
    "simulate scenario": f"simulate {HELD} -o out",
    "simulate --twin": f"simulate parked_only --twin {HELD} -o out",
    "simulate --table": f"simulate parked_only --table {HELD} -o out",
    "look log": f"look {HELD}",
    "look --map": f"look log.csv --map {HELD}",
    "look --gnss": f"look log.csv --map map.toml --gnss {HELD}",
    "convert log": f"convert {HELD} -o out",
    "convert --map": f"convert log.csv --map {HELD} -o out",
    "convert --gnss": f"convert log.csv --map map.toml --gnss {HELD} -o out",
    "check run": f"check {HELD}",
    "align run": f"align {HELD}",
    "align --twin": f"align run --twin {HELD}",
    "replay run": f"replay {HELD}",
    "replay --twin": f"replay run --twin {HELD}",
    "replay --thermal-model": f"replay run --thermal-model {HELD}",
    "update runs": f"update {HELD}",
    "update --twin": f"update run --twin {HELD}",
    "update --config": f"update run --config {HELD}",
    "update --priors": f"update run --priors {HELD}",
    "update --thermal-model": f"update run --thermal-model {HELD}",
    "misalignment inputs": f"misalignment {HELD} --lat-deg 45 --sigma-deg-h 0.001",
    "misalignment --twin": f"misalignment k.csv --lat-deg 45 --sigma-deg-h 0.001 --twin {HELD}"
    " --twin-out out.json",
    "plan runs": f"plan {HELD} --twin twin.json",
    "plan --twin": f"plan --twin {HELD}",
    "diagnose runs": f"diagnose {HELD} --twin twin.json",
    "diagnose --twin": f"diagnose run --twin {HELD}",
    "serve --token-file": f"serve --token-file {HELD}",
    "table verify --report": f"table verify --report {HELD}",
    "table import table": f"table import {HELD}",
    "table import --twin": f"table import table.json --twin {HELD}",
    "thermal rlg runs": f"thermal rlg {HELD}",
    "thermal rlg --check": f"thermal rlg run --check {HELD}",
    "thermal rlg --twin": f"thermal rlg run --twin {HELD}",
    "thermal fog --fast": f"thermal fog --fast {HELD}",
    "thermal fog --slow": f"thermal fog --fast fog --slow {HELD}",
    "thermal fog --check": f"thermal fog --fast fog --check {HELD}",
    "thermal fog --twin": f"thermal fog --fast fog --twin {HELD}",
    "thermal apply model": f"thermal apply {HELD} run -o out",
    "thermal apply run": f"thermal apply model.json {HELD} -o out",
    "watch --map": f"watch log.csv -o recorded --map {HELD}",
    "watch --twin": f"watch run -o recorded --idle-s 0 --twin {HELD}",
    "watch --config": f"watch run -o recorded --idle-s 0 --config {HELD}",
    "watch --thermal-model": f"watch run -o recorded --idle-s 0 --thermal-model {HELD}",
    "fleet update source": f"fleet update {HELD}",
    "fleet update --config": f"fleet update . --config {HELD}",
    "fleet forecast --priors": f"fleet forecast --priors {HELD}",
    "twin fit runs": f"twin fit {HELD}",
    "twin fit --start": f"twin fit run --start {HELD}",
    "twin check runs": f"twin check {HELD} --twin twin.json",
    "twin check --twin": f"twin check run --twin {HELD}",
    "twin import source": f"twin import {HELD} --from kalibr --technology mems",
    "twin export twin": f"twin export {HELD} --to kalibr",
}
WRITTEN = {"-o", "--truth", "--table-out", "--twin-out"}
SEARCHED = {"serve --reports"}  # folders that are looked through; what is no report is passed over
NAMES_TOO = {"simulate scenario"}  # a name or a file, so its type is text
UNREACHED = {"thermal apply run"}  # the model, which is not there, is refused first
NO_FILE = {"--priors"}  # a choice or a file
SUFFIXES = {
    "simulate scenario": ".toml",
    "fleet update source": ".csv",
    "table import table": ".json",
    "misalignment inputs": ".csv",
}


@contextmanager
def at_most(seconds: float):
    """A reader that waits for a pipe is stopped and fails."""

    def stop(*_: object) -> None:
        pytest.fail(f"waited for {seconds} s")  # no OSError, which a reader would report

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def call(line: list[str], seconds: float = 20.0) -> tuple[int, str]:
    """Exit code and words of a command, as `recal` ends; raises what would be a traceback."""
    with at_most(seconds):
        found = CliRunner().invoke(app, line)
    error = found.exception
    if isinstance(error, InputError) or (isinstance(error, OSError) and error.strerror):
        return BAD_INPUT_EXIT, found.output + one_line(str(error))
    if error is not None and not isinstance(error, SystemExit):
        raise error
    return found.exit_code, found.output


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("user")
    (folder / "twin.json").write_text(json.dumps(TWIN))
    (folder / "table.json").write_text(json.dumps(TABLE))
    (folder / "k.csv").write_text(AZIMUTHS)
    (folder / "map.toml").write_text(MAP)
    warm = 20.0 + 0.01 * np.arange(100.0)[:, None] + np.zeros((100, 3))
    streams = {
        "imu": imu_log(seconds=100),
        "temperature": TemperatureLog(time_s=np.arange(100.0), gyro_degC=warm),
    }
    csv_run(folder / "run", **streams)
    csv_run(folder / "fog", header=header(gyro_technology="fog", imu_serial="SN-F"), **streams)
    shutil.copy(folder / "run" / "imu.csv", folder / "log.csv")
    call(["table", "import", str(folder / "table.json"), "--store", f"sqlite:///{folder}/s.db"])
    return folder


@pytest.fixture
def folder(made, monkeypatch):
    monkeypatch.chdir(made)
    monkeypatch.setenv("RECAL_STORE", "sqlite:///s.db")
    yield made
    for path in made.glob("BAD*"):
        path.unlink()


def refused(place: str, file: str) -> None:
    """The command ends with exit code 3, without a file that it was to write."""
    line = [file if word == HELD else word for word in PLACES[place].split()]
    code, words = call(line)
    assert code == BAD_INPUT_EXIT, (place, file, code, words[-300:])
    assert file in words or place in UNREACHED, (place, file, code, words[-300:])
    assert not Path("out").exists()


def test_each_place_for_a_file_is_tried():
    """The places are those that the commands declare."""
    found = set()

    def walk(command, names):
        for name, below in getattr(command, "commands", {}).items():
            walk(below, [*names, name])
        for option in command.params if not hasattr(command, "commands") else ():
            key = option.opts[0]
            is_path = "Path" in str(option.type_descriptor.annotation) or key in NO_FILE
            if is_path and key not in WRITTEN and [*names, key] != ["watch", "--report"]:
                found.add(" ".join([*names, key]))

    walk(typer.main.get_command(app), [])
    assert found - SEARCHED == set(PLACES) - NAMES_TOO


@pytest.mark.parametrize("place", PLACES)
def test_a_pipe_is_not_waited_for(folder, place):
    file = HELD + SUFFIXES.get(place, "")
    os.mkfifo(folder / file)
    refused(place, file)


def test_a_device_without_end_is_not_read(folder):
    (folder / HELD).symlink_to("/dev/zero")
    for place in ("simulate scenario", "twin import source", "update --config", "look log"):
        refused(place, HELD)


TEXTS = {
    "open quote": b'heading_deg,bias_x_deg_h\n"0,1\n',
    "one line of 200 kB": b"x" * 200_000,
    "zeros": bytes(2000),
    "UTF-16": "seed = 1\n".encode("utf-16"),
    "deep": b"[" * 100_000,
    "infinite": b'{"schema": 1e999}',
    "twice": b'{"schema": 1, "schema": 2}',
    "escapes": b'{"schema": "recal.twin/1", "\\u001b[31m\\n": 1}',
}


@pytest.mark.parametrize("text", TEXTS)
def test_a_text_of_another_kind_costs_one_short_line(folder, text):
    for place in ("misalignment inputs", "simulate scenario", "twin check --twin"):
        file = HELD + SUFFIXES.get(place, "")
        (folder / file).write_bytes(TEXTS[text])
        refused(place, file)
        words = call([file if w == HELD else w for w in PLACES[place].split()])[1]
        assert words.isprintable() and len(words) < 1.1 * LONGEST_PRINTED


FORGED = "SN-1\nstore: 9 revisions, intact\x1b[31m\u202e"


def test_what_is_printed_forges_no_line(capsys):
    """Stores of older versions may hold any text."""
    print_lines([FORGED, "x" * 100_000])
    say(FORGED)
    told, noted = capsys.readouterr()
    first, second = told.splitlines()
    assert first == noted.rstrip("\n") and first.isprintable() and first.startswith("SN-1\\nstore")
    assert len(second) < 1.1 * LONGEST_PRINTED
    assert visible("deg/h, \u00b5g, \u5317") == "deg/h, \u00b5g, \u5317"
    page = page_environment().from_string("{{ name }}").render(name=FORGED + "<b>")
    assert "\x1b" not in page and "\u202e" not in page and "\n" in page and "&lt;b&gt;" in page


@pytest.mark.parametrize("output", ("pipe", "device"))
def test_no_pipe_or_device_is_replaced_by_a_file(folder, output):
    """--force writes over files alone; /dev/full of the administrator was made a file."""
    place = folder / f"{HELD}-{output}"
    if output == "pipe":
        os.mkfifo(place)
    else:
        place.symlink_to("/dev/full")
    line = "misalignment k.csv --lat-deg 45 --sigma-deg-h 0.001 --twin twin.json -o made --force"
    code, words = call([*line.split(), "--twin-out", place.name])
    assert code == BAD_INPUT_EXIT and place.name in words and not place.is_file()
    assert place.is_fifo() or place.is_char_device()
