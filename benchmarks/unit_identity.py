"""Another unit under the same serial number, a raw log declared as compensated, and neither: how
often each is found, and what is committed.

Units are drawn whole: their own curves and ageing, biases of their accelerometers, errors of their
thermometers, own heat and lags. A third of the power-ons finds the unit still warm, some logs begin
late. The unit's history is that of sessions elsewhere; the table is the factory's, as it is before
anything was learnt (the hardest case for the biases).
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.recalibration_unit import OFFSET_DEG_H, SERIAL, SHAPE_DEG_H, TWINS, taxi
from benchmarks.study import Work, share, table
from infield.session.identity.marks import UnitMarks
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.results import UpdateResult
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.records import AXES, ImuLog, Run, TwinModel
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import STARTS, ThermalHistory, thermal_history
from trajectories.simulator.unit_truth import UnitTruth, aged_unit

# of a unit, 1 sigma: what calibration leaves of accelerometers (a navigation-grade one repeats its
# bias within some 100 micro-g over a year); thermometers of 0.5 degC limits
ACCEL_ug, THERMOMETER_degC, OWN_HEAT, OWN_LAG = 100.0, 0.3, 0.25, 0.1
REPEATS_degC, GAIN = 0.05, 1e-3  # of a thermometer: anew each power-on; of its reading
STILL_WARM = 1.0 / 3.0  # of power-ons
LATE_s = 120.0  # up to which logs begin after power-on
TOO_FAR_SIGMAS = 4.0
LATITUDES_DEG = (-45.0, 30.0, 45.0, 60.0)
HEADINGS_DEG = (0.0, 60.0, 135.0, 240.0)
HEAD = ("case", "found", "committed beyond 4 sigmas", "worst committed, sigmas", "doubted")
CASES = ("own log", "another unit", "raw, declared compensated", "compensated, declared so")


@dataclass(frozen=True)
class Made:
    """One unit as it was made: its gyros, its twin record, what its thermometers read above the
    truth (7,) (gyros, accelerometers, block) and times what, its own heat and lags over the usual
    ones (3,).
    """

    unit: UnitTruth
    table: ThermalTable
    twin: TwinModel
    thermometer_degC: NDArray
    gain: NDArray
    heat: NDArray
    lag: NDArray


def made(rng: np.random.Generator) -> Made:
    """A unit."""
    unit = aged_unit(
        rng, ageing_offset_deg_h=OFFSET_DEG_H, ageing_shape_deg_h=SHAPE_DEG_H, imu_serial=SERIAL
    )
    x, y, z = (ACCEL_ug * rng.standard_normal(3)).tolist()
    usual = TWINS["default"]
    return Made(
        unit=unit,
        table=table_from_dict(unit.factory_table(), name="factory"),
        twin=replace(usual, accel=replace(usual.accel, bias_ug=(x, y, z))),
        thermometer_degC=THERMOMETER_degC * rng.standard_normal(7),
        gain=1.0 + GAIN * rng.standard_normal(7),
        heat=1.0 + OWN_HEAT * rng.standard_normal(3),
        lag=1.0 + OWN_LAG * rng.standard_normal(3),
    )


def session(made: Made, seed: list[int]) -> tuple[Run, NDArray]:
    """A log of a unit as it stands, and the true temperatures (n, 3) of its gyros each second."""
    rng = np.random.default_rng(seed)
    thermal = _thermal(made, rng)
    lat, heading = rng.choice(LATITUDES_DEG), rng.choice(HEADINGS_DEG)
    simulated = simulate_run(
        taxi(float(lat), float(heading)),
        thermal,
        made.unit,
        made.twin,
        rng=rng,
        plan=SessionPlan(run_id="-".join(str(s) for s in seed)),
    )
    return _read_by(made, simulated.run, rng), simulated.temperature_true_degC


def _thermal(made: Made, rng: np.random.Generator) -> ThermalHistory:
    """A power-on."""
    thermal = thermal_history(str(rng.choice(list(STARTS))), rng=rng)
    rise = tuple((np.array(thermal.gyro_rise_degC) * made.heat).tolist())
    tau = tuple((np.array(thermal.gyro_tau_s) * made.lag).tolist())
    return replace(thermal, gyro_rise_degC=rise, gyro_tau_s=tau)


def _read_by(made: Made, run: Run, rng: np.random.Generator) -> Run:
    """The log as this unit's thermometers read it. A unit that is still warm keeps a part of its
    own heat, which each gyro loses to the block with its lag; a late log lacks its beginning.
    """
    log, gain = run.temperature, made.gain
    own = made.thermometer_degC + REPEATS_degC * rng.standard_normal(7)
    assert log is not None and log.accel_degC is not None and log.block_degC is not None
    t = log.time_s
    gyro = log.gyro_degC * gain[:3] + own[:3]
    if rng.uniform() < STILL_WARM:
        left = rng.uniform(0.2, 1.0) * np.array([1.5, 2.5, 0.8]) * made.heat
        gyro = gyro + left * np.exp(-t[:, None] / (400.0 * made.lag))
    after = t >= (rng.uniform(0.0, LATE_s) if rng.uniform() < 0.5 else 0.0)
    read = replace(
        log,
        time_s=t[after],
        gyro_degC=gyro[after],
        accel_degC=(log.accel_degC * gain[3:6] + own[3:6])[after],
        block_degC=(log.block_degC * gain[6] + own[6])[after],
        gradient_degC=None if log.gradient_degC is None else log.gradient_degC[after],
        ambient_degC=None if log.ambient_degC is None else log.ambient_degC[after],
    )
    return replace(run, temperature=read)


def trial(case: str, seed: int, sessions: int) -> dict:
    """One log against a unit with some sessions of history."""
    unit, other = (made(np.random.default_rng([seed, 71, k])) for k in (0, 1))
    history = UnitHistory(marks=_history(seed, sessions), applied_table=lambda sha256: unit.table)
    told = other if case == "another unit" else unit
    run, T = session(told, [seed, 72, 9])
    if case in CASES[2:]:
        run = replace(run, header=replace(run.header, applied_table_sha256="0" * 64))
    if case == CASES[3]:
        run = _compensated(run, unit.table, T)
    result = update_calibration([run], unit.table, unit.twin, history=history)
    return {
        "case": case,
        "seed": seed,
        "outcome": str(result.outcome),
        "codes": sorted({str(r.code) for r in result.sessions[0].verdict.reasons}),
        "doubted": [str(s.fact) for s in result.sessions[0].doubted],
        "worst_sigmas": _worst(result, unit.unit, told.unit, T),
        "sigma_deg_h": _sigma(result, T),
        **_marks(result),
    }


@lru_cache(maxsize=2)
def _history(seed: int, sessions: int) -> tuple[UnitMarks, ...]:
    """What earlier sessions of the unit of a seed showed."""
    unit = made(np.random.default_rng([seed, 71, 0]))
    runs = [session(unit, [seed, 72, k])[0] for k in range(sessions)]
    found = [update_calibration([run], unit.table, unit.twin).sessions[0].marks for run in runs]
    return tuple(marks for marks in found if marks is not None)


def _compensated(run: Run, table: ThermalTable, T: NDArray) -> Run:
    """The log less the table, as a unit subtracts it at its thermometers' readings."""
    imu, log = run.imu, run.temperature
    assert isinstance(imu, ImuLog) and log is not None
    read = np.stack([np.interp(imu.time_s, log.time_s, column) for column in log.gyro_degC.T], 1)
    nodes = [table.bias_deg_h(k, read[:, k]) for k in range(3)]
    bias = np.deg2rad(np.stack(nodes, axis=1)) / 3600.0
    return replace(run, imu=replace(imu, dtheta_rad=imu.dtheta_rad - bias * imu.dt_s[:, None]))


def _worst(result: UpdateResult, unit: UnitTruth, told: UnitTruth, T: NDArray) -> float:
    """Largest error over sigma of the table after, of any gyro at the temperatures visited, against
    the unit that it is nearer to.
    """
    at = T[::60]
    errors = [
        max(
            float(
                np.max(
                    np.abs(result.after.bias_deg_h(k, at[:, k]) - truth.bias_deg_h(axis, at[:, k]))
                    / result.after.sigma_deg_h(k, at[:, k])
                )
            )
            for k, axis in enumerate(AXES)
        )
        for truth in (unit, told)
    ]
    return min(errors)


def _sigma(result: UpdateResult, T: NDArray) -> float:
    return float(np.mean([result.after.sigma_deg_h(k, T[::60, k]) for k in (0, 1)]))


def _marks(result: UpdateResult) -> dict:
    session = result.sessions[0]
    merged = session.merged
    likeness = session.likeness
    return {
        "axis_z": None if merged is None else merged.axis_z.tolist(),
        "chi2": None if likeness is None else likeness.chi2,
        "dof": None if likeness is None else likeness.dof,
        "names": None if session.marks is None else list(session.marks.names),
    }


def row(case: str, of: list[dict]) -> list[object]:
    """Of a case: logs found, committed wrong, the worst that was committed, doubted."""
    taken = [r for r in of if r["outcome"] == "accepted"]
    worst = [r["worst_sigmas"] for r in taken]
    return [
        case,
        share(len(of) - len(taken), len(of)),
        sum(w > TOO_FAR_SIGMAS for w in worst),
        f"{max(worst):.1f}" if worst else "-",
        sum("compensation" in r["doubted"] for r in taken),
    ]


def run(work: Work, *, units: int = 100, first: int = 0, history: int = 2) -> str:
    """history: earlier sessions of each unit."""
    seeds = range(first, first + units)
    records = work.each(trial, [(case, seed, history) for seed in seeds for case in CASES])
    by_case = {case: [r for r in records if r["case"] == case] for case in CASES}
    return table(HEAD, [row(case, of) for case, of in by_case.items() if of])
