"""Spectra and Allan deviations of the data beside what the fitted model leads one to expect."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.robust import chi2
from simreal.evidence.noise_model import SIX_CHANNELS
from simreal.twin.fit.model import NoiseEstimate, TriadEvidence, band_model
from simreal.twin.fit.result import ChannelCurve
from simreal.twin.fit.streams import ParkedStream
from simreal.twin.fit.terms import NoiseTerm, sampled_psd

TAUS = 4  # averaging times of a doubling
# A model is contradicted over more than this share of the averaging times; chosen: of sound ones
# 5 % lie outside their band
CONTRADICTED_SHARE = 0.5
# where it is off by this; axes of one sensor that share a model differ by some 10 %, a low-pass
# filter taken for flicker made it 3.2, people who board 7 to 45 (tests/simreal/test_twin_fit.py)
CONTRADICTING_FACTOR = 1.5
# and its spectrum as unlikely; lines left out of that are in the Allan deviation (p 0.84 there)
CONTRADICTING_P = 1e-6
INTEGRAL = 3000  # frequencies of the integral that makes an Allan variance of a spectrum


def curves_of(
    streams: Sequence[ParkedStream],
    evidence: TriadEvidence,
    fits: tuple[NoiseEstimate, NoiseEstimate],
) -> tuple[ChannelCurve, ...]:
    """All six channels; of several runs the longest rest is drawn, the spectra are their means."""
    longest = max(streams, key=lambda s: max(b - a for a, b in s.spans))
    index = list(streams).index(longest)
    found = []
    for c, name in enumerate(SIX_CHANNELS):
        fitted = fits[c // 3]
        share = evidence.share[index]
        bands = [b for k, b in evidence.bands if k == index and b.channel == c]
        if not bands:
            continue
        model = [band_model(fitted.model, fitted.x, (), b, share)[0] for b in bands]
        hz = np.concatenate([b.centre_hz for b in bands])
        order = np.argsort(hz)
        power = np.concatenate([b.power for b in bands])[order]
        dof = np.concatenate([b.dof for b in bands])[order]
        expected = np.concatenate(model)[order]
        tau, allan, freedom = allan_deviation(longest, c)
        drawn = np.array([allan_of(fitted, c, share, t) for t in tau])
        low, high = (np.sqrt(chi2.ppf(q, freedom) / freedom) for q in (0.025, 0.975))
        used = dof > 0
        found.append(
            ChannelCurve(
                channel=name,
                frequency_hz=hz[order],
                power=power,
                power_model=expected,
                dof=dof,
                tau_s=tau,
                allan=allan,
                allan_model=drawn,
                allan_low=drawn * low,
                allan_high=drawn * high,
                p_value=_p_value(power[used] / expected[used], dof[used]),
            )
        )
    return tuple(found)


def contradicted(curve: ChannelCurve) -> bool:
    """Whether the data of a channel contradict the model beside them by far."""
    data, model = curve.allan, curve.allan_model
    if not data.size or not np.all(data > 0) or not np.all(model > 0):
        return False
    far = np.abs(np.log(data / model)) > np.log(CONTRADICTING_FACTOR)
    outside = (data < curve.allan_low) | (data > curve.allan_high)
    return bool(np.mean(far & outside) > CONTRADICTED_SHARE and curve.p_value < CONTRADICTING_P)


def _p_value(ratio: NDArray, dof: NDArray) -> float:
    """That the powers scatter about the model as their freedom allows, two-sided."""
    z = np.sqrt(9.0 * dof) * (np.cbrt(ratio) - 1.0 + 1.0 / (9.0 * dof))  # Wilson and Hilferty
    return float(chi2.sf(np.sum(np.clip(z, -8.0, 8.0) ** 2), z.size)) if z.size else 1.0


def allan_deviation(stream: ParkedStream, channel: int) -> tuple[NDArray, NDArray, NDArray]:
    """Averaging times, overlapping Allan deviation and its degrees of freedom over the longest
    rest. Source: IEEE Std 952-1997, annex C; freedom of white noise, Riley (2008), table 5.
    """
    a, b = max(stream.spans, key=lambda ab: ab[1] - ab[0])
    angle = np.concatenate([[0.0], np.cumsum(stream.seconds.mean[a:b, channel])])
    n = b - a
    steps = np.unique(np.geomspace(1, max(n // 4, 1), TAUS * max(int(np.log2(n)), 1)).astype(int))
    allan, freedom = [], []
    for m in steps:
        second = angle[2 * m :] - 2.0 * angle[m:-m] + angle[: -2 * m]
        allan.append(np.sqrt(np.mean(second**2) / 2.0) / m)
        N = n + 1
        white = (3.0 * (N - 1) / (2.0 * m) - 2.0 * (N - 2) / N) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
        freedom.append(max(white, 1.0))
    return steps.astype(float), np.array(allan), np.array(freedom)


def allan_of(fitted: NoiseEstimate, channel: int, share: NDArray, tau_s: float) -> float:
    """Allan deviation of the model: the integral of its spectrum under sin^4, with the walk, which
    has no lower frequency, in closed form.
    """
    model, shape = fitted.model, fitted.model.shape_at(fitted.x)
    f = np.geomspace(1e-3 / tau_s, 0.5, INTEGRAL)
    kernel = 2.0 * np.sin(np.pi * f * tau_s) ** 4 / (np.pi * f * tau_s) ** 2
    # the samples are means over a second: their spectrum below 0.5 Hz holds the images
    kernel *= (np.pi * f) ** 2 / np.sin(np.pi * f) ** 2
    total = 0.0
    for j, term in enumerate(model.terms):
        size = model.factor(term, channel, share) * np.exp(fitted.x[j])
        if not size:
            continue
        if term is NoiseTerm.WALK:
            total += size * tau_s / 3.0
            continue
        density = sampled_psd(term, f, 1.0, shape)
        total += size * 2.0 * float(np.trapezoid(kernel * density, f))
    return float(np.sqrt(total))
