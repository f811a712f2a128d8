"""Effects in a form that neither the catalogue nor the other trials use: physics written anew.

The right answer is the catalogue's name for the physics; `confounded` are the neighbours that it
states. They are planted by name only (`effect_named`), never drawn among the usual effects.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_trials.effect import GYROS, Effects, Parameters, log_uniform, seed, signed
from benchmarks.gap_trials.seen import Seen, Streams, axis_of, moved, tilted
from ins.units import ARCSEC, DEG

EVERY = 10  # rows of a step of the slow models: a second
RELAYS = 40  # widths of a Preisach operator
RELAYS_ACROSS = 321  # its thresholds, a quarter of a degree apart
THRESHOLDS_DEGC = (-20.0, 60.0)


OTHER_FORMS = Effects()


@OTHER_FORMS.plants(
    "three_node_network",
    GYROS,
    lambda rng, _: {
        "coefficient_deg_h_degC": signed(rng, 0.005),
        "housing_s": log_uniform(rng, 100.0, 600.0),
        "coil_s": log_uniform(rng, 50.0, 300.0),
        "leak_s": log_uniform(rng, 1000.0, 4000.0),
    },
    answers=("gyro_thermal_lag", "gyro_thermal_rate"),
    confounded=("gyro_thermal_gradient", "gyro_thermal_hysteresis"),
)
def network(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """Housing, block and coil exchange heat; the bias is that of the coil, the table is entered
    with the housing.
    """
    housing = seen.gyro_degC[::EVERY, axis_of(target)]
    dt = EVERY * seen.dt_s
    block, coil = housing[0], housing[0]
    bias = np.empty(housing.size)
    for k, outside in enumerate(housing):
        to_block = (outside - block) / p["housing_s"] + (coil - block) / p["coil_s"]
        to_coil = (block - coil) / p["coil_s"] + (outside - coil) / p["leak_s"]
        block, coil = block + dt * to_block, coil + dt * to_coil
        bias[k] = coil - outside
    rows = np.interp(seen.time_s, seen.time_s[::EVERY], bias)
    return streams.gyro(target, size * p["coefficient_deg_h_degC"] * rows)


@OTHER_FORMS.plants(
    "preisach_hysteresis",
    GYROS,
    lambda rng, _: {
        "half_split_deg_h": signed(rng, 0.01),
        "width_degC": float(rng.uniform(3.0, 10.0)),
        "centre_degC": float(rng.uniform(10.0, 40.0)),
        "spread_degC": float(rng.uniform(15.0, 30.0)),
    },
    needs=frozenset({"runs"}),
    answers=("gyro_thermal_hysteresis",),
    confounded=("gyro_thermal_lag", "gyro_thermal_rate", "gyro_thermal_quadratic"),
)
def preisach(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """Relays that switch up and down at thresholds of their own, dense about one temperature.

    One operator for the unit: its thresholds do not move with a run. A unit that stood at rest has
    each relay where the mean of its branches puts it; that mean is the table's, and known.
    """
    T = seen.gyro_degC[::EVERY, axis_of(target)]
    middle = np.linspace(*THRESHOLDS_DEGC, RELAYS_ACROSS)
    density = np.exp(-0.5 * ((middle - p["centre_degC"]) / p["spread_degC"]) ** 2)
    half = np.linspace(0.02, 1.0, RELAYS)[:, None] * p["width_degC"]
    up, down = middle + half, middle - half
    state = np.where(T[0] > middle, 1.0, -1.0) * np.ones_like(up)
    out = np.empty(T.size)
    for k, now in enumerate(T):
        state = np.where(now >= up, 1.0, np.where(now <= down, -1.0, state))
        out[k] = ((state - np.sign(now - middle)) @ density).mean()
    full = 2.0 * density.max() * half.mean() / (middle[1] - middle[0])
    rows = np.interp(seen.time_s, seen.time_s[::EVERY], -out / full)
    return streams.gyro(target, size * p["half_split_deg_h"] * rows)


@OTHER_FORMS.plants(
    "tyre_cornering",
    ("vehicle",),
    lambda rng, _: {
        "deg_s2_m": signed(rng, 0.4),
        "grip_m_s2": float(rng.uniform(3.0, 6.0)),
        "road_m": float(rng.uniform(0.3, 2.0)),
    },
    needs=frozenset({"taxi"}),
    answers=("side_slip",),
    confounded=("odometer_boresight", "lever_arm"),
)
def cornering(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """Tyres of finite grip: the slip angle grows faster than the side force and builds up over a
    length of road.
    """
    pull = seen.speed_m_s * seen.omega_at_ends[:, 2]
    wanted = p["deg_s2_m"] * DEG * pull / (1.0 - np.minimum(np.abs(pull) / p["grip_m_s2"], 0.6))
    slip = np.zeros(seen.rows)
    share = np.minimum(np.abs(seen.speed_m_s) * seen.dt_s / p["road_m"], 1.0)
    for k in range(1, seen.rows):
        slip[k] = slip[k - 1] + share[k] * (wanted[k] - slip[k - 1])
    sideways = np.outer(-seen.speed_m_s * size * slip, [0.0, 1.0, 0.0])
    return moved(streams, seen, np.einsum("nij,nj->ni", seen.C_nb, sideways))


@OTHER_FORMS.plants(
    "stick_slip_struts",
    ("vehicle",),
    lambda rng, seen: _event_arcsec(rng, len(seen)),
    answers=("platform_settling", "platform_step"),
    confounded=("platform_mount_sag",),
)
def stick_slip(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """A strut settles in jerks: it holds, and gives way by a share of what is left."""
    if seen.number != p["run"]:
        return streams
    rng = seen.rng(p["seed"])
    level, at_s = 0.0, 0.0
    shape = np.zeros(seen.rows)
    while at_s < seen.time_s[-1]:
        at_s += rng.exponential(p["hold_s"])
        jerk = (1.0 - level) * rng.uniform(0.05, 0.2)
        shape += jerk / (1.0 + np.exp(-np.clip((seen.time_s - at_s) / 0.7, -50.0, 50.0)))
        level += jerk
    return tilted(streams, seen, np.outer(shape, size * ARCSEC * np.array(p["arcsec_xyz"])))


@OTHER_FORMS.plants(
    "one_over_f_noise",
    GYROS,
    lambda rng, _: {"instability_deg_h": 0.003, "seed": seed(rng)},
    answers=("slow_variation",),
    confounded=("gyro_rate_ramp", "gyro_turn_on_bias"),
)
def one_over_f(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """Noise whose spectrum is drawn: amplitude as the inverse root of frequency."""
    rng = seen.rng(p["seed"])
    n = seen.rows
    frequency = np.fft.rfftfreq(n, seen.dt_s)
    drawn = rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size)
    drawn[0] = 0.0
    shaped = drawn / np.sqrt(np.maximum(frequency, frequency[1]))
    path = np.fft.irfft(shaped, n) * np.sqrt(n / (2.0 * seen.dt_s))
    return streams.gyro(target, size * p["instability_deg_h"] * path / np.sqrt(np.log(2.0)))


@OTHER_FORMS.plants(
    "slow_thermometer",
    ("temperature",),
    lambda rng, _: {"tau_s": log_uniform(rng, 30.0, 200.0)},
    answers=("temperature_sensor_error",),
    confounded=("gyro_thermal_lag", "gyro_thermal_rate"),
    linear=False,
)
def slow_thermometer(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """The bead sits in grease on a plate: two heat capacities before the reading.

    What a larger effect has more of is delay: a multiple of the deficit would let a reading fall
    where the temperature rises.
    """
    log = streams.temperature
    dt = float(np.median(np.diff(log.time_s)))
    to_plate = 1.0 - np.exp(-dt / max(0.7 * size * p["tau_s"], 1e-9))
    to_bead = 1.0 - np.exp(-dt / max(0.3 * size * p["tau_s"], 1e-9))
    read = log.gyro_degC.copy()
    for axis in range(3):
        true = np.interp(log.time_s, seen.time_s, seen.gyro_degC[:, axis])
        plate, bead = true[0], true[0]
        for k, now in enumerate(true):
            plate += to_plate * (now - plate)
            bead += to_bead * (plate - bead)
            read[k, axis] += bead - now
    return replace(streams, temperature=replace(log, gyro_degC=read))


@OTHER_FORMS.plants(
    "jittered_stamps",
    ("vehicle",),
    lambda rng, _: {"jitter_s": 0.01, "seed": seed(rng)},
    answers=("timestamp_jitter",),
    confounded=("accel_noise", "platform_sway", "gyro_quantization"),
    linear=False,
)
def jittered(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """Each row is taken a little early or late: it holds a part of its neighbour's increment."""
    rng = seen.rng(p["seed"])
    late = np.clip(size * p["jitter_s"] * rng.standard_normal(seen.rows + 1), -0.4, 0.4)
    edge = np.arange(seen.rows + 1) + np.where(np.arange(seen.rows + 1) % seen.rows, late, 0.0)

    def resampled(rows: NDArray) -> NDArray:
        total = np.vstack([np.zeros((1, 3)), np.cumsum(rows, axis=0)])
        grid = np.arange(seen.rows + 1)
        at = np.stack([np.interp(edge, grid, column) for column in total.T], axis=1)
        return np.diff(at, axis=0)

    return replace(
        streams, dtheta_rad=resampled(streams.dtheta_rad), dv_m_s=resampled(streams.dv_m_s)
    )


@OTHER_FORMS.plants(
    "fuel_burn",
    ("vehicle",),
    lambda rng, _: {
        "arcsec_h": (60.0 * rng.standard_normal((2, 3)) * [1.0, 1.0, 0.05]).tolist(),
        "next_tank_s": float(rng.uniform(900.0, 2400.0)),
        "slip_s": log_uniform(rng, 60.0, 200.0),
    },
    answers=("platform_settling", "platform_step", "platform_mount_sag"),
)
def fuel_burn(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """Fuel burns while the vehicle is parked: it tilts steadily, about another axis once the next
    tank is drawn from, and the struts follow with friction.
    """
    second = np.maximum(seen.time_s - p["next_tank_s"], 0.0)
    burnt_h = np.stack([seen.time_s - second, second], axis=1) / 3600.0
    way = burnt_h @ np.array(p["arcsec_h"])
    grip = 0.5 * np.sin(2.0 * np.pi * seen.time_s / p["slip_s"])[:, None]
    parked = np.clip((seen.taxi_s - 30.0 - seen.time_s) / 20.0, 0.0, 1.0)[:, None]
    return tilted(streams, seen, size * ARCSEC * (way + grip * parked))


@OTHER_FORMS.plants(
    "dead_zone",
    GYROS,
    lambda rng, _: {
        "lock_deg_h": log_uniform(rng, 2.0, 6.0),
        "dither_deg_h": log_uniform(rng, 40.0, 100.0),
    },
    answers=("gyro_lock_in",),
    confounded=("gyro_scale_factor", "gyro_scale_asymmetry"),
)
def dead_zone(streams: Streams, seen: Seen, target: str, p: Parameters, size: float) -> Streams:
    """The mean output of a laser whose dither swings at random: its beat vanishes while the rate is
    within the dead zone, w sqrt(1 - (lock / w)^2) elsewhere (Aronowitz 1971).

    Its steps are a twentieth of the dead zone: steps as long as that made a curve of their own.
    """
    axis = axis_of(target)
    rate = seen.dtheta_rad[:, axis] / seen.dt_s
    lock, dither = p["lock_deg_h"] * DEG / 3600.0, p["dither_deg_h"] * DEG / 3600.0
    grid = np.linspace(-10.0 * dither, 10.0 * dither, 401)
    steps = int(16.0 * dither / (0.05 * lock))
    swung = 0.05 * lock * np.arange(-steps, steps + 1)
    lost = np.sign(swung) * np.sqrt(np.maximum(swung**2 - lock**2, 0.0)) - swung
    weights = np.exp(-0.5 * ((swung - grid[:, None]) / dither) ** 2)
    error = weights @ lost / weights.sum(axis=1)
    error = np.interp(rate, grid, error) * np.minimum(
        grid[-1] / np.maximum(np.abs(rate), 1e-9), 1.0
    )
    return streams.turning(target, size * error)


@OTHER_FORMS.plants(
    "fixes_by_heading",
    ("gnss",),
    lambda rng, _: {"metres": 3.0, "bearing_rad": float(rng.uniform(0.0, 2.0 * np.pi))},
    needs=frozenset({"gnss"}),
    answers=("unknown", "gnss_lever_arm_or_latency"),
)
def fixes_by_heading(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """A wing reflects: fixes are off along a direction of the body, their velocities are not."""
    log = streams.gnss
    bearing = seen.heading_rad[seen.nearest(log.time_s)] + p["bearing_rad"]
    off_m = size * p["metres"] * np.cos(bearing), size * p["metres"] * np.sin(bearing)
    radius_m = 6.371e6
    gnss = replace(
        log,
        lat_rad=log.lat_rad + off_m[0] / radius_m,
        lon_rad=log.lon_rad + off_m[1] / (radius_m * np.cos(log.lat_rad)),
    )
    return replace(streams, gnss=gnss)


@OTHER_FORMS.plants(
    "white_vibration",
    ("vehicle",),
    lambda rng, seen: {
        "run": int(rng.integers(len(seen))),
        "shares": [0.3, 0.5, 1.0],
        "ug_sqrt_hz": 20.0,
        "seed": seed(rng),
    },
    answers=("platform_vibration", "accel_noise"),
    linear=False,
)
def white_vibration(
    streams: Streams, seen: Seen, target: str, p: Parameters, size: float
) -> Streams:
    """A machine shakes the vehicle in one run, at no frequency of its own: white force on all."""
    if seen.number != p["run"]:
        return streams
    rng = seen.rng(p["seed"])
    for axis, share in zip("xyz", p["shares"]):
        force = share * p["ug_sqrt_hz"] / np.sqrt(seen.dt_s) * rng.standard_normal(seen.rows)
        streams = streams.accel(f"accel_{axis}", size * force)
    return streams


def _event_arcsec(rng: np.random.Generator, runs: int) -> Parameters:
    way = rng.uniform(0, 2 * np.pi)
    level = [80.0 * float(np.cos(way)), 80.0 * float(np.sin(way)), 0.0]
    return {
        "run": int(rng.integers(runs)),
        "arcsec_xyz": level,
        "hold_s": log_uniform(rng, 60.0, 240.0),
        "seed": seed(rng),
    }
