"""`recal update --propose` and `recal table proposals|approve|reject` as a user runs them."""

import json

import pytest

from infield.store.table_store import MergedRun, TableStore
from infield.table.file import table_to_dict
from infield.table.thermal_table import EvenNodes, default_table
from tests.infield.sessions import factory, factory_dict, shifted, simulated
from tests.recal.command import answered, run
from tests.recal.verbs import update
from trajectories.runs.directory import write_run

URL = "sqlite:///recal.db"


def put_forward(serials=("SN-1",), *, shift_deg_h=0.001, run_id="run-1"):
    """Units with a table each and a proposal each."""
    with TableStore.open(URL, create=True) as store:
        for serial in serials:
            old = default_table(
                imu_serial=serial,
                gyro_technology="rlg",
                created_utc="2026-03-01T05:00:00Z",
                span=EvenNodes(high_degC=20),
            )
            first = store.import_table(table_to_dict(old))
            said = {"parent_sha256": first.sha256, "runs": []}
            new = first.table.replaced(
                parameters=first.table.parameters + shift_deg_h, provenance=said
            )
            store.propose(
                first.sha256,
                new,
                [MergedRun(run_id=run_id, sha256=run_id)],
                '{"verdict": "proposed"}',
                by="fleet",
            )


def test_an_update_is_proposed_rejected_proposed_again_and_approved(folder):
    write_run(folder / "run", simulated().run)
    with TableStore.open(URL, create=True) as store:
        first = store.import_table(factory_dict())
    document = answered(
        "update",
        "run",
        "--propose",
        "--by",
        "B. Proposer",
        "--note",
        "after the A check",
        "-o",
        "out",
    )
    assert document["verdict"] == "proposed"
    assert document["proposal"] == 1
    assert document["revision"] is None
    assert document == json.loads((folder / "out/update.json").read_text())
    page = (folder / "out/update.html").read_text()
    assert "waits as proposal 1" in page and "approve 1" in page and "with --commit" not in page
    (listed,) = answered("table", "proposals")["proposals"]
    assert listed["state"] == "open"
    assert listed["proposed_by"] == "B. Proposer"
    assert listed["note"] == "after the A check"
    shown = answered("table", "proposals", "1")
    assert shown["report"]["points"] == document["points"]
    assert "mean bias of the run, 1 sigma" in run("table", "proposals", "1").stdout

    def again(note=""):
        return update(
            [folder / "run"], store_url=URL, commit=False, propose=("B", note), html=False
        )

    assert again()["proposal"] == 1  # the same update is kept once
    answered("table", "reject", 1, "--by", "A", "--reason", "towed at minute 12")
    refused = again()
    assert refused["verdict"] == "refused" and "rejected by A on" in refused["reasons"][0]
    assert "towed at minute 12" in refused["reasons"][0]
    assert again(note="it was not towed")["proposal"] == 2
    approved = answered("table", "approve", 2, "--by", "A. Reviewer", "--reason", "white residuals")
    assert (approved["verdict"], approved["decision"]["revision"]) == ("approved", 2)
    for number, state, by in ((1, "rejected", "A"), (2, "approved", "A. Reviewer")):
        answered("table", "proposals", number, "-o", "decided", "--force")
        decided = json.loads((folder / "decided/update.json").read_text())
        assert (decided["proposal_state"], decided["decision"]["by"]) == (state, by)
        assert f"approve {number}" not in (folder / "decided/update.html").read_text()
    with TableStore.open(URL) as store:
        assert store.active().sha256 == document["table_after_sha256"] != first.sha256
        assert store.active().note == "proposal 2 approved by A. Reviewer: white residuals"


@pytest.mark.slow
def test_an_inconsistent_update_is_not_proposed(folder):
    # the table is of another unit: 0.1 deg/h off, forty of its sigmas
    write_run(folder / "run", simulated().run)
    with TableStore.open(URL, create=True) as store:
        store.import_table(table_to_dict(shifted(factory(), (0.1, 0.0, 0.0))))
    answered("update", "run", "--propose", "-o", "out", exit_code=5)
    with TableStore.open(URL) as store:
        assert store.proposals() == []
        assert store.active().number == 1


def test_a_proposal_is_written_as_files(folder, monkeypatch):
    from infield.reports import update_page as report

    monkeypatch.setattr(report, "update_html", lambda document: f"proposal {document['proposal']}")
    records = "infield.reports.documents.update_records"
    monkeypatch.setattr(f"{records}.update_of", lambda document: document)
    monkeypatch.setattr("recal.service.results.update_summary.stored_summary", lambda document: [])
    put_forward()
    assert run("table", "proposals", 1, "-o", "again").exit_code == 0
    found = json.loads((folder / "again/update.json").read_text())
    assert found == {"verdict": "proposed", "proposal": 1, "proposal_state": "open"}
    assert (folder / "again/update.html").read_text() == "proposal 1"


def test_commit_and_propose_exclude_each_other(folder):
    result = run("update", "run", "--commit", "--propose")
    assert result.exit_code == 2
    assert "give one of them" in " ".join(result.output.replace("│", " ").split())
    assert not list(folder.iterdir())


def test_files_are_written_of_one_proposal(folder):
    assert run("table", "proposals", "-o", "out").exit_code == 2 and not list(folder.iterdir())
