"""What further columns add to a sweep's innovations: against two sweeps, in Monte Carlo, and what
stays out. The errors are moved by dense matrices here, step by step.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from ins import earth
from ins.attitude import dcm_from_euler
from ins.estimation import error_model as em
from ins.estimation import kernel
from ins.estimation.error_filter import ErrorFilter
from ins.estimation.sensors import accelerometer_biases, bin_biases
from ins.estimation.tape import ACCELEROMETER, ADD, ADVANCE, ASSIGN, GYRO, INPUTS, MEASURE, Tape
from tests.ins.filter_steps import LAT, steps_of

NOISE = em.ProcessNoise(
    arw=6e-7, vrw=1e-4, accel_rrw=3e-7, yaw_creep=1e-7, lateral_rms=0.03, lateral_time_s=2.0
)
SIGMA = {"W": 0.05, "POS": 3.0, "THETA": 1e-3, "ACCEL": 5e-4, "ACCEL_Z": 5e-4, "KAPPA": 0.01}
GYRO_SIGMA = 3e-8
STANDS, ROLLS = 12, 40  # steps of 10 s, of 1 s
FALSE_ALARM = 1e-4  # of each two-sided bound, on seeds that are fixed
FOUR_SIGMA = 4.0  # of the mean square of products, which are no more than nearly independent
GATE = 6.0


def step_of(k: int) -> em.Step:
    """Step k: parked, then an S of two turns at 8 m/s."""
    parked = k < STANDS
    heading = 0.4 if parked else 0.4 + 1.2 * np.sin(2.0 * np.pi * (k - STANDS) / ROLLS)
    v_n = (0.0 if parked else 8.0) * np.array([np.cos(heading), np.sin(heading), 0.0])
    spin_n = earth.omega_ie_n(LAT)
    dt_s = 10.0 if parked else 1.0
    return em.Step(
        dt_s=dt_s,
        C_nb=dcm_from_euler(0.02, -0.03, heading),
        v_n=v_n,
        omega_ie_n=spin_n,
        omega_en_n=earth.omega_en_n(LAT, 0.0, v_n),
        gravity=9.806,
        radius_m=6.378e6,
        turn_rad=spin_n[2] * dt_s,
    )


def joined():
    """All steps, standing and then rolling."""
    parts = []
    for k in range(STANDS + ROLLS):
        parked = k < STANDS
        end_s = 10.0 * (k + 1) if parked else 10.0 * STANDS + (k + 1 - STANDS)
        flags = {"rolling": not parked, "keep": 0 < k < STANDS}
        parts.append(steps_of(step_of(k), end_s=end_s, **flags))
    columns = {}
    for name, value in vars(parts[0]).items():
        if isinstance(value, np.ndarray):
            columns[name] = np.concatenate([getattr(part, name) for part in parts])
    return replace(parts[0], **columns)


def tape_of(z=None, *, left_out: int | None = None) -> Tape:
    """What a taxi lays down. z (rows,): measured values, none: zeros; left_out: the step whose fix
    is missing.
    """
    tape = Tape(joined())
    bin_biases(tape, em.BASE)
    accelerometer_biases(tape, range(em.ACCEL.start, em.ACCEL_Z + 1))

    def measure(name, at, rows, variance):
        first, count = tape.rows, len(rows)
        own = slice(first, first + count * len(at))
        values = np.zeros((len(at), count)) if z is None else z[own].reshape(len(at), count)
        tape.measure(name, at, values.T, rows, [variance] * count, gate=GATE)

    still, rolling = np.arange(STANDS), np.arange(STANDS, STANDS + ROLLS)
    fixes = np.arange(STANDS, STANDS + ROLLS, 5)
    down = em.THETA.stop - 1
    tape.widen(still[:1], em.S.start, 1e-6)
    measure("still", still, [{em.S.start: 1.0}, {em.S.start + 1: 1.0}], 1e-6)
    tape.assign(still[:1], em.YAW, {down: -1.0}, 1e-12)
    measure("heading held", still[1:], [{down: 1.0, em.YAW: 1.0}], 1e-12)
    measure("lateral", rolling, [{em.S.start + 1: 1.0, em.KAPPA: 8.0}], 1e-5)
    # the last, so that the rows before keep their numbers
    kept = fixes[fixes != left_out]
    measure("gnss", kept, [{em.POS.start: 1.0}, {em.POS.start + 1: 1.0}], 1.0)
    return tape


def new_filter() -> ErrorFilter:
    return ErrorFilter(
        sigma0=SIGMA, noise=NOISE, bias_mean=np.zeros(3), bias_covariance=GYRO_SIGMA**2 * np.eye(3)
    )


def shown(sensed, start, rng=None):
    """What errors from `start` (n, m) show in the rows (rows, m) under wrong inputs (K, 9, m);
    rng: of the process noise and that of the rows, none: neither.
    """
    c = tape_of().compiled()
    e, z = start.copy(), np.zeros((len(c.z), start.shape[1]))

    def drawn(variance):
        if rng is None:
            return 0.0
        return np.sqrt(variance) * rng.standard_normal(start.shape[1])

    for kind, which, first, count in c.ops:
        rows = slice(first, first + count)
        H = np.zeros((count, len(e)))
        for i, row in enumerate(range(first, first + count)):
            entries = slice(c.first_entry[row], c.first_entry[row + 1])
            np.add.at(H[i], c.index[entries], c.value[entries])
        if kind == ADVANCE:
            flags = {"rolling": which >= STANDS, "keep_displacement": 0 < which < STANDS}
            Phi, Gamma, Q = em.discretize(step_of(which), NOISE, **flags)
            inputs = sensed[which].copy()
            inputs[GYRO : GYRO + 3] += e[em.BASE :]
            e[: em.BASE] = Phi @ e[: em.BASE] + Gamma @ inputs
            if rng is not None:
                values, vectors = np.linalg.eigh(Q)
                unit = rng.standard_normal((em.BASE, start.shape[1]))
                e[: em.BASE] += vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * unit)
        elif kind == MEASURE:
            noise = np.array([drawn(v) * np.ones(start.shape[1]) for v in c.variance[rows]])
            z[rows] = H @ e + noise
        elif kind == ADD:
            e[which] = e[which] + drawn(c.variance[first])
        elif kind == ASSIGN:
            e[which] = H[0] @ e + drawn(c.variance[first])
    return z


def signatures(rng, count=3):
    """Starts (n, m), wrong inputs (K, 9, m) and changed measurements (rows, m) of their usual
    sizes.
    """
    rows = len(tape_of().compiled().z)
    start = np.zeros((em.BASE + 3, count))
    start[em.THETA] = 1e-4 * rng.standard_normal((3, count))
    start[em.POS] = rng.standard_normal((2, count))
    start[em.BASE :] = GYRO_SIGMA * rng.standard_normal((3, count))
    sensed = np.zeros((STANDS + ROLLS, INPUTS, count))
    size = np.repeat([GYRO_SIGMA, 3e-4, 1e-4], 3)
    sensed[:] = size[:, None] * rng.standard_normal((1, INPUTS, count))
    sensed[STANDS:, GYRO : ACCELEROMETER + 3] *= 3.0
    return start, sensed, 1e-3 * rng.standard_normal((rows, count))


@pytest.mark.parametrize("estimate_moved", [0.0, 2e-4], ids=["estimate as it is", "estimate moved"])
def test_a_response_is_the_difference_of_two_sweeps(estimate_moved):
    start, sensed, changed = signatures(np.random.default_rng(1))
    at_start = np.zeros_like(start)
    at_start[em.THETA] = estimate_moved  # what the filter takes the errors for
    z = np.random.default_rng(2).standard_normal(len(changed)) * 1e-3
    told = shown(sensed, start) + changed
    without = new_filter().run_for_response(tape_of(z))
    response = without.of(start - at_start, sensed, changed)
    assert response.shape == (without.used_rows.size, 3)
    for k in range(3):
        flt = new_filter()
        flt.x = at_start[:, k].copy()
        moved = flt.run_for_response(tape_of(z + told[:, k]))
        assert np.array_equal(moved.used_rows, without.used_rows)
        difference = (moved.normalised - without.normalised)[without.used_rows]
        assert np.abs(difference).max() > 0.1
        assert response[:, k] == pytest.approx(difference, abs=1e-6)


def test_plain_python_sweeps_and_responds_as_the_compiled_kernel_does(monkeypatch):
    """Without numba the same source runs as it stands: clones, gates, drives and walks."""
    rng = np.random.default_rng(7)
    given = signatures(rng)
    z = 1e-3 * rng.standard_normal(len(given[2]))
    z[-1] = 1000.0  # beyond the gate

    def swept():
        flt = new_filter()
        response = flt.run_for_response(tape_of(z))
        sigma = np.sqrt(np.maximum(np.diag(flt.P), 1e-40))
        seen = response.normalised[response.used_rows]
        return flt.x / sigma, flt.P / np.outer(sigma, sigma), seen, response.of(*given)

    compiled = swept()
    bodies = {k: f.py_func for k, f in vars(kernel).items() if hasattr(f, "py_func")}
    assert {"sweep", "respond", "transition", "measure", "assign"} <= bodies.keys()
    for name, body in bodies.items():
        monkeypatch.setattr(kernel, name, body)
    for plain, own in zip(swept(), compiled, strict=True):
        assert plain == pytest.approx(own, rel=1e-9, abs=1e-9)


def test_whitened_rows_are_independent_and_of_unit_variance():
    """Errors from the prior, with process noise and noise of the rows: data are the columns that
    start at less what the filter takes the errors for, here zero, with z as what was measured.
    """
    rng, draws = np.random.default_rng(3), 400
    P0 = new_filter().P
    start = np.sqrt(np.diag(P0))[:, None] * rng.standard_normal((len(P0), draws))
    z = shown(np.zeros((STANDS + ROLLS, INPUTS, draws)), start, rng)
    response = new_filter().run_for_response(tape_of())
    white = response.of(np.zeros_like(start), np.zeros((STANDS + ROLLS, INPUTS, draws)), z)
    c = response.tape
    names = np.array(c.names)[c.name[c.operation_of_row[response.used_rows]]]
    for name in ("still", "heading held", "lateral", "gnss"):
        own = white[names == name]
        low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], own.size)
        assert low < np.sum(own**2) < high, name
    off = (white @ white.T)[np.triu_indices(len(white), 1)] / np.sqrt(draws)
    assert np.mean(off**2) == pytest.approx(1.0, abs=FOUR_SIGMA * np.sqrt(2.0 / off.size))
    sweep = new_filter().run_for_response(tape_of(z[:, 0]))
    assert white[:, 0] == pytest.approx(sweep.normalised[sweep.used_rows], abs=1e-6)


def test_refused_rows_stay_out():
    """A fix beyond the gate moves nothing: the response is that of a tape without it."""
    start, sensed, changed = signatures(np.random.default_rng(4))
    outlier = STANDS + 10
    c = tape_of().compiled()
    fix = np.flatnonzero((c.name == c.names.index("gnss")) & (c.time_s == joined().end_s[outlier]))
    rows = c.ops[fix[0], 2] + np.arange(2)
    z = np.zeros(len(c.z))
    z[rows] = 1000.0
    flt = new_filter()
    refused = flt.run_for_response(tape_of(z))
    assert flt.tally.rejected == [(joined().end_s[outlier], "gnss")]
    assert not np.isin(rows, refused.used_rows).any()
    missing = new_filter().run_for_response(tape_of(left_out=outlier))
    kept = np.delete(changed, rows, axis=0)
    assert refused.used_rows.size == missing.used_rows.size == len(c.z) - STANDS - ROLLS - 4
    expected = missing.of(start, sensed, kept)
    assert refused.of(start, sensed, changed) == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_each_row_has_its_operation():
    c = tape_of().compiled()
    for row, operation in enumerate(c.operation_of_row):
        first, count = c.ops[operation, 2:]
        assert first <= row < first + count


def test_a_step_linearised_about_the_filters_own_error_has_no_response():
    steps = joined()
    moving = np.zeros(len(steps.dt_s), bool)
    moving[STANDS + 3] = True
    with pytest.raises(ValueError):
        new_filter().run_for_response(Tape(replace(steps, moving=moving)))


@pytest.mark.parametrize("wrong", ["start", "sensed", "measured", "columns"])
def test_columns_that_do_not_fit_are_refused(wrong):
    start, sensed, changed = signatures(np.random.default_rng(5))
    given = {"start": start, "sensed": sensed, "measured": changed}
    if wrong == "columns":
        given["sensed"] = sensed[:, :, :2]
    else:
        given[wrong] = given[wrong][1:]
    response = new_filter().run_for_response(tape_of())
    with pytest.raises(ValueError):
        response.of(**given)


def test_a_start_that_the_filter_knows_to_be_zero_is_refused():
    start, sensed, changed = signatures(np.random.default_rng(6))
    start[em.SLIP] = 0.01
    with pytest.raises(ValueError):
        new_filter().run_for_response(tape_of()).of(start, sensed, changed)
