"""Sentences of `infield.session`: why sessions are judged so, and what is to be done."""

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum

from infield.reports.words.sentences import Template
from infield.session.reasons import (
    Advice,
    ChainNote,
    NewUnitReason,
    NoiseReason,
    ParkedReason,
    SessionReason,
    ThermalAction,
    ThermalKind,
    VarianceSource,
    WrongFact,
)

DECISION_RULE = (
    "A session is merged when the unit was at rest for at least 5 min, gyro temperatures were"
    " logged and moved or were live, the filter's NIS is not above its 99.9 % band, the session"
    " agrees with the stored table within 99.9 %, the run was not merged before, and at least one"
    " gyro's mean bias became better known by 10 % or more."
)
PARKED_RULE = (
    "A session of gyros that find no heading (MEMS) is merged when it holds a parked stretch of at"
    " least 60 s, judged by the raw seconds in sigmas of this unit, gyro temperatures were logged"
    " and moved or were live, the rates change along it as table and noise model allow (NIS not"
    " above its 99.9 % band), the session agrees with the stored table within 99.9 %, the run was"
    " not merged before, and at least one gyro's mean bias became better known by 10 % or more."
)


VARIANCE_SOURCES: Mapping[VarianceSource, str] = {
    VarianceSource.STORED_TABLE: "the table before, as far as the runs did not renew it",
    VarianceSource.AGEING: "ageing since the table was made, and temperatures it did not hold",
    VarianceSource.TURN_ON: "turn-on: this power-on against the mean of all",
    VarianceSource.BIAS_INSTABILITY: "bias instability during the runs",
    VarianceSource.RATE_RANDOM_WALK: "rate random walk during the runs",
    VarianceSource.MISALIGNMENT: "misalignment of the gyros, through Earth rate",
    VarianceSource.THERMOMETER: "errors of the thermometers",
    VarianceSource.DOUBTED_FACT: "facts in doubt, and a latitude that several runs share",
    VarianceSource.HEATING_AND_COOLING: "heating against cooling",
    VarianceSource.BINS: "times without a temperature",
    VarianceSource.ANGLE_RANDOM_WALK: "white noise of the gyros (angle random walk)",
    VarianceSource.ACCELEROMETERS: "noise and biases of the accelerometers",
    VarianceSource.STANDING: "sway and creep of the standing vehicle",
    VarianceSource.ROLLING: "the taxi: side motion, crab, wheels, satellite fixes",
    VarianceSource.EARTH_RATE: "Earth rate on a heading that is not known",
    VarianceSource.LATITUDE: "the latitude, by which Earth rate is taken out",
    VarianceSource.MEASURED: "other noise of the measurement",
}


def _table_disagrees(
    *,
    axis: str,
    shift_deg_h: float,
    sigma_deg_h: float,
    since_utc: str,
    run_ids: Sequence[str],
    **of_step: object,
) -> str:
    return (
        f"table disagrees with unit since about {since_utc[:10]}: gyro {axis} by"
        f" {shift_deg_h:+.4f} +- {sigma_deg_h:.4f} deg/h; {len(run_ids)} sessions agree"
        f" ({', '.join(run_ids)}); if the site is entered right and the unit is this one, recal"
        " update with these runs and --accept-step follows it"
    )


_WRONG_FACTS: Mapping[WrongFact, str] = {
    WrongFact.LATITUDE: "the entered latitude were off by {size:+.3f} +- {sigma:.3f} deg",
    WrongFact.TIME_BASE: "the clock of the log ran fast by {size:+.2%} +- {sigma:.2%}",
    WrongFact.GYRO_SCALE: "the scale of gyro {axis} were off by {size:+.2%} +- {sigma:.2%}",
    WrongFact.GYRO_AXES: (
        "the gyros were turned by {size:+.2f} +- {sigma:.2f} mrad about {axis} against the"
        " accelerometers"
    ),
    WrongFact.GYRO_STEP: (
        "gyro {axis} had stepped by {size:+.4f} +- {sigma:.4f} deg/h at about {at_s:.0f} s"
    ),
    WrongFact.THERMAL_LAG: (
        "the bias of gyro {axis} followed its temperature late: {size:+.4f} +- {sigma:.4f} deg/h"
        " per degC with 10 min of lag"
    ),
    WrongFact.COMPENSATED_BEFORE: (
        "{size:.2f} +- {sigma:.2f} of the stored table are missing from the rates (0: the log is"
        " raw, as run.json says; 1: it was subtracted before, and run.json needs its hash)"
    ),
    WrongFact.COMPENSATION: (
        "{size:.2f} +- {sigma:.2f} of that table still stand in the rates (0: it was subtracted, as"
        " run.json says; 1: the log is raw, and run.json needs null)"
    ),
}


def _wrong_fact(
    *,
    fact: str,
    axis: str,
    at_s: float,
    size: float,
    sigma: float,
    sigmas: float,
    limit_sigmas: float,
) -> str:
    """What a session looks like, and how clearly."""
    like = _WRONG_FACTS[WrongFact(fact)].format(axis=axis, at_s=at_s, size=size, sigma=sigma)
    if fact in (WrongFact.COMPENSATION, WrongFact.COMPENSATED_BEFORE):
        return f"applied_table_sha256: {like}"
    return (
        f"it looks as if {like}: {abs(sigmas):.1f} sigma, 99.9 % of sound sessions lie within"
        f" {limit_sigmas:.1f}"
    )


def _unlike(
    *, chi2: float, dof: int, limit: float, sessions: int, furthest: str, off: float, sigma: float
) -> str:
    """By which marks a session is not of the unit that it names."""
    name, unit = furthest.rsplit("_", 1)
    shown = {"degC": "degC", "ug": "micro-g"}[unit]
    which = "specific force" if name == "force" else name
    return (
        f"accelerometers and thermometers are not those of this unit in {sessions} earlier"
        f" session{'s' if sessions != 1 else ''}: chi2 {chi2:.1f} for {dof} degrees of freedom,"
        f" 99.5 % lie below {limit:.1f}; furthest off is {which} by {off:+.3g} +- {sigma:.2g}"
        f" {shown}. Another unit under the same serial, or a repaired one (check_unit = false)?"
    )


def _longest_rest(*, found: tuple[float, float] | None, needed_s: float) -> str:
    told = "none" if found is None else f"{found[1] - found[0]:.0f} s, from {_span(*found)}"
    return (
        f"longest rest found: {told}; needed {needed_s:.0f} s, and 10 min or more of warm-up to"
        " show a slope"
    )


def _span(start_s: float, end_s: float) -> str:
    return f"{start_s:.0f} to {end_s:.0f} s"


def thermal_term(*, axis: str, kind: str, value: float, sigma: float, action: str) -> str:
    """What was found of heating against cooling on one axis, and what was done about it."""
    return _THERMAL[ThermalAction(action)](axis, _size(kind, value, sigma), kind)


def _size(kind: str, value: float, sigma: float) -> tuple[str, str]:
    """The size of a term, and how sure it is."""
    sure = f"({abs(value / sigma) if sigma > 0 else 0.0:.1f} sigma)"
    if kind == ThermalKind.RATE:
        return f"{value:+.4f} +- {sigma:.4f} deg/h per degC/min", sure
    return f"{2 * value:+.4f} +- {2 * sigma:.4f} deg/h between heating and cooling", sure


def _not_tested(axis: str, size: tuple[str, str], kind: str) -> str:
    return f"gyro {axis}: not tested, its temperature hardly moved"


def _does_not_explain(axis: str, size: tuple[str, str], kind: str) -> str:
    return (
        f"gyro {axis}: {size[0]} looks like it, but does not bring the sessions into agreement:"
        " not used"
    )


def _seen_in_one(axis: str, size: tuple[str, str], kind: str) -> str:
    return f"gyro {axis}: {' '.join(size)} in one session: not used unless another one shows it"


def _split(axis: str, size: tuple[str, str], kind: str) -> str:
    return (
        f"gyro {axis}: heating and cooling differ, {size[0]}, or a session is wrong: more sessions"
        " would tell"
    )


def _none_found(axis: str, size: tuple[str, str], kind: str) -> str:
    return f"gyro {axis}: no difference found, {' '.join(size)}"


def _acted(action: ThermalAction) -> Callable[[str, tuple[str, str], str], str]:
    def told(axis: str, size: tuple[str, str], kind: str) -> str:
        after = (
            "the table holds the bias at a steady temperature"
            if kind == ThermalKind.RATE
            else "its points count less"
        )
        return f"gyro {axis}: {action}: {' '.join(size)}; {after}"

    return told


_THERMAL: Mapping[ThermalAction, Callable[[str, tuple[str, str], str], str]] = {
    ThermalAction.NOT_TESTED: _not_tested,
    ThermalAction.DOES_NOT_EXPLAIN: _does_not_explain,
    ThermalAction.SEEN_IN_ONE_SESSION: _seen_in_one,
    ThermalAction.SPLIT_OR_WRONG_SESSION: _split,
    ThermalAction.NONE_FOUND: _none_found,
    ThermalAction.RATE_TERM_FITTED: _acted(ThermalAction.RATE_TERM_FITTED),
    ThermalAction.SIGMA_WIDENED: _acted(ThermalAction.SIGMA_WIDENED),
}

SENTENCES: Mapping[StrEnum, Template] = {
    SessionReason.OF_RUN: "{run_id}: {reason}",
    SessionReason.ALREADY_MERGED: "the table already holds this run (same content hash)",
    SessionReason.STARTS_IN_FUTURE: (
        "start_utc {start_utc} is in the future, the clock says {now_utc}: a table that is dated by"
        " it would take every later session for an earlier one"
    ),
    SessionReason.OTHER_TEMPERATURES: (
        "the temperatures go on to {until_s:.0f} s, the imu ends at {end_s:.0f} s: they were hardly"
        " logged beside it"
    ),
    SessionReason.NEVER_RESTS: (
        "the run never rests for a minute; a parked alignment and 30 min in navigation are needed"
    ),
    SessionReason.LEVEL_REMOVED: (
        "a constant of the session had been subtracted from the rates (an autopilot's start-up gyro"
        " offsets): their level is not the unit's; convert the log again with --map FILE of the"
        ' lines format = "dataflash" and gyro_offsets = "add_back"'
    ),
    SessionReason.TEMPERATURE_UNCOVERED: (
        "gyro temperature is known for {known_percent:.0f} % of the session, needed"
        " {needed_percent:.0f} %"
    ),
    SessionReason.FILTER_LOST: "the filter cannot follow this log: {fault}",
    SessionReason.REST_MOVES: (
        "the log reads like a rest for {rest_s:.0f} s, but its own solution stands still for no"
        " step of the filter there, needed {needed_s:g} s: a smooth cruise reads like that, and a"
        " unit much noisier than its noise model ({source}). With a satellite receiver a log is"
        " taken from the air on; without one it must begin parked, for 5 to 15 min"
    ),
    SessionReason.SHORT_REST: (
        "{rest_s:.0f} s at rest, needed {needed_s:.0f} s; {dropped_s:.0f} s were dropped for motion"
        " (listed as excluded)"
    ),
    SessionReason.EXCESS_RESIDUALS: (
        "{excess}; the twin's noise is too small or an effect is not modelled"
    ),
    SessionReason.RATES_CHANGE: (
        "{excess}; the rates change along the session by more than table and twin allow: a table"
        " that does not fit, a wrong thermometer, or a noise model that is too small"
    ),
    SessionReason.COMPENSATED_BEFORE: (
        "the rates would agree with the table had it been subtracted already (NIS"
        " {nis_compensated:.0f} instead of {nis:.0f}): was this log compensated? Then run.json"
        " needs applied_table_sha256"
    ),
    SessionReason.BEYOND_GATE: (
        "{share_percent:.0f} % of the measurements lie beyond the gate, needed below"
        " {needed_percent:.0f} %"
    ),
    SessionReason.KIND_BEYOND_GATE: (
        "{kind}: {share_percent:.0f} % of its measurements lie beyond the gate, needed below"
        " {needed_percent:.0f} %; no wind, arm, delay or scale explains them"
    ),
    SessionReason.NO_GAIN: (
        "no gyro gains: the best keeps {kept_percent:.0f} % of its prior sigma, needed below 90 %"
    ),
    SessionReason.AGAINST_TABLE: "the session contradicts the stored table: {found}",
    SessionReason.MERGE_RESIDUALS: (
        "NIS {nis:.1f} for {dof} degrees of freedom, 99.9 % lie below {limit:.1f}"
    ),
    SessionReason.AXIS_SHIFTED: (
        "gyro {axis} shifted by {shift_sigmas:+.1f} sigma, 99.9 % of sessions lie within"
        " {limit_sigmas:.1f}"
    ),
    SessionReason.LEVEL_OFF: (
        "its shape over temperature agrees, its level does not: power-ons of this unit may differ"
        " by more than the turn-on of its noise model says (--twin)"
    ),
    SessionReason.TABLE_DISAGREES: _table_disagrees,
    SessionReason.NO_STEP: (
        "no step to accept: at least two sessions must agree with each other against the table"
    ),
    SessionReason.NOT_COMMITTED: "not committed: {fault}",
    SessionReason.LIKE_A_WRONG_FACT: _wrong_fact,
    SessionReason.FORCE_OFF_GRAVITY: (
        "the specific force at rest is {excess_ug:+.0f} micro-g ({share_percent:+.3f} %) off"
        " gravity at this site, needed within {limit_ug:.0f}: a wrong time base, scale, or height"
    ),
    SessionReason.UNLIKE_THE_UNIT: _unlike,
    NewUnitReason.FROM_NOTHING: (
        "begun from nothing, as no table of the unit was given or stored: bias 0 +-"
        " {sigma_deg_h:.3g} deg/h, the raw bias of {technology} gyros"
    ),
    NewUnitReason.VERTICAL_BY_LATITUDE: (
        "without a table the vertical gyro rests on the latitude of {run_id}, {latitude_deg:.3f} +-"
        " {sigma_deg:.2g} deg ({source}): 0.01 deg is {deg_h_a_hundredth:.4f} deg/h there, and no"
        " reading of this unit shows which of the two is wrong"
    ),
    NoiseReason.DEFAULTS: (
        "no noise model of {imu_serial} was given: every sigma rests on the defaults of"
        " {technology}; {command} measures it, then --twin twin.json"
    ),
    ParkedReason.NO_HEADING: (
        "gyro uncertainty {sigma_deg_h:.3g} deg/h against {level_deg_h:.3g} deg/h of level Earth"
        " rate: no heading at rest, and no gyro bias by gyrocompass; zero-rate biases against"
        " temperature are taken instead"
    ),
    ParkedReason.NO_REST: "no rest: {start_s:.0f} to {end_s:.0f} s: {why}",
    ParkedReason.REST_TOO_SHORT: "a rest of {rest_s:.0f} s, needed {needed_s:.0f} s",
    ParkedReason.LONGEST_REST: _longest_rest,
    ParkedReason.NAMED_TOO_SHORT: (
        "named as parked, too short: {named_s:.0f} s, needed {needed_s:.0f} s of rest"
    ),
    ParkedReason.NAMED_NOT_AT_REST: (
        "named as parked, but the sensors do not rest: {named_s:.0f} s, needed {needed_s:.0f} s of"
        " rest"
    ),
    ParkedReason.GNSS_MOVES: (
        "GNSS says up to {fastest_m_s:.1f} m/s for {moving_s:.0f} s while the sensors rest: a"
        " steady roll, a circle or a hover taken for rest"
    ),
    ParkedReason.GNSS_DRIFTS: (
        "GNSS says {mean_m_s:.2f} m/s on the mean while the sensors rest, needed"
        " {allowed_m_s:.2f} at most"
    ),
    ParkedReason.NOT_STILL: (
        "less than {needed_s:.0f} s still between {start_s:.0f} and {end_s:.0f} s, the rest is"
        " motion"
    ),
    ParkedReason.TOO_NOISY: (
        "the gyros scatter {scale:.0f} times as much as their noise model ({source}) from second"
        " to second, needed {limit:.0f} at most: it shakes, or the model is of another unit"
    ),
    Advice.TURN_AND_STOP: (
        "turn by 90 to 180 deg and stop for 60 s or more on the new heading before the run ends,"
        " or log GNSS or an odometer in the taxi, or give a surveyed heading"
    ),
    Advice.PARK_LONGER: (
        "park longer: the vertical gyro shows only against an airframe that does not turn"
    ),
    Advice.HOLD_HEADING: (
        "allow the parked-attitude constraint, or park on a second heading for 20 min"
    ),
    Advice.FLY_TURNS: (
        "turn by 90 deg or more early in the flight and again an hour later: each turn shows the"
        " heading, and what it drifts in between shows the vertical gyro"
    ),
    Advice.PARK_FROM_COLD: (
        "park longer, from a cold start: noise still hides the bias, or the table knows it"
    ),
    Advice.MEND_THERMOMETER: (
        "the thermometer of gyro {axis} {fault}: its bias has no temperature"
    ),
    ChainNote.FOUND: "cross-track velocity after a turn, both velocities at stops",
    ChainNote.NO_TAXI: "no taxi: the east axis stays relative",
    ChainNote.BLIND: "the taxi never left the alignment heading: its cross-track motion is blind",
}
