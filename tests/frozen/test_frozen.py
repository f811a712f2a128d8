"""The frozen answers, asked again: the quick ones in the normal suite, the others when slow.

An answer that is meant to move is renewed with `python -m tests.frozen renew`, and the CHANGELOG
says why, with the truth beside it.
"""

from dataclasses import replace

import pytest

from tests.cut import cut_run
from tests.frozen import motion, motion_runs
from tests.frozen.__main__ import absent, frozen_answers
from tests.frozen.answers import differences
from tests.frozen.cases import CASES

LEAST = {"motion": 55, "sessions": 40, "aided": 30, "diagnoses": 198, "twin_fits": 30}


def _cases():
    for kind, cases in CASES.items():
        for case in cases:
            marks = () if case.quick else pytest.mark.slow
            yield pytest.param(kind, case, id=f"{kind}, {case.name}", marks=marks)


@pytest.mark.parametrize(("kind", "case"), list(_cases()))
def test_the_answer_is_as_it_was(kind, case):
    if absent(case):
        pytest.skip(f"../shared/data/{case.needs} is not beside the project")
    lines = list(differences(frozen_answers(kind)[case.name], case.ask()))
    assert not lines, "\n".join(lines)


@pytest.mark.parametrize("kind", CASES)
def test_every_input_has_its_answer(kind):
    names = [case.name for case in CASES[kind]]
    assert len(set(names)) == len(names) >= LEAST[kind]
    assert list(frozen_answers(kind)) == names


FROZEN = {"words": {"verdict": "proposed"}, "estimates": {"x 20 degC": [0.010, 0.002]}}


@pytest.mark.parametrize(
    ("word", "mean", "sigma", "count"),
    [
        ("proposed", 0.010, 0.002, 0),
        ("proposed", 0.01009, 0.00203, 0),
        ("refused", 0.010, 0.002, 1),
        ("proposed", 0.01011, 0.002, 1),
        ("proposed", 0.00989, 0.002, 1),
        ("proposed", 0.010, 0.00205, 1),
        ("proposed", 0.010, 0.00195, 1),
    ],
)
def test_what_moved_is_named(word, mean, sigma, count):
    now = {"words": {"verdict": word}, "estimates": {"x 20 degC": [mean, sigma]}}
    assert len(list(differences(FROZEN, now))) == count


def test_an_estimate_that_came_or_went_is_named():
    now = {"words": FROZEN["words"], "estimates": {"y 20 degC": [0.0, 1.0]}}
    assert len(list(differences(FROZEN, now))) == 2


def test_every_shared_log_is_asked_or_left_out_with_a_reason():
    if not motion_runs.DATA.is_dir():
        pytest.skip("../shared/data is not beside the project")
    files = {p.name for p in motion_runs.DATA.iterdir() if p.is_file()} - {"README.md"}
    asked = {named.needs for named in motion_runs.RECORDED}
    assert files == asked | motion_runs.LEFT_OUT.keys()


def test_a_log_that_begins_later_is_seen_by_all_that_ask_for_motion():
    """75 s less of the log change the answer of every caller but of repairs: nothing to repair."""
    case = next(n for n in motion_runs.SIMULATED if n.name == "taxi, all aids").make()
    later = replace(case, run=cut_run(case.run, 75.0, case.run.imu.end_s))
    lines = list(differences(frozen_answers("motion")["taxi, all aids"], motion.of_motion(later)))
    seen = {line.split(":")[0].split(" ")[0] for line in lines}
    assert seen == motion.CALLERS.keys() - {"repairs"}
