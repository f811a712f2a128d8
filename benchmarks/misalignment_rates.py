"""R21: gyro misalignment from four azimuths over seeded simulations (at 39.9 deg; chi-square of the
redundancy should be 1).
"""

import numpy as np
from numpy.typing import NDArray

from benchmarks.study import Work, table
from infield.misalignment.closed_forms import document_angles
from infield.misalignment.couplings import measure_misalignment
from infield.misalignment.harmonic_fit import level_rate_deg_h, north_to_west_rad
from ins.units import ARCSEC, DEG
from tests.scenarios.azimuth_study import study

RATE = level_rate_deg_h(39.9 * DEG)
NOISE_DEG_H, INJECTED_RAD = 0.001, 60.0 * ARCSEC
FOUR_RAD = np.array([0.0, 90.0, 180.0, 270.0]) * DEG
ENTRIES = ("xy", "yx", "zx", "zy")
HEAD = ("case", "seeds", "mean squared normalised error", "chi-square / dof", "arcsec")
Row = tuple[str, ...]


def biases(heading_rad: NDArray, entries_rad: NDArray) -> NDArray:
    """Biases (m, 3) [deg/h] of a level unit with couplings xy, yx, zx, zy; no bias of its own."""
    x, y = RATE * np.cos(heading_rad), -RATE * np.sin(heading_rad)
    xy, yx, zx, zy = entries_rad
    return np.stack([xy * y, yx * x, zx * x + zy * y], axis=1)


def table_errors(seed: int, off_deg: float) -> tuple[NDArray, float, NDArray]:
    """Error over sigma of the four couplings, chi-square, and errors [arcsec] of ezy: harmonics and
    closed form.
    """
    rng = np.random.default_rng([seed, 2100])
    heading = FOUR_RAD + off_deg * DEG * rng.uniform(-1.0, 1.0, 4)
    k = biases(heading, np.full(4, INJECTED_RAD)) + NOISE_DEG_H * rng.standard_normal((4, 3))
    R = NOISE_DEG_H**2 * np.eye(12)
    result = measure_misalignment(heading, k, R, level_rate_deg_h=RATE)
    assert result.fit is not None
    closed = document_angles(north_to_west_rad(heading), k, R, level_rate_deg_h=RATE)
    found = [result.coupling(name) for name in ENTRIES]
    z = np.array([(c.value_rad - INJECTED_RAD) / c.sigma_rad for c in found])
    errors = (
        np.array([result.coupling("zx").value_rad, closed.ezy_rad, closed.literal_ezy_rad])
        - INJECTED_RAD
    )
    return z, result.fit.chi2, errors / ARCSEC


def of_tables(seeds: int, off_deg: float) -> Row:
    """Of tables of biases."""
    seen = [table_errors(seed, off_deg) for seed in range(seeds)]
    z, errors = np.array([s[0] for s in seen]), np.array([s[2] for s in seen])
    rms = np.sqrt(np.nanmean(errors**2, axis=0))
    return (
        f"table, azimuths off by up to {off_deg:g} deg",
        f"{seeds}",
        f"{np.mean(z**2):.3f}",
        f"{np.mean([s[1] for s in seen]) / 3:.3f}",
        f"RMS error of zx {rms[0]:.1f}; of (29) corrected {rms[1]:.1f}, as printed {rms[2]:.0f}",
    )


def of_runs(power_ons: int, given: bool, count: int) -> Row:
    """Of whole runs."""
    found = [study(seed, power_ons=power_ons, given=given) for seed in range(count)]
    names = ENTRIES if given else ("zx", "zy", "xy+yx")
    z = [f.z[name] for f in found for name in names]
    sigmas = {name: np.mean([f.sigma_mrad[name] for f in found]) * 206.265 for name in names}
    return (
        f"runs, {power_ons} power-on(s), azimuths {'given' if given else 'found'}",
        f"{count}",
        f"{np.mean(np.square(z)):.3f}",
        f"{np.mean([f.chi2 / f.dof for f in found]):.3f}",
        "sigma " + ", ".join(f"{name} {sigma:.0f}" for name, sigma in sigmas.items()),
    )


def run(work: Work, *, seeds: int = 200, runs: int = 40) -> str:
    """seeds: tables of biases, no time at all; runs: whole runs, about 1 s of CPU each."""
    tables = [of_tables(seeds, off) for off in (0.0, 2.0)]
    power_ons = [(ons, given, runs) for ons, given in ((1, False), (1, True), (4, True)) if runs]
    return table(HEAD, [*tables, *work.each(of_runs, power_ons)])
