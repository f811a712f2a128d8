"""`recal diagnose` as a user runs it: files, exit codes, what it prints, and bad input from
files.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.gap_trials.written import write_trial
from infield.table.file import table_sha256
from ins.errors.table import TABLE_AGED
from ins.records import InputError
from ins.twin_file import read_twin
from simreal.declared.twin_effects import parse_effects
from tests.recal import command
from tests.simreal.diagnosed import trial
from trajectories.runs.directory import read_run, write_run


def run(*arguments):
    return command.run("diagnose", *arguments)


FILES = {"diagnosis.json", "diagnosis.html", "twin.json", "table.json"}


def one_cold():
    return trial("gyro_warmup_transient", 6.0, 11, "one_cold")


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trial")
    write_trial(one_cold(), folder)
    return folder / "blind"


@pytest.fixture
def folder(source, tmp_path, monkeypatch):
    shutil.copytree(source, tmp_path / "blind")
    monkeypatch.chdir(tmp_path / "blind")
    return tmp_path / "blind"


@pytest.fixture(scope="module")
def done(source):
    out = source.parent / "out"
    result = run(source / "run-1", "--twin", source / "twin.json", "-o", out, "--json", "--seed", 3)
    return result, out


def test_a_diagnosis_writes_four_files_and_exits_0(done):
    result, out = done
    assert result.exit_code == 0 and {p.name for p in out.iterdir()} == FILES
    document = json.loads((out / "diagnosis.json").read_text())
    assert result.stdout == (out / "diagnosis.json").read_text()
    assert document["verdict"] == "explained" and document["seed"] == 3
    planted, cause = one_cold().truth[0], document["causes"][0]
    assert cause["target"] == planted.target
    assert planted.effect in (cause["effect"], *cause["confounded_with"])
    assert len(document["runs"][0]["sha256"]) == 64
    assert document["table_sha256"] == table_sha256(one_cold().table)
    assert result.stderr == ""


def test_what_one_cold_start_leaves_open_is_in_no_twin_and_reads_back(done):
    """The items of an open cause are those of a twin, if one takes it out of a log all the same."""
    _, out = done
    document = json.loads((out / "diagnosis.json").read_text())
    (open_,) = document["open"]
    assert open_["why"] == "not_unique" and open_["settled_by"]
    twin = read_twin(out / "twin.json")
    (effect,) = parse_effects(replace(twin, effects=tuple(open_["twin_effects"])))
    assert (effect.effect.name, effect.target) == (open_["effect"], open_["target"])


def test_the_twin_written_stands_alone_and_reads_back(done):
    _, out = done
    twin = read_twin(out / "twin.json")
    assert twin.table == "table.json" and parse_effects(twin) == ()
    assert table_sha256(json.loads((out / "table.json").read_text())) == table_sha256(
        one_cold().table
    )


def test_a_run_that_never_rests_is_refused_with_a_document(folder):
    moved = read_run(folder / "run-1")
    imu, rng = moved.imu.whole(), np.random.default_rng(1)
    shaken = imu.dv_m_s + 0.5 * rng.standard_normal(imu.dv_m_s.shape)
    write_run(folder / "shaken", replace(moved, imu=replace(imu, dv_m_s=shaken)))
    result = run("shaken", "--twin", "twin.json", "-o", "out")
    document = json.loads(Path("out/diagnosis.json").read_text())
    assert result.exit_code == 4
    assert document["verdict"] == "refused"
    assert "rest" in document["reasons"][0]
    assert document["sentence"] in result.stdout and result.stderr == ""
    assert result.stdout.endswith("report: out/diagnosis.html\n")
    assert "Not looked at" in Path("out/diagnosis.html").read_text()
    assert not Path("out/twin.json").exists()


def bad(folder, *arguments):
    result = run(*arguments, "--twin", folder / "twin.json")
    assert isinstance(result.exception, InputError) and "\n" not in str(result.exception)
    assert not (folder / "recal-diagnose" / "diagnosis.json").exists()
    return str(result.exception)


def changed_twin(folder, **changes):
    data = json.loads((folder / "twin.json").read_text())
    (folder / "twin.json").write_text(json.dumps({**data, **changes}))


def test_a_twin_of_another_unit_is_bad_input(folder):
    changed_twin(folder, imu_serial="SN-0001", table=None)
    line = bad(folder, "run-1")
    assert "SN-0001" in line and "SN-0042" in line


def test_a_table_of_another_unit_is_bad_input(folder):
    changed_twin(folder, imu_serial="SN-0001")
    assert "table.json" in bad(folder, "run-1")


def test_a_table_that_is_not_there_is_bad_input(folder):
    changed_twin(folder, table="other.json")
    assert "other.json" in bad(folder, "run-1")


def test_one_run_given_twice_is_bad_input(folder):
    assert "run_id" in bad(folder, "run-1", "run-1")


def test_a_run_to_hold_out_must_be_among_the_runs(folder):
    assert "--hold-out run-9" in bad(folder, "run-1", "--hold-out", "run-9")


def test_alpha_out_of_range_is_wrong_usage(folder):
    assert run("run-1", "--twin", "twin.json", "--alpha", "2").exit_code == 2


def test_a_unit_without_a_table_is_told_so_and_no_effect_is_named_in_its_place(folder):
    """Biases of two raw runs came out as a scale factor of 1,600 ppm with a probability of 0.87.
    What an unknown unit has anyway, a bias and a thermal curve, is its table's.
    """
    write_trial(trial(None, 1.0, 5, "one_cold", 0), folder / "sound")
    blind = folder / "sound" / "blind"
    twin = json.loads((blind / "twin.json").read_text())
    (blind / "twin.json").write_text(json.dumps({**twin, "table": None}))
    result = run(blind / "run-1", "--twin", blind / "twin.json", "-o", "out", "--seed", 3)
    document = json.loads(Path("out/diagnosis.json").read_text())
    assert result.exit_code == 0 and document["table_sha256"] is None
    assert document["verdict"] in ("explained", "no_gap") and document["notes"]
    assert {c["effect"] for c in document["causes"]} <= {TABLE_AGED}
    assert not Path("out/table.json").exists()
