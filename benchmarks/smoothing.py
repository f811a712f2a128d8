"""What smoothing brings: errors and sigmas of the aided solution, filter and smoother, over
simulated flights.

    python -m benchmarks.smoothing [FLIGHTS]

Flights of eight minutes with all the noise of the technology's defaults, fixes at 1 Hz and a minute
without any (300 to 360 s); MEMS units start in motion, ring-laser ones parked. And slow drives
whose heading is sought all round.
"""

import sys
from dataclasses import dataclass, field

import numpy as np

from infield.aided.flight import Aiding, navigate_aided
from infield.session.log import find_rest
from tests.infield.aided_cases import errors, flown, ideal, normalised, twin_of
from tests.infield.test_aided_headings import fly, slow

OUT = ((300.0, 360.0),)


@dataclass
class Rows:
    """Of each flight: what an outage left, squared errors over variances, heading at the start."""

    level_m: list[float] = field(default_factory=list)
    over: list[float] = field(default_factory=list)
    normalised: list[np.ndarray] = field(default_factory=list)
    heading_deg: list[float] = field(default_factory=list)
    sigma_deg: list[float] = field(default_factory=list)

    def add(self, made, history, scores) -> None:
        self.level_m += [s.rms_level_m for s in scores]
        self.over += [s.error_over_sigma for s in scores]
        self.normalised.append(normalised(made, history, 0))
        first = slice(0, 60)  # the first minute
        heading = np.degrees(errors(made, history)[first, 8])
        self.heading_deg.append(float(np.mean(heading**2)))
        self.sigma_deg.append(float(np.degrees(np.sqrt(history.variance[first, 8])).mean()))

    def line(self, name: str) -> str:
        level = np.sqrt(np.mean(np.square(self.level_m))) if self.level_m else float("nan")
        over = np.sqrt(np.mean(np.square(self.over))) if self.over else float("nan")
        ratio = ", ".join(f"{v:.2f}" for v in np.mean(self.normalised, axis=0))
        return (
            f"| {name} | {level:.2f} ({over:.2f}) | {np.sqrt(np.mean(self.heading_deg)):.3f} |"
            f" {np.mean(self.sigma_deg):.3f} | {ratio} |"
        )


def main(flights: int) -> None:
    """Prints the table."""
    print(
        "| flights | level RMS in the outage, m (error over sigma) | heading RMS in the first"
        " minute, deg | its mean sigma, deg | position, velocity, attitude: squared error over"
        " variance |\n"
        "|---|---|---|---|---|"
    )
    for technology in ("mems", "rlg"):
        filters, ours = Rows(), Rows()
        for seed in range(flights):
            made, twin = flown(ideal(60.0), twin_of(technology), 300 + seed), twin_of(technology)
            rest = find_rest(made.run) if technology == "rlg" else None
            found = navigate_aided(
                made.run,
                made.run.imu,
                twin,
                rest=rest,
                gyro_sigma_deg_h=None,
                aiding=Aiding(left_out=OUT),
            ).with_smoothed(OUT)
            filters.add(made, found.history, found.outage_scores)
            ours.add(made, found.smoothed, found.smoothed_scores)
        print(filters.line(f"{flights} {technology}, filter"), flush=True)
        print(ours.line(f"{flights} {technology}, smoothed"), flush=True)
    filters, ours = Rows(), Rows()
    for seed in range(flights):
        made = slow(seed)
        found = fly(made.run).with_smoothed()
        filters.add(made, found.history, ())
        ours.add(made, found.smoothed, ())
    print(filters.line(f"{flights} slow drives, filter"), flush=True)
    print(ours.line(f"{flights} slow drives, smoothed"), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 30)
