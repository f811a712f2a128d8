"""How the further states of a flight drive the errors of its solution, step by step.

Equations: `ins.filters.error_model`. What a gyro reads too much, eps dt in body axes, turns the
drift angle by C eps dt and, as there, the velocity error by v x C eps dt; what an accelerometer
reads too much changes the velocity error by C del dt; a deflected vertical by g times the angle.
Written as assignments at the end of each step, half of a step's drive before it and half after, so
that a place is right to the second order: all of it after the step let the filter take a deflected
vertical for another acceleration than a tilt wherever steps of 10 s met steps of 1 s, and sigmas of
x and y were 3 % below the Cramer-Rao bound.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alignment.motion.kinds import STILL
from alignment.navigation_filter import StepPlan, StepViews
from infield.session.flown.priors import Further, Layout
from infield.session.settings import FlightPriors
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.earth import gravity_magnitude
from ins.filters.program import FilterProgram
from ins.filters.states import THETA, W
from ins.records import NavHistory
from ins.units import STANDARD_GRAVITY

MISALIGNED = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  # gyro, axis whose rate it reads


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

    def measure(self, program: FilterProgram, views: StepViews) -> None:
        """Lay down how the states fade and how they drive."""
        self._fade(program, views)
        still = views.kind == STILL
        of_gyros = self._of_gyros(views.dt_s)
        turn = {k: np.einsum("kij,kj->ki", views.C_mean, rows) for k, rows in of_gyros.items()}
        turn = {k: np.where(still[:, None], 0.0, rows) for k, rows in turn.items()}
        v_n = views.displacement_n_m / views.dt_s[:, None]
        every = np.arange(len(views.kind))
        for i in range(3):
            state = THETA.start + i
            row: dict[int, ArrayLike] = {state: 1.0}
            row.update({k: by_halves(rows[:, i]) for k, rows in turn.items()})
            program.assign(every, state, row, 0.0)
        push = {k: np.cross(v_n, rows) for k, rows in turn.items()}
        of_accels = self._of_accelerometers(views)
        push.update(
            {k: np.einsum("kij,kj->ki", views.C_mean, rows) for k, rows in of_accels.items()}
        )
        gravity = gravity_magnitude(views.lat_rad, views.height_m) * views.dt_s
        for i in range(2):
            state = W.start + i
            row = {state: 1.0}
            row.update({k: by_halves(rows[:, i]) for k, rows in push.items()})
            if Further.DEFLECTION in self.layout.at:
                row[self.layout.indices(Further.DEFLECTION)[i]] = by_halves(gravity)
            program.assign(every, state, row, 0.0)

    def _fade(self, program: FilterProgram, views: StepViews) -> None:
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
                program.assign(every, k, {k: kept}, sigma**2 * (1.0 - kept**2))

    def _of_gyros(self, dt_s: NDArray) -> dict[int, NDArray]:
        """What each state makes a gyro read too much over each step, body axes (K, 3) [rad]."""
        turned, count = self.body.turned_rad, len(self.flying)
        found: dict[int, NDArray] = {}

        def reads(index: int, gyro: int, amount: NDArray) -> None:
            found[index] = np.zeros((count, 3))
            found[index][:, gyro] = amount

        for gyro, k in enumerate(self.layout.indices(Further.GYRO_SCALE)):
            reads(k, gyro, turned[:, gyro])
        for (gyro, axis), k in zip(MISALIGNED, self.layout.indices(Further.MISALIGNMENT)):
            reads(k, gyro, turned[:, axis])
        for gyro, k in enumerate(self.layout.indices(Further.SHIFT)):
            reads(k, gyro, np.where(self.flying, dt_s, 0.0))
        for gyro, k in enumerate(self.layout.indices(Further.FORCE)):
            at_rest = -STANDARD_GRAVITY * dt_s if gyro == 2 else 0.0
            reads(k, gyro, self.body.pushed_m_s[:, gyro] - at_rest)
        return found

    def _of_accelerometers(self, views: StepViews) -> dict[int, NDArray]:
        """The same of the accelerometers [m/s]."""
        dt, count = views.dt_s, len(self.flying)
        found: dict[int, NDArray] = {}
        for k in self.layout.indices(Further.ACCEL_Z):
            found[k] = np.column_stack([np.zeros(count), np.zeros(count), dt])
        for axis, k in enumerate(self.layout.indices(Further.ACCEL_SCALE)):
            found[k] = np.zeros((count, 3))
            found[k][:, axis] = self.body.pushed_m_s[:, axis]
        for axis, k in enumerate(self.layout.indices(Further.ACCEL_SHIFT)):
            found[k] = np.zeros((count, 3))
            found[k][:, axis] = np.where(self.flying, dt, 0.0)
        for axis, k in enumerate(self.layout.indices(Further.ACCEL_SLOPE)):
            found[k] = np.zeros((count, 3))
            found[k][:, axis] = self.body.above_degC * dt
        return found


def by_halves(over: NDArray) -> NDArray:
    """What acts over each step (K,), half of it before the step and half after: at the end of each
    step its own half and the next one's.
    """
    later = np.append(over[1:], 0.0)
    return np.asarray(0.5 * (over + later))
