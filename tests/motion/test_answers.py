"""The frozen answers of every judge of rest and movement, asked again (issue 14, point 2).

An answer that is meant to change is written anew with `python -m tests.motion.answers` and named
in the CHANGELOG with the reason.
"""

from dataclasses import replace

import pytest

from tests.cut import cut_run
from tests.motion import answers
from tests.motion.runs import LEFT_OUT, RECORDED, SIMULATED

NAMED = (*SIMULATED, *RECORDED)
SMALL_BYTES = 300_000


@pytest.fixture(scope="module")
def frozen():
    return answers.read_answers()


def cases():
    for named in NAMED:
        marks = () if named.quick else pytest.mark.slow
        yield pytest.param(named, id=named.name, marks=marks)


@pytest.mark.parametrize("named", list(cases()))
def test_every_caller_answers_as_it_did(frozen, named):
    if why := answers.missing(named):
        pytest.skip(why)
    now = answers.answers_of(named.make())
    changed = list(answers.differences(frozen["runs"][named.name], now))
    assert not changed, "\n".join(changed)


def test_all_runs_are_frozen_and_every_caller_is_asked(frozen):
    assert list(frozen["runs"]) == [named.name for named in NAMED]
    for name, found in frozen["runs"].items():
        assert found.keys() == answers.CALLERS.keys(), name
    assert len(SIMULATED) >= 40
    assert answers.ANSWERS.stat().st_size < SMALL_BYTES


def test_every_shared_log_is_asked_or_left_out_with_a_reason(frozen):
    if not answers.DATA.is_dir():
        pytest.skip("../shared/data is not beside the project")
    files = {p.name for p in answers.DATA.iterdir() if p.is_file()} - {"README.md"}
    assert files == {named.needs for named in RECORDED} | LEFT_OUT.keys()
    assert frozen["left_out"] == LEFT_OUT


def test_every_caller_finds_something_somewhere(frozen):
    """A caller that was given what it cannot take in all runs would be frozen for nothing."""
    for caller in answers.CALLERS:
        found = [run[caller] for run in frozen["runs"].values()]
        good = [a for a in found if a and not (isinstance(a, dict) and "error" in a)]
        assert len(good) >= 5, caller


@pytest.mark.parametrize(
    ("now", "lines"),
    [
        ({"rest": [0.1, 600.0], "spans": [[0.1, 9.0, "still"]]}, []),
        ({"rest": [0.1, 600.01], "spans": [[0.1, 8.98, "still"]]}, []),
        (
            {"rest": [0.1, 600.03], "spans": [[0.1, 9.0, "still"]]},
            ["/rest[1]: 600.0 is now 600.03"],
        ),
        ({"rest": None, "spans": [[0.1, 9.0, "still"]]}, ["/rest: [0.1, 600.0] is now null"]),
        (
            {"rest": [0.1, 600.0], "spans": [[0.1, 9.0, "rolling"]]},
            ['/spans[0][2]: "still" is now "rolling"'],
        ),
        ({"rest": [0.1, 600.0]}, ['/spans: [[0.1, 9.0, "still"]] is now null']),
    ],
)
def test_what_differs_is_named(now, lines):
    before = {"rest": [0.1, 600.0], "spans": [[0.1, 9.0, "still"]]}
    assert list(answers.differences(before, now)) == lines


def test_a_log_that_begins_later_is_seen_by_all(frozen):
    """The test of the test: 75 s less of the log change the answer of every caller."""
    name = "taxi, all aids"
    case = next(named for named in NAMED if named.name == name).make()
    later = replace(case, run=cut_run(case.run, 75.0, case.run.imu.end_s))
    now = answers.answers_of(later)
    was = frozen["runs"][name]
    seen = {key for key in was if list(answers.differences(was[key], now[key]))}
    assert seen == answers.CALLERS.keys() - {"repairs"}  # nothing to repair in it
