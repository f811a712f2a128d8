"""The motion of one moving stretch: navigated from the stand before it, corrected by all that is
known of it.

Unknowns are the attitude at its start, gyro and accelerometer biases as straight lines between
knots, crab and odometer scale. A least-squares fit (`move_rows`) holds the solution's errors
against rest and level at the next stand, no side slip on wheels, odometer and GNSS. The solution is
then navigated again with what was found, so that the result is one consistent motion.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.attitude import dcm_from_rotation_vector
from ins.compensation import compensate
from ins.records import GnssLog, ImuSource, NavHistory, NavState, Run, Site, TwinModel
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG_PER_HOUR, HOUR, MICRO_G
from simreal.twin.move_rows import Rows, gnss_rows, hats, sensitivity, stop_rows, wheel_rows
from simreal.twin.stands import airborne

EPOCH_S = 0.1
# random walk of the tilt between knots: below 2 cm/s
KNOT_S = {"rlg": 60.0, "fog": 60.0, "mems": 10.0}
MOST_KNOTS = 60
PASSES = 3
LEAST_TILT_RAD, LEAST_GYRO_DEG_H, LEAST_ACCEL_UG = 2e-5, 5e-3, 20.0
SIGMA_CRAB_RAD, SIGMA_ODOMETER = 0.01, 0.01
HEIGHT_S = 30.0  # of the loop that holds the height to GNSS
FIRST_PART_S, PART_GROWTH = 60.0, 1.6
HUBER_SIGMAS, HUBER_ROUNDS = 3.0, 3


@dataclass(frozen=True, kw_only=True)
class MoveStart:
    """At the end of a stand: time, place, C_nb (3, 3), sigma of its heading.

    gyro_bias_rad_s, accel_bias_m_s2 (3,): what the sensors read there beyond Earth rate and
    gravity.
    """

    time_s: float
    site: Site
    C_nb: NDArray
    sigma_heading_rad: float
    gyro_bias_rad_s: NDArray
    accel_bias_m_s2: NDArray


@dataclass(frozen=True, kw_only=True)
class MoveFit:
    """The fitted solution with its start attitude; in_air (n,): epochs off the ground."""

    history: NavHistory
    C_nb: NDArray
    in_air: NDArray
    sigma_heading_rad: float


class _Correction:
    """What was found so far: start attitude, and biases at the knots."""

    def __init__(self, start: MoveStart, end_s: float, twin: TwinModel) -> None:
        count = int(np.clip((end_s - start.time_s) / KNOT_S[twin.gyro_technology], 1, MOST_KNOTS))
        self.knots_s = np.linspace(start.time_s, end_s, count + 1)
        self.C_nb = start.C_nb
        self.found = np.zeros(3 + 6 * self.knots_s.size + 2)
        self.sigma = _prior_sigma(start, twin, self.knots_s)

    def add(self, step: NDArray, until_s: float) -> None:
        """Take a step of the fit in; biases at knots that it did not reach are those of the last
        that it did.
        """
        self.found = self.found + step
        self.C_nb = dcm_from_rotation_vector(-step[:3]) @ self.C_nb
        reached = int(np.searchsorted(self.knots_s, until_s, side="right"))
        biases = self.found[3:-2].reshape(2, self.knots_s.size, 3)
        biases[:, reached:] = biases[:, reached - 1 : reached]

    def bias(self, time_s: NDArray) -> tuple[NDArray, NDArray]:
        """Gyro [rad/s] and accelerometer bias [m/s^2] at times (n,), (n, 3) each."""
        gyro, accel = self.found[3:-2].reshape(2, self.knots_s.size, 3)
        weight = hats(time_s, self.knots_s)
        return weight @ gyro, weight @ accel


def fit_move(
    run: Run,
    imu: ImuSource,
    twin: TwinModel,
    start: MoveStart,
    *,
    end_s: float,
    C_nb_stop: NDArray | None,
    gnss: GnssLog | None,
) -> MoveFit:
    """The solution from `start` to end_s. imu: compensated with what the twin believes.

    C_nb_stop (3, 3): level of the stand at end_s, None where the log ends in motion. gnss: relative
    to the site.
    """
    vertical = VerticalChannel(mode="hold")
    if gnss is not None:
        vertical = VerticalChannel(
            mode="aided", time_s=gnss.time_s, height_m=gnss.height_m, time_constant_s=HEIGHT_S
        )
    now = _Correction(start, end_s, twin)
    sigma = start.sigma_heading_rad
    for until_s in _horizons(
        start.time_s, end_s, early=gnss is not None and twin.gyro_technology == "mems"
    ):
        history = _navigated(imu, start, now, until_s, vertical)
        in_air = airborne(run, history.time_s, history.v_n_m_s, start.site.height_m)
        s = sensitivity(history, now.knots_s)
        rows = wheel_rows(s, run, twin, ~in_air)
        if C_nb_stop is not None and until_s == end_s:
            rows += stop_rows(s, C_nb_stop, _tilt_sigma(twin))
        if gnss is not None:
            rows += gnss_rows(s, gnss, np.asarray(run.header.gnss_lever_arm_m, dtype=float), twin)
        step, sigma = _least_squares(rows, now)
        now.add(step, until_s)
    history = _navigated(imu, start, now, end_s, vertical)
    in_air = airborne(run, history.time_s, history.v_n_m_s, start.site.height_m)
    return MoveFit(history=history, C_nb=now.C_nb, in_air=in_air, sigma_heading_rad=sigma)


def _horizons(start_s: float, end_s: float, *, early: bool) -> list[float]:
    """How far each pass goes: PASSES to the end; `early`: before that in growing parts, for a
    solution that runs away.
    """
    parts, reach = [], FIRST_PART_S
    while early and start_s + reach < end_s:
        parts += [start_s + reach, start_s + reach]
        reach *= PART_GROWTH
    return parts + [end_s] * PASSES


def _navigated(
    imu: ImuSource, start: MoveStart, now: _Correction, end_s: float, vertical: VerticalChannel
) -> NavHistory:
    lead_s = 2.0 / imu.rate_hz

    def corrected(piece):
        gyro, accel = now.bias(piece.time_s)
        return compensate(
            piece,
            gyro_bias_rad_s=start.gyro_bias_rad_s + gyro,
            accel_bias_m_s2=start.accel_bias_m_s2 + accel,
        )

    first = NavState(time_s=start.time_s, site=start.site, v_n_m_s=np.zeros(3), C_nb=now.C_nb)
    pieces = map(corrected, imu.pieces(start.time_s - lead_s, end_s + 1e-6))
    return navigate(pieces, first, epoch_s=max(EPOCH_S, 1.0 / imu.rate_hz), vertical=vertical)


def _tilt_sigma(twin: TwinModel) -> float:
    """Level of a stand by accelerometers whose bias turns with the vehicle [rad]."""
    return max(2.0 * twin.accel.turn_on_ug * 1e-6, LEAST_TILT_RAD)


def _prior_sigma(start: MoveStart, twin: TwinModel, knots_s: NDArray) -> NDArray:
    gyro, accel = twin.gyro, twin.accel
    step_h = np.diff(knots_s).mean() / HOUR
    wander = np.hypot(gyro.bias_instability_deg_h, gyro.rate_random_walk_deg_h_sqrt_h)
    gyro_deg_h = np.hypot(np.hypot(wander, LEAST_GYRO_DEG_H), gyro.arw_deg_sqrt_h / np.sqrt(step_h))
    accel_ug = np.hypot(
        max(accel.turn_on_ug, LEAST_ACCEL_UG), accel.vrw_ug_sqrt_hz / np.sqrt(step_h * HOUR)
    )
    return np.concatenate(
        [
            [_tilt_sigma(twin), _tilt_sigma(twin), max(start.sigma_heading_rad, 1e-6)],
            np.full(3 * knots_s.size, gyro_deg_h * DEG_PER_HOUR),
            np.full(3 * knots_s.size, accel_ug * MICRO_G),
            [SIGMA_CRAB_RAD, SIGMA_ODOMETER],
        ]
    )


def _least_squares(rows: list[Rows], now: _Correction) -> tuple[NDArray, float]:
    """What to add to the correction, and the sigma of the heading; rows far off count less
    (Huber).
    """
    prior = 1.0 / now.sigma**2
    prior[-2:] = [1.0 / SIGMA_CRAB_RAD**2, 1.0 / SIGMA_ODOMETER**2]
    mean = -now.found
    mean[-2:] = 0.0  # crab and scale are not taken out of the solution
    H = np.concatenate([r.H / r.sigma[:, None] for r in rows]) if rows else np.zeros((0, mean.size))
    z = np.concatenate([r.z / r.sigma for r in rows]) if rows else np.zeros(0)
    x, weight = mean, np.ones(z.size)
    scale = np.sqrt(prior)
    for _ in range(HUBER_ROUNDS):
        A = (H * weight[:, None]).T @ H / np.outer(scale, scale) + np.eye(mean.size)
        x = np.linalg.solve(A, (H.T @ (weight * z) + prior * mean) / scale) / scale
        weight = np.minimum(1.0, HUBER_SIGMAS / np.maximum(np.abs(z - H @ x), 1e-9))
    step = x.copy()
    step[-2:] = 0.0
    return step, float(np.sqrt(np.linalg.inv(A)[2, 2]) / scale[2])
