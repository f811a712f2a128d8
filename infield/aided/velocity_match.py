"""Attitude of a moving unit from satellite velocities: the force its accelerometers feel, turned by
its gyros, against the change of velocity that the receiver sees. Heading comes from level
acceleration; at a constant velocity there is none::

    v(t2) - v(t1) - g dt + (2 omega_ie + omega_en) x v dt
        = C_nb0 (integral of C_b0b f dt + change of C_b0b (omega x lever))

solved for C_nb0 by singular values (Wahba's problem; Groves 2013, section 5.6; Wu and Pan, IEEE
T-AES 49(2), 2013).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.attitude import dcm_from_rotation_vector, skew
from ins.earth import geodetic_from_ecef, gravity_n, omega_en_n, omega_ie_n
from ins.filters.aided_records import Fixes
from ins.records import ImuLog

# between the fixes of a pair, one a second with 5 % of jitter: short of it noise outweighs what
# gravity and turns show
APART_S = 0.95
# 15 equations for the 3 angles, so that the residuals tell the noise to 20 % (1 / sqrt(24))
FEWEST_PAIRS = 5


@dataclass(frozen=True)
class Match:
    """Attitude at the log's last row; covariance (3, 3) [rad^2] of its NED error; residual RMS of a
    pair [m/s]; pairs.

    rate_b: angular rate at the last row [rad/s], for the antenna's swing.
    """

    C_nb: NDArray
    covariance: NDArray
    pairs: int
    rate_b: NDArray

    @property
    def sigma_heading_rad(self) -> float:
        return float(np.sqrt(self.covariance[2, 2]))


@dataclass(frozen=True)
class Pairs:
    """Fixes of a bounded log by pairs: what the force added in the body axes of the log's start,
    alpha (m, 3), and what the velocity gained, beta (m, 3) NED [m/s].

    C_b0b: body axes of the last row in those of the start; rate_b (3,): angular rate there.
    variance: of a component of beta, declared; seconds: of log.
    """

    alpha: NDArray
    beta: NDArray
    C_b0b: NDArray
    rate_b: NDArray
    variance: float
    seconds: float

    def attitude(self) -> NDArray:
        """C_nb (3, 3) at the start that fits best (Wahba's problem)."""
        U, _, Vt = np.linalg.svd(self.beta.T @ self.alpha)
        return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt)

    def information(self, C_nb: NDArray) -> NDArray:
        """Of the NED error of an attitude (3, 3), for errors of 1 m/s."""
        return sum((skew(b).T @ skew(b) for b in self.alpha @ C_nb.T), np.zeros((3, 3)))

    def residuals(self, C_nb: NDArray) -> NDArray:
        """What an attitude leaves of the pairs (m, 3) [m/s]."""
        return np.asarray(self.beta - self.alpha @ C_nb.T)

    def levelled(self, C_nb: NDArray) -> NDArray:
        """The attitude with the tilt that fits best beside its heading, by two steps of Gauss and
        Newton.
        """
        for _ in range(2):
            force = self.alpha @ C_nb.T
            # beta = (1 + [phi x]) force, phi level: the columns of -[force x] for north and east
            H = np.concatenate([-skew(f)[:, :2] for f in force])
            phi, *_ = np.linalg.lstsq(H, self.residuals(C_nb).ravel(), rcond=None)
            C_nb = dcm_from_rotation_vector(np.append(phi, 0.0)) @ C_nb
        return C_nb


def pairs_of(
    imu: ImuLog, fixes: Fixes, *, lever_arm_m: NDArray, gyro_bias_rad_s: NDArray
) -> Pairs | None:
    """The pairs of fixes in a bounded log; None where there are too few."""
    from ins.strapdown.body_forces import turned_forces

    C_b0b, force = turned_forces(imu.dtheta_rad - gyro_bias_rad_s * imu.dt_s[:, None], imu.dv_m_s)
    edges = np.append(imu.time_s[0] - imu.dt_s[0], imu.time_s)
    used = whole_fixes(fixes, float(edges[0]), float(edges[-1]))
    if used.size < FEWEST_PAIRS + 1:
        return None
    t, v = fixes.time_s[used], fixes.v_n_m_s[used]
    rate = (imu.dtheta_rad / imu.dt_s[:, None] - gyro_bias_rad_s)[
        np.clip(np.searchsorted(imu.time_s, t), 0, imu.rows - 1)
    ]
    felt = np.stack([np.interp(t, edges, column) for column in force.T], axis=1)
    at = np.clip(np.searchsorted(edges, t), 0, imu.rows)
    felt += np.einsum("kij,kj->ki", C_b0b[at], np.cross(rate, lever_arm_m))
    return Pairs(
        alpha=np.diff(felt, axis=0),
        beta=_gained(fixes, used, t, v),
        C_b0b=C_b0b[-1],
        rate_b=rate[-1],
        variance=2.0 * float(np.nanmean(fixes.sigma_velocity_m_s[used] ** 2)),
        seconds=float(edges[-1] - edges[0]),
    )


def match_velocity(
    imu: ImuLog,
    fixes: Fixes,
    *,
    lever_arm_m: NDArray,
    gyro_bias_rad_s: NDArray,
    sigma_gyro_rad_s: float,
) -> Match | None:
    """Attitude over a bounded log from the fixes in it; None where there are too few, or where they
    do not say.

    The covariance takes the residuals as they are, or the declared noise where that is larger, and
    a constant gyro error of `sigma_gyro_rad_s` over the log.
    """
    pairs = pairs_of(imu, fixes, lever_arm_m=lever_arm_m, gyro_bias_rad_s=gyro_bias_rad_s)
    if pairs is None:
        return None
    C = pairs.attitude()
    left = pairs.residuals(C)
    variance = max(float((left**2).sum()) / (3 * len(left) - 3), pairs.variance)
    information = pairs.information(C)
    if np.linalg.cond(information) > 1e12:
        return None
    turned = (sigma_gyro_rad_s * pairs.seconds) ** 2 * np.eye(3)
    return Match(
        C_nb=C @ pairs.C_b0b,
        covariance=variance * np.linalg.inv(information) + turned,
        pairs=len(left),
        rate_b=pairs.rate_b,
    )


def whole_fixes(fixes: Fixes, start_s: float, end_s: float) -> NDArray:
    """Fixes with position and velocity inside a span, each at least APART_S after the one
    before.
    """
    inside = (fixes.time_s >= start_s) & (fixes.time_s <= end_s)
    inside &= np.isfinite(fixes.v_n_m_s[:, 0]) & np.isfinite(fixes.r_e_m[:, 0])
    found: list[int] = []
    for k in np.flatnonzero(inside):
        if not found or fixes.time_s[k] - fixes.time_s[found[-1]] >= APART_S:
            found.append(int(k))
    return np.array(found, dtype=int)


def _gained(fixes: Fixes, used: NDArray, t: NDArray, v: NDArray) -> NDArray:
    """What the force added to the velocity between the fixes, NED (m - 1, 3) [m/s]."""
    lat, _, height = geodetic_from_ecef(fixes.r_e_m[used])
    rate = 2.0 * omega_ie_n(lat) + omega_en_n(lat, height, v)
    turned = np.cross(rate, v) - gravity_n(lat, height)
    return np.diff(v, axis=0) + 0.5 * (turned[1:] + turned[:-1]) * np.diff(t)[:, None]
