"""A store or a unit that nobody asked for is not made; sigma that rests on defaults says so."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from ins.records import InputError
from ins.twin_file import default_twin, twin_to_dict
from recal.cli.app import app
from tests.infield.sessions import factory_dict, simulated
from trajectories.runs.directory import write_run

DEFAULTS = "every sigma rests on the defaults of rlg; recal twin fit run -o twin.json measures it"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "run", simulated().run)
    twin = replace(default_twin("rlg"), imu_serial="SN-0042")
    Path("twin.json").write_text(json.dumps(twin_to_dict(twin)))
    return tmp_path


def update(url, *more):
    return CliRunner().invoke(app, ["update", "run", "--store", url, "-o", "out", "--json", *more])


@pytest.mark.parametrize("stores", ["--commit", "--propose"])
def test_a_unit_that_the_store_does_not_hold_is_refused(folder, url, stores):
    with TableStore.open(url, create=True) as store:
        store.import_table({**factory_dict(), "imu_serial": "SN-7"})
    done = update(url, stores)
    document = json.loads(done.stdout)
    assert done.exit_code == 4 and document["verdict"] == "refused"
    assert document["reason_codes"] == ["unit_not_in_store"] and len(document["reasons"]) == 1
    assert "SN-0042" in document["reasons"][0]
    assert document["reasons"][0].endswith("--new-unit to begin with the default of rlg")
    assert [run["run_id"] for run in document["runs"]] == ["run-1"]
    assert document == json.loads(Path("out/update.json").read_text())
    assert "holds no table of SN-0042" in Path("out/update.html").read_text()
    with TableStore.open(url) as store:
        assert [summary.unit.imu_serial for summary in store.overview()] == ["SN-7"]


@pytest.mark.parametrize("asked", [(), ("--new-unit",), ("--new-store",)])
def test_a_mistyped_store_is_not_made(folder, asked):
    done = update("sqlite:///typo.db", "--commit", *asked)
    document = json.loads(done.stdout)
    code = "unit_not_in_store" if "--new-store" in asked else "no_store"
    assert (done.exit_code, document["reason_codes"]) == (4, [code])
    assert "typo.db" in document["reasons"][0] or code != "no_store"
    assert not Path("typo.db").exists()


def test_a_mistyped_store_is_named_where_nothing_is_stored(folder, monkeypatch):
    """An update against no table at all looks like any other: whoever named a store is told."""

    def stop(*_):
        raise InputError("far enough")

    monkeypatch.setattr("recal.service.update._estimate", stop)
    assert "///typo.db" in update("sqlite:///typo.db").stderr
    assert "no store" not in update("sqlite:///recal.db").stderr


def test_asked_for_by_name_both_are_made(folder, url):
    done = update(url, "--commit", "--new-store", "--new-unit")
    assert (done.exit_code, json.loads(done.stdout)["verdict"]) == (0, "committed")
    with TableStore.open(url) as store:
        assert [r.kind for r in store.history()] == ["factory", "update"]


def test_sigma_says_whether_it_rests_on_defaults(folder):
    """On the terminal, in JSON and on the page; silent where the twin is given or stored."""
    url = "sqlite:///recal.db"
    with TableStore.open(url, create=True) as store:
        store.import_table(factory_dict())
    done = update(url)
    document = json.loads(done.stdout)
    assert document["noise_source"] == "defaults of rlg" and DEFAULTS in document["noise_note"]
    words = CliRunner().invoke(app, ["update", "run", "--store", url, "-o", "out"])
    assert f"note: {document['noise_note']}" in words.stdout
    assert "every sigma rests on the defaults of rlg" in Path("out/update.html").read_text()
    aligned = CliRunner().invoke(app, ["align", "run", "--store", url, "--json"])
    assert json.loads(aligned.stdout)["noise_source"] == "defaults of rlg"
    assert DEFAULTS in json.loads(aligned.stdout)["noise_note"]
    words = CliRunner().invoke(app, ["align", "run", "--store", url])
    assert DEFAULTS in words.stdout
    given = json.loads(update(url, "--twin", "twin.json").stdout)
    assert given["noise_source"] == "twin file" and "noise_note" not in given
    with TableStore.open(url) as store:
        store.import_table(factory_dict(), twin=replace(default_twin("rlg"), imu_serial="SN-0042"))
    stored = json.loads(update(url).stdout)
    assert stored["noise_source"] == "store" and "noise_note" not in stored
