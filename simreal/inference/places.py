"""Where the gap lies: channel, phase, band, time and temperature of what was found and of what is
left.

The parked stretch and what follows it are asked apart: a found effect is placed in a phase only
where it makes the rows of that phase likelier, so that an error of the drive never shows in a
parked stretch that is clean (effects.md, section 3.3).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.errors.telemetry import AIRBORNE, PARKED, ROLLING
from simreal.evidence.whitened import CHANNELS, Evidence
from simreal.inference.attribute import Attribution, Slot
from simreal.inference.locate import Cell, CellTable
from simreal.inference.noise_hypotheses import NoiseHypothesis, term_of
from simreal.inference.scoring import fit

MOST_PLACES = 8
SPAN = (0.05, 0.95)  # of the energy, for the stretch of time and temperature that a place names
LEAST_SHARE = 0.02  # of the gap, for a channel to be named; chosen: as TOUCHED of addback, 1/50
# twice the log likelihood that a phase gains by what was found: 1 % of squares of N(0, 1) lie
# beyond
LEAST_PHASE_GAIN = 6.6
PHASE_OF_MOTION = {PARKED: "extended_alignment", ROLLING: "taxi", AIRBORNE: "flight"}
BAND_OF_ROWS_HZ = (0.0, 0.5)  # of rows a second apart
Key = tuple[int, bool]  # a channel's number, and whether it is what follows the parked stretch


@dataclass(frozen=True)
class Place:
    """Where a part of the gap lies; share of the total excess. temperature: None where there is
    none.
    """

    channel: str
    phase: str
    temperature_degC: tuple[float, float] | None
    frequency_hz: tuple[float, float]
    time_s: tuple[float, float]
    share: float


@dataclass
class _Found:
    """Energy by channel and phase, by cell of the parked sensors, and the rows that were
    explained.
    """

    energy: dict[Key, float]
    by_cell: NDArray
    explained: NDArray

    def add(self, key: Key, energy: float) -> None:
        if energy > 0.0:
            self.energy[key] = self.energy.get(key, 0.0) + energy


def places(attribution: Attribution, cells: CellTable, after: CellTable) -> tuple[Place, ...]:
    """Channels and phases by their share of the gap, with band, time and temperature.

    A found effect counts where it enters: on its target if that is a channel (a gyro's drift also
    shows in GNSS), else on the channels that hold its energy. What is left counts in the cells that
    still stand out.
    """
    found = _Found({}, np.zeros(len(cells.cells)), np.zeros(attribution.evidence.size))
    signatures = [
        (slot, _signature(attribution, slot)) for slot in attribution.slots if slot.extra is None
    ]
    for _, signature in signatures:
        found.explained += signature
    likelier = _phases_gaining(attribution.evidence, found.explained)
    for slot, signature in signatures:
        _enter_signature(attribution, found, cells, slot, signature, likelier)
    for slot in attribution.slots:
        if slot.extra is not None:
            share = 2.0 * max(slot.log_odds, 0.0) * _noise_cells(attribution, slot, cells)
            _enter_cells(found, cells, share)
    left = after if attribution.slots else cells
    _enter_cells(found, cells, np.where(left.located, 2.0 * np.maximum(left.nats, 0.0), 0.0))
    total = sum(found.energy.values())
    named = [
        _place(attribution.evidence, found, cells, key, energy / total)
        for key, energy in found.energy.items()
        if energy > LEAST_SHARE * total
    ]
    return tuple(sorted(named, key=lambda p: -p.share)[:MOST_PLACES])


def _phases_gaining(evidence: Evidence, explained: NDArray) -> dict[bool, bool]:
    """Whether the rows of the parked stretch, and those that follow, are likelier with what was
    found.
    """
    gain = 2.0 * evidence.z * explained - explained**2
    by_phase = {moving: float(gain[evidence.followed == moving].sum()) for moving in (False, True)}
    least = max(LEAST_PHASE_GAIN, LEAST_SHARE * max(by_phase.values()))
    return {moving: value > least for moving, value in by_phase.items()}


def _enter_signature(
    attribution: Attribution,
    found: _Found,
    cells: CellTable,
    slot: Slot,
    signature: NDArray,
    likelier: dict[bool, bool],
) -> None:
    evidence = attribution.evidence
    rows, target = evidence.rows, slot.hypothesis.target
    # as a target it is the vehicle, as a channel its side slip
    own = CHANNELS.index(target) if target in CHANNELS and target != "vehicle" else None
    for moving in (False, True):
        if not likelier[moving] and any(likelier.values()):
            continue
        phase = evidence.followed == moving
        square = np.where(phase, signature**2, 0.0)
        energy = np.bincount(rows.channel, square, minlength=len(CHANNELS))
        if own is not None:
            found.add((own, moving), float(energy.sum()))
            continue
        for channel in np.flatnonzero(energy):
            found.add((int(channel), moving), float(energy[channel]))
    squares = attribution.squares
    ratio = squares.ratio(signature[:, None])[:, 0]
    for quick in squares.quick.values():
        ratio[quick] = 0.0
    found.by_cell += [float((squares.dof[c.index] * ratio[c.index]).sum()) for c in cells.cells]


def _enter_cells(found: _Found, cells: CellTable, energy: NDArray) -> None:
    found.by_cell += energy
    for cell, value in zip(cells.cells, energy):
        found.add((CHANNELS.index(cell.channel), cell.moving), float(value))


def _signature(attribution: Attribution, slot: Slot) -> NDArray:
    """Whitened rows of one found effect as fitted with the others."""
    columns = attribution.columns
    beta, _ = fit(attribution.bank, columns)
    return attribution.bank.signature(slot.columns, beta[np.isin(columns, slot.columns)])


def _noise_cells(attribution: Attribution, slot: Slot, cells: CellTable) -> NDArray:
    """Shares of the cells (k,) in what a found noise changes."""
    factor = np.zeros(attribution.plain_squares.dof.size)
    h = slot.hypothesis
    assert isinstance(h, NoiseHypothesis) and slot.extra is not None
    term = term_of(
        attribution.plain_evidence,
        attribution.plain_squares,
        h.effect,
        h.target,
        dict(slot.extra.shape),
        h.run,
    )
    factor[term.index] = np.abs(slot.extra.square) * term.factor
    dof = attribution.plain_squares.dof
    change = np.array([float((dof[c.index] * factor[c.index] ** 2).sum()) for c in cells.cells])
    return np.asarray(change / max(change.sum(), 1e-300))


def _place(evidence: Evidence, found: _Found, cells: CellTable, key: Key, share: float) -> Place:
    number, moving = key
    rows = evidence.rows
    phase = evidence.followed == moving
    at = np.flatnonzero(phase & (rows.channel == number))
    if moving and not np.any(found.explained[at]):
        at = np.flatnonzero(phase & (found.explained != 0.0)) if not at.size else at
    weight = found.explained[at] ** 2
    if not weight.any():
        weight = evidence.z[at] ** 2
    if at.size:
        kind = int(np.bincount(rows.kind[at], weights=weight, minlength=3).argmax())
        inside = rows.kind[at] == kind
        span = _span(rows.time_s[at][inside], weight[inside]) or (0.0, 0.0)
        T = rows.temperature_degC[at][inside]
        warm = _span(T[np.isfinite(T)], weight[inside][np.isfinite(T)])
    else:  # a channel without rows: the thermometer
        span, kind, warm = (evidence.views[0].start_s, evidence.views[0].end_s), PARKED, None
    return Place(
        CHANNELS[number],
        _phase_name(evidence, kind, span),
        warm,
        _band(found, cells, key),
        span,
        share,
    )


def _band(found: _Found, cells: CellTable, key: Key) -> tuple[float, float]:
    """From the lowest to the highest frequency of the cells that hold a tenth of the largest."""
    number, moving = key
    own = [
        k
        for k, c in enumerate(cells.cells)
        if c.moving == moving and c.channel == CHANNELS[number] and found.by_cell[k] > 0.0
    ]
    if not own:
        return BAND_OF_ROWS_HZ
    largest = max(found.by_cell[k] for k in own)
    used: list[Cell] = [cells.cells[k] for k in own if found.by_cell[k] > 0.1 * largest]
    high = max(min(c.frequency_hz[1], 1e3) for c in used)
    return float(min(c.frequency_hz[0] for c in used)), float(high)


def _span(values: NDArray, weights: NDArray) -> tuple[float, float] | None:
    if not values.size or not weights.sum() > 0:
        return None
    order = np.argsort(values)
    total = np.cumsum(weights[order]) / weights.sum()
    a, b = np.searchsorted(total, SPAN)
    return float(values[order][min(a, values.size - 1)]), float(
        values[order][min(b, values.size - 1)]
    )


def _phase_name(evidence: Evidence, kind: int, span: tuple[float, float]) -> str:
    """The logged phase that holds the middle of the span, else the kind of motion in words of
    formats.md.
    """
    middle = 0.5 * (span[0] + span[1])
    for view in evidence.views:
        for phase in view.run.phases:
            if phase.start_s <= middle <= phase.end_s:
                return str(phase.phase)
    if kind == PARKED and not any(v.run.phases for v in evidence.views):
        return "parked"
    return PHASE_OF_MOTION[kind]
