"""What the twin says the noise of one channel is, as covariances of means and as expected scatter.

A channel is a mean rate or specific force: white noise (PSD N^2), flicker (PSD B^2 / 2 pi f from
1/(4 x run length)), rate random walk (variance K^2 t), a turn-on constant, a Markov process, and
the difference of a bounded process: the quantised angle of a gyro (white), the sway velocity of a
standing vehicle (damped oscillator). formats.md, section 3.

Decision: docs/decisions/0024-null-replicates.md.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.linalg import toeplitz

from ins.errors.base import AddedNoise
from ins.noise import accel_densities, gyro_densities
from ins.records import TwinModel
from ins.units import ARCSEC

SIX_CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
FLICKER_GRID_S = 1.0
LINE_ALIKE_S = 20.0  # over which a line keeps its phase: as finely as spectra of 20 s tell it


@dataclass(frozen=True, kw_only=True)
class ChannelNoise:
    """Variances and densities in SI: white [unit^2/Hz], flicker B^2, walk K^2 [unit^2/s], turn_on,
    markov variance;

    bounded: variance of a white bounded integral (angle, velocity); sway: velocity variance of an
    oscillator with circular frequency sway_w and damping sway_zeta; lines: circular frequency and
    variance of the bounded integral of each. run_s: length of the run (lowest frequency of the
    flicker).
    """

    white: float = 0.0
    flicker: float = 0.0
    walk: float = 0.0
    turn_on: float = 0.0
    markov: float = 0.0
    markov_tau_s: float = 1.0
    bounded: float = 0.0
    sway: float = 0.0
    sway_w: float = 1.0
    sway_zeta: float = 0.2
    lines: tuple[tuple[float, float], ...] = ()
    run_s: float = 3600.0

    def with_added(self, added: AddedNoise, scale: float) -> "ChannelNoise":
        """Together with an effect's noise, `scale` in units of its coefficient squared."""
        return replace(
            self,
            white=self.white + scale * added.white,
            flicker=self.flicker + scale * added.flicker,
            walk=self.walk + scale * added.walk,
            bounded=self.bounded + scale * added.bounded,
            sway=self.sway + scale * added.sway,
            markov=self.markov + scale * added.markov,
            markov_tau_s=added.markov_tau_s or self.markov_tau_s,
        )

    def only(self, added: AddedNoise) -> "ChannelNoise":
        """An effect's noise alone, per unit of its coefficient squared, on this channel's run and
        oscillator.
        """
        return replace(
            self,
            white=added.white,
            flicker=added.flicker,
            walk=added.walk,
            turn_on=0.0,
            markov=added.markov,
            markov_tau_s=added.markov_tau_s or 1.0,
            bounded=added.bounded,
            sway=added.sway,
            lines=(),
        )

    def covariance(self, n: int, dt_s: float, start_s: float = 0.0) -> NDArray:
        """Covariance (n, n) of means over n intervals of dt_s on end from start_s after
        power-on.
        """
        end = start_s + dt_s * (np.arange(n) + 1.0)
        C = toeplitz(self._stationary(n, dt_s)) + self.turn_on
        if self.walk:
            middle = end - 0.5 * dt_s
            C += self.walk * np.minimum.outer(middle, middle)
            C[np.diag_indices(n)] -= self.walk * dt_s / 6.0
        return C

    def scatter(self, rows: int, dt_s: float) -> tuple[float, float]:
        """Expected sum of squared deviations of `rows` row means from their mean, and its degrees
        of freedom.
        """
        if rows < 2:
            return 0.0, 0.0
        C = toeplitz(self._stationary(rows, dt_s, slow=False))
        if self.flicker:
            C += self.flicker * toeplitz(_flicker_within(rows, dt_s))
        C = C - C.mean(axis=0) - C.mean(axis=1)[:, None] + C.mean()
        trace, square = float(np.trace(C)), float(np.sum(C * C))
        return trace, (trace**2 / square if square > 0 else 0.0)

    def _stationary(self, n: int, dt_s: float, *, slow: bool = True) -> NDArray:
        """Autocovariance (n,) of means over dt_s at lags k dt_s, turn-on and random walk apart."""
        r = np.zeros(n)
        r[0] = self.white / dt_s
        lag = np.abs(dt_s * np.arange(-1, n + 1))
        u = self.bounded * (lag < 1e-9) + self.sway * oscillator(lag, self.sway_w, self.sway_zeta)
        for w, variance in self.lines:
            u += variance * oscillator(lag, w, 1.0 / (w * LINE_ALIKE_S))
        r += (2.0 * u[1:-1] - u[:-2] - u[2:]) / dt_s**2
        if self.markov:
            r += self.markov * _markov_means(dt_s * np.arange(n), dt_s, self.markov_tau_s)
        if slow and self.flicker:
            r += self.flicker * _flicker_means(n, dt_s, self.run_s)
        return r


def oscillator(lag_s: NDArray, w: float, zeta: float) -> NDArray:
    """Autocorrelation of the velocity of x'' + 2 zeta w x' + w^2 x = white in its steady state."""
    if zeta >= 1.0:
        return np.exp(-w * lag_s)
    wd = w * np.sqrt(1.0 - zeta**2)
    return np.exp(-zeta * w * lag_s) * (np.cos(wd * lag_s) - zeta * w / wd * np.sin(wd * lag_s))


def _markov_means(lag_s: NDArray, dt_s: float, tau_s: float) -> NDArray:
    """Autocorrelation of means over dt_s of exp(-|t|/tau)."""
    a = dt_s / tau_s
    out = np.exp(-np.maximum(lag_s - dt_s, 0.0) / tau_s) * (np.expm1(-a) / a) ** 2
    out[lag_s == 0] = 2.0 * (a - 1.0 + np.exp(-a)) / a**2
    return out


def _flicker_means(n: int, dt_s: float, run_s: float) -> NDArray:
    """Autocovariance (n,) of means over dt_s of unit flicker, PSD 1/(2 pi |f|) from 1/(4 run_s): a
    sum over its lines.
    """
    step = min(FLICKER_GRID_S, dt_s)
    per = round(dt_s / step)
    m = next_fast_len(int(np.ceil(max(4.0 * run_s, 2.0 * n * dt_s) / step)), real=True)
    f = np.fft.rfftfreq(m, step)
    lowest = 0.98 / (4.0 * run_s)  # the line there carries the band about it
    psd = (
        np.where(f >= lowest, 1.0 / (2.0 * np.pi * np.maximum(f, lowest)), 0.0)
        * np.sinc(f * dt_s) ** 2
    )
    return np.fft.irfft(psd, m)[: n * per : per] / step


def _flicker_within(n: int, dt_s: float) -> NDArray:
    """Autocovariance (n,) of means over dt_s of unit flicker, but for a constant, which a mean over
    them takes out: that of -ln|t| / pi, twice integrated over the rows, exact at all frequencies.
    """
    t = dt_s * np.arange(-1.0, n + 1.0)
    twice = -(0.5 * t**2 * np.log(np.maximum(np.abs(t), 1e-300)) - 0.75 * t**2) / np.pi
    return np.asarray((twice[2:] - 2.0 * twice[1:-1] + twice[:-2]) / dt_s**2)


def channel_noises(twin: TwinModel, run_s: float, C_nb: NDArray) -> tuple[ChannelNoise, ...]:
    """The six channels of a parked unit: gyro x, y, z [rad/s], accelerometer x, y, z [m/s^2].

    C_nb (3, 3): parked attitude. The heading creeps (white rate on z); each accelerometer feels its
    share of the level sway (a tilt of a degree gives the vertical one a sixtieth). Quantisation is
    that of the accumulated angle or velocity: uniform, q^2/12. Lines of dither and engines that a
    fit found, and what sets one axis apart from the others, stand in the twin's `fit`.
    """
    g, v = twin.gyro, twin.vehicle
    rate, force = gyro_densities(g), accel_densities(twin.accel)
    gyro = ChannelNoise(
        white=rate.white**2,
        flicker=rate.instability**2,
        walk=rate.walk**2,
        turn_on=rate.turn_on**2,
        bounded=g.quantization_rad**2 / 12.0,
        run_s=run_s,
    )
    creep = (v.yaw_creep_arcsec_sqrt_h * ARCSEC / 60.0) ** 2
    accel = ChannelNoise(
        white=force.white**2,
        flicker=force.instability**2,
        walk=force.walk**2,
        turn_on=force.turn_on**2,
        bounded=twin.accel.quantization_m_s**2 / 12.0,
        sway_w=2.0 * np.pi * v.sway_hz,
        sway_zeta=v.sway_damping,
        run_s=run_s,
    )
    share = C_nb[0] ** 2 + C_nb[1] ** 2
    x, y, z = (replace(accel, sway=float(s) * v.sway_m_s**2) for s in share)
    every = [
        replace(noise, white=white * noise.white, bounded=counts * noise.bounded)
        for noise, (white, counts) in zip((gyro, gyro, gyro, x, y, z), axis_variances(twin))
    ]
    every[2] = replace(every[2], white=every[2].white + creep)
    return tuple(replace(n, lines=_lines_of(twin, c)) for c, n in zip(SIX_CHANNELS, every))


def axis_variances(twin: TwinModel) -> list[tuple[float, float]]:
    """Of each of the six channels, white noise and quantisation over the twin's, as variances."""
    said = {entry["channel"]: entry for entry in (twin.fit or {}).get("axes", [])}
    return [
        (float(said[c]["white"]), float(said[c]["quantization"])) if c in said else (1.0, 1.0)
        for c in SIX_CHANNELS
    ]


def _lines_of(twin: TwinModel, channel: str) -> tuple[tuple[float, float], ...]:
    """Circular frequency of each line of a channel, and half its squared swing."""
    found = (twin.fit or {}).get("lines", [])
    return tuple(
        (2.0 * np.pi * float(line["frequency_hz"]), 0.5 * float(line["swing"]) ** 2)
        for line in found
        if line["channel"] == channel and "swing" in line
    )
