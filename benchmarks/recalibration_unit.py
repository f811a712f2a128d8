"""One unit of the recalibration study: five sessions, every rule's table after each, its errors
against truth.

All rules see the same sessions. `update_calibration` makes our table and, on the way, what each
session measured; from that come the exact merge's evidence and the baselines' points, in two kinds,
so that no baseline is shown at its worse::

    measured   the points of `update.json`: each temperature for itself, nothing assumed of the
               bias between them
    smoothed   the same measurement where the departure from the factory table is a constant and
               a smooth small curve
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks import free_inertial
from benchmarks.baselines import BASELINES, IndependentVariance, Points
from benchmarks.exact_merge import Evidence, exact_merge, posterior
from benchmarks.free_inertial import Flown, Hour, Sortie
from infield.session.bins import BIN_FLOOR_DEG_H
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.points import measurement_information
from infield.session.results import SessionResult, UpdateResult
from infield.table.file import table_from_dict, table_sha256, table_to_dict
from infield.table.merge import merge_posterior, session_covariance
from infield.table.thermal_table import ThermalTable, smooth_kernel
from ins.records import AXES, AccelNoise, GyroNoise, Site, TwinModel, VehicleNoise
from ins.units import DEG
from ins.verdicts import sentences
from tests.reference_motions import reference_motion
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import STARTS, ThermalHistory, thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import UnitTruth, aged_unit

SESSIONS = 5
HEADINGS_DEG = np.arange(0.0, 360.0, 15.0)
LATITUDES_DEG = np.array([-45.0, 0.0, 30.0, 45.0, 60.0])
# the ageing, physics.md 6.8: together 0.0072 deg/h
OFFSET_DEG_H, SHAPE_DEG_H, LENGTH_DEGC = 0.006, 0.004, 30.0
VAGUE_DEG_H = 1.0  # level of a session's departure before it, for smoothed points
SCORED_EVERY_S = 60.0
# at least this far from any temperature of the five sessions, within the factory nodes
UNVISITED_DEGC = 2.0
KINDS = ("measured", "smoothed")
OURS, HERMITE = "recal", "recal, cubic Hermite table"
EXACT, PERFECT, OLD = "exact Bayesian merge", "perfect table", "do nothing"
NOT_FLOWN = (HERMITE, EXACT)
SERIAL = "SN-0042"
TWINS = {
    "reference": TwinModel(
        imu_serial=SERIAL,
        gyro=GyroNoise(
            bias_instability_deg_h=0.0, rate_random_walk_deg_h_sqrt_h=0.0, turn_on_deg_h=0.0
        ),
        accel=AccelNoise(bias_instability_ug=0.0, rate_random_walk_ug_sqrt_h=0.0, turn_on_ug=50.0),
        # 5 arcsec over 70 min
        vehicle=VehicleNoise(yaw_creep_arcsec_sqrt_h=5.0 / float(np.sqrt(70 / 60))),
    ),
    "default": TwinModel(imu_serial=SERIAL),
}


class Curve(Protocol):
    """Anything that gives a bias over temperature: a table, ours or a baseline's."""

    def bias_deg_h(self, axis: int, temperature_degC: NDArray) -> NDArray: ...


@dataclass(frozen=True)
class Visit:
    """Where and how a unit is powered on."""

    heading_deg: float
    lat_deg: float
    start: str


@dataclass(frozen=True, kw_only=True)
class UnitResult:
    """Scores of one unit, each a dict by rule.

    visited, unvisited (SESSIONS + 1,): mean square error of the level gyros [(deg/h)^2] after 0, 1
    ... sessions, at all temperatures of the five sessions, and at those of the factory table that
    none came near (NaN: there are none); before, after (SESSIONS, 2): RMS error of gyros x and y
    [deg/h] at the temperatures of session k, with the table before and after it; normalised: mean
    squared error over sigma^2 at visited temperatures at the end; z: visited RMS of gyro z [deg/h];
    outcomes, reasons: what `update_calibration` said of each session, and why not; hours: of the
    new power-on, by profile.
    """

    seed: int
    visited: dict[str, list[float]]
    unvisited: dict[str, list[float]]
    before: dict[str, list[list[float]]]
    after: dict[str, list[list[float]]]
    normalised: dict[str, float]
    z: dict[str, float]
    outcomes: list[str]
    reasons: list[str]
    hours: dict[str, dict[str, Hour]]


def study_unit(
    seed: int, *, twin_name: str, sessions: int = SESSIONS, profiles: Sequence[str] = ()
) -> UnitResult:
    """One unit through its sessions, then, powered on anew, through the hour of each profile."""
    rng, twin = np.random.default_rng([seed, 29]), TWINS[twin_name]
    unit = aged_unit(
        rng, ageing_offset_deg_h=OFFSET_DEG_H, ageing_shape_deg_h=SHAPE_DEG_H, imu_serial=SERIAL
    )
    visits = [_visit(rng) for _ in range(sessions)]
    thermals = [thermal_history(v.start, rng=rng) for v in visits]
    table = factory = table_from_dict(unit.factory_table(), name="factory")
    aged = factory.replaced(covariance=true_prior(factory))
    rules = {
        f"{name}, {kind}": rule(factory)
        for name, rule in BASELINES.items()
        if name != OLD
        for kind in KINDS
    }
    scores = _Scores(unit, factory, [_visited(thermal) for thermal in thermals])
    hermite = hermite_factory(unit)
    curves: dict[str, Curve] = {OLD: factory, OURS: table, HERMITE: hermite, EXACT: aged, **rules}
    scores.take(curves)
    evidence: list[Evidence] = []
    outcomes: list[str] = []
    reasons: list[str] = []
    for k, (visit, thermal) in enumerate(zip(visits, thermals)):
        result = _session(unit, twin, visit, thermal, table, f"{seed}-{k}", rng)
        table, (session,) = result.after, result.sessions
        outcomes.append(result.outcome)
        reasons += sentences(result.reasons)
        if session.estimate is not None:
            evidence.append(evidence_of(session, factory, twin))
            hermite = merge_evidence(hermite, evidence[-1])
            for kind, points in points_of(session, evidence[-1]).items():
                for name in filter(OLD.__ne__, BASELINES):
                    rules[f"{name}, {kind}"].update(points)
        curves = {
            OLD: factory,
            OURS: table,
            HERMITE: hermite,
            EXACT: exact_merge(aged, evidence),
            **rules,
        }
        scores.take(curves)
    again = partial(np.random.default_rng, [seed, 29, 60])
    hours = {profile: _hour(unit, twin, curves, factory, again(), profile) for profile in profiles}
    return UnitResult(
        seed=seed,
        visited=scores.visited,
        unvisited=scores.unvisited,
        before=scores.before,
        after=scores.after,
        normalised=scores.normalised(curves),
        z=scores.z,
        outcomes=outcomes,
        reasons=reasons,
        hours=hours,
    )


def _visit(rng: np.random.Generator) -> Visit:
    return Visit(
        float(rng.choice(HEADINGS_DEG)),
        float(rng.choice(LATITUDES_DEG)),
        str(rng.choice(list(STARTS))),
    )


@lru_cache(maxsize=4)
def taxi(lat_deg: float, heading_deg: float) -> IdealSensors:
    """The noise-free realistic taxi on a heading, 70 min parked before it, 10 Hz."""
    site = Site(lat_rad=lat_deg * DEG, lon_rad=7 * DEG, height_m=250.0)
    _, motion = reference_motion("realistic_taxi")
    return ideal_sensors(build_truth(motion, site, heading_rad=heading_deg * DEG), 10.0)


def _session(
    unit: UnitTruth,
    twin: TwinModel,
    visit: Visit,
    thermal: ThermalHistory,
    table: ThermalTable,
    run_id: str,
    rng: np.random.Generator,
) -> UpdateResult:
    simulated = simulate_run(
        taxi(visit.lat_deg, visit.heading_deg),
        thermal,
        unit,
        twin,
        rng=rng,
        plan=SessionPlan(run_id=run_id),
    )
    parent = table_sha256(table_to_dict(table))
    return update_calibration(
        [simulated.run], table, twin, history=UnitHistory(parent_sha256=parent)
    )


def _visited(thermal: ThermalHistory) -> NDArray:
    """Gyro temperatures (t, 3) of a session, one a minute."""
    _, motion = reference_motion("realistic_taxi")
    return thermal.at(np.arange(0.0, motion.end_s, SCORED_EVERY_S)).gyro_degC


def true_prior(factory: ThermalTable) -> NDArray:
    """Covariance (n, n) of the ageing at the nodes, as the units were drawn [(deg/h)^2]."""
    return np.kron(np.eye(len(AXES)), _ageing(factory.temperature_degC[0], OFFSET_DEG_H))


def _ageing(temperature_degC: NDArray, offset_deg_h: float) -> NDArray:
    return offset_deg_h**2 + SHAPE_DEG_H**2 * smooth_kernel(temperature_degC, LENGTH_DEGC)


def evidence_of(session: SessionResult, factory: ThermalTable, twin: TwinModel) -> Evidence:
    """What a session measured, about its departures from the factory table; the table of the day
    does not enter.
    """
    assert session.estimate is not None and session.temperature is not None
    bins, seen = session.estimate.bins, session.temperature
    information, vector = measurement_information(bins, session.estimate)
    axis = np.tile(np.arange(3), len(bins.centre_s))
    spans = [seen.between(a, b) for a, b in pairwise(bins.edges_s)]
    bin_degC = tuple(seen.temperature_degC[span, k] for span in spans for k in range(3))
    factory_deg_h = np.array([factory.bias_deg_h(int(k), t).mean() for k, t in zip(axis, bin_degC)])
    own = session_covariance(
        axis_index=axis,
        time_s=np.repeat(bins.centre_s, 3),
        duration_s=np.repeat(bins.duration_s, 3),
        gyro=twin.gyro,
        run_length_s=float(bins.edges_s[-1]),
    )
    return Evidence(
        axis_index=axis,
        temperature_degC=bins.temperature_degC.ravel(),
        factory_deg_h=factory_deg_h,
        information=information,
        vector=vector + information @ (bins.table_deg_h - factory_deg_h),
        own=own,
        bin_degC=bin_degC,
    )


def hermite_factory(unit: UnitTruth) -> ThermalTable:
    """The factory table with the slope of the factory curve at each node (US 5,570,304)."""
    data = unit.factory_table()
    for curve, axis in zip(unit.factory_deg_h, data["axes"].values()):
        axis["slope_deg_h_degC"] = curve.derivative()(axis["temperature_degC"]).tolist()
    return table_from_dict({**data, "interpolation": "hermite"}, name="factory")


def merge_evidence(table: ThermalTable, e: Evidence) -> ThermalTable:
    """One session into any kind of table by infield.table.merge, from its evidence instead of a
    filter run of its own.
    """
    table = table.extended_to(*e.span_degC)
    H = e.rows(table)
    C = H @ table.covariance @ H.T + e.own + BIN_FLOOR_DEG_H**2 * np.eye(len(H))
    departure = H @ table.parameters - e.factory_deg_h
    change, covariance = posterior(C, e.information, e.vector - e.information @ departure)
    return merge_posterior(table, H, departure, C, departure + change, covariance).table


def points_of(session: SessionResult, evidence: Evidence) -> dict[str, Points]:
    """The session's points of both kinds (this module's head); sigma with the session's own turn-on
    and drift.
    """
    measured, axis, T = session.points, evidence.axis_index, evidence.temperature_degC
    assert measured is not None
    prior = _ageing(T, VAGUE_DEG_H) * (axis[:, None] == axis)
    departure, covariance = posterior(prior + evidence.own, evidence.information, evidence.vector)
    own = np.diag(evidence.own)
    return {
        "measured": Points(
            axis_index=axis,
            temperature_degC=T,
            bias_deg_h=measured.bias_deg_h,
            sigma_deg_h=np.sqrt(np.diag(measured.covariance) + own),
        ),
        "smoothed": Points(
            axis_index=axis,
            temperature_degC=T,
            bias_deg_h=evidence.factory_deg_h + departure,
            sigma_deg_h=np.sqrt(np.diag(covariance)),
        ),
    }


class _Scores:
    """Errors of every rule against truth, gathered session by session."""

    def __init__(self, unit: UnitTruth, factory: ThermalTable, visited: Sequence[NDArray]) -> None:
        self.T: list[NDArray] = []
        self.truth: list[NDArray] = []
        seen = np.concatenate(visited)
        ends = np.cumsum([len(v) for v in visited])
        self.spans = [slice(end - len(v), end) for end, v in zip(ends, visited)]
        for k, axis in enumerate(AXES):
            grid = np.arange(factory.temperature_degC[k][0], factory.temperature_degC[k][-1] + 0.5)
            far = np.min(np.abs(grid[:, None] - seen[:, k]), axis=1) >= UNVISITED_DEGC
            T = np.concatenate([seen[:, k], grid[far]])
            self.T.append(T)
            self.truth.append(unit.bias_deg_h(axis, T))
        self.count = len(seen)
        self.visited: dict[str, list[float]] = {}
        self.unvisited: dict[str, list[float]] = {}
        self.before: dict[str, list[list[float]]] = {}
        self.after: dict[str, list[list[float]]] = {}
        self.z: dict[str, float] = {}

    def take(self, curves: Mapping[str, Curve]) -> None:
        """Score all tables as they are now; the first call scores them before any session."""
        for name, curve in curves.items():
            error = [
                curve.bias_deg_h(k, T) - truth
                for k, (T, truth) in enumerate(zip(self.T, self.truth))
            ]
            level = np.stack([e[: self.count] for e in error[:2]])
            beyond = np.concatenate([e[self.count :] for e in error[:2]])
            done = self.visited.setdefault(name, [])
            done.append(float(np.mean(level**2)))
            self.unvisited.setdefault(name, []).append(
                float(np.mean(beyond**2)) if beyond.size else float("nan")
            )
            self.z[name] = float(np.sqrt(np.mean(error[2][: self.count] ** 2)))
            if len(done) > 1:
                self.after.setdefault(name, []).append(_rms(level[:, self.spans[len(done) - 2]]))
            if len(done) <= len(self.spans):
                self.before.setdefault(name, []).append(_rms(level[:, self.spans[len(done) - 1]]))

    def normalised(self, curves: Mapping[str, Curve]) -> dict[str, float]:
        """Mean squared error over sigma^2 of the level gyros at visited temperatures, of rules that
        state a sigma.
        """
        found = {}
        for name, curve in curves.items():
            if isinstance(curve, ThermalTable | IndependentVariance):
                T = [t[: self.count] for t in self.T[:2]]
                ratio = [
                    (curve.bias_deg_h(k, t) - self.truth[k][: self.count]) / curve.sigma_deg_h(k, t)
                    for k, t in enumerate(T)
                ]
                found[name] = float(np.mean(np.square(ratio)))
        return found


def _rms(values: NDArray) -> list[float]:
    """Of each row."""
    return np.sqrt(np.mean(values**2, axis=1)).tolist()


def _hour(
    unit: UnitTruth,
    twin: TwinModel,
    curves: Mapping[str, Curve],
    factory: ThermalTable,
    rng: np.random.Generator,
    profile: str,
) -> dict[str, Hour]:
    """The new power-on. The alignment expects of each table what is known of it; of a baseline,
    what ours states.
    """
    visit, ours = _visit(rng), curves[OURS]
    assert isinstance(ours, ThermalTable)
    flown = {
        name: curve
        for name, curve in curves.items()
        if name not in NOT_FLOWN and not name.endswith(KINDS[0])
    }
    tables = {
        name: Flown(c.bias_deg_h, factory if name == OLD else ours) for name, c in flown.items()
    }
    certain = ours.replaced(covariance=np.zeros_like(ours.covariance))
    tables[PERFECT] = Flown(lambda axis, T: unit.bias_deg_h(AXES[axis], T), certain)
    sortie = Sortie(
        profile=profile, lat_deg=visit.lat_deg, heading_deg=visit.heading_deg, start=visit.start
    )
    return free_inertial.fly(unit, twin, tables, sortie, rng=rng)
