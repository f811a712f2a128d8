"""An effect of one's own for `recal diagnose`: a gyro that feels the taxi speed (say, a fan driven
by the air stream).

Three things: parameters with units and usual sizes, what the runs must hold, the trace of one unit
of each coefficient. To have it in every diagnosis, a package declares it in its pyproject.toml::

    [project.entry-points."recal.errors"]
    fan = "my_package.fan:FAN"

Run this file to see it found: `python examples/own_effect.py`. magnetic_axis.py is another one, a
declaration with words, that is simulated, found, planned for and taken out of an update.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ins.units import DEG_PER_HOUR
from simreal.effects.own import GYROS, Coefficient, ErrorSource, Shape, Telemetry, Trace, on_axis


@dataclass(frozen=True)
class Fan(ErrorSource):
    """Bias proportional to the speed: 1 deg/h at 1 m/s for each unit of its coefficient."""

    def needs(self, runs: Sequence[Telemetry], target: str) -> str:
        return "" if any(np.ptp(run.speed_m_s) > 1.0 for run in runs) else "a taxi"

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        return (Trace(gyro_rad_s=on_axis(DEG_PER_HOUR * run.speed_m_s, GYROS.index(target))),)


FAN = Fan(
    id="gyro_fan",
    name="gyro_fan",
    targets=GYROS,
    coefficients=(Coefficient("coefficient", "deg/h per m/s", 0.01, 1.0),),
    rivals=("gyro_scale_factor",),
    source="an example",
)


def trace_at(speed_m_s: float) -> float:
    """What one unit of the effect adds to gyro x at a steady speed [deg/h]."""
    n = 10
    run = Telemetry(
        run_index=0,
        time_s=np.arange(n) + 0.5,
        dt_s=1.0,
        rate_rad_s=np.zeros((n, 3)),
        force_m_s2=np.zeros((n, 3)),
        C_nb=np.broadcast_to(np.eye(3), (n, 3, 3)),
        v_n_m_s=np.zeros((n, 3)),
        speed_m_s=np.full(n, speed_m_s),
        turn_rad_s=np.zeros(n),
        kind=np.ones(n, int),
        lat_rad=0.8,
        height_m=0.0,
    )
    gyro = FAN.traces(run, "gyro_x", {})[0].gyro_rad_s
    assert gyro is not None
    return float(gyro[0, 0] / DEG_PER_HOUR)


if __name__ == "__main__":
    print(
        f"{FAN.name}: {trace_at(8.0):g} deg/h on gyro_x at 8 m/s for 1 {FAN.coefficients[0].unit}"
    )
