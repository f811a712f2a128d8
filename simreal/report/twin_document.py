"""twin_fit.json of a fit, the `fit` of its twin, and the same in a few lines for people. Computes
nothing.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from ins.documents import OMIT_NONE, UNWRITTEN
from ins.records import FitDocument, TwinModel
from simreal.report.twin_words import PARAMETER_NAMES, YAW_NOTE, needs_words, size_words, why_words
from simreal.twin.fit.evidence import AXES_DIFFER_P
from simreal.twin.fit.fit import NoRest
from simreal.twin.fit.gear import GEAR_BELOW_HZ
from simreal.twin.fit.result import (
    ChannelCurve,
    Needs,
    Parameter,
    RunUsed,
    SpectralLine,
    TwinFit,
    Why,
)
from simreal.twin.fit.streams import STILL_AT_LEAST_S

SCHEMA = "recal.twin_fit/1"
FIT_METHOD = (
    "restricted maximum likelihood of slow means with Whittle's of half-overlapping Hann spectra"
)
CONTRADICTED = (
    "the data contradict any model of the {triad} noise by far: filtered by the logger, shaken by"
    " what the model does not know, or a rest too short; its numbers stay what they were"
)
FILTERED = (
    "a filter takes noise out of the {triad} rows at high frequencies; their white noise is read"
    " below {hz:.3g} Hz, where it takes out next to nothing"
)
ROCKED = (
    "people or wind move the vehicle on its gear: of {channels} only the rows' noise above {hz:g}"
    " Hz is read; the rest rests on the other channels"
)
FLICKER_FOR_MARKOV = (
    "the twin knows no Gauss-Markov process; its {triad} flicker is set to {size:.3g} {unit}, which"
    " covers the process that was found"
)
DIFFERENT = (
    "the white noise of the {triad} axes differs ({sizes}); the twin has their root mean square"
)


@dataclass(frozen=True, kw_only=True)
class TwinParameter:
    """One number of the twin; interval_95: the upper end is a one-sided limit where not identified;
    nats: log likelihood against none of it; needed_s, needed_runs: what would identify it.
    """

    name: str
    words: str
    unit: str
    value: float
    sigma: float
    interval_95: Sequence[float]
    identified: bool
    believed: float
    seconds: float
    nats: float | None
    why: Why | None
    text: str
    needs: Needs
    needed_s: float | None
    needed_runs: float | None


@dataclass(frozen=True, kw_only=True)
class FitReport:
    """The document of a fit: a field is a key; found: what a page is drawn from."""

    schema: str = SCHEMA
    verdict: str
    reasons: Sequence[str]
    version: str
    method: str = FIT_METHOD
    imu_serial: str
    gyro_technology: str
    start: str
    runs: Sequence[RunUsed]
    parked_s: float
    parameters: Sequence[TwinParameter]
    channels: Sequence[ChannelCurve]
    lines: Sequence[SpectralLine]
    axes_alike_p: Mapping[str, float]
    vehicle_share: Mapping[str, float]
    windows_left_out: Mapping[str, float]
    read_below_hz: Mapping[str, float] = field(default_factory=dict)
    read_above_hz: Mapping[str, float] = field(default_factory=dict)
    notes: Sequence[str]
    found: TwinFit | None = field(default=None, metadata=UNWRITTEN)
    twin: str | None = field(default=None, metadata=OMIT_NONE)


def twin_fit_document(found: TwinFit, believed: TwinModel, version: str) -> FitReport:
    """The document of a fit that found something."""
    return FitReport(
        verdict="fitted",
        reasons=(),
        version=version,
        imu_serial=found.twin.imu_serial,
        gyro_technology=found.twin.gyro_technology,
        start=believed.source,
        runs=found.runs,
        parked_s=found.parked_s,
        parameters=[_parameter(p) for p in found.parameters],
        channels=found.channels,
        lines=found.lines,
        axes_alike_p=found.axes_alike_p,
        vehicle_share=found.vehicle_share,
        windows_left_out=found.windows_left_out,
        read_below_hz=found.read_below_hz,
        read_above_hz=found.read_above_hz,
        notes=_notes(found),
        found=found,
    )


def no_rest_document(found: NoRest, believed: TwinModel, serial: str, version: str) -> FitReport:
    """The document of a fit of runs that never rest."""
    names = ", ".join(r.run_id for r in found.runs)
    return FitReport(
        verdict="refused",
        reasons=[f"{names}: never at rest for {STILL_AT_LEAST_S:.0f} s; needed a parked stretch"],
        version=version,
        imu_serial=serial,
        gyro_technology=believed.gyro_technology,
        start=believed.source,
        runs=found.runs,
        parked_s=0.0,
        parameters=(),
        channels=(),
        lines=(),
        axes_alike_p={},
        vehicle_share={},
        windows_left_out={},
        notes=(),
    )


def fitted_twin(found: TwinFit) -> TwinModel:
    """The twin with what its numbers rest on."""
    known = [found.of(name) for name in found.names]
    fit: FitDocument = {
        "parameters": list(found.names),
        "values": [p.value for p in known],
        "sigma": [_finite(p.sigma) for p in known],
        "interval_95": [[_finite(p.low), _finite(p.high)] for p in known],
        "covariance": found.covariance.tolist(),
        "identified": [p.identified for p in known],
        "seconds": [p.seconds for p in known],
        "needed_s": [_needed(p, Needs.PARKED_SECONDS) for p in known],
        "needed_runs": [_needed(p, Needs.RUNS) for p in known],
        "not_identified": {p.name: why_words(p) for p in found.parameters if not p.identified},
        "lines": [
            {
                "channel": line.channel,
                "frequency_hz": line.frequency_hz,
                "amplitude": line.amplitude,
                "swing": line.swing,
            }
            for line in found.lines
        ],
        "axes": [
            {"channel": channel, "white": white, "quantization": counts}
            for channel, (white, counts) in found.axes.items()
        ],
        "read_below_hz": dict(found.read_below_hz),
        "runs": [r.sha256 for r in found.runs],
        "method": FIT_METHOD,
    }
    return replace(found.twin, fit=fit)


def summary(d: FitReport) -> list[str]:
    """The fit in a few lines for people."""
    if d.found is None:
        return [f"{d.imu_serial}: {d.verdict}", *(f"  because {why}" for why in d.reasons)]
    known = sum(p.identified for p in d.parameters)
    hours = d.parked_s / 3600.0
    lines = [
        f"{d.imu_serial}: fitted from {len(d.runs)} run{'s' if len(d.runs) > 1 else ''},"
        f" {hours:.2g} h at rest: {known} of {len(d.parameters)} parameters told"
    ]
    for p in d.found.parameters:
        name = PARAMETER_NAMES[p.name][0]
        lacks = needs_words(p)
        tail = "" if p.identified else f" ({WORDS_SHORT}{'; ' + lacks if lacks else ''})"
        lines.append(f"  {name:28s}{size_words(p)}{tail}")
    lines += [f"  note: {note}" for note in d.notes]
    return lines


WORDS_SHORT = "not told by these runs"


def _parameter(p: Parameter) -> TwinParameter:
    words, unit = PARAMETER_NAMES[p.name]
    return TwinParameter(
        name=p.name,
        words=words,
        unit=unit,
        value=p.value,
        sigma=p.sigma,
        interval_95=(p.low, p.high),
        identified=p.identified,
        believed=p.believed,
        seconds=p.seconds,
        nats=p.nats,
        why=p.why,
        text=why_words(p),
        needs=p.needs,
        needed_s=_needed(p, Needs.PARKED_SECONDS),
        needed_runs=_needed(p, Needs.RUNS),
    )


def _needed(p: Parameter, needs: Needs) -> float | None:
    return _finite(p.needed) if p.needs is needs else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _notes(found: TwinFit) -> list[str]:
    parts = {p.name.split(".")[0] for p in found.parameters if p.why is Why.CONTRADICTED}
    against = parts - {"vehicle"}
    notes = [CONTRADICTED.format(triad=triad) for triad in sorted(against)]
    notes += [FILTERED.format(triad=k, hz=hz) for k, hz in found.read_below_hz.items()]
    moved = [name for name in found.read_above_hz if name.split("_")[0] not in against]
    if moved:
        notes.append(ROCKED.format(channels=", ".join(moved), hz=GEAR_BELOW_HZ))
    told = {p.name for p in found.parameters if p.identified}
    if "gyro.gauss_markov_deg_h" in told:
        size = found.twin.gyro.bias_instability_deg_h
        notes.append(FLICKER_FOR_MARKOV.format(triad="gyro", size=size, unit="deg/h"))
    if "accel.gauss_markov_ug" in told:
        size = found.twin.accel.bias_instability_ug
        notes.append(FLICKER_FOR_MARKOV.format(triad="accelerometer", size=size, unit="ug"))
    for triad, p in found.axes_alike_p.items():
        if p < AXES_DIFFER_P and triad not in against:
            own = {k: v for k, v in found.axis_white.items() if k.startswith(triad)}
            sizes = ", ".join(f"{name[-1]} {value:.3g}" for name, value in own.items())
            notes.append(DIFFERENT.format(triad=triad, sizes=sizes))
    if found.of("vehicle.yaw_creep_arcsec_sqrt_h").identified:
        notes.append(YAW_NOTE)
    if found.lines:
        worst = max(found.lines, key=_loudness)
        channels = len({line.channel for line in found.lines})
        unit = "rad/s" if worst.channel.startswith("gyro") else "m/s^2"
        notes.append(
            f"{len(found.lines)} lines of dither or engines on {channels} channels are left out of"
            f" the noise, such as {worst.frequency_hz:.4g} Hz on {worst.channel},"
            f" amplitude {worst.amplitude:.2g} {unit}; the twin lists them for recal"
            " diagnose"
        )
    silent = [r.run_id for r in found.runs if r.parked_s == 0.0]
    if silent:
        notes.append(f"never at rest, not used: {', '.join(silent)}")
    return notes


def _loudness(line: SpectralLine) -> float:
    """Amplitude, comparable between gyros and accelerometers: a rad/s counts as 1001 m/s^2."""
    return line.amplitude if line.channel.startswith("gyro") else line.amplitude / 1001.0
