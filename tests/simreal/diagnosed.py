"""Small diagnoses for the tests of documents and reports: short parked runs, a few effects, made
once.
"""

from functools import lru_cache

from benchmarks.gap_trials.trial import draw_trial
from infield.table.file import table_from_dict, table_sha256
from ins.errors.catalogue import catalogue
from simreal.inference.diagnosis import Diagnosis, DiagnosisSettings, diagnose

NAMES = (
    "gyro_thermal_rate",
    "gyro_thermal_lag",
    "gyro_warmup_transient",
    "gyro_turn_on_bias",
    "gyro_bias_step",
    "slow_variation",
)


@lru_cache(maxsize=8)
def trial(name="gyro_thermal_rate", size=8.0, seed=4, plan="four_parked", effects=1):
    names = [name] if name else None
    drawn = draw_trial(seed, plan=plan, effects=effects, names=names, parked_s=1800.0)
    return drawn.with_sizes([size] * effects)


@lru_cache(maxsize=8)
def diagnosed(
    name="gyro_thermal_rate", size=8.0, seed=4, plan="four_parked", effects=1, hold_out=()
) -> Diagnosis:
    made = trial(name, size, seed, plan, effects)
    return diagnose(
        made.runs,
        made.twin,
        table_from_dict(made.table, name="table"),
        DiagnosisSettings(
            effects=tuple(e for e in catalogue() if e.name in NAMES),
            replicates=100,
            hold_out=hold_out,
        ),
        table_sha256=table_sha256(made.table),
    )
