"""Scores of the blind trials: what is right, in the set, unresolved, wrong and confident; and what
issue 4 asks of them, each question with its cell, score and goal.

right: name among the planted answers and target among its targets. The top cause is the one of
largest probability (to 0.001; then of largest size). Generic answers (unknown ..., slow_variation)
are no names: never "wrong and confident".
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from benchmarks.study import Record, interval_95
from ins.errors.base import SLOW_NAME
from ins.errors.gyro.noise import NOISE_OF_TIME
from ins.errors.unnamed import FREE_FUNCTIONS
from simreal.inference.verdict import GapVerdict

CONFIDENT = 0.9
# descriptions, not causes
GENERIC_ANSWERS = {*FREE_FUNCTIONS, SLOW_NAME, NOISE_OF_TIME}
# of the planted energy: such a channel is a right place of an effect that sits on no channel
WHERE_SHARE = 0.2
BODIES = ("vehicle", "site")  # targets that are no channel of their own
NOISE_NAMES = (
    "gyro_angle_random_walk",
    "accel_noise",
    "platform_sway",
    "gyro_quantization",
    "gyro_noise_thermal",
    "timestamp_jitter",
)
BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0 + 1e-9)
SINGLE = ("20", "12", "8", "5", "cold", "pyins")


def is_name(effect: str) -> bool:
    return effect not in GENERIC_ANSWERS


def top(record: Record) -> Record | None:
    """The most probable cause; None where none is named."""
    causes = record["causes"]
    return max(causes, key=lambda c: (round(c["probability"], 3), c["size"])) if causes else None


def answers_to(planted: Record, effect: str, target: str) -> bool:
    return effect in planted["answers"] and target in planted["targets"]


def members(cause: Record) -> list[tuple[str, str, float]]:
    """The cause and its rivals: name, target, probability."""
    return [
        (cause["effect"], cause["target"], cause["probability"]),
        *((e, t, p) for e, t, p in cause["rivals"]),
    ]


def on_top(record: Record) -> bool:
    """Every planted effect is the first answer of a cause of its own; for one effect: of the most
    probable cause.
    """
    if len(record["planted"]) > 1:
        return _each_has_its_own(record, lambda p, c: answers_to(p, c["effect"], c["target"]))
    cause = top(record)
    return cause is not None and answers_to(record["planted"][0], cause["effect"], cause["target"])


def in_set(record: Record, *, confounded: bool = False) -> bool:
    """As `on_top`, for a cause or one of its rivals; confounded: what cannot be told from it counts
    as well.
    """

    def holds(planted: Record, cause: Record) -> bool:
        return any(
            answers_to(planted, e, t) or (confounded and e in planted["confounded"])
            for e, t, _ in members(cause)
        )

    if len(record["planted"]) > 1:
        return _each_has_its_own(record, holds)
    cause = top(record)
    return cause is not None and holds(record["planted"][0], cause)


def _each_has_its_own(record: Record, holds: Callable[[Record, Record], bool]) -> bool:
    """Two planted effects, two different causes."""
    first, second = record["planted"]
    causes = record["causes"]
    pairs = [(a, b) for a in range(len(causes)) for b in range(len(causes)) if a != b]
    return any(holds(first, causes[a]) and holds(second, causes[b]) for a, b in pairs)


def unresolved(record: Record) -> bool:
    """Honestly: a set without a member over 0.9, or a verdict that says so."""
    if record["verdict"] in (GapVerdict.UNEXPLAINED, GapVerdict.PARTLY_EXPLAINED):
        return True
    cause = top(record)
    listed = members(cause) if cause else []
    return len(listed) > 1 and all(p <= CONFIDENT for *_, p in listed)


def wrong_and_confident(record: Record, *, confounded: bool = False) -> bool:
    """The top cause has a name at over 0.9, and neither it nor a rival is right."""
    cause = top(record)
    if cause is None or cause["probability"] <= CONFIDENT or not is_name(cause["effect"]):
        return False
    return not in_set(record, confounded=confounded)


def named_falsely(record: Record, *, confounded: bool = False) -> bool:
    """Without the true effect in the catalogue: any cause has a name at over 0.9 (confounded: but
    for those).
    """
    excused = {n for p in record["planted"] for n in p["confounded"]} if confounded else set()
    return any(
        c["probability"] > CONFIDENT and is_name(c["effect"]) and c["effect"] not in excused
        for c in record["causes"]
    )


def where_right(record: Record) -> bool:
    """The first place is a channel of the target; for an effect on a body, one that holds a fifth
    of its energy.
    """
    if not record["where"]:
        return False
    channel = record["where"][0][0]
    (planted,) = record["planted"]
    if channel in planted["targets"]:
        return True
    return planted["target"] in BODIES and record.get("energy", {}).get(channel, 0.0) >= WHERE_SHARE


def where_energy(record: Record) -> bool | None:
    """The first place is a channel that holds a fifth of the planted whitened energy, whatever the
    target is.

    None where the effect moved the rows themselves (the end of parking), so that there is no
    difference to look at.
    """
    energy = record.get("energy")
    if not energy:
        return None
    return bool(record["where"]) and energy.get(record["where"][0][0], 0.0) >= WHERE_SHARE


def alarm(record: Record) -> bool:
    return record["verdict"] != GapVerdict.NO_GAP


def as_noise(record: Record) -> bool:
    """Named, by noise of the channel that is off, and by nothing but noise."""
    names = [c["effect"] for c in record["causes"]]
    right = any(
        answers_to(record["planted"][0], c["effect"], c["target"]) for c in record["causes"]
    )
    return right and all(n in NOISE_NAMES for n in names)


def as_drift(record: Record) -> bool:
    """Some cause is anything but noise."""
    return any(c["effect"] not in NOISE_NAMES for c in record["causes"])


def covered(record: Record) -> bool | None:
    """The 95 % interval of the first cause's shrink holds the true one; None: no such thing
    (noise).
    """
    cause = top(record)
    if cause is None or not record.get("true_shrink"):
        return None
    truth = record["true_shrink"][record["causes"].index(cause)]
    if truth is None or cause["shrink"] is None:
        return None
    return bool(cause["shrink"][1] - 1e-9 <= max(truth, -1.0) <= cause["shrink"][2] + 1e-9)


def calibration(records: Sequence[Record]) -> list[Record]:
    """Bins of the reported probability of each member of the first set: mean claimed, share
    right.
    """
    claims = [
        (p, answers_to(r["planted"][0], e, t))
        for r in records
        if r["cell"] in SINGLE and (cause := top(r))
        for e, t, p in members(cause)
    ]
    out = []
    for low, high in pairwise(BINS):
        inside = [(p, right) for p, right in claims if low <= p < high]
        if inside:
            k = sum(right for _, right in inside)
            out.append(
                {
                    "low": low,
                    "high": min(high, 1.0),
                    "claims": len(inside),
                    "right": k,
                    "claimed": float(np.mean([p for p, _ in inside])),
                    "interval_95": interval_95(k, len(inside)),
                }
            )
    return out


# ---- what issue 4 asks


@dataclass(frozen=True)
class Question:
    """score: of a record, None where it does not apply. goal: the share wanted, None where none is;
    at_most: its sense.
    """

    cell: str
    words: str
    score: Callable[[Record], bool | None]
    goal: float | None = None
    at_most: bool = False


def excused(score: Callable[..., bool]) -> Callable[[Record], bool]:
    """A score for which inseparable effects count."""
    return partial(score, confounded=True)


def _of_size(cell: str, top: float | None, inside: float | None) -> tuple[Question, ...]:
    wrong = "wrong and confident"
    return (
        Question(cell, "right effect and target on top", on_top, top),
        Question(cell, "in the credible set", in_set, inside),
        Question(cell, "in the set, inseparable effects counted", excused(in_set)),
        Question(cell, wrong, wrong_and_confident),
        Question(cell, f"{wrong}, inseparable effects excused", excused(wrong_and_confident)),
        Question(cell, "first place right", where_right),
        Question(cell, "first place holds a fifth of the effect's energy", where_energy),
        Question(cell, "shrink interval covers the true shrink", covered, 0.90),
    )


def set_or_unresolved(record: Record) -> bool:
    return in_set(record) or unresolved(record)


def below_five_percent(record: Record) -> bool:
    return bool(record["p_value"] < 0.05)


QUESTIONS = (
    Question("none", "false alarms at the default level", alarm, 0.02, True),
    Question("none", "p-value below 0.05", below_five_percent, 0.05, True),
    Question("none5", "false alarms at --alpha 0.05", alarm, 0.05, True),
    *_of_size("20", 0.93, 0.97),
    *_of_size("12", 0.93, 0.97),
    *_of_size("8", 0.85, 0.95),
    *_of_size("5", None, None),
    Question("5", "in the set or honestly unresolved", set_or_unresolved, 0.85),
    Question("cold", "wrong and confident", wrong_and_confident, 0.03, True),
    Question("cold", "the same, inseparable effects excused", excused(wrong_and_confident)),
    Question("cold", "right effect and target on top", on_top),
    Question("cold", "in the credible set", in_set),
    Question("two", "both named", on_top, 0.85),
    Question("two", "both in their sets", in_set),
    Question("noise", "named as noise of the right channel", as_noise),
    Question("noise", "a drift named", as_drift, 0.0, True),
    Question("without", "another effect's name at over 0.9", named_falsely, 0.10, True),
    Question("without", "the same, inseparable effects excused", excused(named_falsely)),
    Question("without", "first place right", where_right, 0.90),
    Question("without", "first place holds a fifth of the effect's energy", where_energy),
    *_of_size("pyins", 0.93, 0.97),
    *_of_size("motion", None, None),
    Question("forms", "right effect or a stated neighbour in the set", excused(in_set), 0.90),
    Question("forms", "wrong and confident", excused(wrong_and_confident), 0.03, True),
    Question("motion_without", "another effect's name at over 0.9", named_falsely),
    Question("motion_without", "first place right", where_right),
    Question("pyins_none", "false alarms at the default level", alarm, 0.02, True),
)


def answer(question: Question, records: Sequence[Record]) -> Record | None:
    """The share and its interval; None where no record has an answer.

    met: the share is on the good side of the goal; shown: the whole interval is on one side of it.
    """
    own = [r for r in records if r["cell"] == question.cell]
    said = [s for s in (question.score(r) for r in own) if s is not None]
    if not said:
        return None
    k, n = sum(said), len(said)
    low, high = interval_95(k, n)
    met, shown = None, None
    if question.goal is not None:
        met = k / n <= question.goal if question.at_most else k / n >= question.goal
        shown = not low <= question.goal <= high
    return {"k": k, "n": n, "met": met, "shown": shown}
