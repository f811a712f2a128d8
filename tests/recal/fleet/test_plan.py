"""Which runs are taken, in which order, and what is set aside: folders, manifests, clocks, ties."""

import json
from datetime import UTC, datetime

import pytest

from infield.store.rows import UnitKey
from ins.records import InputError
from recal.fleet.manifest import listed_runs
from recal.fleet.plan import plan_fleet
from recal.fleet.records import PlannedRun
from recal.fleet.update import run_folder, unit_folder

NOW = datetime(2026, 11, 21, tzinfo=UTC)


def make_run(folder, serial="SN-1", run_id="r", start_utc="2026-01-01T00:00:00Z", **more):
    """A run directory of which only run.json is ever read here."""
    folder.mkdir(parents=True)
    data = {
        "schema": "recal.run/1",
        "run_id": run_id,
        "tail": "T",
        "imu_serial": serial,
        "gyro_technology": "rlg",
        "start_utc": start_utc,
        "site": {"lat_deg": 45.0, "lon_deg": 7.0, "height_m": 0.0},
        **more,
    }
    (folder / "run.json").write_text(json.dumps(data))
    return folder


def test_a_folder_is_searched_at_any_depth_and_each_run_found_once(tmp_path):
    deep = make_run(tmp_path / "2026" / "jan" / "r1")
    make_run(deep / "inner")  # inside a run: not a run of its own
    make_run(tmp_path / ".r2.half-written")
    (tmp_path / "loop").symlink_to(tmp_path / "2026")
    (tmp_path / "unfinished").mkdir()
    (tmp_path / "unfinished" / "imu.parquet").write_bytes(b"")
    found = listed_runs(tmp_path)
    assert [run.path.name for run in found] == ["r1", "unfinished"]
    assert "run.json" in found[1].wrong
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match="no run below it"):
        listed_runs(empty)


MANIFESTS = {
    "runs.csv": "path,twin\nr1,\nsub/r2,t.json\nr1,\n",
    "runs.jsonl": '{"path": "r1"}\n\n{"path": "sub/r2", "twin": "t.json"}\n',
    "runs.toml": '[[run]]\npath = "r1"\n[[run]]\npath = "sub/r2"\ntwin = "t.json"\n',
}


@pytest.mark.parametrize("name", MANIFESTS)
def test_manifests_name_runs_relative_to_themselves(tmp_path, name):
    (tmp_path / name).write_text(MANIFESTS[name])
    first, second = listed_runs(tmp_path / name)
    assert (first.path, first.twin) == (tmp_path / "r1", None)
    assert (second.path, second.twin) == (tmp_path / "sub" / "r2", tmp_path / "t.json")


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "path,colour\nr1,red\n", "a.csv: line 2: unknown key colour"),
        ("a.csv", "run\nr1\n", "a.csv: line 2: key path is missing"),
        ("a.csv", "path,twin\nr1\n", "a.csv: line 2: needed as many fields"),
        ("a.jsonl", '{"path": "r1"}\n{"path": 3}\n', "a.jsonl: line 2: path: got 3"),
        ("a.jsonl", "{\n", "a.jsonl: line 1: not valid JSON"),
        ("a.toml", 'path = "r1"\n', r"needed \[\[run\]\]"),
        ("a.toml", "[[run]]\ntwin = 't'\n", r"\[\[run\]\] 1: key path is missing"),
        ("a.txt", "r1\n", "a manifest that ends in .csv"),
        ("a.csv", "path\n", "names no run"),
    ],
)
def test_a_wrong_manifest_is_said_with_its_line(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=words):
        listed_runs(tmp_path / name)


def test_runs_are_grouped_by_unit_and_ordered_in_time_ties_said(tmp_path):
    make_run(tmp_path / "a", run_id="late", start_utc="2026-05-01T00:00:00Z")
    make_run(tmp_path / "b", run_id="same-2", start_utc="2026-02-01T00:00:00Z")
    make_run(tmp_path / "c", run_id="same-1", start_utc="2026-02-01T00:00:00Z")
    make_run(tmp_path / "d", run_id="dithered", gyro_mode="dithered")
    make_run(tmp_path / "e", serial="SN-0")
    plan = plan_fleet(listed_runs(tmp_path), NOW)
    key = UnitKey(imu_serial="SN-1", gyro_technology="rlg")
    assert [str(k) for k in plan.units] == ["SN-0 (rlg)", "SN-1 (rlg)", "SN-1 (rlg, dithered)"]
    assert [run.run_id for run in plan.units[key]] == ["same-1", "same-2", "late"]
    assert [bool(run.notes) for run in plan.units[key]] == [True, True, False]
    assert not plan.set_aside


def test_what_cannot_be_ordered_is_set_aside_with_its_reason(tmp_path):
    make_run(tmp_path / "a", start_utc="1970-01-01T00:00:12Z")
    make_run(tmp_path / "b", start_utc="2031-01-01T00:00:00Z")
    (make_run(tmp_path / "c") / "run.json").write_text('{"schema"')
    make_run(tmp_path / "d", gyro_technology="laser")
    make_run(tmp_path / "good")
    (tmp_path / "m.csv").write_text("path\na\nb\nc\nd\ngood\ngone\n")
    plan = plan_fleet(listed_runs(tmp_path / "m.csv"), NOW)
    assert sum(map(len, plan.units.values())) == 1
    assert {o.outcome for o in plan.set_aside} == {"bad_input"}
    reasons = [o.reasons[0] for o in plan.set_aside]
    words = (
        "clock was not set",
        "in the future",
        "not valid JSON",
        "gyro_technology",
        "no such run",
    )
    assert all(w in reason for w, reason in zip(words, reasons, strict=True))


def test_a_file_written_anew_changes_the_signature(tmp_path):
    run = make_run(tmp_path / "a")
    (before,) = plan_fleet(listed_runs(tmp_path), NOW).units.values()
    (run / "imu.csv").write_text("time_s\n")
    (after,) = plan_fleet(listed_runs(tmp_path), NOW).units.values()
    assert before[0].signature != after[0].signature


def test_folders_of_odd_names_stay_inside_and_apart():
    odd = [
        UnitKey(imu_serial=s, gyro_technology="rlg")
        for s in ("../../etc", "a/b", "a_b", "..", "Ä", "x" * 200)
    ]
    names = [unit_folder(key) for key in odd]
    assert len(set(names)) == len(names)
    assert all("/" not in name and not name.startswith(".") and len(name) < 100 for name in names)
    found = unit_folder(UnitKey(imu_serial="SN-1", gyro_technology="fog", gyro_mode="m"))
    assert found == "SN-1-fog-m"
    runs = [
        PlannedRun(path=f"/{k}", unit=odd[0], run_id="../r", start_utc=start, signature="")
        for k, start in enumerate(("2026-01-01T01:00:00+02:00", "2026-01-01T00:00:00Z"))
    ]
    first, second = map(run_folder, runs)
    assert first.startswith("20251231T230000Z-_.._r-") and first < second
