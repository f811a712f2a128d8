"""What is odd about a logged thermometer: stuck, coarse steps, jumps, zero as missing, kelvin or Fahrenheit."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from trajectories.run_check import Findings

STUCK_S = 600.0
ZERO_OFF_DEGC = 1.0  # a reading of exactly 0 this far from its neighbours' median is a missing value
JUMP_DEGC, JUMP_DEGC_S = 2.0, 0.5  # a housing does not change faster


def check_thermometer(columns: dict[str, NDArray], label: str, findings: Findings) -> None:
    """Warnings on thermometers: stuck, coarse steps, jumps, zero as missing, kelvin or Fahrenheit."""
    time_s = columns["time_s"]
    for name, values in columns.items():
        if name == "time_s" or name.startswith("gradient"):
            continue
        kept = np.isfinite(values)
        if kept.any():
            findings.warn(*(f"{label}: {name} {w}" for w in _thermometer_faults(time_s[kept], values[kept])))
            if np.median(values[kept]) > 150.0:
                findings.suspect(f"{label}: {name} is about {np.median(values[kept]):.0f}, needed degC: kelvin?")


def _thermometer_faults(time_s: NDArray, values: NDArray) -> list[str]:
    faults = []
    step = np.diff(values)
    resolution = float(np.min(np.abs(step[step != 0]), initial=np.inf))
    changes = np.concatenate([[0], np.flatnonzero(step) + 1, [values.size]])
    lasts = time_s[changes[1:] - 1] - time_s[changes[:-1]]
    k = int(np.argmax(lasts))
    coarse = np.isfinite(resolution) and np.allclose(values / 0.5, np.round(values / 0.5), atol=1e-9)
    if lasts[k] > STUCK_S and not coarse:
        at = changes[k]
        faults.append(f"is stuck at {values[at]:g} degC from {time_s[at]:.0f} s for {lasts[k]:.0f} s")
    if coarse:
        faults.append(f"has steps of {resolution:g} degC: its rate of change is poorly known")
    jumps = np.flatnonzero((np.abs(step) > JUMP_DEGC) & (np.abs(step) > JUMP_DEGC_S * np.diff(time_s)))
    if jumps.size:
        at = jumps[0]
        faults.append(f"jumps by {step[at]:+.1f} degC at {time_s[at + 1]:.1f} s ({jumps.size} jumps)")
    around = median_filter(values, size=min(31, values.size), mode="nearest")
    zeros = int(np.sum((values == 0) & (np.abs(around) > ZERO_OFF_DEGC)))
    if zeros:
        faults.append(f"is exactly 0 in {zeros} rows: missing values?")
    if 70.0 < np.median(values) <= 150.0:
        faults.append(f"is about {np.median(values):.0f} degC: Fahrenheit?")
    return faults
