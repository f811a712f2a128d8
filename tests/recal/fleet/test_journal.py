"""The journal survives a cut last line, tells of other damage, and counts only calls of the same
settings.
"""

from dataclasses import replace

import pytest

from ins.records import InputError
from recal.fleet.document import Timing
from recal.fleet.pools.journal import Journal
from recal.fleet.records import CallSettings, RunOutcome, TemperatureBand, UnitReport

SETTINGS = CallSettings(
    store="sqlite:///a.db", mode="commit", joint=False, config=None, version="1"
)
SUMMARY = UnitReport(of="x", coverage=(TemperatureBand(low_degC=0.0, high_degC=5.0, seconds=9.0),))
RUNS = [
    RunOutcome(path=f"/r{k}", outcome="committed", reasons=("why",), revision=k) for k in (1, 2)
]


def written(folder, settings=SETTINGS):
    journal = Journal(folder, settings, {"SN-1 (rlg)": 3})
    for run in RUNS:
        journal.add_run(run)
    journal.add_unit("SN-1", SUMMARY)
    journal.end(Timing().document(1.0))
    journal.close()
    return journal


def test_what_was_written_is_read_by_a_call_like_it_only(tmp_path):
    first = written(tmp_path)
    again = Journal(tmp_path, SETTINGS, {"SN-1 (rlg)": 9})
    assert again.runs == {run.path: run for run in RUNS} and again.units == {"SN-1": SUMMARY}
    assert again.heads == first.heads == {"SN-1 (rlg)": 3} and again.calls[0].timing.seconds == 1.0
    again.close()
    other = Journal(tmp_path, replace(SETTINGS, mode="propose"), {})
    assert not other.runs and not other.units
    other.close()


@pytest.mark.parametrize("cut", [1, 7, 120])
def test_a_cut_last_line_is_dropped_and_nothing_is_written_behind_it(tmp_path, cut):
    written(tmp_path)
    path = tmp_path / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:3])[:-cut])  # call, run 1, run 2
    again = Journal(tmp_path, SETTINGS, {"SN-1 (rlg)": 9})
    assert list(again.runs) == ["/r1"]
    again.add_run(RUNS[1])
    again.close()
    last = Journal(tmp_path, SETTINGS, {"SN-1 (rlg)": 9})
    assert list(last.runs) == ["/r1", "/r2"]
    last.close()


def test_a_damaged_line_is_named(tmp_path):
    written(tmp_path)
    path = tmp_path / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + b'{"event": 3\n' + lines[1])
    with pytest.raises(InputError, match="line 2 is damaged"):
        Journal(tmp_path, SETTINGS, {"SN-1 (rlg)": 9})


def test_two_parents_cannot_share_a_folder(tmp_path):
    first = Journal(tmp_path, SETTINGS, {"SN-1 (rlg)": 9})
    with pytest.raises(InputError, match="another recal fleet update is at work there"):
        Journal(tmp_path, SETTINGS, {"SN-1 (rlg)": 9})
    first.close()
    Journal(tmp_path, SETTINGS, {"SN-1 (rlg)": 9}).close()
