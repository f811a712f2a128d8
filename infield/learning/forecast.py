"""When the free-inertial drift of a unit will pass a limit, and which session would put that off.

The error e of a unit's table at the temperatures where it works is what the sessions leave of it
(`FleetLikelihood`), and ages on as the learnt parameters say. The drift of a power-on at t is::

    D(t) = 60 NM/h per deg/h * sqrt(mean over T of (e_x^2 + e_y^2) + 2 (turn-on^2 + flicker^2))

(physics.md 6.3, 7: mean of a Schuler period, RMS over power-ons).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.learning.learn import TWO_SIDED_95, Learnt, Parameters
from infield.learning.parameters import PriorName
from infield.learning.stored_sessions import StoredSession, StoredUnit, covering, curve_rows
from infield.table.merge import session_covariance
from infield.table.thermal_table import DAYS_PER_YEAR, AgeingModel, ThermalTable, smooth_kernel
from ins.noise import FLICKER_FLOOR
from ins.records import AXES, GyroNoise

NM_H_PER_DEG_H = 60.0  # mean drift of a level gyro's bias: R u, physics.md 6.3
LIMIT_NM_H = 0.8  # physics.md 7: the export-control line of a navigation-grade system
LEVEL_GYROS = (0, 1)
TEMPERATURES = 5  # where a unit works: evenly spaced quantiles of what its sessions saw
WORKS_AT_degC = (10.0, 40.0)  # of a unit without sessions
PATHS = 400
HORIZON_YEARS = 12.0
# when paths are looked at: today, in a day (what a date tells apart), and 287 times 3 % later each,
# so that a date a week ahead is as finely told as one in years
LOOK_YEARS = np.concatenate([[0.0], np.geomspace(1.0 / DAYS_PER_YEAR, HORIZON_YEARS, 288)])
JITTER = 1e-9  # of a kernel's diagonal, so that it has a root
# [NM/h] and [(NM/h)^2]: a millionth of a limit, where a division by nothing would be
SMALLEST_DRIFT_NM_H, SMALLEST_VARIANCE = 1e-6, 1e-12


@dataclass(frozen=True)
class Outlook:
    """Drift of a unit from now on. years (k,): from now; median, high (k,) [NM/h]: of the paths,
    high is passed by 5 %; passes (paths,): first passage in years, infinite beyond the horizon.
    """

    years: NDArray
    median: NDArray
    high: NDArray
    passes: NDArray

    @property
    def year_50(self) -> float:
        """By then half the paths have passed the limit; infinite beyond the horizon."""
        return _quantile(self.passes, 0.5)

    @property
    def year_95(self) -> float:
        """Until then 95 % of the paths stay below the limit."""
        return _quantile(self.passes, 0.05)


@dataclass(frozen=True, eq=False)
class UnitState:
    """What is known of a unit: its first table, the departure of its nodes from it after the last
    session (mean, covariance, values of x, y, z alone), and the table in use. year: of the last
    session.
    """

    first: ThermalTable
    mean: NDArray
    covariance: NDArray
    active: ThermalTable
    year: float

    def level_error(self, temperature_degC: Sequence[NDArray]) -> tuple[NDArray, NDArray]:
        """Error of the table in use at temperatures of x and y: mean and covariance, x then y."""
        A = np.vstack([self.rows(k, temperature_degC[k]) for k in LEVEL_GYROS])
        offset = [
            self.first.bias_deg_h(k, T) - self.active.bias_deg_h(k, T)
            for k, T in zip(LEVEL_GYROS, temperature_degC)
        ]
        return np.concatenate(offset) + A @ self.mean, A @ self.covariance @ A.T

    def rows(self, axis: int, temperature_degC: NDArray) -> NDArray:
        """Of the node values, at temperatures of an axis."""
        rows = np.zeros((temperature_degC.size, self.mean.size))
        sizes = [nodes.size for nodes in self.first.temperature_degC]
        start = sum(sizes[:axis])
        rows[:, start : start + sizes[axis]] = curve_rows(self.first, axis, temperature_degC)
        return rows

    def with_session(self, session: StoredSession, value: Parameters, year: float) -> "UnitState":
        """After one more session like this one, merged at `year` into the table in use: what is
        expected of the error is taken out, its covariance shrinks.
        """
        P = self.aged(value, year).covariance
        H = np.zeros((session.axis_index.size, self.mean.size))
        for axis in range(len(AXES)):
            chosen = session.axis_index == axis
            H[chosen] = self.rows(axis, session.temperature_degC[chosen])
        creep = value[PriorName.YAW_CREEP].value ** 2 * np.diag(session.creep_variance)
        own = session_covariance(
            axis_index=session.axis_index,
            time_s=session.time_s,
            duration_s=session.duration_s,
            gyro=GyroNoise(
                bias_instability_deg_h=value[PriorName.FLICKER].value,
                rate_random_walk_deg_h_sqrt_h=value[PriorName.RANDOM_WALK].value,
                turn_on_deg_h=value[PriorName.TURN_ON].value,
            ),
            run_length_s=session.run_length_s,
        )
        S = H @ P @ H.T + session.covariance_without_creep + creep + own
        after = P - P @ H.T @ np.linalg.solve(S, H @ P)
        known = np.zeros(self.first.n_parameters)
        known[: self.mean.size] = self.mean
        table = self.first.replaced(parameters=self.first.parameters + known)
        return UnitState(self.first, self.mean, 0.5 * (after + after.T), table, year)

    def aged(self, value: Parameters, year: float) -> "UnitState":
        """The same at a later year."""
        ageing = AgeingModel(
            common_deg_h_sqrt_year=value[PriorName.AGEING_COMMON].value,
            shape_deg_h_sqrt_year=value[PriorName.AGEING_SHAPE].value,
            length_degC=value[PriorName.LENGTH].value,
        )
        days = DAYS_PER_YEAR * max(year - self.year, 0.0)
        grown = self.first.aged(days, ageing).covariance - self.first.covariance
        n = self.mean.size
        return UnitState(
            self.first,
            self.mean,
            self.covariance + grown[:n, :n],
            self.active,
            max(year, self.year),
        )


def state_of(
    unit: StoredUnit, mean: NDArray, covariance: NDArray, active: ThermalTable
) -> UnitState:
    """From a row of `Evidence`: the unit's nodes stand first there."""
    first = covering(unit)
    n = sum(t.size for t in first.temperature_degC)
    year = unit.sessions[-1].year if unit.sessions else unit.year
    return UnitState(first, mean[:n], covariance[:n, :n], active, year)


def works_at(unit: StoredUnit) -> tuple[NDArray, NDArray]:
    """Temperatures of gyros x and y where the unit works: quantiles of what its sessions saw."""
    levels = (np.arange(TEMPERATURES) + 0.5) / TEMPERATURES
    found = []
    for axis in LEVEL_GYROS:
        seen = [s.temperature_degC[s.axis_index == axis] for s in unit.sessions]
        every = np.concatenate(seen) if seen else np.array(WORKS_AT_degC)
        found.append(np.quantile(every if every.size else np.array(WORKS_AT_degC), levels))
    return found[0], found[1]


class Paths:
    """Ways in which a unit may age from now on, and start: drawn once, for its state as it is and
    as it would be after a session.
    """

    def __init__(
        self, value: Parameters, temperature_degC: tuple[NDArray, NDArray], *, seed: int = 0
    ) -> None:
        rng = np.random.default_rng(seed)
        n = len(temperature_degC[0])
        drawn = {name: _drawn(value[name], rng) for name in value}
        self._temperature_degC = temperature_degC
        self._now = rng.standard_normal((PATHS, 2 * n))
        self._level = drawn[PriorName.AGEING_COMMON][:, None, None]
        self._shape = drawn[PriorName.AGEING_SHAPE][:, None, None]
        self._roots = []
        rates = np.zeros((PATHS, LOOK_YEARS.size, 2 * n))
        for a in LEVEL_GYROS:
            kernel = smooth_kernel(temperature_degC[a], value[PriorName.LENGTH].value)
            root = np.linalg.cholesky(kernel + JITTER * np.eye(n))
            smooth = rng.standard_normal((PATHS, LOOK_YEARS.size, n)) @ root.T
            common = rng.standard_normal((PATHS, LOOK_YEARS.size, 1))
            rates[:, :, a * n : (a + 1) * n] = self._level * common + self._shape * smooth
            self._roots.append(root)
        self._since = rates[:, 0]  # of a year since the last session
        self._ageing = np.zeros_like(rates)
        steps = np.sqrt(np.diff(LOOK_YEARS))[:, None]
        np.cumsum(rates[:, 1:] * steps, axis=1, out=self._ageing[:, 1:])
        self._grown = rates[:, 1:2] * np.sqrt(LOOK_YEARS)[:, None]
        self._chance = rng.random((PATHS, LOOK_YEARS.size - 1))
        flicker = FLICKER_FLOOR * drawn[PriorName.FLICKER]
        self._start = 2.0 * (drawn[PriorName.TURN_ON] ** 2 + flicker**2)

    def ahead(self, state: UnitState, *, year: float, limit_nm_h: float = LIMIT_NM_H) -> Outlook:
        """The drift from `year` on."""
        mean, P = state.level_error(self._temperature_degC)
        values, vectors = np.linalg.eigh(P)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        now = mean + self._now @ root.T + np.sqrt(max(year - state.year, 0.0)) * self._since
        error = now[:, None, :] + self._ageing
        drift = self._drift_nm_h(error)
        beyond = drift > limit_nm_h
        beyond[:, 1:] |= self._passed_between(error, drift, limit_nm_h)
        first = np.where(beyond.any(axis=1), LOOK_YEARS[np.argmax(beyond, axis=1)], np.inf)
        # of one date the paths are scattered as one draw each, grown by the root of the time, which
        # makes a smooth band of them
        spread = self._drift_nm_h(now[:, None, :] + self._grown)
        median, high = np.quantile(spread, [0.5, 0.95], axis=0)
        return Outlook(LOOK_YEARS, median, high, first)

    def _drift_nm_h(self, error: NDArray) -> NDArray:
        """Drift (paths, looks) of power-ons with errors (paths, looks, 2n) [deg/h] of the table."""
        squared = np.sum(error**2, axis=2) / (error.shape[2] // 2)
        return np.asarray(NM_H_PER_DEG_H * np.sqrt(squared + self._start[:, None]))

    def _passed_between(self, error: NDArray, drift: NDArray, limit_nm_h: float) -> NDArray:
        """Whether a path (paths, looks - 1) was beyond the limit since the look before, where
        neither look shows it.

        A random walk between two known ends at distances a and b below a limit has touched it with
        the probability exp(-2 a b / variance of its step): reflection principle.
        """
        n = error.shape[2] // 2
        growth = np.zeros_like(drift[:, 1:])  # variance of the gradient times e, per year
        for a in LEVEL_GYROS:
            own = error[:, :-1, a * n : (a + 1) * n]
            growth += (self._level[:, :, 0] * own.sum(axis=2)) ** 2
            growth += self._shape[:, :, 0] ** 2 * np.sum((own @ self._roots[a]) ** 2, axis=2)
        slope = NM_H_PER_DEG_H**2 / (n * np.maximum(drift[:, :-1], SMALLEST_DRIFT_NM_H))
        variance = slope**2 * growth * np.diff(LOOK_YEARS)
        room = np.maximum(limit_nm_h - drift, 0.0)
        exponent = -2.0 * room[:, :-1] * room[:, 1:] / np.maximum(variance, SMALLEST_VARIANCE)
        return np.asarray(self._chance < np.exp(exponent))


def expected_passage(
    state: UnitState, value: Parameters, limit_nm_h: float, *, year: float
) -> float:
    """About when the mean square of the drift passes that of the limit, years from `year`: to sort
    units by, without a path.
    """
    at = (np.array(WORKS_AT_degC),) * 2
    mean, P = state.level_error(at)
    growth = 2.0 * sum(
        value[name].value ** 2 for name in (PriorName.AGEING_COMMON, PriorName.AGEING_SHAPE)
    )
    flicker = FLICKER_FLOOR * value[PriorName.FLICKER].value
    start = 2.0 * (value[PriorName.TURN_ON].value ** 2 + flicker**2)
    now = (float(mean @ mean) + float(np.trace(P))) / len(at[0]) + start
    left = (limit_nm_h / NM_H_PER_DEG_H) ** 2 - now
    return float(left / growth - max(year - state.year, 0.0))


def _drawn(learnt: Learnt, rng: np.random.Generator) -> NDArray:
    """Values of a parameter, one a path, from its uncertainty."""
    z = rng.standard_normal(PATHS)
    low, high = (abs(np.log(end / learnt.value)) / TWO_SIDED_95 for end in learnt.interval_95)
    return np.asarray(learnt.value * np.exp(np.where(z < 0.0, low, high) * z))


def _quantile(passes: NDArray, share: float) -> float:
    """The time by which a share of the paths has passed."""
    return float(np.sort(passes)[int(np.ceil(share * len(passes))) - 1])
