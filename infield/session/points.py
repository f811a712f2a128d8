"""Bias-temperature points of a session, and how well each gyro was seen.

Decision: docs/decisions/0010-points-exclude-prior.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, solve_triangular

from infield.session.bins import SessionBins
from infield.session.disagreement import SessionEvidence
from infield.session.estimate import SessionEstimate
from infield.session.reasons import Advice
from infield.table.merge import SessionPoints
from infield.table.thermal_table import ThermalTable
from ins.documents import OMIT_NONE
from ins.records import AXES, Run
from ins.verdicts import WEAK_BELOW, Observability, because, sentence

# prior of the points: this many times the table's sigma, so that they are the session's own
VAGUE_POINT = 100.0
# of a heading sigma to its prior: above it the session did not show the heading
UNSEEN_SIGMA = WEAK_BELOW


@dataclass(frozen=True, kw_only=True)
class AxisObservability:
    """Sigma of the session's mean bias on one axis before and after, the verdict on it, and what
    would make the gyro better known, empty where nothing more is needed; axis: None under its key.
    """

    axis: str | None = field(default=None, metadata=OMIT_NONE)
    sigma_before_deg_h: float
    sigma_after_deg_h: float
    verdict: Observability | str
    advice: str = ""


def unseen_axes(seen: Sequence[AxisObservability]) -> list[str]:
    """The axes that a session does not show."""
    verdicts = zip(AXES, (axis.verdict for axis in seen))
    return [axis for axis, verdict in verdicts if verdict == Observability.NOT_OBSERVABLE]


def measurement_information(
    bins: SessionBins, estimate: SessionEstimate
) -> tuple[NDArray, NDArray]:
    """Information matrix (m, m) and vector (m,) of the session alone about its biases beyond the
    table.

    P1^-1 - C^-1, worked where C = I so that nearly equal bins do not cost digits: with C = L L' and
    L^-1 P1 L^-T = U diag(e) U', it is L^-T U diag(1/e - 1) U' L^-1.
    """
    L = np.linalg.cholesky(bins.prior)
    inner = solve_triangular(L, solve_triangular(L, estimate.covariance, lower=True).T, lower=True)
    e, U = eigh(0.5 * (inner + inner.T))
    e = np.clip(e, 1e-12, 1.0)
    A = solve_triangular(L.T, U)
    information = (A * (1.0 / e - 1.0)) @ A.T
    vector = A @ ((U.T @ solve_triangular(L, estimate.mean_deg_h, lower=True)) / e)
    return information, vector


def session_points(run: Run, estimate: SessionEstimate) -> SessionPoints:
    """Total bias of each gyro over each bin, the stored table not used but as the point of
    linearisation.

    A direction that the session does not show (an east gyro before a turn) keeps a sigma of about
    100 times the table's: such a point says nothing of its own, and its sigma says so.
    """
    bins = estimate.bins
    information, vector = measurement_information(bins, estimate)
    count, m = len(bins.centre_s), bins.table_deg_h.size
    sigma = VAGUE_POINT * np.sqrt(np.diag(bins.prior))
    shared = np.outer(sigma, sigma) * (np.arange(m)[:, None] % 3 == np.arange(m)[None, :] % 3)
    vague = shared + np.diag(sigma**2)
    alone = np.linalg.inv(information + np.linalg.inv(vague))
    # a point stands at its temperature, which is itself measured
    covariance = alone + bins.thermometer
    return SessionPoints(
        axis_index=np.tile(np.arange(3), count),
        time_s=np.repeat(bins.centre_s, 3),
        duration_s=np.repeat(bins.duration_s, 3),
        temperature_degC=bins.temperature_degC.ravel(),
        temperature_rate_degC_min=bins.rate_degC_min.ravel(),
        bias_deg_h=bins.table_deg_h + alone @ vector,
        covariance=0.5 * (covariance + covariance.T),
        H=bins.H,
        gradient_degC=None if bins.gradient_degC is None else bins.gradient_degC.ravel(),
        sigma_temperature_degC=bins.sigma_temperature_degC.ravel(),
        sigma_rate_degC_min=bins.sigma_rate_degC_min.ravel(),
        run_id=run.header.run_id,
        run_sha256=run.sha256,
        applied_table_sha256=run.header.applied_table_sha256,
    )


def mean_rows(estimate: SessionEstimate) -> NDArray:
    """Rows (3, 3N) that average the bins of each axis over the session."""
    weight = estimate.bins.duration_s / estimate.bins.duration_s.sum()
    rows = np.zeros((3, estimate.mean_deg_h.size))
    for axis in range(3):
        rows[axis, axis::3] = weight
    return rows


def session_evidence(
    run: Run, table: ThermalTable, estimate: SessionEstimate, points: SessionPoints
) -> SessionEvidence:
    """The session's mean bias, whatever the table says."""
    A, bins = mean_rows(estimate), estimate.bins
    T = bins.duration_s / bins.duration_s.sum() @ bins.temperature_degC
    return SessionEvidence(
        run_id=run.header.run_id,
        run_sha256=run.sha256,
        start_utc=run.header.start_utc,
        temperature_degC=T,
        bias_deg_h=A @ points.bias_deg_h,
        covariance=A @ (points.covariance + bins.own) @ A.T,
        bend_deg_h=A @ bins.table_deg_h - [table.bias_deg_h(k, T[k])[0] for k in range(3)],
    )


def observability(
    estimate: SessionEstimate,
    *,
    hold_heading: bool,
    flown: bool = False,
    unusable: Mapping[str, str] = MappingProxyType({}),
) -> tuple[AxisObservability, ...]:
    """Verdict per axis from the variance that the session removed from its mean bias; flown: with
    a flight; unusable: axis -> what is wrong with its thermometer.
    """
    A = mean_rows(estimate)
    before = np.sqrt(np.einsum("ij,jk,ik->i", A, estimate.bins.prior, A))
    after = np.sqrt(np.einsum("ij,jk,ik->i", A, estimate.covariance, A))
    on_ground = Advice.PARK_LONGER if hold_heading else Advice.HOLD_HEADING
    moving = dict.fromkeys("xy", Advice.TURN_AND_STOP)
    moving["z"] = Advice.FLY_TURNS if flown else on_ground
    found = []
    for axis, b, a in zip(AXES, before, after):
        verdict = Observability.of(a / b)
        advice = ""
        if axis in unusable:
            verdict = Observability.NOT_OBSERVABLE
            mend = because(Advice.MEND_THERMOMETER, axis=axis, fault=unusable[axis])
            advice = sentence(mend)
        elif verdict is not Observability.OBSERVED:
            code = moving[axis] if estimate.parked is None else Advice.PARK_FROM_COLD
            advice = sentence(because(code))
        found.append(
            AxisObservability(
                axis=axis,
                sigma_before_deg_h=float(b),
                sigma_after_deg_h=float(a),
                verdict=verdict,
                advice=advice,
            )
        )
    return tuple(found)
