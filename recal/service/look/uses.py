"""What a log can and cannot be used for, each with the reason and the command that does it."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from alignment.reasons import AlignmentVerdict
from infield.aided.flight import FEWEST_FIXES
from infield.reports.documents.alignment import AlignmentDocument
from infield.session.acceptance import MIN_MERGED_REST_S
from infield.session.parked.stretches import find_rests
from ins.json_file import Written
from ins.records import PARKED_PHASES, Run
from recal.service.look.records import Assumption, Fit, LogUse, Use
from simreal.report.twin_document import FitReport

# of one gyro over the rest: 1 degC of a usual table, 0.001 deg/h per degC, is a third of what
# a session of an hour tells a gyro's bias to
NARROW_DEGC = 1.0
# in the place of what was guessed: pasted as it is, the command asks for it (a guess of the
# latitude that was pasted made a table 8 sigma wrong)
TO_BE_GIVEN = {"lat_deg": "LATITUDE"}


class UseReason(StrEnum):
    """Why a log is fit for a use, or is not."""

    HEADING_FOUND = "heading_found"
    LEVEL_ONLY = "level_only"
    NOT_ALIGNED = "not_aligned"
    NOISE_TOLD = "noise_told"
    NO_REST = "no_rest"
    NEVER_PARKED = "never_parked"
    TEMPERATURES = "temperatures"
    NARROW = "narrow"
    SHORT_REST = "short_rest"
    NO_TEMPERATURE = "no_temperature"
    FIXES = "fixes"
    NO_FIXES = "no_fixes"
    NO_START = "no_start"
    TWIN_FIRST = "twin_first"


USE_WORDS: Mapping[UseReason, str] = {
    UseReason.HEADING_FOUND: (
        "Heading is found to {sigma_deg:.2g} deg (1 sigma), without a table of the unit."
    ),
    UseReason.LEVEL_ONLY: "Roll and pitch are found, heading is not: {why}.",
    UseReason.NOT_ALIGNED: "No attitude is found: {why}.",
    UseReason.NOISE_TOLD: (
        "{rest_min:.1f} min at rest show {told} of the {of} numbers of the noise model."
    ),
    UseReason.NO_REST: "The unit never rests for a minute, so its own noise cannot be seen.",
    UseReason.NEVER_PARKED: (
        "The unit never stands parked for a minute, so no bias can be read against temperature."
    ),
    UseReason.TEMPERATURES: (
        "The unit rests with its gyros at {low_degC:.1f} to {high_degC:.1f} degC. The table can be"
        " renewed over these temperatures."
    ),
    UseReason.NARROW: (
        "The unit rests with its gyros at {low_degC:.1f} to {high_degC:.1f} degC only. The table"
        " can be renewed in this narrow range."
    ),
    UseReason.SHORT_REST: (
        "The unit stands still for {rest_min:.1f} min, and a table is renewed from"
        " {needed_min:.0f} min or more. Half an hour while the gyros warm up is a good session."
    ),
    UseReason.NO_TEMPERATURE: (
        "The log holds no gyro temperature, and a bias without its temperature has no place in a"
        " table."
    ),
    UseReason.FIXES: "{fixes} satellite fixes aid the navigation and judge it.",
    UseReason.NO_FIXES: (
        "There are fewer than {needed} satellite fixes, so a replay shows the free-inertial drift"
        " alone."
    ),
    UseReason.NO_START: "Without fixes the navigation needs a heading to start from.",
    UseReason.TWIN_FIRST: (
        "The log is compared with a noise model, which the first command makes. If you have another"
        " log of the unit, make the model from that one: a log always fits its own model."
    ),
}


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What a look found of a log, for its uses.

    run_path: of the run that the commands name; fitted: None where no rest was found.
    """

    run: Run
    run_path: str
    aligned: AlignmentDocument
    fitted: FitReport | None

    @property
    def rest_s(self) -> float:
        """Seconds at rest."""
        return 0.0 if self.fitted is None else self.fitted.parked_s


def uses_of(judged: Judged) -> tuple[LogUse, ...]:
    """Every use, in the order in which a newcomer goes through them."""
    return (_alignment(judged), _noise(judged), _table(judged), _replay(judged), _diagnosis(judged))


def convert_command(
    log: str, run_path: str, assumed: Sequence[Assumption], given: Mapping[str, str | float | None]
) -> str:
    """The command that makes the run for good: options that were given, then those taken for
    granted; what was guessed with a sigma is for the user to say.
    """
    words = ["recal", "convert", log, "-o", run_path]
    for option, value in given.items():
        if value is not None:
            words += [option] if value is True else [option, _text(value)]
    for one in assumed:
        words += [one.option, _text(one.value) if one.sigma is None else TO_BE_GIVEN[one.key]]
    return shlex.join(words)


def _text(value: str | float) -> str:
    if isinstance(value, Written):
        return value.text
    return value if isinstance(value, str) else f"{value:.12g}"


def _use(
    use: Use, fit: Fit, code: UseReason, words: Sequence[str] = (), **values: float | str
) -> LogUse:
    return LogUse(
        use=use,
        fit=fit,
        why=USE_WORDS[code].format(**values),
        reason_code=code.value,
        command=shlex.join(words).replace(" '&&' ", " && "),
    )


def _first_reason(aligned: AlignmentDocument) -> str:
    return str(aligned.reasons[0]) if aligned.reasons else "the rest says too little"


def _alignment(judged: Judged) -> LogUse:
    aligned, words = judged.aligned, ("recal", "align", judged.run_path)
    why = _first_reason(aligned)
    if aligned.verdict is AlignmentVerdict.ALIGNED:
        sigma = float(aligned.sigma_heading_deg)
        return _use(Use.ALIGNMENT, Fit.YES, UseReason.HEADING_FOUND, words, sigma_deg=sigma)
    if aligned.verdict is AlignmentVerdict.LEVEL_ONLY:
        return _use(Use.ALIGNMENT, Fit.PARTLY, UseReason.LEVEL_ONLY, words, why=why)
    return _use(Use.ALIGNMENT, Fit.NO, UseReason.NOT_ALIGNED, why=why)


def _noise(judged: Judged) -> LogUse:
    if judged.fitted is None:
        return _use(Use.NOISE, Fit.NO, UseReason.NO_REST)
    parameters = judged.fitted.parameters
    told = sum(p.identified for p in parameters)
    return _use(
        Use.NOISE,
        Fit.YES if told else Fit.PARTLY,
        UseReason.NOISE_TOLD,
        ("recal", "twin", "fit", judged.run_path, "-o", "twin.json"),
        told=told,
        of=len(parameters),
        rest_min=judged.rest_s / 60.0,
    )


def _table(judged: Judged) -> LogUse:
    run = judged.run
    if run.temperature is None or not np.isfinite(run.temperature.gyro_degC).any():
        return _use(Use.TABLE, Fit.NO, UseReason.NO_TEMPERATURE)
    mems = run.header.gyro_technology == "mems"
    if mems and not find_rests(run).stretches:
        return _use(Use.TABLE, Fit.NO, UseReason.NEVER_PARKED)
    if not mems and judged.aligned.verdict is not AlignmentVerdict.ALIGNED:
        return _use(Use.TABLE, Fit.NO, UseReason.NOT_ALIGNED, why=_first_reason(judged.aligned))
    still_s = _still_s(judged.aligned)
    if not mems and still_s < MIN_MERGED_REST_S:
        still, needed = still_s / 60.0, MIN_MERGED_REST_S / 60.0
        return _use(Use.TABLE, Fit.NO, UseReason.SHORT_REST, rest_min=still, needed_min=needed)
    low, high = np.nanmin(run.temperature.gyro_degC), np.nanmax(run.temperature.gyro_degC)
    narrow = bool(high - low < NARROW_DEGC)
    return _use(
        Use.TABLE,
        Fit.PARTLY if narrow else Fit.YES,
        UseReason.NARROW if narrow else UseReason.TEMPERATURES,
        ("recal", "update", judged.run_path, "--new-store", "--new-unit"),
        low_degC=float(low),
        high_degC=float(high),
    )


def _still_s(aligned: AlignmentDocument) -> float:
    """Seconds of the parked phases that the alignment used, as an update counts them."""
    parked_s = sum(p.end_s - p.start_s for p in aligned.phases if p.phase in PARKED_PHASES)
    return parked_s * aligned.used_percent / 100.0


def _replay(judged: Judged) -> LogUse:
    words = ("recal", "replay", judged.run_path)
    gnss = judged.run.gnss
    if gnss is not None and gnss.time_s.size >= FEWEST_FIXES:
        return _use(Use.REPLAY, Fit.YES, UseReason.FIXES, words, fixes=gnss.time_s.size)
    if judged.aligned.verdict is AlignmentVerdict.ALIGNED:
        return _use(Use.REPLAY, Fit.PARTLY, UseReason.NO_FIXES, words, needed=FEWEST_FIXES)
    return _use(Use.REPLAY, Fit.NO, UseReason.NO_START)


def _diagnosis(judged: Judged) -> LogUse:
    if judged.fitted is None:
        return _use(Use.DIAGNOSIS, Fit.NO, UseReason.NO_REST)
    run = judged.run_path
    fit = ("recal", "twin", "fit", run, "-o", "twin.json")
    diagnose = ("recal", "diagnose", run, "--twin", "twin.json")
    return _use(Use.DIAGNOSIS, Fit.YES, UseReason.TWIN_FIRST, (*fit, "&&", *diagnose))
