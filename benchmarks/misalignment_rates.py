"""R21: gyro misalignment from four azimuths over seeded simulations, and the drawing in
docs/misalignment.svg.

    python -m benchmarks.misalignment_rates [--seeds 200] [--runs 40]
        [--drawing docs/misalignment.svg]

prints Markdown. `--seeds`: tables of biases, no time at all; `--runs`: whole runs, about 1 s of CPU
each, 0: none.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from infield.misalignment.closed_forms import document_angles
from infield.misalignment.couplings import measure_misalignment
from infield.misalignment.harmonic_fit import level_rate_deg_h, north_to_west_rad
from infield.reports.figures import BLACK, BLUE, VERMILLION
from ins.units import ARCSEC, DEG

RATE = level_rate_deg_h(39.9 * DEG)
NOISE_DEG_H, INJECTED_RAD = 0.001, 60.0 * ARCSEC
FOUR_RAD = np.array([0.0, 90.0, 180.0, 270.0]) * DEG
ENTRIES = ("xy", "yx", "zx", "zy")


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


def of_tables(seeds: int) -> tuple[list[str], NDArray]:
    """Markdown rows of both cases, and the normalised errors of the second."""
    rows = []
    for off in (0.0, 2.0):
        seen = [table_errors(seed, off) for seed in range(seeds)]
        z, errors = np.array([s[0] for s in seen]), np.array([s[2] for s in seen])
        rms = np.sqrt(np.nanmean(errors**2, axis=0))
        errors_told = (
            f"RMS error of zx {rms[0]:.1f}; of (29) corrected {rms[1]:.1f}, as printed {rms[2]:.0f}"
        )
        rows.append(
            f"| table, azimuths off by up to {off:g} deg | {seeds} | {np.mean(z**2):.3f} | "
            f"{np.mean([s[1] for s in seen]) / 3:.3f} | {errors_told} |"
        )
    return rows, z


def of_runs(count: int) -> list[str]:
    """Markdown rows of whole runs."""
    from tests.scenarios.azimuth_study import study

    rows = []
    for power_ons, given in ((1, False), (1, True), (4, True)):
        found = [study(seed, power_ons=power_ons, given=given) for seed in range(count)]
        names = ("xy", "yx", "zx", "zy") if given else ("zx", "zy", "xy+yx")
        z = [f.z[name] for f in found for name in names]
        sigma = ", ".join(
            f"{name} {np.mean([f.sigma_mrad[name] for f in found]) * 206.265:.0f}" for name in names
        )
        rows.append(
            f"| runs, {power_ons} power-on(s), azimuths {'given' if given else 'found'} | {count} |"
            f" {np.mean(np.square(z)):.3f} | {np.mean([f.chi2 / f.dof for f in found]):.3f} | sigma"
            f" {sigma} |"
        )
    return rows


def drawing(z: NDArray) -> Figure:
    """One case with its curve, and the normalised errors of all against the normal curve."""
    figure = Figure(figsize=(10.0, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    rng = np.random.default_rng(7)
    H = np.linspace(0.0, 360.0, 181)
    entries = np.array([0.3, -0.2, 0.5, -0.1]) * 1e-3
    k = biases(FOUR_RAD, entries) + NOISE_DEG_H * rng.standard_normal((4, 3))
    fit = measure_misalignment(FOUR_RAD, k, NOISE_DEG_H**2 * np.eye(12), level_rate_deg_h=RATE).fit
    assert fit is not None
    bias, a, b = fit.parameters[2]
    left.plot(
        H, bias + RATE * (a * np.cos(H * DEG) + b * np.sin(H * DEG)), color=BLACK, label="fit"
    )
    left.errorbar(
        FOUR_RAD / DEG,
        k[:, 2],
        yerr=NOISE_DEG_H,
        fmt="o",
        color=VERMILLION,
        label="gyro z as measured",
    )
    left.errorbar(
        FOUR_RAD / DEG,
        fit.compensated_deg_h()[:, 2],
        yerr=NOISE_DEG_H,
        fmt="s",
        color=BLUE,
        label="compensated",
    )
    left.legend()
    left.set(
        title="zx 0.5 mrad, zy -0.1 mrad at 39.9 deg", xlabel="heading, deg", ylabel="bias, deg/h"
    )
    edges = np.linspace(-4.0, 4.0, 33)
    right.hist(z.ravel(), bins=edges, density=True, color=BLUE, alpha=0.5)
    right.plot(edges, np.exp(-(edges**2) / 2) / np.sqrt(2 * np.pi), color=BLACK)
    right.set(title=f"{z.size} couplings of 60 arcsec", xlabel="error / sigma", ylabel="density")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--drawing", type=Path, default=None)
    given = parser.parse_args()
    rows, z = of_tables(given.seeds)
    rows += of_runs(given.runs) if given.runs else []
    print(
        "| case | seeds | mean squared normalised error | chi-square / dof | arcsec |\n| --- | ---"
        " | --- | --- | --- |"
    )
    print("\n".join(rows))
    if given.drawing:
        drawing(z).savefig(given.drawing, metadata={"Date": None})


if __name__ == "__main__":
    main()
