"""Sessions drawn from the posteriors of real ones, for rates that need hundreds of them (R15 to
R18).

A template is one simulated run through the whole pipeline: its bins, temperatures and the
information that its navigation filter won about the biases. A drawn session keeps these and draws
anew what is random: the session's own biases (turn-on, flicker, random walk), the noise of the
measurement, and the true curve over temperature. From there on everything is the product's:
`posterior_with`, `merge_posterior`, `assess_merge`, `with_thermal_terms`, `find_steps`.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from infield.session.acceptance import assess_merge
from infield.session.disagreement import SessionEvidence
from infield.session.hysteresis import SessionLikelihood, posterior_with
from infield.session.joint_update import likelihood_of
from infield.session.pipeline import update_calibration
from infield.session.points import session_evidence, session_points
from infield.session.results import SessionResult
from infield.session.settings import SessionSettings
from infield.table.merge import merge_posterior
from infield.table.thermal_table import EvenNodes, ThermalTable, default_table, smooth_kernel
from ins.records import Site, TwinModel
from ins.units import DEG
from tests.reference_motions import reference_motion
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import simulate_run
from trajectories.simulator.thermal import STARTS, thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

TWIN = TwinModel(imu_serial="SN-0042")
SETTINGS = SessionSettings()
SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
HEADINGS_DEG = (0.0, 50.0, 200.0)
OFFSET_DEG_H, SHAPE_DEG_H, LENGTH_DEGC = 0.006, 0.004, 30.0  # ageing, physics.md 6.8
NODES_DEGC = np.arange(-20.0, 71.0, 10.0)


STARTED = tuple((start, heading) for start in STARTS for heading in HEADINGS_DEG)


@cache
def template(k: int) -> SessionResult:
    """A taxi of one start and heading, through the pipeline against a table of zeros."""
    start, heading = STARTED[k]
    rng = np.random.default_rng([k, 151])
    unit = aged_unit(rng)
    truth = build_truth(reference_motion("realistic_taxi")[1], SITE, heading_rad=heading * DEG)
    ideal = ideal_sensors(truth, 10.0)
    run = simulate_run(ideal, thermal_history(start, rng=rng), unit, TWIN, rng=rng).run
    return update_calibration([run], aged_table(sigma=0.1), TWIN).sessions[0]


def templates() -> tuple[SessionResult, ...]:
    """All of them."""
    return tuple(template(k) for k in range(len(STARTED)))


def aged_table(*, sigma: float | None = None, values: NDArray | None = None) -> ThermalTable:
    """An aged factory table (or all of one sigma), zeros or the given node values."""
    table = default_table(
        imu_serial="SN-0042",
        gyro_technology="rlg",
        created_utc="2025-01-01T00:00:00Z",
        span=EvenNodes(low_degC=NODES_DEGC[0], high_degC=NODES_DEGC[-1]),
        sigma_deg_h=sigma,
    )
    if sigma is None:
        table = table.replaced(
            covariance=np.kron(np.eye(3), ageing_kernel(table.temperature_degC[0]))
        )
    return table if values is None else table.replaced(parameters=values)


def ageing_kernel(T: NDArray) -> NDArray:
    return OFFSET_DEG_H**2 + SHAPE_DEG_H**2 * smooth_kernel(T, LENGTH_DEGC)


def draw(covariance: NDArray, rng: np.random.Generator) -> NDArray:
    """One draw of zero mean, shape (n,); a singular covariance is fine."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(values.size))


def drawn_session(
    template: SessionResult,
    table: ThermalTable,
    true_bias: NDArray,
    rng: np.random.Generator,
    *,
    day: int,
) -> SessionResult:
    """A session of the template's motion and temperatures, its truth given without the session's
    own part (3N,).

    Judged against the table and merged into it as `update_calibration` would.
    """
    data = likelihood_of(template, table, TWIN, SETTINGS)
    own = data.bins.own - data.bins.thermometer
    departure = true_bias + draw(own, rng) - data.reference_deg_h
    noisy = replace(data, vector=data.information @ departure + draw(data.information, rng))
    m0, C, m1, P1 = posterior_with(
        noisy, np.zeros_like(true_bias), np.zeros_like(noisy.information)
    )
    merged = merge_posterior(table, data.bins.H, m0, C, m1, P1)
    assert template.estimate is not None and template.points is not None
    estimate = replace(template.estimate, bins=data.bins, mean_deg_h=m1 - m0, covariance=P1)
    run = replace(
        template.run,
        sha256=f"{int(rng.integers(2**62)):064x}",
        header=replace(
            template.run.header, run_id=f"day-{day}", start_utc=f"2026-03-{1 + day:02d}T05:00:00Z"
        ),
    )
    return replace(
        template,
        run=run,
        verdict=assess_merge(merged),
        estimate=estimate,
        merged=merged,
        points=session_points(run, estimate),
    )


def take(
    table: ThermalTable,
    chosen: Sequence[SessionResult],
    truths: Sequence[NDArray],
    rng: np.random.Generator,
    *,
    day: int = 0,
) -> tuple[list[SessionResult], ThermalTable]:
    """Sessions one after the other, merged in turn; (results, table after)."""
    found: list[SessionResult] = []
    for k, (template, truth) in enumerate(zip(chosen, truths)):
        session = drawn_session(template, table, truth, rng, day=day + k)
        found.append(session)
        if session.verdict.accepted and session.merged is not None:
            table = session.merged.table.replaced(created_utc=session.run.header.start_utc)
    return found, table


def bins_of(template: SessionResult, table: ThermalTable) -> SessionLikelihood:
    """The template on a table, for its temperatures, rates and rows."""
    return likelihood_of(template, table, TWIN, SETTINGS)


def evidence_of(session: SessionResult, table: ThermalTable) -> SessionEvidence:
    assert session.estimate is not None and session.points is not None
    return session_evidence(session.run, table, session.estimate, session.points)
