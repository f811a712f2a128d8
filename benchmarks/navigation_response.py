"""How a navigation solution answers to small errors: finite differences of the nonlinear
mechanization, no error model.

A noise-free run is navigated from its true start (the nominal), and again with one start value or
one constant sensor error moved up and down. The differences give, at every epoch k, the response
M_k to the seven start errors and B_k to six constant sensor errors. Between epochs:

    Phi = M_{k+1} M_k^-1,    Gamma = B_{k+1} - Phi B_k

so that an error that acts in one epoch alone (white noise, a bias that changes) is answered without
a formula for it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ins.attitude import dcm_from_rotation_vector, rotation_vector_from_dcm
from ins.earth import geodetic_from_ecef, radii_of_curvature
from ins.records import ImuLog, NavHistory, NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG_PER_HOUR, MICRO_G
from trajectories.simulator.sensors import IdealSensors

ERRORS = 7  # position N, E [m]; velocity N, E [m/s]; rotation computed - true, NED [rad]
SHOWN = 3  # what a vehicle shows within an epoch: way along body x, y [m], turn about down [rad]
SENSORS = 6  # gyros x, y, z [rad/s]; accelerometers x, y, z [m/s^2]
HELD = VerticalChannel(mode="hold")
START_STEP = np.array([10.0, 10.0, 0.01, 0.01, 1e-5, 1e-5, 1e-4])
SENSOR_STEP = np.repeat([0.01 * DEG_PER_HOUR, 10 * MICRO_G], 3)


@dataclass(frozen=True)
class NavigationResponse:
    """Linear response of a solution over n epochs, and the nominal it belongs to.

    Phi (n, 7, 7), Gamma (n, 7, 6): of the errors at an epoch's end to those at its start and to
    sensor errors within it. shown_Phi (n, 3, 7), shown_Gamma (n, 3, 6): the same of body way x, y
    and turn over the epoch. nominal: navigation history of n + 1 rows; row k starts epoch k.
    """

    Phi: NDArray
    Gamma: NDArray
    shown_Phi: NDArray
    shown_Gamma: NDArray
    nominal: NavHistory


def navigation_response(
    ideal: IdealSensors, *, epoch_s: float = 1.0, vertical: VerticalChannel = HELD
) -> NavigationResponse:
    """Response of the free-running solution over a noise-free run that starts at rest; vertical:
    what tells it its height.
    """
    log = ImuLog(
        time_s=ideal.time_s,
        dt_s=np.full(ideal.time_s.size, ideal.dt_s),
        dtheta_rad=ideal.dtheta_rad,
        dv_m_s=ideal.dv_m_s,
    )
    nominal = _navigated(ideal, log, np.zeros(ERRORS + SENSORS), epoch_s, vertical)

    def derivative(start: NDArray, sensor: NDArray) -> tuple[NDArray, NDArray]:
        up, down = (
            _departure(
                nominal,
                _navigated(ideal, log, s * np.concatenate([start, sensor]), epoch_s, vertical),
            )
            for s in (1.0, -1.0)
        )
        return (up[0] - down[0]) / 2.0, (up[1] - down[1]) / 2.0

    zero_start, zero_sensor = np.zeros(ERRORS), np.zeros(SENSORS)
    starts = [derivative(row, zero_sensor) for row in np.diag(START_STEP)]
    sensors = [derivative(zero_start, row) for row in np.diag(SENSOR_STEP)]
    M, M_way = (np.stack(column, axis=-1) for column in zip(*starts))
    B, B_way = (np.stack(column, axis=-1) / SENSOR_STEP for column in zip(*sensors))
    Phi = np.swapaxes(np.linalg.solve(np.swapaxes(M[:-1], 1, 2), np.swapaxes(M[1:], 1, 2)), 1, 2)
    way_Phi = np.swapaxes(
        np.linalg.solve(np.swapaxes(M[:-1], 1, 2), np.swapaxes(M_way[1:], 1, 2)), 1, 2
    )
    Gamma, way_Gamma = B[1:] - Phi @ B[:-1], B_way[1:] - way_Phi @ B[:-1]
    turn = Phi[:, 6:] - np.eye(ERRORS)[6:]
    return NavigationResponse(
        Phi=Phi,
        Gamma=Gamma,
        shown_Phi=np.concatenate([way_Phi, turn], axis=1),
        shown_Gamma=np.concatenate([way_Gamma, Gamma[:, 6:]], axis=1),
        nominal=nominal,
    )


def _navigated(
    ideal: IdealSensors, log: ImuLog, errors: NDArray, epoch_s: float, vertical: VerticalChannel
) -> NavHistory:
    """The run navigated with start errors (7,) and, after them, constant sensor errors (6,)."""
    start, sensor = errors[:ERRORS], errors[ERRORS:]
    truth, dt = ideal.truth, ideal.dt_s
    lat, lon, height = (float(v[0]) for v in geodetic_from_ecef(truth.kinematics(np.zeros(1)).r_e))
    meridian, transverse = (float(r) for r in radii_of_curvature(lat))
    site = Site(
        lat_rad=lat + start[0] / (meridian + height),
        lon_rad=lon + start[1] / ((transverse + height) * np.cos(lat)),
        height_m=height,
    )
    initial = NavState(
        time_s=0.0,
        site=site,
        v_n_m_s=np.array([start[2], start[3], 0.0]),
        C_nb=dcm_from_rotation_vector(start[4:]) @ ideal.C_nb[0],
    )
    wrong = replace(
        log, dtheta_rad=log.dtheta_rad + sensor[:3] * dt, dv_m_s=log.dv_m_s + sensor[3:] * dt
    )
    return navigate(wrong, initial, epoch_s=epoch_s, vertical=vertical)


def _departure(nominal: NavHistory, other: NavHistory) -> tuple[NDArray, NDArray]:
    """Errors (n + 1, 7) of another solution against the nominal, and its excess of body way per
    epoch (n + 1, 2).
    """
    meridian, transverse = radii_of_curvature(nominal.lat_rad)
    north = (other.lat_rad - nominal.lat_rad) * (meridian + nominal.height_m)
    east = (
        (other.lon_rad - nominal.lon_rad)
        * (transverse + nominal.height_m)
        * np.cos(nominal.lat_rad)
    )
    turned = rotation_vector_from_dcm(other.C_nb @ np.swapaxes(nominal.C_nb, 1, 2))
    velocity = (other.v_n_m_s - nominal.v_n_m_s)[:, :2]
    errors = np.concatenate([north[:, None], east[:, None], velocity, turned], axis=1)
    return errors, (other.displacement_b_m - nominal.displacement_b_m)[:, :2]
