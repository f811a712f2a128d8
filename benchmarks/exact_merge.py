"""The exact Bayesian merge, in one batch: what any sequential merge of the same sessions can reach
at best::

    departures of session k from the factory table  d_k = H_k beta + t_k
                                                    beta ~ N(0, P0),  t_k ~ N(0, T_k)
    what the session alone says of d_k              information L_k, vector l_k
                                                    (L_k may leave directions open)

With t_k integrated out, (I + L T)^-1 L and (I + L T)^-1 l take the place of L and l; all sessions
are summed and solved once. Written apart from infield.table.merge: information form, no gain, no
gate, no order.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import ThermalTable


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """One session about its departures d (m,) from the factory table at its bins [deg/h].

    axis_index, temperature_degC (m,): of each bin; factory_deg_h (m,): the table there; information
    (m, m), vector (m,): of the session alone; own (m, m): covariance T of turn-on and drift;
    span_degC: lowest and highest temperature; bin_degC: the temperatures within each bin, m arrays.
    """

    axis_index: NDArray
    temperature_degC: NDArray
    factory_deg_h: NDArray
    information: NDArray
    vector: NDArray
    own: NDArray
    bin_degC: tuple[NDArray, ...]

    @property
    def span_degC(self) -> tuple[float, float]:
        return min(float(t.min()) for t in self.bin_degC), max(
            float(t.max()) for t in self.bin_degC
        )

    def rows(self, table: ThermalTable) -> NDArray:
        """Rows (m, n) of a table, averaged over each bin."""
        return np.stack(
            [table.basis(int(a), t).mean(axis=0) for a, t in zip(self.axis_index, self.bin_degC)]
        )


def posterior(prior: NDArray, information: NDArray, vector: NDArray) -> tuple[NDArray, NDArray]:
    """Mean and covariance of N(0, C) after information L, l: C (I + L C)^-1 l and C (I + L C)^-1,
    neither inverted.
    """
    gain = np.linalg.solve(
        np.eye(vector.size) + information @ prior, np.column_stack([vector, np.eye(vector.size)])
    )
    covariance = prior @ gain[:, 1:]
    return prior @ gain[:, 0], 0.5 * (covariance + covariance.T)


def exact_merge(factory: ThermalTable, sessions: Sequence[Evidence]) -> ThermalTable:
    """The factory table after all sessions at once; its covariance must be the true prior."""
    low = min((e.span_degC[0] for e in sessions), default=np.inf)
    high = max((e.span_degC[1] for e in sessions), default=-np.inf)
    table = factory.extended_to(low, high) if sessions else factory
    J, j = np.zeros_like(table.covariance), np.zeros(table.n_parameters)
    for e in sessions:
        H = e.rows(table)
        known = np.linalg.solve(
            np.eye(e.vector.size) + e.information @ e.own,
            np.column_stack([e.information, e.vector]),
        )
        J, j = J + H.T @ known[:, :-1] @ H, j + H.T @ known[:, -1]
    mean, covariance = posterior(table.covariance, 0.5 * (J + J.T), j)
    return table.replaced(parameters=table.parameters + mean, covariance=covariance)
