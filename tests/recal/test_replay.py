"""`recal replay` as a user runs it: outputs, exit codes, a store it never makes, the same bytes
twice.
"""

import json
import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pyarrow.parquet as pq
import pytest
import typer
from pyarrow import csv
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from infield.table.file import table_sha256, table_to_dict
from infield.table.thermal_table import default_table
from ins.records import InputError
from ins.units import DEG
from recal.cli import replay
from tests.infield.test_replay import never_rests, simulated
from trajectories.runs.directory import write_run
from trajectories.simulator.motions import Park, Stop, Straight, lay
from trajectories.simulator.session import SimulatedRun

app = typer.Typer()
app.command()(replay.command)
COLUMNS = [
    "time_s",
    "lat_deg",
    "lon_deg",
    "height_m",
    "vn_m_s",
    "ve_m_s",
    "vd_m_s",
    "roll_deg",
    "pitch_deg",
    "heading_deg",
    "table",
]


@lru_cache(maxsize=1)
def session() -> SimulatedRun:
    motion = lay([Park(duration_s=1200.0), Straight(duration_s=60.0), Stop(duration_s=30.0)])
    return simulated(motion, 2, heading_deg=359.99, with_gnss=True)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "run", session().run, reference=session().reference)
    return tmp_path


def table(bias_deg_h: float, serial: str = "SN-0042"):
    made = default_table(
        imu_serial=serial, gyro_technology="rlg", created_utc="2026-01-01T00:00:00Z"
    )
    data = table_to_dict(made)
    data["axes"]["x"]["bias_deg_h"] = [bias_deg_h] * len(data["axes"]["x"]["bias_deg_h"])
    return data


def stored(*tables) -> None:
    with TableStore.open("sqlite:///recal.db", create=True) as store:
        for data in tables:
            store.import_table(data)


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def result_of(*arguments, exit_code: int = 0) -> dict:
    outcome = run(*arguments, "--json", "-q")
    assert outcome.exit_code == exit_code, (outcome.output, outcome.exception)
    return json.loads(outcome.stdout)


def test_two_revisions_are_flown_and_compared(folder):
    first, second = table(0.05), table(0.0)
    stored(first, second)
    outcome = run("run", "--json")
    document = json.loads(outcome.stdout)
    assert outcome.stdout == (folder / "recal-replay/replay.json").read_text()
    assert document["schema"] == "recal.replay/1" and document["verdict"] == "replayed"
    defaults, extrapolated = document["notes"]
    assert "recal twin fit run -o twin.json" in defaults
    assert document["noise_source"] == "defaults of rlg"
    assert extrapolated == "parked for 10 min of navigation: NM/h is extrapolated"
    found = [(t["role"], t["revision"]) for t in document["tables"]]
    assert found == [("active", 2), ("previous", 1)]
    assert [t["sha256"] for t in document["tables"]] == [table_sha256(second), table_sha256(first)]
    rate = document["difference"]["rate_nm_h"]
    assert rate["active"] < 0.01 < 0.1 < rate["previous"]  # the unit's truth is no bias at all
    assert rate["change"] == pytest.approx(rate["active"] - rate["previous"])
    assert f"{rate['previous']:.3f} -> {rate['active']:.3f} NM/h" in run("run").stdout
    sigmas = [t["predicted"]["sigma_nm_h"] for t in document["tables"]]
    difference = document["difference"]
    assert difference["sigma_rate_nm_h"] == pytest.approx(np.hypot(*sigmas))  # two imports
    assert difference["significant"] is bool(abs(rate["change"]) > 2 * np.hypot(*sigmas))
    active = document["tables"][0]
    assert active["gnss"] is not None and active["scoring_only"]["source"] == "reference"
    assert 0 <= active["alignment"]["heading_deg"] < 360
    assert len(active["stops"]) == 1
    assert not active["realign"]
    assert "replay" in (folder / "recal-replay/replay.html").read_text().lower()


def test_navigation_file_holds_both_solutions_at_one_hertz(folder):
    stored(table(0.05), table(0.0))
    document = result_of("run", "-o", "out", "--no-aided")
    data = pq.read_table("out/navigation.parquet").to_pandas()
    assert list(data.columns) == COLUMNS
    for role in ("active", "previous"):
        part = data[data["table"] == role]
        np.testing.assert_allclose(np.diff(part["time_s"]), 1.0, atol=1e-6)
        assert part["time_s"].iloc[0] == document["parked_span"]["start_s"]
        assert part["heading_deg"].between(0, 360, inclusive="left").all()
    reference, active = session().reference, data[data["table"] == "active"]
    truth = np.interp(active["time_s"], reference.time_s, reference.lat_rad / DEG)
    # 100 m; the perfect unit with the perfect table
    assert np.abs(active["lat_deg"] - truth).max() < 1e-3
    assert data.drop(columns="table").notna().all().all()


@pytest.mark.slow
def test_same_bytes_on_a_second_run(folder):
    stored(table(0.05), table(0.0))
    result_of("run", "-o", "one")
    result_of("run", "-o", "two")
    names = sorted(p.name for p in (folder / "one").iterdir())
    assert names == ["navigation.parquet", "navigation_aided.parquet", "replay.html", "replay.json"]
    for name in names:
        assert (folder / "one" / name).read_bytes() == (folder / "two" / name).read_bytes(), name


def test_exports_and_the_aided_solution(folder):
    """Both write what the parquet files hold, twice the same bytes; --no-aided leaves GNSS out."""
    stored(table(0.0))
    document = result_of("run", "-o", "one", "--kml", "--csv")
    result_of("run", "-o", "two", "--kml", "--csv")
    for name in ("track.kml", "navigation.csv", "navigation_aided.csv"):
        assert (folder / "one" / name).read_bytes() == (folder / "two" / name).read_bytes(), name
    for name in ("navigation", "navigation_aided"):
        text, binary = csv.read_csv(f"one/{name}.csv"), pq.read_table(f"one/{name}.parquet")
        assert text.column_names == binary.column_names
        for column in binary.column_names:
            np.testing.assert_array_equal(
                text[column].to_numpy(), binary[column].to_numpy(), err_msg=column
            )
    aided = document["aided"]
    assert aided["verdict"] == "aided"
    assert aided["start"]["method"] == "gyrocompass"
    assert aided["consistency"]["is_test"]
    assert aided["scoring_only"]["normalised_position"] < 3.0 and aided["rejected"] == []
    page = (folder / "one/replay.html").read_text()
    assert "Aided by GNSS" in page
    assert "$" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    plain = result_of("run", "-o", "one", "--no-aided")
    assert plain["aided"] is None and not (folder / "one/navigation_aided.parquet").exists()
    assert plain["tables"] == document["tables"]
    assert plain["tables"][0]["schuler"]["reason"].startswith("parked for 10 min")


@pytest.mark.parametrize(("serial", "said"), [("SN-0042", "one revision"), ("SN-7", "SN-0042")])
def test_a_lone_table_is_flown_and_why_is_said(folder, serial, said):
    stored(table(0.0, serial=serial))
    document = result_of("run", "--no-aided")
    assert len(document["tables"]) == 1 and document["difference"] is None
    assert said in document["notes"][0]


def test_without_a_store_the_default_table_is_flown_and_none_made(folder):
    document = result_of("run", "--no-aided")
    assert document["notes"][0].startswith("no store there") and document["store"] is None
    assert document["tables"][0]["origin"].startswith("default")
    assert document["tables"][0]["applied"]
    assert not (folder / "recal.db").exists()


def test_refused_writes_its_reasons_and_no_old_navigation(folder):
    result_of("run", "-o", "out", "--no-aided")
    assert (folder / "out/navigation.parquet").exists()
    write_run(folder / "moving", never_rests(session().run))
    document = result_of("moving", "-o", "out", "--no-aided", exit_code=4)
    assert document["verdict"] == "refused" and "never rests" in document["reasons"][0]
    assert json.loads((folder / "out/replay.json").read_text()) == document
    assert "never rests" in (folder / "out/replay.html").read_text()
    assert not (folder / "out/navigation.parquet").exists()


@pytest.mark.parametrize("applied", [False, True])
def test_bad_input_is_one_line(folder, applied):
    if applied:
        header = replace(session().run.header, applied_table_sha256="ab" * 32)
        write_run(folder / "bad", replace(session().run, header=header))
        stored(table(0.0))
    outcome = run("bad", "-o", "out")
    assert isinstance(outcome.exception, InputError) and "\n" not in str(outcome.exception)
    assert ("abab" if applied else "no such run") in str(outcome.exception)
    assert not (folder / "out").exists()


def test_outages_are_left_out_and_scored(folder):
    """In replay.json, on the page and on the terminal; a mistyped one is named in a line."""
    arguments = ["run", "--outage", "1220:30", "--outage", "1100:20", "-o", "out"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    scores = json.loads((folder / "out" / "replay.json").read_text())["aided"]["outage_scores"]
    assert [(s["start_s"], s["end_s"]) for s in scores] == [(1220.0, 1250.0), (1100.0, 1120.0)]
    assert all(s["error_over_sigma"] < 4.0 and s["fixes"] > 15 for s in scores)
    assert "1250.0 s" in result.output
    assert "fixes left out, s" in (folder / "out" / "replay.html").read_text()
    for words, told in (("300", "needed START:LENGTH in seconds"), ("300:-5", "such as 300:60")):
        refused = CliRunner().invoke(app, ["run", "--outage", words, "-o", "other"])
        assert isinstance(refused.exception, InputError) and told in str(refused.exception)
    off = CliRunner().invoke(app, ["run", "--no-aided", "--outage", "300:60", "-o", "other"])
    assert "--no-aided" in str(off.exception)


def test_smoothed_solution_is_written_where_it_is_asked_for(folder):
    """Columns of the filter's, smaller sigmas, on the page and in a line; gone with the next replay
    that does not ask for it.
    """
    result = CliRunner().invoke(app, ["run", "--smooth", "--outage", "1220:30", "-o", "out"])
    assert result.exit_code == 0, result.output
    assert "smoothed: sigma level at most" in result.output
    aided, best = (
        pq.read_table(folder / f"out/navigation_{name}.parquet").to_pandas()
        for name in ("aided", "smoothed")
    )
    assert list(best.columns) == list(aided.columns) and len(best) == len(aided)
    assert (best["sigma_heading_deg"] <= aided["sigma_heading_deg"] * 1.001).all()
    document = json.loads((folder / "out/replay.json").read_text())["aided"]["smoothed"]
    assert document["sigma_level_m"]["largest"] < document["filter_sigma_level_m"]["largest"]
    (score,) = document["outage_scores"]
    assert score["error_over_sigma"] < 4.0
    assert "navigation_smoothed.parquet" in (folder / "out/replay.html").read_text()
    plain = result_of("run", "-o", "out", "--force")
    assert "smoothed" not in plain["aided"]
    assert not (folder / "out/navigation_smoothed.parquet").exists()
    off = CliRunner().invoke(app, ["run", "--no-aided", "--smooth", "-o", "other"])
    assert "--smooth" in str(off.exception)
