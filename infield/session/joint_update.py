"""Sessions of one update taken together: is there a heating-cooling term, and what is the table
when there is one? Do the gyros read otherwise in flight than at rest?

The latter, bias = table(T) + s in flight, is looked for as the former is: the joint posterior of
table and term, each session's own departure integrated out, nothing believed of the table's level.
One flight shows s only as far as its cruise is not taken for a colder part of the table.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from infield.session.acceptance import assess_merge
from infield.session.bins import rebinned
from infield.session.disagreement import BiasStep, utc, widened_for
from infield.session.flown.information_gain import FlightTerm
from infield.session.hysteresis import (
    FOUND_SIGMAS,
    VAGUE_TERM,
    MOVED_degC_min,
    SessionLikelihood,
    ThermalTerm,
    find_terms,
    heating_sense,
    joint_posterior,
    joint_with,
    posterior_with,
    with_free_common,
    with_terms,
)
from infield.session.points import measurement_information, unseen_axes
from infield.session.reasons import ThermalAction, ThermalKind, WrongFact
from infield.session.results import SessionResult
from infield.session.settings import SessionSettings
from infield.session.wrong_facts import SessionInformation, suspicions, without_lag
from infield.table.merge import hold_common, merge_posterior
from infield.table.thermal_table import AgeingModel, ThermalTable
from ins.errors.table import DEFAULT_SIGMA_deg_h
from ins.records import AXES, Run, TwinModel
from ins.verdicts import Observability

# of an update; chosen: 1 flight alone is told by itself (`infield.session.flown.gates`)
LEAST_FLIGHTS = 2


@dataclass(frozen=True, kw_only=True)
class Walk:
    """How a unit's table goes on from run to run: it ages, and steps that are followed widen it."""

    ageing: AgeingModel = field(default_factory=AgeingModel)
    steps: tuple[BiasStep, ...] = ()

    def until(self, table: ThermalTable, run: Run, before: Run | None) -> ThermalTable:
        """The table at the start of a run. before: the last run that it holds, None: it is as it
        was made.
        """
        since = utc(table.created_utc)
        due = [s for s in self.steps if utc(s.since_utc) <= utc(run.header.start_utc)]
        if before is not None:
            held = utc(before.header.start_utc)
            since = max(since, held)
            due = [s for s in due if utc(s.since_utc) > held]
        days = (utc(run.header.start_utc) - since).total_seconds() / 86400.0
        return widened_for(table, due).aged(days, self.ageing)


STILL = Walk()  # nothing ages


def likelihood_of(
    session: SessionResult, table: ThermalTable, twin: TwinModel, settings: SessionSettings
) -> SessionLikelihood:
    """What a session measured, its bins on the given table."""
    estimate, temperature = session.estimate, session.temperature
    assert estimate is not None and temperature is not None
    bins = rebinned(estimate.bins, table, temperature, twin, settings)
    information, vector = measurement_information(estimate.bins, estimate)
    along = heating_sense(temperature.temperature_degC)
    sense = np.stack(
        [temperature.mean_rows(a, b) @ along for a, b in zip(bins.start_s, bins.end_s)]
    )
    return SessionLikelihood(bins, information, vector, estimate.bins.table_deg_h, sense)


def likelihoods_of(
    sessions: Sequence[SessionResult],
    table: ThermalTable,
    twin: TwinModel,
    settings: SessionSettings,
    walk: Walk,
) -> list[SessionLikelihood]:
    """What sessions measured, in the order of their start, and how the table went on in between."""
    found, before = [], None
    for session in sessions:
        gained = walk.until(table, session.run, before).covariance - table.covariance
        data = likelihood_of(session, table, twin, settings)
        found.append(replace(data, gained=gained))
        before = session.run
    return found


def with_thermal_terms(
    sessions: Sequence[SessionResult],
    table: ThermalTable,
    twin: TwinModel,
    settings: SessionSettings,
    walk: Walk = STILL,
) -> tuple[tuple[ThermalTerm, ...], list[SessionResult], ThermalTable | None]:
    """Terms, the sessions judged again and the merged table; (terms, sessions as they were, None)
    where none is found.

    Where sessions contradict the table, a term may explain them only if it shows inside the
    sessions, each with a free level of its own, and if it brings every one into agreement: neither
    a wrong session nor a step of the unit is a rate term. Else it is looked for in the sessions
    that agree, and one that would explain the others is named.

    One session alone names a term and acts on none: a real one repeats, and of healthy units 3 to 6
    % show one by chance.

    table: as it was before the sessions.
    """
    merged = [s for s in sessions if s.merged is not None]
    agreeing = [s for s in merged if s.verdict.accepted]
    terms: tuple[ThermalTerm, ...] = ()
    for chosen in [merged, agreeing] if len(agreeing) < len(merged) else [agreeing]:
        if not chosen:
            continue
        wide = covering(table, chosen)
        plain = [_without_lag(s) for s in chosen]
        data = likelihoods_of(plain, wide, twin, settings, walk)
        terms = find_terms(
            wide, data if chosen is agreeing else [with_free_level(d, wide) for d in data]
        )
        if len(chosen) == 1:
            terms = tuple(
                replace(term, action=ThermalAction.SEEN_IN_ONE_SESSION) if term.found else term
                for term in terms
            )
        if not any(term.found for term in terms):
            continue
        again, after = _merged_again(plain, data, wide, terms, twin, settings, walk)
        if all(s.verdict.accepted for s in again):
            new = {id(old): s for old, s in zip(chosen, again)}
            return terms, [new.get(id(s), s) for s in sessions], after
        terms = tuple(
            replace(term, action=ThermalAction.DOES_NOT_EXPLAIN) if term.found else term
            for term in terms
        )
    if len(agreeing) < len(merged):
        wide = covering(table, merged)
        terms = _or_a_wrong_session(terms, wide, likelihoods_of(merged, wide, twin, settings, walk))
    return terms, list(sessions), None


def _without_lag(session: SessionResult) -> SessionResult:
    """The session without the doubt of a lag behind temperature, which the terms take over."""
    assert session.estimate is not None
    others = tuple(s for s in session.doubted if s.fact is not WrongFact.THERMAL_LAG)
    plain = without_lag(session.estimate, session.doubted)
    return replace(session, estimate=plain, doubted=others)


def _or_a_wrong_session(
    terms: Sequence[ThermalTerm], table: ThermalTable, data: Sequence[SessionLikelihood]
) -> tuple[ThermalTerm, ...]:
    """Where sessions contradict: a split between those that warm and those that cool is named, but
    not acted upon.
    """
    plain, named = find_terms(table, data), list(terms or ())
    for k, term in enumerate(plain):
        rates = np.concatenate(
            [np.where(d.bins.tied[:, k], d.bins.rate_degC_min[:, k], 0.0) for d in data]
        )
        both = rates.min() < -MOVED_degC_min and rates.max() > MOVED_degC_min
        if both and term.found and named:
            named[k] = replace(term, action=ThermalAction.SPLIT_OR_WRONG_SESSION)
    return tuple(named)


def with_free_level(session: SessionLikelihood, table: ThermalTable) -> SessionLikelihood:
    """The session with nothing believed of each gyro's level: only changes within it are left as
    evidence.
    """
    level = (VAGUE_TERM * DEFAULT_SIGMA_deg_h[table.gyro_technology]) ** 2
    count = len(session.bins.centre_s)
    own = session.bins.own + level * np.kron(np.ones((count, count)), np.eye(3))
    return replace(session, bins=replace(session.bins, own=own))


def covering(table: ThermalTable, sessions: Sequence[SessionResult]) -> ThermalTable:
    """The table with nodes over all temperatures of the sessions."""
    seen = [s.temperature.temperature_degC for s in sessions if s.temperature is not None]
    return table.extended_to(float(min(T.min() for T in seen)), float(max(T.max() for T in seen)))


def _merged_again(
    sessions: Sequence[SessionResult],
    measured: Sequence[SessionLikelihood],
    table: ThermalTable,
    terms: Sequence[ThermalTerm],
    twin: TwinModel,
    settings: SessionSettings,
    walk: Walk,
) -> tuple[list[SessionResult], ThermalTable]:
    """Each session judged with the terms in its prior, one after the other."""
    current, again, before = table, [], None
    for session in sessions:
        current, before = walk.until(current, session.run, before), session.run
        held = unseen_axes(session.seen)
        data = likelihood_of(session, current, twin, settings)
        m0, C, m1, P1 = posterior_with(data, *with_terms(data, terms))
        merged = merge_posterior(current, data.bins.H, m0, C, m1, P1, held_axes=held)
        estimate = session.estimate
        assert estimate is not None
        suspected = suspicions(estimate, SessionInformation(C, m1 - m0, P1))
        verdict = assess_merge(merged, estimate, suspected)
        again.append(replace(session, merged=merged, verdict=verdict))
        current = merged.table
    fitted = [term.action is ThermalAction.RATE_TERM_FITTED for term in terms]
    if not any(fitted):
        return again, current
    joint = [_with_widened(data, terms) for data in measured]
    found = joint_posterior(table, joint, ThermalKind.RATE, fitted)
    gained = [data.gained for data in joint if data.gained is not None]
    table = table.replaced(covariance=table.covariance + sum(gained))
    unseen = [
        a
        for k, a in enumerate(AXES)
        if all(s.seen[k].verdict is Observability.NOT_OBSERVABLE for s in sessions)
    ]
    change, P = hold_common(table, unseen, found.change, found.covariance)
    return again, table.replaced(parameters=table.parameters + change, covariance=0.5 * (P + P.T))


def unfitted(terms: Sequence[ThermalTerm]) -> list[ThermalTerm]:
    """The terms with those left out that become a coefficient."""
    return [
        t if t.kind is ThermalKind.SENSE else replace(t, action=ThermalAction.NONE_FOUND)
        for t in terms
    ]


def _with_widened(session: SessionLikelihood, terms: Sequence[ThermalTerm]) -> SessionLikelihood:
    """The session with the terms that are not fitted in its own covariance."""
    _, wider = with_terms(session, unfitted(terms))
    return replace(session, bins=replace(session.bins, own=session.bins.own + wider))


def find_flight_terms(
    sessions: Sequence[SessionResult],
    table: ThermalTable,
    twin: TwinModel,
    settings: SessionSettings,
    walk: Walk = STILL,
) -> tuple[FlightTerm, ...]:
    """One term a gyro; empty where fewer than LEAST_FLIGHTS sessions were joined by their flight.

    table: as it was before the sessions.
    """
    flown = [s for s in sessions if s.merged is not None and _aloft(s).any()]
    if len(flown) < LEAST_FLIGHTS:
        return ()
    used = [_as_usual(s) for s in sessions if s.merged is not None]
    free = with_free_common(covering(table, used))
    data = likelihoods_of(used, free, twin, settings, walk)
    found = joint_with(free, [(d, _columns(s)) for d, s in zip(data, used)])
    sigma = np.sqrt(np.diag(found.terms_covariance))
    return tuple(
        FlightTerm(
            axis=axis,
            value_deg_h=float(found.terms[k]),
            sigma_deg_h=float(sigma[k]),
            flights=len(flown),
            found=bool(abs(found.terms[k]) > FOUND_SIGMAS * sigma[k]),
        )
        for k, axis in enumerate(AXES)
    )


def _as_usual(session: SessionResult) -> SessionResult:
    """The session with its flight as the usual prior has it."""
    if session.flight is None or session.flight.as_usual is None:
        return session
    return replace(session, estimate=session.flight.as_usual)


def _aloft(session: SessionResult) -> NDArray:
    """Share of each bin (N,) that a joined flight spends in the air."""
    assert session.estimate is not None
    bins, evidence = session.estimate.bins, session.flight
    if evidence is None or evidence.joined is None:
        return np.zeros(bins.start_s.size)
    flight = evidence.flight
    shared = np.minimum(bins.end_s, flight.end_s) - np.maximum(bins.start_s, flight.start_s)
    return np.asarray(np.maximum(shared, 0.0) / bins.duration_s)


def _columns(session: SessionResult) -> NDArray:
    """What a term of 1 adds to each bin (3N, 3)."""
    return np.kron(_aloft(session)[:, None], np.eye(3))
