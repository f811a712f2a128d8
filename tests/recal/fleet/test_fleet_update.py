"""The spine with its tasks in this process: same tables as `recal update`, failures isolated,
nothing twice, nothing lost.
"""

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from infield.store.table_store import TableStore
from infield.table.file import table_from_dict, table_to_dict
from ins.documents import plain
from recal.cli.app import app
from recal.fleet.pools import work
from recal.fleet.update import FleetRequest, update_fleet
from tests.infield.sessions import factory_dict, shifted
from tests.recal.fleet.made_fleet import SERIALS, UPDATES, history, run_of
from tests.recal.verbs import update
from trajectories.runs.directory import write_run

URL = "sqlite:///recal.db"


def call(mode="commit", source="runs", output="out", store_url=URL, **more):
    request = FleetRequest(
        source=Path(source),
        store_url=store_url,
        output=Path(output),
        mode=mode,
        pages="none",
        **more,
    )
    return plain(update_fleet(request))


def outcomes(document):
    return {
        Path(run["path"]).parent.name + "/" + Path(run["path"]).name: run["outcome"]
        for run in document["runs"]
    }


def lines(output="out", event="run"):
    text = (Path(output) / "journal.jsonl").read_text()
    return [line for line in map(json.loads, text.splitlines()) if line["event"] == event]


def test_tables_are_those_of_recal_update_run_after_run(fleet, inline):
    document = call()
    assert document["verdict"] == "committed" and set(outcomes(document).values()) == {"committed"}
    active = {serial: history(fleet, serial)[-1].table_json for serial in SERIALS}
    with TableStore.open(URL) as store:
        for serial in SERIALS:
            store.rollback(serial, by="B", reason="wrong run")
    for k in (0, 1):
        update(
            [fleet / "runs" / "SN-B" / f"flight-{k}"],
            store_url=URL,
            commit=True,
            output=fleet / "o",
            html=False,
        )
    by_hand = json.loads(history(fleet, "SN-B")[-1].table_json)
    by_fleet = json.loads(active["SN-B"])
    assert by_hand["axes"] == by_fleet["axes"] and by_hand["covariance"] == by_fleet["covariance"]


def test_a_second_call_does_nothing_and_says_the_same(fleet, inline):
    first = call()
    assert len(inline[0].seen) == UPDATES + len(SERIALS)  # each run, then each unit's summary
    second = call()
    assert len(inline) == 1  # no pool was needed
    assert second["counts"] == first["counts"]
    assert second["units"][0]["drift"] == first["units"][0]["drift"]
    assert [len(history(fleet, serial)) for serial in SERIALS] == [3, 3, 3]
    assert second["timing"]["runs"] == 0 and len(second["timing"]["earlier_calls"]) == 1


def spoil_some(fleet):
    """Runs of every bad kind beside the good ones; what each should come to."""
    runs = fleet / "runs"
    data = (runs / "SN-A/flight-1/imu.parquet").read_bytes()
    (runs / "SN-A/flight-1/imu.parquet").write_bytes(data[:1000])
    (runs / "SN-B/flight-1/temperature.parquet").unlink()
    shutil.copytree(runs / "SN-C/flight-0", runs / "SN-C/flight-0-again")
    (runs / "SN-C/flight-1/run.json").write_text("{")
    write_run(runs / "SN-C" / "flight-2", run_of("SN-C", 1, start_utc="1970-01-01T00:00:00Z"))
    return {
        "SN-A/flight-0": "committed",
        "SN-A/flight-1": "bad_input",
        "SN-B/flight-0": "committed",
        "SN-B/flight-1": "refused",
        "SN-C/flight-0": "committed",
        "SN-C/flight-0-again": "already",
        "SN-C/flight-1": "bad_input",
        "SN-C/flight-2": "bad_input",
    }


@pytest.mark.parametrize("joint", [False, True])
def test_bad_runs_are_told_and_stop_nothing(fleet, inline, joint):
    expected = spoil_some(fleet)
    document = call(joint=joint)
    assert outcomes(document) == expected and document["verdict"] == "committed"
    reasons = {
        Path(r["path"]).name: r["reasons"] for r in document["runs"] if r["imu_serial"] == "SN-C"
    }
    assert reasons["flight-0-again"] == [f"the same recording as {fleet}/runs/SN-C/flight-0"]
    groups = sorted((g["outcome"], g["count"]) for g in document["left_out"])
    assert groups == [("bad_input", 1)] * 3 + [("refused", 1)]
    assert not any("SN-" in g["reason"] or str(fleet) in g["reason"] for g in document["left_out"])


def test_proposals_wait_in_the_store_one_a_unit(fleet, inline):
    expected = spoil_some(fleet)
    document = call("propose", by="a fleet test")
    assert outcomes(document) == {
        k: "proposed" if v == "committed" else v for k, v in expected.items()
    }
    with TableStore.open(URL) as store:
        waiting = store.proposals()
        assert [(p.unit.imu_serial, p.proposed_by, len(p.runs)) for p in waiting] == [
            (s, "a fleet test", 1) for s in SERIALS
        ]
        (number,) = [p.number for p in waiting if p.unit.imu_serial == "SN-B"]
        assert store.decide(number, "approved", by="x", reason="y").decision is not None
    assert {u["proposal"] for u in document["units"]} == {1, 2, 3}
    assert len(history(fleet, "SN-A")) == 1 and len(history(fleet, "SN-B")) == 2
    call("propose")
    with TableStore.open(URL) as store:
        assert len(store.proposals()) == 3


def test_a_dry_run_stores_nothing(fleet, inline):
    before = (fleet / "recal.db").read_bytes()
    assert call("dry")["counts"]["proposed"] == UPDATES
    assert (fleet / "recal.db").read_bytes() == before


def test_a_commit_the_worker_could_not_tell_of_is_found_again(fleet, inline, monkeypatch):
    """Killed after the commit: no line, no report; the next call finds the run in the store."""
    real = work.take_runs

    def dies_once(task):
        result = real(task)
        if task.attempt == 1 and task.runs[0].run_id == "SN-A-0":
            shutil.rmtree(task.folders[0])
            raise _Killed
        return result

    monkeypatch.setattr(work, "take_runs", dies_once)
    with pytest.raises(_Killed):
        call()
    assert len(history(fleet, "SN-A")) == 2 and not lines()
    monkeypatch.setattr(work, "take_runs", real)
    document = call()
    assert document["counts"]["committed"] == UPDATES
    run = next(r for r in document["runs"] if r["run_id"] == "SN-A-0")
    assert "found in the store" in run["notes"][-1] and run["revision"] == 2
    report = json.loads((Path("out") / run["report"]).read_text())
    assert report["verdict"] == "committed"
    assert [r["sha256"] for r in report["runs"]] == [run["sha256"]]
    assert [r.kind for r in history(fleet, "SN-A")] == ["factory", "update", "update"]


class _Killed(BaseException):
    pass


def test_a_dead_worker_costs_a_try_and_three_cost_the_run(fleet, inline):
    deaths = []

    def spoil(task):
        if hasattr(task, "runs") and task.runs[0].run_id in ("SN-A-0", "SN-B-0"):
            deaths.append(task)
            return (
                "killed by SIGKILL"
                if task.attempt < (2 if task.runs[0].run_id == "SN-B-0" else 9)
                else ""
            )
        return ""

    from recal.fleet import update as spine
    from tests.recal.fleet.made_fleet import InlinePool

    spine.LocalPool = lambda workers: InlinePool(spoil=spoil)
    document = call()
    found = outcomes(document)
    assert found.pop("SN-A/flight-0") == "crashed" and set(found.values()) == {"committed"}
    run = next(r for r in document["runs"] if r["run_id"] == "SN-A-0")
    assert run["reasons"] == ["worker died 3 times at this run: killed by SIGKILL"]
    assert next(r for r in document["runs"] if r["run_id"] == "SN-B-0")["attempts"] == 2
    spine.LocalPool = lambda workers: InlinePool()
    assert outcomes(call())["SN-A/flight-0"] == "committed"  # the next call tries again


def test_a_rollback_is_respected(fleet, inline):
    call()
    with TableStore.open(URL) as store:
        store.rollback("SN-C", by="B", reason="wrong run")
    document = call()
    assert document["counts"]["taken_out"] == 2 and len(history(fleet, "SN-C")) == 4
    assert call(output="anew")["counts"]["committed"] == 2


def test_a_stepped_unit_is_named_and_not_followed(fleet, inline):
    table = table_to_dict(
        shifted(table_from_dict(factory_dict(), name="factory"), (-0.05, 0.0, 0.0))
    )
    with TableStore.open(URL) as store:
        store.import_table({**table, "imu_serial": "SN-A"})
    document = call()
    assert document["counts"]["inconsistent"] == 2 and document["counts"]["committed"] == 4
    unit = next(u for u in document["units"] if u["imu_serial"] == "SN-A")
    assert len(unit["step_words"]) == 1 and "--accept-step" in unit["step_words"][0]
    assert unit["table"]["contradictions"] == 2 and unit["table"]["kind"] == "import"
    assert (
        "2 sessions contradict it"
        in next(s for s in document["stale"] if s["imu_serial"] == "SN-A")["reasons"]
    )


def test_exit_codes_and_json(fleet, inline):
    def exit_code(*arguments):
        done = CliRunner().invoke(
            app,
            [
                "fleet",
                "update",
                *arguments,
                "--store",
                URL,
                "--commit",
                "--pages",
                "none",
                "--json",
            ],
        )
        return done.exit_code, json.loads(done.stdout)

    spoil_some(fleet)
    assert exit_code("runs/SN-B/flight-1", "-o", "o1")[0] == 4
    assert exit_code("runs/SN-A/flight-1", "-o", "o2")[0] == 3
    code, document = exit_code("runs", "-o", "o3")
    assert code == 0 and document == json.loads(Path("o3/fleet.json").read_text())
    code, document = exit_code("runs/SN-B/flight-0", "-o", "o4")
    assert code == 0 and document["verdict"] in ("up_to_date", "committed")
    code, document = exit_code("nowhere", "-o", "o5")
    assert document["schema"] == "recal.error/1" and "no such folder" in document["reasons"][0]
