"""Where the variance of an updated table comes from: parts that add up to all of it.

A merge is linear, so that the error of the table after it is, with W = I - K H::

    e+ = W e - K (t + v),   K = W P H' M,   M = (R + T)^-1 = L (I + T L)^-1

of the table before (e), of how the session departs from it (t, covariance T) and of how well the
session measures itself (v, covariance R, information L = R^-1). All three are sums of independent
sources, and so is the covariance after it: W D W' of each part D of the table before, K T_i K' of
each part of T, and of a source whose part in the information is N_i = L R_i L::

    K R_i K' = W P H' (I - M T) N_i (I - T M) H P W'.

Units: deg/h, (deg/h)^2.  Source: physics.md 6.8; the sum is tested against the merged covariance.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from infield.session.bins import SessionBins, rebinned
from infield.session.estimate import SessionEstimate
from infield.session.hysteresis import VAGUE_TERM, SessionLikelihood, ThermalTerm, with_terms
from infield.session.joint_update import likelihood_of, unfitted, unseen_in_all
from infield.session.points import measurement_information, unseen_axes
from infield.session.reasons import ThermalAction, ThermalKind, VarianceSource
from infield.session.results import SessionResult, UpdateResult
from infield.session.settings import SessionSettings, misalignment_sigma_mrad
from infield.table.merge import common_parts, session_covariance
from infield.table.thermal_table import ThermalTable
from ins.errors.table import DEFAULT_SIGMA_deg_h
from ins.records import GyroNoise, TwinModel
from ins.verdicts import Outcome

Parts = dict[VarianceSource, NDArray]


@dataclass(frozen=True)
class VarianceBudget:
    """Parts of a table's covariance (n, n), by source; they add up to `table.covariance`."""

    table: ThermalTable
    parts: Mapping[VarianceSource, NDArray]

    def shares(self, row: NDArray) -> Mapping[VarianceSource, float]:
        """Of the variance of row @ parameters, row (n,), by source; they add up to 1, or are 0 of
        what is known exactly.
        """
        variance = float(row @ self.table.covariance @ row)
        if variance <= 0.0:
            return dict.fromkeys(self.parts, 0.0)
        return {source: float(row @ D @ row) / variance for source, D in self.parts.items()}


@dataclass(frozen=True)
class _Measured:
    """What one session brings: rows H (m, n), parts of T and of the information L, (m, m) each."""

    H: NDArray
    departs: Parts
    information: NDArray
    shares: Mapping[VarianceSource, NDArray]


def variance_budget(result: UpdateResult) -> VarianceBudget | None:
    """The parts of the table after an update, or None where nothing was merged."""
    if result.outcome is not Outcome.ACCEPTED or not result.merged_runs:
        return None
    sessions = [s for s in result.sessions if s.merged is not None and s.verdict.accepted]
    if any(term.action is ThermalAction.RATE_TERM_FITTED for term in result.terms):
        return VarianceBudget(result.after, _with_rate_terms(result, sessions))
    together = any(term.found for term in result.terms)
    spans = [_span(sessions if together else [s]) for s in sessions]
    table, parts = result.before, {VarianceSource.STORED_TABLE: result.before.covariance}
    for session, span in zip(sessions, spans):
        assert session.merged is not None
        before = session.merged.before
        parts = _before_session(parts, table, before, span)
        measured = _measured(session, before, result)
        parts = _merged(parts, before, [measured], unseen_axes(session.seen))
        table = session.merged.table
    return VarianceBudget(result.after, parts)


def _span(sessions: Sequence[SessionResult]) -> tuple[float, float]:
    """Coldest and warmest gyro temperature [degC]."""
    seen = [s.temperature.temperature_degC for s in sessions if s.temperature is not None]
    return float(min(T.min() for T in seen)), float(max(T.max() for T in seen))


def _before_session(
    parts: Parts, table: ThermalTable, before: ThermalTable, span: tuple[float, float]
) -> Parts:
    """The parts of the table that a session met: wider by ageing, with nodes over `span`."""
    columns = [
        table.replaced(parameters=unit).extended_to(*span).parameters
        for unit in np.eye(table.n_parameters)
    ]
    A = np.stack(columns, axis=1)
    there = {source: A @ D @ A.T for source, D in parts.items()}
    grown = before.covariance - sum(there.values())
    there[VarianceSource.AGEING] = there.get(VarianceSource.AGEING, 0.0) + grown
    return there


def _measured(session: SessionResult, before: ThermalTable, result: UpdateResult) -> _Measured:
    """A session on the table that it met, with what heating and cooling add to it."""
    estimate, temperature = session.estimate, session.temperature
    assert estimate is not None and temperature is not None
    twin, settings = result.twin, result.settings
    bins, wider = estimate.bins, np.zeros_like(estimate.covariance)
    if any(term.found for term in result.terms):
        bins = rebinned(bins, before, temperature, twin, settings)
        wider = with_terms(likelihood_of(session, before, twin, settings), result.terms)[1]
    return _brought(estimate, bins, wider, (twin, settings))


def _brought(
    estimate: SessionEstimate,
    bins: SessionBins,
    wider: NDArray,
    under: tuple[TwinModel, SessionSettings],
) -> _Measured:
    """What a session brings; wider: what a term of heating and cooling adds to its T."""
    information = measurement_information(estimate.bins, estimate)[0]
    departs = _departures(bins, *under)
    departs[VarianceSource.HEATING_AND_COOLING] = wider
    shares = _parked_shares(estimate, information) if estimate.parked else estimate.shares
    return _Measured(bins.H, departs, information, shares)


def _departures(bins: SessionBins, twin: TwinModel, settings: SessionSettings) -> Parts:
    """The parts of T (3N, 3N), each made by the formula that made the whole."""
    gyro = twin.gyro
    none = replace(
        twin.gyro, turn_on_deg_h=0.0, bias_instability_deg_h=0.0, rate_random_walk_deg_h_sqrt_h=0.0
    )

    def of(noise: GyroNoise, misalignment_mrad: NDArray | float = 0.0) -> NDArray:
        return session_covariance(
            axis_index=np.tile(np.arange(3), len(bins.start_s)),
            time_s=np.repeat(bins.centre_s, 3),
            duration_s=np.repeat(bins.duration_s, 3),
            gyro=noise,
            run_length_s=float(bins.end_s[-1]),
            sigma_misalignment_mrad=misalignment_mrad,
        )

    walk, flicker = gyro.rate_random_walk_deg_h_sqrt_h, gyro.bias_instability_deg_h
    parts = {
        VarianceSource.TURN_ON: of(replace(none, turn_on_deg_h=gyro.turn_on_deg_h)),
        VarianceSource.BIAS_INSTABILITY: of(replace(none, bias_instability_deg_h=flicker)),
        VarianceSource.RATE_RANDOM_WALK: of(replace(none, rate_random_walk_deg_h_sqrt_h=walk)),
        VarianceSource.MISALIGNMENT: of(none, misalignment_sigma_mrad(twin, settings)),
        VarianceSource.THERMOMETER: bins.thermometer,
        VarianceSource.DOUBTED_FACT: np.zeros_like(bins.own) if bins.doubt is None else bins.doubt,
    }
    parts[VarianceSource.BINS] = bins.own - sum(parts.values())
    return parts


def _parked_shares(
    estimate: SessionEstimate, information: NDArray
) -> Mapping[VarianceSource, NDArray]:
    """Of a unit without a heading: what is not known of Earth rate, and the noise of the rates."""
    parked = estimate.parked
    assert parked is not None
    if len(parked.stretch) != len(estimate.bins.start_s) or (parked.stretch < 0).any():
        return {}
    rows = (3 * parked.stretch[:, None] + np.arange(3)).ravel()
    earth = information @ parked.earth.covariance[np.ix_(rows, rows)] @ information
    return {VarianceSource.EARTH_RATE: earth, VarianceSource.ANGLE_RANDOM_WALK: information - earth}


def _merged(
    parts: Parts,
    table: ThermalTable,
    sessions: Sequence[_Measured],
    held: Sequence[str],
    last: NDArray | None = None,
) -> Parts:
    """The parts after sessions were merged at once; the common part of held axes stays put."""
    P = np.asarray(sum(parts.values()))
    H = np.vstack([s.H for s in sessions])
    T = block_diag(*(sum(s.departs.values()) for s in sessions))
    L = block_diag(*(s.information for s in sessions))
    M = np.linalg.solve((np.eye(len(L)) + T @ L).T, L.T).T  # L (I + T L)^-1
    M = 0.5 * (M + M.T)
    W = np.linalg.inv(np.eye(len(P)) + P @ H.T @ M @ H)
    gain = W @ P @ H.T
    last = np.eye(len(P)) if last is None else last
    reduction = last @ (np.eye(len(P)) - W) @ P @ last.T
    moved = last - common_parts(table, held, reduction) @ last
    K, left = moved @ gain @ M, last - moved @ (np.eye(len(P)) - W)
    G = moved @ gain @ (np.eye(len(T)) - M @ T)
    after: Parts = {source: left @ D @ left.T for source, D in parts.items()}
    for source, S in _sums([s.departs for s in sessions], [len(s.H) for s in sessions]):
        after[source] = after.get(source, 0.0) + K @ S @ K.T
    measured = G @ L @ G.T
    for source, N in _sums([s.shares for s in sessions], [len(s.H) for s in sessions]):
        part = G @ N @ G.T
        after[source] = after.get(source, 0.0) + part
        measured = measured - part
    after[VarianceSource.MEASURED] = after.get(VarianceSource.MEASURED, 0.0) + measured
    return after


def _sums(
    of_sessions: Sequence[Mapping[VarianceSource, NDArray]], sizes: Sequence[int]
) -> Iterator[tuple[VarianceSource, NDArray]]:
    """Each source over all sessions, which are independent of each other."""
    for source in dict.fromkeys(source for parts in of_sessions for source in parts):
        blocks = [
            parts.get(source, np.zeros((size, size))) for parts, size in zip(of_sessions, sizes)
        ]
        yield source, block_diag(*blocks)


def _with_rate_terms(result: UpdateResult, sessions: Sequence[SessionResult]) -> Parts:
    """All sessions at once, the coefficients of the rate terms being unknowns beside the table."""
    first = sessions[0].merged
    assert first is not None
    table, twin, settings = first.before, result.twin, result.settings
    fitted = [t.action is ThermalAction.RATE_TERM_FITTED for t in result.terms]
    n, terms = table.n_parameters, int(np.count_nonzero(fitted))
    start: Parts = {VarianceSource.STORED_TABLE: result.before.covariance}
    start = _before_session(start, result.before, table, _span(sessions))
    walks = n * (len(sessions) - 1)
    rest = np.zeros((walks + terms, walks + terms))
    parts = {source: block_diag(D, rest) for source, D in start.items()}
    for k, (earlier, later) in enumerate(pairwise(s.merged for s in sessions)):
        assert earlier is not None and later is not None
        own = slice(n * (k + 1), n * (k + 2))
        parts[VarianceSource.AGEING][own, own] = later.before.covariance - earlier.table.covariance
    vague = (VAGUE_TERM * DEFAULT_SIGMA_deg_h[table.gyro_technology]) ** 2
    of_terms = block_diag(np.zeros((n + walks, n + walks)), vague * np.eye(terms))
    parts[VarianceSource.HEATING_AND_COOLING] = of_terms
    brought = [_with_coefficients(s, table, result.terms, (twin, settings)) for s in sessions]
    brought = [_walked(b, k, len(sessions), n) for k, b in enumerate(brought)]
    last = np.hstack([np.eye(n)] * len(sessions) + [np.zeros((n, terms))])
    aged = table.replaced(covariance=last @ sum(parts.values()) @ last.T)
    return _merged(parts, aged, brought, unseen_in_all(sessions), last)


def _walked(session: _Measured, k: int, count: int, n: int) -> _Measured:
    """Session k of several, which reads the table of n parameters and what that went until then."""
    H, columns = session.H[:, :n], session.H[:, n:]
    walks = [H if j <= k else np.zeros_like(H) for j in range(count)]
    return replace(session, H=np.hstack([*walks, columns]))


def _with_coefficients(
    session: SessionResult,
    table: ThermalTable,
    terms: Sequence[ThermalTerm],
    under: tuple[TwinModel, SessionSettings],
) -> _Measured:
    """A session on the table of all, with columns for the coefficients that are fitted."""
    estimate = session.estimate
    assert estimate is not None
    data: SessionLikelihood = likelihood_of(session, table, *under)
    wider = with_terms(data, unfitted(terms))[1]
    brought = _brought(estimate, data.bins, wider, under)
    fitted = [term.action is ThermalAction.RATE_TERM_FITTED for term in terms]
    columns = data.regressor(ThermalKind.RATE)[:, np.flatnonzero(fitted)]
    return replace(brought, H=np.hstack([brought.H, columns]))
