"""The `aided` part of replay.json, and the columns of navigation_aided.parquet, from an
`infield.aided.flight.AidedResult`.

Decision: docs/decisions/0037-receiver-errors-and-noise.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from infield.aided.antenna import SeenAntenna, antenna_sigmas
from infield.aided.flight import AidedResult, Outage, leap_times, nis_of, rejected_rows, reset_times
from infield.aided.grade import Weak
from infield.aided.left_out import OutageScore
from infield.aided.noise import NoiseScales
from infield.aided.reasons import AidedGrade, AidedVerdict, StartMethod
from infield.aided.start import FoundStart
from infield.aided.taken import TypeShare, shares_by_type
from infield.aided.wheels import Mounting
from infield.reports.documents.alignment import FilterNis
from ins.attitude import euler_from_dcm, wrap_pi
from ins.documents import OMIT_NONE, MadeOf, made
from ins.earth import displacement_ned
from ins.filters.aided_filter import KINDS, level_sigmas
from ins.filters.aided_records import AidedHistory, Antenna
from ins.filters.states import AIDED_ACCEL as ACCEL
from ins.filters.states import AIDED_GYRO as GYRO
from ins.filters.states import AIDED_POS as POS
from ins.filters.states import AIDED_VEL as VEL
from ins.kalman import nis_band
from ins.records import ReferenceLog
from ins.units import DEG, DEG_PER_HOUR, MICRO_G
from ins.verdicts import codes, sentences

MOST = 500  # rejects that are listed
POSITION, VELOCITY = range(len(KINDS))
ANGLES = ("roll", "pitch", "heading")
of = MadeOf[AidedResult]()
of_start = MadeOf[FoundStart]()
of_scales = MadeOf[NoiseScales]()
of_history = MadeOf[AidedHistory]()
of_mounting = MadeOf[Mounting]()
of_arm = MadeOf[Antenna]()


@dataclass(frozen=True, kw_only=True)
class TimeSpanDocument:
    """A stretch of the log."""

    start_s: float
    end_s: float


@dataclass(frozen=True, kw_only=True)
class StartDocument:
    """Where and how the solution begins."""

    time_s: float = of_start(lambda found: found.start.state.time_s)
    method: StartMethod = of_start(lambda found: found.method)
    span: TimeSpanDocument = of_start(lambda found: _spans([found.span])[0])
    heading_deg: float = of_start(lambda f: float(euler_from_dcm(f.start.state.C_nb)[2]) / DEG)
    sigma_heading_deg: float = of_start(lambda found: found.sigma_heading_rad / DEG)


@dataclass(frozen=True, kw_only=True)
class FixesDocument:
    """How many fixes were seen, used and rejected."""

    count: int = of_history(lambda h: int((h.used > 0).any(axis=1).sum()))
    used_position: int = of_history(lambda h: nis_of(h, POSITION)[1] // 3)
    used_velocity: int = of_history(lambda h: nis_of(h, VELOCITY)[1] // 3)
    rejected_position: int = of_history(lambda h: int(rejected_rows(h, POSITION).size))
    rejected_velocity: int = of_history(lambda h: int(rejected_rows(h, VELOCITY).size))
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

    fitted: bool = of_scales(lambda s: s.fitted)
    white_factor: float = of_scales(lambda s: s.white)
    walk_factor: float = of_scales(lambda s: s.walk)
    accel_white_factor: float = of_scales(lambda s: s.accel_white)
    accel_walk_factor: float = of_scales(lambda s: s.accel_walk)
    shaken_factor: float = of_scales(lambda s: s.stirred)
    position_factor: float = of_scales(lambda s: s.position)
    velocity_factor: float = of_scales(lambda s: s.velocity)
    slow_factor: float = of_scales(lambda s: s.slow)
    slow_s: float | None = of_scales(lambda s: s.slow_s if s.slow else None)
    slow_velocity_factor: float = of_scales(lambda s: s.slow_velocity)
    slow_velocity_s: float | None = of_scales(
        lambda s: s.slow_velocity_s if s.slow_velocity else None
    )
    slow_other_factor: float = of_scales(lambda s: s.slow_other)
    at_largest: Sequence[str] = of_scales(lambda s: s.capped)
    declared_nis: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class ArmDocument:
    """Lever arm and delays with their sigmas."""

    lever_arm_m: Sequence[float] = of_arm(lambda arm: arm.lever_arm_m.tolist())
    sigma_lever_arm_m: Sequence[float] = of_arm(lambda arm: antenna_sigmas(arm)[:3].tolist())
    delay_s: float = of_arm(lambda arm: arm.delay_s)
    sigma_delay_s: float = of_arm(lambda arm: float(antenna_sigmas(arm)[3]))
    velocity_delay_s: float = of_arm(lambda arm: arm.velocity_delay_s)
    sigma_velocity_delay_s: float = of_arm(lambda arm: float(antenna_sigmas(arm)[4]))


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
    mounted_yaw_deg: float = of_mounting(lambda mounting: mounting.yaw_rad / DEG)
    sigma_mounted_yaw_deg: float = of_mounting(lambda mounting: mounting.sigma_rad[0] / DEG)
    mounted_pitch_deg: float = of_mounting(lambda mounting: mounting.pitch_rad / DEG)
    sigma_mounted_pitch_deg: float = of_mounting(lambda mounting: mounting.sigma_rad[1] / DEG)


@dataclass(frozen=True, kw_only=True)
class AidedDocument:
    """The `aided` part of replay.json where nothing was flown."""

    verdict: AidedVerdict = of(lambda result: result.verdict)
    reasons: Sequence[str] = of(lambda result: sentences(result.reasons))
    reason_codes: Sequence[str | None] = of(lambda result: codes(result.reasons))
    notes: Sequence[str] = of(lambda result: sentences(result.notes))
    note_codes: Sequence[str | None] = of(lambda result: codes(result.notes))
    table: str = of(lambda result: result.role)
    standing: Sequence[TimeSpanDocument] = of(lambda result: _spans(result.stands))


@dataclass(frozen=True, kw_only=True)
class AidedFlightDocument(AidedDocument):
    """The same with a solution."""

    start: StartDocument
    end: Mapping[str, float] = of(lambda result: _end(result))
    fixes: FixesDocument
    rejected: Sequence[RejectedDocument]
    outages: Sequence[Outage] = of(lambda result: result.outages)
    outage_scores: Sequence[OutageScore] = of(lambda result: result.outage_scores)
    resets_s: Sequence[float]
    leaps_s: Sequence[float]
    grade: AidedGrade = of(lambda result: result.grade or AidedGrade.GOOD)
    degraded: Sequence[Weak] = of(lambda result: result.weak)
    consistency: AidedConsistencyDocument
    noise: AidedNoiseDocument = of(lambda result: _noise(result))
    antenna: AntennaDocument | None = of(lambda result: _antenna(result.antenna))
    scoring_only: ScoresDocument | None
    smoothed: SmoothedDocument | None = field(metadata=OMIT_NONE)
    wheels: WheelsDocument | None = field(metadata=OMIT_NONE)


def aided_document(
    result: AidedResult | None, reference: ReferenceLog | None
) -> AidedDocument | None:
    """The document; None without GNSS or where it was not asked for."""
    if result is None:
        return None
    history, found, fixes = result.history, result.found, result.fixes
    if history is None or found is None:
        return made(AidedDocument, result)
    return made(
        AidedFlightDocument,
        result,
        start=made(StartDocument, found),
        fixes=made(
            FixesDocument, history, by_type=() if fixes is None else shares_by_type(history, fixes)
        ),
        rejected=_rejected(history)[:MOST],
        resets_s=reset_times(history).tolist(),
        leaps_s=leap_times(history).tolist(),
        consistency=_consistency(result, history),
        scoring_only=None if reference is None else _scores(result, reference),
        smoothed=_smoothed(result, reference),
        wheels=_wheels(result, history),
    )


def _spans(stretches: Sequence[Where]) -> list[TimeSpanDocument]:
    return [TimeSpanDocument(start_s=start_s, end_s=end_s) for start_s, end_s in stretches]


def _wheels(result: AidedResult, history: AidedHistory) -> WheelsDocument | None:
    """None where no wheels were taken."""
    if result.mounting is None:
        return None
    used, rejected = history.rolled
    return made(WheelsDocument, result.mounting, used=used, rejected=rejected)


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
    declared_nis = dict(zip(KINDS, result.declared_nis))
    return made(AidedNoiseDocument, result.scales, declared_nis=declared_nis)


def _antenna(seen: SeenAntenna | None) -> AntennaDocument | None:
    if seen is None:
        return None
    return made(
        AntennaDocument,
        seen.antenna,
        taken=[name for name, freed in zip(("lever_arm", "delay"), seen.freed) if freed],
        gain_nats=seen.gain_nats,
        seen=None if seen.seen is None else made(ArmDocument, seen.seen),
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
