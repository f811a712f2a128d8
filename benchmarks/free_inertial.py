"""The hour after a 60 min alignment: what a gyro table is worth in position.

A unit is powered on anew, aligned for an hour with the table in question, then navigates for an
hour without any aid but a damped height. Only the compensation differs between tables; log, noise
and alignment filter are the same.

What a level gyro error does here (physics.md 6.4): the east gyro's is cancelled by the heading it
makes the alignment find, but for its change over temperature since; the north gyro's is not, R b (t
- sin(w t)/w) = 1.22 R b t after an hour. So a perfect table still leaves the angle random walk of
alignment and flight.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from alignment import gyrocompass
from infield.replay.drift import drift_against
from infield.session.bins import make_bins
from infield.session.log import compensated_imu
from infield.session.settings import SessionSettings
from infield.table.thermal_table import SettledCurve, TemperatureModel, ThermalTable
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.records import AXES, NavState, Site, TwinModel
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG, MILLIRADIAN
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Park,
    Segment,
    Stop,
    Straight,
    TakeOff,
    Turn,
    TurnFlight,
)
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import UnitTruth

ALIGNMENT_S = 3600.0
HOUR_S = 3600.0
_FLIGHT: tuple[Segment, ...] = (
    Turn(angle_deg=90.0),
    Straight(duration_s=120.0),
    Stop(duration_s=60.0),
    TakeOff(),
    Climb(height_m=6000.0, rate_m_s=8.0, speed_m_s=180.0),
    TurnFlight(angle_deg=60.0),
    Cruise(duration_s=2600.0),
)
PROFILES: dict[str, tuple[Segment, ...]] = {
    "parked": (Park(duration_s=ALIGNMENT_S + HOUR_S),),
    "flight": (Park(duration_s=ALIGNMENT_S), *_FLIGHT),
}


@dataclass(frozen=True)
class Flown(TemperatureModel):
    """A table to fly with: bias(axis, T) [deg/h], and the table whose sigma the alignment is to
    expect of it.
    """

    bias_deg_h: Callable[[int, NDArray], NDArray]
    believed: ThermalTable

    @property
    def curves(self) -> Mapping[str, SettledCurve]:
        return {
            axis: SettledCurve((-np.inf, np.inf), partial(self.bias_deg_h, k))
            for k, axis in enumerate(AXES)
        }


@dataclass(frozen=True, kw_only=True)
class Sortie:
    """Where, on which heading, from which thermal start and along which profile a unit flies."""

    profile: str
    lat_deg: float
    heading_deg: float
    start: str


@dataclass(frozen=True, kw_only=True)
class Hour:
    """Position error at the end, north and east [m]; radial error, mean over the hour [m]; heading
    error of the alignment.
    """

    north_m: float
    east_m: float
    mean_m: float
    heading_mrad: float
    verdict: str


@lru_cache(maxsize=8)
def ideal(profile: str, lat_deg: float, heading_deg: float) -> IdealSensors:
    """The noise-free two hours, 10 Hz."""
    site = Site(lat_rad=lat_deg * DEG, lon_rad=7 * DEG, height_m=250.0)
    motion = lay(PROFILES[profile], alignment_s=ALIGNMENT_S)
    return ideal_sensors(build_truth(motion, site, heading_rad=heading_deg * DEG), 10.0)


def fly(
    unit: UnitTruth,
    twin: TwinModel,
    tables: dict[str, Flown],
    sortie: Sortie,
    *,
    rng: np.random.Generator,
) -> dict[str, Hour]:
    """One new power-on, flown with each table; a refused alignment gives NaN errors."""
    simulated = simulate_run(
        ideal(sortie.profile, sortie.lat_deg, sortie.heading_deg),
        thermal_history(sortie.start, rng=rng),
        unit,
        twin,
        rng=rng,
        plan=SessionPlan(run_id=f"hour-{sortie.profile}"),
    )
    return {name: fly_with(table, simulated, twin) for name, table in tables.items()}


def fly_with(table: Flown, simulated: SimulatedRun, twin: TwinModel) -> Hour:
    """Align on the first hour of a run, navigate over the second."""
    run, reference = simulated.run, simulated.reference
    assert run.temperature is not None
    temperature = gyro_temperature(run.temperature)
    imu = compensated_imu(run, table, temperature, twin)
    bins = make_bins(
        table.believed, temperature, twin, SessionSettings(), start_s=0.0, end_s=ALIGNMENT_S
    )
    sigma = np.sqrt(np.diag(bins.prior)[:3])
    aligned = gyrocompass.align(
        imu.between(0.0, ALIGNMENT_S), run.header.site, twin, bias_sigma_deg_h=sigma
    )
    if aligned.C_nb is None:
        return Hour(
            north_m=np.nan,
            east_m=np.nan,
            mean_m=np.nan,
            heading_mrad=np.nan,
            verdict=aligned.verdict,
        )
    start = NavState(
        time_s=aligned.time_s, site=run.header.site, v_n_m_s=np.zeros(3), C_nb=aligned.C_nb
    )
    vertical = VerticalChannel(mode="aided", time_s=reference.time_s, height_m=reference.height_m)
    history = navigate(
        imu.between(0.0, ALIGNMENT_S + HOUR_S), start, epoch_s=1.0, vertical=vertical
    )
    drift = drift_against(history, reference, np.zeros(3), aligned.time_s)
    assert drift is not None
    at = int(np.argmin(np.abs(reference.time_s - aligned.time_s)))
    error = np.angle(np.exp(1j * (aligned.heading_rad - reference.heading_rad[at])))
    north, east = (float(p) for p in drift.position_m[-1])
    return Hour(
        north_m=north,
        east_m=east,
        mean_m=float(drift.radial_m.mean()),
        heading_mrad=float(error / MILLIRADIAN),
        verdict=aligned.verdict,
    )
