"""The driver of the studies: their options, work that is gone on with, tables kept as JSON."""

import argparse
import json

import pytest

from benchmarks import __main__ as driver
from benchmarks import results
from benchmarks.study import Work, interval_95, share, table


def squared(value: int, of: str) -> dict:
    if value < 0:
        raise ValueError("below zero")
    return {"of": of, "square": value**2}


def run(work: Work, *, last: int = 3, names: tuple[str, ...] = ("a",), plain: bool = False) -> str:
    found = work.each(squared, [(k, name) for name in names for k in range(last)])
    return table(("of", "square"), [(r["of"], r["square"]) for r in found])


@pytest.fixture
def made_up(monkeypatch):
    monkeypatch.setattr(driver, "run_of", lambda name: run)
    monkeypatch.setattr(driver, "words_of", lambda name: "A study.")


def test_options_are_the_study_s_own_and_its_records_are_printed(made_up, capsys):
    assert driver.run_study("study", ["--last", "2", "--names", "b", "c", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    found = [(r["of"], r["square"]) for r in said["records"]]
    assert found == [("b", 0), ("b", 1), ("c", 0), ("c", 1)]
    assert said["options"] == {"last": 2, "names": ["b", "c"], "plain": False}
    assert said["text"].splitlines()[-1] == "| c | 1 |"


def test_what_was_stopped_goes_on(tmp_path, monkeypatch):
    path = tmp_path / "kept.jsonl"
    first = Work(path).each(squared, [(1, "a"), (2, "a")])
    path.write_text(path.read_text() + '{"task": "cut o')
    monkeypatch.setattr(f"{__name__}.squared.__code__", (lambda value, of: 7).__code__)
    assert Work(path).each(squared, [(2, "a"), (3, "a"), (1, "a")]) == [first[1], 7, first[0]]
    assert len(path.read_text().splitlines()) == 3


def test_a_task_that_fails_is_told_and_tried_again(tmp_path, capsys):
    work = Work(tmp_path / "kept.jsonl")
    assert work.each(squared, [(-1, "a"), (2, "a")]) == [{"of": "a", "square": 4}]
    assert len(work.failed) == 1 and "ValueError: below zero" in work.failed[0]
    assert len((tmp_path / "kept.jsonl").read_text().splitlines()) == 1


def test_nothing_is_begun_after_the_time_that_is_given():
    assert Work(until="00:00").each(squared, [(1, "a")]) == []


@pytest.mark.slow
def test_two_processes_give_what_one_gives(tmp_path):
    tasks = [(k, "a") for k in range(5)]
    assert Work(jobs=2).each(squared, tasks) == Work().each(squared, tasks)


def test_tables_of_a_study_are_kept_as_json(made_up, tmp_path, monkeypatch):
    monkeypatch.setattr(results, "FOLDER", tmp_path / "results")
    assert driver.run_study("study", ["--last", "2", "--write"]) == 0
    document = json.loads((tmp_path / "results/study.json").read_text("utf-8"))
    assert document["command"].endswith("study --last 2")
    table = document["tables"][0]
    assert ["a", "1"] in table["rows"]
    assert all(len(row) == len(table["columns"]) for row in table["rows"])


def test_kept_results_are_tables():
    """Transcribed or written: each row has its columns, and a command or a commit made it."""
    kept = [json.loads(p.read_text("utf-8")) for p in results.FOLDER.glob("*.json")]
    assert len(kept) >= 8
    for document in kept:
        assert document["command"] or document["commit"]
        for kept_table in document["tables"]:
            columns = len(kept_table["columns"])
            assert all(len(row) == columns for row in kept_table["rows"]), document["study"]


@pytest.mark.parametrize("name", sorted(driver.STUDIES))
def test_every_study_says_what_it_is_and_has_options(name):
    assert driver.words_of(name)
    driver.add_options(argparse.ArgumentParser(), driver.run_of(name))


def test_shares_have_clopper_pearson_intervals():
    """None of n has the upper end 1 - 0.025^(1/n)."""
    assert interval_95(0, 20) == (0.0, pytest.approx(1 - 0.025 ** (1 / 20), abs=1e-12))
    assert interval_95(20, 20) == pytest.approx((0.025 ** (1 / 20), 1.0), abs=1e-12)
    assert share(0, 20) == "0 of 20 (0.0 to 16.8 %)"
