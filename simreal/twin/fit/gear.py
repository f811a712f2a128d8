"""What a vehicle that moves on its gear adds to gyros and accelerometers, and the bands without it.

People aboard and wind rock a parked vehicle by up to thousands of times the noise of a ring laser.
A rate is the change of an angle that stays small: it fades as the square of the frequency below the
gear's own, and as fast or faster above it, until nothing is left from GEAR_BELOW_HZ on. What is
more between than on both sides is the vehicle's. Weights that come and go tilt it slowly, too: of a
channel that moves, only what lies above is read.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ins.robust import gamma as gamma_law
from simreal.twin.fit.model import NoiseEstimate, TriadEvidence, band_model, climb
from simreal.twin.fit.spectra import Bands
from simreal.twin.fit.terms import NoiseTerm

# Gears swing at 1 to 2 Hz with a tenth of critical damping (docs/environments.md). In a strong
# breeze a ring laser's rows show 4 % more noise at 12 to 16 Hz, nothing from 16 Hz on; people
# nothing from 8 Hz on (docs/twin_fit.md).
GEAR_BELOW_HZ, SWINGS_BELOW_HZ = 16.0, 8.0
# a turn of 1 Hz has faded to 1/400 here
GEAR_ABOVE_HZ = 0.05
# of a channel beside one that moves, in one cell: of seven cells at rest three in ten are left out
# for nothing, and little of a motion is left in
BESIDE_P = 0.05
FLOOR_SIGMAS = 2.0  # of the white noise outside the gear's frequencies, which 95 % lie within
# of a sway: a channel has less of it where it is within 6 deg of the vertical, sin^2 6 deg = 0.01
SWAYS = 0.01
# of a run at rest, over all its cells: 1 of 100 is taken for a moving one, which costs it the
# cells below 16 Hz
MOVES_P = 0.01
GEAR_EDGES_HZ = (GEAR_ABOVE_HZ, 0.1, 0.2, 0.4, 1.0, 2.0, 4.0, SWINGS_BELOW_HZ)
Gear = frozenset[tuple[int, int]]  # of run and channel
FALLS_SIGMAS = 3.0  # of the ratio of two halves of a band: 0.0013 of flat ones fall as much


def rocked(evidence: TriadEvidence, best: NoiseEstimate) -> Gear:
    """The channels, by run, that show more than what they show outside the gear's frequencies lets
    one expect, with the sway of the best fit (a gyro has none), and more than at the upper end of
    these: a spectrum that falls gently is a filter's. Where a sway does not explain what one
    accelerometer shows, its size is wrong for all that are not vertical.
    """
    floors = {c: _floor(evidence.of((c,)), best) for c in {b.channel for _, b in evidence.bands}}
    cells = [cell for c in floors for cell in _cells(evidence.of((c,)), floors[c])]
    quick = {(c.run, c.channel): max(c.ratio, 1.0) for c in cells}  # the last one of each
    found: set[tuple[int, int]] = set()
    for p_limit, sigmas in ((MOVES_P / max(len(cells), 1), FLOOR_SIGMAS), (BESIDE_P, 0.0)):
        for cell in cells:
            known = float(np.exp(sigmas * floors[cell.channel].sigma(NoiseTerm.WHITE)))
            over = cell.ratio / (known * quick[cell.run, cell.channel])
            if float(gamma_law.sf(over * cell.dof, cell.dof)) < p_limit:
                found.add((cell.run, cell.channel))
        if not found:
            return frozenset()
    if NoiseTerm.SWAY in best.model.terms:
        found |= {(k, b.channel) for k, b in evidence.bands if evidence.share[k][b.channel] > SWAYS}
    return frozenset(found)


def _floor(evidence: TriadEvidence, best: NoiseEstimate) -> NoiseEstimate:
    """The noise of a channel alone, as it shows outside the gear's frequencies."""
    model, x = best.model, best.x
    if NoiseTerm.CREEP in model.terms:
        k = model.terms.index(NoiseTerm.CREEP)
        model, x = model.without(NoiseTerm.CREEP), np.delete(x, k)
    outside = []
    for run, b in evidence.bands:
        inside = (b.centre_hz > GEAR_ABOVE_HZ) & (b.centre_hz < GEAR_BELOW_HZ)
        outside.append((run, replace(b, dof=np.where(inside, 0.0, b.dof))))
    held = list(range(len(model.terms), x.size))
    held += [k for k, term in enumerate(model.terms) if term is NoiseTerm.SWAY]
    return climb(replace(evidence, bands=tuple(outside)), model, x, fixed=held)


def without_gear(evidence: TriadEvidence, gear: Gear) -> TriadEvidence:
    """The evidence with nothing of these channels that a vehicle on its gear reaches. The slow
    means go as well: weights that come and go, and a wind that turns, tilt the vehicle for good.
    """
    kept = []
    for k, b in evidence.bands:
        gone = ((k, b.channel) in gear) & (b.centre_hz < GEAR_BELOW_HZ)
        kept.append((k, replace(b, dof=np.where(gone, 0.0, b.dof))))
    slow = tuple((k, s) for k, s in evidence.slow if (k, s.channel) not in gear)
    return replace(evidence, bands=tuple(kept), slow=slow)


def flat_above(evidence: TriadEvidence) -> bool:
    """Whether what is left, all above the gear's frequencies, falls nowhere, as filtered noise
    would. False where nothing is left.
    """
    ratios = []
    for _, b in evidence.bands:
        used = b.dof > 0
        upper = b.centre_hz > np.median(b.centre_hz[used]) if used.any() else used
        low, high = (float(b.dof[k].sum()) for k in (used & ~upper, used & upper))
        if low > 0.0 and high > 0.0:
            mean = [b.dof[k] @ b.power[k] / b.dof[k].sum() for k in (used & ~upper, used & upper)]
            ratios.append((mean[1] / mean[0] - 1.0) / np.sqrt(1.0 / low + 1.0 / high))
    return bool(ratios) and min(ratios) > -FALLS_SIGMAS


@dataclass(frozen=True)
class _Cell:
    """A band of one channel in one run: power over the expected one, and degrees of freedom."""

    run: int
    channel: int
    low_hz: float
    ratio: float
    dof: float


def _cells(evidence: TriadEvidence, floor: NoiseEstimate) -> Iterator[_Cell]:
    """The cells of one channel."""
    for run in sorted({k for k, _ in evidence.bands}):
        mine = [b for k, b in evidence.bands if k == run]
        share = evidence.share[run]
        hz, ratio, dof = (np.concatenate(c) for c in zip(*_ratios(mine, floor, share)))
        for low, high in pairwise(GEAR_EDGES_HZ):
            inside = (hz >= low) & (hz < high) & (dof > 0)
            total = float(dof[inside].sum())
            if total > 0.0:
                mean = float(ratio[inside] @ dof[inside]) / total
                yield _Cell(run, mine[0].channel, low, mean, total)


def _ratios(
    bands: Sequence[Bands], floor: NoiseEstimate, share: NDArray
) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    for b in bands:
        expected, _ = band_model(floor.model, floor.x, (), b, share)
        yield b.centre_hz, b.power / expected, b.dof
