"""White noise of a triad whose slow noise no model explains: where its rows' spectra are flat.

A table that warms up, a line that swings and a filter of the logger can contradict every model of
the whole band. Over three octaves between them the power of the rows may still be the same, and
nothing but white noise is: what a vehicle adds falls there as the square of the frequency, and
flicker halves from one octave to the next.
"""

import numpy as np
from numpy.typing import NDArray

from simreal.twin.fit.evidence import TermEstimate
from simreal.twin.fit.model import TriadEvidence
from simreal.twin.fit.spectra import Bands
from simreal.twin.fit.terms import NoiseTerm

# chosen: a white floor over 8 times its lowest frequency, above the slow noise of 1 s and longer
OCTAVES, LOWEST_HZ = 3, 1.0
# of the power, from the lowest to the highest octave: flicker of a tenth of the white noise in the
# first changes it by 0.07, a pole at twice the last by 0.2
FLAT = 0.2


def plateau(evidence: TriadEvidence) -> tuple[TermEstimate, float] | None:
    """The white noise of a triad and the frequency up to which it was read [Hz].

    Parameters
    ----------
    evidence : TriadEvidence
        Of one triad; its fastest layer is read.

    Returns
    -------
    white, top_hz : TermEstimate, float
        Log variance, whose sigma holds a third of what a plateau may still lean; None where the
        channels have no plateau in common.
    """
    dt_s = min((b.dt_s for _, b in evidence.bands), default=np.inf)
    rows = [b for _, b in evidence.bands if b.dt_s < 1.5 * dt_s]
    top_hz = max((float(b.centre_hz.max()) for b in rows), default=0.0)
    best: tuple[float, float, float, float] | None = None
    low_hz = LOWEST_HZ
    while low_hz * 2.0**OCTAVES <= top_hz:
        found = np.array([_octaves(b, low_hz) for b in rows])
        lean = float(np.max(found[:, :, 0].max(axis=1) / found[:, :, 0].min(axis=1) - 1.0))
        if lean < FLAT and (best is None or lean < best[0]):
            power = float(np.mean(np.average(found[:, :, 0], axis=1, weights=found[0, :, 1])))
            best = lean, power, float(found[:, :, 1].sum()), low_hz * 2.0**OCTAVES
        low_hz *= 2.0**0.5
    if best is None:
        return None
    _, power, dof, read_hz = best
    value, sigma = float(np.log(power)), float(np.hypot(dof**-0.5, FLAT / 3.0))
    high = value + 1.96 * sigma
    white = TermEstimate(
        term=NoiseTerm.WHITE,
        value=value,
        sigma=sigma,
        low=value - 1.96 * sigma,
        high=high,
        nats=np.inf,
        identified=True,
        upper=high,
        needed_s=0.0,
    )
    return white, read_hz


def _octaves(bands: Bands, low_hz: float) -> NDArray:
    """Mean power of each octave, and the values behind it (OCTAVES, 2); NaN where one is empty."""
    found = np.full((OCTAVES, 2), np.nan)
    for k in range(OCTAVES):
        inside = (bands.centre_hz >= low_hz * 2.0**k) & (bands.centre_hz < low_hz * 2.0 ** (k + 1))
        dof = bands.dof[inside]
        if dof.sum() > 0:
            found[k] = dof @ bands.power[inside] / dof.sum(), dof.sum()
    return found
