"""What the found effects cost in navigation: the drift of a session like those recorded, as it is
and with the effects taken out.

A session aligns over ALIGN_S and then navigates unaided while it stands. To first order (physics.md
6.2) its errors are the twin's own noise (turn-on, flicker, random walks) and what the effects add.
With D its level position error over its time, from one unit of each coefficient, b the fitted
coefficients and C their covariance, over sessions, headings and noise::

    as it is  d^2 = s^2 + b' M b + tr(M C)
    without   d^2 = s^2 + tr(M C)             M = mean of D' D over sessions and headings

so that no figure has the luck of one run. The interval is that of d over draws of the coefficients
from N(b, C) and of the sessions (Bayesian bootstrap, Rubin 1981, Ann. Statist. 9, 130).

Left out: what an effect owes to the heading itself, the error of the table, and noises that were
found, for nothing takes a noise out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from infield.replay.drift_prediction import (
    PREDICTION_STEP_S,
    aligned_errors,
    parked_step,
    predict_parked,
)
from infield.session.bins import equal_edges
from infield.session.settings import BIN_S
from infield.table.merge import session_covariance
from ins.documents import written_as
from ins.errors.telemetry import Trace
from ins.estimation.states import ACCEL, POS, THETA, W
from ins.estimation.tape import ACCELEROMETER, GYRO
from ins.records import TwinModel
from ins.units import ARCSEC, DEG_PER_HOUR, KNOT
from simreal.evidence.run_view import RunView
from simreal.inference.diagnosis import Diagnosis
from simreal.predict.traces import fitted, found_columns, unit_traces

ALIGN_S = 600.0  # 10 min, as in the reference scenario of requirements.md
LONGEST_NAVIGATION_S = 3600.0
# of navigation after the alignment; chosen: 10 min, over which an acceleration shows 0.735 of the
# tilt rate behind it (physics.md 6.3)
SHORTEST_NAVIGATION_S = 600.0
ARCMIN = 60.0 * ARCSEC
QUARTERS = 4  # headings whose mean is that of all: a square has no more than two turns in it
DRAWS = 2000  # of coefficients and sessions: 50 of them lie beyond either end of an interval
INTERVAL = (2.5, 97.5)


@dataclass(frozen=True)
class NavigationEnd:
    """At the end of unaided navigation, RMS over noise."""

    rate_nm_h: float
    speed_m_s: float


@dataclass(frozen=True, kw_only=True)
class UserLevel:
    """A run on its own heading, aligned over `align_s`, then free-inertial over `navigated_s`: as
    it is, and without the found effects.

    heading_change_arcmin : of the alignment, as it is less without.
    """

    run_id: str
    align_s: float
    navigated_s: float
    heading_change_arcmin: float
    as_it_is: NavigationEnd = field(metadata=written_as("with"))
    without: NavigationEnd


@dataclass(frozen=True)
class Expected:
    """RMS of a drift over sessions, and the 95 % interval of that RMS."""

    rms_nm_h: float
    interval_95: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class SessionDrift:
    """Radial drift expected of sessions like those recorded, on any heading.

    noise_nm_h : of the twin's own noise. gained : as it is less without. by_cause_nm_h : of each
    cause alone, without noise, in the order of the causes; 0 where it touches no parked sensor.
    """

    sessions: int
    align_s: float
    noise_nm_h: float
    as_it_is: Expected
    without: Expected
    gained: Expected
    by_cause_nm_h: tuple[float, ...]


@dataclass(frozen=True)
class _Session:
    """One run: position and velocity error at the end (2, p) and heading error of the alignment
    (p,) by column, on its own heading and on others (QUARTERS, 2, p); sigmas of the noise.
    """

    view: RunView
    navigated_s: float
    position: NDArray
    velocity: NDArray
    heading: NDArray
    sigma_radial_m: float
    sigma_speed_m_s: float


def sessions_of(diagnosis: Diagnosis) -> tuple[SessionDrift | None, tuple[UserLevel, ...]]:
    """The drift expected over sessions, and run by run; none where no run is parked for long enough
    and finds north, or no found effect touches its gyros and accelerometers.
    """
    attribution = diagnosis.attribution
    found = found_columns(attribution)
    every = [_session(diagnosis, k, found) for k in range(len(diagnosis.views))]
    sessions = [s for s in every if s is not None]
    if not any(np.any(s.position) for s in sessions):
        return None, ()
    beta, covariance = fitted(attribution)
    beta, covariance = beta[found], covariance[np.ix_(found, found)]
    columns = attribution.columns[found]
    slots = [attribution.slots[k] for k in diagnosis.order]
    owned = [np.isin(columns, slot.columns) for slot in slots]
    levels = tuple(_level(s, beta) for s in sessions if np.any(s.position))
    return _expected(sessions, beta, covariance, owned), levels


def _session(diagnosis: Diagnosis, run: int, found: NDArray) -> _Session | None:
    view, twin = diagnosis.views[run], diagnosis.twin
    start, end = view.start_s, min(view.end_s, view.start_s + ALIGN_S + LONGEST_NAVIGATION_S)
    if not view.telemetry.heading_known or end - start < ALIGN_S + SHORTEST_NAVIGATION_S:
        return None
    traces = [t for t, mine in zip(unit_traces(diagnosis, run), found) if mine]
    inputs = _inputs(view, traces, end)
    ends = [_errors(view, twin, quarter, inputs, end) for quarter in range(QUARTERS)]
    edges = equal_edges(start, end, BIN_S)
    noise = predict_parked(
        edges_s=edges,
        covariance=_own_bias(edges, twin, view.run_s),
        twin=twin,
        site=view.run.header.site,
        C_nb=view.C_nb,
        alignment=(start, start + ALIGN_S),
        end_s=end,
    )
    return _Session(
        view=view,
        navigated_s=end - start - ALIGN_S,
        position=np.stack([errors[POS] for errors, _ in ends]),
        velocity=ends[0][0][W],
        heading=ends[0][1],
        sigma_radial_m=float(noise.sigma_radial_m[-1]),
        sigma_speed_m_s=float(noise.sigma_speed_m_s[-1]),
    )


def _inputs(view: RunView, traces: Sequence[Trace], end_s: float) -> tuple[NDArray, NDArray]:
    """What each trace adds to gyros and accelerometers (6, p): its mean over the alignment, and at
    the middle of each step of navigation (k, 6, p); rad/s, m/s^2.
    """
    t, start = view.telemetry.time_s, view.start_s + ALIGN_S
    aligning = (t > view.start_s) & (t <= start)
    edges = equal_edges(start, end_s, PREDICTION_STEP_S)
    middle = 0.5 * (edges[1:] + edges[:-1])
    mean, steps = np.zeros((6, len(traces))), np.zeros((middle.size, 6, len(traces)))
    for p, trace in enumerate(traces):
        for first, added in ((0, trace.gyro_rad_s), (3, trace.accel_m_s2)):
            if added is None:
                continue
            for axis, series in enumerate(added.T, start=first):
                mean[axis, p] = series[aligning].mean()
                steps[:, axis, p] = np.interp(middle, t, series)
    return mean, steps


def _errors(
    view: RunView, twin: TwinModel, quarter: int, inputs: tuple[NDArray, NDArray], end_s: float
) -> tuple[NDArray, NDArray]:
    """Errors (42, p) at the end of navigation on a heading so many quarters on, and the heading
    error (p,) of the alignment [rad].
    """
    site, (mean, steps) = view.run.header.site, inputs
    angle = 0.5 * np.pi * quarter
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    C_nb = view.C_nb.copy()
    C_nb[:2] = turn @ C_nb[:2]
    span = view.start_s, view.start_s + ALIGN_S
    start = aligned_errors(np.array(span), site, C_nb, span)
    errors = start[:, :3] @ mean[:3] / DEG_PER_HOUR + start[:, 3:] @ mean[3:5]
    errors[ACCEL] = 0.0  # an effect's comes with the steps
    heading = errors[THETA][2].copy()
    Phi, Gamma, _ = parked_step(site, C_nb, twin, (end_s - span[1]) / len(steps))
    of_sensors = Gamma[:, GYRO : ACCELEROMETER + 3]
    for step in steps:
        errors = Phi @ errors + of_sensors @ step
    return errors, heading


def _own_bias(edges_s: NDArray, twin: TwinModel, run_s: float) -> NDArray:
    """Covariance (3N, 3N) [(deg/h)^2] of a session's own gyro biases, x, y, z of bin 0 first."""
    count = edges_s.size - 1
    return session_covariance(
        axis_index=np.tile(np.arange(3), count),
        time_s=np.repeat(0.5 * (edges_s[1:] + edges_s[:-1]), 3),
        duration_s=np.repeat(np.diff(edges_s), 3),
        gyro=twin.gyro,
        run_length_s=run_s,
    )


def _level(session: _Session, beta: NDArray) -> UserLevel:
    radial = float(np.linalg.norm(session.position[0] @ beta))
    speed = float(np.linalg.norm(session.velocity @ beta))
    noise_m, noise_m_s = session.sigma_radial_m, session.sigma_speed_m_s
    per_hour = 1.0 / (session.navigated_s * KNOT)
    return UserLevel(
        run_id=session.view.name,
        align_s=ALIGN_S,
        navigated_s=session.navigated_s,
        heading_change_arcmin=float(session.heading @ beta) / ARCMIN,
        as_it_is=NavigationEnd(np.hypot(radial, noise_m) * per_hour, np.hypot(speed, noise_m_s)),
        without=NavigationEnd(noise_m * per_hour, noise_m_s),
    )


def _expected(
    sessions: Sequence[_Session], beta: NDArray, covariance: NDArray, owned: Sequence[NDArray]
) -> SessionDrift:
    """owned : of each cause, which columns are its own."""
    rates = [s.position / (s.navigated_s * KNOT) for s in sessions]
    squares = np.stack([np.einsum("qip,qir->pr", D, D) / QUARTERS for D in rates])
    noise = np.array([(s.sigma_radial_m / (s.navigated_s * KNOT)) ** 2 for s in sessions])
    M, floor = squares.mean(axis=0), float(noise.mean())
    left = float(np.sum(M * covariance))
    own = [
        float(np.sqrt(np.where(mine, beta, 0.0) @ M @ np.where(mine, beta, 0.0))) for mine in owned
    ]
    rng = np.random.default_rng(0)
    share = rng.dirichlet(np.ones(len(sessions)), DRAWS)
    # each in its own sigma, as their units differ; a coefficient without any trace has none
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    seen = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(seen, seen))
    root = sigma[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    off = rng.standard_normal((DRAWS, beta.size)) @ root.T
    drawn = beta + off
    before = np.sqrt(share @ noise + np.einsum("dk,kpr,dp,dr->d", share, squares, drawn, drawn))
    after = np.sqrt(share @ noise + np.einsum("dk,kpr,dp,dr->d", share, squares, off, off))
    as_it_is = float(np.sqrt(floor + beta @ M @ beta + left))
    without = float(np.sqrt(floor + left))
    return SessionDrift(
        sessions=len(sessions),
        align_s=ALIGN_S,
        noise_nm_h=float(np.sqrt(floor)),
        as_it_is=Expected(as_it_is, _interval(before)),
        without=Expected(without, _interval(after)),
        gained=Expected(as_it_is - without, _interval(before - after)),
        by_cause_nm_h=tuple(own),
    )


def _interval(drawn: NDArray) -> tuple[float, float]:
    low, high = np.percentile(drawn, INTERVAL)
    return float(low), float(high)
