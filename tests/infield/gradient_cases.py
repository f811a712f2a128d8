"""Minute means of a ring-laser unit from a truth written apart from the fit: temperatures by
recursion, drift by recursion.
"""

from dataclasses import dataclass

import numpy as np

from infield.thermal.ramp_runs import GradientRun, RampRun
from ins.records import GyroNoise, TwinModel
from tests.infield.ramp_cases import flicker

TWIN = TwinModel(gyro_technology="rlg", gyro=GyroNoise())
NAMES = ("K1", "K2", "K3", "K4", "K5", "K6x", "K6y", "K6z")


class Unit:
    """True terms of three gyros, T counted from 25 degC; wave: what of the curve is no parabola
    [deg/h].
    """

    def __init__(self, rng, *, wave=0.0, gradients=1.0):
        sign = rng.choice([-1.0, 1.0], (3, 5))
        self.K1 = 0.02 * rng.standard_normal(3)
        self.K2 = 0.001 * rng.standard_normal(3)
        self.K3 = 1e-5 * rng.standard_normal(3)
        self.K4 = sign[:, 0] * rng.uniform(0.03, 0.06, 3)
        self.K5 = sign[:, 1] * rng.uniform(2e-4, 8e-4, 3)
        self.K6 = gradients * np.diag(sign[:, 2] * rng.uniform(0.02, 0.05, 3))
        # of another gyro's line
        self.K6 += gradients * np.diag(sign[:, 3] * rng.uniform(0.01, 0.02, 3))[[1, 2, 0]]
        self.wave, self.phase = wave, rng.uniform(0.0, 2 * np.pi, 3)

    def bias(self, k, T, rate, lines):
        t = T - 25.0
        curve = (
            self.K1[k]
            + self.K2[k] * t
            + self.K3[k] * t**2
            + self.wave * np.sin(2 * np.pi * t / 65.0 + self.phase[k])
        )
        return curve + (self.K4[k] + self.K5[k] * t) * rate + lines @ self.K6[k]

    def terms(self, k, reference):
        """The true coefficients with T counted from a reference, by hand from the polynomial."""
        d = reference - 25.0
        return np.array(
            [
                self.K1[k] + self.K2[k] * d + self.K3[k] * d**2,
                self.K2[k] + 2 * self.K3[k] * d,
                self.K3[k],
                self.K4[k] + self.K5[k] * d,
                self.K5[k],
                *self.K6[k],
            ]
        )


@dataclass(frozen=True, kw_only=True)
class Chamber:
    """Air of a chamber: up at a rate [degC/min] between soaks [min], and back; a heater [degC] on
    one side of the unit that switches with a period [min].
    """

    rate: float = 1.0
    low: float = -15.0
    high: float = 40.0
    soak: int = 25
    heater: float = 4.0
    period: int = 80
    side: tuple[float, float, float] = (0.8, -0.3, 0.2)
    back: bool = True

    def air(self):
        """Its temperature, minute by minute."""
        up = np.arange(self.low, self.high, self.rate)
        cold, warm = np.full(self.soak, self.low), np.full(self.soak, self.high)
        return np.r_[cold, up, warm, *((up[::-1], cold) if self.back else ())]


def temperatures(chamber):
    """Block, gyros and lines each a lag of the chamber's air, minute by minute: T, rate and lines
    (n, 3).
    """
    air, side = chamber.air(), np.array(chamber.side)
    n, steps = air.size, 10
    block, hot, gyro = air[0], 0.0, np.full(3, air[0])
    T, lines = np.empty((n, 3)), np.empty((n, 3))
    tau, share = np.array([2.0, 2.5, 1.7]), np.array([0.3, -0.2, 0.25])
    for i in range(n):
        for _ in range(steps):
            block += (air[i] - block) / (8.0 * steps)
            on = (i // (chamber.period // 2)) % 2 == 0
            hot += ((chamber.heater if on else 0.0) - hot) / (12.0 * steps)
            gyro = gyro + (block - gyro) / (tau * steps)
        T[i], lines[i] = gyro + 0.1 * hot, share * (block - gyro) + side * hot
    return T, np.gradient(T, axis=0), lines


def case(
    rng,
    unit,
    *,
    earth=(0.0, 0.0, 0.0),
    run_id="run",
    noise=1.0,
    with_lines=True,
    turned=0.0,
    **chamber,
):
    """One power-on in a `Chamber` with these changes: minute blocks with white noise, turn-on,
    random walk and flicker.
    """
    T, rate, lines = temperatures(Chamber(**chamber))
    n, g = len(T), TWIN.gyro
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
            unit.bias(k, T[:, k], rate[:, k], lines)
            + earth[k]
            + noise * (drift + white * rng.standard_normal(n))
        )
    blocks = RampRun(
        run_id=run_id,
        sha256="",
        imu_serial="SN-1",
        gyro_technology="rlg",
        time_s=60.0 * (np.arange(n) + 0.5),
        temperature_degC=T,
        rate_degC_min=rate,
        bias_deg_h=bias,
        sigma_deg_h=np.full(3, white),
        rate_sigma_degC_min=np.full(3, 1e-3),
        level_sigma_deg_h=np.array([7.5, 7.5, 0.001]),
        legs=(),
        excluded=(),
        unusable=(),
        roll_pitch_rad=(0.0, 0.0),
        heading_known=False,
        turned_rad=turned,
    )
    return GradientRun(
        blocks=blocks,
        gradient_degC=lines if with_lines else np.zeros((n, 3)),
        usable=np.ones(n, dtype=bool),
        lines=("x", "y", "z") if with_lines else (),
        sigma_rate_degC_min=np.full(3, 1e-3),
        sigma_gradient_degC=np.full(3, 1e-3),
    )


SIDES = ((0.8, -0.3, 0.2), (-0.2, 0.7, 0.4), (0.3, 0.4, -0.8))


def three_runs(rng, unit, **more):
    """Three days in the chamber, each heated from another side."""
    rates, periods = (0.8, 1.2, 1.0), (90, 75, 105)
    return [
        case(rng, unit, run_id=f"day-{k}", side=SIDES[k], rate=rates[k], period=periods[k], **more)
        for k in range(3)
    ]
