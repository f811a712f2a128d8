"""R1, R2, R5: how often the gates of the collected data do what they should.

Every row is over seeded simulations with known truth at 10 Hz; the page says how events are drawn.
"""

from itertools import chain

import numpy as np

from benchmarks.study import Work, interval_95, table
from tests.scenarios.fault_study import TWINS, burst, latitude_found
from tests.scenarios.gate_study import KINDS, gate

FIRST = 1000  # seed of the events
SWAYS_M_S = (0.001, 0.02)
NAMES = {"bump": "tug bump", "loading": "loading (boarding)", "gust": "gust", "push": "tug push"}
HEAD = ("requirement", "what", "needed", "measured", "95 % interval", "met")
OFFSETS = ((0.0, 0.0, 0.01), (0.25, 0.95, 1.0), (0.6, 1.0, 1.0))  # deg, least and most named
Row = tuple[str, ...]


def rate_row(
    requirement: str, what: str, hits: int, runs: int, *, least: float = 0.0, most: float = 1.0
) -> Row:
    """One row of a share of runs, needed at least `least` or at most `most`."""
    low, high = interval_95(hits, runs)
    needed = f"at least {100 * least:g} %" if least else f"at most {100 * most:g} %"
    met = "yes" if least <= hits / runs <= most else "**no**"
    measured = f"{100 * hits / runs:.1f} % ({hits} of {runs})"
    return requirement, what, needed, measured, f"{100 * low:.1f} to {100 * high:.1f} %", met


def motion_rows(sway: float, kind: str, runs: int) -> list[Row]:
    """R1: events of a kind at a sway, or the quiet data lost."""
    where, seeds = f"sway {1e3 * sway:g} mm/s", range(FIRST, FIRST + runs)
    if kind == "quiet":
        lost = 100 * np.array([gate(None, seed, sway).quiet_lost for seed in seeds])
        met = "yes" if lost.mean() <= 1.0 else "**no**"
        told = f"{lost.mean():.2f} % of the seconds"
        worst = f"worst run {lost.max():.1f} %"
        return [("R1", f"quiet data lost, {where}", "at most 1 %", told, worst, met)]
    gated = [gate(kind, seed, sway) for seed in seeds]
    excluded = sum(g.excluded for g in gated)
    what = f"{NAMES[kind]} excluded with its guard, {where}"
    rows = [rate_row("R1", what, excluded, runs, least=0.99)]
    if kind == "push":
        what = f"parked heading taken as new after a push, {where}"
        rows.append(rate_row("R1", what, sum(g.reopened for g in gated), runs, least=0.99))
    return rows


def latitude_row(name: str, offset: float, least: float, most: float, runs: int) -> Row:
    """R2: wrong entered latitude."""
    named = sum(latitude_found(seed, offset, TWINS[name])[0] for seed in range(runs))
    what = f"{offset:g} deg of wrong latitude named" if offset else "false alarms of the latitude"
    return rate_row("R2", f"{what}, {name} twin", named, runs, least=least, most=most)


def clipping_rows(runs: int) -> list[Row]:
    """R5: bursts listed, and what they move."""
    bursts = [burst(seed) for seed in range(runs)]
    listed = sum(b.listed for b in bursts)
    rows = [rate_row("R5", "burst excluded with its guard and listed", listed, runs, least=0.99)]
    moved, lost = np.array([b.moved for b in bursts]), np.array([b.widened for b in bursts])
    for axis, name in enumerate("xyz"):
        rms, worst = np.sqrt(np.mean(moved[:, axis] ** 2)), np.abs(moved[:, axis]).max()
        by_loss = np.sqrt(np.maximum(np.mean(lost[:, axis] ** 2) - 1.0, 0.0))
        what = f"gyro {name}: session mean moved by a burst"
        owned = f"worst {worst:.2f}; {by_loss:.3f} is what the sigma owns to for the lost data"
        met = "yes" if rms < 0.1 else "**no**"
        rows.append(("R5", what, "below 0.1 sigma", f"{rms:.3f} sigma RMS", owned, met))
    return rows


def run(work: Work, *, runs: int = 200) -> str:
    kinds = (*KINDS, "quiet")
    motion = work.each(motion_rows, [(sway, kind, runs) for sway in SWAYS_M_S for kind in kinds])
    asked = [(name, *offset, runs) for name in TWINS for offset in OFFSETS]
    latitude = work.each(latitude_row, asked)
    clipping = work.each(clipping_rows, [(runs,)])
    return table(HEAD, [*chain(*motion), *latitude, *chain(*clipping)])
