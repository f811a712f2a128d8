"""How much larger than declared the noise of a log is, and how late its fixes are, by the aided filter's own innovations.

The declared noise stands wherever the innovations fit it. Where they do not, a latency of the receiver is looked for, and four
factors are raised, never lowered: white noise of the sensors, walks of their biases, sigmas of the satellite positions and of
the velocities, all by the likelihood of the innovations over the first FIT_S. NIS is then near one by construction and tests
nothing any more; the document says so and keeps the first.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from alignment.gyrocompass import nis_verdict
from ins.aided_filter import KINDS, REJECT_PROBABILITY, AidedHistory, AidedNoise

MATERIAL = 1.2  # mean NIS above its band but below this is said, not acted on
FIT_S = 1800.0  # of log that the factors are fitted on
GAIN_NATS = 5.0  # of likelihood that a change must bring
LATENCIES_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
STEPS = (4.0, 2.0)
LARGEST = {"white": 64.0, "walk": 32.0}
GNSS_PASSES = 3
MAX_OUTLIERS = 0.1  # share of rejected fixes up to which they are the receiver's outliers


@dataclass(frozen=True, kw_only=True)
class NoiseScales:
    """Factors on declared sigmas; latency_s: by how much the fixes are older than their time says."""

    white: float = 1.0
    walk: float = 1.0
    position: float = 1.0
    velocity: float = 1.0
    latency_s: float = 0.0
    sigma_latency_s: float = float("nan")

    @property
    def fitted(self) -> bool:
        return (self.white, self.walk, self.position, self.velocity, self.latency_s) != (1.0, 1.0, 1.0, 1.0, 0.0)

    def of(self, noise: AidedNoise) -> AidedNoise:
        return AidedNoise(
            arw=self.white * noise.arw, vrw=self.white * noise.vrw, gyro_walk=self.walk * noise.gyro_walk,
            accel_walk=self.walk * noise.accel_walk,
        )  # fmt: skip


class Fly(Protocol):
    """Navigates a log from its start, for `seconds` at most; None where no start is found."""

    def __call__(self, scales: NoiseScales, seconds: float = np.inf) -> AidedHistory | None: ...


@dataclass(frozen=True)
class _Tried:
    scales: NoiseScales
    history: AidedHistory

    @property
    def value(self) -> float:
        """Log likelihood of all innovations; a rejected one counts as if at the gate."""
        return float(np.nansum(self.history.loglik))


def fit_noise(fly: Fly) -> tuple[NoiseScales, AidedHistory, AidedHistory] | None:
    """The scales that a log needs, the flight under them, the flight as declared; None where it cannot be flown."""
    declared = fly(NoiseScales())
    if declared is None:
        return None
    if not any(misfit(declared, k) for k in range(2)):
        return NoiseScales(), declared, declared
    best = _search(fly)
    if best is None:
        return NoiseScales(), declared, declared
    history = fly(best.scales)
    if history is None:
        return NoiseScales(), declared, declared
    whole = _with_gnss(_Tried(best.scales, history), fly, np.inf, lower=False)
    return whole.scales, whole.history, declared


def _search(fly: Fly) -> _Tried | None:
    """Latency first, under sensors so noisy that a large bias cannot hide it; then sensors; then latency to a millisecond."""
    wide = NoiseScales(white=8.0, walk=32.0, position=3.0, velocity=8.0)
    tried = [_flown(replace(wide, latency_s=t), fly) for t in LATENCIES_S]
    found = [_with_gnss(t, fly, FIT_S) for t in tried if t is not None]
    if not found:
        return None
    best = _with_latency(max(found, key=lambda t: t.value), fly, 0.05)
    for factor in STEPS:
        improved = True
        while improved:
            improved = False
            for name in LARGEST:
                for step in (factor, 1.0 / factor):
                    value = float(np.clip(step * getattr(best.scales, name), 1.0, LARGEST[name]))
                    if value == getattr(best.scales, name):
                        continue
                    other = _flown(replace(best.scales, **{name: value}), fly)
                    other = None if other is None else _with_gnss(other, fly, FIT_S)
                    if other is not None and other.value > best.value + GAIN_NATS:
                        best, improved = other, True
    without = _flown(replace(best.scales, latency_s=0.0), fly)
    if without is not None and _with_gnss(without, fly, FIT_S).value > best.value - GAIN_NATS:
        return _with_gnss(without, fly, FIT_S)
    return _with_latency(best, fly, 0.02)


def _flown(scales: NoiseScales, fly: Fly) -> _Tried | None:
    history = fly(scales, FIT_S)
    return None if history is None else _Tried(scales, history)


def _with_latency(at: _Tried, fly: Fly, step_s: float) -> _Tried:
    """The latency at the top of a parabola through three likelihoods, with the sigma of its curvature."""
    t0 = at.scales.latency_s
    before, after = (_flown(replace(at.scales, latency_s=t0 + d), fly) for d in (-step_s, step_s))
    if before is None or after is None:
        return at
    low, middle, high = before.value, at.value, after.value
    bend = (low - 2.0 * middle + high) / step_s**2
    if bend >= 0:
        return max((at, before, after), key=lambda t: t.value)
    shift = float(np.clip(0.5 * (low - high) / step_s / bend, -step_s, step_s))
    sigma = float(1.0 / np.sqrt(-bend))
    top = _flown(replace(at.scales, latency_s=max(t0 + shift, 0.0)), fly)
    best = max((t for t in (at, top) if t is not None), key=lambda t: t.value)
    return _Tried(replace(best.scales, sigma_latency_s=sigma), best.history)


def _with_gnss(at: _Tried, fly: Fly, seconds: float, *, lower: bool = True) -> _Tried:
    """The satellite sigmas at which the NIS of each kind is one, not below declared; `lower` False: raised at most."""
    for _ in range(GNSS_PASSES):
        factor = [np.sqrt(capped_nis(at.history, k)) for k in range(2)]
        if not lower:
            factor = [max(f, 1.0) if misfit(at.history, k) else 1.0 for k, f in enumerate(factor)]
        changed = {name: float(max(getattr(at.scales, name) * f, 1.0)) for name, f in zip(KINDS, factor)}
        if all(abs(changed[name] / getattr(at.scales, name) - 1.0) < 0.02 for name in KINDS):
            break
        scales = replace(at.scales, **changed)
        history = fly(scales, seconds)
        if history is None:
            break
        at = _Tried(scales, history)
    return at


def capped_nis(history: AidedHistory, kind: int) -> float:
    """Mean NIS per degree of freedom of a kind; 1 where there is none.

    Rejected fixes are left out where they are few, the receiver's own outliers; where they are more than MAX_OUTLIERS of
    all, it is the model that does not fit, and each is taken as at the gate.
    """
    nis = _counted(history, kind)
    return float(np.minimum(nis, chi2.isf(REJECT_PROBABILITY, 3)).mean() / 3.0) if nis.size else 1.0


def misfit(history: AidedHistory, kind: int) -> bool:
    """Whether the innovations of a kind are larger than their noise allows, and by an amount that matters."""
    mean = capped_nis(history, kind)
    return mean > MATERIAL and nis_verdict(mean, 3 * _counted(history, kind).size) is not None


def _counted(history: AidedHistory, kind: int) -> NDArray:
    from ins.aided_kernel import REJECTED

    nis = history.nis[:, kind]
    seen, rejected = np.isfinite(nis), history.used[:, kind] == REJECTED
    few = (seen & rejected).sum() <= MAX_OUTLIERS * seen.sum()
    return nis[seen & ~rejected] if few else nis[seen]
