"""What a fit of a twin found: parameters with sigmas, what each rests on, and curves to draw. Its
fields and properties are the keys of twin_fit.json.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ins.documents import UNWRITTEN, written
from ins.records import FitDocument, TwinModel
from ins.units import HOUR
from ins.verdicts import Reason, because, sentence, sentences
from simreal.twin.fit.evidence import AXES_DIFFER_P
from simreal.twin.fit.gear import GEAR_BELOW_HZ
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


class Needs(StrEnum):
    """The unit of what a recording lacks."""

    PARKED_SECONDS = "parked_s"
    RUNS = "runs"
    NOTHING = ""


@written(
    "name words unit value sigma interval_95 identified believed seconds nats why text needs"
    " needed_s needed_runs"
)
@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number of a twin.

    name: section and key; value, sigma: of the twin that is written; low, high: 95 % (one-sided
    limit in `high` where not identified); believed: before; seconds: parked time that it rests on;
    why: code where not identified; needed: how much of `needs` in one recording would identify it
    (infinite: none of a week).
    """

    name: str
    value: float
    sigma: float
    low: float
    high: float
    believed: float
    seconds: float
    nats: float | None = None
    why: Why | None = None
    needs: Needs = Needs.NOTHING
    needed: float = float("nan")

    @property
    def identified(self) -> bool:
        return self.why is None

    @property
    def words(self) -> str:
        """What people call it."""
        return PARAMETER_NAMES[self.name][0]

    @property
    def unit(self) -> str:
        return PARAMETER_NAMES[self.name][1]

    @property
    def interval_95(self) -> tuple[float, float]:
        return self.low, self.high

    @property
    def needed_s(self) -> float | None:
        return _finite(self.needed) if self.needs is Needs.PARKED_SECONDS else None

    @property
    def needed_runs(self) -> float | None:
        return _finite(self.needed) if self.needs is Needs.RUNS else None

    @property
    def text(self) -> str:
        """Why it is not observable, and what it needs; empty where it is estimated."""
        if self.why is None:
            return ""
        said = f"not observable in these runs: {self.why.template}"
        return f"{said}; {self.lacks}" if self.lacks else said

    @property
    def lacks(self) -> str:
        """The recording that would tell it, as `recal plan` names it; empty where none is
        sought.
        """
        from simreal.plan.recordings import Recording  # with the simulator behind it

        if self.needs is Needs.NOTHING:
            return ""
        if self.needs is Needs.RUNS:
            each = Recording(hours=0.5).words
            return sentence(because(Lacking.POWER_ONS, count=self.needed, recording=each))
        if not math.isfinite(self.needed):
            return sentence(because(Lacking.NO_RECORDING))
        asked = Recording(start="ambient", hours=round(self.needed / HOUR, 1) or 0.1)
        return sentence(because(Lacking.RECORDING, recording=asked.words))

    @property
    def size_words(self) -> str:
        """The value with its interval, or the limit."""
        tail = f" {self.unit}" if self.unit else ""
        if self.identified:
            return f"{self.value:.4g} +- {self.sigma:.2g}{tail}"
        limit = f", below {self.high:.3g}" if math.isfinite(self.high) else ""
        return f"{self.value:.3g}{tail} assumed{limit}"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


@dataclass(frozen=True, kw_only=True)
class ChannelCurve:
    """A channel's spectrum and Allan deviation, of the data and of the fitted model (SI units).

    white: of this axis, where its triad's differ. power, power_model (b,): two-sided spectrum
    [unit^2/Hz], dof (b,) behind each power; tau_s, allan, allan_model (k,), allan_low, allan_high
    (k,): 95 % of what the model leads one to expect.
    """

    channel: str
    p_value: float
    white: float | None = None
    frequency_hz: NDArray
    power: NDArray
    power_model: NDArray
    dof: NDArray
    tau_s: NDArray
    allan: NDArray
    allan_model: NDArray
    allan_low: NDArray
    allan_high: NDArray


@dataclass(frozen=True, kw_only=True)
class SpectralLine:
    """A line of dither or of an engine; amplitude in rad/s or m/s^2; swing: amplitude of the angle
    [rad] or velocity [m/s] whose changes the rows are.
    """

    channel: str
    frequency_hz: float
    amplitude: float
    sigma: float
    swing: float = field(metadata=UNWRITTEN)


@dataclass(frozen=True, kw_only=True)
class RunUsed:
    """A run of a fit; parked_s: at rest and still."""

    run_id: str
    sha256: str
    parked_s: float


@written(
    "schema verdict reasons version method imu_serial=twin.imu_serial"
    " gyro_technology=twin.gyro_technology start runs parked_s parameters channels lines"
    " axes_alike_p vehicle_share windows_left_out read_below_hz read_above_hz notes"
)
@dataclass(frozen=True, kw_only=True)
class TwinFit:
    """A fitted twin; start: what was believed; version: of the program. Without parameters where no
    run rests.

    covariance: of the parameters `names`; axes_alike_p: per triad the p-value that its axes are
    alike; axis_white: the white noise of each channel; axes: of each channel the variances of its
    white noise and of its quantisation over those of the twin, where its triad's differ;
    vehicle_share: largest share of a band of a gyro that the vehicle made; read_below_hz: of each
    triad whose rows a filter has smoothed, the frequency up to which they were read; read_above_hz:
    of channels that people or wind move, the frequency below which nothing was read in one of the
    runs.
    """

    schema: str = SCHEMA
    version: str = ""
    method: str = FIT_METHOD
    start: str
    twin: TwinModel
    parameters: tuple[Parameter, ...] = ()
    names: tuple[str, ...] = ()
    covariance: NDArray = field(default_factory=lambda: np.zeros((0, 0)))
    channels: tuple[ChannelCurve, ...] = ()
    lines: tuple[SpectralLine, ...] = ()
    runs: tuple[RunUsed, ...]
    axes_alike_p: Mapping[str, float] = field(default_factory=dict)
    axis_white: Mapping[str, float] = field(default_factory=dict)
    axes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    vehicle_share: Mapping[str, float] = field(default_factory=dict)
    windows_left_out: Mapping[str, float] = field(default_factory=dict)
    parked_s: float = 0.0
    read_below_hz: Mapping[str, float] = field(default_factory=dict)
    read_above_hz: Mapping[str, float] = field(default_factory=dict)

    @property
    def tells_any(self) -> bool:
        """Whether any number of the gyros or accelerometers is told; a thermometer's makes no
        twin.
        """
        sensors = ("gyro.", "accel.")
        return any(p.identified for p in self.parameters if p.name.startswith(sensors))

    def of(self, name: str) -> Parameter:
        """The parameter of a name."""
        return next(p for p in self.parameters if p.name == name)

    @property
    def verdict(self) -> str:
        """Refused where no run rests, or what rests tells none of the numbers."""
        return "fitted" if self.tells_any else "refused"

    @property
    def reasons(self) -> list[str]:
        """Why it is refused."""
        if self.tells_any:
            return []
        of, rest_min = len(self.parameters), self.parked_s / 60.0
        why = because(FitReason.NOTHING_TOLD, rest_min=rest_min, of=of)
        if not self.parameters:
            run_ids = [run.run_id for run in self.runs]
            why = because(FitReason.NEVER_RESTS, run_ids=run_ids, needed_s=STILL_AT_LEAST_S)
        return sentences([why])

    @cached_property
    def notes(self) -> list[str]:
        """What a reader must know of the fit."""
        return sentences(_notes(self)) if self.parameters else []


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


def _loudness(line: SpectralLine) -> float:
    """Amplitude, comparable between gyros and accelerometers: a rad/s counts as 1001 m/s^2."""
    return line.amplitude if line.channel.startswith("gyro") else line.amplitude / 1001.0


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
        "needed_s": [p.needed_s for p in known],
        "needed_runs": [p.needed_runs for p in known],
        "not_identified": {p.name: p.text for p in found.parameters if not p.identified},
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
