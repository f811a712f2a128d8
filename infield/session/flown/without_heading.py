"""Flights and drives of a unit that finds no heading at rest (MEMS): its bins under way, joined to
its parked ones or left out.

The parked stretches are estimated first (`infield.session.parked`). The whole log is navigated with
the receiver (`infield.aided`); between the rests a filter about that solution estimates the bins
(`infield.session.flown.ways`), with the table's and the session's joint prior over all bins, and
with what the rests said. The rests' own seconds are not used again. A log without a rest is one
way: what its gyros may read under way beyond what they read at rest stays in its sigmas.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from alignment.reasons import AlignmentReason, AlignmentVerdict
from alignment.result import Alignment
from infield.aided.flight import AidedResult, navigate_aided, warmed_accel_walk
from infield.aided.reasons import AidedVerdict
from infield.session.bins import SessionBins, bins_between, equal_edges
from infield.session.estimate import BegunInMotion, ParkedEvidence, SessionEarth, SessionEstimate
from infield.session.flown.flight import Flight, RunInputs
from infield.session.flown.gates import (
    FlightEvidence,
    against,
    carried,
    information_gain,
    suspected_shift,
    uncovered,
)
from infield.session.flown.priors import Further, Layout, laid_out
from infield.session.flown.ways import COMES_AND_GOES, Believed, Way, estimated_ways
from infield.session.log import compensated_imu
from infield.session.parked.stretches import MIN_PARKED_S, StationarySegments
from infield.session.points import measurement_information
from infield.session.reasons import FlightReason
from ins.estimation import error_model as em
from ins.estimation.measurements.antenna import Antenna, RowSums
from ins.filters.aided_records import AidedHistory, AidedNoise
from ins.filters.reference import About, Rows, reference
from ins.records import ImuSource, Span
from ins.units import DEG, DEG_PER_HOUR, MICRO_G, MILLIRADIAN, PPM
from ins.verdicts import because

# a bin under way: a minute at least, as of a rest; what a bin of five minutes shows is 2 deg/h of
# a default MEMS unit
SHORTEST_AWAY_BIN_S, BINS_AWAY = 60.0, 10.0
# 1 sigma of the solution's heading and tilt where a stretch begins: within them the errors are
# linear to 5 % of themselves
LINEAR_HEADING_RAD, LINEAR_TILT_RAD = 3.0 * DEG, 1.0 * DEG
# between rows of a solution, which are 1 s apart; chosen: a row may be late by half of that
ROW_GAP_S = 1.5
# states of a flight that a unit without a heading carries; the others are below its noise
CARRIED = (
    Further.ANTENNA,
    Further.DELAY,
    Further.ACCEL_SCALE,
    Further.ACCEL_SLOPE,
    Further.GYRO_SCALE,
    Further.MISALIGNMENT,
    Further.SHIFT,
    Further.FORCE,
)
COMPONENTS_OF_SCALE = 3  # of all gyros; that of z is no base state here


def fly_without_heading(
    known: RunInputs, ground: SessionEstimate | StationarySegments
) -> FlightEvidence | None:
    """What lies between the rests of such a unit, before the first and after the last; None where
    nothing moves with a receiver. ground: of a log that never stands for a minute, its rests that
    are too short: it is one way.
    """
    rests: tuple[Where, ...] = ()
    if isinstance(ground, SessionEstimate):
        assert ground.parked is not None
        rests = tuple(
            (float(s.seconds.start_s[0]), float(s.seconds.end_s[-1]))
            for s in ground.parked.stretches
        )
    run, twin = known.run, known.twin
    if run.gnss is None or not known.settings.use_gnss:
        return None
    away = _between(rests, run.imu.start_s, run.imu.end_s)
    heard = run.gnss.time_s
    covered = [np.unique(np.floor(heard[(heard > a) & (heard <= b)])).size for a, b in away]
    if sum(covered) < MIN_PARKED_S:
        return None
    flight = Flight(
        start_s=away[0][0],
        end_s=away[-1][1],
        stands=tuple(rest for rest in rests if rest[0] > away[0][0]),
        covered=min(sum(covered) / sum(b - a for a, b in away), 1.0),
    )
    left_out = FlightEvidence(flight, 0, float("nan"))
    if few := uncovered(flight):
        return replace(left_out, reasons=few)
    imu = compensated_imu(run, known.table, known.temperature, twin)
    sigma = known.gyro_sigma_deg_h
    result = navigate_aided(run, imu, twin, rest=None, gyro_sigma_deg_h=sigma)
    if result.history is None or result.verdict is not AidedVerdict.AIDED:
        return replace(
            left_out, reasons=(because(FlightReason.NOT_NAVIGATED, why=result.reasons[0]),)
        )
    stretches = _linear(result.history, away)
    if not stretches:
        return replace(
            left_out,
            reasons=(because(FlightReason.NEVER_LINEAR, limit_deg=LINEAR_HEADING_RAD / DEG),),
        )

    def estimated(known: RunInputs) -> FlightEvidence:
        return _estimated(known, ground, imu, result, stretches, left_out)

    usual = estimated(known)
    if isinstance(ground, StationarySegments):
        return usual
    return _widened(known, ground, usual, estimated)


def _widened(
    known: RunInputs,
    ground: SessionEstimate,
    usual: FlightEvidence,
    estimated: Callable[[RunInputs], FlightEvidence],
) -> FlightEvidence:
    """The flight once more with a wider prior where its gyros hardly read as at rest."""
    doubt = None if usual.joined is None else suspected_shift(usual.carried)
    if usual.joined is None or doubt is None:
        return usual
    wider = replace(
        estimated(known.with_shift(doubt.size_deg_h)), notes=doubt.notes, as_usual=usual.joined
    )
    if wider.joined is None:
        return wider
    joined = usual.joined.averaged(wider.joined, doubt.belief)
    worth = information_gain(known.table, ground, joined, wider.flight)
    return replace(wider, joined=joined, worth=worth)


def _between(rests: tuple[Where, ...], start_s: float, end_s: float) -> list[Where]:
    """What lies before, between and after the rests."""
    edges = [(start_s, start_s), *rests, (end_s, end_s)]
    return [(a[1], b[0]) for a, b in pairwise(edges) if b[0] - a[1] >= MIN_PARKED_S]


def _linear(history: AidedHistory, away: list[Where]) -> list[slice]:
    """Rows of the solution under way, from where its errors are small on; MIN_PARKED_S and more."""
    tilt = np.sqrt(np.maximum(history.phi_covariance[:, 0, 0], history.phi_covariance[:, 1, 1]))
    heading = np.sqrt(history.phi_covariance[:, 2, 2])
    usable = (tilt < LINEAR_TILT_RAD) & (heading < LINEAR_HEADING_RAD)
    t, found = history.time_s, []
    gaps = t[1:][np.diff(t) > ROW_GAP_S]
    for start, end in away:
        edges = [start, *gaps[(gaps > start) & (gaps < end)], end]
        for a, b in pairwise(edges):
            rows = np.flatnonzero(usable & (t >= a) & (t < b))
            last = int(np.searchsorted(t, b))
            if rows.size and t[last - 1] - t[rows[0]] >= MIN_PARKED_S:
                found.append(slice(int(rows[0]), last))
    return found


def _estimated(
    known: RunInputs,
    ground: SessionEstimate | StationarySegments,
    imu: ImuSource,
    result: AidedResult,
    stretches: list[slice],
    left_out: FlightEvidence,
) -> FlightEvidence:
    """The bins of rests and ways together, judged."""
    history, given = result.history, result.given
    assert history is not None and given is not None
    spans = [(float(history.time_s[s][0]), float(history.time_s[s][-1])) for s in stretches]
    alone = None if isinstance(ground, StationarySegments) else ground
    bins, is_away = _all_bins(known, None if alone is None else alone.bins, spans)
    if isinstance(ground, StationarySegments):
        ground = never_at_rest(bins, _begun(result), ground.left_out)
    after = _after_rests(ground, bins, ~is_away)
    believed = _believed(known, result, bins, after, is_away)
    flt = estimated_ways(_way(known, imu, result, stretches, bins.end_s[is_away]), believed)
    reasons = against(flt, believed.layout, rested=alone is not None)
    states = carried(flt, believed.layout)
    joined = None if reasons else _joined(ground, bins, is_away, after, flt.bias)
    worth = (
        None if joined is None else information_gain(known.table, alone, joined, left_out.flight)
    )
    return replace(left_out, reasons=reasons, joined=joined, carried=states, worth=worth)


def _way(
    known: RunInputs,
    imu: ImuSource,
    result: AidedResult,
    stretches: list[slice],
    bin_ends_s: NDArray,
) -> Way:
    """The stretches as one way. bin_ends_s (N,): of the bins under way."""
    assert result.history is not None and result.given is not None
    fixes, temperature = result.given.fixes, known.temperature
    rows = Rows.of(result.history)
    along = reference(imu, rows, fixes.time_s, stretches, result.given.noise.vrw)
    middle_s = along.end_s - 0.5 * along.dt_s
    degC = temperature.temperature_degC.mean(axis=1)
    standing = np.zeros(along.end_s.size, dtype=bool)
    for start_s, end_s in result.stands:
        standing |= (along.end_s > start_s) & (along.end_s <= end_s)
    return Way(
        about=About(rows, along, RowSums(imu), imu, np.zeros(6)),
        fixes=fixes,
        bins=np.minimum(np.searchsorted(bin_ends_s, middle_s), bin_ends_s.size - 1),
        flies=~standing,
        warmer_degC=np.interp(along.end_s, temperature.time_s, degC - degC[0]),
        stands=np.flatnonzero(standing & along.closes & (along.dt_s > 0.0)),
    )


def _begun(result: AidedResult) -> BegunInMotion:
    """How a session began that never stood."""
    found = result.found
    assert found is not None
    return BegunInMotion(
        time_s=found.start.state.time_s,
        method=found.method.value,
        sigma_heading_mrad=found.sigma_heading_rad / MILLIRADIAN,
        parked_s=0.0,
    )


def _all_bins(
    known: RunInputs, parked: SessionBins | None, spans: list[Where]
) -> tuple[SessionBins, NDArray]:
    """Bins of rests and ways in order of time, and which of them are under way (N,). parked."""
    of_rests = () if parked is None else (parked.start_s, parked.end_s)
    under_way_s = sum(b - a for a, b in spans)
    bin_s = float(np.clip(under_way_s / BINS_AWAY, SHORTEST_AWAY_BIN_S, known.settings.bin_s))
    away = [equal_edges(a, b, bin_s) for a, b in spans]
    every = np.unique(np.concatenate([*of_rests, *away]))
    bins = bins_between(known.table, known.temperature, known.twin, known.settings, every)
    rest = np.zeros(bins.start_s.size, dtype=bool)
    if parked is not None:
        rest = np.isin(bins.start_s, parked.start_s) & np.isin(bins.end_s, parked.end_s)
    under_way = np.zeros(bins.start_s.size, dtype=bool)
    for a, b in spans:
        under_way |= (bins.start_s >= a) & (bins.end_s <= b)
    kept = rest | under_way
    return bins.only(kept), under_way[kept] & ~rest[kept]


@dataclass(frozen=True)
class _Biases:
    """Of bins beyond the table [deg/h]: mean (3N,), covariance (3N, 3N)."""

    mean: NDArray
    covariance: NDArray

    def seen(self, of: NDArray, mean: NDArray, covariance: NDArray) -> "_Biases":
        """All of them, once some are known to be these. of: their places."""
        gain = np.linalg.solve(self.covariance[np.ix_(of, of)], self.covariance[of]).T
        less = self.covariance[np.ix_(of, of)] - covariance
        P = self.covariance - gain @ less @ gain.T
        return _Biases(self.mean + gain @ (mean - self.mean[of]), 0.5 * (P + P.T))


def _believed(
    known: RunInputs, result: AidedResult, bins: SessionBins, after: _Biases, is_away: NDArray
) -> Believed:
    """Noise, antenna and priors; of the bins under way, after what the rests said."""
    twin, priors = known.twin, known.settings.flight
    technology = known.run.header.gyro_technology
    accepted_ppm = known.run.header.accepted_accel_scale / PPM
    scale_ppm = {technology: max(priors.accel_scale_ppm[technology], accepted_ppm)}
    assert result.antenna is not None and result.given is not None
    of = np.flatnonzero(np.repeat(is_away, 3))
    every = laid_out(
        replace(priors, accel_scale_ppm=priors.accel_scale_ppm | scale_ppm),
        technology,
        first=em.BASE + of.size + COMES_AND_GOES,
        scale_ppm=known.settings.sigma_scale_factor_ppm[technology],
        accel_z_ug=twin.accel.turn_on_ug,
    )
    found, declared = result.antenna.antenna, np.asarray(known.run.header.gnss_lever_arm_m)
    arm_m = found.lever_arm_m
    antenna = Antenna(arm_m, found.delay_s, found.velocity_delay_s, found_m=arm_m - declared)
    return Believed(
        noise=_noise(known, result.given.noise),
        antenna=antenna,
        layout=_layout(every, antenna),
        bias_mean=after.mean[of] * DEG_PER_HOUR,
        bias_covariance=after.covariance[np.ix_(of, of)] * DEG_PER_HOUR**2,
        accel_m_s2=2.0 * twin.accel.turn_on_ug * MICRO_G,
        flicker_rad_s=twin.gyro.bias_instability_deg_h * DEG_PER_HOUR,
        bin_s=float(bins.duration_s[is_away].mean()),
    )


def _layout(every: Layout, antenna: Antenna) -> Layout:
    """The states that are carried; the antenna's are no nearer than the solution found it."""
    found = {
        Further.ANTENNA: antenna.found_m,
        Further.DELAY: np.array([antenna.delay_s, antenna.velocity_delay_s]),
    }
    at: dict[Further, slice] = {}
    sigma: list[float] = []
    for state in CARRIED:
        where = every.at.get(state)
        if where is None:
            continue
        own = every.sigma[where.start - every.first : where.stop - every.first]
        if state is Further.GYRO_SCALE:
            own = np.full(COMPONENTS_OF_SCALE, own[0])
        own = np.maximum(own, np.abs(found.get(state, 0.0)))
        begin = every.first + len(sigma)
        at[state] = slice(begin, begin + own.size)
        sigma += own.tolist()
    return Layout(every.first, np.array(sigma), at)


def _noise(known: RunInputs, flown: AidedNoise) -> AidedNoise:
    """The noise that the log was flown with, less what is a state here."""
    gnss, priors = known.twin.gnss, known.settings.flight
    unheld = flown.accel_walk**2 - warmed_accel_walk(known.run) ** 2
    noise = replace(flown, accel_walk=float(np.sqrt(max(unheld, 0.0))))
    if noise.slow_level_m == 0.0:
        noise = replace(
            noise,
            slow_level_m=priors.slow_position_m,
            slow_down_m=priors.slow_position_m * gnss.sigma_vertical_m / gnss.sigma_horizontal_m,
            slow_s=priors.slow_position_s,
        )
    if noise.slow_velocity_m_s == 0.0:
        noise = replace(
            noise,
            slow_velocity_m_s=priors.slow_velocity_m_s,
            slow_velocity_s=priors.slow_velocity_s,
        )
    return noise


def _after_rests(ground: SessionEstimate, bins: SessionBins, parked: NDArray) -> _Biases:
    """All bins, given the rests."""
    if not parked.any():
        return _Biases(np.zeros(3 * parked.size), bins.prior)
    information, vector = measurement_information(ground.bins, ground)
    of = np.flatnonzero(np.repeat(parked, 3))
    C = bins.prior
    gain = np.linalg.solve(np.eye(of.size) + information @ C[np.ix_(of, of)], information)
    P = C - C[:, of] @ gain @ C[of]
    return _Biases(P[:, of] @ vector, 0.5 * (P + P.T))


def _joined(
    ground: SessionEstimate,
    bins: SessionBins,
    is_away: NDArray,
    after: _Biases,
    found: tuple[NDArray, NDArray],
) -> SessionEstimate:
    """The session with its ways. found: mean and covariance of their bins' biases [rad/s]."""
    parked, of = ground.parked, np.flatnonzero(np.repeat(is_away, 3))
    assert parked is not None
    mean, covariance = found
    every = after.seen(of, mean / DEG_PER_HOUR, covariance / DEG_PER_HOUR**2)
    return replace(
        ground,
        bins=bins,
        mean_deg_h=every.mean,
        covariance=every.covariance,
        parked=_placed(parked, bins, is_away),
    )


def _placed(parked: ParkedEvidence, bins: SessionBins, is_away: NDArray) -> ParkedEvidence:
    """The rests' evidence at their places among all bins; -1 is no stretch."""
    stretch = np.full(is_away.size, -1)
    rate, used_s = np.full((is_away.size, 3), np.nan), np.zeros(is_away.size)
    stretch[~is_away], rate[~is_away] = parked.stretch, parked.rate_deg_h
    used_s[~is_away] = parked.used_s
    start_s, end_s = bins.start_s[is_away], bins.end_s[is_away]
    middles = [0.5 * (span.start_s + span.end_s) for span in parked.left_out]
    held = [bool(((start_s <= m) & (m <= end_s)).any()) for m in middles]
    left_out = tuple(span for span, used in zip(parked.left_out, held) if not used)
    return replace(parked, stretch=stretch, rate_deg_h=rate, used_s=used_s, left_out=left_out)


def never_at_rest(
    bins: SessionBins, begun: BegunInMotion, left_out: tuple[Span, ...]
) -> SessionEstimate:
    """The session before anything was measured. bins: of its ways; left_out: short rests."""
    count = bins.start_s.size
    none = SessionEarth(
        known=np.zeros((0, 3)),
        covariance=np.zeros((0, 0)),
        of_heading=np.zeros((0, 0)),
        heading_deg_h=np.zeros(0),
        down_b=np.zeros((0, 3)),
    )
    parked = ParkedEvidence(
        stretches=(),
        stretch=np.zeros(0, dtype=np.int64),
        rate_deg_h=np.zeros((0, 3)),
        used_s=np.zeros(0),
        earth=none,
        turns=(),
        left_out=left_out,
        shape_dof=0,
        shape_nis=0.0,
        shape_nis_compensated=0.0,
    )
    return SessionEstimate(
        bins=bins,
        mean_deg_h=np.zeros(3 * count),
        covariance=bins.prior,
        alignment=Alignment(AlignmentVerdict.REFUSED, (because(AlignmentReason.BEGINS_IN_MOTION),)),
        solution=None,
        parked=parked,
        begun=begun,
    )
