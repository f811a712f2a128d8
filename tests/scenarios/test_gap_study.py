"""Scores of the gap study on made-up records: each score in a case where it holds and one where it
does not.
"""

import json

import pytest

from benchmarks import gap_study, gap_study_document, gap_study_scores, gap_study_summary

TRUTH = {
    "effect": "gyro_thermal_rate",
    "target": "gyro_x",
    "answers": ["gyro_thermal_rate"],
    "targets": ["gyro_x"],
    "confounded": ["gyro_thermal_lag"],
}
OTHER = {
    "effect": "accel_thermal",
    "target": "accel_y",
    "answers": ["accel_thermal"],
    "targets": ["accel_y"],
    "confounded": [],
}


def cause(effect, target, probability, *, rivals=(), shrink=(0.8, 0.5, 0.9, 10.0), size=12.0):
    return {
        "effect": effect,
        "target": target,
        "probability": probability,
        "rivals": list(rivals),
        "size": size,
        "shrink": list(shrink),
        "held_out": "leave one run out",
    }


def record(
    *causes, cell="12", planted=(TRUTH,), verdict="explained", where=(("gyro_x", 0.9),), **more
):
    base = {
        "cell": cell,
        "seed": 0,
        "commit": "made-up",
        "planted": list(planted),
        "causes": list(causes),
        "cpu_s": 1.0,
        "verdict": verdict,
        "where": [list(w) for w in where],
        "p_value": 0.5,
        "p_left": 0.5,
        "looks_like": "",
    }
    return {**base, **more}


RIGHT = cause("gyro_thermal_rate", "gyro_x", 0.98)
WRONG = cause("gyro_rate_ramp", "gyro_x", 0.95)
LAG = cause("gyro_thermal_lag", "gyro_x", 0.95)


def test_the_right_name_on_another_axis_is_wrong():
    assert gap_study_scores.on_top(record(RIGHT))
    assert not gap_study_scores.on_top(record(cause("gyro_thermal_rate", "gyro_y", 0.98)))
    assert not gap_study_scores.on_top(record())


def test_top_is_the_most_probable_then_the_largest():
    small = cause("gyro_rate_ramp", "gyro_z", 0.98, size=6.0)
    assert gap_study_scores.on_top(record(small, RIGHT))
    assert not gap_study_scores.on_top(record({**small, "probability": 0.999}, RIGHT))


def test_a_rival_is_in_the_set_and_an_inseparable_one_only_if_counted():
    rival = cause("gyro_rate_ramp", "gyro_x", 0.6, rivals=[("gyro_thermal_rate", "gyro_x", 0.38)])
    assert gap_study_scores.in_set(record(rival)) and not gap_study_scores.on_top(record(rival))
    assert not gap_study_scores.in_set(record(LAG)) and gap_study_scores.in_set(
        record(LAG), confounded=True
    )
    assert not gap_study_scores.in_set(record(WRONG), confounded=True)


def test_wrong_and_confident_needs_a_name_and_no_right_rival():
    scored = gap_study_scores.wrong_and_confident
    assert scored(record(WRONG)) and not scored(record(RIGHT))
    assert not scored(record({**WRONG, "probability": 0.89}))
    assert not scored(record({**WRONG, "rivals": [("gyro_thermal_rate", "gyro_x", 0.01)]}))
    assert not scored(record(cause("unknown_function_of_time", "gyro_x", 0.99)))
    assert scored(record(LAG)) and not scored(record(LAG), confounded=True)


def test_unresolved_is_a_set_without_a_winner_or_a_verdict_that_says_so():
    open_set = cause(
        "gyro_rate_ramp", "gyro_x", 0.7, rivals=[("gyro_warmup_transient", "gyro_x", 0.3)]
    )
    assert gap_study_scores.unresolved(record(open_set))
    assert gap_study_scores.unresolved(record(WRONG, verdict="partly_explained"))
    assert not gap_study_scores.unresolved(record(WRONG)) and not gap_study_scores.unresolved(
        record(verdict="no_gap")
    )


def test_two_effects_need_a_cause_each():
    both = (TRUTH, OTHER)
    second = cause("accel_thermal", "accel_y", 0.9)
    assert gap_study_scores.on_top(record(second, RIGHT, planted=both))
    assert not gap_study_scores.on_top(record(RIGHT, WRONG, planted=both))
    one_set = cause("accel_thermal", "accel_y", 0.6, rivals=[("gyro_thermal_rate", "gyro_x", 0.4)])
    assert not gap_study_scores.in_set(record(one_set, planted=both))


def test_first_place():
    on_vehicle = {**TRUTH, "target": "vehicle", "targets": ["vehicle"]}
    place = [("accel_x", 0.7)]
    assert gap_study_scores.where_right(record(RIGHT)) and not gap_study_scores.where_right(
        record(RIGHT, where=place)
    )
    assert gap_study_scores.where_right(
        record(planted=[on_vehicle], where=place, energy={"accel_x": 0.3})
    )
    assert not gap_study_scores.where_right(
        record(planted=[on_vehicle], where=place, energy={"accel_x": 0.1})
    )
    assert not gap_study_scores.where_right(record(RIGHT, where=()))
    assert gap_study_scores.where_energy(record(RIGHT, where=place, energy={"accel_x": 0.3}))
    assert (
        gap_study_scores.where_energy(record(RIGHT, where=place, energy={"accel_x": 0.1})) is False
    )
    assert gap_study_scores.where_energy(record(RIGHT, where=place, energy={})) is None


def test_noise_is_named_as_noise_alone():
    planted = (
        {
            "effect": "declared_noise",
            "target": "gyro_x",
            "answers": ["gyro_angle_random_walk"],
            "targets": ["gyro_x", "gyro_y"],
            "confounded": [],
        },
    )
    noise = cause("gyro_angle_random_walk", "gyro_y", 0.99)
    assert gap_study_scores.as_noise(record(noise, planted=planted))
    assert not gap_study_scores.as_noise(record(noise, WRONG, planted=planted))
    assert gap_study_scores.as_drift(record(noise, WRONG, planted=planted))
    assert not gap_study_scores.as_drift(record(noise, planted=planted))


def test_names_given_without_the_true_effect():
    scored = gap_study_scores.named_falsely
    assert scored(record(WRONG)) and not scored(record(cause("slow_variation", "gyro_x", 0.99)))
    assert scored(record(LAG)) and not scored(record(LAG), confounded=True)
    assert scored(record(cause("unknown_function_of_time", "gyro_x", 0.99), WRONG))


@pytest.mark.parametrize(
    ("truth", "says"), [(0.6, True), (0.4, False), (0.95, False), (None, None)]
)
def test_the_shrink_interval_covers(truth, says):
    assert gap_study_scores.covered(record(RIGHT, true_shrink=[truth])) is says


def test_the_interval_of_a_share():
    """Clopper-Pearson by hand: none of n has the upper end 1 - 0.025^(1/n)."""
    low, high = gap_study_scores.interval(0, 20)
    assert low == 0.0 and high == pytest.approx(1 - 0.025 ** (1 / 20), abs=1e-12)
    assert gap_study_scores.interval(20, 20) == pytest.approx((0.025 ** (1 / 20), 1.0), abs=1e-12)


def test_calibration_counts_every_member_of_the_set():
    rival = cause("gyro_rate_ramp", "gyro_x", 0.6, rivals=[("gyro_thermal_rate", "gyro_x", 0.38)])
    bins = {
        (b["low"], b["high"]): b
        for b in gap_study_scores.calibration([record(rival), record(RIGHT)])
    }
    assert (bins[0.3, 0.5]["right"], bins[0.3, 0.5]["claims"]) == (1, 1)
    assert (bins[0.5, 0.7]["right"], bins[0.5, 0.7]["claims"]) == (0, 1)
    assert bins[0.9, 0.99]["claimed"] == pytest.approx(0.98)


def test_a_study_is_read_summed_up_and_drawn(tmp_path):
    """A cut-off line is left out; goals are judged; what fails and what misses is listed; other
    commits are left out.
    """
    quiet = record(cell="none", planted=(), verdict="no_gap")
    loud = record(cell="none", planted=(), verdict="unexplained", where=())
    failed = {
        "cell": "12",
        "seed": 9,
        "commit": "made-up",
        "failed": "ValueError: x",
        "at": ["a", "b"],
    }
    old = record(WRONG, commit="older")
    lines = [json.dumps(r) + "\n" for r in (record(RIGHT), record(WRONG), quiet, loud, failed, old)]
    path = tmp_path / "trials.jsonl"
    path.write_text("".join(lines) + '{"cell": "1')
    gap_study.main(["--out", str(path), "--draw", str(tmp_path), "--commit", "made-up"])
    summary = json.loads((tmp_path / "gap_study.json").read_text())
    answers = {(a["cell"], a["words"]): a for a in summary["answers"]}
    assert (
        answers["12", "right effect and target on top"]["k"],
        answers["12", "right effect and target on top"]["n"],
    ) == (1, 2)
    assert answers["12", "right effect and target on top"]["met"] is False
    assert answers["12", "right effect and target on top"]["shown"] is False  # 1 of 2 may be 93 %
    assert answers["none", "p-value below 0.05 (the level a user sets)"]["met"] is True
    assert summary["cells"]["12"] == {"diagnosed": 2, "skipped": 0, "failed": 1}
    assert len(summary["misses"]) == 3  # the wrong name, the alarm, the failure
    assert [c["commit"] for c in summary["earlier"]] == ["older"]
    assert summary["earlier"][0]["answers"][0]["k"] == 0
    text = (tmp_path / "gap_study.md").read_text()
    assert "one effect, 12 sigma: right effect and target on top 1 of 2 = 50.0 %" in text
    assert (tmp_path / "gap_study.svg").stat().st_size > 1000


@pytest.mark.parametrize(("wrong", "shown"), [(0, True), (4, False), (20, True)])
def test_a_goal_is_shown_only_where_the_interval_clears_it(wrong, shown):
    """93 % on top, 60 trials: 60 clear it from above, 56 straddle it, 40 fall short by more than
    the interval.
    """
    records = [record(RIGHT)] * (60 - wrong) + [record(WRONG)] * wrong
    question = gap_study_summary.Question("12", "on top", gap_study_scores.on_top, 0.93)
    assert gap_study_summary.answer(question, records)["shown"] is shown


def test_the_questions_ask_only_of_cells_that_exist():
    from benchmarks.gap_study_document import TITLES
    from benchmarks.gap_study_trial import CELLS

    assert {q.cell for q in gap_study_summary.QUESTIONS} <= set(CELLS) == set(TITLES)


def test_the_oracle_is_right_where_it_alarms_and_names_the_planted_effect():
    right = {"effect": "gyro_thermal_rate", "target": "gyro_x", "probability": 0.9, "alarm": True}
    quiet = {**right, "alarm": False}
    other = {**right, "target": "gyro_y"}
    assert gap_study_scores.oracle_on_top(record(RIGHT, oracle=right)) is True
    assert gap_study_scores.oracle_on_top(record(RIGHT, oracle=quiet)) is False
    assert gap_study_scores.oracle_on_top(record(RIGHT, oracle=other)) is False
    assert gap_study_scores.oracle_on_top(record(RIGHT, oracle=None)) is None
    assert gap_study_scores.oracle_on_top(record(RIGHT)) is None


def test_the_page_sets_oracle_and_diagnosis_side_by_side_on_the_same_trials():
    right = {"effect": "gyro_thermal_rate", "target": "gyro_x", "probability": 0.9, "alarm": True}
    records = [record(RIGHT, oracle=right), record(WRONG, oracle=right), record(RIGHT)]
    summary = gap_study_summary.summarise(records)
    seen = [a["oracle"] for a in summary["answers"] if a["oracle"]]
    assert seen == [{"right": 2, "ours": 1, "trials": 2}]
    text = gap_study_document.page({**summary, "earlier": [], "speed": ""})
    assert "| 2; 1 of 2 |" in text
