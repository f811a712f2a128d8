"""Cramer-Rao bound of the gyros' session means in a session that flies, and how near the update
comes to it.

    python -m benchmarks run flight_bound --technology rlg

The bound is that of `benchmarks.cramer_rao`, kept apart from the estimator as there: responses by
finite differences of the nonlinear mechanization, height from the truth; recursion over epochs of
one second. A flight adds unknowns: slow errors of the receiver, antenna and delays, deflection of
the vertical along the track, scale, shift and slope of the accelerometers, scale, misalignment and
shift of the gyros, each drawn as `benchmarks.flight_errors` draws it. In the air nothing is seen
but the receiver, once a second.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.cramer_rao import (
    MODES,
    Epoch,
    Sights,
    Spread,
    bias_modes,
    session_epochs,
    session_prior,
)
from benchmarks.flight_update import (
    FLIGHTS_OF_A_PLACE,
    HEADINGS_DEG,
    THERMAL,
    drawn_session,
    ideal_session,
    mean_rows,
)
from benchmarks.navigation_response import NavigationResponse, navigation_response
from benchmarks.study import Work, table
from infield.session.one_run import take_run
from infield.session.settings import FlightPriors, SessionSettings
from ins.earth import gravity_magnitude
from ins.records import TwinModel
from ins.strapdown.mechanization import VerticalChannel
from ins.twin_file import default_twin
from ins.units import DEG_PER_HOUR, MICRO_G, MILLIRADIAN, PPM
from trajectories.simulator.sensors import IdealSensors

ASSUMED = SessionSettings(flight=FlightPriors().assumed)
AGEING = Spread(common_deg_h=0.006, shape_deg_h=0.004)  # as trajectories.simulator.unit_truth
AIRBORNE_SHARE = 0.5  # of an epoch's rows that are off their wheels
# The state: that of cramer_rao up to its modes, what fades, the flight's constants, the modes.
SLOW_PLACE, SLOW_SPEED, DEFLECTED = slice(MODES, MODES + 2), slice(23, 25), slice(25, 27)
MOVES = MODES + 6  # states that do not stand still
A_SCALE, A_SLOPE, A_SHIFT = range(MOVES, MOVES + 3), range(30, 33), range(33, 36)
G_SCALE, G_TURNED, G_SHIFT = range(36, 39), range(39, 45), range(45, 48)
ANTENNA, DELAYS = range(48, 51), range(51, 53)
FIRST_MODE = 53
# of gyro x by y and z, of y by x and z, of z by x and y
READER, READ = (0, 0, 1, 1, 2, 2), (1, 2, 0, 2, 0, 1)


@dataclass(frozen=True)
class Epochs:
    """What each epoch of a noise-free run is: mean angular rate and specific force (n, 3), body;
    off its wheels (n,); warmer than at the start (n,) [degC]; way over it (n,) [m].
    """

    rate_b: NDArray
    force_b: NDArray
    flies: NDArray
    warmer_degC: NDArray
    way_m: NDArray


def epochs_of(ideal: IdealSensors, response: NavigationResponse) -> Epochs:
    """The epochs of a response from the rows of its run."""
    t = response.nominal.time_s
    of = np.searchsorted(t[1:], ideal.time_s - 0.5 * ideal.dt_s)
    inside = of < len(response.Phi)
    of, count = of[inside], np.bincount(of[inside])
    middle = 0.5 * (t[1:] + t[:-1])
    degC = THERMAL.at(np.concatenate([t[:1], middle])).gyro_degC.mean(axis=1)

    def mean(rows: NDArray) -> NDArray:
        return np.stack([np.bincount(of, column[inside]) / count for column in rows.T], axis=1)

    wheels = np.bincount(of, np.asarray(ideal.on_wheels, dtype=float)[inside]) / count
    speed = np.linalg.norm(response.nominal.v_n_m_s[1:], axis=1)
    return Epochs(
        rate_b=mean(ideal.dtheta_rad) / ideal.dt_s,
        force_b=mean(ideal.dv_m_s) / ideal.dt_s,
        flies=1.0 - wheels,
        warmer_degC=degC[1:] - degC[0],
        way_m=speed * np.diff(t),
    )


def flight_prior(
    twin: TwinModel, technology: str, settings: SessionSettings, modes: int
) -> NDArray:
    """Prior covariance of the whole state."""
    p = settings.flight
    sigma = np.concatenate(
        [
            np.sqrt(np.diag(session_prior(twin, AGEING, 0))),
            np.full(2, p.slow_position_m),
            np.full(2, p.slow_velocity_m_s),
            np.full(2, p.deflection_rad),
            np.full(3, p.accel_scale_ppm[technology] * PPM),
            np.full(3, p.accel_slope_ug_degC[technology] * MICRO_G),
            np.full(3, p.accel_shift_ug[technology] * MICRO_G),
            np.full(3, settings.sigma_scale_factor_ppm[technology] * PPM),
            np.full(6, p.misalignment_mrad[technology] * MILLIRADIAN),
            np.full(3, p.shift_deg_h[technology] * DEG_PER_HOUR),
            np.full(3, p.antenna_m),
            np.full(2, p.delay_s),
            np.ones(modes),
        ]
    )
    return np.diag(sigma**2)


def _drives(epochs: Epochs, k: int) -> NDArray:
    """What the constants add to gyros and accelerometers in epoch k (6, FIRST_MODE)."""
    D = np.zeros((6, FIRST_MODE))
    for i in range(3):
        D[i, G_SCALE[i]] = epochs.rate_b[k, i]
        D[i, G_SHIFT[i]] = epochs.flies[k]
        D[3 + i, A_SCALE[i]] = epochs.force_b[k, i]
        D[3 + i, A_SLOPE[i]] = epochs.warmer_degC[k]
        D[3 + i, A_SHIFT[i]] = epochs.flies[k]
    for j, (reader, read) in enumerate(zip(READER, READ)):
        D[reader, G_TURNED[j]] = epochs.rate_b[k, read]
    return D


def flight_bound(
    ideal: IdealSensors, technology: str, settings: SessionSettings = ASSUMED
) -> NDArray:
    """Covariance (3, 3) [(deg/h)^2] of the gyros' means over the session; nuisances as settings
    say.
    """
    height = VerticalChannel(mode="aided", time_s=ideal.time_s, height_m=ideal.height_m)
    response = navigation_response(ideal, vertical=height)
    t, twin = response.nominal.time_s, default_twin(technology)
    gyro_degC = THERMAL.at(0.5 * (t[1:] + t[:-1])).gyro_degC
    modes = bias_modes(gyro_degC, twin.gyro, AGEING, epoch_s=float(t[1] - t[0]))
    P = flight_prior(twin, technology, settings, modes.shape[2])
    epochs = epochs_of(ideal, response)
    p = settings.flight
    on_ground = session_epochs(ideal, response, modes, twin, Sights(gnss=True), 600.0)
    for k, epoch in enumerate(on_ground):
        P = _stepped(P, _widened(epoch, response, epochs, k), *_fades(epochs, k, p))
    mean = modes.mean(axis=0) / DEG_PER_HOUR
    return np.asarray(mean @ P[FIRST_MODE:, FIRST_MODE:] @ mean.T)


def _fades(epochs: Epochs, k: int, p: FlightPriors) -> tuple[NDArray, NDArray]:
    """Transition and noise (6,) of what fades, over an epoch of one second."""
    kept = np.exp(
        -np.repeat(
            [1.0 / p.slow_position_s, 1.0 / p.slow_velocity_s, epochs.way_m[k] / p.deflection_m], 2
        )
    )
    sigma = np.repeat([p.slow_position_m, p.slow_velocity_m_s, p.deflection_rad], 2)
    return kept, sigma**2 * (1.0 - kept**2)


def _widened(epoch: Epoch, response: NavigationResponse, epochs: Epochs, k: int) -> Epoch:
    """An epoch of the ground's state with the flight's: F (MOVES, n) are its moving rows."""
    size = FIRST_MODE + epoch.F.shape[1] - MODES
    F = np.zeros((MOVES, size))
    F[:MODES, :MODES], F[:MODES, FIRST_MODE:] = epoch.F[:MODES, :MODES], epoch.F[:MODES, MODES:]
    gamma = np.concatenate([response.Gamma[k], response.shown_Gamma[k]])
    C = response.nominal.C_nb[k + 1]
    F[:10, :FIRST_MODE] += gamma @ _drives(epochs, k)
    pull = gravity_magnitude(response.nominal.lat_rad[k], response.nominal.height_m[k])
    F[:10, DEFLECTED] += gamma[:, 3:] @ C[:2].T * float(pull)
    Q = epoch.Q[:MODES, :MODES]
    H, R = [], []
    for row, variance in zip(epoch.H, epoch.R):
        of = int(np.flatnonzero(row)[0])
        wide = np.zeros(size)
        wide[of] = 1.0
        if of < 4:
            _heard(wide, of, response, epochs, k)
        elif epochs.flies[k] > AIRBORNE_SHARE:
            continue
        H.append(wide)
        R.append(variance)
    return Epoch(F, Q, np.array(H), np.array(R))


def _heard(row: NDArray, of: int, response: NavigationResponse, epochs: Epochs, k: int) -> None:
    """The receiver's own states in a position (of 0, 1) or a velocity (2, 3), north or east."""
    nominal, axis = response.nominal, of % 2
    C = nominal.C_nb[k + 1]
    if of < 2:
        row[SLOW_PLACE.start + axis] = 1.0
        row[list(ANTENNA)] = C[axis]
        row[DELAYS[0]] = -nominal.v_n_m_s[k + 1, axis]
        return
    x, y, z = epochs.rate_b[k]
    row[SLOW_SPEED.start + axis] = 1.0
    row[list(ANTENNA)] = C[axis] @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    row[DELAYS[1]] = -(nominal.v_n_m_s[k + 1, axis] - nominal.v_n_m_s[k, axis])


def _stepped(P: NDArray, epoch: Epoch, kept: NDArray, fresh: NDArray) -> NDArray:
    """The covariance after an epoch."""
    F = epoch.F
    F[MODES:MOVES, MODES:MOVES] = np.diag(kept)
    top = F @ P
    P[:MOVES, :], P[:, :MOVES] = top, top.T
    P[:MOVES, :MOVES] = top @ F.T
    P[:MODES, :MODES] += epoch.Q
    P[range(MODES, MOVES), range(MODES, MOVES)] += fresh
    for row, variance in zip(epoch.H, epoch.R):
        seen = P @ row
        P -= np.outer(seen, seen / (row @ seen + variance))
    return 0.5 * (P + P.T)


def one(place: int, technology: str) -> dict[str, list[float]]:
    """Sigmas of bound and update at a place of `benchmarks.flight_update` (3,) [deg/h]."""
    bound = np.sqrt(np.diag(flight_bound(ideal_session(place), technology)))
    drawn = drawn_session(place * FLIGHTS_OF_A_PLACE, technology)
    result = take_run(drawn.simulated.run, drawn.table, drawn.twin, ASSUMED, False)
    assert result.estimate is not None
    rows = mean_rows(result.estimate, -np.inf, np.inf)
    sigma = np.sqrt(np.diag(rows @ result.estimate.covariance @ rows.T))
    return {"bound": bound.tolist(), "sigma": sigma.tolist()}


def run(work: Work, *, technology: str = "rlg") -> str:
    """The table of the places: the bound, and the update's sigma over it."""
    found = work.each(one, [(place, technology) for place in range(len(HEADINGS_DEG))])
    rows = []
    for place, line in enumerate(found):
        bound, sigma = np.array(line["bound"]), np.array(line["sigma"])
        ratio = [f"{r:.3f}" for r in sigma / bound]
        rows.append([str(place), *(f"{b:.5f}" for b in bound), *ratio])
    axes = [f"bound {a} [deg/h]" for a in "xyz"] + [f"sigma {a} over it" for a in "xyz"]
    return table(["place", *axes], rows)
