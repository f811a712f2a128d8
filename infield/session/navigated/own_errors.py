"""Errors that installed packages add to the list (`ins.errors.catalogue`), estimated by a session.

A session has states of its own for the errors of the project. What a user declares with a prior of
recipe SESSION becomes one constant state for each coefficient, behind the time bins; it makes gyros
and accelerometers wrong by the error's own trace along the solution.

Decision: docs/decisions/0028-effects-are-formulas.md.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion import kinds
from alignment.motion.inertial import Where
from alignment.navigation_filter import StepViews, views_of
from alignment.result import Solution
from infield.session.bins import SessionBins
from infield.session.estimate import OwnError, OwnErrorsFound
from infield.session.navigated.run_telemetry import navigated, standing, thermal
from infield.session.reasons import OwnErrorState
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.errors.base import ErrorSource
from ins.errors.catalogue import estimated_of_users
from ins.errors.prior import Prior
from ins.errors.telemetry import AIRBORNE, PARKED, ROLLING, Telemetry, Trace
from ins.estimation.tape import ACCELEROMETER, GYRO, Tape
from ins.records import InputError, Run, TwinModel
from ins.units import DEG_PER_HOUR

SESSION = "session"  # recipe of the priors
PROBED_S = 10.0  # of the first rest, over which traces are looked at before there is a solution
SHOWN = {"gyro_rad_s", "accel_m_s2"}  # channels of a trace that drive the filter
REPEATS = "R"  # one coefficient for all runs


@dataclass(frozen=True)
class Carried:
    """A coefficient of an error on a target as a state, and what is to be said of it."""

    source: ErrorSource
    number: int
    prior: Prior
    record: OwnError

    def trace(self, run: Telemetry) -> Trace:
        """What one unit of it adds to a run. InputError where that is not (n, 3), or not finite."""
        name = f"error {self.source.id} on {self.record.target}"
        try:
            trace = self.source.traces(run, self.record.target, {})[self.number]
            driven = [getattr(trace, channel) for channel in sorted(SHOWN)]
        except (TypeError, AttributeError):  # of a stream that is not logged
            raise
        except Exception as broken:  # code of a user's package
            raise InputError(f"{name}: its traces raise {broken!r}") from broken
        for series in driven:
            if series is None:
                continue
            if np.shape(series) != (run.n, 3):
                raise InputError(f"{name}: trace of shape {np.shape(series)}, needed {(run.n, 3)}")
            if not np.all(np.isfinite(series)):
                raise InputError(f"{name}: its trace is not finite")
        return trace

    def one_sigma_deg_h(self, run: Telemetry) -> NDArray:
        """What one sigma of it adds to the gyros (n, 3)."""
        gyro = self.trace(run).gyro_rad_s
        if gyro is None:
            return np.zeros((run.n, 3))
        return np.asarray(self.record.prior_sigma * gyro / DEG_PER_HOUR)


@dataclass(frozen=True)
class LoggedRun:
    """What the traces of a session depend on beside its motion."""

    run: Run
    table: ThermalTable
    temperature: GyroTemperature

    def with_temperatures(self, motion: Telemetry) -> Telemetry:
        """A motion of the run with its temperatures."""
        at = thermal(self.run, self.table, self.temperature, motion.time_s)
        return replace(motion, **at)


@dataclass(frozen=True)
class OwnErrors:
    """What users' errors add to a session: an aid of its filter.

    states: those that are estimated, from the place `first` of the filter on; left_out: the others;
    at_rest_deg_h2 (3,): variance of what they add to the gyros at the first rest; airborne: from
    when to when the run flies [s], where its steps do not say so.
    """

    logged: LoggedRun
    first: int
    states: tuple[Carried, ...] = ()
    left_out: tuple[OwnError, ...] = ()
    at_rest_deg_h2: NDArray | float = 0.0
    airborne: Where = (np.inf, np.inf)

    @property
    def sigma(self) -> tuple[float, ...]:
        """Priors of the states."""
        return tuple(state.record.prior_sigma for state in self.states)

    def measure(self, program: Tape, views: StepViews) -> None:
        """Let the states drive the steps by their traces."""
        if not self.states:
            return
        run = self._along(views)
        for place, state in enumerate(self.states, self.first):
            trace = state.trace(run)
            for kind, series in ((GYRO, trace.gyro_rad_s), (ACCELEROMETER, trace.accel_m_s2)):
                if series is None:
                    continue
                means = _means(run, series, views.start_s, views.end_s)
                for axis in range(3):
                    program.drive(place, kind + axis, means[:, axis])

    def found(self, solution: Solution, bins: SessionBins) -> OwnErrorsFound:
        """What the filter of a solution found of each, and what was left out."""
        if not self.states:
            return OwnErrorsFound(self.left_out)
        flt, run = solution.filter, self._along(views_of(solution.history, solution.plan))
        estimated = [
            replace(
                state.record,
                state=OwnErrorState.ESTIMATED,
                value=float(flt.x[place]),
                sigma=float(np.sqrt(flt.P[place, place])),
            )
            for place, state in enumerate(self.states, self.first)
        ]
        in_common = [
            _means(run, state.one_sigma_deg_h(run), bins.start_s, bins.end_s).ravel()
            for state in self.states
            if state.source.repeats == REPEATS
        ]
        return OwnErrorsFound((*estimated, *self.left_out), tuple(in_common))

    def _along(self, views: StepViews) -> Telemetry:
        """The run as far as the steps go."""
        time_s = views.history.time_s
        last = int(np.searchsorted(time_s, views.end_s[-1] - 1e-6))
        of_step = np.searchsorted(views.end_s, time_s[1 : last + 1] - 1e-6)
        rolls = views.kind >= kinds.ROLLING
        flies = (views.start_s >= self.airborne[0]) & (views.end_s <= self.airborne[1] + 1.0)
        flies = rolls & (flies | (views.kind == kinds.AIRBORNE))
        kind = np.select([flies, rolls], [AIRBORNE, ROLLING], PARKED)
        motion = navigated(self.logged.run, views.history, kind[of_step])
        return self.logged.with_temperatures(motion)


def own_errors(
    logged: LoggedRun, twin: TwinModel, *, rest: Where, attitude: Callable[[], NDArray], first: int
) -> OwnErrors:
    """What users' errors add to a session.

    Parameters
    ----------
    logged : LoggedRun
    twin : TwinModel
        What its `effects` list is known, and not estimated.
    rest : (float, float)
        The first rest [s].
    attitude : callable
        Gives C_nb (3, 3) there; asked where there is such an error.
    first : int
        The first state behind the time bins.

    Returns
    -------
    errors : OwnErrors

    Raises
    ------
    InputError
        A prior is in another unit than its coefficient.
    """
    every = list(_every(logged.run))
    if not every:
        return OwnErrors(logged, first)
    seconds = np.arange(rest[0] + 0.5, rest[0] + PROBED_S)
    probed = logged.with_temperatures(standing(logged.run, seconds, attitude()))
    known = {
        (effect.get("effect"), effect.get("target"))
        for effect in twin.effects
        if "run_id" not in effect.get("parameters", {})
    }
    states, left_out, variance = [], [], np.zeros(3)
    for state in every:
        record = state.record
        why = _against(state, probed)
        if (record.error, record.target) in known:
            why = OwnErrorState.IN_TWIN
        if why is not None:
            left_out.append(replace(record, state=why))
            continue
        states.append(state)
        variance += np.mean(state.one_sigma_deg_h(probed), axis=0) ** 2
    return OwnErrors(logged, first, tuple(states), tuple(left_out), variance)


def not_estimated(run: Run, why: OwnErrorState) -> OwnErrorsFound:
    """All of them, of a session whose filter carries none."""
    return OwnErrorsFound(tuple(replace(state.record, state=why) for state in _every(run)))


def _every(run: Run) -> Iterator[Carried]:
    """Each coefficient of users' errors on each target."""
    for source in estimated_of_users(SESSION):
        for number, coefficient in enumerate(source.coefficients):
            prior = source.prior_of(SESSION, coefficient)
            if prior is None:
                continue
            sigma = prior.of(run.header.gyro_technology)
            if not 0.0 < sigma < np.inf:
                raise InputError(
                    f"error {source.id}: prior sigma {sigma:g}, needed above 0, finite"
                )
            for target in source.targets:
                record = OwnError(
                    error=source.name,
                    target=target,
                    coefficient=coefficient.name,
                    unit=coefficient.unit,
                    prior_sigma=sigma,
                )
                yield Carried(source, number, prior, record)


def _against(state: Carried, probed: Telemetry) -> OwnErrorState | None:
    """Why it is no constant that gyros and accelerometers show in proportion; None where it is."""
    if state.source.shape or state.source.is_noise or state.prior.process != "constant":
        return OwnErrorState.NOT_CONSTANT
    try:
        trace = state.trace(probed)
    except (TypeError, AttributeError):  # of a stream that is not logged
        return OwnErrorState.NO_TRACE
    shown = {name for name, series in vars(trace).items() if series is not None}
    return None if shown and shown <= SHOWN else OwnErrorState.NO_TRACE


def _means(run: Telemetry, series: NDArray, start_s: NDArray, end_s: NDArray) -> NDArray:
    """Means (m, 3) of a series (n, 3) over spans of whole seconds."""
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(series, axis=0)])
    a = np.clip(np.searchsorted(run.time_s, start_s), 0, run.n - 1)
    b = np.clip(np.searchsorted(run.time_s, end_s), a + 1, run.n)
    return np.asarray((sums[b] - sums[a]) / (b - a)[:, None])
