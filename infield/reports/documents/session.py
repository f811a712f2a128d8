"""What `update.json` and the report say of one run: alignment, measurements, coverage, residuals,
the claim chain.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from alignment.motion.stillness import detect_phases
from infield.reports.documents import parked as parked_document
from infield.reports.documents.alignment import (
    FilterNis,
    LevelDocument,
    SessionAlignment,
    alignment_document,
)
from infield.reports.documents.flight import flight_document
from infield.reports.documents.session_records import (
    ChainDocument,
    ChainRow,
    CoverageDocument,
    EstimatedDocument,
    HeadingError,
    HeatingCooling,
    ResidualDocument,
    SessionDocument,
    SmoothingDocument,
    TaxiDocument,
    TaxiNuisance,
    TemperatureDocument,
    UnitMarksDocument,
    VelocityDocument,
)
from infield.session.estimate import Found, RollingEvidence, SessionEstimate
from infield.session.navigated.claim_chain import ClaimChain
from infield.session.navigated.environment import environment
from infield.session.navigated.taxi_heading import heading_source
from infield.session.points import UNSEEN_SIGMA
from infield.session.reasons import Nuisance
from infield.session.results import SessionResult
from infield.table.merge import SessionPoints
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.attitude import euler_from_dcm
from ins.documents import made
from ins.records import AXES, Phase
from ins.units import DEG, DEG_PER_HOUR, MILLIRADIAN
from ins.verdicts import because, codes, sentence, sentences

# a slower change of temperature is neither heating nor cooling; chosen: it passes 0.25 degC in
# the 5 min of a bin, a coarse thermometer's step
HEATING_DEG_C_MIN = 0.05
BAND_DEG_C = 5.0  # width of the bands of temperature that the coverage counts
# of the values of each nuisance: name, size in SI
NUISANCE_UNITS = {
    Nuisance.CRAB: ("mrad", MILLIRADIAN),
    Nuisance.WHEEL_ARM_X: ("m", 1.0),
    Nuisance.WHEEL_SCALE: ("%", 0.01),
    Nuisance.CROSS_WIND: ("mrad", MILLIRADIAN),
    Nuisance.TURNING_CRAB: ("mrad", MILLIRADIAN),
    Nuisance.GUSTS: ("mrad", MILLIRADIAN),
    Nuisance.SIDE_SLIP: ("mrad per m/s2", MILLIRADIAN),
    Nuisance.WHEEL_ARM_Y: ("m", 1.0),
    Nuisance.ODOMETER_DELAY: ("s", 1.0),
    Nuisance.ANTENNA: ("m", 1.0),
    Nuisance.GNSS_DELAY: ("s", 1.0),
    Nuisance.GNSS_SLOW_POSITION: ("m", 1.0),
    Nuisance.GNSS_SLOW_VELOCITY: ("m/s", 1.0),
}
ALIGNMENT_PHASES = ("alignment", "extended_alignment")  # of a log that begins at rest
MOST_VELOCITIES = 800  # points of a drawing


def session_document(session: SessionResult) -> SessionDocument:
    """Everything a report shows of one run."""
    run, T = session.run, session.temperature
    logged = {"temperature": run.temperature, "gnss": run.gnss, "odometer": run.odometer}
    facts = made(
        SessionDocument,
        run,
        outcome=session.verdict.outcome,
        reasons=sentences(session.verdict.reasons),
        reason_codes=codes(session.verdict.reasons),
        streams=[name for name, stream in logged.items() if stream is not None],
        temperature=None if T is None else made(TemperatureDocument, T),
    )
    if session.estimate is None or session.points is None or T is None:
        return facts
    return _estimated(facts, session, session.estimate, session.points, T)


def _estimated(
    facts: SessionDocument,
    session: SessionResult,
    e: SessionEstimate,
    points: SessionPoints,
    temperature: GyroTemperature,
) -> EstimatedDocument:
    """The facts of a run with its estimate."""
    parked = e.parked is not None
    rested = not parked and e.begun is None
    after_deg_h = _table_after(session, e, points)
    phases = logged_phases(session, e)
    return EstimatedDocument(
        **vars(facts),
        alignment=SessionAlignment(**vars(alignment_document(e.alignment, session.run))),
        heading_error=heading_error(session),
        observability={a.axis: a for a in session.seen if a.axis},
        phases=phases,
        phases_used=list(dict.fromkeys(filter(None, phases_of(points, phases)))),
        points_covariance_deg_h2=points.covariance.tolist(),
        coverage=_coverage(temperature, e),
        residuals=_residuals(points, e.bins.table_deg_h, after_deg_h),
        heating_cooling=_heating_cooling(points, after_deg_h),
        measurements=parked_document.measurements(e) if parked else _measurements(e),
        parked_jitter_m=e.navigated.displacement_sigma_m if rested else None,
        smoothing={} if parked else _smoothing(e),
        velocity=None if parked else _velocity(e),
        claim_chain=None if parked else _chain(session.chain, e),
        zero_rate=parked_document.zero_rate(e) if parked else None,
        doubted=sentences(s.reason for s in session.doubted) or None,
        motion_level=made(LevelDocument, e.navigated.level) if rested else None,
        environment=environment(e.navigated) if rested else None,
        taxi=_taxi(e.rolling),
        own_errors=None if e.own is None else e.own.errors or None,
        flight=flight_document(session),
        begun_in_motion=e.begun,
        unit_marks=_unit_marks(session),
    )


def _unit_marks(session: SessionResult) -> UnitMarksDocument | None:
    marks, likeness = session.marks, session.likeness
    if marks is None:
        return None
    compared = ("sessions", "chi2", "dof", "limit")
    known = {} if likeness is None else {name: getattr(likeness, name) for name in compared}
    return made(UnitMarksDocument, marks, **known)


def logged_phases(session: SessionResult, e: SessionEstimate) -> tuple[Phase, ...]:
    """The phases of a run as it declares them, else as its motion shows them."""
    return session.run.phases or _detected(e)


def phases_of(points: SessionPoints, phases: Sequence[Phase]) -> list[str | None]:
    """The phase in which each point has its centre; None of one between two phases."""
    return [
        next((p.phase for p in phases if p.start_s <= time_s <= p.end_s), None)
        for time_s in points.time_s
    ]


def _detected(e: SessionEstimate) -> tuple[Phase, ...]:
    """Phases by the motion; what lies between the stretches of a parked unit is nobody's to
    name.
    """
    if e.parked is not None and len(e.parked.stretches) != 1:
        return parked_document.phases(e)
    found = detect_phases(e.motion)
    if e.begun is None:
        return found
    return tuple(phase for phase in found if phase.phase not in ALIGNMENT_PHASES)


def _measurements(e: SessionEstimate) -> Mapping[str, FilterNis]:
    """Each kind of measurement of a navigated session."""
    tally = e.navigated.filter.tally
    return {
        kind: FilterNis(nis_mean=tally.nis[kind] / tally.dof[kind], dof=tally.dof[kind])
        for kind in sorted(tally.nis)
    }


def _taxi(rolling: RollingEvidence | None) -> TaxiDocument | None:
    """What the taxi showed of wind, tyres and installation; None where nothing rolled."""
    if rolling is None or not rolling.always:
        return None
    return made(
        TaxiDocument,
        rolling,
        needed=[_nuisance(found, found.gain_nats) for found in rolling.found],
        always=[_nuisance(found, None) for found in rolling.always],
    )


def _nuisance(found: Found, gain_nats: float | None) -> TaxiNuisance:
    unit, size = NUISANCE_UNITS[found.nuisance]
    return TaxiNuisance(
        nuisance=found.nuisance,
        text=sentence(found.reason),
        value=(found.value / size).tolist(),
        sigma=None if found.sigma is None else (found.sigma / size).tolist(),
        prior_sigma=(found.prior / size).tolist(),
        unit=unit,
        gain_nats=gain_nats,
    )


def _smoothing(e: SessionEstimate) -> Mapping[str, SmoothingDocument]:
    """RMS over the bins of each gyro's sigma when the bin's time was over, and given the whole
    run.
    """
    filtered = e.navigated.filter.filtered[:, 1, :] / DEG_PER_HOUR**2
    smoothed = np.diag(e.covariance).reshape(-1, 3)
    return {
        axis: SmoothingDocument(
            filtered_sigma_deg_h=float(np.sqrt(np.nanmean(filtered[:, k]))),
            smoothed_sigma_deg_h=float(np.sqrt(np.mean(smoothed[:, k]))),
        )
        for k, axis in enumerate(AXES)
    }


def _coverage(T: GyroTemperature, e: SessionEstimate) -> list[CoverageDocument]:
    """Seconds of the session in each band of temperature, per axis."""
    bins = e.bins
    apart = np.flatnonzero(bins.start_s[1:] > bins.end_s[:-1])
    spans = zip(bins.start_s[np.append(0, apart + 1)], bins.end_s[np.append(apart, -1)])
    rows = np.concatenate([np.arange(T.time_s.size)[T.between(a, b)] for a, b in spans])
    step = float(np.median(np.diff(T.time_s)))
    found = []
    for k, axis in enumerate(AXES):
        values = T.temperature_degC[rows, k]
        lowest = BAND_DEG_C * np.floor(values.min() / BAND_DEG_C)
        edges = np.arange(lowest, values.max() + BAND_DEG_C, BAND_DEG_C)
        counts, _ = np.histogram(values, edges)
        for low, high, n in zip(edges[:-1], edges[1:], counts):
            found.append(
                CoverageDocument(
                    axis=axis, low_degC=float(low), high_degC=float(high), seconds=float(n * step)
                )
            )
    return found


def _residuals(
    p: SessionPoints, before_deg_h: NDArray, after_deg_h: NDArray
) -> list[ResidualDocument]:
    """Points less the table before and after the merge, with the point's sigma."""
    return [
        ResidualDocument(
            axis=AXES[axis],
            time_s=float(p.time_s[k]),
            temperature_degC=float(p.temperature_degC[k]),
            before_deg_h=float(p.bias_deg_h[k] - before_deg_h[k]),
            after_deg_h=float(p.bias_deg_h[k] - after_deg_h[k]),
            sigma_deg_h=float(p.sigma_deg_h[k]),
        )
        for k, axis in enumerate(p.axis_index)
    ]


def _table_after(session: SessionResult, e: SessionEstimate, p: SessionPoints) -> NDArray:
    """The merged table at the points; as it was where nothing was merged or a stuck thermometer
    ties no table to them.
    """
    before = e.bins.table_deg_h
    if session.merged is None:
        return before
    return np.where(p.H.any(axis=1), p.H @ session.merged.candidate.parameters, before)


def _heating_cooling(p: SessionPoints, after_deg_h: NDArray) -> list[HeatingCooling]:
    """Mean residual to the merged table over rising and over falling temperature, per axis."""
    residual = p.bias_deg_h - after_deg_h
    found = []
    for k, axis in enumerate(AXES):
        up = (p.axis_index == k) & (p.temperature_rate_degC_min > HEATING_DEG_C_MIN)
        down = (p.axis_index == k) & (p.temperature_rate_degC_min < -HEATING_DEG_C_MIN)
        difference, sigma = None, None
        if up.any() and down.any():
            w = up / up.sum() - down / down.sum()
            difference = float(w @ residual)
            sigma = float(np.sqrt(w @ p.covariance @ w))
        found.append(
            HeatingCooling(
                axis=axis,
                heating_points=int(up.sum()),
                cooling_points=int(down.sum()),
                difference_deg_h=difference,
                sigma_deg_h=sigma,
            )
        )
    return found


def _velocity(e: SessionEstimate) -> VelocityDocument:
    """Computed velocity of the last pass."""
    history = e.navigated.history
    every = max(len(history.time_s) // MOST_VELOCITIES, 1)
    return VelocityDocument(
        time_s=history.time_s[::every].tolist(),
        north_m_s=history.v_n_m_s[::every, 0].tolist(),
        east_m_s=history.v_n_m_s[::every, 1].tolist(),
        heading_deg=(euler_from_dcm(history.C_nb[::every])[2] / DEG).tolist(),
    )


def _chain(chain: ClaimChain | None, e: SessionEstimate) -> ChainDocument | None:
    """The patent's own path beside the filter: points along north and east of the parked
    heading.
    """
    if chain is None:
        return None
    c, s = np.cos(chain.heading_rad), np.sin(chain.heading_rad)
    level = e.mean_deg_h.reshape(-1, 3)[:, :2] @ np.array([[c, s], [-s, c]])  # columns north, east
    centre = e.bins.centre_s
    rows = [
        ChainRow(
            **vars(point),
            filter_north_deg_h=float(np.interp(point.time_s, centre, level[:, 0])),
            filter_east_deg_h=float(np.interp(point.time_s, centre, level[:, 1])),
        )
        for point in chain.points
    ]
    known = not np.isnan(chain.psi_rad)
    north = np.array([row.north_deg_h - row.filter_north_deg_h for row in rows])
    east = np.array([row.east_deg_h - row.filter_east_deg_h for row in rows])
    return ChainDocument(
        points=rows,
        heading_error_mrad=chain.psi_rad / MILLIRADIAN if known else None,
        sigma_heading_error_mrad=chain.sigma_psi_rad / MILLIRADIAN if known else None,
        note=sentence(because(chain.note)),
        sigma_deg_h=_mean([row.sigma_deg_h for row in rows]),
        sigma_filtered_deg_h=_mean([row.sigma_filtered_deg_h for row in rows]),
        bracket_sigma_deg_h=_mean([row.bracket_sigma_deg_h for row in rows]),
        difference_rms_deg_h=_rms(north) if rows else None,
        difference_rms_east_deg_h=_rms(east) if rows and known else None,
    )


def _mean(values: Sequence[float]) -> float | None:
    seen = np.array(values, dtype=float)
    return float(np.nanmean(seen)) if np.isfinite(seen).any() else None


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def heading_error(session: SessionResult | None) -> HeadingError:
    """Computed minus true at the end of the alignment; None where the session did not add to the
    alignment.
    """
    nothing = HeadingError(value_mrad=None, sigma_mrad=None, source=None)
    if session is None or session.estimate is None:
        return nothing
    e = session.estimate
    sigma = e.sigma_heading_rad / MILLIRADIAN
    if not np.isfinite(sigma):
        return nothing
    source = heading_source(e.navigated.filter.tally.heading_gain)
    if source is None or e.sigma_heading_rad > UNSEEN_SIGMA * e.sigma_heading_before_rad:
        return HeadingError(value_mrad=None, sigma_mrad=sigma, source=None)
    value = e.heading_error_rad / MILLIRADIAN
    return HeadingError(value_mrad=value, sigma_mrad=sigma, source=source)
