"""The `aided` part of replay.json, and the columns of navigation_aided.parquet, from an
`infield.aided.flight.AidedResult`.

Decision: docs/decisions/0037-receiver-errors-and-noise.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from infield.aided.antenna import SeenAntenna, antenna_sigmas
from infield.aided.flight import AidedResult, Outage, leap_times, nis_of, rejected_rows, reset_times
from infield.aided.grade import Weak
from infield.aided.left_out import OutageScore
from infield.aided.reasons import AidedGrade, AidedVerdict, StartMethod
from infield.aided.start import FoundStart
from infield.aided.taken import TypeShare, shares_by_type
from infield.reports.documents.alignment import FilterNis
from ins.attitude import euler_from_dcm, wrap_pi
from ins.documents import OMIT_NONE
from ins.earth import displacement_ned
from ins.filters.aided_filter import KINDS, level_sigmas
from ins.filters.aided_records import AidedHistory, Antenna, Fixes
from ins.filters.states import AIDED_ACCEL as ACCEL
from ins.filters.states import AIDED_GYRO as GYRO
from ins.filters.states import AIDED_POS as POS
from ins.filters.states import AIDED_VEL as VEL
from ins.kalman import nis_band
from ins.records import ReferenceLog
from ins.units import DEG, DEG_PER_HOUR, MICRO_G
from ins.verdicts import codes, sentences

MOST = 500  # rejects that are listed
ANGLES = ("roll", "pitch", "heading")


@dataclass(frozen=True, kw_only=True)
class TimeSpanDocument:
    """A stretch of the log."""

    start_s: float
    end_s: float


@dataclass(frozen=True, kw_only=True)
class StartDocument:
    """Where and how the solution begins."""

    time_s: float
    method: StartMethod
    span: TimeSpanDocument
    heading_deg: float
    sigma_heading_deg: float


@dataclass(frozen=True, kw_only=True)
class FixesDocument:
    """How many fixes were seen, used and rejected."""

    count: int
    used_position: int
    used_velocity: int
    rejected_position: int
    rejected_velocity: int
    by_type: Sequence[TypeShare]


@dataclass(frozen=True, kw_only=True)
class RejectedDocument:
    """A fix that the gate left out, its residual over its sigma."""

    time_s: float
    kind: str
    nis: float
    north_sigmas: float
    east_sigmas: float
    down_sigmas: float


@dataclass(frozen=True, kw_only=True)
class BandedNis(FilterNis):
    """Mean NIS per degree of freedom; the standing vehicle has no band."""

    band_95: Sequence[float] | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class AidedConsistencyDocument:
    """NIS by kind; is_test: false where the model was fitted to this log."""

    overall: BandedNis
    position: BandedNis
    velocity: BandedNis
    standing: BandedNis
    is_test: bool


@dataclass(frozen=True, kw_only=True)
class AidedNoiseDocument:
    """Factors on the declared sigmas; a time constant is None without its slow error."""

    fitted: bool
    white_factor: float
    walk_factor: float
    accel_white_factor: float
    accel_walk_factor: float
    shaken_factor: float
    vibration_factor: float
    position_factor: float
    velocity_factor: float
    slow_factor: float
    slow_s: float | None
    slow_velocity_factor: float
    slow_velocity_s: float | None
    slow_other_factor: float
    at_largest: Sequence[str]
    declared_nis: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class ArmDocument:
    """Lever arm and delays with their sigmas."""

    lever_arm_m: Sequence[float]
    sigma_lever_arm_m: Sequence[float]
    delay_s: float
    sigma_delay_s: float
    velocity_delay_s: float
    sigma_velocity_delay_s: float


@dataclass(frozen=True, kw_only=True)
class AntennaDocument(ArmDocument):
    """The antenna that was flown, and what the fixes show by themselves."""

    taken: Sequence[str]
    gain_nats: float
    seen: ArmDocument | None


@dataclass(frozen=True, kw_only=True)
class ScoresDocument:
    """RMS errors against truth (north, east, down; roll, pitch, heading), and squared errors over
    variances, 1 where the sigmas are honest.
    """

    source: str = "reference"
    rms_position_m: Sequence[float]
    normalised_position: float
    rms_velocity_m_s: Sequence[float]
    normalised_velocity: float
    rms_attitude_deg: Sequence[float]
    normalised_attitude: float


@dataclass(frozen=True, kw_only=True)
class SmoothedDocument:
    """The solution that all fixes make (`recal replay --smooth`), beside the filter's: level and
    heading sigma at the first row, median and largest of the log.
    """

    sigma_level_m: Mapping[str, float]
    sigma_heading_deg: Mapping[str, float]
    filter_sigma_level_m: Mapping[str, float]
    filter_sigma_heading_deg: Mapping[str, float]
    outage_scores: Sequence[OutageScore]
    scoring_only: ScoresDocument | None


@dataclass(frozen=True, kw_only=True)
class WheelsDocument:
    """Measurements of wheels (`recal replay --vehicle`) that were used, and rejected as slips; the
    way that the vehicle goes, in the unit's axes: to the right of body x, and above it.
    """

    used: int
    rejected: int
    mounted_yaw_deg: float
    sigma_mounted_yaw_deg: float
    mounted_pitch_deg: float
    sigma_mounted_pitch_deg: float


@dataclass(frozen=True, kw_only=True)
class AidedDocument:
    """The `aided` part of replay.json where nothing was flown."""

    verdict: AidedVerdict
    reasons: Sequence[str]
    reason_codes: Sequence[str | None]
    notes: Sequence[str]
    note_codes: Sequence[str | None]
    table: str
    standing: Sequence[TimeSpanDocument]


@dataclass(frozen=True, kw_only=True)
class AidedFlightDocument(AidedDocument):
    """The same with a solution."""

    start: StartDocument
    end: Mapping[str, float]
    fixes: FixesDocument
    rejected: Sequence[RejectedDocument]
    outages: Sequence[Outage]
    outage_scores: Sequence[OutageScore]
    resets_s: Sequence[float]
    leaps_s: Sequence[float]
    grade: AidedGrade
    degraded: Sequence[Weak]
    consistency: AidedConsistencyDocument
    noise: AidedNoiseDocument
    antenna: AntennaDocument | None
    scoring_only: ScoresDocument | None
    smoothed: SmoothedDocument | None = field(default=None, metadata=OMIT_NONE)
    wheels: WheelsDocument | None = field(default=None, metadata=OMIT_NONE)


def aided_document(
    result: AidedResult | None, reference: ReferenceLog | None
) -> AidedDocument | None:
    """The document; None without GNSS or where it was not asked for."""
    if result is None:
        return None
    head = AidedDocument(
        verdict=result.verdict,
        reasons=sentences(result.reasons),
        reason_codes=codes(result.reasons),
        notes=sentences(result.notes),
        note_codes=codes(result.notes),
        table=result.role,
        standing=[TimeSpanDocument(start_s=a, end_s=b) for a, b in result.stands],
    )
    history, found = result.history, result.found
    if history is None or found is None:
        return head
    return AidedFlightDocument(
        **vars(head),
        start=_start(found),
        end=_end(result),
        fixes=_fixes(history, result.fixes),
        rejected=_rejected(history)[:MOST],
        outages=result.outages,
        outage_scores=result.outage_scores,
        resets_s=[float(t) for t in reset_times(history)],
        leaps_s=[float(t) for t in leap_times(history)],
        grade=result.grade or AidedGrade.GOOD,
        degraded=result.weak,
        consistency=_consistency(result, history),
        noise=_noise(result),
        antenna=_antenna(result.antenna),
        scoring_only=None if reference is None else _scores(result, reference),
        smoothed=_smoothed(result, reference),
        wheels=_wheels(result, history),
    )


def _wheels(result: AidedResult, history: AidedHistory) -> WheelsDocument | None:
    """None where no wheels were taken."""
    if result.mounting is None:
        return None
    yaw, pitch = (sigma / DEG for sigma in result.mounting.sigma_rad)
    return WheelsDocument(
        used=history.rolled[0],
        rejected=history.rolled[1],
        mounted_yaw_deg=result.mounting.yaw_rad / DEG,
        sigma_mounted_yaw_deg=yaw,
        mounted_pitch_deg=result.mounting.pitch_rad / DEG,
        sigma_mounted_pitch_deg=pitch,
    )


def smoothed_result(result: AidedResult) -> AidedResult | None:
    """The result with the smoothed solution in the filter's place; None where none was asked."""
    return None if result.smoothed is None else replace(result, history=result.smoothed)


def _smoothed(result: AidedResult, reference: ReferenceLog | None) -> SmoothedDocument | None:
    best = smoothed_result(result)
    if best is None:
        return None
    ours, filters = aided_columns(best), aided_columns(result)
    return SmoothedDocument(
        sigma_level_m=_spread(_level(ours)),
        sigma_heading_deg=_spread(ours["sigma_heading_deg"]),
        filter_sigma_level_m=_spread(_level(filters)),
        filter_sigma_heading_deg=_spread(filters["sigma_heading_deg"]),
        outage_scores=result.smoothed_scores,
        scoring_only=None if reference is None else _scores(best, reference),
    )


def _level(columns: Mapping[str, NDArray]) -> NDArray:
    return np.hypot(columns["sigma_north_m"], columns["sigma_east_m"])


def _spread(sigma: NDArray) -> dict[str, float]:
    """Of a sigma along the log."""
    middle, largest = float(np.median(sigma)), float(sigma.max())
    return {"first": float(sigma[0]), "median": middle, "largest": largest}


def _start(found: FoundStart) -> StartDocument:
    return StartDocument(
        time_s=found.start.state.time_s,
        method=found.method,
        span=TimeSpanDocument(start_s=found.span[0], end_s=found.span[1]),
        heading_deg=float(euler_from_dcm(found.start.state.C_nb)[2]) / DEG,
        sigma_heading_deg=found.sigma_heading_rad / DEG,
    )


def _fixes(history: AidedHistory, fixes: Fixes | None) -> FixesDocument:
    shares = () if fixes is None else shares_by_type(history, fixes)
    position, velocity = range(len(KINDS))
    return FixesDocument(
        count=int((history.used > 0).any(axis=1).sum()),
        used_position=nis_of(history, position)[1] // 3,
        used_velocity=nis_of(history, velocity)[1] // 3,
        rejected_position=int(rejected_rows(history, position).size),
        rejected_velocity=int(rejected_rows(history, velocity).size),
        by_type=shares,
    )


def _rejected(history: AidedHistory) -> list[RejectedDocument]:
    """All rejected fixes in order of time."""
    found = []
    for k, kind in enumerate(KINDS):
        part = slice(3 * k, 3 * k + 3)
        for row in rejected_rows(history, k):
            over = history.residual[row, part] / history.sigma[row, part]
            found.append(
                RejectedDocument(
                    time_s=float(history.fix_time_s[row]),
                    kind=kind,
                    nis=float(history.nis[row, k]),
                    north_sigmas=float(over[0]),
                    east_sigmas=float(over[1]),
                    down_sigmas=float(over[2]),
                )
            )
    return sorted(found, key=lambda r: r.time_s)


def _consistency(result: AidedResult, history: AidedHistory) -> AidedConsistencyDocument:
    position, velocity = (nis_of(history, k) for k in range(len(KINDS)))
    dof = position[1] + velocity[1]
    total = sum(mean * n for mean, n in (position, velocity) if n)
    taken = result.antenna is not None and any(result.antenna.freed)
    standing = history.stand_nis / history.stand_dof if history.stand_dof else float("nan")
    return AidedConsistencyDocument(
        overall=_nis(total / dof if dof else float("nan"), dof),
        position=_nis(*position),
        velocity=_nis(*velocity),
        standing=BandedNis(nis_mean=standing, dof=history.stand_dof),
        is_test=not (result.scales.fitted or taken),
    )


def _nis(mean: float, dof: int) -> BandedNis:
    return BandedNis(nis_mean=mean, dof=dof, band_95=list(nis_band(dof, 0.95)))


def _noise(result: AidedResult) -> AidedNoiseDocument:
    s = result.scales
    return AidedNoiseDocument(
        fitted=s.fitted,
        white_factor=s.white,
        walk_factor=s.walk,
        accel_white_factor=s.accel_white,
        accel_walk_factor=s.accel_walk,
        shaken_factor=s.stirred,
        vibration_factor=s.shaken,
        position_factor=s.position,
        velocity_factor=s.velocity,
        slow_factor=s.slow,
        slow_s=s.slow_s if s.slow else None,
        slow_velocity_factor=s.slow_velocity,
        slow_velocity_s=s.slow_velocity_s if s.slow_velocity else None,
        slow_other_factor=s.slow_other,
        at_largest=s.capped,
        declared_nis=dict(zip(KINDS, result.declared_nis)),
    )


def _antenna(seen: SeenAntenna | None) -> AntennaDocument | None:
    if seen is None:
        return None
    return AntennaDocument(
        **vars(_arm(seen.antenna)),
        taken=[name for name, freed in zip(("lever_arm", "delay"), seen.freed) if freed],
        gain_nats=seen.gain_nats,
        seen=None if seen.seen is None else _arm(seen.seen),
    )


def _arm(antenna: Antenna) -> ArmDocument:
    sigma = [float(v) for v in antenna_sigmas(antenna)]
    return ArmDocument(
        lever_arm_m=[float(v) for v in antenna.lever_arm_m],
        sigma_lever_arm_m=sigma[:3],
        delay_s=antenna.delay_s,
        sigma_delay_s=sigma[3],
        velocity_delay_s=antenna.velocity_delay_s,
        sigma_velocity_delay_s=sigma[4],
    )


def _end(result: AidedResult) -> dict[str, float]:
    return {name: float(column[-1]) for name, column in aided_columns(result).items()}


def aided_columns(result: AidedResult) -> dict[str, NDArray]:
    """The solution at 1 Hz by column, units in the names, each with its sigma (NED; roll, pitch,
    heading).
    """
    history = result.history
    assert history is not None
    sigma, attitude = (
        np.sqrt(history.variance),
        level_sigmas(history.phi_covariance, history.C_nb) / DEG,
    )
    columns = {
        "time_s": history.time_s,
        "lat_deg": history.lat_rad / DEG,
        "lon_deg": history.lon_rad / DEG,
        "height_m": history.height_m,
        **dict(zip(("vn_m_s", "ve_m_s", "vd_m_s"), history.v_n_m_s.T)),
        **{f"{name}_deg": a / DEG for name, a in zip(ANGLES, euler_from_dcm(history.C_nb))},
        **dict(zip(("sigma_north_m", "sigma_east_m", "sigma_down_m"), sigma[:, POS].T)),
        **dict(zip(("sigma_vn_m_s", "sigma_ve_m_s", "sigma_vd_m_s"), sigma[:, VEL].T)),
        **{f"sigma_{name}_deg": a for name, a in zip(ANGLES, attitude.T)},
    }
    gyro_sigma, accel_sigma = bias_sigmas(result)
    for sensor, bias, spread, unit, factor in (
        ("gyro", history.gyro_bias_rad_s, gyro_sigma, "deg_h", DEG_PER_HOUR),
        ("accel", history.accel_bias_m_s2, accel_sigma, "ug", MICRO_G),
    ):
        for k, axis in enumerate("xyz"):
            columns[f"{sensor}_bias_{axis}_{unit}"] = bias[:, k] / factor
            columns[f"sigma_{sensor}_bias_{axis}_{unit}"] = spread[:, k] / factor
    return columns


def bias_sigmas(result: AidedResult) -> tuple[NDArray, NDArray]:
    """Sigmas (k, 3) of gyro and accelerometer bias: the filter's, and the flicker that its random
    walk is too slow for.
    """
    history = result.history
    assert history is not None
    gyro, accel = result.flicker
    return np.sqrt(history.variance[:, GYRO] + gyro**2), np.sqrt(
        history.variance[:, ACCEL] + accel**2
    )


def _scores(result: AidedResult, reference: ReferenceLog) -> ScoresDocument | None:
    """RMS errors against truth, and squared errors over variances (1 where the sigmas are
    honest).
    """
    history = result.history
    assert history is not None
    inside = (history.time_s >= reference.time_s[0]) & (history.time_s <= reference.time_s[-1])
    if not inside.any():
        return None
    t = history.time_s[inside]

    def true(values: NDArray) -> NDArray:
        return np.interp(t, reference.time_s, values)

    level = displacement_ned(
        history.lat_rad[inside],
        history.lon_rad[inside],
        lat0_rad=true(reference.lat_rad),
        lon0_rad=true(np.unwrap(reference.lon_rad)),
        height0_m=true(reference.height_m),
    )
    position = np.column_stack([level, true(reference.height_m) - history.height_m[inside]])
    velocity = history.v_n_m_s[inside] - np.stack([true(v) for v in reference.v_n_m_s.T], axis=1)
    angles = np.stack(euler_from_dcm(history.C_nb[inside]), axis=1) / DEG
    turn = np.stack(
        [
            true(np.unwrap(a))
            for a in (reference.roll_rad, reference.pitch_rad, reference.heading_rad)
        ],
        axis=1,
    )
    attitude = wrap_pi(angles * DEG - turn) / DEG
    sigma = level_sigmas(history.phi_covariance, history.C_nb)[inside] / DEG
    return ScoresDocument(
        rms_position_m=_rms(position),
        normalised_position=_normalised(position, np.sqrt(history.variance[inside, POS])),
        rms_velocity_m_s=_rms(velocity),
        normalised_velocity=_normalised(velocity, np.sqrt(history.variance[inside, VEL])),
        rms_attitude_deg=_rms(attitude),
        normalised_attitude=_normalised(attitude, sigma),
    )


def _rms(error: NDArray) -> list[float]:
    """Of each column."""
    return [float(x) for x in np.sqrt(np.mean(error**2, axis=0))]


def _normalised(error: NDArray, sigma: NDArray) -> float:
    return float(np.mean((error / sigma) ** 2))
