"""Whitening: exact on its own covariance, and right on runs that another code simulated."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2

from benchmarks.gap_trials.trial import draw_trial
from infield.table.file import table_from_dict
from ins.errors.catalogue import effects_named
from ins.errors.telemetry import AIRBORNE, Trace
from ins.errors.telemetry import PARKED as STANDS
from ins.records import Run, TwinModel
from simreal.evidence.run_view import RunView, view_run
from simreal.evidence.whitened import CHANNELS, SENSORS, Evidence, ExtraNoise, RunEvidence
from simreal.inference.bank import Bank
from simreal.inference.noise_hypotheses import Squares
from tests.simreal.runs import FLIGHT, PARKED, simulated, table, twin_of

FALSE_ALARM = 1e-4  # of each two-sided bound below, on seeds that are fixed
BIAS_M_S2 = 1e-3


def views(trial) -> list[RunView]:
    table = table_from_dict(trial.table, name="trial")
    out = [view_run(run, k, table, trial.twin) for k, run in enumerate(trial.runs)]
    assert all(isinstance(v, RunView) for v in out)
    return [v for v in out if isinstance(v, RunView)]


@lru_cache(maxsize=4)
def null_evidence(source: str) -> Evidence:
    trial = draw_trial(71, effects=0, source=source, parked_s=1800.0)
    return Evidence(views(trial), trial.twin)


def inside(values: np.ndarray, *, spare: float = 0.0) -> bool:
    """Mean square of n values within its chi-square bounds, and a stated modelling error."""
    n = values.size
    low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], n) / n
    return bool(low - spare <= np.mean(values**2) <= high + spare)


@pytest.mark.parametrize("source", ["trajectories", "pyins"])
def test_rows_of_a_twin_that_is_right_are_white(source):
    evidence = null_evidence(source)
    rows = evidence.rows
    for c, channel in enumerate(CHANNELS):
        z = evidence.z[(rows.channel == c) & rows.steady]
        # rows of moving vehicles: side motion and sway are models of models
        spare = 0.05 if c >= SENSORS else 0.0
        assert not z.size or inside(z, spare=spare), f"{channel}: {np.mean(z**2):.3f} of {z.size}"


@pytest.mark.parametrize("source", ["trajectories", "pyins"])
def test_scatter_of_a_twin_that_is_right_is_as_expected(source):
    evidence = null_evidence(source)
    squares = Squares(evidence)
    ratio = squares.ratio(evidence.z[:, None])[:, 0]
    for (run, c, band), index in squares.quick.items():
        n = float(squares.dof[index].sum())
        mean = float((squares.dof[index] * ratio[index]).sum()) / n
        low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], n) / n
        assert low - 0.02 <= mean <= high + 0.02, (run, CHANNELS[c], band, mean)


def every_third(run):
    """The run with three rows in one, 10 / 3 Hz: seconds of 3, 3 and 4 rows."""
    imu = run.imu.whole()
    n = imu.time_s.size // 3
    sums = {
        name: getattr(imu, name)[: 3 * n].reshape(n, 3, -1).sum(axis=1)
        for name in ("dtheta_rad", "dv_m_s", "dt_s")
    }
    more = {**sums, "dt_s": sums["dt_s"][:, 0], "time_s": imu.time_s[2 : 3 * n : 3]}
    return replace(run, imu=replace(imu, **more))


def test_rows_of_a_rate_that_is_no_whole_number_are_looked_at():
    run = every_third(simulated(segments=PARKED).run)
    view = view_run(run, 0, table(), twin_of())
    scatter = RunEvidence(view, twin_of()).scatter
    ratio, dof = scatter.ratio[:SENSORS, -1], scatter.dof[:SENSORS, -1]
    assert (dof > 0.0).all()
    for c in range(SENSORS):
        n = dof[c].sum()
        low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], n) / n
        assert low - 0.02 <= (dof[c] * ratio[c]).sum() / n <= high + 0.02, CHANNELS[c]
    # a block in which rows are lost says nothing of the noise of whole seconds
    imu = run.imu.whole()
    kept = (imu.time_s < 200.0) | (imu.time_s > 200.7)
    holed = replace(
        imu, **{k: getattr(imu, k)[kept] for k in ("time_s", "dt_s", "dtheta_rad", "dv_m_s")}
    )
    lost = RunEvidence(view_run(replace(run, imu=holed), 0, table(), twin_of()), twin_of()).scatter
    assert 1 <= (lost.dof[0, -1] == 0.0).sum() <= 2


def test_parked_whitening_is_exact():
    """The operator takes the model's own covariance, attitude and all, to the identity."""
    run = null_evidence("trajectories").runs[0]
    block = run.parked
    rng = np.random.default_rng(0)
    draws = 3000
    columns = np.zeros((SENSORS, block.bins, draws))
    for c in range(SENSORS):
        columns[c] = block._factors[c] @ rng.standard_normal((block.bins, draws))
    phi = block._sigma0[:, None] * rng.standard_normal((3, draws))
    columns += (block.A @ phi)[:, None, :]
    z, handoff = block.whiten(columns)
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.005)
    picks = rng.integers(0, z.shape[0], (40, 2))
    correlation = [np.mean(z[i] * z[j]) for i, j in picks if i != j]
    assert np.max(np.abs(correlation)) < 4.5 / np.sqrt(draws)
    error = handoff.mean[:3] - phi  # attitude at the end: as certain as claimed
    nees = np.einsum("ik,ij,jk->k", error, np.linalg.inv(handoff.covariance[:3, :3]), error)
    assert np.mean(nees) == pytest.approx(3.0, abs=4 * np.sqrt(6.0 / draws))


def test_the_likelihood_is_that_of_the_whole_covariance():
    """The determinant against that of all parked rows at once, the attitude they share with it."""
    block = null_evidence("trajectories").runs[0].parked
    of_phi = np.repeat(block.A * block._sigma0, block.bins, axis=0)
    C = block_diag(*(factor @ factor.T for factor in block._factors)) + of_phi @ of_phi.T
    scale = np.sqrt(np.diag(C))
    dense = 0.5 * np.linalg.slogdet(C / np.outer(scale, scale))[1] + np.log(scale).sum()
    assert block.log_sigma_of_rows == pytest.approx(dense, abs=1e-3)


def test_noise_that_starts_within_a_run_is_white_before_and_after():
    """An engine of the blind trials: parked from its onset on, and in what follows."""
    trial = draw_trial(73, names=["engine_start"], parked_s=1200.0, plan="four")
    planted = trial.truth[0].parameters
    number, onset_s = planted["run"], planted["onset_s"]
    engine = next(e for e in effects_named("engine_start") if e.is_noise)
    on = planted["accel_ug_sqrt_hz"]
    extra = [ExtraNoise(engine, "vehicle", {"onset_s": onset_s}, on**2, number)]
    run = RunEvidence(views(trial)[number], trial.twin, extra)
    rows = run.rows(0)
    for late in (False, True):
        for c in (3, 4, 5):
            own = (rows.channel == c) & (rows.kind == STANDS) & ((rows.time_s > onset_s) == late)
            z = run.z[own] - run.z[own].mean()  # vibration shifts the accelerometer as well
            assert inside(z, spare=0.1), (late, c, np.mean(z**2))
            blocks = (run.scatter.time_s > onset_s + 10.0) if late else run.scatter.time_s < onset_s
            ratio, dof = run.scatter.ratio[c, -1, blocks], run.scatter.dof[c, -1, blocks]
            five_sigma = 5.0 * np.sqrt(2.0 / dof.sum())
            assert np.mean(ratio) == pytest.approx(1.0, abs=five_sigma), (late, c)
    declared = trial.twin.accel.vrw_ug_sqrt_hz
    assert run.twin.accel.vrw_ug_sqrt_hz == pytest.approx(np.hypot(declared, on))


def test_a_signature_is_what_the_effect_does_to_the_rows():
    """Rows of a run with a known bias less those without are the bank's column."""
    trial = draw_trial(72, names=["gyro_rate_ramp"], parked_s=1800.0)
    with_effect = Evidence(views(trial), trial.twin)
    table = table_from_dict(trial.table, name="trial")
    without = [view_run(run, k, table, trial.twin) for k, run in enumerate(trial.runs_without)]
    clean = Evidence([v for v in without if isinstance(v, RunView)], trial.twin)
    d = with_effect.z - clean.z
    bank = Bank(clean, effects_named("gyro_rate_ramp"), with_generic=False)
    h = next(h for h in bank.hypotheses if h.target == trial.truth[0].target)
    column = h.groups[0].columns
    u = bank.signature(column, np.ones(1))
    slope = float(u @ d) / float(u @ u)
    assert np.linalg.norm(d - slope * u) < 0.05 * np.linalg.norm(d)
    planted = trial.truth[0].parameters["slope_deg_h_h"] * trial.truth[0].size
    assert slope == pytest.approx(planted, rel=0.03)


def test_a_run_that_never_rests_is_told_in_words():
    from dataclasses import replace

    from ins.records import ImuLog

    trial = draw_trial(71, effects=0, plan="one_cold", parked_s=600.0)
    run: Run = trial.runs[0]
    imu = run.imu.whole()
    rng = np.random.default_rng(0)
    shaken = ImuLog(
        time_s=imu.time_s,
        dt_s=imu.dt_s,
        dtheta_rad=imu.dtheta_rad + 0.02 * rng.standard_normal(imu.dtheta_rad.shape),
        dv_m_s=imu.dv_m_s + 2.0 * rng.standard_normal(imu.dv_m_s.shape),
    )
    said = view_run(replace(run, imu=shaken, phases=()), 0, None, TwinModel())
    assert isinstance(said, str) and "rests" in said


def test_fixes_of_an_antenna_that_swings_with_the_bank_are_white():
    """A climb, a turn and a descent with the antenna on a fin, 6 m above the unit: its speed by
    roll and pitch is no gap. Fixes alone, for their noise is known exactly.
    """
    fin = (-10.0, 0.0, -6.0)
    run, twin = simulated(seed=4, segments=FLIGHT, aids=True, antenna_m=fin).run, twin_of()
    view = view_run(run, 0, table(), twin)
    assert isinstance(view, RunView)
    evidence = RunEvidence(view, twin)
    assert evidence.rolling is not None
    labels = evidence.rolling.labels
    z = evidence.z[-labels.time_s.size :]
    flying = (labels.channel == "gnss") & (labels.kind == AIRBORNE)
    # what the rate at a fix may be off by is in the sigma
    assert flying.sum() > 2000 and inside(z[flying], spare=0.05), np.mean(z[flying] ** 2)
    # creeping to a stop behind the landing is no standing yet: 10 sigmas of 10 s where it was
    stood = (labels.channel == "vehicle") & (labels.time_s > labels.time_s[flying].max())
    assert stood.sum() > 10 and np.abs(z[stood]).max() < 4.5


def test_a_signature_of_a_flight_is_what_a_biased_vertical_accelerometer_does():
    """Banked, a part of it is level. The telemetry with the bias less that without, against the
    response of the filter.
    """
    made, twin = simulated(seed=4, segments=FLIGHT, aids=True), twin_of()
    clean = view_run(made.run, 0, table(), twin)
    assert isinstance(clean, RunView)
    since = clean.end_s + 60.0
    imu = made.run.imu.whole()
    dv = imu.dv_m_s.copy()
    dv[:, 2] += np.where(imu.time_s > since, BIAS_M_S2 * imu.dt_s, 0.0)
    biased = view_run(replace(made.run, imu=replace(imu, dv_m_s=dv)), 0, table(), twin)
    assert isinstance(biased, RunView)
    evidence = RunEvidence(clean, twin)
    d = RunEvidence(biased, twin).z - evidence.z
    seconds = clean.seconds.end_s
    trace = np.zeros((seconds.size, 3))
    trace[:, 2] = BIAS_M_S2 * (seconds > since)
    u = evidence.whiten([Trace(accel_m_s2=trace)])[:, 0]
    assert np.linalg.norm(d) > 3.0
    assert np.linalg.norm(d - u) < 0.04 * np.linalg.norm(d)
