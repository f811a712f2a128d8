"""Whole diagnoses of a unit that finds no north: parked rates, with one effect and with none.

    python -m benchmarks.gap_mems [--sizes 8 12] [--seeds 0:2] [--nulls 10] [-o FILE]

Three starts (cold, ambient, cooling) of a MEMS unit that stands for 20 minutes. Its twin declares
a turn-on of hundreds of deg/h, so heading is unknown and only what changes within a rest, or from
start to start with temperature, can show. Effects are made row by row from the true temperatures;
no code of the catalogue is used.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_flights import (
    Believed,
    Outcome,
    parser_of,
    seeds_of,
    table_of,
    tell,
    tell_nulls,
    unit_of,
)
from infield.table.thermal_table import ThermalTable
from ins.records import Run, Site, TwinModel
from ins.twin_file import default_twin
from ins.units import DEG, DEG_PER_HOUR
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth

SITE = Site(lat_rad=45.0 * DEG, lon_rad=7.0 * DEG, height_m=250.0)
STARTS = ("cold", "ambient", "cooling")
PARKED_S, RATE_HZ = 1200.0, 10.0
UNIT_SEED = 3


@dataclass(frozen=True)
class Rested:
    """A rest, and the true temperature of its gyros at the rows (n, 3)."""

    run: Run
    time_s: NDArray
    degC: NDArray


@dataclass(frozen=True)
class Drift:
    """An effect on a sensor as `gap_flights.Planted`; rate: (rest, number of the start) -> rows
    [deg/h].
    """

    name: str
    target: str
    rate: Callable[[Rested, int], NDArray]
    answers: tuple[str, ...]
    neighbours: tuple[str, ...] = ()


def slope(rest: Rested, number: int) -> NDArray:
    return rest.degC[:, 0] - 30.0


def follows_ramps(rest: Rested, number: int) -> NDArray:
    """What the case gains on the sensor within two minutes, by a slow model of it."""
    behind = rest.degC[0, 1]
    out = np.empty(rest.time_s.size)
    for k, now in enumerate(rest.degC[:, 1]):
        behind += (now - behind) / (120.0 * RATE_HZ)
        out[k] = now - behind
    return out


def leaps(rest: Rested, number: int) -> NDArray:
    """In the second rest, within a second."""
    at = (rest.time_s > 700.0) if number == 1 else np.zeros(rest.time_s.size)
    return np.asarray(at, dtype=float)


DRIFTS = (
    Drift(
        "slope with temperature",
        "gyro_x",
        slope,
        ("gyro_thermal_linear",),
        ("gyro_thermal_quadratic", "compensation_misapplied"),
    ),
    Drift(
        "ramps",
        "gyro_y",
        follows_ramps,
        ("gyro_thermal_lag", "gyro_thermal_rate"),
        ("gyro_thermal_gradient",),
    ),
    Drift("step", "gyro_z", leaps, ("gyro_bias_step",), ()),
)


def twin() -> TwinModel:
    return default_twin("mems")


def table() -> ThermalTable:
    return table_of("mems", UNIT_SEED)


@lru_cache(maxsize=1)
def _ideal() -> IdealSensors:
    truth = build_truth(lay((Park(duration_s=PARKED_S),)), SITE, heading_rad=0.6)
    return ideal_sensors(truth, RATE_HZ)


def rests(seed: int) -> tuple[Rested, ...]:
    """The rests of a trial, without an effect."""
    out = []
    for number, start in enumerate(STARTS):
        session = simulate_run(
            _ideal(),
            thermal_history(start),
            unit_of("mems", UNIT_SEED),
            twin(),
            rng=np.random.default_rng([seed, number, 5]),
            plan=SessionPlan(run_id=f"rest-{number + 1}"),
        )
        t = session.run.imu.whole().time_s
        degC = np.stack(
            [np.interp(t, session.bias_time_s, c) for c in session.temperature_true_degC[:, :3].T],
            axis=1,
        )
        out.append(Rested(session.run, t, degC))
    return tuple(out)


def laid(rest: Rested, number: int, drift: Drift, size: float) -> Run:
    imu = rest.run.imu.whole()
    dtheta = imu.dtheta_rad.copy()
    rate = size * DEG_PER_HOUR * drift.rate(rest, number)
    dtheta[:, "xyz".index(drift.target[-1])] += rate * imu.dt_s
    return replace(rest.run, imu=replace(imu, dtheta_rad=dtheta))


def trial(drift: Drift, seed: int, wanted: float) -> Outcome:
    """One drift at one size in the rests of a seed, diagnosed."""
    bases, believed = rests(seed), Believed(twin(), table())

    def lay_all(size: float) -> list[Run]:
        return [laid(b, k, drift, size) for k, b in enumerate(bases)]

    sized = believed.at_size(lay_all, 1.0, wanted)
    return believed.outcome(drift, sized, wanted=wanted, seed=seed)


def main() -> None:
    options = parser_of("gap_mems", __doc__).parse_args()
    tell_nulls(options, Believed(twin(), table()), lambda seed: [r.run for r in rests(seed)])
    for seed in seeds_of(options):
        for drift in DRIFTS:
            for wanted in options.sizes:
                tell(trial(drift, seed, wanted), options.output)


if __name__ == "__main__":
    main()
