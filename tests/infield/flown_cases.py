"""A short session that flies, for the tests of flights: an ideal run made once, its sessions, and
the linear errors of its noise-free solution.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from alignment.motion.kinds import ROLLING, STILL
from alignment.motion.stillness import Motion
from alignment.navigation_filter import filter_steps, plan_steps, process_noise, views_of
from infield.session.flown.passes import Driving, body_motion
from infield.session.flown.priors import laid_out
from infield.session.log import table_series
from infield.session.settings import SessionSettings
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.estimation import error_model as em
from ins.estimation.error_filter import ErrorFilter
from ins.estimation.tape import Tape
from ins.records import ImuLog, NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG
from tests.infield.flight_errors import FlightErrors, with_flight_errors
from tests.infield.sessions import TWIN, factory, unit
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Descend,
    Landing,
    Park,
    Stop,
    Straight,
    TakeOff,
    Turn,
    TurnFlight,
)
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import ThermalHistory
from trajectories.simulator.truth import build_truth

SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
RATE_HZ = 10.0
ANTENNA_M = (1.5, -0.4, -1.8)
FLIGHT = (
    Park(duration_s=900.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=60.0),
    TakeOff(),
    Climb(height_m=3000.0),
    TurnFlight(angle_deg=120.0),
    Cruise(duration_s=600.0),
    TurnFlight(angle_deg=-90.0),
    Cruise(duration_s=300.0),
    Descend(height_m=600.0),
    TurnFlight(angle_deg=100.0),
    Landing(),
    Straight(duration_s=30.0),
    Stop(duration_s=5.0),
    Park(duration_s=300.0),
)
COLD = ThermalHistory(
    ambient_degC=8.0,
    start_degC=8.0,
    settled_degC=30.0,
    flight_degC=-40.0,
    flight_start_s=1200.0,
    flight_end_s=2600.0,
    flight_tau_s=1200.0,
)


@lru_cache(maxsize=1)
def ideal_flight():
    return ideal_sensors(build_truth(lay(FLIGHT), SITE, heading_rad=0.4), RATE_HZ)


def flown(seed=1, errors=None, *, with_gnss=True, gyro=None):
    """A simulated flight; errors: of receiver and unit; gyro: of the truth, None: the twin's."""
    rng = np.random.default_rng([99, seed])
    truth = TWIN if gyro is None else replace(TWIN, gyro=gyro)
    plan = SessionPlan(with_gnss=with_gnss, gnss_lever_arm_m=ANTENNA_M, run_id=f"flight-{seed}")
    simulated = simulate_run(ideal_flight(), COLD, unit(), truth, rng=rng, plan=plan)
    errors = errors or FlightErrors(slow_position_m=1.5)
    return with_flight_errors(simulated, ideal_flight(), errors, rng)


def bin_errors(simulated, result):
    """Estimate less truth (3N,) of the bins' biases beyond the factory table [deg/h]."""
    estimate, time_s = result.estimate, simulated.bias_time_s
    low, high = (f(result.temperature.temperature_degC) for f in (np.min, np.max))
    of_table = table_series(factory().extended_to(low, high), result.temperature)
    true = simulated.gyro_bias_true_deg_h - of_table(time_s)
    bins = estimate.bins
    means = [
        true[(time_s >= a) & (time_s < b)].mean(axis=0) for a, b in zip(bins.start_s, bins.end_s)
    ]
    return estimate.mean_deg_h - np.ravel(means)


@dataclass(frozen=True)
class Noiseless:
    """The noise-free log, its true start, and when it leaves its rest."""

    log: ImuLog
    start: NavState
    moves_s: float
    vertical: VerticalChannel


@lru_cache(maxsize=1)
def noiseless():
    ideal = ideal_flight()
    log = ImuLog(
        time_s=ideal.time_s,
        dt_s=np.full(ideal.time_s.size, ideal.dt_s),
        dtheta_rad=ideal.dtheta_rad,
        dv_m_s=ideal.dv_m_s,
    )
    first = ideal.time_s[np.flatnonzero(~ideal.at_rest)[0]]
    moves_s = float(np.floor(first)) - 2.0
    k = int(np.searchsorted(ideal.time_s, moves_s))
    start = NavState(
        time_s=float(ideal.time_s[k]), site=SITE, v_n_m_s=np.zeros(3), C_nb=ideal.C_nb[k]
    )
    heights = VerticalChannel(
        mode="aided", time_s=ideal.time_s[::10], height_m=ideal.height_m[::10]
    )
    return Noiseless(log, start, moves_s, heights)


@lru_cache(maxsize=1)
def nominal():
    """The solution of the noise-free log."""
    return solution(noiseless().log)


def solution(log):
    """The nonlinear solution of a log from the true start."""
    case = noiseless()
    return navigate(log, case.start, vertical=case.vertical)


def layout_of(technology="rlg"):
    settings = SessionSettings()
    return laid_out(settings.flight, technology, first=em.BASE + 3, scale_ppm=5.0, accel_z_ug=30.0)


def predicted(index, size):
    """Linear errors at the end where a further state is `size`: velocity and position, level."""
    history = nominal()
    kind = np.full(history.time_s.size, int(ROLLING))
    kind[0] = STILL
    motion = Motion(history.time_s, kind, np.zeros(kind.size), 1e-3)
    plan = plan_steps(motion, np.array([history.time_s[0], history.time_s[-1] + 1.0]))
    views = views_of(history, plan)
    tape = Tape(filter_steps(views))
    layout = layout_of()
    temperature = gyro_temperature(flown().run.temperature)
    body = body_motion(history, plan, views, temperature)
    ideal = ideal_flight()
    in_air = np.interp(0.5 * (views.start_s + views.end_s), ideal.time_s, 1.0 - ideal.on_wheels)
    Driving(layout, SessionSettings().flight, body, in_air > 0.5).measure(tape, views)
    flt = ErrorFilter(
        sigma0={},
        noise=process_noise(TWIN),
        bias_mean=np.zeros(3),
        bias_covariance=np.zeros((3, 3)),
        further_sigma=tuple(layout.sigma),
    )
    flt.x[index] = size
    flt.run(tape)
    v, w, p, theta = history.v_n_m_s[-1], flt.x[em.W], flt.x[em.POS], flt.x[em.THETA]
    return np.append(w + np.cross(theta, v)[:2], p), body, views
