"""What tells one unit from another of its type, as a session shows it: how its thermometers differ
as it is switched on, and the biases of its accelerometers.

Gyro biases cannot do that alone: the table of another unit agrees by chance at the temperatures of
one session in sixteen, and a session does not see the vertical gyro at all.

Thermometers of a unit that has stood for hours read the same temperature but for their own errors.
One that was switched on again while warm keeps a part of the pattern that it heats up by; how the
readings change in a session is kept as that pattern. The specific force at rest
less gravity is the bias of the accelerometer that points up; the level ones show where the vehicle
turns.

Decision: docs/decisions/0016-contradicting-sessions.md.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from alignment.motion.speeds import watched_seconds
from infield.session.estimate import SessionEstimate
from ins.earth import gravity_magnitude
from ins.estimation.states import ACCEL
from ins.records import AXES, Run, TemperatureLog, TwinModel
from ins.units import MICRO_G

# the first minute of a log: gyros warm by 0.2 degC in it after a cold start
# (trajectories.simulator.thermal)
POWER_ON_S = 60.0
# chosen: the last 5 min of the rest, as long as a bin of `recal update`
WARM_END_S = 300.0
LEAST_READINGS = 5  # of a thermometer in either window; chosen: one every 12 s
# of a thermometer against the others from one power-on to the next [degC]: 0.05 of repeatability
# (a thermistor drifts by 0.02 to 0.1 in a year), 0.1 of gain over 50 degC of different starts
REPEATS_degC = 0.1
# a log that begins so much after power-on, in which each thermometer follows at its own speed
LATE_START_min = 0.2
# the mean over all thermometers is the weather's [degC]
WEATHER_degC = 100.0
# of an accelerometer from one session to the next, beside the twin's turn-on [micro-g]: 20 of
# scale (a fifth of the 100 ppm of `infield.session.wrong_facts`), 15 of a height entered anew
SCALE_REPEATS_ug, ENTERED_HEIGHT_ug = 20.0, 15.0
# what compensation leaves of an accelerometer's temperature slope; as FlightPriors, over 50 degC
SLOPE_ug = 10.0
# a level accelerometer's bias is shown where its variance is below this share of its prior;
# chosen: it then measures to 1.7 times its turn-on or better
LEVEL_SHOWN = 0.75
FORCE = "force_ug"


@dataclass(frozen=True)
class UnitMarks:
    """What a session shows of its unit: names (k,) with the unit at their end, value (k,), and the
    covariance (k, k) of what does not repeat.

    heat (k,): by how much each thermometer changes against the others while the session lasts, 0
    of the other marks. lat_rad, lon_rad: where, since gravity has anomalies.
    """

    names: tuple[str, ...]
    value: NDArray
    covariance: NDArray
    heat: NDArray
    lat_rad: float
    lon_rad: float

    def of(self, names: tuple[str, ...]) -> "UnitMarks":
        """Those of some names alone."""
        at = [self.names.index(name) for name in names]
        P = self.covariance[np.ix_(at, at)]
        return replace(self, names=names, value=self.value[at], covariance=P, heat=self.heat[at])


def unit_marks(run: Run, twin: TwinModel, estimate: SessionEstimate) -> UnitMarks | None:
    """The marks of a session; None where it shows none (a unit that finds no heading)."""
    if estimate.solution is None or not np.isfinite(estimate.alignment.time_s):
        return None
    rest = float(estimate.solution.history.time_s[0]), estimate.alignment.time_s
    parts = [
        _thermometers(run.temperature, rest[1]),
        _force(run, twin, rest),
        _level(twin, estimate),
    ]
    found = [part for part in parts if part is not None]
    if not found:
        return None
    site = run.header.site
    return UnitMarks(
        names=tuple(name for part in found for name in part.names),
        value=np.concatenate([part.value for part in found]),
        covariance=np.asarray(block_diag(*(part.covariance for part in found))),
        heat=np.concatenate([part.heat for part in found]),
        lat_rad=site.lat_rad,
        lon_rad=site.lon_rad,
    )


class _Part(NamedTuple):
    """Marks of one kind; as in `UnitMarks`."""

    names: tuple[str, ...]
    value: NDArray
    covariance: NDArray
    heat: NDArray


def _thermometers(log: TemperatureLog | None, rest_end_s: float) -> _Part | None:
    """Readings of the gyros' and accelerometers' thermometers as the log begins."""
    if log is None:
        return None
    columns = [(f"gyro_{axis}_degC", log.gyro_degC[:, k]) for k, axis in enumerate(AXES)]
    if log.accel_degC is not None:
        columns += [(f"accel_{axis}_degC", log.accel_degC[:, k]) for k, axis in enumerate(AXES)]
    start = log.time_s <= log.time_s[0] + POWER_ON_S
    late = (log.time_s >= rest_end_s - WARM_END_S) & (log.time_s <= rest_end_s)
    read = [
        (name, _reading(values[start]), _reading(values[late]), np.ptp(values[start]))
        for name, values in columns
    ]
    known = [one for one in read if np.isfinite(one[1]) and np.isfinite(one[2])]
    if len(known) < len(("one", "another")):
        return None
    first, last, change = (np.array([one[k] for one in known]) for k in (1, 2, 3))
    pattern = (last - first) - (last - first).mean()
    repeats = np.hypot(REPEATS_degC, LATE_START_min * float(np.median(change)))
    n = len(known)
    P = repeats**2 * np.eye(n) + WEATHER_degC**2 * np.ones((n, n))
    return _Part(tuple(one[0] for one in known), first, P, pattern)


def _reading(values: NDArray) -> float:
    """The median of some readings, NaN where there are too few."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size >= LEAST_READINGS else float("nan")


def _force(run: Run, twin: TwinModel, rest: tuple[float, float]) -> _Part | None:
    """Specific force at rest less normal gravity [micro-g], nothing of the twin taken off."""
    seconds = watched_seconds(run).between(*rest)
    if not seconds.end_s.size:
        return None
    blocks, site = seconds.blocks(), run.header.site
    force = np.linalg.norm(blocks.dv_m_s / blocks.seconds[:, None], axis=1)
    gravity = float(gravity_magnitude(site.lat_rad, site.height_m))
    excess_ug = float(np.median(force) - gravity) / MICRO_G
    sigma_ug = float(
        np.linalg.norm([twin.accel.turn_on_ug, SCALE_REPEATS_ug, ENTERED_HEIGHT_ug, SLOPE_ug])
    )
    return _Part((FORCE,), np.array([excess_ug]), np.array([[sigma_ug**2]]), np.zeros(1))


def _level(twin: TwinModel, estimate: SessionEstimate) -> _Part | None:
    """Biases of the level accelerometers [micro-g] as the whole session tells them, the filter's
    prior taken out again.
    """
    solution = estimate.navigated
    prior_ug = max(twin.accel.turn_on_ug, 1.0)
    mean = (solution.filter.x[ACCEL] + solution.last.applied_accel_m_s2[:2]) / MICRO_G
    variance = np.diag(solution.filter.P)[ACCEL] / MICRO_G**2
    shown = np.flatnonzero(variance < LEVEL_SHOWN * prior_ug**2)
    if not shown.size:
        return None
    information = 1.0 / variance[shown] - prior_ug**-2.0
    measured = mean[shown] / variance[shown] / information + np.asarray(twin.accel.bias_ug)[shown]
    repeats = np.linalg.norm([twin.accel.turn_on_ug, SLOPE_ug]) ** 2
    names = tuple(f"accel_{AXES[k]}_ug" for k in shown)
    return _Part(names, measured, np.diag(1.0 / information + repeats), np.zeros(shown.size))
