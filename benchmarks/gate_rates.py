"""R1, R2, R5: how often the gates of the collected data do what they should, with 95 %
Clopper-Pearson intervals.

    python -m benchmarks.gate_rates [--runs 200] [--only motion|latitude|clipping]
        [-o docs/rates_gate.md]

prints a Markdown table and writes it. All seeded: the same command gives the same numbers.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.stats import beta

from tests.scenarios.fault_study import TWINS, burst, latitude_found
from tests.scenarios.gate_study import KINDS, gate

SWAYS_M_S = (0.001, 0.02)
NAMES = {"bump": "tug bump", "loading": "loading (boarding)", "gust": "gust", "push": "tug push"}
HEAD = ("requirement", "what", "needed", "measured", "95 % interval", "met")
INTRODUCTION = """# Rates of the gates

Made by `python -m benchmarks.gate_rates`; every row is over seeded simulations with known truth at 10 Hz. Events are drawn
apart from what the detector looks for: tug bumps with a velocity of 0.061 to 1 m/s over 0.3 to 3 s in any direction; loading
that tilts or turns by 5 to 200 arcsec in 0.5 to 5 s and sinks by up to 30 mm; gusts of at least 30 mm/s RMS and three times
the sway for 10 to 90 s; pushes of 0.5 to 10 m at 0.1 to 0.7 m/s. An event counts as excluded when no second of it and of the
30 s behind it is used. Bursts: a gyro (0.005 to 0.5 rad) or accelerometer (0.05 to 20 m/s) stuck at one value for 1 to 10 rows
somewhere in the parked 70 min of the reference session.
"""


def interval(hits: int, runs: int) -> tuple[float, float]:
    """95 % Clopper-Pearson interval of a rate."""
    low = beta.ppf(0.025, hits, runs - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, runs - hits) if hits < runs else 1.0
    return float(low), float(high)


def rate_row(
    requirement: str, what: str, hits: int, runs: int, *, least: float = 0.0, most: float = 1.0
) -> tuple[str, ...]:
    """One row of a share of runs, needed at least `least` or at most `most`."""
    low, high = interval(hits, runs)
    needed = f"at least {100 * least:g} %" if least else f"at most {100 * most:g} %"
    met = "yes" if least <= hits / runs <= most else "**no**"
    measured = f"{100 * hits / runs:.1f} % ({hits} of {runs})"
    return requirement, what, needed, measured, f"{100 * low:.1f} to {100 * high:.1f} %", met


def motion_rows(runs: int) -> Iterator[tuple[str, ...]]:
    """R1: events by kind and sway, and the quiet data lost."""
    for sway in SWAYS_M_S:
        where = f"sway {1e3 * sway:g} mm/s"
        for kind in KINDS:
            gated = [gate(kind, seed, sway) for seed in range(1000, 1000 + runs)]
            yield rate_row(
                "R1",
                f"{NAMES[kind]} excluded with its guard, {where}",
                sum(g.excluded for g in gated),
                runs,
                least=0.99,
            )
            if kind == "push":
                what = f"parked heading taken as new after a push, {where}"
                yield rate_row("R1", what, sum(g.reopened for g in gated), runs, least=0.99)
        lost = np.array([gate(None, seed, sway).quiet_lost for seed in range(1000, 1000 + runs)])
        share, worst = 100 * lost.mean(), 100 * lost.max()
        met = "yes" if share <= 1.0 else "**no**"
        yield (
            "R1",
            f"quiet data lost, {where}",
            "at most 1 %",
            f"{share:.2f} % of the seconds",
            f"worst run {worst:.1f} %",
            met,
        )


def latitude_rows(runs: int) -> Iterator[tuple[str, ...]]:
    """R2: wrong entered latitude."""
    for name, twin in TWINS.items():
        for offset, least, most in ((0.0, 0.0, 0.01), (0.25, 0.95, 1.0), (0.6, 1.0, 1.0)):
            named = sum(latitude_found(seed, offset, twin)[0] for seed in range(runs))
            what = (
                f"{offset:g} deg of wrong latitude named"
                if offset
                else "false alarms of the latitude test"
            )
            yield rate_row("R2", f"{what}, {name} twin", named, runs, least=least, most=most)


def clipping_rows(runs: int) -> Iterator[tuple[str, ...]]:
    """R5: bursts listed, and what they move."""
    bursts = [burst(seed) for seed in range(runs)]
    yield rate_row(
        "R5",
        "burst excluded with its guard and listed",
        sum(b.listed for b in bursts),
        runs,
        least=0.99,
    )
    moved, lost = np.array([b.moved for b in bursts]), np.array([b.widened for b in bursts])
    for axis, name in enumerate("xyz"):
        rms, worst = np.sqrt(np.mean(moved[:, axis] ** 2)), np.abs(moved[:, axis]).max()
        by_loss = np.sqrt(np.maximum(np.mean(lost[:, axis] ** 2) - 1.0, 0.0))
        yield (
            "R5",
            f"gyro {name}: session mean moved by a burst",
            "below 0.1 sigma",
            f"{rms:.3f} sigma RMS",
            f"worst {worst:.2f}; {by_loss:.3f} is what the sigma owns to for the lost data",
            "yes" if rms < 0.1 else "**no**",
        )


PARTS: dict[str, Callable[[int], Iterator[tuple[str, ...]]]] = {
    "motion": motion_rows,
    "latitude": latitude_rows,
    "clipping": clipping_rows,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--only", choices=tuple(PARTS))
    parser.add_argument("-o", type=Path, default=Path("docs/rates_gate.md"))
    arguments = parser.parse_args()
    lines = ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    print(*lines, sep="\n")
    for name in [arguments.only] if arguments.only else PARTS:
        for row in PARTS[name](arguments.runs):
            lines.append("| " + " | ".join(row) + " |")
            print(lines[-1], flush=True)
    arguments.o.parent.mkdir(parents=True, exist_ok=True)
    arguments.o.write_text(INTRODUCTION + "\n" + "\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
