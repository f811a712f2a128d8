"""One power-on session against the stored table: from a run to the posterior of its gyro biases.

The gyro output, less the table at the logged temperature, goes through navigation, and the
navigation-mode filter carries what is left of each gyro's bias as a constant over five-minute bins
(`infield.session.bins`).
"""

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from alignment import gyrocompass
from alignment.inertial_start import start_attitude
from alignment.level_fit import LevelFound
from alignment.linearised import Course, NothingStands, RestedLog, latitude_covariance, solve
from alignment.motion.imu_faults import repair
from alignment.motion.seconds import seconds_of
from alignment.navigation_filter import Aid
from alignment.result import Alignment, BiasPrior, Solution
from infield.session.bins import make_bins
from infield.session.estimate import SessionEstimate
from infield.session.log import alignment_end, compensated_imu
from infield.session.navigated.noise_shares import noise_shares
from infield.session.navigated.nuisances import (
    AS_DECLARED,
    Assumed,
    Bench,
    priors_under,
    rolling_model,
)
from infield.session.navigated.own_errors import LoggedRun, own_errors
from infield.session.navigated.receiver import WHITE, ReceiverErrors, receiver_errors
from infield.session.navigated.taxi_heading import (
    OF_FIXES,
    CentreLineAid,
    GnssAid,
    LateralAid,
    OdometerAid,
    SurveyedHeadingAid,
)
from infield.session.settings import SessionSettings
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.attitude import euler_from_dcm, wrap_pi
from ins.estimation import error_model as em
from ins.estimation.measurements.antenna import RowSums
from ins.records import InputError, Run, TwinModel
from ins.strapdown.mechanization import VerticalChannel
from ins.units import DEG_PER_HOUR, MILLIRADIAN, PPM
from ins.verdicts import Reason


class AlignmentRefused(InputError):
    """Nothing stands once navigated about a wrong latitude: the `reasons` that name it."""

    def __init__(self, reasons: tuple[Reason, ...]) -> None:
        super().__init__(str(reasons[0].code))
        self.reasons = reasons


def estimate_session(
    run: Run,
    table: ThermalTable,
    temperature: GyroTemperature,
    twin: TwinModel,
    settings: SessionSettings,
    *,
    rest: tuple[float, float],
    end_s: float,
) -> SessionEstimate:
    """Alignment on the alignment phase, then one filter over align, park and taxi with all aids the
    run has.
    """
    logged = LoggedRun(run, table, temperature)
    return estimate_under(logged, twin, settings, rest=rest, end_s=end_s)


def estimate_under(
    logged: LoggedRun,
    twin: TwinModel,
    settings: SessionSettings,
    *,
    rest: tuple[float, float],
    end_s: float,
    level: LevelFound | None = None,
) -> SessionEstimate:
    """The same of a session whose parked vehicle moves as is given; level None: as the run
    shows.
    """
    run, table, temperature = logged.run, logged.table, logged.temperature
    log, align_until_s = seconds_of(run.imu), alignment_end(run, rest[0])
    repaired, faults = repair(run.imu, log, rest[0], end_s)
    imu = compensated_imu(replace(run, imu=repaired), table, temperature, twin)
    bins = make_bins(table, temperature, twin, settings, start_s=rest[0], end_s=end_s)
    own = own_errors(
        logged,
        twin,
        rest=rest,
        attitude=lambda: start_attitude(imu, run.header.site, rest),
        first=em.BASE + len(bins.prior),
    )
    aligned = gyrocompass.align(
        imu.between(rest[0], align_until_s),
        run.header.site,
        twin,
        bias_sigma_deg_h=np.sqrt(np.diag(bins.prior)[:3] + own.at_rest_deg_h2),
        hold_heading=settings.hold_heading,
        read=gyrocompass.ReadLog(
            seconds=log.between(rest[0], align_until_s),
            faults=[fault for fault in faults if fault.end_s < align_until_s],
        ),
    )
    prior = BiasPrior(bins.edges_s, bins.prior * DEG_PER_HOUR**2)
    clone_at = aligned.time_s if np.isfinite(aligned.time_s) else rest[1]
    receiver = _receiver(run, twin, settings, rest)
    sigma0 = {**nuisance_sigmas(run, settings), **receiver.priors}
    rows = RowSums(imu)

    def aids(assumed: Assumed) -> list[Aid]:
        gnss = None
        if run.gnss is not None and settings.use_gnss:
            arm_m, noise = run.header.gnss_lever_arm_m, twin.gnss
            sigmas = noise.sigma_horizontal_m, noise.sigma_velocity_m_s
            gnss = GnssAid(run.gnss, rows, arm_m, *sigmas, assumed, receiver)
        return [*ground_aids(run, twin, settings, assumed, clone_at, gnss), own]

    try:
        solution = solve(
            RestedLog(imu, run.header.site, rest, run.phases, faults),
            twin,
            prior,
            course=Course(
                until_s=end_s,
                clone_at_s=clone_at,
                hold_heading=settings.hold_heading,
                vertical=_vertical(run),
                level=level,
            ),
            sigma0=sigma0,
            aids=aids(AS_DECLARED),
            further_sigma=own.sigma,
        )
    except NothingStands:
        if aligned.wrong_latitude:
            raise AlignmentRefused(aligned.wrong_latitude) from None
        raise
    rolling = rolling_model(Bench(solution.last, sigma0, aids), solution.filter)
    solution = replace(solution, fitted=replace(solution.fitted, filter=rolling.filter))
    taken = priors_under(sigma0, rolling.assumed)
    left = latitude_covariance(solution.history, bins.edges_s, run.header.site.sigma_lat_rad)
    error, sigma = alignment_heading_error(aligned, solution)
    slow = receiver.found if OF_FIXES in solution.filter.tally.dof else ()
    return SessionEstimate.of_solution(
        bins,
        aligned,
        solution,
        _beside_latitude(prior.covariance, left, *solution.bias),
        heading_error_rad=error,
        sigma_heading_rad=sigma,
        sigma_heading_before_rad=aligned.sigma_heading_rad,
        sweep=partial(noise_shares, solution.last, taken, aids(rolling.assumed), left),
        rolling=replace(rolling.evidence, found=(*rolling.evidence.found, *slow)),
        own=own.found(solution, bins),
    )


def _beside_latitude(
    prior: NDArray, left: NDArray, mean: NDArray, covariance: NDArray
) -> tuple[NDArray, NDArray]:
    """Mean (3N,) and covariance (3N, 3N) of the biases, from those of the sums of bias and Earth
    rate that an error of the latitude leaves, which is all that the filter can show.

    left (3N, 3N): covariance of that rest. Of b in the sum e, G = C (C + D)^-1: E b = G e,
    P_b = G P_e G' + G D (regression of a Gaussian, Bar-Shalom (2001), section 1.4.14).
    """
    G = np.linalg.solve(prior + left, prior).T
    P = G @ covariance @ G.T + G @ left
    return G @ mean, 0.5 * (P + P.T)


def alignment_heading_error(aligned: Alignment, solution: Solution) -> tuple[float, float]:
    """Alignment heading less the heading that the whole session gives for the same moment [rad],
    and its sigma.
    """
    flt, history = solution.filter, solution.history
    if not np.isfinite(aligned.heading_rad):
        return float("nan"), float("nan")
    k = int(np.argmin(np.abs(history.time_s - aligned.time_s)))
    down = em.THETA_CLONE.stop - 1
    heading = euler_from_dcm(history.C_nb[k])[2] - flt.x[down]
    return float(wrap_pi(aligned.heading_rad - heading)), float(np.sqrt(flt.P[down, down]))


def nuisance_sigmas(run: Run, settings: SessionSettings) -> dict[str, float]:
    survey = run.header.survey
    return {
        "KAPPA": settings.sigma_crab_mrad * MILLIRADIAN,
        "LEVER_X": settings.sigma_lever_arm_m,
        "ODOMETER": settings.sigma_odometer_scale,
        "SCALE_Z": settings.sigma_scale_factor_ppm[run.header.gyro_technology] * PPM,
        "CENTRE_LINE": survey.sigma_centre_line_rad or 0.0,
    }


def _receiver(
    run: Run, twin: TwinModel, settings: SessionSettings, rest: tuple[float, float]
) -> ReceiverErrors:
    """The slow errors of the run's receiver, none where there is no receiver to be used."""
    if run.gnss is None or not settings.use_gnss:
        return WHITE
    noise = twin.gnss.sigma_horizontal_m, twin.gnss.sigma_velocity_m_s
    return receiver_errors(run.gnss, rest, noise, settings.flight)


def ground_aids(
    run: Run,
    twin: TwinModel,
    settings: SessionSettings,
    assumed: Assumed,
    aligned_s: float,
    gnss: GnssAid | None = None,
) -> list[Aid]:
    """Every source beside the unit that a run has on the ground: the wheels always, odometer and
    surveys where logged. aligned_s: when the heading at the end of the alignment stands.
    """
    header, survey = run.header, run.header.survey
    aids: list[Aid] = [LateralAid(header.wheel_reference_m, assumed)]
    if run.odometer is not None and settings.use_odometer:
        noise_m_s = twin.odometer.noise_m_s
        aids.append(OdometerAid(run.odometer, noise_m_s, header.wheel_reference_m))
    if gnss is not None:
        aids.append(gnss)
    if survey.heading_rad is not None and survey.sigma_heading_rad:
        aids.append(SurveyedHeadingAid(survey.heading_rad, survey.sigma_heading_rad, aligned_s))
    if survey.centre_line_rad is not None and survey.sigma_centre_line_rad:
        aids.append(CentreLineAid(survey.centre_line_rad))
    return aids


def _vertical(run: Run) -> VerticalChannel:
    """Height held at the site's, or at GNSS height where logged."""
    if run.gnss is None:
        return VerticalChannel(mode="hold")
    return VerticalChannel(mode="aided", time_s=run.gnss.time_s, height_m=run.gnss.height_m)
