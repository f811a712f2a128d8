"""The motion of a recorded run, smooth and without noise, as its own sensors tell it: what its twin
is simulated along.

A stand has exactly one attitude: level by its mean specific force, heading carried on by the gyros
from the first stand, which is gyrocompassed with all aids (or surveyed, or by GNSS course, or taken
as 0). A moving stretch is navigated from the stand before it and fitted to what is known
(`move_fit`); a cubic spline with knots KNOT_S apart is taken through its attitude and forward
speed. On wheels the motion has no side slip: crab and side noise are the twin's. Where a run has no
GNSS, its place is the entered site. No reference stream is read; `Run` does not hold one.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_lsq_spline
from scipy.ndimage import uniform_filter1d

from alignment.coarse import gyrocompass_dcm, rest_means
from alignment.gyrocompass import UNKNOWN_BIAS_DEG_H
from alignment.motion.stillness import NEW_PLACE_RAD
from infield.session.navigated import compensated_imu, find_rest
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import (
    GyroTemperature,
    gyro_temperature,
    plausible_range,
    too_short,
)
from ins.attitude import dcm_from_euler, euler_from_dcm, wrap_pi
from ins.earth import gravity_magnitude, omega_ie_n
from ins.records import GnssLog, ImuSource, InputError, NavHistory, Run, Site, TwinModel
from ins.thermometer_faults import PLAUSIBLE_degC
from ins.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR, HOUR
from simreal.evidence.seconds import Seconds, seconds_of
from simreal.twin.first_heading import FirstHeading, first_heading, relative_to_site
from simreal.twin.move_fit import MoveFit, MoveStart, fit_move
from simreal.twin.move_rows import wheel_velocity
from simreal.twin.stands import Stood, find_stands, level_and_rate
from simreal.twin.timeline import even_rate
from trajectories.simulator.sampled_truth import (
    Sampled,
    SampledMove,
    SampledStand,
    truth_from_samples,
)
from trajectories.simulator.truth import Truth

KNOT_S = 0.5
COURSE_M, MOVING_M_S = 40.0, 1.0  # GNSS way that shows a heading
COURSE_SIGMA_RAD = 0.1
# of a stretch that was no move: way, its growth with time, speed
NOWHERE_M, NOWHERE_S, NOWHERE_M_S = 0.3, 150.0, 0.5
HELD_RAD = 1e-6  # sigma of a heading that nothing shows: it stays as it was taken
KNOWN_RAD = 0.1  # sigma of a heading that counts as known
LIFT_OFF_S = 4.0


@dataclass(frozen=True, kw_only=True)
class RunMotion:
    """Truth for a twin. Its time 0 is `origin_s` of the run, the start of the first IMU interval.

    stands: (start, end) in run time [s]. heading_source: gyrocompass, survey, gnss or assumed;
    sigma at the first stand. temperature: smoothed, None where not logged.
    """

    truth: Truth
    origin_s: float
    stands: tuple[tuple[float, float], ...]
    heading_known: bool
    heading_source: str
    sigma_heading_rad: float
    temperature: GyroTemperature | None


def estimate_motion(run: Run, table: ThermalTable | None, twin: TwinModel) -> RunMotion:
    """The motion of a run with raw gyro output (see
    `infield.session.pipeline.with_applied_table_undone`).

    table, twin: what is believed of the unit. Raises InputError where the run never rests.
    """
    temperature = smoothed_temperature(run, table)
    imu = compensated_imu(run, table, temperature, twin)
    rest = find_rest(run)
    if rest is None:
        raise InputError(
            f"run {run.header.run_id}: never rests for a minute; its motion cannot be told from its"
            " own sensors"
        )
    means = rest_means(imu.between(*rest))
    seconds = seconds_of(imu)
    local = _at_site(run, gyrocompass_dcm(means), rest)
    first = first_heading(local, imu, twin, rest)
    stands = find_stands(local, seconds, means, rest, first.motion)
    origin_s = run.imu.start_s - 1.0 / even_rate(run.imu)[0]
    stands[0] = (origin_s, stands[0][1])
    walk = _walk(run, imu, twin, seconds, stands, rest, first)
    if not first.sigma_rad < KNOWN_RAD and run.gnss is not None:
        first = walk.course(first)
        walk = _walk(run, imu, twin, seconds, stands, rest, first)
    heading, fits = walk.along(first)
    if len(calmer := _without_shakes(stands, fits)) < len(stands):
        walk = _walk(run, imu, twin, seconds, calmer, rest, first)
        heading, fits = walk.along(first)
    sigma = fits[0].sigma_heading_rad if fits and np.isfinite(first.sigma_rad) else first.sigma_rad
    truth = truth_from_samples(
        run.header.site,
        _stretches(walk, heading, fits, origin_s),
        wheel_reference_m=run.header.wheel_reference_m,
    )
    return RunMotion(
        truth=truth,
        origin_s=origin_s,
        stands=tuple(walk.stands),
        heading_known=first.source != "assumed",
        heading_source=first.source,
        sigma_heading_rad=sigma,
        temperature=temperature,
    )


def smoothed_temperature(run: Run, table: ThermalTable | None) -> GyroTemperature | None:
    """The run's gyro temperatures without noise; None where it has none to speak of."""
    if run.temperature is None or too_short(run.temperature):
        return None
    plausible = PLAUSIBLE_degC if table is None else plausible_range(table)
    found = gyro_temperature(run.temperature, plausible_degC=plausible)
    return None if len(found.unusable) == 3 else found


def _walk(
    run: Run,
    imu: ImuSource,
    twin: TwinModel,
    seconds: Seconds,
    stands: list[tuple[float, float]],
    rest: tuple[float, float],
    first: FirstHeading,
) -> "Walk":
    stood = [level_and_rate(seconds, *span) for span in stands]
    return Walk(_at_site(run, _C_nb(stood[0], first.heading_rad), rest), imu, twin, stands, stood)


def _without_shakes(
    stands: list[tuple[float, float]], fits: list[MoveFit]
) -> list[tuple[float, float]]:
    """The stands with those joined between which the vehicle went nowhere: a gust, not a move."""
    out = [stands[0]]
    for fit, (start_s, end_s) in zip(fits, stands[1:]):
        history = fit.history
        lasted = history.time_s[-1] - history.time_s[0]
        way = np.cumsum(history.displacement_n_m[:, :2], axis=0)
        turned = abs(float(wrap_pi(np.diff(euler_from_dcm(history.C_nb[[0, -1]])[2])[0])))
        near = np.linalg.norm(way, axis=1).max() < NOWHERE_M + (lasted / NOWHERE_S) ** 2
        slow = np.linalg.norm(history.v_n_m_s[:, :2], axis=1).max() < NOWHERE_M_S
        if near and slow and turned < NEW_PLACE_RAD:
            start_s = out.pop()[0]
        out.append((start_s, end_s))
    return out


def _at_site(run: Run, C_nb: NDArray, rest: tuple[float, float]) -> Run:
    return (
        run if run.gnss is None else replace(run, gnss=relative_to_site(run.gnss, run, C_nb, rest))
    )


def _C_nb(stood: Stood, heading_rad: float) -> NDArray:
    return dcm_from_euler(stood.roll_rad, stood.pitch_rad, heading_rad)


@dataclass(frozen=True)
class Walk:
    """From stand to stand. run: its GNSS relative to the site; imu: compensated; spans and levels
    of the stands.
    """

    run: Run
    imu: ImuSource
    twin: TwinModel
    stands: list[tuple[float, float]]
    stood: list[Stood]

    def along(
        self, first: FirstHeading, *, course_until_s: float | None = None
    ) -> tuple[list[float], list[MoveFit]]:
        """Heading of each stand, not wrapped, and the fit of each moving stretch, one fewer or as
        many.

        course_until_s: go only so far, and without GNSS.
        """
        heading, sigma = (
            [first.heading_rad],
            first.sigma_rad if np.isfinite(first.sigma_rad) else HELD_RAD,
        )
        site, fits, gnss = (
            self.run.header.site,
            [],
            self.run.gnss if course_until_s is None else None,
        )
        log_end_s = self.imu.end_s if course_until_s is None else course_until_s
        for k, (stood, (_, start_s)) in enumerate(zip(self.stood, self.stands)):
            last = k + 1 == len(self.stands) or self.stands[k + 1][0] > log_end_s
            end_s = log_end_s if last else self.stands[k + 1][0]
            if end_s <= start_s:
                break
            C_nb = _C_nb(stood, heading[k])
            start = MoveStart(
                time_s=start_s,
                site=site,
                C_nb=C_nb,
                sigma_heading_rad=sigma,
                gyro_bias_rad_s=_beyond_earth_rate(stood, C_nb, site, self.twin, start_s),
                accel_bias_m_s2=_beyond_gravity(stood, site),
            )
            stop = None if last else _C_nb(self.stood[k + 1], 0.0)
            fit = fit_move(
                self.run, self.imu, self.twin, start, end_s=end_s, C_nb_stop=stop, gnss=gnss
            )
            heading[k] += float(wrap_pi(euler_from_dcm(fit.C_nb)[2] - heading[k]))
            turned = np.unwrap(np.append(heading[k], euler_from_dcm(fit.history.C_nb)[2]))
            heading.append(float(turned[-1]))
            fits.append(fit)
            if last:
                break
            sigma, site = fit.sigma_heading_rad, _last_place(fit.history, site, gnss is not None)
        return heading, fits

    def course(self, first: FirstHeading) -> FirstHeading:
        """The first heading from the direction that GNSS says the first long enough way had; as
        given where there is none.
        """
        log = self.run.gnss
        reached_s = None if log is None else self._course_reached_s(log)
        if log is None or reached_s is None:
            return first
        history = self.along(first, course_until_s=reached_s)[1][-1].history
        rows = (log.time_s > history.time_s[0]) & (log.time_s < history.time_s[-1])
        north, east = (
            np.interp(log.time_s[rows], history.time_s, v) for v in history.v_n_m_s.T[:2]
        )
        turn = np.sum((log.v_n_m_s[rows, 0] + 1j * log.v_n_m_s[rows, 1]) * (north - 1j * east))
        return FirstHeading(
            first.heading_rad + float(np.angle(turn)), COURSE_SIGMA_RAD, "gnss", first.motion
        )

    def _course_reached_s(self, log: GnssLog) -> float | None:
        """When the first moving stretch with a way of COURSE_M has gone so far."""
        for k, (_, start_s) in enumerate(self.stands):
            end_s = self.stands[k + 1][0] if k + 1 < len(self.stands) else self.imu.end_s
            rows = np.flatnonzero((log.time_s > start_s) & (log.time_s < end_s))
            speed = np.linalg.norm(log.v_n_m_s[rows[1:], :2], axis=1)
            way = np.cumsum(np.where(speed > MOVING_M_S, speed, 0.0) * np.diff(log.time_s[rows]))
            if way.size and way[-1] > COURSE_M:
                return float(log.time_s[rows[1:]][way > COURSE_M][0])
        return None


def _last_place(history: NavHistory, start: Site, has_height: bool) -> Site:
    height = float(history.height_m[-1]) if has_height else start.height_m
    return Site(
        lat_rad=float(history.lat_rad[-1]), lon_rad=float(history.lon_rad[-1]), height_m=height
    )


def _beyond_earth_rate(
    stood: Stood, C_nb: NDArray, site: Site, twin: TwinModel, time_s: float
) -> NDArray:
    """Bias (3,) [rad/s] of the gyros while it stood, weighed against zero with what a session may
    add.
    """
    gyro = twin.gyro
    drift = np.hypot(
        gyro.bias_instability_deg_h,
        gyro.rate_random_walk_deg_h_sqrt_h * np.sqrt(max(time_s, 1.0) / HOUR),
    )
    prior = (
        np.hypot(drift, np.hypot(gyro.turn_on_deg_h, UNKNOWN_BIAS_DEG_H[twin.gyro_technology]))
        * DEG_PER_HOUR
    )
    noise = gyro.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR / np.sqrt(max(stood.seconds, 1.0))
    found = stood.rate_rad_s - C_nb.T @ omega_ie_n(site.lat_rad)
    return np.asarray(found * prior**2 / (prior**2 + noise**2))


def _beyond_gravity(stood: Stood, site: Site) -> NDArray:
    """Bias (3,) [m/s^2] along the vertical: all that a levelled stand shows of the
    accelerometers.
    """
    force = float(np.linalg.norm(stood.force_m_s2))
    return np.asarray(
        stood.force_m_s2 * (1.0 - float(gravity_magnitude(site.lat_rad, site.height_m)) / force)
    )


def _stretches(
    walk: Walk, heading: list[float], fits: list[MoveFit], origin_s: float
) -> list[Sampled]:
    """Stands and moving stretches in turn, in truth time."""
    euler = [np.array([s.roll_rad, s.pitch_rad, h]) for s, h in zip(walk.stood, heading)]
    out: list[Sampled] = []
    for k, (start_s, end_s) in enumerate(walk.stands):
        out.append(
            SampledStand(start_s=start_s - origin_s, end_s=end_s - origin_s, euler_rad=euler[k])
        )
        if k < len(fits):
            last = k + 1 == len(walk.stands)
            after_s = walk.imu.end_s if last else walk.stands[k + 1][0]
            ends = (euler[k], None if last else euler[k + 1])
            out.append(_move(walk.run, fits[k], (end_s, after_s), ends, origin_s))
    return out


def _move(
    run: Run,
    fit: MoveFit,
    span: tuple[float, float],
    ends: tuple[NDArray, NDArray | None],
    origin_s: float,
) -> SampledMove:
    """Samples of a cubic least-squares spline through the fitted solution, led into the attitudes
    of the stands beside it.
    """
    history = fit.history
    lever = np.asarray(run.header.wheel_reference_m, dtype=float)
    angles = np.unwrap(np.column_stack(euler_from_dcm(history.C_nb)), axis=0)
    angles[:, 2] += ends[0][2] - angles[0, 2] - wrap_pi(ends[0][2] - angles[0, 2])
    # along the ground, of that along body x
    speed = wheel_velocity(history, lever)[:, :1] / np.cos(angles[:, 1:2])
    # as the height is aided
    v_n = np.column_stack([history.v_n_m_s[:, :2], -np.gradient(history.height_m, history.time_s)])
    t = span[0] + (span[1] - span[0]) * np.linspace(
        0.0, 1.0, max(round((span[1] - span[0]) / KNOT_S), 8) + 1
    )
    smooth = _smooth(history.time_s, np.hstack([angles, speed, v_n]), t)
    into = np.linspace(0.0, 1.0, t.size)[:, None]
    wanted = smooth[[0, -1]].copy()
    wanted[0, :4] = [*ends[0], 0.0]
    if ends[1] is not None:
        wanted[1, :4] = [*ends[1], 0.0]
    smooth += (1.0 - into) * (wanted[0] - smooth[0]) + into * (wanted[1] - smooth[-1])
    in_air = uniform_filter1d(
        np.interp(t, history.time_s, fit.in_air), max(round(LIFT_OFF_S / KNOT_S), 1)
    )
    return SampledMove(
        time_s=t - origin_s,
        euler_rad=smooth[:, :3],
        speed_m_s=smooth[:, 3],
        v_n_m_s=smooth[:, 4:],
        airborne=in_air,
    )


def _smooth(time_s: NDArray, values: NDArray, at_s: NDArray) -> NDArray:
    """Values (n, c) at even times (m,) of the cubic spline with knots there that fits them best."""
    inside = at_s[1:-1]
    inside = inside[(inside > time_s[2]) & (inside < time_s[-3])]
    knots = np.concatenate([np.full(4, time_s[0]), inside, np.full(4, time_s[-1])])
    spline = make_lsq_spline(time_s, values, knots, k=3)
    return np.asarray(spline(np.clip(at_s, time_s[0], time_s[-1])))
