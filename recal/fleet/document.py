"""fleet.json (recal.fleet/1): what became of every run, which units drift, which tables are stale,
what was refused and why.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from recal.fleet.records import MERGED, OUTCOMES, FleetOutcome, RunOutcome
from recal.fleet.tables import CRITERIA, table_facts
from recal.fleet.unit_summary import LEVEL
from recal.service.results.files import program_version
from recal.service.results.pages import NM_H_PER_DEG_H
from recal.service.store import TableStore, UnitKey, store_exists, store_name

MAX_POINTS = 2000
VERDICTS = ("committed", "proposed", "up_to_date", "inconsistent", "refused", "bad_input", "failed")
LONGEST_REASON = 220
METHOD = (
    (
        "each run of a unit an update of its own, in the order of the starts, committed before the"
        " next is tried"
    ),
    "all runs of a unit in one joint update, without those that contradict the model or the table",
)


class Timing:
    """When each run of this call was through, and what it cost."""

    def __init__(self) -> None:
        self.workers, self.where = 0, ""
        self._began = datetime.now(UTC)
        self._ends_s: list[float] = []
        self._spent: list[tuple[float, float]] = []

    def tell(self, outcome: RunOutcome) -> None:
        self._ends_s.append((datetime.now(UTC) - self._began).total_seconds())
        self._spent.append((outcome.seconds, outcome.cpu_s))

    def to_json(self, seconds: float) -> dict[str, Any]:
        n = len(self._ends_s)
        rows = (
            np.unique(np.linspace(0, n - 1, min(n, MAX_POINTS)).round().astype(int))
            if n
            else np.arange(0)
        )
        wall, cpu = np.array(self._spent).reshape(-1, 2).T
        return {
            "began_utc": self._began.strftime("%Y-%m-%dT%H:%M:%SZ"),
            "seconds": round(seconds, 2),
            "runs": n,
            "workers": self.workers,
            "where": self.where,
            "runs_per_hour": 3600.0 * n / seconds if n else None,
            "run_s": _spread(wall),
            "run_cpu_s": _spread(cpu),
            "cpu_s": round(float(cpu.sum()), 1),
            "curve": [[round(self._ends_s[k], 2), int(k) + 1] for k in rows],
        }


def _spread(values: Any) -> dict[str, float] | None:
    if not len(values):
        return None
    median, late, most = np.quantile(values, [0.5, 0.95, 1.0])
    return {"median": float(median), "p95": float(late), "max": float(most)}


def fleet_document(
    outcomes: Sequence[RunOutcome],
    summaries: dict[UnitKey, dict[str, Any]],
    *,
    store_url: str,
    mode: str,
    joint: bool,
    output: Path,
    timing: dict[str, Any],
    earlier: Sequence[dict[str, Any]],
) -> dict[str, Any]:
    """outcomes: of all runs; summaries: of the units that have some; both of this call and those
    that it goes on from.
    """
    now = datetime.now(UTC)
    counts = Counter(o.outcome for o in outcomes)
    tables = _tables(store_url, now)
    units = [
        _unit(key, summary, outcomes, tables.get(key), output) for key, summary in summaries.items()
    ]
    ranks = count(1)
    units.sort(key=lambda u: -u["ranked_nm_h"])
    return {
        "schema": "recal.fleet/1",
        "verdict": fleet_verdict(counts),
        "reasons": [
            f"{counts[name]} {name}: {meaning}"
            for name, meaning in OUTCOMES.items()
            if counts[name]
        ],
        "store": store_name(store_url),
        "mode": mode,
        "issued_utc": now.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "method": {"name": METHOD[joint], "program": "recal", "version": program_version()},
        "counts": {name: counts[name] for name in OUTCOMES},
        "units": [{**u, "rank": next(ranks) if u["drift"] else None} for u in units],
        "stale": _stale(tables, summaries),
        "left_out": _groups(outcomes),
        "noted": _notes(outcomes),
        "coverage": _coverage(summaries),
        "criteria": CRITERIA,
        "timing": {**timing, "earlier_calls": list(earlier)},
        "runs": [_run(o, output) for o in outcomes],
    }


def fleet_verdict(counts: Counter[str]) -> str:
    """One verdict: what was done if anything was; else nothing new; else the worst reason why
    not.
    """
    if any(counts[name] for name in MERGED):
        return "committed" if counts["committed"] else "proposed"
    if counts["already"] and not any(
        counts[n] for n in ("inconsistent", "refused", "bad_input", "crashed")
    ):
        return "up_to_date"
    found = next(
        (name for name in ("inconsistent", "refused", "bad_input", "crashed") if counts[name]),
        "refused",
    )
    return {"crashed": "failed"}.get(found, found)


def _tables(store_url: str, now: datetime) -> dict[UnitKey, dict[str, Any]]:
    """Facts of every table in the store."""
    if not store_exists(store_url):
        return {}
    with TableStore.open(store_url) as store:
        return {record.unit: table_facts(store, record, now) for record in store.units()}


def _unit(
    key: UnitKey,
    summary: dict[str, Any],
    outcomes: Sequence[RunOutcome],
    table: dict[str, Any] | None,
    output: Path,
) -> dict[str, Any]:
    """A row of the fleet."""
    mine = [o for o in outcomes if o.unit == key]
    pages = [str(Path(page).relative_to(output)) for page in summary.get("pages", [])]
    best = [o.folder for o in mine if o.outcome in MERGED] + [o.folder for o in mine]
    shown = [page for folder in reversed(best) for page in pages if str(output / page) == folder]
    drift, step = summary.get("drift"), _step_drift(summary.get("steps", []))
    return {
        **vars(key),
        "runs": dict(Counter(o.outcome for o in mine)),
        "drift": drift,
        "step_drift": step,
        "ranked_nm_h": max(found["nm_h"] if found else -1.0 for found in (drift, step)),
        "coverage": summary.get("coverage", []),
        "steps": summary.get("steps", []),
        "step_words": summary.get("step_words", []),
        "table": table,
        "page": f"{shown[0]}/update.html" if shown else None,
        "pages": [f"{page}/update.html" for page in pages],
        "proposal": next((o.proposal for o in mine if o.proposal is not None), None),
    }


def _step_drift(steps: Sequence[dict[str, Any]]) -> dict[str, float] | None:
    """What a step of the level gyros that the table does not follow makes of a solution; None
    without one.
    """
    level = [(s["shift_deg_h"], s["sigma_deg_h"]) for s in steps if s["axis"] in LEVEL]
    if not level:
        return None
    shift, sigma = np.array(level).T
    size = float(np.linalg.norm(shift))
    return {
        "nm_h": NM_H_PER_DEG_H * size,
        "sigma_nm_h": NM_H_PER_DEG_H * float(np.linalg.norm(shift / size * sigma)),
    }


def _stale(
    tables: dict[UnitKey, dict[str, Any]], visited: dict[UnitKey, Any]
) -> list[dict[str, Any]]:
    """Tables that need somebody's attention, the contradicted first, then the oldest; those without
    a run among them.
    """
    rows = [
        {
            **vars(key),
            "reasons": table["stale"],
            "contradictions": table["contradictions"],
            "age_days": table["age_days"],
            "in_this_update": key in visited,
        }
        for key, table in tables.items()
        if table["stale"]
    ]
    return sorted(rows, key=lambda row: (-row["contradictions"], -row["age_days"]))


def _groups(outcomes: Sequence[RunOutcome]) -> list[dict[str, Any]]:
    """Runs left out, by outcome and reason; a reason with its numbers and names taken out."""
    groups: dict[tuple[str, str], list[RunOutcome]] = defaultdict(list)
    for o in outcomes:
        if o.outcome not in MERGED and o.outcome != FleetOutcome.ALREADY:
            groups[o.outcome, plain_reason(o)].append(o)
    rows = [
        {
            "outcome": outcome,
            "reason": reason,
            "count": len(runs),
            "units": len({o.unit for o in runs if o.unit}),
            "example": {"path": runs[0].path, "reason": (runs[0].reasons or ("",))[0]},
        }
        for (outcome, reason), runs in groups.items()
    ]
    order = list(OUTCOMES)
    return sorted(rows, key=lambda row: (order.index(row["outcome"]), -row["count"]))


def plain_reason(outcome: RunOutcome) -> str:
    """The first reason without what is the run's own: path, names and numbers."""
    text = (outcome.reasons or ("no reason is on record",))[0]
    for own, word in ((outcome.path, "RUN"), (outcome.run_id, "RUN"), (outcome.imu_serial, "UNIT")):
        text = text.replace(own, word) if own else text
    return re.sub(r"(?<![\w#])[-+]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?", "#", text)[:LONGEST_REASON]


def _notes(outcomes: Sequence[RunOutcome]) -> list[dict[str, Any]]:
    """What was noted of runs, whatever became of them."""
    found: dict[str, list[str]] = defaultdict(list)
    for o in outcomes:
        for note in o.notes:
            found[note].append(o.path)
    return [
        {"note": note, "count": len(paths), "example": paths[0]}
        for note, paths in sorted(found.items())
    ]


def _coverage(summaries: dict[UnitKey, dict[str, Any]]) -> list[dict[str, Any]]:
    """In each 5 degC band: how many units were seen there, and for how long."""
    bands: dict[float, list[float]] = defaultdict(list)
    for summary in summaries.values():
        for band in summary.get("coverage", []):
            bands[band["low_degC"]].append(band["seconds"])
    return [
        {
            "low_degC": low,
            "high_degC": low + 5.0,
            "units": len(bands[low]),
            "seconds": round(sum(bands[low]), 1),
        }
        for low in sorted(bands)
    ]


def _run(o: RunOutcome, output: Path) -> dict[str, Any]:
    """A run's line; `report` is relative to the output folder."""
    known = o.to_json()
    folder = known.pop("folder")
    known.pop("signature")
    inside = bool(folder) and Path(folder).is_relative_to(output)
    return {
        **known,
        "report": f"{Path(folder).relative_to(output)}/update.json" if inside else None,
    }
