"""What smoothing and wheels bring to the aided solution: errors and sigmas over simulated flights
and drives.

Flights of eight minutes with all the noise of the technology's defaults, fixes at 1 Hz and a minute
without any (300 to 360 s); MEMS units start in motion, ring-laser ones parked. And slow drives
whose heading is sought all round. Drives of twelve minutes with two outages of 60 s: without
wheels, with side and height alone, and with an odometer.
"""

from dataclasses import replace

import numpy as np

from benchmarks.study import Record, Work, rms, table
from infield.aided.flight import AidedResult, Aiding, Vehicle, navigate_aided
from infield.session.log import find_rest
from tests.infield.aided_cases import errors, flown, ideal, normalised, twin_of
from tests.infield.car_cases import driven
from tests.infield.test_aided_headings import fly, slow
from trajectories.simulator.session import SimulatedRun

OUT = ((300.0, 360.0),)


NORMALISED = "squared error over variance: position, velocity, attitude"
SMOOTHED = (
    "flights",
    "level RMS in an outage of 60 s, m (error over sigma)",
    "heading RMS in the first minute, deg",
    "its mean sigma, deg",
    NORMALISED,
)
DRIVEN = ("drives", "level RMS in two outages, m (error over sigma)", "smoothed", NORMALISED)
WHEELS = {
    "no wheels": (Vehicle.OTHER, True),
    "side and height": (Vehicle.FIND, False),
    "and an odometer": (Vehicle.FIND, True),
}
DRIVEN_OUT = ((300.0, 360.0), (420.0, 480.0))


def smoothed(technology: str, seed: int) -> list[Record]:
    """A flight as filtered and as smoothed."""
    twin = twin_of(technology)
    made = flown(ideal(60.0), twin, 300 + seed)
    rest = find_rest(made.run) if technology == "rlg" else None
    aiding = Aiding(left_out=OUT)
    found = navigate_aided(
        made.run, made.run.imu, twin, rest=rest, gyro_sigma_deg_h=None, aiding=aiding
    ).with_smoothed(OUT)
    return _both(made, found)


def slow_drive(technology: str, seed: int) -> list[Record]:
    """A drive whose heading is sought all round."""
    made = slow(seed)
    return _both(made, fly(made.run).with_smoothed())


def _both(made: SimulatedRun, found: AidedResult) -> list[Record]:
    """Of filter and smoother: level error of the outage, over sigma, squared errors over variances,
    squared error and sigma of the heading in the first minute [deg].
    """
    out = []
    sides = ((found.history, found.outage_scores), (found.smoothed, found.smoothed_scores))
    for history, scores in sides:
        first = slice(0, 60)
        heading = np.degrees(errors(made, history)[first, 8])
        out.append(
            {
                "level_m": [s.rms_level_m for s in scores],
                "over": [s.error_over_sigma for s in scores],
                "normalised": list(normalised(made, history, 0)),
                "heading_deg2": float(np.mean(heading**2)),
                "sigma_deg": float(np.degrees(np.sqrt(history.variance[first, 8])).mean()),
            }
        )
    return out


def on_wheels(technology: str, seed: int, wheels: str) -> Record:
    """A drive with outages, with what wheels there are."""
    drive, twin = driven(seed, technology), twin_of(technology)
    vehicle, odometer = WHEELS[wheels]
    log = drive.run if odometer else replace(drive.run, odometer=None)
    aiding = Aiding(left_out=DRIVEN_OUT, vehicle=vehicle)
    found = navigate_aided(log, log.imu, twin, rest=None, gyro_sigma_deg_h=None, aiding=aiding)
    late = found.with_smoothed(DRIVEN_OUT)
    return {
        name: {
            "level_m": [s.rms_level_m for s in scores],
            "over": [s.error_over_sigma for s in scores],
        }
        for name, scores in (("filter", late.outage_scores), ("smoothed", late.smoothed_scores))
    } | {"normalised": list(normalised(drive, late.history, 60))}


def level(of: list[Record]) -> str:
    """Level RMS of the outages, and RMS error over sigma."""
    metres, over = (rms([v for r in of for v in r[key]]) for key in ("level_m", "over"))
    return f"{metres:.2f} ({over:.2f})" if np.isfinite(metres) else ""


def ratio(of: list[Record]) -> str:
    return ", ".join(f"{v:.2f}" for v in np.mean([r["normalised"] for r in of], axis=0))


def run(work: Work, *, flights: int = 30, drives: int = 12) -> str:
    """flights: of each technology, and slow drives; drives: with and without wheels."""
    rows = []
    for name, make in (("mems", smoothed), ("rlg", smoothed), ("slow drives", slow_drive)):
        found = work.each(make, [(name, seed) for seed in range(flights)])
        for k, side in enumerate(("filter", "smoothed")):
            of = [pair[k] for pair in found]
            heading = np.sqrt(np.mean([r["heading_deg2"] for r in of]))
            sigma = np.mean([r["sigma_deg"] for r in of])
            told = [level(of), f"{heading:.3f}", f"{sigma:.3f}", ratio(of)]
            rows.append([f"{flights} {name}, {side}", *told])
    text = table(SMOOTHED, rows)
    rows = []
    for technology in ("mems", "rlg") if drives else ():
        for wheels in WHEELS:
            of = work.each(on_wheels, [(technology, seed, wheels) for seed in range(drives)])
            told = [level([r[key] for r in of]) for key in ("filter", "smoothed")]
            rows.append([f"{drives} {technology}, {wheels}", *told, ratio(of)])
    return text + "\n" + table(DRIVEN, rows)
