"""Drifts of a gyro with temperature and time. `p`: the parameters drawn; coefficients at size 1."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_trials.effect import GYROS, Effects, Parameters, event, log_uniform, signed
from benchmarks.gap_trials.processes import lagged, play, smooth_step
from benchmarks.gap_trials.seen import Seen, Streams, axis_of

REFERENCE_DEGC = 20.0


EFFECTS = Effects()


def _turn_ons(rng: np.random.Generator, seen: tuple[Seen, ...]) -> Parameters:
    drawn = rng.standard_normal(len(seen))
    return {"biases_deg_h": (0.0065 * drawn / np.sqrt(np.mean(drawn**2))).tolist()}


@EFFECTS.plants(
    "gyro_thermal_linear", GYROS, lambda rng, _: {"coefficient_deg_h_degC": signed(rng, 0.0012)}
)
def thermal_linear(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """k (T - 20), flattening by 3 % at 40 degC off."""
    off = coil(seen, target) - REFERENCE_DEGC
    return streams.gyro(
        target, size * p["coefficient_deg_h_degC"] * off * (1 - 0.03 * (off / 40.0) ** 2)
    )


@EFFECTS.plants(
    "gyro_thermal_quadratic",
    GYROS,
    lambda rng, _: {"coefficient_deg_h_degC2": signed(rng, 0.00005)},
)
def thermal_quadratic(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """k (T - 20)^2 with a cubic part of 10 % at 40 degC off."""
    off = coil(seen, target) - REFERENCE_DEGC
    return streams.gyro(
        target, size * p["coefficient_deg_h_degC2"] * off**2 * (1 + 0.1 * off / 40.0)
    )


@EFFECTS.plants(
    "gyro_thermal_rate",
    GYROS,
    lambda rng, _: {
        "coefficient_deg_h_min_degC": signed(rng, 0.025),
        "shell_s": float(rng.uniform(15, 45)),
    },
    confounded=("gyro_thermal_lag",),
)
def thermal_rate(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """k dT/dt of the coil, which follows its shell by half a minute or so."""
    rate = (
        np.gradient(lagged(coil(seen, target), tau_s=p["shell_s"], dt_s=seen.dt_s), seen.dt_s)
        * 60.0
    )
    return streams.gyro(target, size * p["coefficient_deg_h_min_degC"] * rate)


@EFFECTS.plants(
    "gyro_thermal_gradient", GYROS, lambda rng, _: {"coefficient_deg_h_degC": signed(rng, 0.008)}
)
def thermal_gradient(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """k Tdiff at that gyro."""
    return streams.gyro(
        target, size * p["coefficient_deg_h_degC"] * seen.gradient_degC[:, axis_of(target)]
    )


@EFFECTS.plants(
    "gyro_thermal_lag",
    GYROS,
    lambda rng, _: {
        "coefficient_deg_h_degC": signed(rng, 0.005),
        "tau_s": log_uniform(rng, 60, 900),
    },
    confounded=("gyro_thermal_rate",),
)
def thermal_lag(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """k (T_coil - T): the coil is later than the thermometer by tau and, through its winding, by a
    tenth of that.
    """
    sensor = coil(seen, target)
    once = lagged(sensor, tau_s=p["tau_s"], dt_s=seen.dt_s)
    late = lagged(once, tau_s=0.1 * p["tau_s"], dt_s=seen.dt_s)
    return streams.gyro(target, size * p["coefficient_deg_h_degC"] * (late - sensor))


@EFFECTS.plants(
    "gyro_thermal_hysteresis",
    GYROS,
    lambda rng, _: {
        "half_split_deg_h": signed(rng, 0.005),
        "width_degC": log_uniform(rng, 1.0, 5.0),
    },
    needs=frozenset({"runs"}),
)
def thermal_hysteresis(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """Half the split between heating and cooling, by backlashes of several widths."""
    loop = play(coil(seen, target), width=p["width_degC"]) / p["width_degC"]
    return streams.gyro(target, size * p["half_split_deg_h"] * loop)


@EFFECTS.plants(
    "gyro_warmup_transient",
    GYROS,
    lambda rng, _: {"amplitude_deg_h": signed(rng, 0.02), "tau_s": log_uniform(rng, 180, 1800)},
)
def warmup_transient(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """A exp(-t / tau) with a faster tenth of it."""
    return streams.gyro(target, size * p["amplitude_deg_h"] * two_decays(seen.time_s, p["tau_s"]))


@EFFECTS.plants("gyro_rate_ramp", GYROS, lambda rng, _: {"slope_deg_h_h": signed(rng, 0.003)})
def rate_ramp(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    return streams.gyro(target, size * p["slope_deg_h_h"] * seen.time_s / 3600.0)


@EFFECTS.plants(
    "gyro_bias_step", GYROS, lambda rng, seen: {"step_deg_h": signed(rng, 0.01), **event(rng, seen)}
)
def bias_step(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """In one run, within a few seconds."""
    if seen.number != p["run"]:
        return streams
    return streams.gyro(
        target, size * p["step_deg_h"] * smooth_step(seen.time_s, onset_s=p["onset_s"], rise_s=2.0)
    )


@EFFECTS.plants(
    "gyro_mode_hop",
    GYROS,
    lambda rng, _: {
        "amplitude_deg_h": 0.005,
        "period_degC": float(rng.uniform(3, 10)),
        "phase_rad": float(rng.uniform(0, 2 * np.pi)),
    },
    needs=frozenset({"runs"}),
)
def mode_hop(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """A sin(2 pi T / P + c): a period that grows by 1 % over 10 degC, and a weak second
    harmonic.
    """
    T = coil(seen, target)
    phase = (
        2 * np.pi * T / p["period_degC"] * (1 - 0.001 * (T - REFERENCE_DEGC) / 2) + p["phase_rad"]
    )
    return streams.gyro(
        target, size * p["amplitude_deg_h"] * (np.sin(phase) + 0.08 * np.sin(2 * phase))
    )


@EFFECTS.plants("gyro_turn_on_bias", GYROS, _turn_ons, needs=frozenset({"runs"}))
def turn_on_bias(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    return streams.gyro(target, size * p["biases_deg_h"][seen.number])


@EFFECTS.plants(
    "compensation_misapplied",
    GYROS,
    lambda rng, _: {"coefficient": float(rng.choice([-2.0, -1.0, 1.0]))},
    confounded=("gyro_thermal_linear", "gyro_thermal_quadratic"),
)
def compensation(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """The unit subtracts its own table as well: coefficient -1 (twice), -2 (wrong sign) or 1 (left
    out, added back).
    """
    curve = seen.table["axes"][target[-1]]
    bias = np.interp(coil(seen, target), curve["temperature_degC"], curve["bias_deg_h"])
    return streams.gyro(target, size * p["coefficient"] * bias)


def coil(seen: Seen, target: str) -> NDArray:
    """True temperature of that gyro, (n,)."""
    return seen.gyro_degC[:, axis_of(target)]


def two_decays(time_s: NDArray, tau_s: float) -> NDArray:
    """1 at power-on: nine tenths with tau, the rest seven times as fast."""
    return 0.9 * np.exp(-time_s / tau_s) + 0.1 * np.exp(-7 * time_s / tau_s)
