"""Simulated fleets at the level of session points, by a generator of its own: no covariance of the
estimator is called.

A unit's curve over temperature is a level and a sum of random cosines; both wander from session to
session. A session draws turn-on, a flicker made of sinusoids evenly spaced in log f, a random walk
in steps of 20 s, white noise, a heading error that is common to the level gyros, and an airframe
that creeps in yaw; now and then all of it is shifted.
"""

from dataclasses import dataclass, field

import numpy as np

from infield.learning.parameters import PriorName, defaults_of
from infield.learning.stored_sessions import StoredSession, StoredUnit
from infield.table.thermal_table import ThermalTable

NODES = np.arange(-10.0, 51.0, 10.0)
FACTORY_SIGMA = 0.004  # deg/h
ARW = 0.002  # deg/sqrt(h)
COSINES = 80
SINUSOIDS = 60
BINS, BIN_S, STEP_S = 6, 700.0, 20.0
STARTS = (-10.0, 10.0, 28.0)  # degC, of which a session takes one
WARMS_BY = 22.0
DECLARED_CREEP = 3.0  # arcsec/sqrt(h), what every session's covariance was made with
HEADING_SIGMA = 0.003  # deg/h of east bias that a heading error common to the session makes
OUTLIER = 0.05  # deg/h
FACTOR_3 = float(np.log(3.0))


@dataclass
class TrueUnit:
    """One simulated unit: the true values of its parameters, its curve, and where it was seen."""

    value: dict
    rng: np.random.Generator
    level: np.ndarray = field(init=False)
    waves: list = field(init=False)

    def __post_init__(self):
        self.level = FACTORY_SIGMA * np.sqrt(0.7) * self.rng.standard_normal(3)
        self.waves = [[wave(self.rng, FACTORY_SIGMA * np.sqrt(0.3), 30.0)] for _ in range(3)]

    def age(self, years):
        root = np.sqrt(max(years, 0.0))
        self.level += self.value[PriorName.AGEING_COMMON] * root * self.rng.standard_normal(3)
        size = self.value[PriorName.AGEING_SHAPE] * root
        for k in range(3):
            self.waves[k].append(wave(self.rng, size, self.value[PriorName.LENGTH]))

    def bias(self, axis, T):
        return self.level[axis] + sum(w(np.asarray(T)) for w in self.waves[axis])


def wave(rng, size, length):
    """A random smooth curve of this RMS: cosines whose frequencies are normal with 1 / length."""
    frequency = rng.standard_normal(COSINES) / length
    phase = rng.uniform(0.0, 2.0 * np.pi, COSINES)
    amplitude = size * np.sqrt(2.0 / COSINES)
    return lambda T: amplitude * np.cos(np.multiply.outer(T, frequency) + phase).sum(axis=-1)


def flicker(rng, steps, B):
    """Two-sided spectrum B^2 / (2 pi f) from a quarter of the run's inverse length to the Nyquist
    frequency of the steps: sinusoids of random phase and normal size, evenly spaced in log f, each
    with the variance B^2 d(ln f) / pi of its band.
    """
    lowest = 0.25 / (steps * STEP_S)
    apart = np.log(0.5 / STEP_S / lowest) / SINUSOIDS
    frequency = lowest * np.exp(apart * (np.arange(SINUSOIDS) + rng.uniform()))
    phase = 2.0 * np.pi * np.outer(np.arange(steps) * STEP_S, frequency)
    size = B * np.sqrt(apart / np.pi)
    both = rng.standard_normal((2, SINUSOIDS))
    return size * (np.cos(phase) @ both[0] + np.sin(phase) @ both[1])


def session(unit, year, name):
    """A session of a unit as it is, and whether it is an outlier."""
    rng, value = unit.rng, unit.value
    steps = int(BINS * BIN_S / STEP_S)
    T0, warm = rng.choice(STARTS), WARMS_BY * rng.uniform(0.8, 1.2)
    time = (np.arange(BINS) + 0.5) * BIN_S
    T = T0 + warm * (1.0 - np.exp(-time / 1800.0))
    outlier = rng.random() < value[PriorName.OUTLIER_SHARE]
    bias = np.zeros((3, BINS))
    for axis in range(3):
        walk = np.cumsum(rng.standard_normal(steps)) * np.sqrt(STEP_S / 3600.0)
        slow = value[PriorName.RANDOM_WALK] * walk + flicker(rng, steps, value[PriorName.FLICKER])
        bias[axis] = unit.bias(axis, T) + slow.reshape(BINS, -1).mean(axis=1)
        bias[axis] += value[PriorName.TURN_ON] * rng.standard_normal()
        bias[axis] += ARW / np.sqrt(BIN_S / 3600.0) * rng.standard_normal(BINS)
        bias[axis] += outlier * OUTLIER * rng.standard_normal()
    turned = value[PriorName.YAW_CREEP] / 3600.0 * rng.standard_normal(BINS)
    bias[2] += turned / np.sqrt(BIN_S / 3600.0)
    heading = rng.uniform(0.0, 2.0 * np.pi)
    east = np.array([np.sin(heading), np.cos(heading), 0.0])
    bias += HEADING_SIGMA * rng.standard_normal() * east[:, None]
    R = np.kron(np.outer(east, east), np.full((BINS, BINS), HEADING_SIGMA**2))
    white = np.full(3, ARW**2) + [0.0, 0.0, (DECLARED_CREEP / 3600.0) ** 2]
    R += np.kron(np.diag(white * 3600.0 / BIN_S), np.eye(BINS))
    seen = StoredSession(
        run_id=name,
        run_sha256=name,
        year=year,
        axis_index=np.repeat(np.arange(3), BINS),
        temperature_degC=np.tile(T, 3),
        time_s=np.tile(time, 3),
        duration_s=np.full(3 * BINS, BIN_S),
        bias_deg_h=bias.ravel(),
        covariance=R,
        run_length_s=BINS * BIN_S,
        yaw_creep_arcsec_sqrt_h=DECLARED_CREEP,
        heading_source="stops",
    )
    return seen, outlier


def factory_table(serial):
    """What the factory believes: zero, with the covariance of formats.md, written out here."""
    apart = NODES[:, None] - NODES[None, :]
    block = FACTORY_SIGMA**2 * (0.7 + 0.3 * np.exp(-(apart**2) / (2.0 * 30.0**2)))
    return ThermalTable(
        imu_serial=serial,
        gyro_technology="rlg",
        created_utc="2023-01-01T00:00:00Z",
        temperature_degC=(NODES, NODES, NODES),
        parameters=np.zeros(3 * NODES.size),
        covariance=np.kron(np.eye(3), block),
    )


@dataclass
class MadeUnit:
    """A unit as a store would keep it, its truth, and which of its sessions are outliers."""

    kept: StoredUnit
    true: TrueUnit
    outliers: list


def made_unit(rng, value, sessions, years, serial):
    """A unit with sessions at random times."""
    true, table = TrueUnit(value, rng), factory_table(serial)
    times = np.sort(rng.uniform(0.0, years, sessions))
    seen, outliers, before = [], [], 0.0
    for k, year in enumerate(times):
        true.age(year - before)
        found, outlier = session(true, year, f"{serial}-{k}")
        seen.append(found)
        outliers.append(outlier)
        before = year
    kept = StoredUnit(
        imu_serial=serial,
        gyro_technology="rlg",
        gyro_mode="",
        table=table,
        year=0.0,
        sessions=tuple(seen),
    )
    return MadeUnit(kept, true, outliers)


def true_values(rng, width):
    """Defaults of ring lasers off by random factors, of this width (logarithm) where the default is
    known to a factor 3.
    """
    value = defaults_of("rlg")
    for name in value:
        spread = 0.5 * width / np.log(3.0) if name is PriorName.LENGTH else width
        value[name] *= np.exp(spread * rng.standard_normal())
    value[PriorName.OUTLIER_SHARE] = min(value[PriorName.OUTLIER_SHARE], 0.2)
    return value


def made_fleet(seed, *, units=30, sessions=8, years=3.0, width=FACTOR_3, spread=0.0):
    """A fleet, and the true values of its technology."""
    rng = np.random.default_rng([seed, 20261122])
    value = true_values(rng, width)
    fleet = []
    for u in range(units):
        own = {n: v * np.exp(spread * rng.standard_normal()) for n, v in value.items()}
        fleet.append(made_unit(rng, own, sessions, years, f"SN-{u:03d}"))
    return fleet, value
