"""A logged session navigated with its satellite fixes: an inertial solution held by GNSS, with
sigmas that were tested::

    compensated log -> where it stands
        -> start (gyrocompass while parked, else satellite velocities) -> filter -> noise judged

Errors, filter and gate: `ins.filters.aided_tape`. It is causal, and no part of the free-inertial
flights.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from alignment.gyrocompass import nis_verdict
from alignment.motion.inertial import Where
from alignment.motion.seconds import seconds_of
from alignment.motion.speeds import find_stands, joined
from infield.aided.antenna import Fitted, SeenAntenna, fit_model
from infield.aided.checks import contradicted, mounting_note, site_note, without_repeats
from infield.aided.flights import Beginning, Flights, Given, options_of
from infield.aided.grade import Weak, graded
from infield.aided.headings import HeadingOpen, Sky
from infield.aided.left_out import (
    WITHOUT_S,
    OutageScore,
    check_left_out,
    scored,
    usual_motion,
    without,
)
from infield.aided.noise import (
    CHANGE_GAIN_NATS,
    MATERIAL,
    Flown,
    Model,
    NoiseScales,
    capped_nis,
    flown,
)
from infield.aided.open_heading import causal_weights, mixed
from infield.aided.reasons import (
    AidedGrade,
    AidedNote,
    AidedReason,
    AidedVerdict,
    StartMethod,
    WheelsFound,
    Widened,
)
from infield.aided.smoothing import smooth_all_headings, smooth_flight
from infield.aided.start import FoundStart
from infield.aided.taken import antenna_notes, fixes_note, noise_notes, unbelieved
from infield.aided.wheels import Mounting, seen_wheels
from ins.errors.catalogue import prior
from ins.errors.table import DEFAULT_SIGMA_deg_h
from ins.filters.aided_filter import KINDS
from ins.filters.aided_records import (
    JUMPED,
    REJECTED,
    RESET,
    UNSEEN,
    USED,
    AidedHistory,
    AidedNoise,
    Antenna,
    Fixes,
    fixes_of,
)
from ins.noise import accel_densities, flicker_walk, gyro_densities
from ins.records import ImuSource, Run, TemperatureLog, TwinModel
from ins.units import (
    ARCSEC,
    DEG_PER_HOUR_SQRT_HOUR,
    MICRO_G,
    MICRO_G_PER_SQRT_HOUR,
    MILLIRADIAN,
    PPM,
)
from ins.verdicts import Reason, because

FEWEST_FIXES = 10  # chosen: 10 s of one fix a second; fewer hold nothing
# of the fixes of a kind; as many as that may be wild, or leap for a while: those are told, and the
# rest stand (`infield.aided.grade`). With 1 in 3 wild a flight is inconsistent, with 1 in
# 10 it is not (tests/infield/test_aided.py, test_aided_grade.py)
MOST_REJECTED = 0.25
# without a used position: the solution coasts, and it is listed; at one fix a second 2 may be
# lost
OUTAGE_S = 3.0
# of likelihood of the fixes that wheels may cost: odds of e^5, as for what noise must bring
WORSE_NATS = 5.0
# units whose tilts a deflected vertical matters to: 5 arcsec are 24 microradians, and in flight
# tilts of theirs are good to 10 to 16, of a MEMS unit to 1,400
LEVEL_UNITS = ("rlg", "fog")
WARMED_S = 60.0  # chosen: noise of a thermometer, 0.1 degC, is below a ramp of 1 degC/min


@dataclass(frozen=True, kw_only=True)
class Outage:
    """A stretch without a used position, sigma of the level position at its end [m], and what the
    next fix was off [m]; NaN where none follows.
    """

    start_s: float
    end_s: float
    sigma_m: float
    off_m: float


@dataclass(frozen=True, kw_only=True)
class AidedResult:
    """What follows verdict, reasons and notes is None or empty where nothing was flown.

    declared_nis: mean NIS of position and velocity with the noise as declared, before any scale
    (`capped_nis`); flicker: of gyros [rad/s] and accelerometers [m/s^2], as declared: no filter
    follows it. fixes: as declared; given: what the filter was given, which whoever flies the log
    again takes; scales: how far that is from what was declared, to be told. every: fixes, those
    that were left out among them. smooth: gives the solution that all fixes make; smoothed: that
    solution, and smoothed_scores: its outages. mounting: of a unit whose vehicle is held by its
    wheels.
    """

    verdict: AidedVerdict
    reasons: tuple[Reason, ...] = ()
    notes: tuple[Reason, ...] = ()
    role: str = "active"
    found: FoundStart | None = None
    history: AidedHistory | None = None
    fixes: Fixes | None = None
    given: Given | None = None
    scales: NoiseScales = field(default_factory=NoiseScales)
    antenna: SeenAntenna | None = None
    declared_nis: tuple[float, float] = (float("nan"), float("nan"))
    stands: tuple[Where, ...] = ()
    outages: tuple[Outage, ...] = ()
    outage_scores: tuple[OutageScore, ...] = ()
    grade: AidedGrade | None = None
    weak: tuple[Weak, ...] = ()
    flicker: tuple[float, float] = (0.0, 0.0)
    every: Fixes | None = None
    smooth: Callable[[], AidedHistory] | None = None
    smoothed: AidedHistory | None = None
    smoothed_scores: tuple[OutageScore, ...] = ()
    mounting: Mounting | None = None

    def with_smoothed(self, left_out: tuple[Where, ...] = ()) -> "AidedResult":
        """The result with the smoothed solution, scored where fixes were left out."""
        if self.smooth is None or self.every is None:
            return self
        best = self.smooth()
        return replace(self, smoothed=best, smoothed_scores=scored(best, self.every, left_out))


class Vehicle(StrEnum):
    """What an aided flight may take the vehicle for; FIND: a car where the log shows one."""

    CAR = "car"
    FIND = "find"
    OTHER = "other"


@dataclass(frozen=True, kw_only=True)
class Aiding:
    """What is asked of an aided flight: stretches (start, end) [s] whose fixes it is not given and
    is scored with; smooth: also the solution that all fixes make; vehicle: on wheels or not.
    """

    left_out: tuple[Where, ...] = ()
    smooth: bool = False
    vehicle: Vehicle = Vehicle.OTHER


def aided_noise(twin: TwinModel, technology: str | None = None) -> AidedNoise:
    """Densities of a twin in SI; flicker is carried by a random walk beside the twin's own
    (`flicker_walk`). technology: whose scales and misalignments are states, None: they are none.
    """
    gyro, accel = twin.gyro, twin.accel
    flicker = flicker_walk(gyro.bias_instability_deg_h, gyro.arw_deg_sqrt_h * 60.0)
    accel_flicker = flicker_walk(accel.bias_instability_ug, accel.vrw_ug_sqrt_hz)
    scale = misaligned = accel_scale = 0.0
    if technology is not None:
        measured = np.array(gyro.sigma_misalignment_mrad)
        mrad = (
            measured.max()
            if (measured > 0.0).all()
            else prior("gyro_misalignment_x", "replay").each()[technology]
        )
        misaligned = float(mrad) * MILLIRADIAN
        scale = prior("gyro_scale_factor", "replay").each()[technology] * PPM
        accel_scale = prior("accel_scale_factor", "replay").each()[technology] * PPM
    return AidedNoise(
        gyro_scale=scale,
        misalignment_rad=misaligned,
        accel_scale=accel_scale,
        arw=gyro_densities(gyro).white,
        vrw=accel_densities(accel).white,
        gyro_walk=float(np.hypot(gyro.rate_random_walk_deg_h_sqrt_h, flicker))
        * DEG_PER_HOUR_SQRT_HOUR,
        accel_walk=float(np.hypot(accel.rate_random_walk_ug_sqrt_h, accel_flicker))
        * MICRO_G_PER_SQRT_HOUR,
    )


def warming_walk(log: TemperatureLog | None) -> float:
    """The random walk [degC/sqrt(s)] that goes as far as the gyros' temperature does, in whatever
    time is the worst; 0 where none is logged. A thermometer that misses a row is taken from its own
    rows before and after.
    """
    if log is None or not np.isfinite(log.gyro_degC).any():
        return 0.0
    every = np.arange(log.time_s[0], log.time_s[-1], WARMED_S)
    seen = [(column, np.isfinite(column)) for column in log.gyro_degC.T]
    axes = [np.interp(every, log.time_s[ok], column[ok]) for column, ok in seen if ok.any()]
    degC = np.mean(axes, axis=0)
    lags = [2**k for k in range(int(np.log2(max(every.size - 1, 1))) + 1) if 2**k < every.size]
    far = [np.abs(degC[lag:] - degC[:-lag]).max() / np.sqrt(lag * WARMED_S) for lag in lags]
    return float(max(far, default=0.0))


def warmed_accel_walk(run: Run) -> float:
    """The random walk of the accelerometers' biases [m/s^2/sqrt(s)] that their slope over
    temperature makes of a run's warming.
    """
    slope = prior("accel_thermal", "replay", "linear").each()[run.header.gyro_technology]
    return slope * MICRO_G * warming_walk(run.temperature)


def navigate_aided(
    run: Run,
    imu: ImuSource,
    twin: TwinModel,
    *,
    rest: Where | None,
    gyro_sigma_deg_h: NDArray | None,
    role: str = "active",
    aiding: "Aiding | None" = None,
) -> AidedResult:
    """The aided solution of a run.

    imu: compensated. rest: where a gyrocompass aligned, None where it could not. gyro_sigma_deg_h
    (3,): what may be left of the gyro biases, None: unknown, the technology's.
    """
    header, aiding = run.header, aiding or Aiding()
    left_out = aiding.left_out
    if run.gnss is None:
        return _refused(because(AidedReason.NO_FIXES), role)
    fixes = fixes_of(
        run.gnss,
        horizontal_m=twin.gnss.sigma_horizontal_m,
        vertical_m=twin.gnss.sigma_vertical_m,
        velocity_m_s=twin.gnss.sigma_velocity_m_s,
    )
    fixes, repeats = without_repeats(fixes)
    check_left_out(left_out, fixes, imu.end_s)
    every, fixes = fixes, without(fixes, left_out)
    inside = (
        (fixes.time_s > imu.start_s) & (fixes.time_s <= imu.end_s) & np.isfinite(fixes.r_e_m[:, 0])
    )
    if inside.sum() < FEWEST_FIXES:
        few = because(AidedReason.FEW_FIXES, count=int(inside.sum()), needed=FEWEST_FIXES)
        return _refused(few, role)
    antenna = Antenna(lever_arm_m=np.asarray(header.gnss_lever_arm_m, dtype=float))
    unknown = np.full(3, max(DEFAULT_SIGMA_deg_h[header.gyro_technology], twin.gyro.turn_on_deg_h))
    sigma = unknown if gyro_sigma_deg_h is None else gyro_sigma_deg_h
    stands = find_stands(seconds_of(run.imu), fixes)
    if rest is not None:
        stands = joined(rest, *stands)

    noise = aided_noise(twin, header.gyro_technology)
    noise = replace(noise, accel_scale=max(noise.accel_scale, header.accepted_accel_scale))
    warmed = warmed_accel_walk(run)
    noise = replace(noise, accel_walk=float(np.hypot(noise.accel_walk, warmed)))
    if header.gyro_technology in LEVEL_UNITS:
        noise = replace(noise, deflection_rad=prior("vertical_deflection", "replay").size * ARCSEC)
    sky = Sky(
        imu=imu,
        fixes=fixes,
        twin=twin,
        noise=noise,
        options=options_of(header.gyro_technology, stands),
        gyro_sigma_deg_h=sigma,
        lever_arm_m=antenna.lever_arm_m,
    )
    declared_m = (
        twin.gnss.sigma_horizontal_m,
        twin.gnss.sigma_vertical_m,
        twin.gnss.sigma_velocity_m_s,
    )
    begin = Beginning(sky=sky, header=header, rest=rest, stands=stands)
    flights = Flights(imu, fixes, noise, declared_m, stands, header.gyro_technology, begin)
    flights = flights.by_type()
    fitted = fit_model(flights, antenna, flights.declared_m[0])
    if fitted is None:
        why = flights.start(antenna)
        assert isinstance(why, Reason)
        return replace(_refused(why, role), fixes=fixes, stands=stands)
    fitted, flights, contradicts, widened = _less_contradicted(flights, fitted)
    found = flights.start(fitted.model.antenna)
    assert isinstance(found, FoundStart)
    fitted, flights, without_fixes = _as_usual(flights, fitted)
    open_heading: tuple[Reason, ...] = ()
    if found.method is StartMethod.ALL_HEADINGS:
        fitted, why = _from_all_headings(flights, fitted)
        open_heading = (because(AidedNote.HEADING_OPEN, reason=why),)
    fitted, flights, rolling, mounting = _on_wheels(flights, fitted, run, aiding, found)
    history, scales = fitted.history, fitted.model.scales
    reasons = judged(history) + contradicts + unbelieved(scales, header.gyro_technology)
    notes = (
        open_heading
        + rolling
        + without_fixes
        + repeats
        + widened
        + site_note(fixes, stands, header.site, imu.start_s)
    )
    notes += mounting_note(history)
    notes += antenna_notes(fitted.antenna, antenna) + noise_notes(
        scales, flights, history, twin.source
    )
    notes += fixes_note(scales, fixes)
    outages = find_outages(history)
    grade, weak = graded(
        history, fixes, tuple((o.start_s, o.end_s) for o in outages), inconsistent=bool(reasons)
    )
    return AidedResult(
        verdict=AidedVerdict.INCONSISTENT if reasons else AidedVerdict.AIDED,
        grade=grade,
        weak=weak,
        reasons=reasons,
        role=role,
        found=found,
        history=history,
        fixes=fixes,
        given=flights.given(fitted.model),
        notes=notes,
        scales=scales,
        antenna=fitted.antenna,
        stands=stands,
        outages=outages,
        outage_scores=scored(history, every, left_out),
        declared_nis=(capped_nis(fitted.declared, 0), capped_nis(fitted.declared, 1)),
        flicker=(gyro_densities(twin.gyro).instability, accel_densities(twin.accel).instability),
        smooth=lambda: _smoothed(flights, found, fitted.model),
        every=every,
        mounting=mounting,
    )


def _less_contradicted(
    flights: Flights, fitted: Fitted
) -> tuple[Fitted, Flights, tuple[Reason, ...], tuple[Reason, ...]]:
    """The flight with wider sigmas where velocities are not the way of the positions: of that which
    the sensors contradict, or of both; reasons against the log, and notes.

    With the noise as found; as it is where that is likelier: the gate leaves out what is wild for a
    moment.
    """
    seen = contradicted(flights.fixes)
    plain = None if seen is None else flown(fitted.model, flights)
    if seen is None or plain is None:
        return fitted, flights, (), ()
    best, lead, whose = flights, CHANGE_GAIN_NATS, None
    for kind, fixes in seen.widened(flights.fixes).items():
        other = replace(flights, fixes=fixes)
        trial = flown(fitted.model, other)
        if trial is not None and (gain := trial.over(plain)) > lead:
            best, lead, whose = other, gain + CHANGE_GAIN_NATS, kind
    history = None if whose is None else best(fitted.model, whole=True)
    if whose is None or history is None:
        return fitted, flights, (), ()
    rows = np.flatnonzero(seen.rows)
    count = int(np.isfinite(flights.fixes.r_e_m[:, 0]).sum())
    told = {"count": rows.size, "components": seen.components, "sigmas": seen.sigmas}
    time_s = flights.fixes.time_s[rows]
    note = because(
        AidedNote.FIXES_WIDENED, first_s=time_s[0], last_s=time_s[-1], whose=whose, **told
    )
    against: tuple[Reason, ...] = ()
    if whose is Widened.BOTH and rows.size > MOST_REJECTED * count:
        against = (because(AidedReason.RECEIVER_CONTRADICTS, seen=count, **told),)
    return replace(fitted, history=history), best, against, (note,)


def _as_usual(flights: Flights, fitted: Fitted) -> tuple[Fitted, Flights, tuple[Reason, ...]]:
    """The flight that takes the vehicle to go as it usually does where it has no fixes, and that it
    does; noise and antenna are those of the fixes alone.
    """
    usual = usual_motion(flights.fixes)
    held = replace(flights, usual=usual)
    if usual is None or held.rows_of_receiver.all():
        return fitted, flights, ()
    history = held(fitted.model, whole=True)
    if history is None:
        return fitted, flights, ()
    note = because(AidedNote.USUAL_MOTION, without_s=WITHOUT_S, **vars(usual))
    return replace(fitted, history=history), held, (note,)


def _on_wheels(
    flights: Flights, fitted: Fitted, run: Run, aiding: "Aiding", found: FoundStart
) -> tuple[Fitted, Flights, tuple[Reason, ...], Mounting | None]:
    """The flight held by its wheels where the vehicle is a car, what there is to say of it, and how
    the unit is mounted.
    """
    if aiding.vehicle not in (Vehicle.CAR, Vehicle.FIND) or (
        found.method is StartMethod.ALL_HEADINGS
    ):
        return fitted, flights, (), None
    arm_m = np.asarray(run.header.wheel_reference_m, dtype=float)
    declared = aiding.vehicle is Vehicle.CAR
    seen = seen_wheels(fitted.history, run.odometer, arm_m, aiding.left_out, declared=declared)
    held, history = flights, None
    if seen.wheels is not None:
        held = replace(flights, wheels=seen.wheels)
        history = held(fitted.model, whole=True)
    if history is None or seen.mounting is None:
        return fitted, flights, (because(AidedNote.NO_WHEELS, why=seen.found),), None
    slips = history.rolled[1] > MOST_REJECTED * sum(history.rolled)
    if (
        slips
        or Flown(fitted.model, history).over(Flown(fitted.model, fitted.history)) < -WORSE_NATS
    ):
        note = because(AidedNote.NO_WHEELS, why=WheelsFound.CONTRADICTED)
        return fitted, flights, (note,), None
    note = because(
        AidedNote.WHEELS_TAKEN,
        side_m_s=seen.slip_m_s[0],
        up_m_s=seen.slip_m_s[1],
        odometer=bool(np.isfinite(seen.scale)),
        scale=seen.scale,
        mounted=seen.mounting,
        used=history.rolled[0],
        rejected=history.rolled[1],
    )
    return replace(fitted, history=history), held, (note,), seen.mounting


def _smoothed(flights: Flights, found: FoundStart, model: Model) -> AidedHistory:
    """The solution that all fixes make."""
    heading = flights.begin.heading
    if found.method is StartMethod.ALL_HEADINGS:
        assert isinstance(heading, HeadingOpen)
        return smooth_all_headings(flights, heading, model)
    return smooth_flight(flights, found, model)


def _from_all_headings(flights: Flights, fitted: Fitted) -> tuple[Fitted, Reason]:
    """The model that fits, flown from all headings, and why none is known."""
    heading, model = flights.begin.heading, fitted.model
    assert isinstance(heading, HeadingOpen)
    late = flights.fixes.earlier(model.antenna.velocity_delay_s)
    starts = heading.starts(flights.begin.sky.with_antenna(late, model.antenna.lever_arm_m))
    histories = flights.from_headings(starts, model)
    return replace(fitted, history=mixed(histories, causal_weights(histories))), heading.why


def _refused(reason: Reason, role: str) -> AidedResult:
    """The result where nothing can be flown."""
    return AidedResult(verdict=AidedVerdict.REFUSED, reasons=(reason,), role=role)


def nis_of(history: AidedHistory, kind: int) -> tuple[float, int]:
    """Mean NIS per degree of freedom of the used fixes of a kind, and the degrees of freedom."""
    nis = history.nis[used_rows(history, kind), kind]
    return (float(nis.sum() / (3 * nis.size)), 3 * nis.size) if nis.size else (float("nan"), 0)


def used_rows(history: AidedHistory, kind: int) -> NDArray:
    return np.flatnonzero(history.used[:, kind] == USED)


def rejected_rows(history: AidedHistory, kind: int) -> NDArray:
    return np.flatnonzero(history.used[:, kind] == REJECTED)


def reset_times(history: AidedHistory) -> NDArray:
    """When the solution was begun anew at a fix."""
    return history.fix_time_s[history.used[:, 0] == RESET]


def leap_times(history: AidedHistory) -> NDArray:
    """When the positions had leapt while the velocities went on to fit."""
    return history.fix_time_s[history.used[:, 0] == JUMPED]


def judged(history: AidedHistory) -> tuple[Reason, ...]:
    """What speaks against a solution; empty where nothing does."""
    found = []
    for k, kind in enumerate(KINDS):
        mean, dof = nis_of(history, k)
        if dof and mean > MATERIAL and (reason := nis_verdict(mean, dof)):
            found.append(because(AidedReason.NIS_HIGH, kind=kind, excess=reason))
        rejected = rejected_rows(history, k).size
        seen = rejected + dof // 3
        if rejected > MOST_REJECTED * seen:
            found.append(
                because(
                    AidedReason.MANY_REJECTED,
                    kind=kind,
                    rejected=rejected,
                    seen=seen,
                    most=MOST_REJECTED,
                )
            )
    return tuple(found)


def find_outages(history: AidedHistory) -> tuple[Outage, ...]:
    """Stretches of OUTAGE_S and more between used positions, from the start on, and after the last
    one.
    """
    used = np.flatnonzero((history.used[:, 0] != UNSEEN) & (history.used[:, 0] != REJECTED))
    times = np.concatenate([history.time_s[:1], history.fix_time_s[used], history.time_s[-1:]])
    found = []
    for k in np.flatnonzero(np.diff(times) > OUTAGE_S):
        row = max(int(np.searchsorted(history.time_s, times[k + 1] - 1e-6)) - 1, 0)
        after = history.residual[used[k], :2] if k < used.size else np.full(2, np.nan)
        found.append(
            Outage(
                start_s=float(times[k]),
                end_s=float(times[k + 1]),
                sigma_m=float(np.sqrt(history.variance[row, :2].sum())),
                off_m=float(np.linalg.norm(after)),
            )
        )
    return tuple(found)
