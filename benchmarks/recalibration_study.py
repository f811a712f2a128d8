"""R29: aged units through five sessions each, our merge against five baselines and the exact
Bayesian merge.

100 units, their tables aged by 0.0072 deg/h; five
power-ons each on random headings, thermal starts and latitudes, realistic taxi, no outside
reference; then each unit is powered on anew, aligned for 60 min with each table in question and
navigates for an hour. All seeded: the same command gives the same numbers.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from benchmarks.baselines import BASELINES
from benchmarks.free_inertial import PROFILES, Hour
from benchmarks.recalibration_unit import (
    EXACT,
    HERMITE,
    KINDS,
    OLD,
    OURS,
    PERFECT,
    SESSIONS,
    TWINS,
    UnitResult,
    study_unit,
)
from benchmarks.study import Record, Work, table

WORSE_DEG_H = (0.001, 0.004)
RESAMPLES = 2000
BASELINE_NAMES = tuple(name for name in BASELINES if name != OLD)


def summarise(results: Sequence[UnitResult]) -> Record:
    """Figures of a scenario: `rules` by name, `hours` by profile and name, `targets` of R29 and
    whether they are met.
    """
    rules = {name: _rule(results, name) for name in results[0].visited}
    shown = {name: _better_kind(rules, name) for name in BASELINE_NAMES}
    summary = {
        "units": len(results),
        "sessions": len(results[0].outcomes),
        "reasons": [reason for r in results for reason in r.reasons],
        "outcomes": dict(Counter(o for r in results for o in r.outcomes)),
        "rules": rules,
        "shown": [OLD, *shown.values(), EXACT, OURS, HERMITE],
        "hours": {profile: _hours(results, profile) for profile in results[0].hours},
    }
    return {**summary, "targets": _targets(summary)}


def _rule(results: Sequence[UnitResult], name: str) -> Record:
    """RMS after 0, 1 ... sessions [deg/h]; worst session; shares of committed sessions that did not
    worsen the table.
    """
    # unit, session, gyro
    before, after = (
        np.array([getattr(r, when)[name] for r in results]) for when in ("before", "after")
    )
    level_before, level_after = (np.sqrt(np.mean(rms**2, axis=2)) for rms in (before, after))
    committed = np.array([[o == "accepted" or name != OURS for o in r.outcomes] for r in results])
    normalised = [r.normalised[name] for r in results if name in r.normalised]
    return {
        "visited_deg_h": _rms_over_units([r.visited[name] for r in results]),
        "unvisited_deg_h": _rms_over_units([r.unvisited[name] for r in results]),
        "z_deg_h": float(np.sqrt(np.mean([r.z[name] ** 2 for r in results]))),
        "worst_session_deg_h": float(level_after.max()),
        "worst_increase_deg_h": float((level_after - level_before).max()),
        "not_worse": {
            f"{w:g}": float(np.mean((level_after - level_before)[committed] <= w))
            for w in WORSE_DEG_H
        },
        "gyro_not_worse": {
            f"{w:g}": float(np.mean((after - before)[committed] <= w)) for w in WORSE_DEG_H
        },
        "normalised_squared_error": float(np.mean(normalised)) if normalised else None,
    }


def _rms_over_units(mean_squares: list[list[float]]) -> list[float]:
    return np.sqrt(np.nanmean(np.array(mean_squares), axis=0)).tolist()


def _better_kind(rules: Record, baseline: str) -> str:
    """The kind of points that suits a baseline best, by its visited RMS at the end."""
    return min(
        (f"{baseline}, {kind}" for kind in KINDS), key=lambda name: rules[name]["visited_deg_h"][-1]
    )


def _hours(results: Sequence[UnitResult], profile: str) -> Record:
    """Position errors of the new power-on, and their ratios to those with the old and with the
    perfect table.

    gain, over_perfect: of the RMS errors at the end, with 90 % intervals (bootstrap over units);
    table_rms_m: RMS distance at the end to the place that the perfect table comes to with the same
    noise, which is what the table adds.
    """
    end = {
        name: np.array([(h.north_m, h.east_m) for h in (r.hours[profile][name] for r in results)])
        for name in results[0].hours[profile]
    }
    found = {}
    for name, where in end.items():
        hours = [r.hours[profile][name] for r in results]
        found[name] = {
            "final_rms_m": _rms(where),
            "final_median_m": float(np.median(np.linalg.norm(where, axis=1))),
            "mean_m": float(np.mean([h.mean_m for h in hours])),
            "table_rms_m": _rms(where - end[PERFECT]),
            "heading_rms_mrad": float(np.sqrt(np.mean([h.heading_mrad**2 for h in hours]))),
            "gain": _ratio(end[OLD], where),
            "over_perfect": _ratio(where, end[PERFECT]),
            "verdicts": dict(Counter(h.verdict for h in hours)),
        }
    return found


def _rms(end_m: NDArray) -> float:
    """RMS length of vectors (units, 2)."""
    return float(np.sqrt(np.mean(np.sum(end_m**2, axis=1))))


def _ratio(upper_m: NDArray, lower_m: NDArray) -> dict[str, float]:
    """Ratio of two RMS errors over the same units, and its 90 % interval."""
    squares = [np.sum(end**2, axis=1) for end in (upper_m, lower_m)]
    draws = np.random.default_rng(29).integers(len(upper_m), size=(RESAMPLES, len(upper_m)))
    upper, lower = (s[draws].mean(axis=1) for s in squares)
    low, high = np.quantile(np.sqrt(upper / lower), [0.05, 0.95])
    return {"value": _rms(upper_m) / _rms(lower_m), "low": float(low), "high": float(high)}


def _targets(summary: Record) -> list[Record]:
    """R29 line by line: what is asked, what is needed, what was got."""
    rules, ours = summary["rules"], summary["rules"][OURS]
    exact, others = rules[EXACT], [rules[n] for n in rules if n not in (OURS, HERMITE, EXACT)]
    lines = [_at_most("visited level-gyro RMS [deg/h]", 0.0030, ours["visited_deg_h"][-1])]
    for key, of in (("not_worse", "both level gyros"), ("gyro_not_worse", "each gyro alone")):
        kept, best = ours[key], exact[key]
        lines += [
            _at_least(f"sessions not worse by 0.001 deg/h, {of} [%]", 88.0, 100 * kept["0.001"]),
            _at_least(f"sessions not worse by 0.004 deg/h, {of} [%]", 99.0, 100 * kept["0.004"]),
            _at_least(
                f"the exact merge: not worse by 0.001 deg/h, {of} [%]", 91.0, 100 * best["0.001"]
            ),
            _at_most(
                f"behind the exact merge, 0.001 deg/h, {of} [points]",
                2.0,
                100 * (best["0.001"] - kept["0.001"]),
            ),
            _at_most(
                f"behind the exact merge, 0.004 deg/h, {of} [points]",
                2.0,
                100 * (best["0.004"] - kept["0.004"]),
            ),
        ]
    lines += [
        _at_most(
            "RMS over the best baseline's",
            1.0,
            ours["visited_deg_h"][-1] / min(o["visited_deg_h"][-1] for o in others),
        ),
        _at_most(
            "worst session over the best baseline's",
            1.0,
            ours["worst_session_deg_h"] / min(o["worst_session_deg_h"] for o in others),
        ),
    ]
    for profile, hours in summary["hours"].items():
        ceiling = f"over a perfect one: {hours[PERFECT]['gain']['value']:.2f}"
        gain = hours[OURS]["gain"]["value"]
        lines.append(
            _at_least(f"position error, {profile}: old table over new ({ceiling})", 1.6, gain)
        )
        lines.append(
            _at_most(
                f"position error, {profile}: new over perfect",
                1.4,
                hours[OURS]["over_perfect"]["value"],
            )
        )
    return lines


def _at_most(what: str, needed: float, got: float) -> Record:
    return {"what": what, "needed": f"at most {needed:g}", "got": got, "met": bool(got <= needed)}


def _at_least(what: str, needed: float, got: float) -> Record:
    return {"what": what, "needed": f"at least {needed:g}", "got": got, "met": bool(got >= needed)}


SCENARIOS = {
    "reference": "Reference scenario: no flicker, no random walk of the rate, no turn-on",
    "default": (
        "Default twin: flicker 0.002 deg/h, random walk 0.002 deg/h/sqrt(h), turn-on 0.003 deg/h"
    ),
}
RULES = ("rule", "points", "visited", "with the other points", "unvisited", "worst session")
RULES += ("not worse by 0.001", "by 0.004", "worst increase", "e2/sigma2")
HOURS = ("RMS at the end", "of which the table", "mean over the hour", "old / this")
HOURS += ("this / perfect",)


def one(seed: int, twin: str, sessions: int, profiles: Sequence[str]) -> Record:
    """What came of a unit, as it is written down."""
    return asdict(study_unit(seed, twin_name=twin, sessions=sessions, profiles=profiles))


def results_of(records: Sequence[Record]) -> list[UnitResult]:
    """The units again."""
    found = []
    for record in records:
        hours = {
            profile: {name: Hour(**hour) for name, hour in of.items()}
            for profile, of in record["hours"].items()
        }
        found.append(UnitResult(**{**record, "hours": hours}))
    return found


def run(
    work: Work,
    *,
    units: int = 100,
    sessions: int = SESSIONS,
    twins: tuple[str, ...] = tuple(TWINS),
    profiles: tuple[str, ...] = tuple(PROFILES),
) -> str:
    parts = []
    for twin in twins:
        asked = [(seed, twin, sessions, list(profiles)) for seed in range(units)]
        found = summarise(results_of(work.each(one, asked)))
        outcomes = ", ".join(f"{n} {outcome}" for outcome, n in found["outcomes"].items())
        parts += [
            f"## {SCENARIOS[twin]}\n",
            table(
                ("requirement R29", "needed", "got", ""), [target_row(t) for t in found["targets"]]
            ),
            f"Level gyros after {sessions} sessions, RMS over units in deg/h ({outcomes}):\n",
            table(RULES, [rule_row(found["rules"], name) for name in found["shown"]]),
        ]
        if profiles:
            head = [f"{profile}: {column}" for profile in profiles for column in HOURS]
            names = found["hours"][profiles[0]]
            rows = [[bold(name), *chain(*_hour_cells(found["hours"], name))] for name in names]
            parts += ["Free-inertial position error in the hour after a 60 min alignment:\n"]
            parts += [table(("table", *head), rows)]
    return "\n".join(parts)


def target_row(t: Record) -> list[str]:
    return [t["what"], t["needed"], f"{t['got']:.4g}", "met" if t["met"] else "**missed**"]


def rule_row(rules: Record, name: str) -> list[str]:
    rule, plain = rules[name], plain_of(name)
    kind = name.removeprefix(plain).removeprefix(", ")
    others = [rules[f"{plain}, {k}"] for k in KINDS if kind and k != kind]
    error = rule["normalised_squared_error"]
    kept = [
        f"{100 * rule['not_worse'][w]:.1f} ({100 * rule['gyro_not_worse'][w]:.1f}) %"
        for w in ("0.001", "0.004")
    ]
    return [
        bold(name),
        kind or "-",
        f"{rule['visited_deg_h'][-1]:.4f}",
        f"{others[0]['visited_deg_h'][-1]:.4f}" if others else "-",
        f"{rule['unvisited_deg_h'][-1]:.4f}",
        f"{rule['worst_session_deg_h']:.4f}",
        *kept,
        f"{rule['worst_increase_deg_h']:+.4f}",
        "-" if error is None else f"{error:.2f}",
    ]


def _hour_cells(hours: Record, name: str) -> Iterator[list[str]]:
    for of in hours.values():
        hour = of[name]
        metres = [f"{hour[key]:.0f} m" for key in ("final_rms_m", "table_rms_m", "mean_m")]
        ratios = [hour[key] for key in ("gain", "over_perfect")]
        yield [*metres, *("{value:.2f} ({low:.2f}-{high:.2f})".format(**r) for r in ratios)]


def bold(name: str) -> str:
    """A rule as the page names it; ours stands out."""
    return f"**{name}**" if name == OURS else plain_of(name)


def plain_of(name: str) -> str:
    """A rule without its kind of points."""
    for kind in KINDS:
        name = name.removesuffix(f", {kind}")
    return name
