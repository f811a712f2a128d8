"""What wheels are worth where a car has no fixes: errors of simulated drives without them, with
side and height alone, and with an odometer.

    python -m benchmarks.wheels [DRIVES]

Drives of twelve minutes (tests/infield/car_cases.py) with two outages of 60 s.
"""

import sys
from dataclasses import replace

import numpy as np

from infield.aided.flight import Aiding, Vehicle, navigate_aided
from ins.records import Run
from tests.infield.aided_cases import normalised, twin_of
from tests.infield.car_cases import driven

OUT = ((300.0, 360.0), (420.0, 480.0))


def rms(values: list[list[float]]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main(drives: int) -> None:
    """Prints the table."""
    print(
        "| drives | level RMS in the outages, m (error over sigma) | smoothed |"
        " squared error over variance: position, velocity, attitude |\n|---|---|---|---|"
    )
    for technology in ("mems", "rlg"):
        made = [driven(seed, technology) for seed in range(drives)]
        for name, vehicle, odometer in (
            ("no wheels", Vehicle.OTHER, True),
            ("side and height", Vehicle.FIND, False),
            ("and an odometer", Vehicle.FIND, True),
        ):
            found = []
            for drive in made:
                run: Run = drive.run if odometer else replace(drive.run, odometer=None)
                aiding = Aiding(left_out=OUT, vehicle=vehicle)
                twin = twin_of(technology)
                flight = navigate_aided(
                    run, run.imu, twin, rest=None, gyro_sigma_deg_h=None, aiding=aiding
                )
                found.append(flight.with_smoothed(OUT))
            parts = [
                f"{rms([[s.rms_level_m for s in scores] for scores in each]):.2f}"
                f" ({rms([[s.error_over_sigma for s in scores] for scores in each]):.2f})"
                for each in ([f.outage_scores for f in found], [f.smoothed_scores for f in found])
            ]
            ratio = np.mean(
                [normalised(m, f.history, 60) for m, f in zip(made, found, strict=True)], axis=0
            )
            told = ", ".join(f"{v:.2f}" for v in ratio)
            print(f"| {drives} {technology}, {name} | {' | '.join(parts)} | {told} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 12)
