"""Scores of gap study records: what is right, in the set, unresolved, wrong and confident; shares
with 95 % intervals.

right: name among the planted answers and target among its targets. The top cause is the one of
largest probability (to 0.001; then of largest size). Generic answers (unknown ..., slow_variation)
are no names: never "wrong and confident".
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import beta

from simreal.declared.generic import FREE_FUNCTIONS
from simreal.effects.base import SLOW_NAME
from simreal.effects.gyro_noise import NOISE_OF_TIME
from simreal.inference.verdict import GapVerdict

Record = dict[str, Any]
CONFIDENT = 0.9
# descriptions, not causes
GENERIC_ANSWERS = FREE_FUNCTIONS | {SLOW_NAME, NOISE_OF_TIME}
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


def oracle_on_top(record: Record) -> bool | None:
    """Whether the oracle raises an alarm and names the planted effect on its target; None where it
    was not asked (noise effects, records of earlier commits).
    """
    oracle = record.get("oracle")
    if oracle is None:
        return None
    named = answers_to(record["planted"][0], oracle["effect"], oracle["target"])
    return bool(oracle["alarm"]) and named


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


def interval(k: int, n: int) -> tuple[float, float]:
    """Clopper-Pearson, 95 %, of a share k of n."""
    low = 0.0 if k == 0 else float(beta.ppf(0.025, k, n - k + 1))
    high = 1.0 if k == n else float(beta.ppf(0.975, k + 1, n - k))
    return low, high


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
                    "interval_95": interval(k, len(inside)),
                }
            )
    return out
