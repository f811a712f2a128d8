"""What a log can and cannot be used for, each with the reason and the command that does it."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from alignment.reasons import AlignmentVerdict
from infield.aided.flight import FEWEST_FIXES
from infield.aided.headings import LEAST_MOVED_M_S, fixes_move
from infield.reports.documents.alignment import AlignmentDocument
from infield.session.acceptance import MIN_MERGED_REST_S
from infield.session.parked.stretches import stationary_segments
from ins.filters.aided_records import fixes_of
from ins.json_file import Written
from ins.records import PARKED_PHASES, GnssLog, Run
from ins.twin_file import default_twin
from ins.verdicts import Reason, ReasonCode, because, sentence
from recal.service.look.records import Assumption, Fit, LogUse, Use
from simreal.twin.fit.result import TwinFit

# of one gyro over the rest: 1 degC of a usual table, 0.001 deg/h per degC, is a third of what
# a session of an hour tells a gyro's bias to
NARROW_DEGC = 1.0
# in the place of what was guessed: pasted as it is, the command asks for it (a guess of the
# latitude that was pasted made a table 8 sigma wrong)
TO_BE_GIVEN = {"lat_deg": "LATITUDE"}


class UseReason(ReasonCode):
    """Why a log is fit for a use, or is not."""

    HEADING_FOUND = (
        "heading_found",
        "Heading is found to {sigma_deg:.2g} deg (1 sigma), without a table of the unit.",
    )
    LEVEL_ONLY = "level_only", "Roll and pitch are found, heading is not: {why}."
    NOT_ALIGNED = "not_aligned", "No attitude is found: {why}."
    NOISE_TOLD = (
        "noise_told",
        "From {rest_min:.1f} min at rest {told} of {of} parameters of the noise model are"
        " estimated.",
    )
    NO_REST = "no_rest", "The unit never rests for a minute, so its own noise cannot be seen."
    NO_TWIN = (
        "no_twin",
        "A log is compared with a noise model, and none can be made of this one; a twin of the unit"
        " from another log will do.",
    )
    NEVER_PARKED = (
        "never_parked",
        "The unit never stands parked for a minute, so no bias can be read against temperature.",
    )
    TEMPERATURES = (
        "temperatures",
        "The unit rests with its gyros at {low_degC:.1f} to {high_degC:.1f} degC. The table can be"
        " renewed over these temperatures.",
    )
    NARROW = (
        "narrow",
        "The unit rests with its gyros at {low_degC:.1f} to {high_degC:.1f} degC only. The table"
        " can be renewed in this narrow range.",
    )
    SHORT_REST = (
        "short_rest",
        "The unit stands still for {rest_min:.1f} min, and a table is renewed from"
        " {needed_min:.0f} min or more.",
        "Half an hour while the gyros warm up is a good session.",
    )
    NO_TEMPERATURE = (
        "no_temperature",
        "The log holds no gyro temperature, and a bias without its temperature has no place in a"
        " table.",
    )
    FIXES = "fixes", "{fixes} satellite fixes aid the navigation and judge it."
    NO_FIXES = (
        "no_fixes",
        "There are fewer than {needed} satellite fixes, so a replay shows the free-inertial drift"
        " alone.",
    )
    NO_MOTION = (
        "no_motion",
        "The fixes never move by {needed_m_s:g} m/s beyond their noise, and without motion only a"
        " heading found at rest, or given (survey), starts the navigation.",
    )
    NO_START = "no_start", "Without fixes the navigation needs a heading to start from."
    TWIN_FIRST = (
        "twin_first",
        "The log is compared with a noise model, which the first command makes.",
        "If you have another log of the unit, make the model from that one: a log always fits its"
        " own model.",
    )


@dataclass(frozen=True, kw_only=True)
class LookFindings:
    """What a look found of a log, for its uses.

    run_path: of the run that the commands name; fitted: None where no rest was found.
    """

    run: Run
    run_path: str
    aligned: AlignmentDocument
    fitted: TwinFit | None

    @property
    def rest_s(self) -> float:
        """Seconds at rest."""
        return 0.0 if self.fitted is None else self.fitted.parked_s


def uses_of(judged: LookFindings) -> tuple[LogUse, ...]:
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


def _use(use: Use, fit: Fit, why: Reason, words: Sequence[str] = ()) -> LogUse:
    return LogUse(
        use=use,
        fit=fit,
        why=sentence(why),
        reason_code=why.code.value,
        command=shlex.join(words).replace(" '&&' ", " && "),
    )


def _first_reason(aligned: AlignmentDocument) -> str:
    return str(aligned.reasons[0]) if aligned.reasons else "the rest says too little"


def _alignment(judged: LookFindings) -> LogUse:
    aligned, words = judged.aligned, ("recal", "align", judged.run_path)
    if aligned.verdict is AlignmentVerdict.ALIGNED:
        sigma_deg = float(aligned.sigma_heading_deg)
        found = because(UseReason.HEADING_FOUND, sigma_deg=sigma_deg)
        return _use(Use.ALIGNMENT, Fit.YES, found, words)
    why = _first_reason(aligned)
    if aligned.verdict is AlignmentVerdict.LEVEL_ONLY:
        return _use(Use.ALIGNMENT, Fit.PARTLY, because(UseReason.LEVEL_ONLY, why=why), words)
    return _use(Use.ALIGNMENT, Fit.NO, because(UseReason.NOT_ALIGNED, why=why))


def _noise(judged: LookFindings) -> LogUse:
    if judged.fitted is None:
        return _use(Use.NOISE, Fit.NO, because(UseReason.NO_REST))
    parameters = judged.fitted.parameters
    told = sum(p.identified for p in parameters)
    why = because(
        UseReason.NOISE_TOLD, told=told, of=len(parameters), rest_min=judged.rest_s / 60.0
    )
    if not told:
        return _use(Use.NOISE, Fit.NO, why)
    words = ("recal", "twin", "fit", judged.run_path, "-o", "twin.json")
    return _use(Use.NOISE, Fit.YES, why, words)


def _table(judged: LookFindings) -> LogUse:
    run = judged.run
    if run.temperature is None or not np.isfinite(run.temperature.gyro_degC).any():
        return _use(Use.TABLE, Fit.NO, because(UseReason.NO_TEMPERATURE))
    mems = run.header.gyro_technology == "mems"
    if mems and not stationary_segments(run).stretches:
        return _use(Use.TABLE, Fit.NO, because(UseReason.NEVER_PARKED))
    if not mems and judged.aligned.verdict is not AlignmentVerdict.ALIGNED:
        why = because(UseReason.NOT_ALIGNED, why=_first_reason(judged.aligned))
        return _use(Use.TABLE, Fit.NO, why)
    still_s = _still_s(judged.aligned)
    if not mems and still_s < MIN_MERGED_REST_S:
        short = because(
            UseReason.SHORT_REST, rest_min=still_s / 60.0, needed_min=MIN_MERGED_REST_S / 60.0
        )
        return _use(Use.TABLE, Fit.NO, short)
    low, high = np.nanmin(run.temperature.gyro_degC), np.nanmax(run.temperature.gyro_degC)
    words = ("recal", "update", judged.run_path, "--new-store", "--new-unit")
    if high - low < NARROW_DEGC:
        narrow = because(UseReason.NARROW, low_degC=float(low), high_degC=float(high))
        return _use(Use.TABLE, Fit.PARTLY, narrow, words)
    span = because(UseReason.TEMPERATURES, low_degC=float(low), high_degC=float(high))
    return _use(Use.TABLE, Fit.YES, span, words)


def _still_s(aligned: AlignmentDocument) -> float:
    """Seconds of the parked phases that the alignment used, as an update counts them."""
    parked_s = sum(p.end_s - p.start_s for p in aligned.phases or () if p.phase in PARKED_PHASES)
    return parked_s * aligned.used_percent / 100.0


def _replay(judged: LookFindings) -> LogUse:
    words = ("recal", "replay", judged.run_path)
    gnss = judged.run.gnss
    is_aligned = judged.aligned.verdict is AlignmentVerdict.ALIGNED
    if gnss is not None and gnss.time_s.size >= FEWEST_FIXES:
        starts_still = is_aligned or judged.run.header.survey.heading_rad is not None
        if not starts_still and not _moves(judged.run, gnss):
            still = because(UseReason.NO_MOTION, needed_m_s=LEAST_MOVED_M_S)
            return _use(Use.REPLAY, Fit.NO, still)
        aided = because(UseReason.FIXES, fixes=gnss.time_s.size)
        return _use(Use.REPLAY, Fit.YES, aided, words)
    if is_aligned:
        alone = because(UseReason.NO_FIXES, needed=FEWEST_FIXES)
        return _use(Use.REPLAY, Fit.PARTLY, alone, words)
    return _use(Use.REPLAY, Fit.NO, because(UseReason.NO_START))


def _moves(run: Run, gnss: GnssLog) -> bool:
    """Whether the velocities of the fixes, with the noise of an unknown twin, are ever more than
    that.
    """
    declared = default_twin(run.header.gyro_technology).gnss
    fixes = fixes_of(
        gnss,
        horizontal_m=declared.sigma_horizontal_m,
        vertical_m=declared.sigma_vertical_m,
        velocity_m_s=declared.sigma_velocity_m_s,
    )
    return fixes_move(fixes)


def _diagnosis(judged: LookFindings) -> LogUse:
    if judged.fitted is None:
        return _use(Use.DIAGNOSIS, Fit.NO, because(UseReason.NO_REST))
    if not any(p.identified for p in judged.fitted.parameters):
        return _use(Use.DIAGNOSIS, Fit.NO, because(UseReason.NO_TWIN))
    run = judged.run_path
    fit = ("recal", "twin", "fit", run, "-o", "twin.json")
    diagnose = ("recal", "diagnose", run, "--twin", "twin.json")
    words = (*fit, "&&", *diagnose)
    return _use(Use.DIAGNOSIS, Fit.YES, because(UseReason.TWIN_FIRST), words)
