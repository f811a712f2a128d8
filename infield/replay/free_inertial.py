"""A logged session flown again with each of several tables: align, then navigate free-inertially to
the end of the log::

    raw log -> less the table -> gyrocompass on the alignment phase -> navigation
        -> drift while parked, ground speed at later stops, error against GNSS

The alignment is computed anew with each table, since its heading error is that table's own. Nothing
is aided but the vertical channel; beside these flights, a run with GNSS is navigated with it once
(`infield.aided.flight`), with the active table. `ReferenceLog` is truth: it scores the
result here and goes nowhere near a solution.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment import gyrocompass
from alignment.motion.speeds import steady_roll
from alignment.motion.timeline import steady_epochs, timeline
from alignment.reasons import WITH_HEADING, AlignmentVerdict
from alignment.result import Alignment
from infield.aided.flight import AidedResult, Aiding, navigate_aided
from infield.aided.reasons import AidedVerdict
from infield.replay.drift import Drift, drift_against, parked_drift
from infield.replay.drift_prediction import DriftPrediction, level_shares, predict_parked
from infield.replay.reasons import Damping, ReplayNote, ReplayReason, ReplayVerdict
from infield.replay.stops import StopInterval, StopSpeed, find_stops, stop_speed
from infield.session.bins import SessionBins, make_bins
from infield.session.log import (
    alignment_end,
    compensated_imu,
    find_rest,
    session_end,
    with_applied_table_undone,
)
from infield.session.settings import SessionSettings
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import (
    GyroTemperature,
    fault_reason,
    gyro_temperature,
    too_short,
)
from ins.earth import EARTH_RATE_RAD_S
from ins.records import AXES, ImuSource, NavHistory, NavState, ReferenceLog, Run, TwinModel
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG_PER_HOUR
from ins.verdicts import Reason, because

# of navigation, and of a parked span, for a drift to mean anything: in 60 s a level gyro off by
# 0.01 deg/h makes 0.9 mm/s (physics.md 6.3)
SHORTEST_SPAN_S = 60.0
# before the start of navigation: holds the row before it (a run has no gap over 1 s)
ROW_BEFORE_S = 2.0
# 0.36 of a Schuler period (84.4 min, physics.md 6.1): a drift in NM/h from less is said to be
# extrapolated
EXTRAPOLATED_BELOW_S = 1800.0

Where = tuple[float, float]  # start and end [s]


@dataclass(frozen=True, kw_only=True)
class TableChoice:
    """A table to fly with. role: "active" or "previous"; origin: where it comes from, in words.

    table None: the gyro output stays raw.
    """

    role: str
    table: ThermalTable | None
    origin: str
    sha256: str | None = None
    revision: int | None = None


@dataclass(frozen=True, kw_only=True)
class TableReplay:
    """One table's flight. `history` is None where its alignment was refused, or where the log ends
    too soon after it (`unflown`); the rest is None where there is nothing.

    parked: against the parked position; gnss, reference: from the end of the parked span on
    (reference: scoring only); heading_error_rad: against the reference.
    """

    choice: TableChoice
    alignment: Alignment
    unflown: Reason | None = None
    history: NavHistory | None = None
    notes: tuple[Reason, ...] = ()
    bins: SessionBins | None = None
    parked: Drift | None = None
    predicted: DriftPrediction | None = None
    stops: tuple[StopSpeed, ...] = ()
    gnss: Drift | None = None
    reference: Drift | None = None
    heading_error_rad: float = float("nan")

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Why it was not flown, and what its alignment says."""
        own = () if self.unflown is None else (self.unflown,)
        return (*own, *self.alignment.reasons)


@dataclass(frozen=True, kw_only=True)
class ReplayResult:
    """The flights of a log and what is to be said of them.

    alignment_span: the stretch aligned on; parked_until_s: where the vehicle first rolls; aided:
    None without GNSS, or where it was not asked for.
    """

    run: Run
    verdict: ReplayVerdict
    reasons: tuple[Reason, ...] = ()
    notes: tuple[Reason, ...] = ()
    vertical: Damping = Damping.SITE
    alignment_span: Where | None = None
    parked_until_s: float | None = None
    tables: tuple[TableReplay, ...] = ()
    aided: AidedResult | None = None

    def of(self, role: str) -> TableReplay | None:
        return next((t for t in self.tables if t.choice.role == role), None)


def replay(
    run: Run,
    tables: Sequence[TableChoice],
    twin: TwinModel,
    *,
    applied_table: Callable[[str], ThermalTable] | None = None,
    reference: ReferenceLog | None = None,
    aided: bool | tuple[Where, ...] | Aiding = True,
    told: Callable[[str], None] = lambda words: None,
) -> ReplayResult:
    """Fly a log with each table, the active one first; `aided`: and with its GNSS, where it has
    that.

    Stretches for `aided`: their fixes are left out of that flight, which is scored with them;
    an `Aiding` also asks for the smoothed solution.
    applied_table(sha256): the table that the unit had subtracted, to be added back (InputError
    where unknown); told(words): hears what is being done. A run without gyro temperatures is flown
    raw, once, and the notes say so. Refusals are verdicts.
    """
    raw = with_applied_table_undone(run, applied_table)
    faults = tuple(
        because(ReplayNote.LOG_FAULT, start_s=f.start_s, end_s=f.end_s, fault=f.reason)
        for f in run.faults
    )
    temperature, said = _temperature_of(raw)
    notes = faults + said
    if temperature is None:
        tables = [TableChoice(role="active", table=None, origin="none: raw gyro output")]
    vertical, damping = _vertical(raw)
    rest = find_rest(raw)
    if rest is None:
        result = ReplayResult(
            run=run,
            verdict=ReplayVerdict.REFUSED,
            reasons=(steady_roll(raw) or because(ReplayReason.NEVER_RESTS),),
            notes=notes,
            vertical=damping,
        )
    else:
        span = (rest[0], min(alignment_end(raw, rest[0]), raw.imu.end_s))
        flown = []
        for choice in tables:
            told(f"flying with the {choice.role} table")
            flown.append(_fly(raw, choice, temperature, twin, span, vertical))
        result = ReplayResult(
            run=run,
            verdict=ReplayVerdict.REFUSED,
            reasons=flown[0].reasons,
            notes=notes,
            vertical=damping,
            alignment_span=span,
            tables=tuple(flown),
        )
        first = next((t.history for t in flown if t.history is not None), None)
        if first is not None:
            result = _with_scores(result, raw, first, twin, reference)
    if aided is False or raw.gnss is None:
        return result
    asked = aided if isinstance(aided, Aiding) else Aiding(left_out=() if aided is True else aided)
    told("navigating with satellite fixes")
    choice = tables[0]
    imu, _, sigma, _ = _prepared(
        raw, choice, temperature, twin, rest or (raw.imu.start_s, raw.imu.end_s)
    )
    gyrocompassed = bool(result.tables) and result.tables[0].alignment.verdict in WITH_HEADING
    flight = navigate_aided(
        raw, imu, twin, rest=rest if gyrocompassed else None, gyro_sigma_deg_h=sigma, aiding=asked
    )
    if asked.smooth:
        told("smoothing")
        flight = flight.with_smoothed(asked.left_out)
    return _with_aided(result, flight)


def _temperature_of(raw: Run) -> tuple[GyroTemperature | None, tuple[Reason, ...]]:
    """Gyro temperatures of a run and what is wrong with them; None where no table can be
    applied.
    """
    if raw.temperature is None:
        return None, (because(ReplayNote.NO_TEMPERATURE),)
    shortage = too_short(raw.temperature)
    if shortage:
        return None, (because(ReplayNote.TEMPERATURE_TOO_SHORT, shortage=shortage),)
    temperature = gyro_temperature(raw.temperature)
    faults = [
        because(ReplayNote.THERMOMETER_FAULT, fault=fault_reason(fault))
        for fault in temperature.faults
    ]
    stand_ins = [because(ReplayNote.MEAN_STANDS_IN, axis=axis) for axis in temperature.unusable]
    return temperature, (*faults, *stand_ins)


def _with_aided(result: ReplayResult, aided: AidedResult) -> ReplayResult:
    """The result with the aided flight; where that is all there is, it is a replay, and the notes
    keep the refusal.
    """
    if result.verdict is not ReplayVerdict.REFUSED or aided.history is None:
        return replace(result, aided=aided)
    contradicted = aided.verdict is AidedVerdict.INCONSISTENT
    kept = tuple(because(ReplayNote.NO_FREE_INERTIAL, reason=reason) for reason in result.reasons)
    return replace(
        result,
        aided=aided,
        verdict=ReplayVerdict.INCONSISTENT if contradicted else ReplayVerdict.REPLAYED,
        reasons=tuple(because(ReplayReason.BY_AIDED, reason=reason) for reason in aided.reasons),
        notes=result.notes + kept,
    )


def _with_scores(
    result: ReplayResult,
    raw: Run,
    first: NavHistory,
    twin: TwinModel,
    reference: ReferenceLog | None,
) -> ReplayResult:
    """The result with every flight measured over the same spans, found on the first one."""
    active, span = result.tables[0], result.alignment_span
    assert span is not None
    motion = timeline(raw, first)
    parked_s = motion.parked_until_s
    stops = find_stops(motion, steady_epochs(first, motion))
    parked_for_s = parked_s - float(first.time_s[0])
    short = SHORTEST_SPAN_S <= parked_for_s < EXTRAPOLATED_BELOW_S
    extrapolated = because(ReplayNote.EXTRAPOLATED, parked_s=parked_for_s)
    inconsistent = active.alignment.verdict is AlignmentVerdict.INCONSISTENT
    return replace(
        result,
        verdict=ReplayVerdict.INCONSISTENT if inconsistent else ReplayVerdict.REPLAYED,
        reasons=active.reasons if inconsistent or active.history is None else (),
        notes=result.notes + ((extrapolated,) if short else ()),
        parked_until_s=parked_s,
        tables=tuple(
            _scored(t, raw, twin, span, parked_s, stops, reference) for t in result.tables
        ),
    )


def _fly(
    run: Run,
    choice: TableChoice,
    temperature: GyroTemperature | None,
    twin: TwinModel,
    span: Where,
    vertical: VerticalChannel,
) -> TableReplay:
    """Align with one table, then navigate to the end of the log; only the alignment where that is
    refused.
    """
    imu, bins, sigma, notes = _prepared(run, choice, temperature, twin, span)
    aligned = gyrocompass.align(imu.between(*span), run.header.site, twin, bias_sigma_deg_h=sigma)
    history, unflown = None, None
    C_nb, left_s = aligned.C_nb, imu.end_s - aligned.time_s
    if aligned.verdict in WITH_HEADING and C_nb is not None:
        if left_s < SHORTEST_SPAN_S:
            unflown = because(ReplayReason.LOG_ENDS, left_s=left_s, needed_s=SHORTEST_SPAN_S)
            aligned = replace(aligned, verdict=AlignmentVerdict.REFUSED)
        else:
            start = NavState(
                time_s=aligned.time_s, site=run.header.site, v_n_m_s=np.zeros(3), C_nb=C_nb
            )
            history = navigate(
                imu.pieces(aligned.time_s - ROW_BEFORE_S), start, epoch_s=1.0, vertical=vertical
            )
    return TableReplay(
        choice=choice, alignment=aligned, unflown=unflown, history=history, notes=notes, bins=bins
    )


def _prepared(
    run: Run, choice: TableChoice, temperature: GyroTemperature | None, twin: TwinModel, span: Where
) -> tuple[ImuSource, SessionBins | None, NDArray | None, tuple[Reason, ...]]:
    """The log less a table; bins from the span's start and their first sigmas (3,) [deg/h]; notes.
    None without a table.
    """
    if choice.table is None or temperature is None:
        return compensated_imu(run, None, temperature, twin), None, None, ()
    table, notes = _covering(choice.table, temperature)
    bins = make_bins(
        table, temperature, twin, SessionSettings(), start_s=span[0], end_s=session_end(run)
    )
    return (
        compensated_imu(run, table, temperature, twin),
        bins,
        np.sqrt(np.diag(bins.prior)[:3]),
        notes,
    )


def _covering(
    table: ThermalTable, temperature: GyroTemperature
) -> tuple[ThermalTable, tuple[Reason, ...]]:
    """The table widened to the temperatures seen (the end values held), and a note for each axis
    beyond its nodes.
    """
    T = temperature.temperature_degC
    beyond = tuple(
        because(ReplayNote.BEYOND_NODES, axis=axis, low_degC=T[:, k].min(), high_degC=T[:, k].max())
        for k, axis in enumerate(AXES)
        if not table.in_range(axis, T[:, k]).all()
    )
    return table.extended_to(float(T.min()), float(T.max())), beyond


def _vertical(run: Run) -> tuple[VerticalChannel, Damping]:
    """What damps the height."""
    if run.gnss is None:
        return VerticalChannel(mode="hold"), Damping.SITE
    aided = VerticalChannel(mode="aided", time_s=run.gnss.time_s, height_m=run.gnss.height_m)
    return aided, Damping.GNSS


def _scored(
    flown: TableReplay,
    run: Run,
    twin: TwinModel,
    span: Where,
    parked_s: float,
    stops: Sequence[StopInterval],
    reference: ReferenceLog | None,
) -> TableReplay:
    """The flight with its measures."""
    history, aligned = flown.history, flown.alignment
    if history is None or aligned.C_nb is None:
        return flown
    parked = predicted = None
    if parked_s - aligned.time_s >= SHORTEST_SPAN_S:
        parked = parked_drift(history, run.header.site, parked_s)
        if flown.bins is not None:
            predicted = predict_parked(
                edges_s=flown.bins.edges_s,
                covariance=flown.bins.prior,
                twin=twin,
                site=run.header.site,
                C_nb=aligned.C_nb,
                alignment=(span[0], aligned.time_s),
                end_s=float(aligned.time_s + parked.time_s[-1]),
            )
    heading_error = float("nan")
    if reference is not None:
        k = int(np.argmin(np.abs(reference.time_s - aligned.time_s)))
        heading_error = float(
            np.angle(np.exp(1j * (aligned.heading_rad - reference.heading_rad[k])))
        )
    lever = np.asarray(run.header.gnss_lever_arm_m)
    return replace(
        flown,
        parked=parked,
        predicted=predicted,
        stops=tuple(stop_speed(history, stop) for stop in stops),
        gnss=None if run.gnss is None else drift_against(history, run.gnss, lever, parked_s),
        reference=(
            None if reference is None else drift_against(history, reference, np.zeros(3), parked_s)
        ),
        heading_error_rad=heading_error,
    )


def heading_change(result: ReplayResult) -> tuple[float, float] | None:
    """Aligned heading with the active table less that with the previous one [rad], and what the
    tables' own difference of mean east bias over the alignment makes of it, db_E / (Omega cosL)
    (physics.md 6.4).
    """
    new, old = result.of("active"), result.of("previous")
    if (
        new is None
        or old is None
        or new.history is None
        or old.history is None
        or new.bins is None
        or old.bins is None
    ):
        return None
    seen = np.angle(np.exp(1j * (new.alignment.heading_rad - old.alignment.heading_rad)))
    assert result.alignment_span is not None and new.alignment.C_nb is not None
    east = level_shares(new.bins.edges_s, new.alignment.C_nb, result.alignment_span)[1]
    change = east @ (new.bins.table_deg_h - old.bins.table_deg_h) * DEG_PER_HOUR
    return float(seen), float(change / (EARTH_RATE_RAD_S * np.cos(result.run.header.site.lat_rad)))
