"""Does the noise that a twin declares fit what a run shows at rest, channel by channel and band by
band?

Read from the seconds of a log and from a few minutes of its rows. A size within TOLERATED of the
declared one fits: nothing that is estimated with the twin would be noticeably wrong.

People and wind move a parked vehicle and all its sensors: by thousands of times the noise of a ring
laser where its gear swings, by nothing above GEAR_BELOW_HZ. So the unit is judged there; below, for
less noise than declared (no vehicle takes noise away), and for more only in a run whose channels
show no more swinging than their own quietest bands let one expect.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from ins.noise import accel_densities, gyro_densities
from ins.records import TwinModel
from ins.robust import gamma as gamma_law
from ins.units import ARCSEC, HOUR, STANDARD_GRAVITY
from simreal.evidence.noise_model import SIX_CHANNELS, axis_variances
from simreal.twin.fit.evidence import without_comb
from simreal.twin.fit.gear import GEAR_BELOW_HZ, MOVES_P, SWINGS_BELOW_HZ
from simreal.twin.fit.model import ABSENT, TriadModel, band_model
from simreal.twin.fit.rounding import roundings
from simreal.twin.fit.slow import SlowData, slow_data
from simreal.twin.fit.spectra import UPRIGHT, Bands, below_hz, few_spectra
from simreal.twin.fit.streams import ParkedStream
from simreal.twin.fit.terms import NoiseTerm, Shape

TOLERATED = 0.1  # of a size: a sigma that is off by less is 20 % of a variance off
# of a whole run, over all its cells: one run in 100 of a right twin is called wrong
MISFIT_P = 0.01
BLOCK_S = 60  # of the slow means
CELL_EDGES_HZ = (0.025, 0.06, 0.15, 0.41)  # of the cells between slow means and rows
ROW_EDGES_HZ = (0.4, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 1e4)  # of the cells of rows
MOVES_BY = 0.05  # of a size: the half of TOLERATED, which the slow cells may show of it
# of the grid of the readings: a declared quantum this near is that grid; TOLERATED is 0.1
SAME_QUANTUM = 0.01
# of a cell's declared power that is sway: above 0.5 the cell says more of the vehicle
VEHICLES = 0.5


class Of(StrEnum):
    """Whose noise a cell shows."""

    SENSOR = "sensor"
    VEHICLE = "vehicle"


@dataclass(frozen=True)
class NoiseCell:
    """One band of one channel: power over the declared one, degrees of freedom, the probability of
    a power this far off or farther if the size were within TOLERATED of the declared one, and
    whether it fits among all cells of sensors.
    """

    channel: str
    frequency_hz: tuple[float, float]
    ratio: float
    dof: float
    p_value: float
    of: Of
    fits: bool = True


@dataclass(frozen=True)
class Agreement:
    """All cells; p_value: of the worst cell of a sensor, times their number."""

    cells: tuple[NoiseCell, ...]
    p_value: float
    parked_s: float

    @property
    def fits(self) -> bool:
        return self.p_value >= MISFIT_P

    @property
    def misfits(self) -> tuple[NoiseCell, ...]:
        """Sensors' cells that the twin does not explain, the worst first."""
        bad = [c for c in self.cells if c.of is Of.SENSOR and not c.fits]
        return tuple(sorted(bad, key=lambda c: (c.p_value, -abs(np.log(max(c.ratio, 1e-12))))))


@dataclass(frozen=True)
class RunBandPower:
    """What one run says of one cell. power: declared [unit^2/Hz]; sway: its share that is sway."""

    channel: int
    low_hz: float
    high_hz: float
    ratio: float
    dof: float
    power: float
    sway: float


def agreement(streams: Sequence[ParkedStream], twin: TwinModel) -> Agreement | None:
    """The noise of the runs against a twin; None where no stream holds enough to say."""
    cells: dict[tuple[int, float, float, Of], list[RunBandPower]] = {}
    for stream in streams:
        for part, of in _parts(stream, twin):
            key = (part.channel, part.low_hz, part.high_hz, of)
            cells.setdefault(key, []).append(part)
    found = [_joined(parts, key[-1]) for key, parts in cells.items()]
    own = [c for c in found if c.of is Of.SENSOR]
    if not own:
        return None
    worst = min(c.p_value for c in own) * len(own)
    judged = tuple(replace(c, fits=c.p_value * len(own) >= MISFIT_P) for c in found)
    return Agreement(judged, float(min(worst, 1.0)), sum(s.still_s for s in streams))


def _joined(parts: Sequence[RunBandPower], of: Of) -> NoiseCell:
    """One cell of all runs."""
    dof = np.array([p.dof for p in parts])
    total = float(dof.sum())
    ratio = float(np.array([p.ratio for p in parts]) @ dof / total)
    first = parts[0]
    return NoiseCell(
        channel=SIX_CHANNELS[first.channel],
        frequency_hz=(first.low_hz, first.high_hz),
        ratio=ratio,
        dof=total,
        p_value=_p_value(ratio, total),
        of=of,
    )


def _p_value(ratio: float, dof: float) -> float:
    """Two-sided probability of a ratio, gamma with dof, at the nearer edge of what is tolerated."""
    above, below = (1.0 + TOLERATED) ** 2, (1.0 - TOLERATED) ** 2
    high = float(gamma_law.sf(ratio / above * dof, dof))
    low = float(gamma_law.cdf(ratio / below * dof, dof))
    return min(2.0 * min(high, low), 1.0)


def _parts(stream: ParkedStream, twin: TwinModel) -> list[tuple[RunBandPower, Of]]:
    """The cells of a run, and whose noise each shows."""
    share = np.tile(1.0 - stream.up_b**2, 2)
    models = {0: declared_model(twin, gyro=True), 3: declared_model(twin, gyro=False)}
    live = [c for c in range(6) if not stream.seconds.dead[c]]
    rows, seconds = few_spectra(stream)
    counts = roundings(stream, rows.lines) if _counts(twin) else {}
    of_rows: list[RunBandPower] = []
    slow: list[RunBandPower] = []
    for bands in rows.bands:
        if bands.channel in live:
            counted = replace(bands, rounding=counts.get(bands.channel))
            counted = below_hz(counted, read_below_hz(twin, bands.channel))
            of_rows += _between(counted, models[3 * (bands.channel // 3)], share, ROW_EDGES_HZ)
    for bands in seconds.bands:
        if bands.channel in live:
            slow += _between(bands, models[3 * (bands.channel // 3)], share, CELL_EDGES_HZ)
    for data in slow_data(stream, BLOCK_S):
        if data.channel in live:
            slow.append(_slow(data, models[3 * (data.channel // 3)], share))
    turns = swings([p for p in of_rows if p.channel < 3])
    sways = turns or swings(of_rows)
    level = [c for c in range(3) if abs(stream.up_b[c]) < UPRIGHT]
    tilted = _tilted(slow, level)
    found = []
    for p in of_rows + slow:
        moves = turns if p.channel < 3 else sways
        reached = p.low_hz < GEAR_BELOW_HZ and p.ratio > 1.0 and (moves or p in tilted)
        found.append((p, Of.VEHICLE if reached or p.sway > VEHICLES else Of.SENSOR))
    return found


def _tilted(parts: Sequence[RunBandPower], level: Sequence[int]) -> list[RunBandPower]:
    """The slow cells of level gyros whose excess may be a tilting vehicle: the gravity that such a
    tilt brings in hides in what the level accelerometers show.
    """
    found = []
    for p in parts:
        shown = [_shown(q) for q in parts if q.channel - 3 in level and q.low_hz == p.low_hz]
        if p.channel in level and shown:
            tilt = (p.ratio - 1.0) * p.power / (2.0 * np.pi * p.high_hz) ** 2  # rad^2/Hz
            if tilt * STANDARD_GRAVITY**2 < max(shown):
                found.append(p)
    return found


def _shown(part: RunBandPower) -> float:
    """Power of a cell, at its upper 97.5 % limit."""
    return part.ratio * part.power * (1.0 + 2.0 / np.sqrt(part.dof))


def swings(parts: Sequence[RunBandPower]) -> bool:
    """Whether the vehicle moves on its gear more than declared: a channel shows more, of what its
    own quietest band makes one expect, where gears swing. Of what gears do not reach the mean
    counts: a last band of a few rows is the quietest by chance, and a spectrum that falls gently
    with frequency is no swinging.
    """
    for channel in {p.channel for p in parts}:
        own = [p for p in parts if p.channel == channel]
        quick = [p for p in own if p.low_hz >= GEAR_BELOW_HZ]
        levels = [p.ratio for p in own if p.low_hz < GEAR_BELOW_HZ]
        if quick:
            dof = np.array([p.dof for p in quick])
            levels.append(float(np.array([p.ratio for p in quick]) @ dof / dof.sum()))
        least = min(levels)
        low = [p for p in own if p.low_hz < SWINGS_BELOW_HZ and p.sway < VEHICLES]
        for p in low:
            over = p.ratio / max(least, 1e-12) / (1.0 + MOVES_BY) ** 2
            if float(gamma_law.sf(over * p.dof, p.dof)) * len(parts) < MOVES_P:
                return True
    return False


def _counts(twin: TwinModel) -> bool:
    return bool(twin.gyro.quantization_rad or twin.accel.quantization_m_s)


def declared_model(twin: TwinModel, *, gyro: bool) -> TriadModel:
    """What a twin declares of a triad, as the fit's model at its own values."""
    v = twin.vehicle
    d = gyro_densities(twin.gyro) if gyro else accel_densities(twin.accel)
    sizes = {
        NoiseTerm.WHITE: d.white**2,
        NoiseTerm.FLICKER: d.instability**2,
        NoiseTerm.WALK: d.walk**2,
    }
    if gyro:
        sizes[NoiseTerm.QUANTIZATION] = twin.gyro.quantization_rad**2 / 12.0
        sizes[NoiseTerm.CREEP] = (v.yaw_creep_arcsec_sqrt_h * ARCSEC) ** 2 / HOUR
    else:
        sizes[NoiseTerm.QUANTIZATION] = twin.accel.quantization_m_s**2 / 12.0
        sizes[NoiseTerm.SWAY] = v.sway_m_s**2
    logs = np.array([np.log(size) if size > 0 else ABSENT - 1.0 for size in sizes.values()])
    shape = Shape(sway_w=2.0 * np.pi * max(v.sway_hz, 1e-3), sway_zeta=max(v.sway_damping, 1e-3))
    ratios: dict[tuple[NoiseTerm, int], float] = {}
    for channel, (white, counts) in enumerate(axis_variances(twin)):
        if (channel < 3) is gyro:
            ratios |= {(NoiseTerm.WHITE, channel): white, (NoiseTerm.QUANTIZATION, channel): counts}
    return TriadModel(tuple(sizes), logs, shape, np.ones(logs.size), ratios)


def read_below_hz(twin: TwinModel, channel: int) -> float:
    """Up to which frequency a twin speaks of the rows of a channel: above, a filter has smoothed
    those that it was fitted to.
    """
    triad = SIX_CHANNELS[channel].split("_")[0]
    return float((twin.fit or {}).get("read_below_hz", {}).get(triad, np.inf))


def _between(
    bands: Bands, model: TriadModel, share: NDArray, edges_hz: Sequence[float]
) -> list[RunBandPower]:
    """Cells of a spectrum."""
    quantum = float(np.sqrt(12.0 * np.exp(model.start[model.terms.index(NoiseTerm.QUANTIZATION)])))
    grid = bands.rounding
    if grid is not None and abs(quantum / grid.quantum - 1.0) < SAME_QUANTUM:
        model = replace(model, on_grid=True)
        bands = without_comb(bands, model, model.start, share)
    S, parts = band_model(model, model.start, (), bands, share)
    sway = (
        parts[model.terms.index(NoiseTerm.SWAY)] / S if NoiseTerm.SWAY in model.terms else 0.0 * S
    )
    f = bands.centre_hz
    found: list[RunBandPower] = []
    for low, high in pairwise(edges_hz):
        inside = (f >= low) & (f < high) & (bands.dof > 0)
        if inside.any():
            dof = bands.dof[inside]
            ratio = float(np.sum(dof * bands.power[inside] / S[inside]) / dof.sum())
            part = float(dof @ sway[inside] / dof.sum())
            top = min(high, 0.5 / bands.dt_s)
            power = float(np.mean(S[inside]))
            found.append(
                RunBandPower(bands.channel, low, top, ratio, float(dof.sum()), power, part)
            )
    return found


def _slow(slow: SlowData, model: TriadModel, share: NDArray) -> RunBandPower:
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
            if term is NoiseTerm.SWAY:
                sway = factor * float(np.exp(x[j]) * np.trace(unit.slow))
    z = solve_triangular(np.linalg.cholesky(V), slow.y[:w], lower=True)
    square = float(z @ z + np.sum(slow.y[w:] ** 2 / v))
    n = slow.y.size
    own = sway / float(np.trace(V))
    power = float(np.median(np.append(np.diag(V), v))) * BLOCK_S
    return RunBandPower(slow.channel, 0.0, 0.5 / BLOCK_S, square / n, 0.5 * n, power, own)
