"""Seeded four-azimuth runs of units whose misalignment nobody knows: normalised errors of what
`study_runs` finds.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from infield.misalignment.azimuth_biases import KnownAzimuths
from infield.misalignment.study import study_runs
from infield.table.file import table_from_dict
from ins.records import Site
from ins.twin_file import default_twin
from ins.units import ARCSEC, DEG
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Pivot
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

SITE = Site(lat_rad=39.9 * DEG, lon_rad=116.4 * DEG, height_m=50.0)
TWIN = default_twin("fog")
START_DEG, STOP_S = 45.0, 2400.0
TRUE_SIGMA_MRAD = 0.3
SIGMA_STOP, SIGMA_NORTH = 5.0 * ARCSEC, 30.0 * ARCSEC
TURN = (Pivot(angle_deg=90.0), Park(duration_s=STOP_S))
ONE = (Park(duration_s=STOP_S), *TURN, *TURN, *TURN)


@dataclass(frozen=True)
class Found:
    """One seed: error over sigma and sigma [mrad] of each coupling seen, and the redundancy."""

    z: dict[str, float]
    sigma_mrad: dict[str, float]
    chi2: float
    dof: int


@lru_cache(maxsize=5)
def _ideal(segments, heading_deg):
    truth = build_truth(
        lay(segments), SITE, heading_rad=heading_deg * DEG, roll_rad=3e-3, pitch_rad=-2e-3
    )
    return ideal_sensors(truth, 10.0)


def study(seed: int, *, power_ons: int, given: bool) -> Found:
    """One unit with couplings of 0.3 mrad (1 sigma): one power-on with four stops, or four;
    azimuths given or found.
    """
    rng = np.random.default_rng([seed, 2021, power_ons])
    mrad = TRUE_SIGMA_MRAD * rng.standard_normal(6)
    truth = replace(TWIN, gyro=replace(TWIN.gyro, misalignment_mrad=tuple(mrad)))
    unit = aged_unit(rng, gyro_technology="fog")
    table = table_from_dict(unit.factory_table(np.arange(-20.0, 61.0, 5.0)), name="factory")
    headings = START_DEG + 90.0 * np.arange(4)
    plans = (
        [(ONE, START_DEG)]
        if power_ons == 1
        else [((Park(duration_s=STOP_S),), h) for h in headings]
    )
    runs = [
        simulate_run(
            _ideal(*plan),
            thermal_history("ambient"),
            unit,
            truth,
            rng=rng,
            plan=SessionPlan(with_phases=False, run_id=f"run-{k}"),
        ).run
        for k, plan in enumerate(plans)
    ]
    error = SIGMA_STOP * rng.standard_normal(4) + SIGMA_NORTH * rng.standard_normal()
    known = KnownAzimuths(
        heading_rad=headings * DEG + error, sigma_stop_rad=SIGMA_STOP, sigma_north_rad=SIGMA_NORTH
    )
    result = study_runs(runs, table, TWIN, known=known if given else None).result
    true = dict(zip(("xy", "xz", "yx", "yz", "zx", "zy"), mrad)) | {"xy+yx": mrad[0] + mrad[2]}
    seen = [c for c in result.couplings if c.verdict != "not_observable"]
    assert result.fit is not None
    return Found(
        {c.entry: (c.value_rad * 1e3 - true[c.entry]) / (c.sigma_rad * 1e3) for c in seen},
        {c.entry: c.sigma_rad * 1e3 for c in seen},
        result.fit.chi2,
        result.fit.dof,
    )
