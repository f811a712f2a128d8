"""twin_fit.json of a fit, the `fit` of its twin, and the same in a few lines for people. Computes
nothing.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from ins.documents import OMIT_NONE, UNWRITTEN
from ins.records import FitDocument, TwinModel
from ins.units import HOUR
from ins.verdicts import Reason, because, sentence, sentences
from simreal.plan.recordings import Recording
from simreal.twin.fit.evidence import AXES_DIFFER_P
from simreal.twin.fit.fit import NoRest
from simreal.twin.fit.gear import GEAR_BELOW_HZ
from simreal.twin.fit.result import ChannelCurve, Needs, Parameter, RunUsed, SpectralLine, TwinFit
from simreal.twin.fit.streams import STILL_AT_LEAST_S
from simreal.twin.reasons import FitNote, FitReason, Lacking, Why

SCHEMA = "recal.twin_fit/1"
FIT_METHOD = (
    "restricted maximum likelihood of slow means with Whittle's of half-overlapping Hann spectra"
)
# of each parameter: what people call it, and its unit
PARAMETER_NAMES = {
    "gyro.arw_deg_sqrt_h": ("angle random walk", "deg/sqrt(h)"),
    "gyro.quantization_rad": ("gyro quantisation", "rad"),
    "gyro.bias_instability_deg_h": ("gyro flicker B", "deg/h"),
    "gyro.rate_random_walk_deg_h_sqrt_h": ("gyro rate random walk", "deg/h/sqrt(h)"),
    "gyro.gauss_markov_deg_h": ("gyro Gauss-Markov", "deg/h"),
    "gyro.gauss_markov_tau_s": ("its correlation time", "s"),
    "gyro.turn_on_deg_h": ("gyro turn-on", "deg/h"),
    "accel.vrw_ug_sqrt_hz": ("velocity random walk", "ug/sqrt(Hz)"),
    "accel.quantization_m_s": ("accelerometer quantisation", "m/s"),
    "accel.bias_instability_ug": ("accelerometer flicker B", "ug"),
    "accel.rate_random_walk_ug_sqrt_h": ("accelerometer random walk", "ug/sqrt(h)"),
    "accel.gauss_markov_ug": ("accelerometer Gauss-Markov", "ug"),
    "accel.gauss_markov_tau_s": ("its correlation time", "s"),
    "accel.turn_on_ug": ("accelerometer turn-on", "ug"),
    "vehicle.sway_m_s": ("sway of the vehicle", "m/s"),
    "vehicle.sway_hz": ("frequency of the sway", "Hz"),
    "vehicle.sway_damping": ("damping of the sway", ""),
    "vehicle.yaw_creep_arcsec_sqrt_h": ("yaw creep", "arcsec/sqrt(h)"),
    "temperature.noise_degC": ("thermometer noise", "degC"),
    "temperature.resolution_degC": ("thermometer resolution", "degC"),
    "gnss.sigma_horizontal_m": ("receiver, horizontal", "m"),
    "gnss.sigma_vertical_m": ("receiver, vertical", "m"),
    "gnss.sigma_velocity_m_s": ("receiver, velocity", "m/s"),
    "odometer.noise_m_s": ("wheels", "m/s"),
}


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
    """The document of a fit of runs that rest: refused where they tell none of its numbers."""
    nothing_told = because(
        FitReason.NOTHING_TOLD, rest_min=found.parked_s / 60.0, of=len(found.parameters)
    )
    return FitReport(
        verdict="fitted" if found.tells_any else "refused",
        reasons=() if found.tells_any else sentences([nothing_told]),
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
        notes=sentences(_notes(found)),
        found=found,
    )


def no_rest_document(found: NoRest, believed: TwinModel, serial: str, version: str) -> FitReport:
    """The document of a fit of runs that never rest."""
    never_rests = because(
        FitReason.NEVER_RESTS, run_ids=[r.run_id for r in found.runs], needed_s=STILL_AT_LEAST_S
    )
    return FitReport(
        verdict="refused",
        reasons=sentences([never_rests]),
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
        "not_identified": {
            p.name: why_not_estimated(p) for p in found.parameters if not p.identified
        },
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
        f"{d.imu_serial}: {d.verdict} from {len(d.runs)} run{'s' if len(d.runs) > 1 else ''},"
        f" {hours:.2g} h at rest: {known} of {len(d.parameters)} parameters estimated",
        *(f"  because {why}" for why in d.reasons),
    ]
    for p in d.found.parameters:
        name = PARAMETER_NAMES[p.name][0]
        lacks = would_tell(p)
        tail = "" if p.identified else f" ({WORDS_SHORT}{'; ' + lacks if lacks else ''})"
        lines.append(f"  {name:28s}{size_words(p)}{tail}")
    lines += [f"  note: {note}" for note in d.notes]
    return lines


WORDS_SHORT = "not observable in these runs"


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
        text=why_not_estimated(p),
        needs=p.needs,
        needed_s=_needed(p, Needs.PARKED_SECONDS),
        needed_runs=_needed(p, Needs.RUNS),
    )


def _needed(p: Parameter, needs: Needs) -> float | None:
    return _finite(p.needed) if p.needs is needs else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _notes(found: TwinFit) -> list[Reason]:
    """What a reader must know of the fit."""
    parts = {p.name.split(".")[0] for p in found.parameters if p.why is Why.CONTRADICTED}
    against = parts - {"vehicle"}
    notes = [because(FitNote.CONTRADICTED, triad=triad) for triad in sorted(against)]
    notes += [
        because(FitNote.FILTERED, triad=triad, hz=hz) for triad, hz in found.read_below_hz.items()
    ]
    moved = [name for name in found.read_above_hz if name.split("_")[0] not in against]
    if moved:
        notes.append(because(FitNote.ROCKED, channels=moved, hz=GEAR_BELOW_HZ))
    notes += _flicker_notes(found)
    for triad, p in found.axes_alike_p.items():
        if p < AXES_DIFFER_P and triad not in against:
            sizes = {k[-1]: v for k, v in found.axis_white.items() if k.startswith(triad)}
            notes.append(because(FitNote.AXES_DIFFER, triad=triad, sizes=sizes))
    if found.of("vehicle.yaw_creep_arcsec_sqrt_h").identified:
        notes.append(because(FitNote.YAW_OR_GYRO))
    if found.lines:
        notes.append(_lines_note(found))
    silent = [r.run_id for r in found.runs if r.parked_s == 0.0]
    if silent:
        notes.append(because(FitNote.RUNS_NOT_USED, run_ids=silent))
    return notes


def _flicker_notes(found: TwinFit) -> list[Reason]:
    """Flicker that stands for a Gauss-Markov process."""
    gyro, accel = found.twin.gyro.bias_instability_deg_h, found.twin.accel.bias_instability_ug
    told = {p.name for p in found.parameters if p.identified}
    notes = []
    if "gyro.gauss_markov_deg_h" in told:
        notes.append(because(FitNote.FLICKER_FOR_MARKOV, triad="gyro", size=gyro, unit="deg/h"))
    if "accel.gauss_markov_ug" in told:
        notes.append(
            because(FitNote.FLICKER_FOR_MARKOV, triad="accelerometer", size=accel, unit="ug")
        )
    return notes


def _lines_note(found: TwinFit) -> Reason:
    """The lines that are no noise, with the largest of them."""
    worst = max(found.lines, key=_loudness)
    return because(
        FitNote.LINES_LEFT_OUT,
        count=len(found.lines),
        channels=len({line.channel for line in found.lines}),
        frequency_hz=worst.frequency_hz,
        channel=worst.channel,
        amplitude=worst.amplitude,
        unit="rad/s" if worst.channel.startswith("gyro") else "m/s^2",
    )


def why_not_estimated(p: Parameter) -> str:
    """Why a parameter is not observable, and what it needs; empty where it is estimated."""
    if p.why is None:
        return ""
    said = f"not observable in these runs: {p.why.template}"
    lacks = would_tell(p)
    return f"{said}; {lacks}" if lacks else said


def would_tell(p: Parameter) -> str:
    """The recording that would tell a parameter, as `recal plan` names it; empty where none is
    sought.
    """
    if p.needs is Needs.NOTHING:
        return ""
    if p.needs is Needs.RUNS:
        each = Recording(hours=0.5).words
        return sentence(because(Lacking.POWER_ONS, count=p.needed, recording=each))
    if not math.isfinite(p.needed):
        return sentence(because(Lacking.NO_RECORDING))
    asked = Recording(start="ambient", hours=round(p.needed / HOUR, 1) or 0.1)
    return sentence(because(Lacking.RECORDING, recording=asked.words))


def size_words(p: Parameter) -> str:
    """The value with its interval, or the limit."""
    unit = PARAMETER_NAMES[p.name][1]
    tail = f" {unit}" if unit else ""
    if p.identified:
        return f"{p.value:.4g} +- {p.sigma:.2g}{tail}"
    limit = f", below {p.high:.3g}" if math.isfinite(p.high) else ""
    return f"{p.value:.3g}{tail} assumed{limit}"


def _loudness(line: SpectralLine) -> float:
    """Amplitude, comparable between gyros and accelerometers: a rad/s counts as 1001 m/s^2."""
    return line.amplitude if line.channel.startswith("gyro") else line.amplitude / 1001.0
