"""A twin from a unit's own parked logs: the spine.

Streams at rest -> spectra and slow means -> one likelihood a triad -> what can be told of each
term, with the other sensors and the spread between runs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import ThermalTable
from ins.earth import EARTH_RATE_RAD_S
from ins.noise import FLICKER_FLOOR, Densities, accel_densities, gyro_densities
from ins.records import InputError, Run, RunHeader, TwinModel
from ins.robust import chi2
from ins.units import ARCSEC, DEG_PER_HOUR, DEG_PER_HOUR_SQRT_HOUR, DEG_PER_SQRT_HOUR, HOUR, MICRO_G
from ins.units import MICRO_G_PER_SQRT_HOUR as MICRO_G_WALK
from simreal.evidence.noise_model import SIX_CHANNELS
from simreal.twin.fit.constants import (
    CONSTANT_OVER_S,
    RunToRunVariance,
    accel_constants,
    gyro_constants,
    spread_between,
)
from simreal.twin.fit.curves import contradicted, curves_of
from simreal.twin.fit.evidence import (
    AXES_DIFFER_P,
    BELIEVED_SIGMA,
    IDENTIFIED_SIGMA,
    TermEstimate,
    TriadFit,
    fit_triad,
    plateau,
)
from simreal.twin.fit.gear import GEAR_BELOW_HZ, SWINGS_BELOW_HZ, Gear
from simreal.twin.fit.model import PRIOR_SIGMA, NoiseEstimate, TriadEvidence, TriadModel
from simreal.twin.fit.other_sensors import Sample, receiver, thermometers, wheels
from simreal.twin.fit.result import Needs, Parameter, RunUsed, SpectralLine, TwinFit
from simreal.twin.fit.rounding import roundings
from simreal.twin.fit.slow import slow_data
from simreal.twin.fit.spectra import spectra_of
from simreal.twin.fit.streams import DitherLine, ParkedStream, stream_of
from simreal.twin.fit.terms import NoiseTerm, Shape
from simreal.twin.reasons import Why

GYRO_TRIAD, ACCEL_TRIAD = (0, 1, 2), (3, 4, 5)
# of the white noise at the highest frequency, where quantisation is first looked for: 0.1 is seen
# in 1e4 rows
STARTING_SHARE = 0.1
SMALLEST = 1e-3  # of the white noise in a second: what a term of zero is believed to be
SMALLEST_SWAY_M_S = 1e-5
# degrees of freedom at which a spread is known to a quarter: sigma of a log variance sqrt(2 / n)
ENOUGH_FREEDOM = 2.0 / IDENTIFIED_SIGMA**2
# readings are seldom independent to the last: twice the 8 that a size to a quarter asks for
ENOUGH_READINGS = 2.0 * ENOUGH_FREEDOM


def fit_twin(
    runs: Sequence[Run],
    believed: TwinModel,
    table: ThermalTable | None = None,
    told: Callable[[str], None] = lambda words: None,
) -> TwinFit:
    """The noise of the unit that made the runs. InputError where they are of several units.

    believed: what is kept of what the runs do not tell; table: its thermal table, taken out first.
    """
    header = one_unit(runs)
    streams: list[ParkedStream] = []
    used: list[RunUsed] = []
    for run in runs:
        told(f"reading {run.header.run_id}")
        stream = stream_of(run, believed, table)
        if stream is not None:
            streams.append(stream)
        parked = 0.0 if stream is None else stream.still_s
        used.append(RunUsed(run_id=run.header.run_id, sha256=run.sha256, parked_s=parked))
    if not streams:
        unit = replace(believed, imu_serial=header.imu_serial)
        return TwinFit(twin=unit, start=believed.source, runs=tuple(used))
    told("fitting the noise")
    evidence, lines, left_out, shared = _evidence(streams)
    rate_hz = float(np.median([s.run.imu.rate_hz for s in streams]))
    seconds = float(sum(s.still_s for s in streams))

    def fit_of(channels: Sequence[int], model: TriadModel) -> TriadFit:
        of = evidence.of(channels)

        def hopeless(fitted: NoiseEstimate, used: TriadEvidence) -> bool:
            return any(contradicted(c) for c in curves_of(streams, used, (fitted, fitted)))

        return fit_triad(of, model, 1.0 / rate_hz, seconds, hopeless)

    gyro = fit_of(GYRO_TRIAD, _gyro_model(believed, 1.0 / rate_hz))
    accel = fit_of(ACCEL_TRIAD, _accel_model(believed, 1.0 / rate_hz))
    told("reading the other sensors")
    fits = {GYRO_TRIAD: gyro, ACCEL_TRIAD: accel}
    read = [fit.read(evidence.of(c)).bands for c, fit in fits.items()]
    drawn = replace(evidence, bands=tuple(chain(*read)))
    curves = curves_of(streams, drawn, (gyro.fitted, accel.fitted))
    against = {curve.channel.split("_")[0] for curve in curves if contradicted(curve)}
    triads = {"gyro": gyro, "accel": accel}
    against |= {name for name, fit in triads.items() if fit.contradicted}
    parameters: list[Parameter] = []
    for name, fit in triads.items():
        parameters += _parameters(name, fit, believed, seconds)
    against -= {_triad(p) for p in parameters if p.why is Why.ROUNDED}  # which is why, and known
    flat = _plateaus(evidence, believed, against, seconds)
    parameters = [
        flat[p.name][0]
        if p.name in flat
        else _kept(p.name, believed, Why.CONTRADICTED, seconds)
        if _triad(p) in against
        else p
        for p in parameters
    ]
    parameters += _turn_on(streams, believed, gyro, accel)
    parameters += _others(streams, believed)
    twin = _twin_of(believed, parameters, header.imu_serial)
    names, covariance = _covariance(parameters, gyro, accel)
    for name, (alone, _) in flat.items():  # of no fit with the others
        at = names.index(name)
        covariance[at] = covariance[:, at] = 0.0
        covariance[at, at] = alone.sigma**2
    white = _axis_white(gyro, accel)
    rocked = [SIX_CHANNELS[c] for c in sorted({c for _, c in gyro.gear | accel.gear})]
    return TwinFit(
        twin=twin,
        start=believed.source,
        parameters=tuple(parameters),
        names=names,
        covariance=covariance,
        channels=tuple(replace(c, white=white.get(c.channel)) for c in curves),
        lines=tuple(_line(line) for line in lines_of_unit(lines, gyro.gear | accel.gear)),
        runs=tuple(used),
        axes_alike_p={name: fit.differ_p for name, fit in triads.items()},
        axis_white=white,
        axes=_axis_variances([fit for name, fit in triads.items() if name not in against]),
        vehicle_share={SIX_CHANNELS[k]: float(shared[k]) for k in range(3)},
        windows_left_out=left_out,
        parked_s=seconds,
        read_below_hz={name: fit.band_hz for name, fit in triads.items() if fit.band_hz is not None}
        | {name.split(".")[0]: top_hz for name, (_, top_hz) in flat.items()},
        read_above_hz=dict.fromkeys(rocked, GEAR_BELOW_HZ),
    )


def _plateaus(
    evidence: TriadEvidence, believed: TwinModel, against: set[str], seconds: float
) -> dict[str, tuple[Parameter, float]]:
    """White noise of the triads that no model explains, by its name, where their rows' spectra have
    a plateau, and the frequency up to which it was read.
    """
    found = {}
    triads = (("gyro", GYRO_TRIAD, GYRO_TERMS), ("accel", ACCEL_TRIAD, ACCEL_TERMS))
    for triad, channels, terms in triads:
        flat = plateau(evidence.of(channels)) if triad in against else None
        if flat is not None:
            name, unit = terms[NoiseTerm.WHITE]
            white = _parameter(name, flat[0], unit, believed_value(believed, name), seconds)
            found[name] = white, flat[1]
    return found


def _line(line: DitherLine) -> SpectralLine:
    return SpectralLine(
        channel=SIX_CHANNELS[line.channel],
        frequency_hz=line.frequency_hz,
        amplitude=line.amplitude,
        sigma=line.sigma,
        swing=line.swing,
    )


def _triad(parameter: Parameter) -> str:
    """The part of the twin that a parameter belongs to."""
    return parameter.name.split(".")[0]


def one_unit(runs: Sequence[Run]) -> RunHeader:
    """The header of the first run; InputError where another is of another unit."""
    first = runs[0].header
    for run in runs[1:]:
        header = run.header
        for key in ("imu_serial", "gyro_technology", "gyro_mode"):
            if getattr(header, key) != getattr(first, key):
                raise InputError(
                    f"run {header.run_id}: {key} {getattr(header, key)!r}, run {first.run_id} has"
                    f" {getattr(first, key)!r}: needed runs of one unit"
                )
    return first


def _evidence(
    streams: Sequence[ParkedStream],
) -> tuple[TriadEvidence, list[tuple[DitherLine, ...]], dict[str, float], NDArray]:
    bands, slow, share = [], [], []
    lines: list[tuple[DitherLine, ...]] = []
    left_out: dict[str, float] = {}
    shared = np.zeros(3)
    for k, stream in enumerate(streams):
        found = spectra_of(stream)
        counts = roundings(stream, found.lines)
        bands += [(k, replace(b, rounding=counts.get(b.channel))) for b in found.bands]
        slow += [(k, d) for d in slow_data(stream, found.slow_s)]
        share.append(np.tile(1.0 - stream.up_b**2, 2))
        lines.append(found.lines)
        shared = np.maximum(shared, found.shared)
        for name, part in found.left_out.items():
            left_out[name] = max(part, left_out.get(name, 0.0))
    evidence = TriadEvidence(tuple(bands), tuple(slow), tuple(share))
    return evidence, lines, left_out, shared


def lines_of_unit(
    lines: Sequence[Sequence[DitherLine]], gear: Gear = frozenset()
) -> tuple[DitherLine, ...]:
    """Lines that most runs have, as one where they are of one channel and within 0.5 %.

    What one run of three has is of its vehicle: people on board rock it at 1.3 Hz, and a twin with
    that line declares thirteen times the white noise of a quiet hour. So is what lies within the
    frequencies of a gear that moves.
    """
    lines = [
        [one for one in own if one.frequency_hz > SWINGS_BELOW_HZ or (k, one.channel) not in gear]
        for k, own in enumerate(lines)
    ]
    groups: list[list[DitherLine]] = []
    for line in sorted(chain(*lines), key=lambda one: (one.channel, one.frequency_hz)):
        last = groups[-1][-1] if groups else None
        alike = last is not None and last.channel == line.channel
        if alike and last and line.frequency_hz < 1.005 * last.frequency_hz:
            groups[-1].append(line)
        else:
            groups.append([line])
    strongest = [max(group, key=lambda one: one.amplitude) for group in groups]
    return tuple(
        line
        for line, group in zip(strongest, groups)
        if 2 * sum(any(one in of_run for one in group) for of_run in lines) > len(lines)
    )


def _gyro_model(twin: TwinModel, dt_s: float) -> TriadModel:
    d = gyro_densities(twin.gyro)
    creep = (twin.vehicle.yaw_creep_arcsec_sqrt_h * ARCSEC / np.sqrt(HOUR)) ** 2
    own = {NoiseTerm.CREEP: creep or SMALLEST * d.white**2}
    return _model(d, twin.gyro.quantization_rad, dt_s, own, Shape())


def _accel_model(twin: TwinModel, dt_s: float) -> TriadModel:
    v = twin.vehicle
    own = {NoiseTerm.SWAY: max(v.sway_m_s, SMALLEST_SWAY_M_S) ** 2}
    shape = Shape(
        sway_w=2.0 * np.pi * max(v.sway_hz, 0.01), sway_zeta=min(max(v.sway_damping, 0.02), 0.95)
    )
    return _model(accel_densities(twin.accel), twin.accel.quantization_m_s, dt_s, own, shape)


def _model(
    d: Densities, quantum: float, dt_s: float, own: Mapping[NoiseTerm, float], shape: Shape
) -> TriadModel:
    """The model of a triad about what is believed; own: terms that the other triad has not."""
    white = d.white**2
    centres = {
        NoiseTerm.WHITE: white,
        NoiseTerm.QUANTIZATION: quantum**2 / 12.0 or STARTING_SHARE * white * dt_s / 4.0,
        NoiseTerm.FLICKER: d.instability**2 or SMALLEST * white,
        NoiseTerm.WALK: d.walk**2 or SMALLEST * white / HOUR,
        **own,
    }
    return TriadModel(
        tuple(centres),
        np.log(list(centres.values())),
        shape,
        np.full(len(centres), PRIOR_SIGMA),
        unbelieved=frozenset() if quantum else frozenset([NoiseTerm.QUANTIZATION]),
    )


def _size(told: TermEstimate, unit: float) -> tuple[float, float, float, float]:
    """Value, sigma, low and high of a term's size in a unit."""
    value = float(np.exp(0.5 * told.value)) / unit
    low = float(np.exp(0.5 * told.low)) / unit if np.isfinite(told.low) else 0.0
    return value, 0.5 * told.sigma * value, low, float(np.exp(0.5 * told.high)) / unit


def _parameter(
    name: str, told: TermEstimate, unit: float, believed: float, seconds: float
) -> Parameter:
    if told.hidden:
        return _unknown(name, believed, Why.ROUNDED, seconds)
    value, sigma, low, high = _size(told, unit)
    why = None
    if not told.identified:
        why = Why.TOO_LOOSE if told.nats > SEEN_NATS else Why.NOTHING_SEEN
        if believed == 0.0:  # nobody believed in it and nothing shows it
            value, sigma = 0.0, 0.5 * high
    return Parameter(
        name=name,
        value=value,
        sigma=sigma,
        low=low,
        high=high,
        believed=believed,
        seconds=seconds,
        nats=told.nats if np.isfinite(told.nats) else None,
        why=why,
        needs=Needs.NOTHING if told.identified else Needs.PARKED_SECONDS,
        needed=told.needed_s,
    )


SEEN_NATS = 2.0  # 2 nats are 2 sigmas: something is there, its size is not told
QUANTUM = 1.0 / np.sqrt(12.0)  # sigma of a uniform error of one step
SQRT_HOUR = np.sqrt(HOUR)
GYRO_TERMS = {
    NoiseTerm.WHITE: ("gyro.arw_deg_sqrt_h", DEG_PER_SQRT_HOUR),
    NoiseTerm.QUANTIZATION: ("gyro.quantization_rad", QUANTUM),
    NoiseTerm.FLICKER: ("gyro.bias_instability_deg_h", DEG_PER_HOUR),
    NoiseTerm.WALK: ("gyro.rate_random_walk_deg_h_sqrt_h", DEG_PER_HOUR_SQRT_HOUR),
    NoiseTerm.MARKOV: ("gyro.gauss_markov_deg_h", DEG_PER_HOUR),
    NoiseTerm.CREEP: ("vehicle.yaw_creep_arcsec_sqrt_h", ARCSEC / SQRT_HOUR),
}
ACCEL_TERMS = {
    NoiseTerm.WHITE: ("accel.vrw_ug_sqrt_hz", MICRO_G),
    NoiseTerm.QUANTIZATION: ("accel.quantization_m_s", QUANTUM),
    NoiseTerm.FLICKER: ("accel.bias_instability_ug", MICRO_G),
    NoiseTerm.WALK: ("accel.rate_random_walk_ug_sqrt_h", MICRO_G_WALK),
    NoiseTerm.MARKOV: ("accel.gauss_markov_ug", MICRO_G),
    NoiseTerm.SWAY: ("vehicle.sway_m_s", 1.0),
}
TERMS = {"gyro": GYRO_TERMS, "accel": ACCEL_TERMS}
COVERED = {
    "gyro": ("gyro.gauss_markov_deg_h", "bias_instability_deg_h"),
    "accel": ("accel.gauss_markov_ug", "bias_instability_ug"),
}
# of flicker to the sigma of a Markov process, whose Allan deviation is 0.617 sigma at its highest
# (IEEE Std 952-1997, annex C)
MARKOV_AS_FLICKER = 0.617 / FLICKER_FLOOR
# what the fit finds and a twin has no key for; it stands in the twin's `fit`
BESIDE_TWIN = (
    "gyro.gauss_markov_deg_h",
    "gyro.gauss_markov_tau_s",
    "accel.gauss_markov_ug",
    "accel.gauss_markov_tau_s",
)


def believed_value(twin: TwinModel, name: str) -> float:
    """What a twin declares under a name, 0 where it has no such key."""
    section, key = name.split(".")
    return float(getattr(getattr(twin, section), key, 0.0))


def _parameters(section: str, fit: TriadFit, twin: TwinModel, seconds: float) -> list[Parameter]:
    """What is told of a triad; all as it was believed to be where the data contradict it."""
    terms = TERMS[section]
    if fit.contradicted:
        keys = [name for name, _ in terms.values() if name not in BESIDE_TWIN]
        if NoiseTerm.SWAY in terms:
            keys += ["vehicle.sway_hz", "vehicle.sway_damping"]
        return [_kept(key, twin, Why.CONTRADICTED, seconds) for key in keys]
    found = [
        _parameter(name, told, unit, believed_value(twin, name), seconds)
        for term, (name, unit) in terms.items()
        if (told := fit.of(term)) is not None
    ]
    if NoiseTerm.CREEP in terms and fit.of(NoiseTerm.CREEP) is None:
        name = terms[NoiseTerm.CREEP][0]
        found.append(_kept(name, twin, Why.GYROS_DIFFER, seconds))
    return found + _shape_parameters(section, fit, twin, seconds)


def _shape_parameters(
    section: str, fit: TriadFit, twin: TwinModel, seconds: float
) -> list[Parameter]:
    """Frequency and damping of the sway, time of a Markov process; as well known as their term."""
    units = {
        "sway_w": ("vehicle.sway_hz", 2.0 * np.pi, NoiseTerm.SWAY),
        "sway_zeta": ("vehicle.sway_damping", 1.0, NoiseTerm.SWAY),
        "tau_s": (f"{section}.gauss_markov_tau_s", 1.0, NoiseTerm.MARKOV),
    }
    model, found = fit.fitted.model, []
    sigmas = np.sqrt(np.diag(fit.fitted.covariance))
    for j, name in enumerate(model.shapes):
        key, unit, term = units[name]
        k = len(model.terms) + j
        value, sigma = float(np.exp(fit.fitted.x[k])) / unit, float(sigmas[k])
        of = fit.of(term)
        identified = of is not None and of.identified and sigma < IDENTIFIED_SIGMA / 2.0
        why = None if identified else Why.TOO_LOOSE
        found.append(
            Parameter(
                name=key,
                value=value,
                sigma=sigma * value,
                low=value * float(np.exp(-1.96 * sigma)),
                high=value * float(np.exp(1.96 * sigma)),
                believed=believed_value(twin, key),
                seconds=seconds,
                why=why,
                needs=Needs.NOTHING if identified else Needs.PARKED_SECONDS,
                needed=seconds if identified else _shape_needed(of, sigma, seconds),
            )
        )
    return found


def _shape_needed(of: TermEstimate | None, sigma: float, seconds: float) -> float:
    """Parked seconds that would tell a shape: as long as the squared sigma of its logarithm takes
    to fall, and its term has to be told.
    """
    if of is None:
        return float("inf")
    return max(of.needed_s, seconds * (2.0 * sigma / IDENTIFIED_SIGMA) ** 2)


def _kept(
    name: str,
    twin: TwinModel,
    why: Why,
    seconds: float,
    *,
    needs: Needs = Needs.NOTHING,
    needed: float = float("nan"),
) -> Parameter:
    """A parameter that stays what it was believed to be."""
    found = _unknown(name, believed_value(twin, name), why, seconds)
    return replace(found, needs=needs, needed=needed)


def _unknown(name: str, value: float, why: Why, seconds: float) -> Parameter:
    """A parameter of which nothing is known but what was believed."""
    return Parameter(
        name=name,
        value=value,
        sigma=float("inf"),
        low=0.0,
        high=float("inf"),
        believed=value,
        seconds=seconds,
        why=why,
    )


def _turn_on(
    streams: Sequence[ParkedStream], twin: TwinModel, gyro: TriadFit, accel: TriadFit
) -> list[Parameter]:
    """The spread of constants from one power-on to the next, from several runs."""
    north = twin.gyro_technology != "mems"
    rows = [gyro_constants(s, finds_north=north) for s in streams]
    noise = np.full(rows[0].size, _mean_variance(gyro, streams))
    if not north:
        lat = streams[0].run.header.site.lat_rad
        noise = noise + 0.5 * (EARTH_RATE_RAD_S * np.cos(lat)) ** 2
    force = [accel_constants(s) for s in streams]
    spreads = (
        ("gyro.turn_on_deg_h", DEG_PER_HOUR, spread_between(rows, noise)),
        (
            "accel.turn_on_ug",
            MICRO_G,
            spread_between(force, np.array([_mean_variance(accel, streams)])),
        ),
    )
    return [_spread(name, unit, found, twin, len(streams)) for name, unit, found in spreads]


def _mean_variance(fit: TriadFit, streams: Sequence[ParkedStream]) -> float:
    """Variance of the mean over the first rest: white noise and what flicker adds to it."""
    seconds = min(CONSTANT_OVER_S, float(np.median([s.still_s for s in streams])))
    white = np.exp(fit.fitted.log_variance(NoiseTerm.WHITE)) / seconds
    flicker = np.exp(fit.fitted.log_variance(NoiseTerm.FLICKER))
    return float(white + flicker)


def _spread(
    name: str, unit: float, found: RunToRunVariance | None, twin: TwinModel, runs: int
) -> Parameter:
    columns = found.freedom / max(runs - 1, 1) if found else 1.0
    needed = float(np.ceil(ENOUGH_FREEDOM / columns)) + 1.0
    if found is None:
        return _kept(name, twin, Why.FEW_RUNS, 0.0, needs=Needs.RUNS, needed=max(needed, 2.0))
    value = float(np.sqrt(found.variance)) / unit
    high = float(np.sqrt(found.high)) / unit
    low = float(np.sqrt(found.low)) / unit
    identified = bool(found.freedom >= ENOUGH_FREEDOM and found.low > 0)
    believed = believed_value(twin, name)
    taken = value
    if not identified and believed > 0:  # what few runs say is weighed with what was believed
        taken = float(np.sqrt(found.weighed((believed * unit) ** 2, BELIEVED_SIGMA))) / unit
    return Parameter(
        name=name,
        value=taken,
        sigma=value / np.sqrt(2.0 * found.freedom),
        low=low,
        high=high,
        believed=believed,
        seconds=float(runs),
        why=None if identified else Why.FEW_RUNS,
        needs=Needs.NOTHING if identified else Needs.RUNS,
        needed=float(runs) if identified else needed,
    )


def _others(streams: Sequence[ParkedStream], twin: TwinModel) -> list[Parameter]:
    found = _thermometer_parameters(list(streams), twin)
    fixes = receiver(list(streams))
    for key in ("sigma_horizontal_m", "sigma_vertical_m", "sigma_velocity_m_s"):
        name = f"gnss.{key}"
        found.append(_sampled(name, fixes.get(name), twin))
    found.append(_sampled("odometer.noise_m_s", wheels(list(streams)), twin))
    return found


def _thermometer_parameters(streams: list[ParkedStream], twin: TwinModel) -> list[Parameter]:
    noise_name, step_name = "temperature.noise_degC", "temperature.resolution_degC"
    seen = thermometers(streams)
    if seen is None:
        return [_kept(name, twin, Why.NO_STREAM, 0.0) for name in (noise_name, step_name)]
    noise = _sampled(noise_name, seen.noise, twin)
    if seen.noise.sigma < 0.3 * seen.resolution:
        limit = 0.3 * seen.resolution
        value = min(noise.believed, limit)
        noise = replace(noise, value=value, low=0.0, high=limit, why=Why.BELOW_RESOLUTION)
    if seen.resolution == 0.0:
        return [noise, _kept(step_name, twin, Why.NOT_ON_A_GRID, seen.noise.count)]
    step = Parameter(
        name=step_name,
        value=seen.resolution,
        sigma=0.0,
        low=seen.resolution,
        high=seen.resolution,
        believed=believed_value(twin, step_name),
        seconds=seen.noise.count,
    )
    return [noise, step]


def _sampled(name: str, sample: Sample | None, twin: TwinModel) -> Parameter:
    if sample is None:
        return _kept(name, twin, Why.NO_STREAM, 0.0)
    freedom = max(sample.count, 1.0)
    low, high = chi2.ppf([0.025, 0.975], freedom)
    identified = bool(freedom >= ENOUGH_READINGS and sample.sigma > 0)
    believed = believed_value(twin, name)
    return Parameter(
        name=name,
        value=sample.sigma if identified else believed,
        sigma=sample.sigma / float(np.sqrt(2.0 * freedom)),
        low=sample.sigma * float(np.sqrt(freedom / high)),
        high=sample.sigma * float(np.sqrt(freedom / low)),
        believed=believed,
        seconds=sample.count,
        why=None if identified else Why.EXACT_ZERO if sample.sigma == 0 else Why.TOO_LOOSE,
    )


def _twin_of(believed: TwinModel, parameters: Sequence[Parameter], serial: str) -> TwinModel:
    """The twin with the fitted numbers."""
    twin = replace(believed, imu_serial=serial, source="fitted")
    for p in parameters:
        if p.name in BESIDE_TWIN:
            continue
        section, key = p.name.split(".")
        record = replace(getattr(twin, section), **{key: p.value})
        twin = replace(twin, **{section: record})
    return _covering(twin, parameters)


def _covering(twin: TwinModel, parameters: Sequence[Parameter]) -> TwinModel:
    """The twin with flicker that covers the Markov processes that were told: it has no key for
    them, and an estimate that knew nothing of them would be too sure.
    """
    told = {p.name: p.value for p in parameters if p.identified}
    for section, (markov, flicker) in COVERED.items():
        if markov in told:
            record = getattr(twin, section)
            size = float(np.hypot(getattr(record, flicker), MARKOV_AS_FLICKER * told[markov]))
            twin = replace(twin, **{section: replace(record, **{flicker: size})})
    return twin


def _covariance(
    parameters: Sequence[Parameter], gyro: TriadFit, accel: TriadFit
) -> tuple[tuple[str, ...], NDArray]:
    """Covariance of all parameters that have a finite sigma: triads as fitted, the rest apart."""
    known = [p for p in parameters if np.isfinite(p.sigma)]
    names = tuple(p.name for p in known)
    values = {p.name: p.value for p in known}
    total = np.diag([p.sigma**2 for p in known])
    for fit, terms in ((gyro, GYRO_TERMS), (accel, ACCEL_TERMS)):
        model = fit.fitted.model
        keys = [terms[t][0] for t in model.terms]
        at = [names.index(k) for k in keys if k in names]
        scale = np.array([0.5 * values[k] for k in keys if k in names])
        own = [j for j, k in enumerate(keys) if k in names]
        block = fit.fitted.covariance[np.ix_(own, own)] * np.outer(scale, scale)
        total[np.ix_(at, at)] = block
    return names, total


def _axis_variances(triads: Sequence[TriadFit]) -> dict[str, tuple[float, float]]:
    """Variances of white noise and quantisation over the twin's: channels of axes that differ."""
    found = {}
    for fit in triads:
        ratios = fit.fitted.model.ratios if fit.differ_p <= AXES_DIFFER_P else {}
        for c in sorted({channel for _, channel in ratios}):
            white = ratios.get((NoiseTerm.WHITE, c), 1.0)
            found[SIX_CHANNELS[c]] = white, ratios.get((NoiseTerm.QUANTIZATION, c), 1.0)
    return found


def _axis_white(gyro: TriadFit, accel: TriadFit) -> dict[str, float]:
    """White noise of each axis fitted alone, in the units of the twin."""
    found = {}
    for fit, terms in ((gyro, GYRO_TERMS), (accel, ACCEL_TERMS)):
        unit = terms[NoiseTerm.WHITE][1]
        for c, alone in fit.axes.items():
            size = float(np.exp(0.5 * alone.log_variance(NoiseTerm.WHITE)))
            found[SIX_CHANNELS[c]] = size / unit
    return found
