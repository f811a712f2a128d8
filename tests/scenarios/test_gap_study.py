"""Scores of the gap study on made-up records: each score in a case where it holds and one where it
does not.
"""

import pytest

from benchmarks import gap_scores

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


def test_top_is_the_most_probable_then_the_largest():
    small = cause("gyro_rate_ramp", "gyro_z", 0.98, size=6.0)
    assert gap_scores.on_top(record(small, RIGHT))
    assert not gap_scores.on_top(record({**small, "probability": 0.999}, RIGHT))


def test_a_rival_is_in_the_set_and_an_inseparable_one_only_if_counted():
    rival = cause("gyro_rate_ramp", "gyro_x", 0.6, rivals=[("gyro_thermal_rate", "gyro_x", 0.38)])
    assert gap_scores.in_set(record(rival)) and not gap_scores.on_top(record(rival))
    assert not gap_scores.in_set(record(LAG)) and gap_scores.in_set(record(LAG), confounded=True)
    assert not gap_scores.in_set(record(WRONG), confounded=True)


def test_wrong_and_confident_needs_a_name_and_no_right_rival():
    scored = gap_scores.wrong_and_confident
    assert scored(record(WRONG)) and not scored(record(RIGHT))
    assert not scored(record({**WRONG, "probability": 0.89}))
    assert not scored(record({**WRONG, "rivals": [("gyro_thermal_rate", "gyro_x", 0.01)]}))
    assert not scored(record(cause("unknown_function_of_time", "gyro_x", 0.99)))
    assert scored(record(LAG)) and not scored(record(LAG), confounded=True)


def test_unresolved_is_a_set_without_a_winner_or_a_verdict_that_says_so():
    open_set = cause(
        "gyro_rate_ramp", "gyro_x", 0.7, rivals=[("gyro_warmup_transient", "gyro_x", 0.3)]
    )
    assert gap_scores.unresolved(record(open_set))
    assert gap_scores.unresolved(record(WRONG, verdict="partly_explained"))
    assert not gap_scores.unresolved(record(WRONG))
    assert not gap_scores.unresolved(record(verdict="no_gap"))


def test_two_effects_need_a_cause_each():
    both = (TRUTH, OTHER)
    second = cause("accel_thermal", "accel_y", 0.9)
    assert gap_scores.on_top(record(second, RIGHT, planted=both))
    assert not gap_scores.on_top(record(RIGHT, WRONG, planted=both))
    one_set = cause("accel_thermal", "accel_y", 0.6, rivals=[("gyro_thermal_rate", "gyro_x", 0.4)])
    assert not gap_scores.in_set(record(one_set, planted=both))


@pytest.mark.parametrize(
    ("truth", "says"), [(0.6, True), (0.4, False), (0.95, False), (None, None)]
)
def test_the_shrink_interval_covers(truth, says):
    assert gap_scores.covered(record(RIGHT, true_shrink=[truth])) is says


@pytest.mark.parametrize(("wrong", "shown"), [(0, True), (4, False), (20, True)])
def test_a_goal_is_shown_only_where_the_interval_clears_it(wrong, shown):
    """93 % on top, 60 trials: 60 clear it from above, 56 straddle it, 40 fall short by more than
    the interval.
    """
    records = [record(RIGHT)] * (60 - wrong) + [record(WRONG)] * wrong
    question = gap_scores.Question("12", "on top", gap_scores.on_top, 0.93)
    assert gap_scores.answer(question, records)["shown"] is shown
