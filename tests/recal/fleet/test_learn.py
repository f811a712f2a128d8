"""`recal fleet learn`, `priors`, `approve`, and `recal update --priors` on a small store."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from recal.cli.app import app
from tests.infield.sessions import factory_dict, simulated
from trajectories.runs.directory import write_run

URL = "sqlite:///recal.db"


def recal(*words):
    return CliRunner().invoke(app, [*words, "--store", URL])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A store with three committed sessions of one unit, and a fourth run."""
    folder = tmp_path_factory.mktemp("learn")
    for k in range(4):
        start = ("ambient", "cold", "hot", "ambient")[k]
        run = simulated(51 + k, start=start, start_utc=f"2026-0{k + 1}-01T05:00:00Z").run
        write_run(folder / f"run-{k}", run)
    url = f"sqlite:///{folder}/recal.db"
    with TableStore.open(url, create=True) as store:
        store.import_table(factory_dict())
    for k in range(3):
        words = ["update", str(folder / f"run-{k}"), "--commit", "--store", url, "-q"]
        done = CliRunner().invoke(app, [*words, "-o", str(folder / "out")])
        assert done.exit_code == 0, done.output
    return folder


@pytest.fixture(scope="module")
def learnt(made):
    """What is learnt in this process of one thread, proposed in the store."""
    words = ["fleet", "learn", "--json", "--by", "night fleet", "-o", str(made / "out")]
    done = CliRunner().invoke(app, [*words, "--store", f"sqlite:///{made}/recal.db"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


@pytest.fixture
def folder(made, learnt, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("recal.db").write_bytes((made / "recal.db").read_bytes())
    return made


def test_learnt_approved_used_and_taken_back(folder, learnt):
    """Three sessions of one unit: what they say is kept and named; an update goes by it once it is
    approved, and by the defaults where asked.
    """
    kept = folder / "out/priors.json"
    assert learnt["schema"] == "recal.priors/1" and learnt["verdict"] == "proposed"
    assert json.loads(kept.read_text()) == learnt
    (priors,) = learnt["technologies"]
    assert (priors["gyro_technology"], priors["revision"]) == ("rlg", 1)
    assert priors["technology"]["sessions"] == 3 and priors["units"][0]["name"] == "SN-0042"
    turn_on = priors["technology"]["parameters"]["turn_on"]
    assert turn_on["default"] == 0.003 and turn_on["unit"] == "deg/h" and turn_on["n"] == 3
    assert {"few_sessions", "one_unit"} <= set(priors["note_codes"])
    assert "recal fleet approve 1" in (folder / "out/priors.html").read_text()

    before = json.loads(recal("update", str(folder / "run-3"), "--json", "-o", "u").stdout)
    assert "priors" not in before and "rlg priors 1  open" in recal("fleet", "priors").stdout
    signed = ("--by", "K. Reviewer", "--reason", "fits")
    assert _next_of_a_forecast().startswith("recal fleet learn")
    assert recal("fleet", "approve", "1", *signed).exit_code == 0
    assert _next_of_a_forecast().startswith("recal update RUN")
    listed = recal("fleet", "priors").stdout
    assert "priors 1" in listed and "approved by K. Reviewer" in listed
    used = recal("update", str(folder / "run-3"), "--json", "-o", "u")
    after = json.loads(used.stdout)
    assert (after["priors"]["source"], after["priors"]["revision"]) == ("approved", 1)
    assert after["noise_model"]["gyro"]["turn_on_deg_h"] != 0.003
    words = ("update", str(folder / "run-3"), "--json", "-o", "u", "--priors")
    assert "priors" not in json.loads(recal(*words, "default").stdout)
    of_file = json.loads(recal(*words, str(kept)).stdout)
    assert of_file["priors"]["source"] == str(kept)
    assert of_file["observability"] == after["observability"]


def _next_of_a_forecast():
    assert recal("fleet", "forecast", "-o", "f").exit_code == 0
    return re.search(r'<pre class="command">(.*?)</pre>', Path("f/forecast.html").read_text())[1]


@pytest.mark.slow  # that draws do not feel the last digits: infield/test_learning.py
def test_what_is_learnt_is_the_same_with_more_threads(folder, learnt):
    """Two threads add in another order: values that differ at 4e-11 are kept as the same digits."""
    environment = os.environ | {"OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"}
    words = ("fleet", "learn", "--dry-run", "--json", "--store", URL, "-o", "two")
    command = [sys.executable, "-m", "recal", *words]
    done = subprocess.run(command, env=environment, capture_output=True, check=True)
    (of_two,), (of_one,) = json.loads(done.stdout)["technologies"], learnt["technologies"]
    assert {**of_two, "revision": 1} == of_one


def test_what_cannot_be_learnt_from_is_named(folder):
    done = recal("fleet", "learn", "--technology", "fog", "--json")
    assert done.exit_code == 4
    document = json.loads(done.stdout)
    assert document["reason_codes"] == ["no_sessions"]
    assert "no unit of fog with a table" in document["reasons"][0]
    nobody = recal("fleet", "learn", "--serial", "SN-NOPE", "-o", "nobody")
    assert nobody.exit_code == 4 and "SN-NOPE" in nobody.stdout
    assert recal("fleet", "learn", "--technology", "ring").exit_code == 2
    assert recal("fleet", "approve", "7", "--by", "K.", "--reason", "x").exception
    wrong = CliRunner().invoke(app, ["fleet", "learn", "--store", "sqlite:///none.db"])
    assert "///none.db" in str(wrong.exception)
    assert not Path("none.db").exists()
    Path("p.json").write_text('{"schema": "recal.table/1"}')
    bad = recal("update", str(folder / "run-3"), "--priors", "p.json")
    assert "'recal.priors/1'" in str(bad.exception)
