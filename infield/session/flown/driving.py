"""How the further states of a flight drive the errors of its solution, step by step, and fade.

What each makes a sensor read too much: `ins.estimation.sensors`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.kinds import STILL
from alignment.navigation_filter import StepPlan, StepViews
from infield.session.flown.priors import Further, Layout
from infield.session.settings import FlightPriors
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.estimation import sensors
from ins.estimation.tape import Tape
from ins.records import NavHistory


@dataclass(frozen=True)
class BodyMotion:
    """What each step (K) turned and was pushed by, body axes: (K, 3) [rad] and [m/s]; degrees
    (K,) [degC] above the session's mean temperature.
    """

    turned_rad: NDArray
    pushed_m_s: NDArray
    above_degC: NDArray


def body_motion(
    history: NavHistory, plan: StepPlan, views: StepViews, temperature: GyroTemperature
) -> BodyMotion:
    """Sums over the planned steps; the accelerometers are taken as warm as the gyros' mean."""
    last = plan.last[-1] + 1
    turned = np.add.reduceat(history.dtheta_b_rad[1:last], plan.first)
    pushed_n = np.add.reduceat(history.dv_f_n_m_s[1:last], plan.first)
    pushed = np.einsum("kji,kj->ki", views.C_mean, pushed_n)
    degC = temperature.at(0.5 * (views.start_s + views.end_s)).mean(axis=1)
    return BodyMotion(turned, pushed, degC - float(np.average(degC, weights=views.dt_s)))


@dataclass(frozen=True)
class Driving:
    """An aid that measures nothing: it lets the further states act."""

    layout: Layout
    priors: FlightPriors
    body: BodyMotion
    flying: NDArray  # (K,) bool

    def measure(self, tape: Tape, views: StepViews) -> None:
        """Lay down how the states fade and how they drive.

        A standing vehicle's gyros are taken as their bins have them: the table is of units at rest.
        """
        self._fade(tape, views)
        states, body = self.layout.indices, self.body
        still = (views.kind == STILL)[:, None]
        force_b = body.pushed_m_s / views.dt_s[:, None]
        turns_b = np.where(still, 0.0, body.turned_rad / views.dt_s[:, None])
        sensors.gyro_scales(tape, states(Further.GYRO_SCALE), turns_b)
        sensors.misalignments(tape, states(Further.MISALIGNMENT), turns_b)
        sensors.gyro_shifts(tape, states(Further.SHIFT), self.flying)
        pushed_b = np.where(still, sensors.REST_B, force_b)
        sensors.force_sensitivities(tape, states(Further.FORCE), pushed_b)
        sensors.accelerometer_biases(tape, states(Further.ACCEL_Z), first_axis=2)
        sensors.accelerometer_scales(tape, states(Further.ACCEL_SCALE), force_b)
        sensors.accelerometer_shifts(tape, states(Further.ACCEL_SHIFT), self.flying)
        sensors.accelerometer_slopes(tape, states(Further.ACCEL_SLOPE), body.above_degC)
        sensors.deflections(tape, states(Further.DEFLECTION))

    def _fade(self, tape: Tape, views: StepViews) -> None:
        """First-order Gauss-Markov processes over time, and over the way flown."""
        every, p = np.arange(len(views.kind)), self.priors
        way = np.linalg.norm(views.displacement_n_m[:, :2], axis=1)
        way = np.where(views.kind == STILL, 0.0, way)
        lengths = {
            Further.SLOW_POSITION: views.dt_s / p.slow_position_s,
            Further.SLOW_VELOCITY: views.dt_s / p.slow_velocity_s,
            Further.DEFLECTION: way / p.deflection_m,
        }
        for state, length in lengths.items():
            kept = np.exp(-length)
            for k in self.layout.indices(state):
                sigma = self.layout.sigma[k - self.layout.first]
                tape.assign(every, k, {k: kept}, sigma**2 * (1.0 - kept**2))
