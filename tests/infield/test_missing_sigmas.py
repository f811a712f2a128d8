"""Fixes whose receiver gave no accuracy in single rows: read as NaN, and counted with the twin's
declared sigma.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from infield.session.navigated.receiver import sigma_of_fixes
from ins.columns import FIX_SIGMA_COLUMNS
from ins.filters.aided_records import fixes_of
from ins.records import InputError
from tests.infield.aided_cases import flown, ideal, twin_of
from trajectories.runs.directory import inspect_run, read_run, write_run

TWIN = twin_of("rlg")
DECLARED = dict(
    zip(
        FIX_SIGMA_COLUMNS,
        (TWIN.gnss.sigma_horizontal_m, TWIN.gnss.sigma_vertical_m, TWIN.gnss.sigma_velocity_m_s),
    )
)


@lru_cache(maxsize=1)
def logged():
    """A flight whose receiver says twice what the twin declares, in all rows."""
    run = flown(ideal(180.0), TWIN, 2).run
    n = run.gnss.time_s.size
    return replace(
        run,
        gnss=replace(run.gnss, **{name: np.full(n, 2 * value) for name, value in DECLARED.items()}),
    )


def holes(seed: int = 3) -> np.ndarray:
    """Which rows have no sigma, shape (3, n): every kind in rows of its own, and some rows without
    any.
    """
    lost = np.random.default_rng(seed).random((3, logged().gnss.time_s.size)) < 0.2
    lost[:, 50:60] = True
    return lost


def with_sigmas(values) -> object:
    """The flight with `values` (a number for each kind) where sigmas are missing."""
    gnss, lost = logged().gnss, holes()
    changed = {
        name: np.where(lost[k], values[name], getattr(gnss, name))
        for k, name in enumerate(FIX_SIGMA_COLUMNS)
    }
    return replace(logged(), gnss=replace(gnss, **changed))


@pytest.mark.parametrize("fmt", ["parquet", "csv", "csv.gz"])
def test_a_run_keeps_missing_sigmas(tmp_path, fmt):
    """Bit for bit through each kind of file, without a word, since nothing is wrong."""
    run = with_sigmas(dict.fromkeys(FIX_SIGMA_COLUMNS, np.nan))
    write_run(tmp_path / "run", run, fmt=fmt)
    found = inspect_run(tmp_path / "run")
    for k, name in enumerate(FIX_SIGMA_COLUMNS):
        np.testing.assert_array_equal(getattr(found.run.gnss, name), getattr(run.gnss, name))
        assert np.isnan(getattr(found.run.gnss, name)).sum() == holes()[k].sum()
    assert found.run.gnss.time_s.size == run.gnss.time_s.size
    assert not any("gnss" in f.text or "sigma" in f.text for f in found.findings)


def edited(path, change):
    """The written run with gnss.csv changed, line by line: `change(row number from 1, fields)`."""
    write_run(path / "run", logged(), fmt="csv")
    file = path / "run" / "gnss.csv"
    head, *rows = file.read_text().splitlines()
    names = head.split(",")
    out = [
        ",".join(change(k, dict(zip(names, row.split(",")))).values())
        for k, row in enumerate(rows, start=1)
    ]
    file.write_text("\n".join([head, *out]) + "\n")
    return path / "run"


@pytest.mark.parametrize("value", ["0", "-0.5", "inf"])
def test_what_is_no_sigma_is_named(tmp_path, value):
    path = edited(tmp_path, lambda k, row: row | ({"sigma_horizontal_m": value} if k == 7 else {}))
    with pytest.raises(InputError, match=r"row 7 \(line 8\)"):
        read_run(path)


def test_a_missing_sigma_counts_with_the_declared_one():
    """In the aided filter and in the alignment's own aid: as if the declared value had been logged
    in those rows.
    """
    missing, declared = with_sigmas(dict.fromkeys(FIX_SIGMA_COLUMNS, np.nan)), with_sigmas(DECLARED)
    noise = dict(zip(("horizontal_m", "vertical_m", "velocity_m_s"), DECLARED.values()))
    a, b = fixes_of(missing.gnss, **noise), fixes_of(declared.gnss, **noise)
    np.testing.assert_array_equal(a.sigma_position_m, b.sigma_position_m)
    np.testing.assert_array_equal(a.sigma_velocity_m_s, b.sigma_velocity_m_s)
    rows, lost = np.arange(missing.gnss.time_s.size), holes()
    for k, (sigma, name) in enumerate(
        zip(
            (a.sigma_position_m[:, 0], a.sigma_position_m[:, 2], a.sigma_velocity_m_s[:, 1]),
            FIX_SIGMA_COLUMNS,
        )
    ):
        np.testing.assert_array_equal(sigma, np.where(lost[k], DECLARED[name], 2 * DECLARED[name]))
    np.testing.assert_array_equal(
        sigma_of_fixes(missing.gnss.sigma_horizontal_m, rows, DECLARED[FIX_SIGMA_COLUMNS[0]]),
        a.sigma_position_m[:, 0],
    )
