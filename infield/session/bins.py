"""Time bins of a session and how they hang on the stored table.

The bins' prior is the table's own uncertainty at their temperatures plus what a session adds
(turn-on, flicker, random walk): one joint covariance over axes and time, so that nothing shared is
counted twice.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from infield.session.settings import SessionSettings, misalignment_sigma_mrad
from infield.table.merge import session_covariance
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.records import TwinModel

# spread of a bin's mean about every model of it; keeps the joint covariance invertible
BIN_FLOOR_DEG_H = 1e-4
# of a bin that needs a gyro temperature; chosen: of 5 min the larger half, 150 s, as USED_SHARE
# of parked.rates
TIED_SHARE = 0.5


@dataclass(frozen=True)
class SessionBins:
    """Time bins of a session and how they hang on the table.

    start_s, end_s (N,): in order, not always without gaps; temperature, rate (N, 3): bin means; H
    (3N, n): rows of the table averaged over the bin, order x, y, z of bin 0, then bin 1 ...;
    table_deg_h (3N,): the table there; prior (3N, 3N) [(deg/h)^2] = H P H' + T. own: T, what the
    session adds; thermometer: the part of T that the temperatures' own errors make, their
    covariance times the table's slope. tied (N, 3): the bin has a temperature; where not, its row
    of H is zero. doubt: the part of T that wrong facts may add (`infield.session.wrong_facts`),
    None: none is suspected.
    """

    start_s: NDArray
    end_s: NDArray
    temperature_degC: NDArray
    rate_degC_min: NDArray
    H: NDArray
    table_deg_h: NDArray
    prior: NDArray
    own: NDArray
    thermometer: NDArray
    tied: NDArray
    sigma_temperature_degC: NDArray
    sigma_rate_degC_min: NDArray
    gradient_degC: NDArray | None = None
    doubt: NDArray | None = None

    @property
    def edges_s(self) -> NDArray:
        """(N + 1,): where bins begin, and where the last one ends."""
        return np.append(self.start_s, self.end_s[-1])

    @property
    def centre_s(self) -> NDArray:
        return 0.5 * (self.end_s + self.start_s)

    @property
    def duration_s(self) -> NDArray:
        return np.asarray(self.end_s - self.start_s)

    def only(self, kept: NDArray) -> "SessionBins":
        """The bins kept (N,) bool, the others' biases left out of the joint prior: as if nobody had
        asked for them.
        """
        k = np.repeat(kept, 3)
        return SessionBins(
            self.start_s[kept],
            self.end_s[kept],
            self.temperature_degC[kept],
            self.rate_degC_min[kept],
            self.H[k],
            self.table_deg_h[k],
            self.prior[np.ix_(k, k)],
            self.own[np.ix_(k, k)],
            self.thermometer[np.ix_(k, k)],
            self.tied[kept],
            self.sigma_temperature_degC[kept],
            self.sigma_rate_degC_min[kept],
            None if self.gradient_degC is None else self.gradient_degC[kept],
            None if self.doubt is None else self.doubt[np.ix_(k, k)],
        )

    def doubted(self, doubt: NDArray | None) -> "SessionBins":
        """The bins with `doubt` (3N, 3N) [(deg/h)^2] more of what the session adds."""
        if doubt is None:
            return self
        return replace(
            self,
            prior=self.prior + doubt,
            own=self.own + doubt,
            doubt=doubt if self.doubt is None else self.doubt + doubt,
        )


def make_bins(
    table: ThermalTable,
    temperature: GyroTemperature,
    twin: TwinModel,
    settings: SessionSettings,
    *,
    start_s: float,
    end_s: float,
) -> SessionBins:
    """Equal bins of about `bin_s`; a bin without a gyro temperature teaches the table nothing."""
    return bins_between(
        table, temperature, twin, settings, equal_edges(start_s, end_s, settings.bin_s)
    )


def equal_edges(start_s: float, end_s: float, bin_s: float) -> NDArray:
    """Edges (N + 1,) of equal bins of about `bin_s`."""
    return np.linspace(start_s, end_s, max(round((end_s - start_s) / bin_s), 1) + 1)


def rebinned(
    bins: SessionBins,
    table: ThermalTable,
    temperature: GyroTemperature,
    twin: TwinModel,
    settings: SessionSettings,
) -> SessionBins:
    """The same bins on another table."""
    edges = np.unique(np.concatenate([bins.start_s, bins.end_s]))
    again = bins_between(table, temperature, twin, settings, edges)
    return again.only(np.isin(edges[:-1], bins.start_s)).doubted(bins.doubt)


def bins_between(
    table: ThermalTable,
    temperature: GyroTemperature,
    twin: TwinModel,
    settings: SessionSettings,
    edges: NDArray,
) -> SessionBins:
    """Bins between edges (N + 1,) [s]."""
    count, end_s = len(edges) - 1, float(edges[-1])
    T, rate, H = (
        np.empty((count, 3)),
        np.empty((count, 3)),
        np.empty((3 * count, table.n_parameters)),
    )
    of_log = temperature.of_bins(edges)
    at_nodes = [table.basis(axis, temperature.temperature_degC[:, axis]) for axis in range(3)]
    tied = of_log.covered >= TIED_SHARE
    tied[:, ["xyz".index(name) for name in temperature.unusable]] = False
    gradient = None if temperature.gradient_degC is None else np.empty((count, 3))
    for k in range(count):
        rows = of_log.rows[k]
        T[k], rate[k] = rows @ temperature.temperature_degC, rows @ temperature.rate_degC_min
        if gradient is not None and temperature.gradient_degC is not None:
            gradient[k] = rows @ temperature.gradient_degC
        for axis in range(3):
            H[3 * k + axis] = rows[seen := rows > 0] @ at_nodes[axis][seen]
    own = session_covariance(
        axis_index=np.tile(np.arange(3), count),
        time_s=np.repeat(0.5 * (edges[1:] + edges[:-1]), 3),
        duration_s=np.repeat(np.diff(edges), 3),
        gyro=twin.gyro,
        run_length_s=end_s,
        sigma_misalignment_mrad=misalignment_sigma_mrad(twin, settings),
    )
    own[np.diag_indices_from(own)] += BIN_FLOOR_DEG_H**2
    table_deg_h = H @ table.parameters
    _cut_off(table, H, own, tied)
    of_T = of_log.covariance
    thermometer = _thermometer_covariance(
        table, T, of_T * (tied.T[:, :, None] & tied.T[:, None, :])
    )
    own += thermometer
    return SessionBins(
        edges[:-1],
        edges[1:],
        T,
        rate,
        H,
        table_deg_h,
        H @ table.covariance @ H.T + own,
        own,
        thermometer,
        tied,
        np.sqrt(np.diagonal(of_T, axis1=1, axis2=2).T),
        of_log.rate_sigma_degC_min,
        gradient,
    )


def _cut_off(table: ThermalTable, H: NDArray, own: NDArray, tied: NDArray) -> None:
    """Untied bins, in place: the bias is what it is, but no temperature ties it to the table."""
    for axis in range(3):
        rows = 3 * np.flatnonzero(~tied[:, axis]) + axis
        values = table.values_of(axis)
        spread = np.max(np.diag(table.covariance)[values]) + np.var(table.parameters[values])
        own[np.ix_(rows, rows)] += spread * (0.7 + 0.3 * np.eye(rows.size))
        H[rows] = 0.0


def _thermometer_covariance(table: ThermalTable, T: NDArray, covariance: NDArray) -> NDArray:
    """What errors of the temperatures, covariance (3, N, N) [degC^2], do to the bias."""
    count = len(T)
    out = np.zeros((3 * count, 3 * count))
    for axis in range(3):
        S = table.basis(axis, T[:, axis] + 0.5) - table.basis(axis, T[:, axis] - 0.5)  # per degC
        slope = S @ table.parameters
        out[axis::3, axis::3] = covariance[axis] * (
            np.outer(slope, slope) + S @ table.covariance @ S.T
        )
    return out
