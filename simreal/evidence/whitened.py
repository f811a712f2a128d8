"""All runs as one set of whitened rows, and the same operator for signatures.

Under the twin every row is N(0, 1) and independent, whatever the channel: ten-second means of the
parked sensors, parked fixes, innovations of what follows. What happens within ten seconds enters as
sums of squares over their expected value (`Scatter`), chi-square distributed.

Decision: docs/decisions/0024-null-replicates.md.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from ins.errors.base import AddedNoise, Effect
from ins.errors.telemetry import PARKED, Telemetry, Trace
from ins.records import TwinModel
from ins.units import DEG_PER_SQRT_HOUR, MICRO_G
from simreal.evidence.noise_model import SIX_CHANNELS, ChannelNoise, channel_noises
from simreal.evidence.parked import PARKED_MEAN_S, ParkedBlock
from simreal.evidence.parked_fixes import FIX_COMPONENTS, ParkedFixes
from simreal.evidence.parked_fixes import FIX_MEAN_S as FIX_BIN_S
from simreal.evidence.rolling import RollingBlock
from simreal.evidence.run_view import RunView

CHANNELS = (*SIX_CHANNELS, "temperature", "odometer", "gnss", "vehicle")
SENSORS = 6  # 3 gyros and 3 accelerometers
# DCT indices within ten seconds: 0.05 to 0.15 Hz, 0.2 to 0.45 Hz; then rows within a second
BANDS = ((1, 4), (4, 10))
BAND_HZ = ((0.05, 0.175), (0.175, 0.5), (0.5, np.inf))
PER_BLOCK = int(PARKED_MEAN_S)
# noise over resolution, for the error of rounding to be white: at 0.5 its variance is within 7 % of
# a uniform error's at every phase, at 0.7 within 0.01 % (Widrow and Kollar 2008, ch. 5)
WHITE_ROUNDING = 0.5
THERMOMETER_BLOCK = 10  # readings of a block, of which a parabola takes 3
# of the variance, how well a thermometer's noise is declared; chosen: 5 %, half a unit of 0.1
THERMOMETER_KNOWN = 0.05
MOST_LESS = 0.99  # of a density, what an uneven noise leaves out at most; chosen: 1 % stays
SWAYING = "accel_x"  # the level sway is one for all sensors; its variance is read off this one
NEAR_BLOCKS = 2  # how far apart blocks of a swaying vehicle are still related
OUTLIER_SIGMA, OUTLIERS = 5.5, 3  # of Gaussian blocks 4e-8 lie beyond
BURST_SIGMA, FEW_BLOCKS = 10.0, 0.05  # of Gaussian blocks 2e-23 lie beyond
# below, the side motion of the twin fades: at 1 to 2 m/s the RMS of the vehicle's rows was 1.35
# to 1.6, above 1.00 to 1.07 (4 blind trials)
SIDE_STEADY_M_S = 2.0


@dataclass(frozen=True)
class RowLabels:
    """Labels of whitened rows (k): run and channel numbers, time [s], kind of motion, temperature
    (NaN: none) [degC].

    steady: the row takes part in tests of variance (its sigma is that of the twin, not a
    nuisance's).
    """

    run: NDArray
    channel: NDArray
    time_s: NDArray
    kind: NDArray
    temperature_degC: NDArray
    steady: NDArray
    variance: NDArray


@dataclass(frozen=True)
class Scatter:
    """Sums of squares within blocks of ten seconds over their expectation, one run: ratio (7,
    bands, blocks), dof the same.

    Channels as the first seven of CHANNELS; dof 0 where there is nothing to compare.
    """

    ratio: NDArray
    dof: NDArray
    time_s: NDArray


@dataclass(frozen=True)
class ExtraNoise:
    """A noise effect with its coefficient squared (negative: less than the twin declares)."""

    effect: Effect
    target: str
    shape: Mapping[str, float]
    square: float
    run: int | None = None

    def in_run(self, run: Telemetry) -> tuple[AddedNoise, ...]:
        """What it adds to a run per unit of `square`; nothing where it is an event of another."""
        return (
            self.effect.noise(run, self.target, self.shape)
            if self.run in (None, run.run_index)
            else ()
        )


def channel_noises_with(
    twin: TwinModel, view: RunView, extra: Sequence[ExtraNoise]
) -> tuple[tuple[ChannelNoise, ...], NDArray]:
    """The six channels with extra noise, that which is not steady by its mean over the rest, and
    what its density is beyond that mean at each second (6, n).
    """
    noises = list(channel_noises(twin, view.run_s, view.C_nb))
    uneven = np.zeros((SENSORS, view.telemetry.n))
    for item in extra:
        for added in item.in_run(view.telemetry):
            c = CHANNELS.index(added.channel)
            if c >= SENSORS:
                continue
            mean = 1.0
            if added.profile is not None:
                mean = float(added.profile[view.telemetry.parked].mean())
                uneven[c] += item.square * added.white * (added.profile - mean)
            noises[c] = noises[c].with_added(added, mean * item.square)
    declared = np.array([noise.white for noise in noises])
    return tuple(noises), np.maximum(uneven, -MOST_LESS * declared[:, None])


def with_extra(twin: TwinModel, run: Telemetry, extra: Sequence[ExtraNoise]) -> TwinModel:
    """The twin with the noise that effects add beyond the parked stretch: white noise of the
    sensors, the mean of a triad, and the sample noise of thermometer, odometer and GNSS.
    """
    twin = _whiter(twin, run, extra)
    for item in extra:
        for added in item.in_run(run):
            more = added.sample * item.square
            if added.channel == "odometer" and more:
                total = max(twin.odometer.noise_m_s**2 + more, 1e-12)
                twin = replace(
                    twin, odometer=replace(twin.odometer, noise_m_s=float(np.sqrt(total)))
                )
            elif added.channel == SWAYING and added.sway:
                twin = _swaying(twin, added.sway * item.square)
            elif added.channel == "temperature" and more:
                total = max(twin.temperature.noise_degC**2 + more, 1e-12)
                twin = replace(
                    twin, temperature=replace(twin.temperature, noise_degC=float(np.sqrt(total)))
                )
    return twin


def _whiter(twin: TwinModel, run: Telemetry, extra: Sequence[ExtraNoise]) -> TwinModel:
    """The twin with more white noise of its gyros and accelerometers in what follows the rest."""
    more = np.zeros(SENSORS)
    for item in extra:
        for added in item.in_run(run):
            c = CHANNELS.index(added.channel)
            if c < SENSORS and added.white:
                follows = 1.0
                if added.profile is not None and not run.parked.all():
                    follows = float(added.profile[~run.parked].mean())
                more[c] += follows * item.square * added.white
    if not more.any():
        return twin
    gyro, accel = more.reshape(2, 3).mean(axis=1)
    arw = twin.gyro.arw_deg_sqrt_h**2 + gyro / DEG_PER_SQRT_HOUR**2
    vrw = twin.accel.vrw_ug_sqrt_hz**2 + accel / MICRO_G**2
    return replace(
        twin,
        gyro=replace(twin.gyro, arw_deg_sqrt_h=float(np.sqrt(max(arw, 0.0)))),
        accel=replace(twin.accel, vrw_ug_sqrt_hz=float(np.sqrt(max(vrw, 0.0)))),
    )


def _swaying(twin: TwinModel, more: float) -> TwinModel:
    """The twin with so much more variance of the sway's velocity, for what follows as well."""
    sway = float(np.sqrt(max(twin.vehicle.sway_m_s**2 + more, 1e-12)))
    return replace(twin, vehicle=replace(twin.vehicle, sway_m_s=sway))


class RunEvidence:
    """One run whitened with the twin's noise and what `extra` adds to its channels.

    known : what the twin expects of the effects that it lists, taken off the data.
    parked_only : signatures are those of the parked stretch alone, and what follows it is left as
        it is.
    """

    def __init__(
        self,
        view: RunView,
        twin: TwinModel,
        extra: Sequence[ExtraNoise] = (),
        known: Trace | None = None,
        *,
        parked_only: bool = False,
    ) -> None:
        noises, uneven = channel_noises_with(twin, view, extra)
        self.view, self.twin = view, with_extra(twin, view.telemetry, extra)
        twin = self.twin
        self.parked = ParkedBlock(view, twin, noises, uneven)
        self.fixes = ParkedFixes(view, twin)
        data = self.parked.residual(view)[:, :, None]
        z_parked, handoff = self.parked.whiten(data)
        self.handoff = handoff
        self.rolling = (
            None if view.history is None else RollingBlock(view, twin, handoff, self.fixes)
        )
        parts = [z_parked[:, 0], self.fixes.whiten_data()[0]]
        if self.rolling is not None:
            parts.append(self.rolling.whiten_data())
        self.z = np.concatenate(parts)
        self.parked_only = False
        if known is not None:
            self.z = self.z - self.whiten([known])[:, 0]
        self.parked_only = parked_only
        self.scatter = _scatter(view, self.parked, twin)

    def whiten(self, traces: Sequence[Trace]) -> NDArray:
        """Whitened signatures (rows, m) of traces on the run's seconds."""
        if not traces:
            return np.zeros((self.z.size, 0))
        listed = list(traces)
        white, handoff = self.parked.whiten(self.parked.of_traces(listed))
        fixes, site_m = self.fixes.whiten(listed)
        parts = [white, fixes]
        if self.rolling is not None:
            follows = self.rolling.whiten(listed, handoff, site_m)
            parts.append(np.zeros_like(follows) if self.parked_only else follows)
        return np.vstack(parts)

    def outlier_times(self) -> list[float]:
        """Middles of the parked bins, at most OUTLIERS, in which a sensor's row is beyond what
        noise ever is.
        """
        rows = np.abs(self.z[: self.parked.rows]).reshape(SENSORS, self.parked.bins).max(axis=0)
        order = [k for k in np.argsort(-rows) if rows[k] > OUTLIER_SIGMA][:OUTLIERS]
        return [self.view.start_s + PARKED_MEAN_S * (k + 0.5) for k in order]

    def _speed_at(self, time_s: NDArray) -> NDArray:
        telemetry = self.view.telemetry
        return np.abs(np.interp(time_s, telemetry.time_s, telemetry.speed_m_s))

    @property
    def blocks(self) -> tuple[slice, ...]:
        """Rows that belong together: parked sensors, parked fixes, what follows."""
        parked, fixes = self.parked.rows, self.parked.rows + self.fixes.rows
        return slice(0, parked), slice(parked, fixes), slice(fixes, self.z.size)

    def rows(self, number: int) -> RowLabels:
        """Labels of the rows, in the order of `z`."""
        p, f = self.parked, self.fixes
        bin_s = self.view.start_s + PARKED_MEAN_S * (np.arange(p.bins) + 0.5)
        time_s = np.concatenate(
            [
                np.tile(bin_s, SENSORS),
                np.tile(f.time_s - 0.5 * FIX_BIN_S, FIX_COMPONENTS if f.rows else 0),
            ]
        )
        channel = np.concatenate(
            [np.repeat(np.arange(SENSORS), p.bins), np.full(f.rows, CHANNELS.index("gnss"))]
        )
        kind = np.full(time_s.size, PARKED)
        steady = np.concatenate([np.repeat(p.steady, p.bins), np.ones(f.rows, bool)])
        variance = np.ones(time_s.size)
        if self.rolling is not None:
            r = self.rolling.labels
            codes = np.array([CHANNELS.index(c) for c in r.channel], dtype=int)
            rolling_ok = (codes != CHANNELS.index("gyro_z")) & ~(
                (codes == CHANNELS.index("vehicle")) & (r.kind == PARKED)
            )
            rolling_ok &= (codes != CHANNELS.index("vehicle")) | (
                self._speed_at(r.time_s) > SIDE_STEADY_M_S
            )
            time_s, channel, kind = (
                np.concatenate(pair)
                for pair in ((time_s, r.time_s), (channel, codes), (kind, r.kind))
            )
            steady, variance = (
                np.concatenate([steady, rolling_ok]),
                np.concatenate([variance, r.variance]),
            )
        T = np.full(time_s.size, np.nan)
        gyro_T = self.view.telemetry.temperature_degC
        if gyro_T is not None:
            axis = np.where(channel < SENSORS, channel % 3, 0)
            for k in range(3):
                T[axis == k] = np.interp(
                    time_s[axis == k], self.view.telemetry.time_s, gyro_T[:, k]
                )
        return RowLabels(
            np.full(time_s.size, number), channel.astype(int), time_s, kind, T, steady, variance
        )


class Evidence:
    """All runs under one twin; parked_only: what follows the parked stretches explains nothing."""

    def __init__(
        self,
        views: Sequence[RunView],
        twin: TwinModel,
        extra: Sequence[ExtraNoise] = (),
        known: Sequence[Trace | None] | None = None,
        *,
        parked_only: bool = False,
    ) -> None:
        self.parked_only = parked_only
        self.views, self.twin, self.extra = tuple(views), twin, tuple(extra)
        self.known = tuple(known) if known is not None else (None,) * len(self.views)
        self.runs = [
            RunEvidence(view, twin, extra, own, parked_only=parked_only)
            for view, own in zip(views, self.known)
        ]
        self.offsets = np.concatenate([[0], np.cumsum([r.z.size for r in self.runs])])
        labels = [r.rows(k) for k, r in enumerate(self.runs)]
        self.rows = RowLabels(
            *(
                np.concatenate([getattr(rows, name) for rows in labels])
                for name in RowLabels.__dataclass_fields__
            )
        )
        self.z = np.concatenate([r.z for r in self.runs])

    @property
    def size(self) -> int:
        return int(self.z.size)

    @property
    def log_likelihood(self) -> float:
        """Of all rows of the data, but for what no noise changes [nats]."""
        spread = sum(run.parked.log_sigma_of_rows for run in self.runs)
        spread += 0.5 * float(np.log(self.rows.variance[self.followed]).sum())
        return -0.5 * float(self.z @ self.z) - spread

    @cached_property
    def followed(self) -> NDArray:
        """Rows of what follows the parked stretches (boolean)."""
        out = np.zeros(self.size, bool)
        for k, run in enumerate(self.runs):
            out[self.rows_of(k)][run.blocks[2]] = True
        return out

    def alone(self, run: int) -> "Evidence":
        """One of the runs, whitened as it is here."""
        out = copy(self)
        out.__dict__.pop("followed", None)
        out.views, out.known, out.runs = (self.views[run],), (self.known[run],), [self.runs[run]]
        out.z = self.runs[run].z
        out.rows = self.runs[run].rows(0)
        out.offsets = np.array([0, out.z.size])
        return out

    def rows_of(self, run: int) -> slice:
        return slice(int(self.offsets[run]), int(self.offsets[run + 1]))

    def whiten(self, traces: Sequence[Sequence[Trace]]) -> NDArray:
        """Whitened columns (rows, m): traces[run][m]."""
        return np.vstack([run.whiten(list(own)) for run, own in zip(self.runs, traces)])


def block_spectrum(noise: ChannelNoise) -> NDArray:
    """Expected squares (10,) of the DCT of ten one-second means."""
    D = dct(np.eye(PER_BLOCK), axis=0, norm="ortho")
    return np.asarray(np.einsum("ki,ij,kj->k", D, noise.covariance(PER_BLOCK, 1.0), D))


def block_freedom(noise: ChannelNoise, low: int, high: int) -> float:
    """Degrees of freedom that a block's DCT squares [low, high), over their expectation, add to a
    long sum of blocks.

    m^2 / sum of squared correlations, within the block and with its neighbours (Satterthwaite):
    sway puts its leaps of velocity from end to end of a block into all of them alike, 1.2 instead
    of 3 in the slow band of the default twin.
    """
    D = dct(np.eye(PER_BLOCK), axis=0, norm="ortho")[low:high]
    C = noise.covariance((1 + NEAR_BLOCKS) * PER_BLOCK, 1.0)
    blocks = [
        D @ C[:PER_BLOCK, k * PER_BLOCK : (k + 1) * PER_BLOCK] @ D.T for k in range(1 + NEAR_BLOCKS)
    ]
    sigma = np.sqrt(np.diag(blocks[0]))
    squares = [float(np.sum((block / np.outer(sigma, sigma)) ** 2)) for block in blocks]
    return (high - low) ** 2 / (squares[0] + 2.0 * sum(squares[1:]))


def _scatter(view: RunView, parked: ParkedBlock, twin: TwinModel) -> Scatter:
    blocks, shape = parked.bins, (7, len(BANDS) + 1, parked.bins)
    ratio, dof = np.ones(shape), np.zeros(shape)
    seconds, dt_s = view.seconds, view.seconds.row_dt_s
    mean = seconds.mean[parked.seconds].reshape(blocks, PER_BLOCK, SENSORS)
    spectrum = dct(mean, axis=1, norm="ortho") ** 2
    rows = seconds.rows[parked.seconds]
    per_second = int(np.median(rows)) if rows.size else 0
    raw = seconds.scatter[parked.seconds].reshape(blocks, PER_BLOCK, SENSORS).sum(axis=1)
    # 200 rows in 3 seconds are 66, 67 and 67: such seconds are as whole as those of 100 Hz
    counts = [n for n in np.unique(rows) if abs(n - per_second) <= 1]
    shares = (rows.reshape(blocks, PER_BLOCK, 1) == counts).sum(axis=1)
    whole = shares.sum(axis=1) == PER_BLOCK
    for c, noise in enumerate(parked.noise):
        if not parked.steady[c]:
            continue
        uneven = parked.uneven[c]
        expected = block_spectrum(noise) + uneven[:, None]
        for b, (low, high) in enumerate(BANDS):
            ratio[c, b] = (spectrum[:, low:high, c] / expected[:, low:high]).mean(axis=1)
            dof[c, b] = block_freedom(noise, low, high)
        told = np.array([noise.scatter(int(n), dt_s) for n in counts])
        expected_sum, freedom = (shares @ told).T if counts else np.zeros((2, blocks))
        expected_sum = expected_sum + uneven * np.sum(rows.reshape(blocks, -1) - 1, axis=1) / dt_s
        seen = whole & (freedom > 0)
        ratio[c, -1, seen] = raw[seen, c] / expected_sum[seen]
        dof[c, -1, seen] = freedom[seen]
    _leave_out_bursts(ratio, dof)
    _thermometer(view, twin, parked, ratio, dof)
    return Scatter(ratio, dof, view.start_s + PARKED_MEAN_S * (np.arange(blocks) + 0.5))


def _leave_out_bursts(ratio: NDArray, dof: NDArray) -> None:
    """Few blocks that scatter far beyond the rest are events (boarding, a bump), not noise: taken
    out, in place.

    What they do to the ten-second means stays in the rows.
    """
    wild = (dof > 0) & (ratio > 1.0 + BURST_SIGMA * np.sqrt(2.0 / np.maximum(dof, 1e-9)))
    few = wild.mean(axis=2, keepdims=True) < FEW_BLOCKS
    dof[wild & few] = 0.0


def _thermometer(
    view: RunView, twin: TwinModel, parked: ParkedBlock, ratio: NDArray, dof: NDArray
) -> None:
    """Scatter of the gyro thermometers about parabolas through blocks of a few readings, in the
    first band of theirs.

    Only where the declared noise is not small beside the rounding: else the error of rounding is
    one of the temperature, not of chance. Blocks are short, because the air wanders by
    milli-degrees within a minute, which is no noise of the thermometer; and its noise is declared
    to THERMOMETER_KNOWN, so that a run is worth no more than 2 / THERMOMETER_KNOWN^2 readings.
    """
    log, noise = view.run.temperature, twin.temperature
    expected = noise.noise_degC**2 + noise.resolution_degC**2 / 12.0
    if log is None or expected <= 0 or noise.noise_degC < WHITE_ROUNDING * noise.resolution_degC:
        return
    n = THERMOMETER_BLOCK
    inside = np.flatnonzero((log.time_s > view.start_s) & (log.time_s <= view.end_s))
    if inside.size < n:
        return
    groups = inside[: inside.size // n * n].reshape(-1, n)
    x = np.stack([np.ones(n), np.linspace(-1, 1, n), np.linspace(-1, 1, n) ** 2], axis=1)
    Q, _ = np.linalg.qr(x)
    at = np.minimum(
        ((log.time_s[groups[:, -1]] - view.start_s - 1e-6) // PARKED_MEAN_S).astype(int),
        parked.bins - 1,
    )
    total, count = np.zeros(parked.bins), np.zeros(parked.bins)
    for axis in range(3):
        values = log.gyro_degC[groups, axis]
        good = np.isfinite(values).all(axis=1)
        off = values[good] - values[good] @ Q @ Q.T
        np.add.at(total, at[good], np.sum(off**2, axis=1) / expected)
        np.add.at(count, at[good], n - 3.0)
    seen = count > 0
    worth = 1.0 / (1.0 + 0.5 * THERMOMETER_KNOWN**2 * float(count.sum()))
    ratio[6, 0, seen], dof[6, 0, seen] = total[seen] / count[seen], worth * count[seen]
