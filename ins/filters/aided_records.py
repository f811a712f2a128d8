"""What goes into the aided filter and what comes out: noise, start, antenna, fixes, history."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.earth import ecef_from_geodetic
from ins.errors.catalogue import prior
from ins.records import GnssLog, NavState

# what became of a fix: from 2 on it was used
UNSEEN, REJECTED, USED, RESET, JUMPED = 0, 1, 2, 3, 4
FEWEST_OF_TYPE = 10  # chosen: fixes, as many as a flight needs (10)
# of a fix, m or m/s: a tenth of what a carrier-phase solution has; beside a start that is known to
# 100 m its square keeps six digits of the covariance
LEAST_SIGMA = 1e-3


@dataclass(frozen=True, kw_only=True)
class AidedNoise:
    """Densities of the sensors' noise and size of the receiver's slow errors, SI.

    Parameters
    ----------
    arw : float
        Angle random walk [rad/sqrt(s)].
    vrw : float
        Velocity random walk [m/s/sqrt(s)].
    gyro_walk, accel_walk : float
        Random walks of the biases [rad/s/sqrt(s)], [m/s^2/sqrt(s)].
    slow_level_m, slow_down_m, slow_velocity_m_s : float
        Sigmas of the receiver's slow errors, beside the fixes' own.
    slow_s, slow_velocity_s : float
        Their time constants.
    deflection_rad, deflection_m : float
        Sigma of the vertical's deflection, north and east, and the length of its correlation along
        the way: a parked vehicle keeps its own.
    slow_other_level_m, slow_other_down_m : float
        Sigmas of the slow error of fixes of the other type, which goes on beside the first one
        with the same time constant.
    gyro_scale, misalignment_rad, accel_scale : float
        Sigmas of what stands still: scale errors and misalignments of the gyros, scale errors of
        the accelerometers; all zero: no states of the filter.
    stirred : float
        How far the accelerometers' biases go with the shaking, which is the root mean square of the
        changes of the specific force from row to row (of white noise: its sigma): where that jumps,
        each bias moves by a draw of stirred times the jump (`About.stirs`).
        Where it is above 0, the shaking is white noise of the accelerometers beside vrw. 0:
        neither.
    """

    arw: float
    vrw: float
    gyro_walk: float
    accel_walk: float
    slow_level_m: float = 0.0
    slow_down_m: float = 0.0
    slow_s: float = prior("gnss_slow_error", "replay", "position").scale
    slow_velocity_m_s: float = 0.0
    slow_velocity_s: float = prior("gnss_slow_error", "replay", "velocity").scale
    deflection_rad: float = 0.0
    deflection_m: float = prior("vertical_deflection", "replay").scale
    slow_other_level_m: float = 0.0
    slow_other_down_m: float = 0.0
    gyro_scale: float = 0.0
    misalignment_rad: float = 0.0
    accel_scale: float = 0.0
    stirred: float = 0.0


@dataclass(frozen=True, kw_only=True)
class AidedStart:
    """Where the filter starts.

    Parameters
    ----------
    state : NavState
    gyro_bias_rad_s, accel_bias_m_s2 : ndarray, shape (3,)
        Biases that are still in the increments.
    covariance : ndarray, shape (15, 15)
        Of the errors; order and signs: `ins.filters.states`.
    """

    state: NavState
    gyro_bias_rad_s: NDArray
    accel_bias_m_s2: NDArray
    covariance: NDArray


@dataclass(frozen=True, kw_only=True)
class Antenna:
    """What the fixes are of: a place beside the IMU, and a time before their own.

    Parameters
    ----------
    lever_arm_m : ndarray, shape (3,)
        From the IMU to the antenna, body axes.
    delay_s, velocity_delay_s : float
        By which positions and velocities are older than their time.
    covariance : ndarray, shape (5, 5)
        Of the errors of lever arm and delays.
    estimated : bool
        By the filter; else they are considered: left as they are, with what that costs.
    """

    lever_arm_m: NDArray
    delay_s: float = 0.0
    velocity_delay_s: float = 0.0
    covariance: NDArray = field(default_factory=lambda: np.zeros((5, 5)))
    estimated: bool = False

    @property
    def values(self) -> NDArray:
        """Lever arm and delays.

        Returns
        -------
        values : ndarray, shape (5,) [m], [s]
        """
        return np.array([*self.lever_arm_m, self.delay_s, self.velocity_delay_s], dtype=float)

    def later(self, seconds: float) -> "Antenna":
        """The same antenna, both delays longer.

        Parameters
        ----------
        seconds : float
            By so much.

        Returns
        -------
        antenna : Antenna
        """
        return replace(
            self, delay_s=self.delay_s + seconds, velocity_delay_s=self.velocity_delay_s + seconds
        )


@dataclass(frozen=True, kw_only=True)
class Fixes:
    """Satellite fixes as the filter takes them; NaN: not measured.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
    r_e_m, v_n_m_s : ndarray, shape (n, 3)
        ECEF position; velocity, NED.
    sigma_position_m, sigma_velocity_m_s : ndarray, shape (n, 3)
        Of the NED components.
    other_type : ndarray of bool, shape (n,)
        Which fixes are of the other of two types, with a slow error of its own; none by default.
    fix_type : ndarray, shape (n,)
        `ins.records.FixType` of each, NaN where it is unknown, as all are by default.
    """

    time_s: NDArray
    r_e_m: NDArray
    v_n_m_s: NDArray
    sigma_position_m: NDArray
    sigma_velocity_m_s: NDArray
    other_type: NDArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    fix_type: NDArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if self.other_type.size != self.time_s.size:
            object.__setattr__(self, "other_type", np.zeros(self.time_s.size, dtype=bool))
        if self.fix_type.size != self.time_s.size:
            object.__setattr__(self, "fix_type", np.full(self.time_s.size, np.nan))

    def earlier(self, latency_s: float) -> "Fixes":
        """The same fixes, each before its time.

        Parameters
        ----------
        latency_s : float
            By so much.

        Returns
        -------
        fixes : Fixes
        """
        return self if latency_s == 0.0 else replace(self, time_s=self.time_s - latency_s)

    def scaled(self, position: float, velocity: float) -> "Fixes":
        """The same fixes with larger sigmas.

        Parameters
        ----------
        position, velocity : float
            Factors of the sigmas.

        Returns
        -------
        fixes : Fixes
        """
        return replace(
            self,
            sigma_position_m=position * self.sigma_position_m,
            sigma_velocity_m_s=velocity * self.sigma_velocity_m_s,
        )


@dataclass(frozen=True, kw_only=True)
class Wheels:
    """What wheels say of a vehicle that rolls: it goes where it points.

    Parameters
    ----------
    time_s : ndarray, shape (m,)
        When: a second apart or more, errors of neighbours are taken for independent.
    speed_m_s : ndarray, shape (m,)
        Forward, as told by an odometer whose scale is taken out; NaN where none tells it.
    variance : ndarray, shape (m, 3)
        Of forward, side and upward velocity [m^2/s^2].
    C_vb : ndarray, shape (3, 3)
        Vehicle axes (forward, right, down) from body axes.
    arm_m : ndarray, shape (3,)
        From the unit to the point that does not slip, body axes.
    """

    time_s: NDArray = field(default_factory=lambda: np.zeros(0))
    speed_m_s: NDArray = field(default_factory=lambda: np.zeros(0))
    variance: NDArray = field(default_factory=lambda: np.zeros((0, 3)))
    C_vb: NDArray = field(default_factory=lambda: np.eye(3))
    arm_m: NDArray = field(default_factory=lambda: np.zeros(3))


NO_WHEELS = Wheels()


@dataclass(frozen=True, kw_only=True)
class AidedOptions:
    """What the filter is told of standstills, and how it is to go on and to report.

    Parameters
    ----------
    stands : array_like, shape (k, 2)
        Spans in which the vehicle stands [s]: each a measurement a second of no velocity and, where
        stand_rate_rad_s is above 0, of no turn but Earth's.
    stand_sigma_m_s, stand_rate_rad_s : float
        Sigmas of these; the gyros' noise adds to the second.
    reset_s : float
        A solution whose positions are rejected one after the other for so long is begun anew; a
        gap between two of them counts for a fifth of that at most.
    wheels : Wheels
        Of a vehicle that rolls; none by default.
    """

    stands: ArrayLike = ()
    stand_sigma_m_s: float = 0.01
    stand_rate_rad_s: float = 0.0
    reset_s: float = 120.0
    wheels: Wheels = NO_WHEELS


@dataclass(frozen=True, kw_only=True)
class AidedHistory:
    """The solution at about 1 Hz, its sigmas, and what became of each fix.

    Parameters
    ----------
    time_s, lat_rad, lon_rad, height_m : ndarray, shape (k,)
    v_n_m_s : ndarray, shape (k, 3)
    C_nb : ndarray, shape (k, 3, 3)
    gyro_bias_rad_s, accel_bias_m_s2 : ndarray, shape (k, 3)
        Biases taken off beyond what the log was compensated with.
    variance : ndarray, shape (k, 15)
        Of the errors.
    phi_covariance : ndarray, shape (k, 3, 3)
        Of the NED attitude error.
    covariance : ndarray, shape (k, 15, 15)
        Of the errors.
    fix_time_s : ndarray, shape (n,)
    residual, sigma : ndarray, shape (n, 6)
        Of the fixes, position then velocity, NED; NaN where unseen.
    nis, used, loglik : ndarray, shape (n, 2)
        Of position and velocity of each fix.
    stand_nis, stand_dof : float, int
        Sum over the standstills, and its degrees of freedom.
    antenna : Antenna
        As it is known at the end.
    rolled : (int, int)
        Measurements of wheels that were used, and rejected (slips).
    scales : ndarray, shape (12,)
        Scale errors and misalignments that are taken off at the end (`ins.filters.states`).
    scales_covariance : ndarray, shape (12, 12)
    shaking : (float, float)
        Least and most of the root mean square of the changes of the specific force from row to row
        (of white noise: its sigma) [m/s^2].
    """

    time_s: NDArray
    lat_rad: NDArray
    lon_rad: NDArray
    height_m: NDArray
    v_n_m_s: NDArray
    C_nb: NDArray
    gyro_bias_rad_s: NDArray
    accel_bias_m_s2: NDArray
    variance: NDArray
    phi_covariance: NDArray
    covariance: NDArray
    fix_time_s: NDArray
    residual: NDArray
    sigma: NDArray
    nis: NDArray
    used: NDArray
    loglik: NDArray
    stand_nis: float
    stand_dof: int
    antenna: Antenna
    rolled: tuple[int, int] = (0, 0)
    scales: NDArray = field(default_factory=lambda: np.zeros(12))
    scales_covariance: NDArray = field(default_factory=lambda: np.zeros((12, 12)))
    shaking: tuple[float, float] = (0.0, 0.0)


def fixes_of(log: GnssLog, *, horizontal_m: float, vertical_m: float, velocity_m_s: float) -> Fixes:
    """A GNSS log with a sigma for each component: as logged, else as declared.

    Parameters
    ----------
    log : GnssLog
    horizontal_m, vertical_m, velocity_m_s : float
        Declared sigmas of one component.

    Returns
    -------
    fixes : Fixes
    """

    def sigma(logged: NDArray | None, declared: float) -> NDArray:
        sigmas = np.full(log.time_s.size, declared)
        if logged is not None:
            sigmas = np.where(np.isfinite(logged) & (logged > 0), logged, declared)
        return np.maximum(sigmas, LEAST_SIGMA)

    level = sigma(log.sigma_horizontal_m, horizontal_m)
    down = sigma(log.sigma_vertical_m, vertical_m)
    speed = sigma(log.sigma_velocity_m_s, velocity_m_s)
    seen = np.isfinite(log.lat_rad) & np.isfinite(log.lon_rad) & np.isfinite(log.height_m)
    r_e = np.full((log.time_s.size, 3), np.nan)
    r_e[seen] = ecef_from_geodetic(log.lat_rad[seen], log.lon_rad[seen], log.height_m[seen])
    v_n = np.where(np.isfinite(log.v_n_m_s).all(axis=1)[:, None], log.v_n_m_s, np.nan)
    return Fixes(
        time_s=log.time_s,
        r_e_m=r_e,
        v_n_m_s=v_n,
        sigma_position_m=np.column_stack([level, level, down]),
        sigma_velocity_m_s=np.column_stack([speed, speed, speed]),
        other_type=_other_type(log.fix_type),
        fix_type=np.zeros(0) if log.fix_type is None else np.asarray(log.fix_type, dtype=float),
    )


def _other_type(fix_type: NDArray | None) -> NDArray:
    """Which fixes are of the other type (n,): the smaller part of those on either side of the cut
    through the scale of types that leaves most in it; none where it would be less than
    FEWEST_OF_TYPE. A type that is unknown is below all others.
    """
    if fix_type is None:
        return np.zeros(0, dtype=bool)
    types = np.nan_to_num(fix_type, nan=0.0)
    cuts = np.unique(types)[1:]
    parts = [part for cut in cuts for part in (types >= cut, types < cut)]
    smaller = [part for part in parts if FEWEST_OF_TYPE <= part.sum() <= 0.5 * types.size]
    none = np.zeros(types.size, dtype=bool)
    return max(smaller, key=np.count_nonzero, default=none)
