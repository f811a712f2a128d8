"""Seeded parked and rolling runs at 10 Hz for the alignment tests, each base made once."""

from functools import lru_cache

import numpy as np

from alignment import coarse
from ins.records import NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG
from tests.scenarios.study import DEFAULT_TWIN, table_to_zero
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

PRIOR_DEG_H = 0.01
OFFSET, SHAPE = PRIOR_DEG_H * np.sqrt(0.7), PRIOR_DEG_H * np.sqrt(0.3)


TEN_MINUTES = (Park(duration_s=600.0),)


@lru_cache(maxsize=16)
def ideal_of(segments=TEN_MINUTES, lat_deg=45.0, heading_deg=17.0):
    site = Site(lat_rad=lat_deg * DEG, lon_rad=7 * DEG, height_m=250.0)
    return ideal_sensors(build_truth(lay(segments), site, heading_rad=heading_deg * DEG), 10.0)


def simulate(ideal, seed, *, twin=DEFAULT_TWIN, size=1.0, **options):
    """One seeded run, its bias drawn with `size` times PRIOR_DEG_H about the table."""
    rng = np.random.default_rng([seed, 20260302])
    unit = aged_unit(
        rng,
        ageing_offset_deg_h=size * OFFSET,
        ageing_shape_deg_h=size * SHAPE,
        table=table_to_zero(),
        gyro_technology=twin.gyro_technology,
    )
    return simulate_run(
        ideal, thermal_history("ambient"), unit, twin, rng=rng, plan=SessionPlan(**options)
    )


def parked_history(run, rest_s=300.0):
    """The solution, one epoch a second, from a coarse attitude over the first `rest_s`."""
    C_nb = coarse.gyrocompass_dcm(coarse.rest_means(run.imu.between(0.0, rest_s)))
    start = NavState(time_s=0.0, site=run.header.site, v_n_m_s=np.zeros(3), C_nb=C_nb)
    return navigate(run.imu, start, epoch_s=1.0, vertical=VerticalChannel(mode="hold"))


def attitude_error(result, simulated):
    """Roll, pitch, heading [rad] of an alignment less the truth at its time."""
    ref = simulated.reference
    k = int(np.argmin(np.abs(ref.time_s - result.time_s)))
    found = np.array([result.roll_rad, result.pitch_rad, result.heading_rad])
    return np.angle(np.exp(1j * (found - [ref.roll_rad[k], ref.pitch_rad[k], ref.heading_rad[k]])))
