"""What `update.json` says of sessions without a heading (zero-rate biases of a parked unit):
budget, assumptions, effect.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from infield.reports.documents.alignment import FilterNis
from infield.reports.documents.session_records import StretchDocument, ZeroRateDocument
from infield.reports.documents.update_records import ZeroRateEffect
from infield.session.estimate import ParkedEvidence, SessionEstimate
from infield.session.flown.priors import Further
from infield.session.parked.rates import ANOTHER_ATTITUDE
from infield.session.results import SessionResult, UpdateResult
from ins.documents import made
from ins.earth import EARTH_RATE_RAD_S
from ins.noise import FLICKER_FLOOR, random_walk_covariance
from ins.records import Phase
from ins.units import DEG, DEG_PER_HOUR, HOUR

METHOD = (
    "zero-rate bias of a parked unit against temperature, no heading needed: levelled Earth rate"
    " removed, joint merge"
)
UNDER_WAY = (
    "; what lies between the rests by a filter of its errors with the receiver, joined to them"
)


def method(result: UpdateResult) -> str:
    """How the biases of these sessions were found."""
    flown = any(s.flight is not None and s.flight.joined is not None for s in result.sessions)
    return METHOD + UNDER_WAY * flown


def parked_sessions(result: UpdateResult) -> list[SessionResult]:
    """The sessions that were estimated without a heading."""
    return [s for s in result.sessions if s.estimate is not None and s.estimate.parked is not None]


def measurements(e: SessionEstimate) -> Mapping[str, FilterNis]:
    """How the rates change along the session, against the noise model."""
    if not e.dof:
        return {}
    return {"zero rate over time": FilterNis(nis_mean=e.nis_mean, dof=e.dof)}


def zero_rate(e: SessionEstimate) -> ZeroRateDocument | None:
    """What the parked seconds of a session gave; None of one that never stood."""
    p = evidence_of(e)
    if not p.stretches:
        return None
    return made(
        ZeroRateDocument,
        p,
        roll_deg=e.alignment.roll_rad / DEG,
        pitch_deg=e.alignment.pitch_rad / DEG,
        bin_s=float(e.bins.duration_s.mean()),
        bins=len(e.bins.duration_s),
        stretches=_stretches(e) if len(p.stretches) > 1 else None,
    )


def evidence_of(e: SessionEstimate) -> ParkedEvidence:
    """What the parked seconds of a session without a heading said."""
    assert e.parked is not None
    return e.parked


def _stretches(e: SessionEstimate) -> list[StretchDocument]:
    """Every stretch of rest: when, how long, how warm, and how far the unit was turned since the
    one before.
    """
    p, found = evidence_of(e), []
    for k, stretch in enumerate(p.stretches):
        T, turn = e.bins.temperature_degC[p.stretch == k], p.turns[k - 1] if k else None
        start_s, end_s = float(stretch.seconds.start_s[0]), float(stretch.seconds.end_s[-1])
        found.append(
            StretchDocument(
                start_s=start_s,
                duration_s=end_s - start_s,
                still_s=stretch.still_s,
                bins=int(np.count_nonzero(p.stretch == k)),
                temperature_degC=(float(T.min()), float(T.max())),
                turned_deg=None if turn is None else turn.heading_rad / DEG,
                sigma_turned_deg=None if turn is None else turn.sigma_rad / DEG,
                turn_told=None if turn is None else turn.told,
            )
        )
    return found


def phases(e: SessionEstimate) -> tuple[Phase, ...]:
    """The first stretch of rest as the alignment, the others as parked."""
    stretches = evidence_of(e).stretches
    spans = [(float(s.seconds.start_s[0]), float(s.seconds.end_s[-1])) for s in stretches]
    names = ["alignment", *["parked"] * (len(spans) - 1)]
    return tuple(Phase(phase=name, start_s=a, end_s=b) for name, (a, b) in zip(names, spans))


def stretch_words(zero_rate: ZeroRateDocument) -> list[str]:
    """An attitude other than a table's, the stretches of one run and what was left out, a line
    each; none for a run of one stretch and nothing else.
    """
    lines = []
    roll, pitch = zero_rate.roll_deg, zero_rate.pitch_deg
    if np.cos(roll * DEG) * np.cos(pitch * DEG) < np.cos(ANOTHER_ATTITUDE):
        lines.append(
            f"stood at roll {roll:.0f}, pitch {pitch:.0f} deg by gravity: sigmas hold what the"
            " specific force may add to the gyros in this attitude"
        )
    for k, s in enumerate(zero_rate.stretches or ()):
        low, high = s.temperature_degC
        lines.append(
            f"stretch {k + 1}: {s.duration_s:.0f} s from {s.start_s:.0f} s on, {low:.1f} to"
            f" {high:.1f} degC{_turn_words(s)}"
        )
    return lines + [
        f"left out: {s.start_s:.0f} to {s.end_s:.0f} s: {s.reason}"
        for s in zero_rate.left_out or ()
    ]


def _turn_words(stretch: StretchDocument) -> str:
    """How far the unit was turned since the stretch before; empty for the first."""
    turned, sigma = stretch.turned_deg, stretch.sigma_turned_deg
    if turned is None or sigma is None:
        return ""
    if stretch.turn_told:
        return f"; turned by {turned:+.0f} +- {sigma:.0f} deg since the one before"
    return f"; how far it was turned is not known (+- {min(sigma, 180.0):.0f} deg)"


def budget_terms(session: SessionResult, result: UpdateResult) -> list[Mapping[str, float]]:
    """Terms of the session's mean bias on x, y and z, each alone, one sigma."""
    assert session.estimate is not None
    p, gyro = evidence_of(session.estimate), result.twin.gyro
    ways = _of_ways(session)
    if not p.stretches:
        of_start = {"turn-on, this session against the mean": gyro.turn_on_deg_h}
        return [of_start | {term: sigma[k] for term, sigma in ways.items()} for k in range(3)]
    seconds = float(p.used_s.sum())
    walk = (
        gyro.rate_random_walk_deg_h_sqrt_h**2
        / HOUR
        * random_walk_covariance(np.zeros(1), np.array([seconds]))
    )
    heading = np.sqrt(p.of_mean(p.earth.of_heading))
    if len(p.stretches) == 1:
        heading = p.earth.heading_deg_h[0] * np.sqrt(np.maximum(1.0 - p.earth.down_b[0] ** 2, 0.0))
    rest = np.sqrt(np.maximum(p.of_mean(p.earth.covariance) - heading**2, 0.0))
    return [
        {
            "angle random walk": p.walk_deg_sqrt_h[k] / np.sqrt(seconds / HOUR),
            "Earth rate on an unknown heading": heading[k],
            "Earth rate: level, scale factor": rest[k],
            "turn-on, this session against the mean": gyro.turn_on_deg_h,
            "bias instability": FLICKER_FLOOR * gyro.bias_instability_deg_h,
            "rate random walk": float(np.sqrt(walk[0, 0])),
            **{term: sigma[k] for term, sigma in ways.items()},
        }
        for k in range(3)
    ]


def _of_ways(session: SessionResult) -> Mapping[str, NDArray]:
    """Terms of what the ways between the rests add, one sigma (3,)."""
    evidence = session.flight
    if evidence is None or evidence.joined is None:
        return {}
    joined, flight = evidence.joined, evidence.flight
    bins = joined.bins
    under_way = (bins.start_s >= flight.start_s) & (bins.end_s <= flight.end_s)
    if not under_way.any():
        return {}
    weight = bins.duration_s * under_way
    rows = np.kron(weight / weight.sum(), np.eye(3))
    mean = np.sqrt(np.diag(rows @ joined.covariance @ rows.T))
    terms = {"ways with the receiver: mean of their bins": mean}
    shift = next((c for c in evidence.carried if c.state is Further.SHIFT), None)
    if shift is not None:
        terms["what a gyro reads under way against at rest"] = shift.sigma / DEG_PER_HOUR
    return terms


def assumptions(result: UpdateResult) -> list[str]:
    """What a reader must believe for these numbers to hold."""
    twin = result.twin
    found = [evidence_of(s.estimate) for s in parked_sessions(result) if s.estimate]
    found = [evidence for evidence in found if evidence.stretches]
    north = max((float(p.earth.heading_deg_h.max()) for p in found), default=0.0)
    several = any(len(p.stretches) > 1 for p in found)
    common = (
        "one common error of all points of a stretch of rest, the turns between the stretches of a"
        " run as the gyros tell them"
        if several
        else "one common error of all points of a session"
    )
    heading = (
        f"no heading is known: the level part of Earth rate is {common}, {north:.1f} deg/h (1"
        " sigma) on a level axis; headings of different sessions are taken as unrelated, so a unit"
        " that always parks the same way keeps that part in its table (a surveyed heading in"
        " run.json takes it out)"
        if north
        else "the surveyed heading takes the level part of Earth rate out"
    )
    if not found:
        heading = (
            "the heading of the parked unit need not be known; what it leaves of Earth rate is one"
            " error of a session"
        )
    noisiest = max((p.noise_scale for p in found), default=0.0)
    said = f", the log's own where larger (at most {noisiest:.2g} times the model)" if found else ""
    return [
        heading,
        (
            f"level by gravity, accelerometers within {twin.accel.turn_on_ug:g} ug (1 sigma);"
            " vertical Earth rate is removed"
        ),
        "the unit stands: a turn at one steady rate all along would be taken for a bias",
        f"noise of the unit from {twin.source}{said}",
        (
            f"each power-on departs from the table by {twin.gyro.turn_on_deg_h:g} deg/h (1 sigma,"
            " turn-on)"
        ),
        (
            f"ageing of the table {result.ageing.common_deg_h_sqrt_year:g} deg/h common and "
            f"{result.ageing.shape_deg_h_sqrt_year:g} deg/h shape per square root of a year"
        ),
    ]


def effect(result: UpdateResult) -> ZeroRateEffect | None:
    """The change of the table over the temperatures of the last merged session, its level and its
    shape apart.
    """
    merged = [s for s in parked_sessions(result) if s.merged is not None]
    if not merged or not result.merged_runs or merged[-1].estimate is None:
        return None
    T = merged[-1].estimate.bins.temperature_degC
    change: list[NDArray] = []
    level_left: list[float] = []
    shape_left: list[float] = []
    for k in range(3):
        change.append(result.after.bias_deg_h(k, T[:, k]) - result.before.bias_deg_h(k, T[:, k]))
        rows = result.after.basis(k, T[:, k])
        P = rows @ result.after.covariance @ rows.T
        level_left.append(float(P.mean()))
        shape_left.append(float(np.mean(np.diag(P)) - P.mean()))
    of_gyro = np.stack(change)
    shape = of_gyro - of_gyro.mean(axis=1, keepdims=True)
    return ZeroRateEffect(
        level_change_deg_h=float(np.sqrt(np.mean(of_gyro.mean(axis=1) ** 2))),
        shape_change_deg_h=float(np.sqrt(np.mean(shape**2))),
        level_left_sigma_deg_h=float(np.sqrt(np.mean(level_left))),
        shape_left_sigma_deg_h=float(np.sqrt(max(float(np.mean(shape_left)), 0.0))),
        turn_on_deg_h=result.twin.gyro.turn_on_deg_h,
        earth_rate_deg_h=EARTH_RATE_RAD_S / DEG_PER_HOUR,
        temperature_degC=(float(T.min()), float(T.max())),
    )


def effect_words(found: ZeroRateEffect) -> str:
    """One line of it for people."""
    low, high = found.temperature_degC
    return (
        f"over {low:.0f} to {high:.0f} degC the table's level changes by"
        f" {found.level_change_deg_h:.3g} deg/h (sigma now {found.level_left_sigma_deg_h:.3g}),"
        f" its shape by {found.shape_change_deg_h:.3g} deg/h (sigma now"
        f" {found.shape_left_sigma_deg_h:.3g}), RMS over the gyros; each start adds a turn-on"
        f" of {found.turn_on_deg_h:g}"
    )
