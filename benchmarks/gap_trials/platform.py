"""What the vehicle under the unit does, and what is entered wrongly of the site."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_trials import processes
from benchmarks.gap_trials.effect import Effects, Parameters, event, log_uniform, seed, signed
from benchmarks.gap_trials.gyro_drifts import two_decays
from benchmarks.gap_trials.seen import Seen, Streams, moved, tilted, turned_back
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G

VEHICLE, SITE = ("vehicle",), ("site",)


EFFECTS = Effects()


def _sway(rng: np.random.Generator, _: tuple[Seen, ...]) -> Parameters:
    rocking = rng.random() < 0.5
    return {
        "kind": "rocking" if rocking else "to and fro",
        "rms": 40.0 * ARCSEC if rocking else 0.004,
        "hz": log_uniform(rng, 0.15, 1.0),
        "damping": float(rng.uniform(0.1, 0.3)),
        "seed": seed(rng),
    }


def _deflection(rng: np.random.Generator, _: tuple[Seen, ...]) -> Parameters:
    north, east, _none = _level(rng, 12.0)
    return {"arcsec_north_east": [north, east], "anomaly_mgal": signed(rng, 25.0)}


def _engine(rng: np.random.Generator, seen: tuple[Seen, ...]) -> Parameters:
    def three(size: float) -> list[float]:
        return (size * rng.standard_normal(3)).tolist()

    return {
        **event(rng, seen),
        "gyro_deg_h": three(0.002),
        "accel_ug": three(15.0),
        "gyro_deg_sqrt_h": 0.0015,
        "accel_ug_sqrt_hz": 60.0,
        "seed": seed(rng),
    }


@EFFECTS.plants(
    "platform_settling",
    VEHICLE,
    lambda rng, seen: {
        "run": _one_run(rng, seen),
        "tau_s": log_uniform(rng, 300, 2400),
        **_tilt(rng, 60.0),
    },
)
def settling(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """In one run struts and tyres give way from power-on: A (1 - exp(-t / tau)), a tenth of it
    sooner.
    """
    if seen.number != p["run"]:
        return streams
    return tilted(
        streams,
        seen,
        np.outer(
            1 - two_decays(seen.time_s, p["tau_s"]), size * ARCSEC * np.array(p["arcsec_xyz"])
        ),
    )


@EFFECTS.plants(
    "platform_yaw_creep",
    VEHICLE,
    lambda rng, seen: {
        "run": _one_run(rng, seen),
        "tau_s": log_uniform(rng, 300, 2400),
        "arcsec_xyz": _about_vertical(rng, 30.0).tolist(),
    },
    accepted=("gyro_z",),
    confounded=("gyro_warmup_transient", "slow_variation"),
)
def yaw_creep(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """The same about the vertical; the tow bar holds less and less."""
    return settling(streams, seen, target, p, size)


@EFFECTS.plants(
    "platform_step",
    VEHICLE,
    lambda rng, seen: {
        **event(rng, seen),
        "rise_s": float(rng.uniform(0.5, 2)),
        **_tilt(rng, 60.0),
    },
)
def step(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """Boarding, fuel or cargo in one run: to a new attitude within a second or two, with a swing
    over it.
    """
    if seen.number != p["run"]:
        return streams
    since = np.maximum(seen.time_s - p["onset_s"], 0.0)
    shape = 1 - np.exp(-since / p["rise_s"]) * np.cos(2.0 * since / p["rise_s"])
    return tilted(streams, seen, np.outer(shape, size * ARCSEC * np.array(p["arcsec_xyz"])))


@EFFECTS.plants("platform_sway", VEHICLE, _sway)
def sway(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """More gusts than declared: to and fro in the level, or rocking about the level axes."""
    rng = seen.rng(p["seed"])
    both = [
        processes.oscillator_velocity(
            rng, seen.rows, rms=p["rms"], frequency_hz=p["hz"], damping=p["damping"], dt_s=seen.dt_s
        )
        for _ in range(2)
    ]
    motion = size * np.stack([*both, np.zeros(seen.rows)], axis=-1)
    if p["kind"] == "to and fro":
        return moved(streams, seen, motion)
    # the oscillator's place, of the same RMS
    swing = np.cumsum(motion, axis=0) * seen.dt_s * 2 * np.pi * p["hz"]
    return tilted(streams, seen, swing - swing[0])


@EFFECTS.plants("platform_mount_sag", VEHICLE, lambda rng, _: _tilt(rng, 20.0))
def mount_sag(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """The tray leans with the block's temperature, half a minute late."""
    warmth = processes.lagged(seen.block_degC, tau_s=30.0, dt_s=seen.dt_s)
    return tilted(
        streams,
        seen,
        np.outer((warmth - warmth[0]) / 30.0, size * ARCSEC * np.array(p["arcsec_xyz"])),
    )


@EFFECTS.plants("engine_start", VEHICLE, _engine)
def engine_start(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """From its start on, in one run: rectified vibration shifts the sensors, and all are
    noisier.
    """
    if seen.number != p["run"]:
        return streams
    on = processes.smooth_step(seen.time_s, onset_s=p["onset_s"], rise_s=5.0)[:, None]
    rng, root_dt = seen.rng(p["seed"]), np.sqrt(seen.dt_s)
    gyro = np.array(p["gyro_deg_h"]) * DEG_PER_HOUR * seen.dt_s
    gyro = gyro + p["gyro_deg_sqrt_h"] * DEG_PER_SQRT_HOUR * root_dt * rng.standard_normal(
        (seen.rows, 3)
    )
    accel = np.array(p["accel_ug"]) * MICRO_G * seen.dt_s
    accel = accel + p["accel_ug_sqrt_hz"] * MICRO_G * root_dt * rng.standard_normal((seen.rows, 3))
    return replace(
        streams,
        dtheta_rad=streams.dtheta_rad + size * on * gyro,
        dv_m_s=streams.dv_m_s + size * on * accel,
    )


@EFFECTS.plants(
    "site_latitude_error",
    SITE,
    lambda rng, _: {"arcmin": signed(rng, 1.0)},
    needs=frozenset({"runs"}),
)
def latitude_error(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """The crew enters a latitude that is off, in every run."""
    site = streams.header.site
    wrong = replace(site, lat_rad=site.lat_rad + size * p["arcmin"] / 60.0 * DEG)
    return replace(streams, header=replace(streams.header, site=wrong))


@EFFECTS.plants(
    "vertical_deflection",
    SITE,
    _deflection,
    needs=frozenset({"runs"}),
    confounded=("accel_scale_factor",),
)
def deflection(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """The plumb line leans north and east, and gravity is off: the same everywhere on the field."""
    north, east = (value * ARCSEC * 9.81 for value in p["arcsec_north_east"])
    more_n = size * np.array([north, east, -p["anomaly_mgal"] * 1e-5])  # specific force: -gravity
    return replace(
        streams,
        dv_m_s=streams.dv_m_s
        + turned_back(seen.C_nb, np.broadcast_to(more_n, (seen.rows, 3))) * seen.dt_s,
    )


def _level(rng: np.random.Generator, arcsec: float) -> list[float]:
    """A rotation about a random level axis."""
    angle = rng.uniform(0, 2 * np.pi)
    return [arcsec * float(np.cos(angle)), arcsec * float(np.sin(angle)), 0.0]


def _one_run(rng: np.random.Generator, seen: tuple[Seen, ...]) -> int:
    return int(rng.integers(len(seen)))


def _tilt(rng: np.random.Generator, arcsec: float) -> dict[str, list[float]]:
    return {"arcsec_xyz": _level(rng, arcsec)}


def _about_vertical(rng: np.random.Generator, arcsec: float) -> NDArray:
    return np.array([0.0, 0.0, signed(rng, arcsec)])
