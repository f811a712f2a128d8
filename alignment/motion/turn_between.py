"""How far a unit turned about the vertical between two stands of one log, by its gyros, and how
well that is known.

Rates less the straight line from the zero rate before to the zero rate after are multiplied up to a
rotation; gravity on either side says where down was. The angle that down fails to close by is the
integral's own witness: what it lost about two axes, it may have lost about the third. A sensor at
the end of its range loses what no closure shows. Source: Savage, Strapdown Analytics (2007), sec.
7.1 (rotation vectors); coning between rows is left to the closure.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.parked_seconds import ParkedSeconds
from alignment.motion.seconds import LogSeconds, quiet_seconds
from ins.attitude import dcm_from_euler, dcm_from_rotation_vector, level_angles, wrap_pi
from ins.noise import gyro_densities
from ins.records import GyroNoise, ImuSource

# a turn known to better is used, 20 deg; of a variance that both stands share 6 % is lost to it
TOLD_RAD = 0.35
LOST_RAD = 0.1  # of turn in a dropout of the log, over which the last rate is held, 1 sigma
BESIDE_S = 60.0  # of rest on either side, for the zero rate
# of a bias change: what its mean may be off a straight line; 0.16 in a warm-up over two time
# constants
CURVED = 1.0 / 3.0


@dataclass(frozen=True)
class HeadingChange:
    """heading_rad: of the later stand less that of the earlier, in [-pi, pi); closure_rad: how far
    down was missed.
    """

    heading_rad: float
    sigma_rad: float
    closure_rad: float

    @property
    def told(self) -> bool:
        """Whether the gyros say how far it was."""
        return self.sigma_rad <= TOLD_RAD


def levelled(seconds: ParkedSeconds) -> NDArray:
    """Rows (3, 3): forward, right and down of a level frame at heading zero, in body axes, by
    gravity.
    """
    return dcm_from_euler(*level_angles(seconds.means(-np.inf, np.inf)[0][:3]), 0.0)


def turn_between(
    imu: ImuSource,
    before: ParkedSeconds,
    after: ParkedSeconds,
    gyro: GyroNoise,
    *,
    log: LogSeconds,
    sigma_scale: float,
) -> HeadingChange:
    """The turn from one stand to the next one of the log; `log`: its seconds."""
    t0, t1 = float(before.end_s[-1]), float(after.start_s[0])
    w0, w1 = before.means(t0 - BESIDE_S, t0)[0][3:], after.means(t1, t1 + BESIDE_S)[0][3:]
    w0 = before.means(-np.inf, np.inf)[0][3:] if np.isnan(w0).any() else w0
    w1 = after.means(-np.inf, np.inf)[0][3:] if np.isnan(w1).any() else w1
    C, turned = np.eye(3), np.zeros(3)  # C takes body axes of the moment into those before
    for piece in imu.pieces(t0, t1):
        share = ((piece.time_s - t0) / (t1 - t0))[:, None]
        angle = piece.dtheta_rad - (w0 + (w1 - w0) * share) * piece.dt_s[:, None]
        C = C @ _product(dcm_from_rotation_vector(angle))
        turned = turned + angle.sum(axis=0)
    K = levelled(before) @ C @ levelled(after).T
    heading = np.arctan2(K[1, 0] - K[0, 1], K[0, 0] + K[1, 1])
    closure = float(np.arctan2(np.hypot(K[0, 2], K[1, 2]), K[2, 2]))
    drift = np.hypot(CURVED * np.linalg.norm(w1 - w0), gyro_densities(gyro).instability) * (t1 - t0)
    white = gyro_densities(gyro).white * np.sqrt(t1 - t0)
    sigma = np.sqrt(
        drift**2
        + white**2
        + (sigma_scale * np.linalg.norm(turned)) ** 2
        + closure**2
        + _lost(log, t0, t1) ** 2
    )
    return HeadingChange(float(wrap_pi(heading)), float(min(sigma, np.pi)), closure)


def _lost(log: LogSeconds, start_s: float, end_s: float) -> float:
    """What dropouts of the log and a sensor at the end of its range may have lost of a turn, 1
    sigma [rad].
    """
    seconds = quiet_seconds(log.between(start_s, end_s))
    if seconds is None:
        return 0.0
    return float(
        np.pi if seconds.stuck.any() else LOST_RAD * np.sqrt(np.count_nonzero(seconds.lost))
    )


def _product(C: NDArray) -> NDArray:
    """C[0] @ C[1] @ ... of matrices (n, 3, 3), neighbours first."""
    while len(C) > 1:
        last = C[-1:] if len(C) % 2 else C[:0]
        C = np.concatenate([C[: len(C) - len(last)][::2] @ C[1::2], last])
    return np.asarray(C[0])
