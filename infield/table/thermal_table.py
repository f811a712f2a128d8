"""The thermal bias table of one gyro triad: node values over temperature, with their full joint
covariance.

Unit: deg/h, deg/h/degC and (deg/h)^2 throughout, in memory as in the file. A table is a border
record (read, printed, stored, compared to 0 ulp), so it is never converted; kernels that want rad/s
multiply by `units.DEG_PER_HOUR`.

Bias is what the gyro reads above the truth: subtract it. It is the mean over power-ons; the sigma
excludes the turn-on bias of any one session. Parameters beta: values of x, y, z nodes, then
(hermite) slopes of x, y, z nodes.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.errors.table import DEFAULT_SIGMA_deg_h
from ins.records import AXES, GYRO_TECHNOLOGIES, InputError, check_name, frozen_array


class GyroCurves(Protocol):
    """One gyro: temperatures and rates (n,) [degC, degC/min], gradient lines (n, 3) [degC] in, bias
    (n,) [deg/h] out. Beyond the fitted temperatures the end values are held.
    """

    @property
    def range_degC(self) -> tuple[float, float]:
        """Temperatures that the curves were fitted to."""
        ...

    def settled_deg_h(self, T: NDArray) -> NDArray: ...

    def rates_deg_h(self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray) -> NDArray:
        """What rates and gradients add."""
        ...

    def rates_sigma_deg_h(
        self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """What is not known of `rates_deg_h`, 1 sigma."""
        ...


@dataclass(frozen=True)
class SettledCurve:
    """One gyro whose bias follows its temperature alone: rates and gradients add nothing."""

    range_degC: tuple[float, float]
    value_deg_h: Callable[[NDArray], NDArray]

    def settled_deg_h(self, T: NDArray) -> NDArray:
        return self.value_deg_h(T)

    def rates_deg_h(self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray) -> NDArray:
        """None."""
        return np.zeros(np.shape(T))

    def rates_sigma_deg_h(
        self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """None."""
        return np.zeros(np.shape(T))


class TemperatureModel(ABC):
    """The gyros of a unit: temperatures, rates and lines (n, 3) in, bias (n, 3) [deg/h] out; 0 for
    a gyro without a model, which is left as it is.
    """

    @property
    @abstractmethod
    def curves(self) -> Mapping[str, GyroCurves]:
        """Of each gyro with a model."""

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(self.curves)

    @property
    def lines(self) -> tuple[str, ...]:
        """Gradient lines that the model needs."""
        return ()

    @property
    def lags_s(self) -> NDArray:
        """By how much (3, 2) [s] each gyro's thermometer, and the lines for it, read late."""
        return np.zeros((len(AXES), 2))

    def settled_deg_h(self, temperature_degC: NDArray) -> NDArray:
        """Of a unit whose temperature stands."""
        return self._by_gyro(lambda c, k: c.settled_deg_h(temperature_degC[:, k]), temperature_degC)

    def rates_deg_h(
        self, temperature_degC: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """What rates and gradients add."""

        def value(c: GyroCurves, k: int) -> NDArray:
            return c.rates_deg_h(temperature_degC[:, k], rate_degC_min[:, k], gradient_degC)

        return self._by_gyro(value, temperature_degC)

    def rates_sigma_deg_h(
        self, temperature_degC: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """What is not known of `rates_deg_h`, 1 sigma."""

        def value(c: GyroCurves, k: int) -> NDArray:
            return c.rates_sigma_deg_h(temperature_degC[:, k], rate_degC_min[:, k], gradient_degC)

        return self._by_gyro(value, temperature_degC)

    def inside(self, temperature_degC: NDArray) -> NDArray:
        """Where (n, 3) the temperatures are within what a gyro's model was fitted to."""
        ok = np.zeros(np.shape(temperature_degC), dtype=bool)
        for axis, curves in self.curves.items():
            k = AXES.index(axis)
            low, high = curves.range_degC
            ok[:, k] = (low <= temperature_degC[:, k]) & (temperature_degC[:, k] <= high)
        return ok

    def _by_gyro(self, value: Callable[[GyroCurves, int], NDArray], like: NDArray) -> NDArray:
        out = np.zeros(np.shape(like))
        for axis, curves in self.curves.items():
            k = AXES.index(axis)
            out[:, k] = value(curves, k)
        return out


COMMON_FRACTION = 0.7  # of each variance: a common shift of the axis
KERNEL_LENGTH_degC = 30.0  # of the smooth rest


def prior_covariance(
    nodes_degC: tuple[NDArray, NDArray, NDArray],
    sigmas_deg_h: tuple[NDArray, NDArray, NDArray],
    *,
    hermite: bool = False,
    common_fraction: float = COMMON_FRACTION,
    length_degC: float = KERNEL_LENGTH_degC,
) -> NDArray:
    """The covariance that goes with sigmas alone (formats.md, section 2: `covariance` null), shape
    (n, n).

    Per axis sigma_i sigma_j (c + (1 - c) rho), axes uncorrelated. Slopes get the derivatives of the
    same kernel with the sigma of their own node; the change of sigma from node to node is neglected
    there.
    """
    sizes = [t.size for t in nodes_degC]
    count = sum(sizes)
    P = np.zeros((2 * count, 2 * count) if hermite else (count, count))
    for start, nodes, sigma in zip(np.cumsum([0] + sizes[:2]), nodes_degC, sigmas_deg_h):
        unit = (1.0 - common_fraction) * smooth_kernel(nodes, length_degC, slopes=hermite)
        unit[: nodes.size, : nodes.size] += common_fraction
        block = start + np.arange(nodes.size)
        scale = np.asarray(sigma, dtype=float)
        if hermite:
            block, scale = np.r_[block, block + count], np.r_[scale, scale]
        P[np.ix_(block, block)] = unit * np.outer(scale, scale)
    return P


def smooth_kernel(nodes_degC: ArrayLike, length_degC: float, *, slopes: bool = False) -> NDArray:
    """Unit covariance rho = exp(-dT^2 / 2 l^2) of a smooth curve at nodes; with `slopes`, of values
    then slopes.

    cov(v, m') = d rho/dT' = (T - T')/l^2 rho; cov(m, m') = (1/l^2 - dT^2/l^4) rho.
    """
    T = np.asarray(nodes_degC, dtype=float)
    d, l2 = T[:, None] - T[None, :], length_degC**2
    rho = np.exp(-(d**2) / (2.0 * l2))
    if not slopes:
        return rho
    value_slope = d / l2 * rho
    return np.block([[rho, value_slope], [value_slope.T, (1.0 - d**2 / l2) / l2 * rho]])


INTERPOLATIONS = ("linear", "hermite")
DAYS_PER_YEAR = 365.25
# asymmetry or negative eigenvalue, relative to the largest variance, still taken for rounding:
# files of ten digits have 1e-10, doubles 1e-16
TABLE_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class AgeingModel:
    """How a table's covariance grows with time: random walks of each axis's common shift and of its
    smooth shape.

    Zero unless configured. Source: physics.md 6.8, Q = q_c dt 11' + q_s dt K_l.
    """

    common_deg_h_sqrt_year: float = 0.0
    shape_deg_h_sqrt_year: float = 0.0
    length_degC: float = KERNEL_LENGTH_degC


@dataclass(frozen=True, kw_only=True, eq=False)
class ThermalTable(TemperatureModel):
    """Node values (and slopes) over temperature for gyros x, y, z of one unit; immutable.

    Parameters
    ----------
    temperature_degC : three arrays
        Each strictly increasing, at least two nodes; the axes may differ.
    parameters : shape (n,) [deg/h; deg/h/degC]
        In the order given at the top of this module.
    covariance : shape (n, n)
        Symmetric and positive semidefinite, units to match.
    provenance : mapping
        What the file says of the parent and the runs; carried, never interpreted here.

    Raises
    ------
    InputError
        A shape, an order, a value or the covariance is not what is written here.
    """

    imu_serial: str
    gyro_technology: str
    created_utc: str
    temperature_degC: tuple[NDArray, NDArray, NDArray]
    parameters: NDArray
    covariance: NDArray
    interpolation: str = "linear"
    gyro_mode: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_one_of("gyro_technology", self.gyro_technology, GYRO_TECHNOLOGIES)
        _check_one_of("interpolation", self.interpolation, INTERPOLATIONS)
        check_name("imu_serial", self.imu_serial)
        check_name("gyro_mode", self.gyro_mode)
        nodes = tuple(
            frozen_array(t, (None,), f"axes.{axis}.temperature_degC")
            for axis, t in zip(AXES, self.temperature_degC)
        )
        for axis, t in zip(AXES, nodes):
            if t.size < 2 or not np.all(np.isfinite(t)) or not np.all(np.diff(t) > 0):
                raise InputError(
                    f"axes.{axis}.temperature_degC: needs at least two finite, strictly increasing"
                    " values"
                )
        n = sum(t.size for t in nodes) * (2 if self.interpolation == "hermite" else 1)
        beta = frozen_array(self.parameters, (n,), "table parameters")
        if not np.all(np.isfinite(beta)):
            raise InputError("table parameters: not finite")
        object.__setattr__(self, "temperature_degC", nodes)
        object.__setattr__(self, "parameters", beta)
        object.__setattr__(self, "covariance", _checked_covariance(self.covariance, n))
        object.__setattr__(self, "provenance", dict(self.provenance))

    @property
    def curves(self) -> Mapping[str, SettledCurve]:
        """Each gyro's bias over temperature, its ends held."""
        return {
            axis: SettledCurve((float(t[0]), float(t[-1])), partial(self.bias_deg_h, axis))
            for axis, t in zip(AXES, self.temperature_degC)
        }

    @property
    def n_parameters(self) -> int:
        return int(self.parameters.size)

    def values_of(self, axis: str | int) -> slice:
        """Where the node values of an axis stand in the parameter vector."""
        sizes = [t.size for t in self.temperature_degC]
        start = sum(sizes[: axis_number(axis)])
        return slice(start, start + sizes[axis_number(axis)])

    def slopes_of(self, axis: str | int) -> slice:
        """Where the node slopes of an axis stand (hermite only)."""
        values, count = self.values_of(axis), sum(t.size for t in self.temperature_degC)
        return slice(values.start + count, values.stop + count)

    def basis(self, axis: str | int, temperature_degC: ArrayLike) -> NDArray:
        """Rows h(T) with bias = h @ parameters, shape (k, n_parameters), over the whole parameter
        vector.

        Hat rows, or the cubic Hermite rows of physics.md 2.2; beyond the nodes the end value is
        held.
        """
        nodes = self.temperature_degC[axis_number(axis)]
        T = np.clip(np.atleast_1d(np.asarray(temperature_degC, dtype=float)), nodes[0], nodes[-1])
        j = np.clip(np.searchsorted(nodes, T, side="right") - 1, 0, nodes.size - 2)
        h = nodes[j + 1] - nodes[j]
        s = (T - nodes[j]) / h
        rows, k = np.zeros((T.size, self.n_parameters)), np.arange(T.size)
        value = self.values_of(axis).start + j
        if self.interpolation == "linear":
            rows[k, value], rows[k, value + 1] = 1.0 - s, s
            return rows
        slope = self.slopes_of(axis).start + j
        rows[k, value], rows[k, value + 1] = 2 * s**3 - 3 * s**2 + 1, -2 * s**3 + 3 * s**2
        rows[k, slope], rows[k, slope + 1] = (s**3 - 2 * s**2 + s) * h, (s**3 - s**2) * h
        return rows

    def bias_deg_h(self, axis: str | int, temperature_degC: ArrayLike) -> NDArray:
        """Bias at each temperature, shape (k,) [deg/h]; held constant beyond the nodes."""
        return self.basis(axis, temperature_degC) @ self.parameters

    def sigma_deg_h(self, axis: str | int, temperature_degC: ArrayLike) -> NDArray:
        """Standard deviation at each temperature, shape (k,) [deg/h]; beyond the nodes it grows as
        in `extended_to`.
        """
        rows, nodes = self.basis(axis, temperature_degC), self.temperature_degC[axis_number(axis)]
        T = np.atleast_1d(np.asarray(temperature_degC, dtype=float))
        beyond = T - np.clip(T, nodes[0], nodes[-1])
        held = (
            2.0
            * self._variance_beyond(axis)
            * -np.expm1(-(beyond**2) / (2 * KERNEL_LENGTH_degC**2))
        )
        variance = np.einsum("ki,ij,kj->k", rows, self.covariance, rows) + held
        return np.sqrt(np.maximum(variance, 0.0))

    def in_range(self, axis: str | int, temperature_degC: ArrayLike) -> NDArray:
        """True where the temperature lies within the nodes of the axis, shape (k,)."""
        nodes = self.temperature_degC[axis_number(axis)]
        T = np.atleast_1d(np.asarray(temperature_degC, dtype=float))
        return (T >= nodes[0]) & (T <= nodes[-1])

    def replaced(self, **changes: Any) -> "ThermalTable":
        """The same table with some fields changed (parameters, covariance, provenance, created_utc
        ...).
        """
        return replace(self, **changes)

    def aged(self, days: float, model: AgeingModel) -> "ThermalTable":
        """The table after `days` (none, if negative): values stay, the covariance grows by Q
        (physics.md 6.8).
        """
        years = max(days, 0.0) / DAYS_PER_YEAR
        Q = np.zeros_like(self.covariance)
        for axis in AXES:
            block = self.block(axis)
            smooth = smooth_kernel(
                self.temperature_degC[axis_number(axis)],
                model.length_degC,
                slopes=self.interpolation == "hermite",
            )
            common = np.zeros(block.size)
            common[: self.temperature_degC[axis_number(axis)].size] = 1.0
            Q[np.ix_(block, block)] = years * (
                model.common_deg_h_sqrt_year**2 * np.outer(common, common)
                + model.shape_deg_h_sqrt_year**2 * smooth
            )
        return replace(self, covariance=self.covariance + Q)

    def extended_to(self, low_degC: float, high_degC: float) -> "ThermalTable":
        """Nodes added at the end spacing until every axis covers low..high; existing nodes keep
        their bits.

        A new node holds the end value (slope 0) plus a random change delta(T) of the smooth kernel
        since the end, var delta = 2 v (1 - exp(-d^2 / 2 l^2)), independent of all else. v is the
        smooth share of the technology's default variance plus the variance of the table's own
        values over temperature: what is known of a unit where it was never calibrated.
        """
        if all(t[0] <= low_degC and t[-1] >= high_degC for t in self.temperature_degC):
            return self
        sides = [_nodes_beyond(t, low_degC, high_degC) for t in self.temperature_degC]
        x, y, z = (np.concatenate((lo, t, hi)) for t, (lo, hi) in zip(self.temperature_degC, sides))
        nodes = (x, y, z)
        n = sum(t.size for t in nodes) * (2 if self.interpolation == "hermite" else 1)
        wide = replace(self, temperature_degC=nodes, parameters=np.zeros(n), covariance=np.eye(n))
        A, Q = np.zeros((n, self.n_parameters)), np.zeros((n, n))
        for axis, t, (lo, hi) in zip(AXES, self.temperature_degC, sides):
            self._keep_nodes(A, wide, axis, lo.size)
            for end, new, first in ((0, lo, 0), (-1, hi, lo.size + t.size)):
                if new.size:
                    self._hold_end(A, Q, wide, axis, new=new, first=first, end=end)
        return replace(
            wide, parameters=A @ self.parameters, covariance=A @ self.covariance @ A.T + Q
        )

    def common_weights(self, axis: str | int) -> NDArray:
        """Row (n,) that takes a change of the parameters to the common part of an axis.

        The common part is the generalised least squares mean of the node values, weights P^-1 1 /
        (1' P^-1 1) with the covariance P of this table. For P = v 11' + S that is the posterior
        mean of the common shift, unshrunk, and data that only see differences between temperatures
        (rows that sum to zero) move it by exactly nothing.
        """
        nodes = self.values_of(axis)
        weights = np.linalg.pinv(self.covariance[nodes, nodes], rcond=1e-12, hermitian=True).sum(
            axis=0
        )
        if weights.sum() <= 0.0:
            weights = np.ones(weights.size)
        row = np.zeros(self.n_parameters)
        row[nodes] = weights / weights.sum()
        return row

    def block(self, axis: str | int) -> NDArray:
        """Indices of an axis's values, then its slopes, shape (k,)."""
        values = np.r_[self.values_of(axis)]
        if self.interpolation == "hermite":
            return np.r_[values, np.r_[self.slopes_of(axis)]]
        return values

    def _variance_beyond(self, axis: str | int) -> float:
        smooth = (1.0 - COMMON_FRACTION) * DEFAULT_SIGMA_deg_h[self.gyro_technology] ** 2
        return float(smooth + np.var(self.parameters[self.values_of(axis)]))

    def _keep_nodes(self, A: NDArray, wide: "ThermalTable", axis: str, shift: int) -> None:
        kinds = ["values_of", "slopes_of"] if self.interpolation == "hermite" else ["values_of"]
        for kind in kinds:
            old, new = getattr(self, kind)(axis), getattr(wide, kind)(axis)
            size = old.stop - old.start
            A[new.start + shift + np.arange(size), np.r_[old]] = 1.0

    def _hold_end(
        self,
        A: NDArray,
        Q: NDArray,
        wide: "ThermalTable",
        axis: str,
        *,
        new: NDArray,
        first: int,
        end: int,
    ) -> None:
        """Fill A and Q for the nodes added on one side of one axis."""
        hermite, values = self.interpolation == "hermite", self.values_of(axis)
        rows = wide.values_of(axis).start + first + np.arange(new.size)
        A[rows, values.start if end == 0 else values.stop - 1] = 1.0
        if hermite:
            rows = np.r_[rows, wide.slopes_of(axis).start + first + np.arange(new.size)]
        kernel = smooth_kernel(
            np.r_[self.temperature_degC[axis_number(axis)][end], new],
            KERNEL_LENGTH_degC,
            slopes=hermite,
        )
        m = new.size
        # changes since the end: value - end value; slopes as they are
        B = np.zeros((rows.size, kernel.shape[0]))
        B[:m, 1 : m + 1], B[:m, 0] = np.eye(m), -1.0
        if hermite:
            B[m:, m + 2 :] = np.eye(m)
        Q[np.ix_(rows, rows)] = self._variance_beyond(axis) * (B @ kernel @ B.T)


@dataclass(frozen=True, kw_only=True)
class EvenNodes:
    """Temperatures a spacing apart, whole multiples of it, that cover low to high."""

    low_degC: float = -40.0
    high_degC: float = 70.0
    spacing_degC: float = 10.0

    def temperature_degC(self) -> NDArray:
        """The nodes, shape (n,), n at least 2."""
        first = self.spacing_degC * np.floor(self.low_degC / self.spacing_degC)
        steps = int(np.ceil((self.high_degC - first) / self.spacing_degC))
        return np.asarray(first + self.spacing_degC * np.arange(max(2, steps + 1)))


def default_table(
    *,
    imu_serial: str,
    gyro_technology: str,
    created_utc: str,
    span: EvenNodes | None = None,
    sigma_deg_h: float | None = None,
    interpolation: str = "linear",
    gyro_mode: str = "",
) -> ThermalTable:
    """What is believed of a unit that has no table: bias 0, the sigma of its technology (or the one
    given).
    """
    _check_one_of("gyro_technology", gyro_technology, GYRO_TECHNOLOGIES)
    sigma = DEFAULT_SIGMA_deg_h[gyro_technology] if sigma_deg_h is None else sigma_deg_h
    nodes = (span or EvenNodes()).temperature_degC()
    hermite = interpolation == "hermite"
    sigmas = np.full(nodes.size, sigma)
    return ThermalTable(
        imu_serial=imu_serial,
        gyro_technology=gyro_technology,
        gyro_mode=gyro_mode,
        created_utc=created_utc,
        interpolation=interpolation,
        temperature_degC=(nodes, nodes, nodes),
        parameters=np.zeros(3 * nodes.size * (2 if hermite else 1)),
        covariance=prior_covariance((nodes,) * 3, (sigmas,) * 3, hermite=hermite),
    )


def axis_number(axis: str | int) -> int:
    """0, 1, 2 for "x", "y", "z" (numbers pass)."""
    return AXES.index(axis) if isinstance(axis, str) else axis


def _nodes_beyond(nodes: NDArray, low_degC: float, high_degC: float) -> tuple[NDArray, NDArray]:
    below, above = nodes[1] - nodes[0], nodes[-1] - nodes[-2]
    n_low = max(0, int(np.ceil((nodes[0] - low_degC) / below - TABLE_ROUNDING)))
    n_high = max(0, int(np.ceil((high_degC - nodes[-1]) / above - TABLE_ROUNDING)))
    return nodes[0] - below * np.arange(n_low, 0, -1), nodes[-1] + above * np.arange(1, n_high + 1)


def _check_one_of(name: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InputError(f"{name} {value!r}, needed one of {', '.join(allowed)}")


def _checked_covariance(covariance: ArrayLike, n: int) -> NDArray:
    P = frozen_array(covariance, (n, n), "covariance")
    if not np.all(np.isfinite(P)):
        raise InputError("covariance: not finite")
    scale = float(np.max(np.abs(P), initial=0.0))
    if np.max(np.abs(P - P.T), initial=0.0) > TABLE_ROUNDING * scale:
        raise InputError("covariance: not symmetric")
    P = 0.5 * (P + P.T)
    lowest = float(np.linalg.eigvalsh(P)[0])
    if lowest < -TABLE_ROUNDING * scale:
        raise InputError(f"covariance: not positive semidefinite, lowest eigenvalue {lowest:.3g}")
    P.flags.writeable = False
    return P
