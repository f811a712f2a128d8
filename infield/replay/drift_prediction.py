"""How far the table's sigma, the session's own bias and the noise say that a parked free-inertial
solution drifts.

The prior of the session's bias bins goes through the linear error model of the parked case
(physics.md 6.2), from a gyrocompass alignment on, so that what the alignment hides (a constant east
bias) does not count.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude, omega_ie_n, radii_of_curvature
from ins.estimation import error_model as em
from ins.estimation.tape import GYRO
from ins.noise import accel_densities, gyro_densities
from ins.records import Site, TwinModel
from ins.units import DEG_PER_HOUR, KNOT, MICRO_G

NM_H_PER_DEG_H = 60.0  # mean drift of one level gyro's bias: R u, physics.md 6.3
PREDICTION_STEP_S = 10.0


@dataclass(frozen=True, kw_only=True)
class DriftPrediction:
    """What the table's covariance, the session's own bias and the noise make of a parked
    free-inertial solution.

    time_s (n,): since navigation began; sigma_radial_m, sigma_speed_m_s (n,): root of the trace of
    north and east. response_m_per_deg_h (2, 3N): north and east position error at the end from the
    gyro bias of each bin.
    """

    time_s: NDArray
    sigma_radial_m: NDArray
    sigma_speed_m_s: NDArray
    response_m_per_deg_h: NDArray

    @property
    def sigma_nm_h(self) -> float:
        """Comparable with `Drift.rate_nm_h` (whose RMS it is)."""
        return float(self.sigma_radial_m[-1] / self.time_s[-1] / KNOT)


def predict_parked(
    *,
    edges_s: NDArray,
    covariance: NDArray,
    twin: TwinModel,
    site: Site,
    C_nb: NDArray,
    alignment: tuple[float, float],
    end_s: float,
) -> DriftPrediction:
    """Covariance of the parked drift from the end of a gyrocompass alignment to `end_s`.

    Parameters
    ----------
    edges_s (N + 1,), covariance (3N, 3N) [(deg/h)^2] : bins and what the gyros' bias beyond the
    table may be in them
        (`infield.session.bins.SessionBins.prior`), order x, y, z of bin 0, then of bin 1 ...
    C_nb (3, 3) : the parked attitude.
    alignment : (start, end) [s]; navigation begins at its end.

    Notes
    -----
    The alignment leaves tilts that balance the accelerometer biases and, for heading, psi = -eps_E
    / (Omega cosL) + (del_E / g) tanL with eps_E its mean east gyro error (physics.md 6.4): so a
    constant east bias does not drift at the parked heading, and the angle random walk of the
    alignment does. From there on ins.estimation.error_model, in steps of at most 10 s. Left out:
    yaw creep and sway of the aircraft (no inertial errors), the velocity error at the start (it is
    set to zero, true to the sway).
    """
    start_s, count = alignment[1], len(edges_s) - 1
    response = aligned_errors(edges_s, site, C_nb, alignment)
    P = np.zeros((em.BASE, em.BASE))
    level_rate = EARTH_RATE_RAD_S * np.cos(site.lat_rad)
    arw = gyro_densities(twin.gyro).white
    down = em.THETA.stop - 1
    P[down, down] = arw**2 / (alignment[1] - alignment[0]) / level_rate**2
    inputs = np.zeros((3 * count + 2, 3 * count + 2))
    inputs[: 3 * count, : 3 * count] = covariance
    inputs[3 * count :, 3 * count :] = (twin.accel.turn_on_ug * MICRO_G) ** 2 * np.eye(2)
    times = np.append(np.arange(start_s, end_s - 1e-3, PREDICTION_STEP_S), end_s)
    variance = np.zeros((times.size, 2))  # of speed and position, both axes
    for k in range(1, times.size):
        Phi, Gamma, Q = parked_step(site, C_nb, twin, float(times[k] - times[k - 1]))
        response, P = Phi @ response, Phi @ P @ Phi.T + Q
        j = int(
            np.clip(np.searchsorted(edges_s, 0.5 * (times[k] + times[k - 1])) - 1, 0, count - 1)
        )
        response[:, 3 * j : 3 * j + 3] += Gamma[:, GYRO : GYRO + 3] * DEG_PER_HOUR
        for column, errors in enumerate((em.W, em.POS)):
            of_inputs = response[errors] @ inputs @ response[errors].T
            variance[k, column] = np.trace(of_inputs + P[errors, errors])
    return DriftPrediction(
        time_s=times[1:] - start_s,
        sigma_speed_m_s=np.sqrt(variance[1:, 0]),
        sigma_radial_m=np.sqrt(variance[1:, 1]),
        response_m_per_deg_h=response[em.POS, : 3 * count],
    )


def level_shares(edges_s: NDArray, C_nb: NDArray, span: tuple[float, float]) -> NDArray:
    """Rows (2, 3N) that take binned gyro biases to their mean north and east parts over a span."""
    overlap = np.minimum(edges_s[1:], span[1]) - np.maximum(edges_s[:-1], span[0])
    share = np.maximum(overlap, 0.0)
    if not share.sum() > 0:
        share[-1 if span[0] >= edges_s[-1] else 0] = 1.0
    return np.kron(share / share.sum(), C_nb[:2])


def aligned_errors(
    edges_s: NDArray, site: Site, C_nb: NDArray, alignment: tuple[float, float]
) -> NDArray:
    """Errors (42, 3N + 2) at the end of the alignment, per deg/h of each bin and per m/s^2 of
    accelerometer bias.
    """
    count = len(edges_s) - 1
    X = np.zeros((em.BASE, 3 * count + 2))
    north, east, down = range(em.THETA.start, em.THETA.stop)
    g = float(gravity_magnitude(site.lat_rad, site.height_m))
    level_rate = EARTH_RATE_RAD_S * np.cos(site.lat_rad)
    X[em.ACCEL, 3 * count :] = np.eye(2)
    X[north, 3 * count :] = -C_nb[1, :2] / g
    X[east, 3 * count :] = C_nb[0, :2] / g
    X[down, 3 * count :] = C_nb[1, :2] / g * np.tan(site.lat_rad)
    X[down, : 3 * count] = -level_shares(edges_s, C_nb, alignment)[1] * DEG_PER_HOUR / level_rate
    return X


def parked_step(
    site: Site, C_nb: NDArray, twin: TwinModel, dt_s: float
) -> tuple[NDArray, NDArray, NDArray]:
    """Phi, Gamma, Q of a parked step (ins.estimation.error_model)."""
    step = em.Step(
        dt_s=dt_s,
        C_nb=C_nb,
        v_n=np.zeros(3),
        omega_ie_n=omega_ie_n(site.lat_rad),
        omega_en_n=np.zeros(3),
        gravity=float(gravity_magnitude(site.lat_rad, site.height_m)),
        radius_m=float(np.sqrt(np.prod(radii_of_curvature(site.lat_rad)))) + site.height_m,
        turn_rad=0.0,
    )
    accel = accel_densities(twin.accel)
    noise = em.ProcessNoise(
        arw=gyro_densities(twin.gyro).white,
        vrw=accel.white,
        accel_rrw=accel.walk,
        yaw_creep=0.0,
        lateral_rms=1.0,
        lateral_time_s=1.0,
    )
    return em.discretize(step, noise, rolling=False)
