"""What the tests of the blind trials share: planting one effect, and what is left of a parked
run.
"""

from benchmarks.gap_trials.trial import Base, Planted, lay_over
from ins.units import DEG_PER_HOUR, MICRO_G

SHORT_S = 300.0
SOURCES = ("trajectories", "pyins")


def planted(name, target, size=1.0, **parameters):
    return Planted(
        effect=name,
        target=target,
        parameters=parameters,
        size=size,
        answers=(name,),
        targets=(target,),
    )


def change(trial, number, *effects):
    """Run `number` with effects less without: gyro [deg/h], accel [micro-g] (n, 3), and the run."""
    seen, plain = trial.seen[number], trial.runs_without[number]
    run = lay_over(Base(plain, seen), effects)
    gyro = (run.imu.dtheta_rad - plain.imu.dtheta_rad) / seen.dt_s / DEG_PER_HOUR
    accel = (run.imu.dv_m_s - plain.imu.dv_m_s) / seen.dt_s / MICRO_G
    return gyro, accel, run
