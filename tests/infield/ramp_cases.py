"""Block means of chamber ramps from a truth that no estimator knows: tanh and sine curves, drift by
recursion.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from infield.thermal.ramp_runs import Leg, RampRun
from ins.records import GyroNoise, TwinModel

TWIN = TwinModel(gyro_technology="fog", gyro=GyroNoise())


class Truth:
    """K_T and K_delta of three gyros: neither polynomial nor spline; inflections of K_delta at its
    tanh centre and between.
    """

    def __init__(self, rng, *, size=0.3):
        self.a = 0.1 * rng.standard_normal((3, 3))
        self.centre = rng.uniform(0.0, 20.0, 3)
        self.size = size * rng.uniform(0.7, 1.4, 3) * rng.choice([-1.0, 1.0], 3)

    def K_T(self, k, T):
        a = self.a[k]
        return a[0] + a[1] * (T - 10) / 30 + 0.6 * a[2] * np.sin(2 * np.pi * (T + 7 * k) / 75)

    def K_delta(self, k, T):
        return self.size[k] * (1.0 + 0.5 * np.tanh((T - self.centre[k]) / 9.0))


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """One power-on in the chamber: legs at `rates` [degC/min] between two temperatures; earth: what
    of Earth's rate is in the gyros [deg/h]; noise: this many times the twin's.
    """

    rates: tuple[float, ...] = (0.5, -0.5)
    low: float = -20.0
    high: float = 40.0
    earth: tuple[float, float, float] = (0.0, 0.0, 0.0)
    run_id: str = "run"
    noise: float = 1.0
    roll_rad: float = 0.0


def ramp(rng, truth, **changes):
    """Blocks of a `Ramp` with these changes; white noise, turn-on, random walk and flicker."""
    of = Ramp(**changes)
    T, rate, legs = [], [], []
    for r in of.rates:
        minutes = int((of.high - of.low) / abs(r))
        leg = (of.low if r > 0 else of.high) + r * (np.arange(minutes) + 0.5)
        legs.append(
            Leg(
                low_degC=float(leg.min()),
                high_degC=float(leg.max()),
                rate_degC_min=r,
                start_s=60.0 * len(T),
                end_s=60.0 * (len(T) + minutes - 1),
                start=len(T),
                end=len(T) + minutes,
            )
        )
        T, rate = [*T, *leg], [*rate, *np.full(minutes, r)]
    T, rate = np.array(T), np.array(rate)
    n, g = T.size, TWIN.gyro
    white = g.arw_deg_sqrt_h * np.sqrt(60.0)
    bias = np.empty((n, 3))
    for k in range(3):
        walk = np.cumsum(rng.standard_normal(n)) * g.rate_random_walk_deg_h_sqrt_h / np.sqrt(60.0)
        drift = (
            g.turn_on_deg_h * rng.standard_normal()
            + walk
            + flicker(rng, n, g.bias_instability_deg_h)
        )
        bias[:, k] = (
            truth.K_T(k, T)
            + truth.K_delta(k, T) * rate
            + of.earth[k]
            + of.noise * (drift + white * rng.standard_normal(n))
        )
    return RampRun(
        run_id=of.run_id,
        sha256="",
        imu_serial="SN-1",
        gyro_technology="fog",
        time_s=60.0 * (np.arange(n) + 0.5),
        temperature_degC=np.repeat(T[:, None], 3, 1),
        rate_degC_min=np.repeat(rate[:, None], 3, 1),
        bias_deg_h=bias,
        sigma_deg_h=np.full(3, white),
        rate_sigma_degC_min=np.full(3, 1e-4),
        level_sigma_deg_h=np.array([7.5, 7.5, 0.001]),
        legs=tuple(legs),
        excluded=(),
        unusable=(),
        roll_pitch_rad=(of.roll_rad, 0.0),
        heading_known=False,
    )


def flicker(rng, n, B):
    """1/f noise as Gauss-Markov processes half a decade apart, 1 to 31623 min: two-sided PSD B^2 /
    (2 pi f), within 10 %.
    """
    sigma = B * np.sqrt(np.log(10.0**0.5) / np.pi)
    out = np.zeros(n)
    for tau in 10.0 ** np.arange(0.0, 5.0, 0.5):
        keep = np.exp(-1.0 / tau)
        drive = sigma * np.sqrt(1 - keep**2) * rng.standard_normal(n)
        out += lfilter([1.0], [1.0, -keep], drive, zi=[keep * sigma * rng.standard_normal()])[0]
    return out
