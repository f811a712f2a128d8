"""One power-on session against the stored table: from a run to the posterior of its gyro biases.

The gyro output, less the table at the logged temperature, goes through navigation, and the
navigation-mode filter carries what is left of each gyro's bias as a constant over five-minute bins.
The bins' prior is the table's own uncertainty at their temperatures plus what a session adds
(turn-on, flicker, random walk): one joint covariance over axes and time, so that nothing shared is
counted twice.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from alignment import coarse, gyrocompass
from alignment.motion.stillness import ALIGNMENT_S, Motion
from alignment.navigation_filter import Aid
from alignment.result import Alignment, BiasPrior, Solution
from infield.session.navigated.taxi_heading import (
    CentreLineAid,
    GnssAid,
    LateralAid,
    OdometerAid,
    SurveyedHeadingAid,
)
from infield.table.merge import session_covariance
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.attitude import euler_from_dcm, wrap_pi
from ins.compensation import compensate, corrected
from ins.filters import error_model as em
from ins.records import PARKED_PHASES, ImuLog, ImuSource, InputError, Run, TwinModel
from ins.strapdown.mechanization import VerticalChannel
from ins.units import DEG_PER_HOUR, HOUR, MICRO_G, MILLIRADIAN, PPM

if TYPE_CHECKING:
    from infield.session.estimate import ParkedEvidence

BIN_S = 300.0
# spread of a bin's mean about every model of it; keeps the joint covariance invertible
BIN_FLOOR_DEG_H = 1e-4
TIED_SHARE = 0.5  # of a bin that needs a gyro temperature


@dataclass(frozen=True, kw_only=True)
class SessionSettings:
    """Prior sigmas of what no table or twin declares; each is an assumption and is named as one in
    the report.
    """

    bin_s: float = BIN_S
    sigma_crab_mrad: float = 10.0
    sigma_lever_arm_m: float = 5.0
    sigma_odometer_scale: float = 0.01
    sigma_scale_factor_ppm: dict[str, float] = field(
        default_factory=lambda: {"rlg": 5.0, "fog": 50.0, "mems": 5000.0}
    )
    sigma_misalignment_mrad: float = 0.01
    hold_heading: bool = True
    use_gnss: bool = True
    use_odometer: bool = True


@dataclass(frozen=True)
class SessionBins:
    """Time bins of a session and how they hang on the table.

    start_s, end_s (N,): in order, not always without gaps; temperature, rate (N, 3): bin means; H
    (3N, n): rows of the table averaged over the bin, order x, y, z of bin 0, then bin 1 ...;
    table_deg_h (3N,): the table there; prior (3N, 3N) [(deg/h)^2] = H P H' + T. own: T, what the
    session adds; thermometer: the part of T that the temperatures' own errors make, their
    covariance times the table's slope. tied (N, 3): the bin has a temperature; where not, its row
    of H is zero.
    """

    start_s: NDArray
    end_s: NDArray
    temperature_degC: NDArray
    rate_degC_min: NDArray
    H: NDArray
    table_deg_h: NDArray
    prior: NDArray
    own: NDArray
    thermometer: NDArray
    tied: NDArray
    sigma_temperature_degC: NDArray
    sigma_rate_degC_min: NDArray
    gradient_degC: NDArray | None = None

    @property
    def edges_s(self) -> NDArray:
        """(N + 1,): where bins begin, and where the last one ends."""
        return np.append(self.start_s, self.end_s[-1])

    @property
    def centre_s(self) -> NDArray:
        return 0.5 * (self.end_s + self.start_s)

    @property
    def duration_s(self) -> NDArray:
        return np.asarray(self.end_s - self.start_s)

    def only(self, kept: NDArray) -> "SessionBins":
        """The bins kept (N,) bool, the others' biases left out of the joint prior: as if nobody had
        asked for them.
        """
        k = np.repeat(kept, 3)
        return SessionBins(
            self.start_s[kept],
            self.end_s[kept],
            self.temperature_degC[kept],
            self.rate_degC_min[kept],
            self.H[k],
            self.table_deg_h[k],
            self.prior[np.ix_(k, k)],
            self.own[np.ix_(k, k)],
            self.thermometer[np.ix_(k, k)],
            self.tied[kept],
            self.sigma_temperature_degC[kept],
            self.sigma_rate_degC_min[kept],
            None if self.gradient_degC is None else self.gradient_degC[kept],
        )


@dataclass(frozen=True)
class SessionEstimate:
    """Posterior of the session's bias beyond the table (mean (3N,), covariance (3N, 3N), deg/h) and
    its evidence.

    heading_error_rad: computed minus true at the end of the alignment; sigma before (alignment
    alone) and after. solution is None, and parked is not, for gyros that find no heading
    (`infield.session.parked.rates`); the heading is NaN then.
    """

    bins: SessionBins
    mean_deg_h: NDArray
    covariance: NDArray
    alignment: Alignment
    solution: Solution | None
    heading_error_rad: float
    sigma_heading_rad: float
    sigma_heading_before_rad: float
    nis_mean: float
    dof: int
    parked: "ParkedEvidence | None" = None

    @property
    def motion(self) -> Motion:
        """When the vehicle stood, by the solution or by the parked seconds."""
        return self.navigated.motion if self.parked is None else self.parked.motion

    @property
    def navigated(self) -> Solution:
        """The navigation solution, where there is one."""
        assert self.solution is not None
        return self.solution


def compensated_imu(
    run: Run, table: ThermalTable | None, temperature: GyroTemperature | None, twin: TwinModel
) -> ImuSource:
    """The log less the table at each row's temperature, less the twin's nominal scale, misalignment
    and biases.

    No table, or no temperature: only the twin's. A log that is in its file stays there.
    """
    bias_at = None
    if table is not None and temperature is not None:
        refuse_without_settled_part(run)
        bias_at = table_series(table, temperature)

    def correct(piece: ImuLog) -> ImuLog:
        return compensate(
            piece,
            gyro_bias_rad_s=None if bias_at is None else bias_at(piece.time_s) * DEG_PER_HOUR,
            accel_bias_m_s2=np.asarray(twin.accel.bias_ug) * MICRO_G,
            gyro_scale_factor_ppm=twin.gyro.scale_factor_ppm,
            gyro_misalignment_mrad=twin.gyro.misalignment_mrad,
        )

    return corrected(run.imu, correct)


def refuse_without_settled_part(run: Run) -> None:
    """InputError for a run that a whole thermal model was taken out of: a table would be subtracted
    on top of it.
    """
    gone = run.header.removed_model
    if gone is not None and gone.part == "all":
        raise InputError(
            f"run {run.header.run_id}: thermal model {gone.sha256[:12]} was taken out whole, needed"
            " the raw run or --part rates"
        )


def misalignment_sigma_mrad(twin: TwinModel, settings: SessionSettings) -> NDArray:
    """What Earth rate couples into x, y, z beyond the twin's misalignment, 1 sigma (3,): as
    measured, else as assumed.
    """
    measured = np.linalg.norm(np.reshape(twin.gyro.sigma_misalignment_mrad, (3, 2)), axis=1)
    return np.where(measured > 0, measured, settings.sigma_misalignment_mrad)


def table_series(table: ThermalTable, temperature: GyroTemperature) -> Callable[[NDArray], NDArray]:
    """Table bias (k, 3) [deg/h] at any times: the table at the smoothed temperature's nodes,
    straight lines in between.
    """
    nodes_s, T = temperature.time_s, temperature.temperature_degC
    bias = [table.bias_deg_h(axis, T[:, axis]) for axis in range(3)]
    return lambda time_s: np.stack([np.interp(time_s, nodes_s, b) for b in bias], axis=1)


def make_bins(
    table: ThermalTable,
    temperature: GyroTemperature,
    twin: TwinModel,
    settings: SessionSettings,
    *,
    start_s: float,
    end_s: float,
) -> SessionBins:
    """Equal bins of about `bin_s`; a bin without a gyro temperature teaches the table nothing."""
    return bins_between(
        table, temperature, twin, settings, equal_edges(start_s, end_s, settings.bin_s)
    )


def equal_edges(start_s: float, end_s: float, bin_s: float) -> NDArray:
    """Edges (N + 1,) of equal bins of about `bin_s`."""
    return np.linspace(start_s, end_s, max(round((end_s - start_s) / bin_s), 1) + 1)


def rebinned(
    bins: SessionBins,
    table: ThermalTable,
    temperature: GyroTemperature,
    twin: TwinModel,
    settings: SessionSettings,
) -> SessionBins:
    """The same bins on another table."""
    edges = np.unique(np.concatenate([bins.start_s, bins.end_s]))
    return bins_between(table, temperature, twin, settings, edges).only(
        np.isin(edges[:-1], bins.start_s)
    )


def bins_between(
    table: ThermalTable,
    temperature: GyroTemperature,
    twin: TwinModel,
    settings: SessionSettings,
    edges: NDArray,
) -> SessionBins:
    """Bins between edges (N + 1,) [s]."""
    count, end_s = len(edges) - 1, float(edges[-1])
    T, rate, H = (
        np.empty((count, 3)),
        np.empty((count, 3)),
        np.empty((3 * count, table.n_parameters)),
    )
    tied = np.array([temperature.covered(a, b) for a, b in pairwise(edges)]) >= TIED_SHARE
    tied[:, ["xyz".index(name) for name in temperature.unusable]] = False
    gradient = None if temperature.gradient_degC is None else np.empty((count, 3))
    for k in range(count):
        rows = temperature.mean_rows(edges[k], edges[k + 1])
        T[k], rate[k] = rows @ temperature.temperature_degC, rows @ temperature.rate_degC_min
        if gradient is not None and temperature.gradient_degC is not None:
            gradient[k] = rows @ temperature.gradient_degC
        for axis in range(3):
            H[3 * k + axis] = rows[seen := rows > 0] @ table.basis(
                axis, temperature.temperature_degC[seen, axis]
            )
    own = session_covariance(
        axis_index=np.tile(np.arange(3), count),
        time_s=np.repeat(0.5 * (edges[1:] + edges[:-1]), 3),
        duration_s=np.repeat(np.diff(edges), 3),
        gyro=twin.gyro,
        run_length_s=end_s,
        sigma_misalignment_mrad=misalignment_sigma_mrad(twin, settings),
    )
    own[np.diag_indices_from(own)] += BIN_FLOOR_DEG_H**2
    table_deg_h = H @ table.parameters
    _cut_off(table, H, own, tied)
    of_T = temperature.temperature_covariance(edges)
    thermometer = _thermometer_covariance(
        table, T, of_T * (tied.T[:, :, None] & tied.T[:, None, :])
    )
    own += thermometer
    return SessionBins(
        edges[:-1],
        edges[1:],
        T,
        rate,
        H,
        table_deg_h,
        H @ table.covariance @ H.T + own,
        own,
        thermometer,
        tied,
        np.sqrt(np.diagonal(of_T, axis1=1, axis2=2).T),
        temperature.rate_sigma(edges),
        gradient,
    )


def _cut_off(table: ThermalTable, H: NDArray, own: NDArray, tied: NDArray) -> None:
    """Untied bins, in place: the bias is what it is, but no temperature ties it to the table."""
    for axis in range(3):
        rows = 3 * np.flatnonzero(~tied[:, axis]) + axis
        values = table.values_of(axis)
        spread = np.max(np.diag(table.covariance)[values]) + np.var(table.parameters[values])
        own[np.ix_(rows, rows)] += spread * (0.7 + 0.3 * np.eye(rows.size))
        H[rows] = 0.0


def _thermometer_covariance(table: ThermalTable, T: NDArray, covariance: NDArray) -> NDArray:
    """What errors of the temperatures, covariance (3, N, N) [degC^2], do to the bias: times the
    table's slope (3N, 3N).

    E[slope_i slope_j] holds the slope's own uncertainty too: a table that does not know its slope
    does not call it zero.
    """
    count = len(T)
    out = np.zeros((3 * count, 3 * count))
    for axis in range(3):
        S = table.basis(axis, T[:, axis] + 0.5) - table.basis(axis, T[:, axis] - 0.5)  # per degC
        slope = S @ table.parameters
        out[axis::3, axis::3] = covariance[axis] * (
            np.outer(slope, slope) + S @ table.covariance @ S.T
        )
    return out


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
    imu = compensated_imu(run, table, temperature, twin)
    bins = make_bins(table, temperature, twin, settings, start_s=rest[0], end_s=end_s)
    aligned = gyrocompass.align(
        imu.between(rest[0], alignment_end(run, rest[0])),
        run.header.site,
        twin,
        bias_sigma_deg_h=np.sqrt(np.diag(bins.prior)[:3]),
        hold_heading=settings.hold_heading,
    )
    prior = BiasPrior(bins.edges_s, bins.prior * DEG_PER_HOUR**2)
    clone_at = aligned.time_s if np.isfinite(aligned.time_s) else rest[1]
    solution = gyrocompass.solve(
        imu,
        run.header.site,
        twin,
        prior,
        rest=rest,
        phases=run.phases,
        sigma0=_nuisance_sigmas(run, twin, settings),
        aids=_aids(run, twin, settings, clone_at),
        vertical=_vertical(run),
        clone_at_s=clone_at,
        until_s=end_s,
        hold_heading=settings.hold_heading,
    )
    mean, covariance = solution.bias
    error, sigma = _heading_error(aligned, solution)
    tally = solution.filter.tally
    dof = sum(tally.dof.values())
    return SessionEstimate(
        bins=bins,
        mean_deg_h=mean / DEG_PER_HOUR,
        covariance=covariance / DEG_PER_HOUR**2,
        alignment=aligned,
        solution=solution,
        heading_error_rad=error,
        sigma_heading_rad=sigma,
        sigma_heading_before_rad=aligned.sigma_heading_rad,
        nis_mean=sum(tally.nis.values()) / max(dof, 1),
        dof=dof,
    )


def alignment_end(run: Run, start_s: float) -> float:
    """End of the logged alignment phase, else ten minutes after the rest began at `start_s`."""
    logged = [p.end_s for p in run.phases if p.phase == "alignment" and p.end_s > start_s]
    return logged[0] if logged else start_s + ALIGNMENT_S


def _heading_error(aligned: Alignment, solution: Solution) -> tuple[float, float]:
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


def _nuisance_sigmas(run: Run, twin: TwinModel, settings: SessionSettings) -> dict[str, float]:
    survey = run.header.survey
    return {
        "KAPPA": settings.sigma_crab_mrad * MILLIRADIAN,
        "LEVER_X": settings.sigma_lever_arm_m,
        "ODOMETER": settings.sigma_odometer_scale,
        "SCALE_Z": settings.sigma_scale_factor_ppm[run.header.gyro_technology] * PPM,
        "CENTRE_LINE": survey.sigma_centre_line_rad or 0.0,
    }


def _aids(run: Run, twin: TwinModel, settings: SessionSettings, aligned_s: float) -> list[Aid]:
    """Every source the run has: the wheels always, odometer, GNSS and survey where logged."""
    header, survey = run.header, run.header.survey
    aids: list[Aid] = [LateralAid(header.wheel_reference_m)]
    if run.odometer is not None and settings.use_odometer:
        aids.append(OdometerAid(run.odometer, twin.odometer.noise_m_s, header.wheel_reference_m))
    if run.gnss is not None and settings.use_gnss:
        aids.append(
            GnssAid(
                run.gnss,
                header.gnss_lever_arm_m,
                twin.gnss.sigma_horizontal_m,
                twin.gnss.sigma_velocity_m_s,
            )
        )
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


def find_rest(run: Run) -> tuple[float, float] | None:
    """The first rest: within the logged alignment phase where there is one."""
    logged = [p for p in run.phases if p.phase in PARKED_PHASES]
    imu = run.imu
    if logged:
        start, end = max(logged[0].start_s, imu.start_s), min(logged[0].end_s, imu.end_s)
        if end - start < 30.0:
            return None
        imu = imu.between(start, end)
    return coarse.first_rest(imu)


def session_end(run: Run) -> float:
    """Where the ground session ends: the first take-off or flight phase, else the end of the
    log.
    """
    airborne = [p.start_s for p in run.phases if p.phase in ("takeoff", "flight", "landing")]
    return min([*airborne, run.imu.end_s])


def own_information_floor_deg_h(twin: TwinModel, seconds: float) -> float:
    """ARW / sqrt(t): no session can know a bias better than this from its own data (requirements
    R11).
    """
    return float(twin.gyro.arw_deg_sqrt_h / np.sqrt(seconds / HOUR))
