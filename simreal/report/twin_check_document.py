"""twin_check.json of a check, and the same in one line and in a few. Computes nothing."""

import math
from collections.abc import Sequence

from ins.records import TwinModel
from simreal.report.twin_records import CellRecord, TwinCheckRecord
from simreal.twin.fit.agreement import MISFIT_P, TOLERATED, Agreement, BandPower, Of

TOO_LITTLE = "the runs hold too little rest to judge the noise model: needed 6 min at rest"


def twin_check_document(
    found: Agreement | None, twin: TwinModel, runs: Sequence[str], *, command: str, version: str
) -> TwinCheckRecord:
    """The document of a check; command: what would mend a twin that does not fit."""
    cells = () if found is None else found.cells
    verdict = "refused" if found is None else "ok" if found.fits else "inconsistent"
    count = sum(c.of is Of.SENSOR for c in cells)
    return TwinCheckRecord(
        verdict=verdict,
        reasons=[TOO_LITTLE] if found is None else [cell_words(c) for c in found.misfits],
        version=version,
        imu_serial=twin.imu_serial,
        noise_model=twin.source,
        runs=list(runs),
        parked_s=0.0 if found is None else found.parked_s,
        p_value=None if found is None else found.p_value,
        tolerated=TOLERATED,
        cells=[
            CellRecord(
                channel=c.channel,
                frequency_hz=(c.low_hz, c.high_hz),
                ratio=c.ratio,
                dof=c.dof,
                p_value=c.p_value,
                of=c.of,
                fits=c.p_value * count >= MISFIT_P,
            )
            for c in cells
        ],
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


def cell_words(c: BandPower) -> str:
    """A cell: its size over the declared one."""
    size = math.sqrt(max(c.ratio, 0.0))
    where = f"below {c.high_hz:g} Hz" if c.low_hz == 0.0 else f"{c.low_hz:g} to {c.high_hz:g} Hz"
    return f"{c.channel} {where}: {size:.2g} times the declared noise"


def summary(d: TwinCheckRecord, *, verbose: bool = False) -> list[str]:
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
