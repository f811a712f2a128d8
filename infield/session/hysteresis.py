"""Does a gyro read otherwise while it warms than while it cools? Found over all sessions of an
update at once.

Two descriptions are tried on each axis beside the table, with the joint covariance of each
session's points, so that heading, turn-on and everything else that a session's points share cancels
in the difference::

    rate   bias = table(T) + r dT/dt               r in deg/h per degC/min: a gradient follows the
                                                   rate of change
    sense  bias = table(T) + s sigma(T history)    sigma from -1 (cooling) to +1 (heating) over
                                                   WIDTH_degC of turn-round

Per session, with x the bias beyond what was subtracted, the data say exp(-x'Lx/2 + e'x)
(`measurement_information`); its own departure t ~ N(0, T) is integrated out::

    L' = (I + L T)^-1 L,    e' = (I + L T)^-1 e

Source: Bayesian linear regression with a Gaussian prior, P^-1 + J'L'J (Bishop 2006, eq. 3.50,
3.51).

Decision: docs/decisions/0017-heating-cooling.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.session.bins import SessionBins
from infield.session.reasons import ThermalAction, ThermalKind
from infield.table.thermal_table import ThermalTable
from ins.documents import written
from ins.errors.table import DEFAULT_SIGMA_deg_h
from ins.records import AXES
from ins.verdicts import Reason, because, sentence

WIDTH_degC = 3.0  # a turned-round temperature forgets its past over this
# |z| of a term that is taken for real: two descriptions of three axes, 2 to 3 % of false alarms
FOUND_SIGMAS = 2.8
# prior sigma of a term in sigmas of the technology's default table: beyond any unit of the class
VAGUE_TERM = 100.0
MOVED_degC_min = 0.02  # mean rates all below this do not test anything


@dataclass(frozen=True)
class SessionLikelihood:
    """What one session measured: information (3N, 3N) and vector (3N,) about its biases less
    `reference` [deg/h].

    bins: on the table of the moment; sense (N, 3): mean heating sense over each bin, -1 to 1;
    gained (n, n): by what the table's covariance grew since the session before, None: by nothing.
    """

    bins: SessionBins
    information: NDArray
    vector: NDArray
    reference_deg_h: NDArray
    sense: NDArray
    gained: NDArray | None = None

    def regressor(self, kind: ThermalKind) -> NDArray:
        """Columns (3N, 3), one an axis, of the rate or the sense of each bin; zero where no
        temperature is known.
        """
        values = np.where(
            self.bins.tied, self.bins.rate_degC_min if kind is ThermalKind.RATE else self.sense, 0.0
        )
        return values.reshape(-1)[:, None] * np.tile(np.eye(3), (len(values), 1))


# what is done about a term that is taken for real
ACTIONS = {
    ThermalKind.RATE: ThermalAction.RATE_TERM_FITTED,
    ThermalKind.SENSE: ThermalAction.SIGMA_WIDENED,
}


@written("axis kind value sigma z action unit text")
@dataclass(frozen=True, kw_only=True)
class ThermalTerm:
    """One axis: the better description, its coefficient and sigma (deg/h per degC/min, or deg/h
    half of the split), and what was done about it.
    """

    axis: str
    kind: ThermalKind
    value: float
    sigma: float
    action: ThermalAction

    @property
    def z(self) -> float:
        return self.value / self.sigma if self.sigma > 0 else 0.0

    @property
    def unit(self) -> str:
        return "deg/h per degC/min" if self.kind is ThermalKind.RATE else "deg/h"

    @property
    def text(self) -> str:
        return sentence(self.reason)

    @property
    def found(self) -> bool:
        return self.action in ACTIONS.values()

    @property
    def reason(self) -> Reason:
        """What was found, and what was done about it; of a sense the whole split is said."""
        times = 1.0 if self.kind is ThermalKind.RATE else 2.0
        return because(
            self.action,
            axis=self.axis,
            kind=self.kind,
            value=times * self.value,
            sigma=times * self.sigma,
            sigmas=abs(self.z),
        )


@dataclass(frozen=True)
class JointPosterior:
    """Table parameters beyond the prior's (n,) with covariance (n, n), the terms (k,) with theirs
    (k, k).
    """

    change: NDArray
    covariance: NDArray
    terms: NDArray
    terms_covariance: NDArray


def heating_sense(temperature_degC: NDArray) -> NDArray:
    """From -1 (cooling) to +1 (heating) along temperatures (n, 3): follows the sense over
    WIDTH_degC, starts at 0.
    """
    change = np.diff(temperature_degC, axis=0, prepend=temperature_degC[:1])
    keep, sense = np.exp(-np.abs(change) / WIDTH_degC), np.sign(change)
    state, out = np.zeros(temperature_degC.shape[1]), np.empty_like(temperature_degC)
    for k in range(len(change)):
        state = sense[k] + (state - sense[k]) * keep[k]
        out[k] = state
    return out


def joint_posterior(
    table: ThermalTable,
    sessions: Sequence[SessionLikelihood],
    kind: ThermalKind,
    axes: Sequence[bool] = (True, True, True),
) -> JointPosterior:
    """Table and terms of some axes from all sessions at once; the sessions' bins must stand on this
    table.
    """
    used = np.flatnonzero(axes)
    found = joint_with(table, [(s, s.regressor(kind)[:, used]) for s in sessions])
    terms, spread = np.zeros(3), np.zeros((3, 3))
    terms[used], spread[np.ix_(used, used)] = found.terms, found.terms_covariance
    return JointPosterior(found.change, found.covariance, terms, spread)


def joint_with(
    table: ThermalTable, sessions: Sequence[tuple[SessionLikelihood, NDArray]]
) -> JointPosterior:
    """Table and terms from all sessions at once, each with what the terms add to its bins (3N, k).

    The terms are k; the sessions' bins must stand on this table. The table walks from session to
    session by what its covariance gains; what comes out is the table of the last one.
    """
    roots = [_root(table.covariance)]
    roots += [_root(s.gained) for s, _ in sessions if s.gained is not None]
    walk = np.hstack(roots)  # parameters at the last = table + walk v, v ~ N(0, I)
    n, count = walk.shape[1], sessions[0][1].shape[1] if sessions else 0
    vague = VAGUE_TERM * DEFAULT_SIGMA_deg_h[table.gyro_technology]
    information = np.diag(np.concatenate([np.ones(n), np.full(count, vague**-2)]))
    vector, walked = np.zeros(n + count), roots.pop(0).shape[1]
    for s, columns in sessions:
        walked += 0 if s.gained is None else roots.pop(0).shape[1]
        until = np.where(np.arange(n) < walked, walk, 0.0)
        J = np.hstack([s.bins.H @ until, columns])
        own = np.eye(len(J)) + s.information @ s.bins.own
        L, e = np.linalg.solve(own, s.information), np.linalg.solve(own, s.vector)
        offset = s.bins.table_deg_h - s.reference_deg_h
        information += J.T @ L @ J
        vector += J.T @ (e - L @ offset)
    P = np.linalg.inv(0.5 * (information + information.T))
    mean = P @ vector
    covariance = walk @ P[:n, :n] @ walk.T
    return JointPosterior(walk @ mean[:n], 0.5 * (covariance + covariance.T), mean[n:], P[n:, n:])


def _root(P: NDArray) -> NDArray:
    """R (n, rank) with R R' = P."""
    values, vectors = np.linalg.eigh(P)
    seen = values > 0.0
    return np.asarray(vectors[:, seen] * np.sqrt(values[seen]))


def with_free_common(table: ThermalTable) -> ThermalTable:
    """The table with nothing believed of the common shift of each axis; its shape over temperature
    stays.
    """
    P, level = table.covariance.copy(), VAGUE_TERM * DEFAULT_SIGMA_deg_h[table.gyro_technology]
    for axis in AXES:
        P[table.values_of(axis), table.values_of(axis)] += level**2
    return table.replaced(covariance=P)


def find_terms(
    table: ThermalTable, sessions: Sequence[SessionLikelihood]
) -> tuple[ThermalTerm, ...]:
    """For each axis the description that explains more, and whether it is found.

    Nothing is believed here of the level of the table: a session that only warms or only cools
    cannot tell a term from a table that is off, and a gyro that aged by more than its sigma says
    has no hysteresis for it.
    """
    if not sessions:
        return ()
    free = with_free_common(table)
    fits = {kind: joint_posterior(free, sessions, kind) for kind in ACTIONS}
    found = []
    for k, axis in enumerate(AXES):
        kind, value, spread = ThermalKind.RATE, 0.0, 0.0
        action = ThermalAction.NOT_TESTED
        if np.max(np.abs(rates_of(sessions, k))) >= MOVED_degC_min:
            sigma = {kind: float(np.sqrt(fit.terms_covariance[k, k])) for kind, fit in fits.items()}
            kind = max(fits, key=lambda kind: abs(fits[kind].terms[k]) / sigma[kind])
            value, spread, action = float(fits[kind].terms[k]), sigma[kind], ACTIONS[kind]
            if abs(value) <= FOUND_SIGMAS * spread:
                action = ThermalAction.NONE_FOUND
        found.append(ThermalTerm(axis=axis, kind=kind, value=value, sigma=spread, action=action))
    return tuple(found)


def rates_of(sessions: Sequence[SessionLikelihood], k: int) -> NDArray:
    """Temperature rates [degC/min] of gyro k in all bins of some sessions, 0 where not known."""
    rates = [np.where(s.bins.tied[:, k], s.bins.rate_degC_min[:, k], 0.0) for s in sessions]
    return np.concatenate(rates)


def with_terms(session: SessionLikelihood, terms: Sequence[ThermalTerm]) -> tuple[NDArray, NDArray]:
    """Mean (3N,) and covariance (3N, 3N) [deg/h] that the found terms add to the prior of a
    session's biases.

    A fitted rate term: its value, and its own uncertainty; a sense: no mean, its size as a standard
    deviation.
    """
    mean, covariance = np.zeros(len(session.vector)), np.zeros_like(session.information)
    for k, term in enumerate(terms):
        if not term.found:
            continue
        D = session.regressor(term.kind)[:, k]
        variance = term.sigma**2 if term.kind is ThermalKind.RATE else term.value**2 + term.sigma**2
        mean += D * (term.value if term.kind is ThermalKind.RATE else 0.0)
        covariance += variance * np.outer(D, D)
    return mean, covariance


def posterior_with(
    session: SessionLikelihood, mean: NDArray, covariance: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Prior and posterior (mean, covariance, mean, covariance) of a session's biases when its prior
    is moved so.
    """
    m0, C = session.bins.table_deg_h + mean, session.bins.prior + covariance
    L = np.linalg.cholesky(C)
    inner = np.linalg.inv(np.eye(len(C)) + L.T @ session.information @ L)
    P1 = L @ inner @ L.T
    step = session.vector - session.information @ (m0 - session.reference_deg_h)
    return m0, C, m0 + P1 @ step, 0.5 * (P1 + P1.T)
