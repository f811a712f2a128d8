"""Does the noise that a twin declares fit what a run shows at rest, channel by channel and band by
band?

Read from the seconds of a log, no row again: the scatter within a second, the spectrum of the means
of seconds, and slow means with their whole covariance. A size within TOLERATED of the declared one
fits: nothing that is estimated with the twin would be noticeably wrong. The sway of the vehicle is
another one on another day, so bands that it fills are named apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.stats import gamma as gamma_law

from ins.noise import accel_densities, gyro_densities
from ins.records import TwinModel
from ins.units import ARCSEC, HOUR
from simreal.evidence.noise_model import channel_noises
from simreal.twin.fit.model import ABSENT, Model, band_model
from simreal.twin.fit.result import SIX_CHANNELS
from simreal.twin.fit.slow import SlowData, slow_data
from simreal.twin.fit.spectra import Bands, mean_spectra
from simreal.twin.fit.streams import Stream
from simreal.twin.fit.terms import Shape, Term

TOLERATED = 0.1  # of a size: a sigma that is off by less is 20 % of a variance off
# of a whole run, over all its cells: one run in 100 of a right twin is called wrong
MISFIT_P = 0.01
BLOCK_S = 60  # of the slow means
CELL_EDGES_HZ = (0.025, 0.06, 0.15, 0.41)  # of the cells between slow means and rows
# of a cell's declared power that is sway: above 0.5 the cell says more of the vehicle
VEHICLES = 0.5


class Of(StrEnum):
    """Whose noise a cell shows."""

    SENSOR = "sensor"
    VEHICLE = "vehicle"


@dataclass(frozen=True)
class Cell:
    """One band of one channel: power over the declared one, degrees of freedom, and the probability
    of a power this far off or farther if the size were within TOLERATED of the declared one.
    """

    channel: str
    low_hz: float
    high_hz: float
    ratio: float
    dof: float
    p_value: float
    of: Of


@dataclass(frozen=True)
class Agreement:
    """All cells; p_value: of the worst cell of a sensor, times their number."""

    cells: tuple[Cell, ...]
    p_value: float
    parked_s: float

    @property
    def fits(self) -> bool:
        return self.p_value >= MISFIT_P

    @property
    def misfits(self) -> tuple[Cell, ...]:
        """Sensors' cells that the twin does not explain, the worst first."""
        own = [c for c in self.cells if c.of is Of.SENSOR]
        bad = [c for c in own if c.p_value * len(own) < MISFIT_P]
        return tuple(sorted(bad, key=lambda c: (c.p_value, -abs(np.log(max(c.ratio, 1e-12))))))

    @property
    def vehicle_misfits(self) -> tuple[Cell, ...]:
        """The same of the vehicle's."""
        own = [c for c in self.cells if c.of is Of.VEHICLE]
        return tuple(c for c in own if c.p_value * len(own) < MISFIT_P)


def agreement(streams: Sequence[Stream], twin: TwinModel) -> Agreement | None:
    """The noise of the runs against a twin; None where no stream holds enough to say."""
    cells: dict[tuple[str, float, float], list[tuple[float, float, float]]] = {}
    for stream in streams:
        for key, power, dof, sway in _cells(stream, twin):
            cells.setdefault(key, []).append((power, dof, sway))
    found = [_joined(key, parts) for key, parts in cells.items()]
    own = [c for c in found if c.of is Of.SENSOR]
    if not own:
        return None
    worst = min(c.p_value for c in own) * len(own)
    return Agreement(tuple(found), float(min(worst, 1.0)), sum(s.still_s for s in streams))


def _joined(key: tuple[str, float, float], parts: list[tuple[float, float, float]]) -> Cell:
    """One cell of all runs."""
    power, dof, sway = (np.array(column) for column in zip(*parts))
    total = float(dof.sum())
    ratio = float(power @ dof / total)
    of = Of.VEHICLE if float(sway @ dof / total) > VEHICLES else Of.SENSOR
    return Cell(*key, ratio=ratio, dof=total, p_value=_p_value(ratio, total), of=of)


def _p_value(ratio: float, dof: float) -> float:
    """Two-sided probability of a ratio, gamma with dof, at the nearer edge of what is tolerated."""
    above, below = (1.0 + TOLERATED) ** 2, (1.0 - TOLERATED) ** 2
    high = float(gamma_law.sf(ratio / above * dof, dof))
    low = float(gamma_law.cdf(ratio / below * dof, dof))
    return min(2.0 * min(high, low), 1.0)


Part = tuple[tuple[str, float, float], float, float, float]


def _cells(stream: Stream, twin: TwinModel) -> list[Part]:
    """Key, power over the declared, degrees of freedom and the sway's share of every cell."""
    share = np.tile(1.0 - stream.up_b**2, 2)
    models = {0: declared_model(twin, gyro=True), 3: declared_model(twin, gyro=False)}
    live = [c for c in range(6) if not stream.seconds.dead[c]]
    found = _within_seconds(stream, twin, live)
    for bands in mean_spectra(stream).bands:
        if bands.channel in live:
            found += _between(bands, models[3 * (bands.channel // 3)], share)
    for slow in slow_data(stream, BLOCK_S):
        if slow.channel in live:
            found.append(_slow(slow, models[3 * (slow.channel // 3)], share))
    return found


def declared_model(twin: TwinModel, *, gyro: bool) -> Model:
    """What a twin declares of a triad, as the fit's model at its own values."""
    v = twin.vehicle
    d = gyro_densities(twin.gyro) if gyro else accel_densities(twin.accel)
    sizes = {Term.WHITE: d.white**2, Term.FLICKER: d.instability**2, Term.WALK: d.walk**2}
    if gyro:
        sizes[Term.QUANTIZATION] = twin.gyro.quantization_rad**2 / 12.0
        sizes[Term.CREEP] = (v.yaw_creep_arcsec_sqrt_h * ARCSEC) ** 2 / HOUR
    else:
        sizes[Term.SWAY] = v.sway_m_s**2
    logs = np.array([np.log(size) if size > 0 else ABSENT - 1.0 for size in sizes.values()])
    shape = Shape(sway_w=2.0 * np.pi * max(v.sway_hz, 1e-3), sway_zeta=max(v.sway_damping, 1e-3))
    return Model(tuple(sizes), logs, shape, np.ones(logs.size))


def _within_seconds(stream: Stream, twin: TwinModel, live: Sequence[int]) -> list[Part]:
    """The scatter of rows about the mean of their second: everything above 1 Hz."""
    seconds = stream.seconds
    rate_hz = stream.run.imu.rate_hz
    if rate_hz < 2.0:
        return []
    level = _level_axes(stream.up_b)
    rows = int(np.median(seconds.rows[stream.still]))
    found: list[Part] = []
    for c, noise in enumerate(channel_noises(twin, stream.run_s, level)):
        if c not in live:
            continue
        expected, freedom = noise.scatter(rows, seconds.row_dt_s)
        scatter = seconds.scatter[stream.still, c]
        limit = WILD_SECONDS * float(np.median(scatter))
        seen = scatter[scatter <= limit]
        if expected <= 0 or not seen.size:
            continue
        only = noise.scatter(rows, seconds.row_dt_s)[0]
        calm = type(noise)(white=noise.white, bounded=noise.bounded)
        sway = 1.0 - calm.scatter(rows, seconds.row_dt_s)[0] / only
        key = (SIX_CHANNELS[c], 1.0, 0.5 * rate_hz)
        found.append((key, float(seen.mean()) / expected, 0.5 * freedom * seen.size, sway))
    return found


# times the median scatter: 100 rows of noise scatter by 1.6 times at 4 sigmas, 10 rows by 3
WILD_SECONDS = 4.0


def _level_axes(up_b: NDArray) -> NDArray:
    """An attitude (3, 3) whose vertical is up_b; its heading does not matter."""
    across = np.linalg.svd(up_b[None, :])[2][1:]
    return np.vstack([across, -up_b])


def _between(bands: Bands, model: Model, share: NDArray) -> list[Part]:
    """Cells of the spectrum of seconds."""
    S, parts = band_model(model, model.start, (), bands, share)
    sway = parts[model.terms.index(Term.SWAY)] / S if Term.SWAY in model.terms else 0.0 * S
    f = bands.centre_hz
    found: list[Part] = []
    for low, high in pairwise(CELL_EDGES_HZ):
        inside = (f >= low) & (f < high) & (bands.dof > 0)
        if inside.any():
            dof = bands.dof[inside]
            ratio = float(np.sum(dof * bands.power[inside] / S[inside]) / dof.sum())
            key = (SIX_CHANNELS[bands.channel], low, high)
            part = float(dof @ sway[inside] / dof.sum())
            found.append((key, ratio, float(dof.sum()), part))
    return found


def _slow(slow: SlowData, model: Model, share: NDArray) -> Part:
    """The cell of the slow means: their mean squared whitened contrast."""
    w, x = slow.whole, model.start
    V, v = np.zeros((w, w)), np.zeros(slow.y.size - w)
    sway = 0.0
    for j, term in enumerate(model.terms):
        factor = model.factor(term, slow.channel, share)
        if factor and x[j] > ABSENT:
            unit = slow.covariance(*slow.kind(term, model.shape))
            V += factor * np.exp(x[j]) * unit.slow
            v += factor * np.exp(x[j]) * unit.quick
            if term is Term.SWAY:
                sway = factor * float(np.exp(x[j]) * np.trace(unit.slow))
    z = solve_triangular(np.linalg.cholesky(V), slow.y[:w], lower=True)
    square = float(z @ z + np.sum(slow.y[w:] ** 2 / v))
    key = (SIX_CHANNELS[slow.channel], 0.0, 0.5 / BLOCK_S)
    return key, square / slow.y.size, 0.5 * slow.y.size, sway / float(np.trace(V))
