"""twin_check.json of a check, a field a key, and the same in one line and in a few."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ins.records import TwinModel
from simreal.twin.fit.agreement import TOLERATED, Agreement, NoiseCell, Of

TOO_LITTLE = "the runs hold too little rest to judge the noise model: needed 6 min at rest"


SCHEMA = "recal.twin_check/1"


@dataclass(frozen=True, kw_only=True)
class TwinCheck:
    """The document of a check; cells: bands of channels; text: in one line."""

    schema: str = SCHEMA
    verdict: str
    reasons: Sequence[str]
    version: str
    imu_serial: str
    noise_model: str
    runs: Sequence[str]
    parked_s: float
    p_value: float | None
    tolerated: float
    cells: Sequence[NoiseCell]
    text: str


def twin_check_document(
    found: Agreement | None, twin: TwinModel, runs: Sequence[str], *, command: str, version: str
) -> TwinCheck:
    """The document of a check; command: what would mend a twin that does not fit."""
    verdict = "refused" if found is None else "ok" if found.fits else "inconsistent"
    return TwinCheck(
        verdict=verdict,
        reasons=[TOO_LITTLE] if found is None else [cell_words(c) for c in found.misfits],
        version=version,
        imu_serial=twin.imu_serial,
        noise_model=twin.source,
        runs=list(runs),
        parked_s=0.0 if found is None else found.parked_s,
        p_value=None if found is None else found.p_value,
        tolerated=TOLERATED,
        cells=() if found is None else found.cells,
        text=TOO_LITTLE if found is None else agreement_line(found, command),
    )


def agreement_line(found: Agreement, command: str) -> str:
    """A check in one line, with the command that would mend what does not fit."""
    bad = found.misfits
    if not bad:
        return f"the noise model fits these runs (p value {found.p_value:.2g})"
    own = sum(c.of is Of.SENSOR for c in found.cells)
    return (
        f"the noise model does not fit these runs in {len(bad)} of {own} bands, worst"
        f" {cell_words(bad[0])}; {command} measures it"
    )


def cell_words(c: NoiseCell) -> str:
    """A cell: its size over the declared one."""
    size = math.sqrt(max(c.ratio, 0.0))
    low, high = c.frequency_hz
    where = f"below {high:g} Hz" if low == 0.0 else f"{low:g} to {high:g} Hz"
    return f"{c.channel} {where}: {size:.2g} times the declared noise"


def summary(d: TwinCheck, *, verbose: bool = False) -> list[str]:
    """The check in a few lines for people."""
    lines = [f"{', '.join(d.runs)}: {d.text}"]
    for c in d.cells:
        if verbose or not c.fits:
            kind = "" if c.of is Of.SENSOR else " (the vehicle moves there)"
            low, high = c.frequency_hz
            lines.append(
                f"  {c.channel:8s}{low:8.3g} to {high:6.3g} Hz  {math.sqrt(max(c.ratio, 0.0)):6.3g}"
                f" times the declared noise, p {c.p_value:.2g}{kind}"
            )
    return lines
