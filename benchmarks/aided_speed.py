"""How many times real time the aided navigation runs, beside free-inertial navigation of the same
log in the same process.

    python benchmarks/aided_speed.py [MINUTES]

A flight at 200 Hz with GNSS at 1 Hz, in memory; CPU seconds of the second of two passes, so that
nothing is compiled in it. The last row: sensors eight times and fixes three times as noisy as
declared, so that the noise is searched for. Smoothing (`recal replay --smooth`) is beside the
flight. Peak memory is that of the process, simulation included.
"""

import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from infield.aided.flight import navigate_aided
from infield.session.log import find_rest
from ins.records import NavState
from ins.strapdown.mechanization import navigate
from ins.twin_file import default_twin
from tests.infield.aided_cases import FLIGHT, SITE, flown
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Cruise, Park
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.truth import build_truth

RATE_HZ = 200.0


def cpu_s(work: Callable[[], object]) -> float:
    """CPU seconds of the second call."""
    work()
    start = time.process_time()
    work()
    return time.process_time() - start


def main(minutes: float) -> None:
    """Prints the table."""
    cruise = Cruise(duration_s=max(60.0 * minutes - 730.0, 10.0))
    truth = build_truth(lay([Park(duration_s=300.0), *FLIGHT, cruise]), SITE, heading_rad=2.0)
    base, twin = ideal_sensors(truth, RATE_HZ), default_twin("rlg")
    made = flown(base, twin, 1)
    run = made.run
    start = NavState(time_s=0.0, site=SITE, v_n_m_s=np.zeros(3), C_nb=base.C_nb[0])
    seconds = run.imu.end_s
    free = cpu_s(lambda: navigate(run.imu.pieces(), start))
    rest = find_rest(run)
    gyro = replace(twin.gyro, arw_deg_sqrt_h=8.0 * twin.gyro.arw_deg_sqrt_h)
    gnss = replace(twin.gnss, sigma_horizontal_m=3.0 * twin.gnss.sigma_horizontal_m)
    loud = flown(base, replace(twin, gyro=gyro, gnss=gnss), 1).run
    loud = replace(loud, gnss=replace(loud.gnss, sigma_horizontal_m=None))
    rest_loud = find_rest(loud)
    aided = cpu_s(lambda: navigate_aided(run, run.imu, twin, rest=rest, gyro_sigma_deg_h=None))
    flight = navigate_aided(run, run.imu, twin, rest=rest, gyro_sigma_deg_h=None)
    smoothing = cpu_s(flight.with_smoothed)
    search = cpu_s(
        lambda: navigate_aided(loud, loud.imu, twin, rest=rest_loud, gyro_sigma_deg_h=None)
    )
    print(f"{seconds / 60:.0f} min at {RATE_HZ:.0f} Hz, GNSS at 1 Hz, {run.imu.rows} rows")
    for name, cost in (
        ("free-inertial navigation", free),
        ("aided: stands, start, filter, verdict", aided),
        ("smoothing it", smoothing),
        ("aided, the noise searched for", search),
    ):
        print(f"  {name:40s}{cost:7.2f} s CPU{seconds / cost:10.0f} times real time")
    print(f"  aided over free-inertial {aided / free:27.1f}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"  peak memory {peak:40.0f} MB")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)
