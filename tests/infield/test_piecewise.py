"""Piecewise models and their whole-number export: continuity, what is recovered, the rounding bound
on every temperature.
"""

import shutil
import subprocess

import numpy as np
import pytest

from infield.reports.documents.fog import fit_models, fixed_tables, worst_rounding
from infield.thermal.coefficient_curves import Reduced
from infield.thermal.compensation import bias_deg_h
from infield.thermal.fog.fixed_point import (
    RATE_BITS,
    TEMPERATURE_BITS,
    fixed_table,
    to_c_header,
    to_csv,
)
from infield.thermal.fog.model import FogModel
from infield.thermal.fog.piecewise import Piecewise, piecewise_pair
from infield.thermal.fog.ramps import separate
from infield.thermal.study import AxisBlocks
from tests.infield.ramp_cases import TWIN, Truth, ramp


def blocks(K_T, K_delta, *, sigma=1e-4, seed=1):
    rng = np.random.default_rng(seed)
    T = np.tile(np.linspace(-20.0, 40.0, 400), 2)
    rate = np.repeat([0.5, -0.5], 400)
    y = K_T(T) + K_delta(T) * rate + sigma * rng.standard_normal(T.size)
    return AxisBlocks(T, rate, y, np.full(T.size, sigma), np.zeros(T.size, int), np.array([[1e-6]]))


def test_an_inflection_is_where_the_second_derivative_changes_sign():
    """T^3 about 7 degC bends there; a parabola nowhere."""
    pair = piecewise_pair(
        Reduced(blocks(lambda T: 1e-6 * (T - 7.0) ** 3, lambda T: 0.2 + 1e-4 * (T + 5) ** 2))
    )
    (bend,) = pair.inflections[0]
    assert bend.low_degC <= 7.0 <= bend.high_degC and bend.sigma_degC < 2.0
    assert pair.inflections[1] == () and len(pair.K_delta.coefficients) == 1
    T = np.linspace(-20, 40, 601)
    np.testing.assert_allclose(pair.K_delta(T), 0.2 + 1e-4 * (T + 5) ** 2, atol=2e-4)
    difference = pair.K_T(T) - 1e-6 * (T - 7.0) ** 3
    np.testing.assert_allclose(difference - difference.mean(), 0.0, atol=1e-4)


@pytest.fixture(scope="module")
def model():
    rng = np.random.default_rng(4)
    truth = Truth(rng)
    study = separate(
        [ramp(rng, truth, rates=(0.5, -0.5))], [ramp(rng, truth, rates=(0.05, -0.05))], TWIN
    )
    return fit_models(study)[1]


def curves_of(model):
    return [curve for gyro in model.gyros.values() for curve in (gyro.K_T, gyro.K_delta)]


def evaluated(table, t):
    """y (integers) at temperatures t (integers), as the hardware does it; the ends are held."""
    t = np.clip(np.asarray(t, dtype=np.int64), table.edges[0], table.edges[-1])
    j = np.clip(np.searchsorted(table.edges, t, side="right") - 1, 0, len(table.shift) - 1)
    u, shift = t - table.edges[j], table.shift[j]
    y = table.coefficients[j, -1].astype(np.int64)
    for k in range(table.coefficients.shape[1] - 2, -1, -1):
        y = ((y * u + (np.int64(1) << (shift - 1))) >> shift) + table.coefficients[j, k]
    return y


def test_segments_are_few_and_meet(model):
    for curve in curves_of(model):
        assert 1 <= len(curve.coefficients) <= 7 and curve.degree <= 3
        assert [b.temperature_degC for b in curve.breakpoints] == curve.edges_degC[1:-1].tolist()
        for edge in curve.edges_degC[1:-1]:
            left, right = curve(np.array([edge - 1e-9, edge + 1e-9]))
            assert left == pytest.approx(right, abs=1e-9)
        ends = curve(curve.edges_degC[[0, -1]] + [-30.0, 30.0])
        # held beyond its ends
        np.testing.assert_array_equal(ends, curve(curve.edges_degC[[0, -1]]))


@pytest.mark.parametrize("word_bits", [10, 16, 24, 32])
def test_rounding_stays_below_its_bound_at_every_temperature(model, word_bits):
    fine = np.linspace(-25.0, 45.0, 40001)
    for curve in curves_of(model):
        table = fixed_table(curve, word_bits=word_bits)
        assert np.abs(table.coefficients).max() < 1 << (word_bits - 1)
        t = np.arange(-25 << TEMPERATURE_BITS, 45 << TEMPERATURE_BITS)
        error = np.abs(
            evaluated(table, t) * 2.0**-table.fraction_bits - curve(t / 2.0**TEMPERATURE_BITS)
        )
        assert error.max() <= table.rounding
        rounded = np.round(fine * 2.0**TEMPERATURE_BITS).astype(int)
        error = np.abs(evaluated(table, rounded) * 2.0**-table.fraction_bits - curve(fine))
        assert 0 < error.max() <= table.worst


def test_the_bound_is_no_looser_than_it_must_be(model):
    """At 16 bits the worst error is at least a tenth of the bound, so the bound says something."""
    for curve in [gyro.K_delta for gyro in model.gyros.values()]:
        table = fixed_table(curve)
        t = np.arange(-20 << TEMPERATURE_BITS, 40 << TEMPERATURE_BITS)
        error = np.abs(
            evaluated(table, t) * 2.0**-table.fraction_bits - curve(t / 2.0**TEMPERATURE_BITS)
        )
        assert error.max() >= 0.1 * table.rounding


def test_breakpoints_off_the_temperature_grid_cost_what_is_stated():
    kinked = Piecewise(
        np.array([-20.0, 1 / 3, 40.0]), np.array([[0.0, 0.05], [(20 + 1 / 3) * 0.05, -0.05]]), ()
    )
    table = fixed_table(kinked, word_bits=24)
    T = np.linspace(0.0, 1.0, 20001)
    error = np.abs(
        evaluated(table, np.round(T * 128).astype(int)) * 2.0**-table.fraction_bits - kinked(T)
    )
    assert error.max() <= table.worst


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_c_header_computes_what_the_tables_say(model, tmp_path):
    tables = fixed_tables(model, 16)
    worst = worst_rounding(model, tables, 1.0)
    (tmp_path / "fog.h").write_text(to_c_header(tables, worst, serial='SN "7" */'))
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "fog.h"\nint main(void) { long t, r; while (scanf("%ld %ld",'
        ' &t, &r) == 2) {\n    printf("%ld %ld %ld\\n", (long)x_bias(t, r), (long)y_bias(t, r),'
        " (long)z_bias(t, r)); } return 0; }\n"
    )
    subprocess.run(
        ["cc", "-std=c99", "-Wall", "-Werror", "-Wno-unused", "main.c", "-o", "fog"],
        cwd=tmp_path,
        check=True,
    )
    rng = np.random.default_rng(1)
    T, rate = rng.uniform(-19, 39, 500), rng.uniform(-1, 1, 500)
    t, r = np.round(T * 2**TEMPERATURE_BITS).astype(int), np.round(rate * 2**RATE_BITS).astype(int)
    lines = "\n".join(f"{a} {b}" for a, b in zip(t, r))
    out = subprocess.run(
        [tmp_path / "fog"], input=lines, capture_output=True, text=True, check=True
    ).stdout
    got = np.array([row.split() for row in out.splitlines()], dtype=float)
    scale = [2.0 ** -tables[f"{axis}_kt"].fraction_bits for axis in "xyz"]
    T3, rate3 = (np.repeat(column[:, None], 3, axis=1) for column in (T, rate))
    error = np.abs(got * scale - bias_deg_h(model, T3, rate3, np.zeros_like(T3)))
    assert np.all(error.max(axis=0) <= list(worst.values())) and error.max() > 0


def test_csv_holds_every_segment(model):
    tables = fixed_tables(FogModel({"x": model.gyros["x"]}), 16)
    rows = to_csv(tables).splitlines()
    assert len(rows) == 1 + sum(len(t.shift) for t in tables.values())
    assert {len(row.split(",")) for row in rows} == {len(rows[0].split(","))}
