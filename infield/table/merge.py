"""Bayesian merge of one session into the thermal table, with everything one session has in common
kept in common::

    session bias points  b = H beta + t,   t ~ N(0, T): turn-on, flicker, rate random walk,
                                           misalignment
    measured             y = b + v,        v ~ N(0, R)

`merge_posterior` merges what a filter learnt that carried b as states (prior m0 = H beta, C = H P
H' + T; posterior m1, P1) and so may have left directions of b unobserved; the tests hold it against
the update from y and R. Units: deg/h, (deg/h)^2.  Source: physics.md 6.8, claim 1 (n), (o).

Decision: docs/decisions/0010-points-exclude-prior.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from infield.table.thermal_table import ThermalTable
from ins.earth import EARTH_RATE_RAD_S
from ins.noise import flicker_covariance, random_walk_covariance
from ins.records import AXES, GyroNoise, InputError, frozen_array
from ins.robust import chi2, norm
from ins.units import DEG_PER_HOUR, HOUR, MILLIRADIAN

CONFIDENCE = 0.999  # of the band a session must lie in to be merged (requirements R11, R16)
# one of three axes exceeds it in 1 of 1000
AXIS_Z_LIMIT = float(norm.isf((1.0 - CONFIDENCE) / 2.0 / len(AXES)))
NEGLIGIBLE_VARIANCE = (  # 1e-6 of a sigma
    1e-12  # variance, relative to the largest, of a direction that is already known
)
# share of a direction's variance that the session removed, below which it says nothing; a sigma
# falls by 5e-7 of itself
UNOBSERVED = 1e-6


@dataclass(frozen=True, kw_only=True)
class SessionPoints:
    """What one session measured: total gyro biases, prior excluded, with their joint covariance.

    axis_index (m,): 0, 1, 2; time_s (m,): centre; duration_s (m,); temperatures and rates: means
    over the point; bias_deg_h (m,): comparable with the table, a table already applied being added
    back; covariance (m, m) [(deg/h)^2]: of the measurement alone, its temperature included; H (m,
    n): `ThermalTable.basis` rows averaged over each point. Gradient and the sigmas of temperature
    and rate: None where not logged or not known.
    """

    axis_index: NDArray
    time_s: NDArray
    duration_s: NDArray
    temperature_degC: NDArray
    temperature_rate_degC_min: NDArray
    bias_deg_h: NDArray
    covariance: NDArray
    H: NDArray
    run_id: str = ""
    run_sha256: str = ""
    applied_table_sha256: str | None = None
    gradient_degC: NDArray | None = None
    sigma_temperature_degC: NDArray | None = None
    sigma_rate_degC_min: NDArray | None = None

    def __post_init__(self) -> None:
        m = len(np.atleast_1d(self.bias_deg_h))
        shapes: dict[str, tuple[int | None, ...]] = {"covariance": (m, m), "H": (m, None)}
        one = (
            "time_s",
            "duration_s",
            "temperature_degC",
            "temperature_rate_degC_min",
            "bias_deg_h",
            "gradient_degC",
            "sigma_temperature_degC",
            "sigma_rate_degC_min",
        )
        shapes.update(dict.fromkeys(one, (m,)))
        for name, shape in shapes.items():
            if getattr(self, name) is not None:
                object.__setattr__(
                    self, name, frozen_array(getattr(self, name), shape, f"SessionPoints.{name}")
                )
        axis = np.array(self.axis_index, dtype=np.int64)
        if axis.shape != (m,) or not np.all((axis >= 0) & (axis < len(AXES))):
            raise InputError(f"SessionPoints.axis_index: needs {m} values of 0, 1, 2")
        axis.flags.writeable = False
        object.__setattr__(self, "axis_index", axis)

    @property
    def sigma_deg_h(self) -> NDArray:
        """Standard deviation of each point alone, shape (m,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def common_sigma_deg_h(self) -> NDArray:
        """Standard deviation of what all points of an axis share, shape (3,): the root of the mean
        covariance between two of them, at most the surest point's own variance.
        """
        found = np.zeros(len(AXES))
        for axis in range(len(AXES)):
            mine = np.flatnonzero(self.axis_index == axis)
            if mine.size < 2:
                continue
            R = self.covariance[np.ix_(mine, mine)]
            between = (R.sum() - np.trace(R)) / (mine.size * (mine.size - 1))
            found[axis] = np.sqrt(np.clip(between, 0.0, np.diag(R).min()))
        return found


@dataclass(frozen=True, kw_only=True)
class MergeResult:
    """One merge, with its evidence.

    Attributes
    ----------
    table, candidate, before : ThermalTable
        The merged table, or the table as it was where the session is not `consistent` with it;
        the merged table in any case; the table as it was.
    innovation_deg_h, innovation_covariance : shape (m,), (m, m)
        Session less table, and what was expected of it.
    nis, dof, band
        innovation' S^-1 innovation, its chi-square degrees of freedom and 99.9 % band.
    axis_z : shape (3,)
        Mean change of each axis's nodes over its expected standard deviation; a shift of one axis
        that a large dof would hide shows here.
    """

    table: ThermalTable
    candidate: ThermalTable
    innovation_deg_h: NDArray
    innovation_covariance: NDArray
    nis: float
    dof: int
    band: tuple[float, float]
    axis_z: NDArray
    consistent: bool
    before: ThermalTable


def merge_posterior(
    table: ThermalTable,
    H: ArrayLike,
    prior_mean: ArrayLike,
    prior_cov: ArrayLike,
    post_mean: ArrayLike,
    post_cov: ArrayLike,
    *,
    held_axes: Sequence[str] = (),
) -> MergeResult:
    """Merge what a filter learnt of the session biases b; H (m, n), means (m,), covariances (m, m).

    prior: N(m0, C), C = H P H' + T with this table's P; posterior: N(m1, P1). With K = P H' C^-1::

        beta+ = beta + K (m1 - m0),   P+ = P - K (C - P1) K'

    exact for any linear measurement of b. Worked in coordinates where C = I and P1 = I - diag(d): d
    is the share of variance that the session removed, and a direction with d below UNOBSERVED moves
    nothing at all.

    held_axes: axes that the session did not show. Their common part stays exactly where it was (a
    consider update): a session sees north and east, and the heading, itself uncertain by about a
    milliradian, would otherwise carry a thousandth of the north gyro's change into the east gyro.
    Their shape over temperature may still be learnt.
    """
    H, C = np.asarray(H, dtype=float), np.asarray(prior_cov, dtype=float)
    innovation = np.asarray(post_mean, dtype=float) - np.asarray(prior_mean, dtype=float)
    m = innovation.size
    if H.shape != (m, table.n_parameters) or C.shape != (m, m) or np.shape(post_cov) != (m, m):
        raise InputError(
            f"posterior of {m} points: H {H.shape}, covariances {C.shape} and {np.shape(post_cov)}"
        )
    reduction = C - np.asarray(post_cov, dtype=float)
    W = _whitener(C)
    share, V = np.linalg.eigh(_symmetric(W @ reduction @ W.T))
    seen = share > UNOBSERVED
    share, U = np.minimum(share[seen], 1.0), V[:, seen].T @ W  # U: observed directions, U C U' = I
    G = table.covariance @ H.T @ U.T
    delta = U @ innovation
    shrunk = G * np.sqrt(share)
    change, P_plus = hold_common(table, held_axes, G @ delta, table.covariance - shrunk @ shrunk.T)
    nis, dof = float(np.sum(delta**2 / share)), int(seen.sum())
    return _judged(table, (innovation, reduction), change, P_plus, nis=nis, dof=dof)


def hold_common(
    table: ThermalTable, axes: Sequence[str], change: NDArray, P_plus: NDArray
) -> tuple[NDArray, NDArray]:
    """A change (n,) and its covariance (n, n) with the common part of some axes left exactly where
    it was.
    """
    if not axes:
        return change, P_plus
    # P - M G - G M' + M G M' with M = I - T, G = P - P+
    reduction = table.covariance - P_plus
    T = common_parts(table, axes, reduction)
    return change - T @ change, P_plus + T @ reduction @ T.T


def common_parts(table: ThermalTable, axes: Sequence[str], reduction: NDArray) -> NDArray:
    """Projector (n, n) of a change onto what the common parts of some axes bring with them.

    With w the weights of the common part and G the reduction (n, n) of the table's covariance by
    the whole update, the part of a change that goes with w' change is G w / (w' G w), taken within
    the axis. What is left of the axis is P - G + G w w' G / (w' G w), at most P by Cauchy and
    Schwarz: no node becomes less sure than it was.
    """
    T = np.zeros((table.n_parameters, table.n_parameters))
    for axis in axes:
        own, weights = table.block(axis), table.common_weights(axis)
        along = np.zeros(table.n_parameters)
        along[own] = reduction[own] @ weights
        removed = float(weights @ along)
        if removed <= NEGLIGIBLE_VARIANCE * (weights @ table.covariance @ weights):
            removed = 1.0
            along[:] = 0.0
            along[table.values_of(axis)] = 1.0
        T += np.outer(along / removed, weights)
    return T


def session_covariance(
    *,
    axis_index: ArrayLike,
    time_s: ArrayLike,
    duration_s: ArrayLike,
    gyro: GyroNoise,
    run_length_s: float,
    sigma_misalignment_mrad: ArrayLike = 0.0,
) -> NDArray:
    """T: covariance of one session's departure from the table, averaged over each point, shape (m,
    m) [(deg/h)^2].

    Per axis, axes independent: turn-on (a constant), flicker of two-sided PSD B^2 / (2 pi f) down
    to 1 / (4 run_length_s), rate random walk K^2 t since power-on, and (15 deg/h
    sigma_misalignment)^2 for Earth rate leaking in on this session's heading (one sigma, or one for
    each of x, y, z). Source: formats.md section 3, physics.md 6.8.
    """
    axis = np.asarray(axis_index, dtype=np.int64)
    start, end = bin_edges(time_s, duration_s)
    misalignment = (
        EARTH_RATE_RAD_S
        / DEG_PER_HOUR
        * MILLIRADIAN
        * np.broadcast_to(sigma_misalignment_mrad, 3)[axis]
    )
    T = (
        gyro.turn_on_deg_h**2
        + misalignment[:, None] ** 2
        + gyro.bias_instability_deg_h**2
        * flicker_covariance(start, end, lowest_hz=0.25 / run_length_s)
        + gyro.rate_random_walk_deg_h_sqrt_h**2 / HOUR * random_walk_covariance(start, end)
    )
    return T * (axis[:, None] == axis[None, :])


def bin_edges(time_s: ArrayLike, duration_s: ArrayLike) -> tuple[NDArray, NDArray]:
    """Start and end of each point [s] from its centre and duration (at least 1 s, for flicker's
    sake).
    """
    centre = np.asarray(time_s, dtype=float)
    half = 0.5 * np.maximum(np.asarray(duration_s, dtype=float), 1.0)
    return centre - half, centre + half


def _judged(
    table: ThermalTable,
    innovation: tuple[NDArray, NDArray],
    change: NDArray,
    P_plus: NDArray,
    *,
    nis: float,
    dof: int,
) -> MergeResult:
    """The result, merged only where neither NIS nor the shift of any axis is beyond its bound."""
    candidate = table.replaced(parameters=table.parameters + change, covariance=_symmetric(P_plus))
    band = (0.0, 0.0)
    if dof:
        band = tuple(chi2.ppf([0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2], dof))
    axis_z = _axis_shifts(table, change, table.covariance - candidate.covariance)
    # a NIS below its band keeps no session out: a table may well be better than its sigma says
    consistent = bool(nis <= band[1] and np.max(np.abs(axis_z)) <= AXIS_Z_LIMIT)
    return MergeResult(
        table=candidate if consistent else table,
        candidate=candidate,
        innovation_deg_h=innovation[0],
        innovation_covariance=innovation[1],
        nis=nis,
        dof=dof,
        band=(float(band[0]), float(band[1])),
        axis_z=axis_z,
        consistent=consistent,
        before=table,
    )


def _axis_shifts(table: ThermalTable, change: NDArray, expected: NDArray) -> NDArray:
    """Mean node change of each axis over its expected sigma (0 where none was expected)."""
    z = np.zeros(len(AXES))
    for k, axis in enumerate(AXES):
        nodes = table.values_of(axis)
        variance = expected[nodes, nodes].mean()
        if variance > NEGLIGIBLE_VARIANCE * table.covariance[nodes, nodes].mean():
            z[k] = change[nodes].mean() / np.sqrt(variance)
    return z


def _whitener(S: NDArray) -> NDArray:
    """W, shape (rank, m), with W S W' = I; directions of no variance are left out."""
    values, vectors = np.linalg.eigh(_symmetric(S))
    kept = values > NEGLIGIBLE_VARIANCE * max(values[-1], 0.0)
    return (vectors[:, kept] / np.sqrt(values[kept])).T


def _symmetric(P: NDArray) -> NDArray:
    return 0.5 * (P + P.T)
