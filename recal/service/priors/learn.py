"""`fleet learn`: what the sessions kept in a store say of its units, kept in the store for
approval.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from infield.learning.learn import learn
from infield.learning.parameters import UNITS, PriorName
from infield.learning.stored_sessions import StoredUnit
from infield.reports.drawing import BLUE, GREY, Boxes, Line, Marks, Panel, Uprights, rows_height
from infield.reports.page import render_page, significant
from infield.store.errors import NoStore
from infield.store.priors_rows import PriorsRecord
from infield.store.table_store import TableStore
from ins.documents import to_json
from ins.verdicts import Outcome, Reason, because, sentence
from recal.service.inputs.unit_inputs import open_store
from recal.service.priors.document import (
    PriorScope,
    PriorsReport,
    TechnologyPriors,
    technology_priors,
)
from recal.service.priors.reasons import NothingKept, PriorsReason
from recal.service.priors.stored_sessions import stored_units
from recal.service.results.files import program_version
from recal.service.results.result import Result, write_report

LEARN_STEPS = 3  # that `told` is told of
PRIORS_VERDICTS = {"proposed": ("Learnt", "fair", "◆"), "refused": ("Refused", "none", "■")}
PARAMETER_WORDS = {
    PriorName.TURN_ON: "turn-on, from one power-on to the next",
    PriorName.FLICKER: "flicker (bias instability)",
    PriorName.RANDOM_WALK: "rate random walk",
    PriorName.AGEING_COMMON: "ageing, common to all temperatures",
    PriorName.AGEING_SHAPE: "ageing of the shape over temperature",
    PriorName.LENGTH: "correlation of the shape over temperature",
    PriorName.YAW_CREEP: "yaw creep of the parked airframe",
    PriorName.OUTLIER_SHARE: "share of outlier sessions",
    PriorName.CRAB: "crab, from one taxi to the next",
}
SHORT_WORDS = {
    PriorName.TURN_ON: "turn-on",
    PriorName.FLICKER: "flicker",
    PriorName.RANDOM_WALK: "random walk",
    PriorName.AGEING_COMMON: "common ageing",
    PriorName.AGEING_SHAPE: "shape ageing",
    PriorName.LENGTH: "length",
    PriorName.YAW_CREEP: "yaw creep",
    PriorName.OUTLIER_SHARE: "outlier share",
    PriorName.CRAB: "crab",
}
MOST_UNITS = 60  # rows of a table of units


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class LearntPriors(Result[PriorsReport]):
    """What was learnt; `kept`: the records in the store, one a technology."""

    kept: Sequence[PriorsRecord] = ()

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Verdict, and for each technology its parameters beside the defaults."""
        return summary(self.record)


@dataclass(frozen=True, kw_only=True)
class LearnRequest:
    """What to learn from.

    Parameters
    ----------
    store_url : str
        The store of tables.
    technology : str, optional
        Only units of rlg, fog or mems. Default: all.
    serial : str, optional
        Only the unit of this serial. Default: all.
    keep : (str, str), optional
        Who keeps it in the store and their note, None to store nothing.
    output : path, optional
        The folder to write to.
    seed : int
        Of the random generator.
    """

    store_url: str
    technology: str | None = None
    serial: str | None = None
    keep: tuple[str, str] | None = None
    output: Path | None = None
    seed: int = 0


def learn_priors(
    request: LearnRequest, told: Callable[[str], None] = lambda words: None
) -> LearntPriors:
    """Learn, write priors.json and priors.html, and keep each technology's priors in the store,
    where they wait for an approval; told: what is being done, in LEARN_STEPS steps.

    Raises
    ------
    InputError
        Where there is no store, or it cannot be read.
    """
    store = open_store(request.store_url)
    if store is None:
        raise NoStore(f"no store at {request.store_url}")
    told("reading the sessions of the store")
    everything, left_out = stored_units(store)
    units = [unit for unit in everything if _asked_for(unit, request)]
    document = PriorsReport(
        verdict=Outcome.PROPOSED,
        reasons=[],
        reason_codes=[],
        store=store.name,
        issued_utc=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        version=program_version(),
        left_out=left_out,
    )
    with_sessions = [unit for unit in units if unit.sessions]
    if not with_sessions:
        why = _why_none(store.name, request, len(units), len(left_out))
        refused = replace(
            document,
            verdict=Outcome.REFUSED,
            reasons=[sentence(why)],
            reason_codes=[why.code.value],
        )
        return _written(request, refused, ())
    technologies = list(dict.fromkeys(unit.gyro_technology for unit in with_sessions))
    found = []
    told(f"learning from {sum(len(unit.sessions) for unit in with_sessions)} sessions")
    for name in technologies:
        of_name = [unit for unit in with_sessions if unit.gyro_technology == name]
        found.append(technology_priors(learn(of_name, seed=request.seed)))
    told("writing the report")
    document = replace(document, technologies=found)
    kept: list[PriorsRecord] = []
    if request.keep is not None:
        kept = _keep(request, document, request.keep)
        numbered = [replace(priors, revision=record.number) for priors, record in zip(found, kept)]
        document = replace(document, technologies=numbered)
    return _written(request, document, kept)


def _why_none(store_name: str, request: LearnRequest, units: int, left_out: int) -> Reason:
    """Why there is nothing to learn from: no such unit, or none of its sessions."""
    of = f" of serial {request.serial}" if request.serial else ""
    of += f" of {request.technology}" if request.technology else ""
    return because(
        PriorsReason.NO_SESSIONS,
        store=store_name,
        lacks=NothingKept.NO_SESSION if units else NothingKept.NO_UNIT,
        of=of,
        units=units,
        unread=left_out > 0,
        left_out=left_out,
    )


def _asked_for(unit: StoredUnit, request: LearnRequest) -> bool:
    technology = request.technology in (None, unit.gyro_technology)
    return technology and request.serial in (None, unit.imu_serial)


def _keep(
    request: LearnRequest, document: PriorsReport, signed: tuple[str, str]
) -> list[PriorsRecord]:
    """A record for each technology: the document of that technology alone."""
    with TableStore.open(request.store_url, create=True) as store:
        return [
            store.keep_priors(
                priors.gyro_technology,
                to_json(replace(document, technologies=[priors])),
                by=signed[0],
                note=signed[1],
            )
            for priors in document.technologies
        ]


def _written(
    request: LearnRequest, document: PriorsReport, kept: Sequence[PriorsRecord]
) -> LearntPriors:
    """The result, its JSON and its page in the folder."""
    result = LearntPriors(document, page=lambda: priors_html(document), kept=kept)
    write_report(result, request.output or "recal-fleet-learn", "priors")
    return result


def summary(document: PriorsReport) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"priors: {document.verdict}", *(f"  because {why}" for why in document.reasons)]
    for priors in document.technologies:
        lines += _technology_lines(priors)
    whys = Counter(item.why for item in document.left_out)
    lines += [f"  {count} sessions left out: {why}" for why, count in whys.items()]
    return lines


def _technology_lines(priors: TechnologyPriors) -> list[str]:
    of = priors.technology
    plural = "s" if of.units != 1 else ""
    kept = "" if priors.revision is None else f", kept as priors {priors.revision}"
    lines = [f"{of.name}: {of.sessions} sessions of {of.units} unit{plural}{kept}"]
    lines += [f"  {line}" for line in parameter_lines(of)]
    check = priors.check
    if check.squared_innovation is not None and check.squared_innovation_defaults is not None:
        lines.append(
            f"  squared innovation {check.squared_innovation:.2f} of what is expected, with the"
            f" defaults {check.squared_innovation_defaults:.2f}"
        )
    named = [f"{o.run_id} ({o.probability:.0%})" for o in priors.outliers]
    lines += [f"  outliers: {', '.join(named[:5])}"] if named else []
    return [*lines, *(f"  note: {note}" for note in priors.notes)]


def parameter_lines(scope: PriorScope) -> list[str]:
    """Each parameter with its interval and its default."""
    return [
        f"{name:28s} {v.value:.2g} ({v.interval_95[0]:.2g} to {v.interval_95[1]:.2g})"
        f" {UNITS[PriorName(name)]}, default {v.default:.3g}{'' if v.shown else ', not shown'}"
        for name, v in scope.parameters.items()
    ]


def priors_html(document: PriorsReport) -> str:
    """The page of a document."""
    return render_page(
        "priors.html.j2",
        d=document,
        verdict=PRIORS_VERDICTS[str(document.verdict)],
        words=PARAMETER_WORDS,
        panels_of={t.gyro_technology: _panel(t) for t in document.technologies},
        significant=significant,
        most=MOST_UNITS,
    )


def _panel(priors: TechnologyPriors) -> Panel:
    """Each parameter over its default: the technology as a bar, units as ticks."""
    parameters = priors.technology.parameters
    rows = {name: float(row) for row, name in enumerate(reversed(list(parameters)))}
    bars, means, units = [], [], []
    for name, row in rows.items():
        value = parameters[name]
        low, high = (end / value.default for end in value.interval_95)
        bars.append((low, high, row - 0.07, row + 0.07))
        means.append((value.value / value.default, row))
        units += [
            (u.parameters[name].value / value.default, row - 0.25)
            for u in priors.units
            if name in u.parameters
        ]
    at, level = np.array(means).T
    seen, below = np.array(units).reshape(-1, 2).T
    return Panel(
        label="Learnt parameters over their defaults",
        items=[
            Line(np.ones(2), np.array([-0.6, len(rows) - 0.4]), GREY, width=1.0),
            Boxes(bars, BLUE, name="technology, 95 %"),
            Marks(at, level, "o", BLUE, size=6.0),
            Uprights(seen, below - 0.09, below + 0.09, GREY, width=1.0, name="units"),
        ],
        x_label="times the default of the technology",
        y_limits=(-0.6, len(rows) - 0.4),
        x_log=True,
        y_ticks=[(row, SHORT_WORDS[PriorName(name)]) for name, row in rows.items()],
        height=rows_height(len(rows)),
    )
