"""What exists is written over only with --force; a command's own earlier output, known by its
schema, is replaced.
"""

import json

import pytest
from typer.testing import CliRunner

from ins.records import InputError
from recal.cli.app import app
from recal.service.results.overwrite import (
    CSV_TABLE,
    Peeked,
    is_simulated,
    keep_report,
    need_free_file,
    need_free_report,
    need_free_run,
    peeked,
)
from tests.recal.test_streams import QUICK, SLOW, Shown, SimulationShown
from tests.trajectories.run_cases import full_run
from trajectories.runs.directory import read_run, write_run
from trajectories.runs.schema import SimulationRecord

SIMULATED = SimulationRecord(scenario="parked_only", seed=1)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for verb in SLOW.values():
        monkeypatch.setattr(verb, lambda *_, **more: Shown())
    monkeypatch.setattr(SLOW["simulate"], lambda *_, **more: SimulationShown())
    return tmp_path


def run(name, *more):
    return CliRunner().invoke(app, [*name.split(), *QUICK[name], *more])


REPORTS = {  # the file by which a command knows its earlier output, what it says, another file
    "align": ("alignment.json", "recal.alignment/1", None),
    "replay": ("replay.json", "recal.replay/1", "navigation.parquet"),
    "update": ("update.json", "recal.update/1", "update.html"),
    "misalignment": ("misalignment.json", "recal.misalignment/1", "misalignment.html"),
    "plan": ("plan.json", "recal.plan/1", "plan.html"),
    "diagnose": ("diagnosis.json", "recal.diagnosis/1", "twin.json"),
    "thermal rlg": ("thermal_rlg.json", "recal.thermal_rlg/1", "thermal_rlg.html"),
    "thermal fog": ("thermal_fog.json", "recal.thermal_fog/1", "thermal_fog.html"),
}


@pytest.mark.parametrize("name", REPORTS)
def test_a_report_is_written_over_by_its_own_command_only(name, folder):
    document, schema, other = REPORTS[name]
    out = folder / "out"
    out.mkdir()
    assert run(name).exit_code == 0
    (out / document).write_text(json.dumps({"schema": schema}))
    assert run(name).exit_code == 0
    (out / document).write_text(json.dumps({"mine": 1}))
    refused = run(name)
    assert isinstance(refused.exception, InputError)
    assert f"out/{document}: exists" in str(refused.exception)
    assert "--force" in str(refused.exception) and "\n" not in str(refused.exception)
    assert run(name, "--force").exit_code == 0
    if other is not None:
        (out / document).unlink()
        (out / other).write_text("mine")
        assert f"out/{other}: exists" in str(run(name).exception)


def test_results_do_not_go_between_the_files_of_a_run(folder):
    (folder / "run-1").mkdir()
    (folder / "run-1/run.json").write_text("{}")
    with pytest.raises(InputError, match=r"run-1: holds a run, .* name another folder"):
        need_free_report(folder / "run-1", "alignment.json", "recal.alignment/1")
    need_free_report(folder / "run-1", "alignment.json", "recal.alignment/1", force=True)


def test_a_diagnosis_does_not_write_over_the_twin_that_it_reads(folder):
    (folder / "twin.json").write_text("{}")
    (folder / "diagnosis.json").write_text('{"schema": "recal.diagnosis/1"}')
    words = ["diagnose", "run", "--twin", "twin.json", "-o", "."]
    assert "twin.json" in str(CliRunner().invoke(app, words).exception)


def test_a_scenario_does_not_write_over_a_recording(folder):
    """The run of a converted log took ten hours to record; a simulated one is made again."""
    out = folder / "out"
    write_run(out, full_run())
    refused = run("simulate")
    assert str(refused.exception).startswith("out: exists (it holds a recording")
    assert read_run(out).header.run_id == "R1"
    assert run("simulate", "--force").exit_code == 0
    write_run(out, full_run(), simulation=SIMULATED)
    assert run("simulate").exit_code == 0
    assert isinstance(run("convert").exception, InputError)


def test_a_log_is_converted_again_into_its_own_run(folder):
    from recal.service.convert import made_of
    from trajectories.readers.conversion import file_sha256

    log = folder / "log.bin"
    log.write_bytes(b"first")
    made = {"conversion": {"source": "log.bin", "source_sha256": file_sha256(log)}}
    (folder / "run.json").write_text(json.dumps(made))
    found = peeked(folder / "run.json")
    assert made_of(found, log) and not made_of(Peeked(), log)
    assert not made_of(found, folder / "other" / "log.bin")
    log.write_bytes(b"second")
    assert not made_of(found, log)


def test_a_report_of_other_runs_is_kept(tmp_path):
    first = {"schema": "recal.update/1", "runs": [{"run_id": "R1", "sha256": "a"}]}
    (tmp_path / "update.json").write_text(json.dumps(first))
    (tmp_path / "update.html").write_text("first")
    keep_report(tmp_path, ["a"])
    assert (tmp_path / "update.html").exists()
    keep_report(tmp_path, ["a", "b"])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["update-1.html", "update-1.json"]
    assert (tmp_path / "update-1.html").read_text() == "first"
    (tmp_path / "update.json").write_text(json.dumps(first))
    keep_report(tmp_path, ["b"])
    assert (tmp_path / "update-2.json").exists() and not (tmp_path / "update.json").exists()


def test_files_and_folders(tmp_path):
    file = tmp_path / "table.csv"
    need_free_file(file, CSV_TABLE)
    file.write_text(CSV_TABLE + "\nx,1,2,3\n")
    need_free_file(file, CSV_TABLE)
    need_free_file(file, None, force=True)
    for mark in ("recal.table/1", None):
        with pytest.raises(InputError, match="exists"):
            need_free_file(file, mark)
    (tmp_path / "empty").mkdir()
    need_free_run(tmp_path / "empty", is_simulated, "a simulated run")
    need_free_report(tmp_path / "nowhere", "demo.json", "recal.demo/1", ("recal.db",))
    (tmp_path / "recal.db").touch()
    with pytest.raises(InputError, match=r"recal\.db: exists"):
        need_free_report(tmp_path, "demo.json", "recal.demo/1", ("recal.db",))
