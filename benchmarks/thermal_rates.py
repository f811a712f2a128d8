"""Measured rates of requirements R4 and R15 to R18: thermometers, outliers, steps, hysteresis.

Sessions of R16 and R17 are drawn from the posteriors of twelve runs of the whole pipeline
(`tests.scenarios.thermal_sessions`).
"""

from collections.abc import Iterator
from itertools import chain

import numpy as np

from benchmarks.study import Work, interval_95, table
from tests.scenarios import thermal_faults as faults
from tests.scenarios import thermal_merge as merge

HEAD = ("requirement", "what", "runs", "rate", "95 % interval", "needed")
Row = tuple[str, ...]
SPLITS = {"rate": "rate term", "sense": "hysteresis by sense"}
AGES = {
    0: "fresh (0.0072 deg/h)",
    1: "after 1 session",
    3: "after 3 sessions",
}  # of a table, by the sessions that it has merged


def rate(requirement: str, what: str, hits: int, total: int, needed: str = "") -> Row:
    """How often something happened, and what the requirement asks for."""
    low, high = interval_95(hits, total)
    spread = f"{100 * low:.1f} to {100 * high:.1f} %"
    return requirement, what, f"{hits}/{total}", f"{100 * hits / total:.1f} %", spread, needed


def counted(requirement: str, what: str, count: merge.Count, needed: str = "") -> Row:
    return rate(requirement, what, count.hits, count.total, needed)


def thermometer_rates(runs: int) -> Iterator[Row]:
    """R4: faults found, healthy ones blamed, the rate of a 0.1 degC thermometer."""
    blamed = others = 0
    for fault in faults.FAULTS:
        total, found, wrong = faults.found_rates(fault, runs)
        yield rate("R4", f"thermometer fault found: {fault}", found, total, "all")
        blamed, others = blamed + wrong, others + total
    what = "false alarm: a healthy gyro blamed beside a faulty one"
    yield rate("R4", what, blamed, others, "few")
    alarms, what = faults.false_alarms(2 * runs), "false alarm: healthy thermometers, all starts"
    yield rate("R4", what, alarms, 2 * runs, "few")
    errors = [faults.rate_error(seed) for seed in range(runs)]
    ours, moving = (sum(e.ours < 0.1 for e in errors), sum(e.moving_average < 0.1 for e in errors))
    what = "dT/dt of a 0.1 degC thermometer within 10 % of the true RMS rate"
    yield rate("R4", what, ours, runs, "all")
    yield rate("R4", "the same, moving average over 121 s", moving, runs, "not all")


def far_rates(runs: int) -> Iterator[Row]:
    """R15."""
    for lengths in (1.0, 2.0):
        for same, said in ((True, "of the same mean"), (False, "whose noise averages on")):
            count = merge.far_nodes(runs, same_mean=same, lengths=lengths)
            where = f"nodes beyond {lengths:g} length move below 0.1 sigma"
            needed = "all" if lengths == 1.0 else ""
            yield counted("R15", f"ten times more data {said}: {where}", count, needed)


def wrong_rates(runs: int) -> Iterator[Row]:
    """R16."""
    for before, age in AGES.items():
        for part in ("whole", "second half", "warm half"):
            count = merge.wrong_session(runs, before=before, part=part)
            what = f"session wrong by 0.03 to 0.06 deg/h ({part}), table {age}"
            yield counted("R16", f"{what}: no node moves over 0.5 sigma", count, "all")
    for before in (0, 3):
        named, kept = merge.step_of_the_unit(runs, before=before)
        what = f"step of 0.05 deg/h, table {AGES[before]}"
        disagrees = f"{what}: 'table disagrees with unit' within three sessions"
        yield counted("R16", disagrees, named, "all")
        yield counted("R16", f"{what}: none of the three merged", kept, "all")


def healthy_rates(runs: int) -> Iterator[Row]:
    """False alarms of R16 and R17; R18."""
    stepped, off, terms = merge.healthy_units(runs)
    unit = "false alarm: healthy unit of five sessions said to disagree"
    session = "false alarm: healthy session said to contradict the table"
    term = "false alarm: heating-cooling term, healthy update of five sessions"
    again = "same run again, any order: refused, table bit-identical"
    yield counted("R16", unit, stepped, "none")
    yield counted("R16", session, off, "0.1 to 0.2 %")
    yield counted("R17", term, terms, "few %")
    yield counted("R18", again, merge.same_run_twice(runs), "all")


def split_rates(runs: int) -> Iterator[Row]:
    """R17: one session that warms and one that cools."""
    points = 3 * merge.POINT_DEG_H
    for kind, name in SPLITS.items():
        sizes = [(f"split of 3 point sigmas ({points:.3f} deg/h)", {"split_deg_h": points}, "95 %")]
        sizes += [(f"{k:g} sigma of its own estimate", {"sigmas": k}, "") for k in (3.0, 5.0)]
        for words, size, needed in sizes:
            found = merge.split(runs, kind=kind, **size)
            yield counted("R17", f"{name}, {words}: named", found.named, needed)
            told = (
                f"fitted or widened (node error squared over sigma squared {found.normalised:.2f})"
            )
            yield counted("R17", f"{name}, {words}: {told}", found.found)


PARTS = {
    "thermometers": thermometer_rates,
    "far": far_rates,
    "wrong": wrong_rates,
    "healthy": healthy_rates,
    "split": split_rates,
}


def part(name: str, runs: int) -> list[Row]:
    with np.errstate(all="raise", under="ignore"):
        return list(PARTS[name](runs))


def run(work: Work, *, runs: int = 200, parts: tuple[str, ...] = tuple(PARTS)) -> str:
    """runs: of each rate, 200: 6 CPU min."""
    return table(HEAD, chain(*work.each(part, [(name, runs) for name in parts])))
