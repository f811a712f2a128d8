"""Cells and the test of what is left: quiet under the twin's own noise, loud where something is
wrong.
"""

import numpy as np
import pytest

from simreal.evidence.whitened import CHANNELS
from simreal.inference.locate import Leftover, cells_of, locate, measure_cells
from simreal.inference.noise_hypotheses import Squares
from tests.simreal.test_evidence import null_evidence

REPLICATES = 250


@pytest.fixture(scope="module")
def bench():
    evidence = null_evidence("trajectories")
    squares = Squares(evidence)
    rng = np.random.default_rng(5)
    z = rng.standard_normal((evidence.size, REPLICATES))
    ratio = squares.ratio(z, rng)
    cells = cells_of(evidence, squares)
    leftover = Leftover(evidence, cells, squares)
    return evidence, squares, cells, leftover, z, ratio, leftover.statistics(z, ratio)


def test_information_of_a_cell_is_nothing_on_average(bench):
    _, squares, cells, _, _, ratio, _ = bench
    _, dof, nats = measure_cells(cells, squares.dof, ratio)
    wide = dof > 50
    assert np.mean(nats[wide]) == pytest.approx(0.0, abs=0.06)


def test_p_values_of_nothing_are_even(bench):
    """Of 60 fresh draws about one in ten is below 0.1: between 1 and 14 at four sigmas."""
    evidence, squares, _, leftover, _, _, replicates = bench
    rng = np.random.default_rng(6)
    fresh = rng.standard_normal((evidence.size, 60))
    ratio = squares.ratio(fresh, rng)
    p = [leftover.judge(fresh[:, k], ratio[:, k], replicates)[0] for k in range(60)]
    assert 1 <= np.sum(np.array(p) < 0.1) <= 14


def test_a_louder_channel_is_found_where_it_is(bench):
    evidence, squares, cells, leftover, z, ratio, replicates = bench
    loud = z[:, 0].copy()
    rows = (evidence.rows.channel == CHANNELS.index("gyro_y")) & evidence.rows.steady
    loud[rows] *= 1.25
    again = squares.ratio(loud[:, None], np.random.default_rng(7))[:, 0]
    p, looks_like = leftover.judge(loud, again, replicates)
    assert p < 1e-3
    _, _, null = measure_cells(cells, squares.dof, ratio)
    table = locate(cells, squares, again, float(np.quantile(null.max(axis=0), 0.995)))
    assert {table.cells[k].channel for k in np.flatnonzero(table.located)} == {"gyro_y"}
    assert looks_like


def test_a_quieter_channel_is_a_gap_as_well(bench):
    evidence, squares, _, leftover, z, _, replicates = bench
    quiet = z[:, 1].copy()
    quiet[evidence.rows.channel == CHANNELS.index("accel_z")] *= 0.75
    again = squares.ratio(quiet[:, None], np.random.default_rng(8))[:, 0]
    assert leftover.judge(quiet, again, replicates)[0] < 1e-3


def test_a_burst_is_seen(bench):
    _, squares, _, leftover, z, _, replicates = bench
    burst = z[:, 2].copy()
    burst[40] = 9.0
    again = squares.ratio(burst[:, None], np.random.default_rng(9))[:, 0]
    p, looks_like = leftover.judge(burst, again, replicates)
    assert p < 0.01
    assert looks_like in ("burst", "kurtosis", "cells")
