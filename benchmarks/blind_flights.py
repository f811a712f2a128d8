"""Flights written from the physics alone: no package of the project takes part in their truth.

The IMU's place is a spline in the Earth frame, its attitude a spline of Euler angles; body rates
and specific force are their exact derivatives, increments the integrals of these (Gauss, two nodes
a row). Gravity is that of the normal field (J2, J4, J6 and the centrifugal term), turned by a
random field of deflections that is the slope of a potential. The antenna turns with the body. What
is drawn is of the sizes that `formats.md` section 3 and the issue give, not of the update's priors.
Runs are written as `formats.md` section 1 says, and read by the program like any other.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, sosfiltfilt

# WGS 84 (NIMA TR8350.2), zonal terms of its normal field
GM, A, F, OMEGA = 3.986004418e14, 6378137.0, 1.0 / 298.257223563, 7.292115e-5
E2 = F * (2.0 - F)
ZONALS = {2: 1.082629821e-3, 4: -2.37091e-6, 6: 6.0835e-9}
G0 = 9.80665
DEG, ARCSEC, DEG_H, UG = np.pi / 180.0, np.pi / 648000.0, np.pi / 648000.0, 1e-6 * G0
HOUR = 3600.0

RATE_HZ, KNOT_S = 50.0, 0.25
LATITUDES_DEG = (47.0, 35.0, 62.0, -33.0, 12.0)
NODES_DEGC = np.arange(-30.0, 61.0, 10.0)
SERIAL = "BLIND-1"
TURBULENCE_DEG, TURBULENCE_HZ = (0.3, 0.2, 0.1), 0.35  # roll, pitch, yaw, RMS
GUST_M_S, GUST_HZ = 0.4, 0.15  # of the vehicle's way, each axis
WAVES = 60  # of the deflection's field
# deg/h, deg/sqrt(h): angle walk, flicker, rate walk per sqrt(h), turn-on, table's sigma; ppm, mrad
GYROS = {
    "rlg": {"arw": 0.002, "flicker": 0.002, "walk": 0.002, "turn_on": 0.003, "table": 0.008},
    "fog": {"arw": 0.002, "flicker": 0.002, "walk": 0.002, "turn_on": 0.003, "table": 0.03},
}
SCALE_PPM, MISALIGNED_MRAD = {"rlg": 4.0, "fog": 40.0}, {"rlg": 0.008, "fog": 0.016}
VRW_UG, ACCEL_FLICKER_UG, ACCEL_WALK_UG, ACCEL_ON_UG = 10.0, 1.0, 2.0, 30.0
ACCEL_SCALE_PPM, ACCEL_SLOPE_UG = 60.0, 0.15
WHITE = {"horizontal": 0.5, "vertical": 0.75, "velocity": 0.03}


# ---- the way


@dataclass
class Profile:
    """What a vehicle is told: speed, turn rate and climb rate at knots, KNOT_S apart."""

    speed_m_s: list[float] = field(default_factory=lambda: [0.0])
    turn_rad_s: list[float] = field(default_factory=lambda: [0.0])
    climb_m_s: list[float] = field(default_factory=lambda: [0.0])
    airborne: list[float] = field(default_factory=lambda: [0.0])

    def add(
        self,
        duration_s: float,
        speed_m_s: float | None = None,
        *,
        turn_deg: float = 0.0,
        climb_m: float = 0.0,
        airborne: bool = False,
    ) -> None:
        """Go on for so long: to a speed, through an angle, by a height, each begun and ended
        smoothly.
        """
        count = max(round(duration_s / KNOT_S), 1)
        u = (np.arange(count) + 1.0) / count
        step = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        bump = 30.0 * u**2 * (1.0 - u) ** 2 / (count * KNOT_S)
        before = self.speed_m_s[-1]
        after = before if speed_m_s is None else speed_m_s
        self.speed_m_s += (before + (after - before) * step).tolist()
        self.turn_rad_s += (turn_deg * DEG * bump).tolist()
        self.climb_m_s += (climb_m * bump).tolist()
        self.airborne += [float(airborne)] * count


def flight_profile(rng: np.random.Generator, parked_s: float = 1800.0) -> Profile:
    """Parked, taxi with stops, two turns a leg, an hour in the air, landing, taxi, parked."""
    way = Profile()
    side = float(rng.choice([-1.0, 1.0]))
    way.add(parked_s)
    way.add(12.0, 8.0)
    way.add(60.0)
    way.add(15.0, 5.0, turn_deg=90.0 * side)
    way.add(70.0, 10.0)
    way.add(12.0, 0.0)
    way.add(60.0)
    way.add(12.0, 6.0)
    way.add(15.0, turn_deg=-float(rng.uniform(60.0, 110.0)) * side)
    way.add(60.0, 9.0)
    way.add(12.0, 4.0)
    way.add(15.0, turn_deg=float(rng.uniform(60.0, 110.0)) * side)
    way.add(10.0, 0.0)
    way.add(40.0)
    way.add(30.0, 75.0)
    way.add(20.0, 90.0, climb_m=100.0, airborne=True)
    height = float(rng.uniform(4000.0, 9000.0))
    way.add(height / 8.0, 180.0, climb_m=height, airborne=True)
    for _ in range(4):
        angle = float(rng.uniform(40.0, 120.0) * rng.choice([-1.0, 1.0]))
        way.add(1.2 * abs(angle), turn_deg=angle, airborne=True)
        way.add(float(rng.uniform(400.0, 700.0)), float(rng.uniform(170.0, 220.0)), airborne=True)
    way.add(height / 7.0, 95.0, climb_m=-height, airborne=True)
    way.add(80.0, turn_deg=90.0 * side, airborne=True)
    way.add(60.0, 75.0, airborne=True)
    way.add(30.0, 65.0, climb_m=-100.0, airborne=True)
    way.add(40.0, 8.0)
    way.add(40.0)
    way.add(15.0, turn_deg=-90.0 * side)
    way.add(40.0)
    way.add(12.0, 0.0)
    way.add(400.0)
    return way


def geodetic(r_e: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Latitude, longitude and height (n,) of places (n, 3); Bowring's formula, iterated."""
    x, y, z = r_e.T
    p, lon = np.hypot(x, y), np.arctan2(y, x)
    beta = np.arctan2(z, (1.0 - F) * p)
    for _ in range(3):
        over = z + E2 * (1.0 - F) / (1.0 - E2) * A * np.sin(beta) ** 3
        lat = np.arctan2(over, p - E2 * A * np.cos(beta) ** 3)
        beta = np.arctan2((1.0 - F) * np.sin(lat), np.cos(lat))
    N = A / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)
    height = p * np.cos(lat) + z * np.sin(lat) - A**2 / N
    return lat, lon, height


def earth_place(lat: NDArray, lon: NDArray, height: NDArray) -> NDArray:
    N = A / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)
    level = (N + height) * np.cos(lat)
    z = (N * (1.0 - E2) + height) * np.sin(lat)
    return np.column_stack([level * np.cos(lon), level * np.sin(lon), z])


def north_east_down(lat: NDArray, lon: NDArray) -> NDArray:
    """C_en (n, 3, 3): columns are north, east and down in the Earth frame."""
    sL, cL, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    zero = np.zeros_like(lat)
    north = np.column_stack([-sL * cl, -sL * sl, cL])
    east = np.column_stack([-sl, cl, zero])
    down = np.column_stack([-cL * cl, -cL * sl, -sL])
    return np.stack([north, east, down], axis=2)


def body_to_level(angles: NDArray) -> NDArray:
    """C_nb (n, 3, 3) of roll, pitch and heading (n, 3)."""
    (sr, sp, sh), (cr, cp, ch) = np.sin(angles).T, np.cos(angles).T
    rows = [
        [cp * ch, sr * sp * ch - cr * sh, cr * sp * ch + sr * sh],
        [cp * sh, sr * sp * sh + cr * ch, cr * sp * sh - sr * ch],
        [-sp, sr * cp, cr * cp],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def normal_gravity(r_e: NDArray) -> NDArray:
    """Attraction and centrifugal acceleration (n, 3), Earth frame."""
    r = np.linalg.norm(r_e, axis=1)
    u = r_e[:, 2] / r
    outward, along = np.ones_like(r), np.zeros_like(r)
    for n, J in ZONALS.items():
        P = np.polynomial.legendre.Legendre.basis(n)
        size = J * (A / r) ** n
        outward -= (n + 1) * size * P(u)
        along -= size * P.deriv()(u)
    unit = r_e / r[:, None]
    pole = np.array([0.0, 0.0, 1.0]) - u[:, None] * unit
    attraction = (GM / r**2)[:, None] * (along[:, None] * pole - outward[:, None] * unit)
    return attraction + OMEGA**2 * r_e * np.array([1.0, 1.0, 0.0])


def deflection_field(
    rng: np.random.Generator, rms_rad: float, length_m: float
) -> Callable[[NDArray, NDArray], NDArray]:
    """Deflection (n, 2) over north and east [m]: the slope of a random potential, of this RMS in
    each component; wave numbers normal, 1 / length.
    """
    k = rng.standard_normal((WAVES, 2)) / length_m
    unit = k / np.linalg.norm(k, axis=1)[:, None]
    size = rms_rad * np.sqrt(2.0) * np.sqrt(2.0 / WAVES)
    phase = rng.uniform(0.0, 2.0 * np.pi, WAVES)

    def at(north_m: NDArray, east_m: NDArray) -> NDArray:
        waves = np.sin(np.outer(north_m, k[:, 0]) + np.outer(east_m, k[:, 1]) + phase)
        return size * waves @ unit

    return at


@dataclass(frozen=True)
class Motion:
    """The truth as functions of time: place (Earth frame), attitude, gravity."""

    end_s: float
    place: CubicSpline
    origin: NDArray
    angles: CubicSpline
    airborne: CubicSpline
    deflection: CubicSpline

    def at(self, time_s: NDArray) -> "State":
        r_e = self.place(time_s) + self.origin
        v_e, a_e = self.place(time_s, 1), self.place(time_s, 2)
        lat, lon, height = geodetic(r_e)
        C_en = north_east_down(lat, lon)
        v_n = np.einsum("kji,kj->ki", C_en, v_e)
        angles, rates = self.angles(time_s), self.angles(time_s, 1)
        C_nb = body_to_level(angles)
        s2 = np.sin(lat) ** 2
        across = A / np.sqrt(1.0 - E2 * s2)
        along = across * (1.0 - E2) / (1.0 - E2 * s2)
        earth_n = OMEGA * np.column_stack([np.cos(lat), 0.0 * lat, -np.sin(lat)])
        east = v_n[:, 1] / (across + height)
        turn_n = np.column_stack([east, -v_n[:, 0] / (along + height), -east * np.tan(lat)])
        (sr, sp, _), (cr, cp, _) = np.sin(angles).T, np.cos(angles).T
        roll, pitch, yaw = rates.T
        own = [roll - yaw * sp, pitch * cr + yaw * cp * sr, -pitch * sr + yaw * cp * cr]
        to_body = np.swapaxes(C_nb, 1, 2)
        from_earth = np.column_stack(own) + np.einsum("kij,kj->ki", to_body, turn_n)
        rate = from_earth + np.einsum("kij,kj->ki", to_body, earth_n)
        g_e = normal_gravity(r_e)
        size = np.linalg.norm(g_e, axis=1)
        pull = np.column_stack([self.deflection(time_s) * size[:, None], 0.0 * size])
        g_n = np.einsum("kji,kj->ki", C_en, g_e) + pull
        spin = np.array([0.0, 0.0, OMEGA])
        f_n = np.einsum("kji,kj->ki", C_en, a_e + 2.0 * np.cross(spin, v_e)) - g_n
        force = np.einsum("kij,kj->ki", to_body, f_n)
        return State(lat, lon, height, r_e, v_n, C_en, C_nb, rate, from_earth, force)


@dataclass(frozen=True)
class State:
    """rate: of the body in inertial space, from_earth: about the Earth (n, 3) [rad/s]; force:
    specific, body axes.
    """

    lat: NDArray
    lon: NDArray
    height: NDArray
    r_e: NDArray
    v_n: NDArray
    C_en: NDArray
    C_nb: NDArray
    rate: NDArray
    from_earth: NDArray
    force: NDArray

    def antenna(self, arm_b: NDArray) -> tuple[NDArray, NDArray]:
        """Place (n, 3), Earth frame, and velocity (n, 3), NED, of a point of the body."""
        arm_n = np.einsum("kij,j->ki", self.C_nb, arm_b)
        r_e = self.r_e + np.einsum("kij,kj->ki", self.C_en, arm_n)
        swing = np.einsum("kij,kj->ki", self.C_nb, np.cross(self.from_earth, arm_b))
        return r_e, self.v_n + swing


def band_limited(rng: np.random.Generator, count: int, highest_hz: float) -> NDArray:
    """Noise of RMS 1 at the knots, below a frequency."""
    sos = butter(4, highest_hz, fs=1.0 / KNOT_S, output="sos")
    noise = sosfiltfilt(sos, rng.standard_normal(count))
    return np.asarray(noise / noise.std())


def markov(rng: np.random.Generator, count: int, rms: float, kept: float) -> NDArray:
    """A first-order Gauss-Markov process (count,)."""
    news = rms * np.sqrt(1.0 - kept**2) * rng.standard_normal(count)
    news[0] = rms * rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -kept], news))


@dataclass(frozen=True, kw_only=True)
class World:
    """What a flight goes through beside its unit and its receiver."""

    deflection_arcsec: float
    deflection_km: float
    turbulence: float = 1.0
    moves: float = 1.0  # sway, creep, side motion and gusts of the vehicle: 0 of a dead calm


def motion_of(rng: np.random.Generator, place: int, world: World) -> Motion:
    """A flight from one of the latitudes."""
    way = flight_profile(rng)
    speed, turn, climb, up = (
        np.array(column) for column in (way.speed_m_s, way.turn_rad_s, way.climb_m_s, way.airborne)
    )
    count = speed.size
    time_s = KNOT_S * np.arange(count)
    smooth = np.hanning(41) / np.hanning(41).sum()
    aloft = np.convolve(up, smooth, mode="same") * up
    still, rolling = speed < 0.05, (speed > 1.0) & (up == 0.0)
    course = rng.uniform(0.0, 2.0 * np.pi) + KNOT_S * np.cumsum(turn)
    bank = np.arctan2(speed * turn, G0) * aloft
    pitch = np.arctan2(climb, np.maximum(speed, 30.0)) + 2.0 * DEG * aloft
    creep = 3.0 * ARCSEC * np.sqrt(KNOT_S / HOUR) * rng.standard_normal(count)
    rough = [world.turbulence * s * DEG * aloft for s in TURBULENCE_DEG]
    shaken = [size * band_limited(rng, count, TURBULENCE_HZ) for size in rough]
    angles = np.column_stack(
        [
            bank + shaken[0],
            pitch + shaken[1],
            course + shaken[2] + world.moves * np.cumsum(np.where(still, creep, 0.0)),
        ]
    )
    side = world.moves * 0.02 * rolling * markov(rng, count, 1.0, np.exp(-KNOT_S / 2.0))
    v_n = np.column_stack(
        [
            speed * np.cos(course) - side * np.sin(course),
            speed * np.sin(course) + side * np.cos(course),
            -climb,
        ]
    )
    gust = np.column_stack([band_limited(rng, count, GUST_HZ) for _ in range(3)])
    v_n += world.moves * world.turbulence * GUST_M_S * aloft[:, None] * gust
    sway = np.column_stack([swaying(rng, count), swaying(rng, count), np.zeros(count)])
    v_n += world.moves * 0.001 * (up == 0.0)[:, None] * sway
    k = place % len(LATITUDES_DEG)
    lat0, lon0 = LATITUDES_DEG[k] * DEG, (7.0 + 20.0 * k) * DEG
    lat, lon, height = np.empty((3, count))
    lat[0], lon[0], height[0] = lat0, lon0, 300.0
    mean = 0.5 * (v_n[1:] + v_n[:-1]) * KNOT_S
    height[1:] = 300.0 - np.cumsum(mean[:, 2])
    lat[1:] = lat0 + np.cumsum(mean[:, 0] / (6.36e6 + height[:-1]))
    lon[1:] = lon0 + np.cumsum(mean[:, 1] / ((6.38e6 + height[:-1]) * np.cos(lat[:-1])))
    origin = earth_place(lat[:1], lon[:1], height[:1])[0]
    slope = deflection_field(rng, world.deflection_arcsec * ARCSEC, world.deflection_km * 1e3)
    north, east = (lat - lat0) * A, (lon - lon0) * A * np.cos(lat0)
    each = slice(None, None, 4)
    return Motion(
        end_s=float(time_s[-1]),
        place=CubicSpline(time_s, earth_place(lat, lon, height) - origin),
        origin=origin,
        angles=CubicSpline(time_s, angles),
        airborne=CubicSpline(time_s, aloft),
        deflection=CubicSpline(time_s[each], slope(north[each], east[each])),
    )


def swaying(rng: np.random.Generator, count: int) -> NDArray:
    """Velocity of RMS 1 of a damped oscillator under white force, 0.28 Hz."""
    w, damping = 2.0 * np.pi * 0.28, 0.2
    poles = np.exp((-damping + 1j * np.sqrt(1.0 - damping**2)) * w * KNOT_S)
    news = rng.standard_normal(count)
    moved = lfilter([1.0, -1.0], [1.0, -2.0 * poles.real, abs(poles) ** 2], news)
    return np.asarray(moved / moved.std())


# ---- sensors


def increments(
    motion: Motion, start_s: float = 0.0, end_s: float | None = None
) -> tuple[NDArray, NDArray, NDArray]:
    """Times (n,) and the integrals of rate and specific force over each row (n, 3)."""
    dt = 1.0 / RATE_HZ
    end_s = motion.end_s if end_s is None else end_s
    time_s = dt * np.arange(round(start_s * RATE_HZ) + 1, int(end_s * RATE_HZ))
    turned, pushed = np.empty((time_s.size, 3)), np.empty((time_s.size, 3))
    for first in range(0, time_s.size, 50_000):
        rows = slice(first, first + 50_000)
        middle = time_s[rows] - 0.5 * dt
        nodes = [motion.at(middle + sign * dt / np.sqrt(12.0)) for sign in (-1.0, 1.0)]
        turned[rows] = 0.5 * dt * (nodes[0].rate + nodes[1].rate)
        pushed[rows] = 0.5 * dt * (nodes[0].force + nodes[1].force)
    return time_s, turned, pushed


def flicker(rng: np.random.Generator, count: int) -> NDArray:
    """Bias instability of B = 1 at 1 Hz: two-sided spectrum 1 / (2 pi f) from 1 / (4 length)."""
    whole = 4 * count
    f = np.fft.rfftfreq(whole, 1.0)
    size = np.zeros(f.size)
    size[1:] = np.sqrt(whole / (2.0 * np.pi * f[1:]))
    noise = (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)) / np.sqrt(2.0)
    return np.fft.irfft(size * noise, whole)[:count]


def wandering(
    rng: np.random.Generator, count: int, *, turn_on: float, instability: float, walk: float
) -> NDArray:
    """A sensor's bias (count, 3) at 1 Hz: turn-on, flicker, random walk per sqrt(h)."""
    columns = []
    for _ in range(3):
        walked = np.cumsum(walk * np.sqrt(1.0 / HOUR) * rng.standard_normal(count))
        columns.append(turn_on * rng.standard_normal() + instability * flicker(rng, count) + walked)
    return np.column_stack(columns)


def temperatures(rng: np.random.Generator, motion: Motion, seconds: NDArray) -> NDArray:
    """Of the gyros (n, 3) [degC]: they warm at rest and cool aloft."""
    outside = rng.uniform(-5.0, 20.0)
    aloft = np.clip(motion.airborne(seconds), 0.0, 1.0)
    aim = outside + 22.0 - rng.uniform(25.0, 45.0) * aloft
    slow = rng.uniform(1000.0, 1800.0, 3)
    columns = []
    for tau in slow:
        kept = np.exp(-1.0 / tau)
        news = (1.0 - kept) * aim
        news[0] = outside
        columns.append(lfilter([1.0], [1.0, -kept], news))
    return np.column_stack(columns) + rng.normal(0.0, 0.5, 3)


def drawn_table(rng: np.random.Generator, technology: str) -> tuple[dict, NDArray]:
    """A factory table, and the unit's nodes (nodes, 3) today, off by its declared sigma."""
    sigma = GYROS[technology]["table"]
    apart = NODES_DEGC[:, None] - NODES_DEGC
    law = sigma**2 * (0.7 + 0.3 * np.exp(-(apart**2) / (2.0 * 30.0**2)))
    half = np.linalg.cholesky(law + 1e-12 * np.eye(NODES_DEGC.size))
    axes, true = {}, []
    for axis in "xyz":
        factory = 10.0 * sigma * np.sin(NODES_DEGC / 40.0 + rng.uniform(0.0, 6.0))
        true.append(factory + half @ rng.standard_normal(NODES_DEGC.size))
        axes[axis] = {
            "temperature_degC": NODES_DEGC.tolist(),
            "bias_deg_h": factory.tolist(),
            "sigma_deg_h": [sigma] * NODES_DEGC.size,
        }
    table = {
        "schema": "recal.table/1",
        "imu_serial": SERIAL,
        "gyro_technology": technology,
        "created_utc": "2026-01-01T00:00:00Z",
        "interpolation": "linear",
        "axes": axes,
        "covariance": None,
        "provenance": {"parent_sha256": None, "runs": []},
    }
    return table, np.column_stack(true)


@dataclass(frozen=True, kw_only=True)
class Faults:
    """What is wrong beyond what a sound flight has."""

    late_s: float | None = None
    arm_off_m: float = 0.0
    step_deg_h: float = 0.0
    outage_s: float = 0.0
    declared: float = 1.0  # of the receiver's sigmas
    scale_ppm: float = 0.0
    deflection_arcsec: float | None = None
    other_unit: bool = False
    turbulence: float = 1.0
    arm_m: tuple[float, float, float] | None = None  # of the antenna; None: drawn


SOUND = Faults()
HOSTILE: Mapping[str, Faults] = {
    "late by 0.3 s": Faults(late_s=0.3),
    "arm 2 m wrong": Faults(arm_off_m=2.0),
    "step of 0.02 deg/h at take-off": Faults(step_deg_h=0.02),
    "outage of 5 min": Faults(outage_s=300.0),
    "sigmas a third": Faults(declared=1.0 / 3.0),
    "scale 500 ppm": Faults(scale_ppm=500.0),
    "deflection 30 arcsec": Faults(deflection_arcsec=30.0),
    "wrong unit": Faults(other_unit=True),
}


@dataclass(frozen=True)
class Made:
    """A flight in its folder, and what only its maker knows: biases (n, 3) [deg/h] of the log at
    each second; nodes (nodes, 3) of the unit that the log says it is of.
    """

    folder: Path
    bias_deg_h: NDArray
    nodes_deg_h: NDArray
    world: World
    take_off_s: float
    landed_s: float


def write_flight(
    folder: Path, seed: int, technology: str, faults: Faults = SOUND, *, silent: bool = False
) -> Made:
    """Draw a flight and write its run, its table and nothing else. silent: perfect sensors."""
    rng = np.random.default_rng([2026, seed])
    world = World(
        deflection_arcsec=float(np.exp(rng.uniform(np.log(3.0), np.log(30.0)))),
        deflection_km=float(rng.uniform(15.0, 60.0)),
        turbulence=faults.turbulence,
    )
    if faults.deflection_arcsec is not None:
        world = replace(world, deflection_arcsec=faults.deflection_arcsec)
    if silent:
        world = replace(world, deflection_arcsec=0.0, moves=0.0)
    motion = motion_of(rng, seed, world)
    seconds = np.arange(0.0, np.floor(motion.end_s))
    up = seconds[motion.airborne(seconds) > 0.5]
    degC = temperatures(rng, motion, seconds)
    table, nodes = drawn_table(rng, technology)
    flown = drawn_table(rng, technology)[1] if faults.other_unit else nodes
    gyro = GYROS[technology]
    thermal = [np.interp(t, NODES_DEGC, node) for t, node in zip(degC.T, flown.T)]
    bias = np.column_stack(thermal) + wandering(
        rng, seconds.size, turn_on=gyro["turn_on"], instability=gyro["flicker"], walk=gyro["walk"]
    )
    time_s, turned, pushed = increments(motion)
    if not silent:
        read = bias + np.where(seconds > up[0], faults.step_deg_h, 0.0)[:, None]
        turned, pushed = _through_sensors(
            rng, (time_s, turned, pushed), read, degC, technology, faults.scale_ppm
        )
    folder.mkdir(parents=True, exist_ok=True)
    _write_rows(folder / "imu.parquet", time_s, dtheta_rad=turned, dv_m_s=pushed)
    noisy = np.round(degC + 0.01 * rng.standard_normal(degC.shape), 2)
    _write_rows(folder / "temperature.parquet", seconds, gyro_degC=noisy)
    arm = _write_fixes(folder, rng, motion, faults, silent=silent)
    first = motion.at(np.array([0.0]))
    header = {
        "schema": "recal.run/1",
        "run_id": f"blind-{technology}-{seed}",
        "tail": "BLIND",
        "imu_serial": SERIAL,
        "gyro_technology": technology,
        "start_utc": "2026-06-01T06:00:00Z",
        "site": {
            "lat_deg": float(first.lat[0] / DEG),
            "lon_deg": float(first.lon[0] / DEG),
            "height_m": float(first.height[0]),
        },
        "lever_arms_m": {"wheel_reference": [0, 0, 0], "gnss": arm.tolist()},
        "applied_table_sha256": None,
    }
    (folder / "run.json").write_text(json.dumps(header), encoding="utf-8")
    (folder / "table.json").write_text(json.dumps(table), encoding="utf-8")
    return Made(folder, bias, nodes, world, float(up[0]), float(up[-1]))


def _through_sensors(
    rng: np.random.Generator,
    rows: tuple[NDArray, NDArray, NDArray],
    bias_deg_h: NDArray,
    degC: NDArray,
    technology: str,
    scale_ppm: float,
) -> tuple[NDArray, NDArray]:
    """Increments as gyros and accelerometers read them."""
    time_s, turned, pushed = rows
    dt, seconds = 1.0 / RATE_HZ, np.arange(float(len(bias_deg_h)))

    def at_rows(columns: NDArray) -> NDArray:
        return np.column_stack([np.interp(time_s, seconds, c) for c in columns.T])

    scale = SCALE_PPM[technology] * rng.standard_normal(3) + scale_ppm
    crossed = 1e-3 * MISALIGNED_MRAD[technology] * rng.standard_normal((3, 3))
    M = np.eye(3) + np.diag(1e-6 * scale) + crossed * (1.0 - np.eye(3))
    arw = GYROS[technology]["arw"] * DEG / 60.0 * np.sqrt(dt)
    turned = turned @ M.T + dt * DEG_H * at_rows(bias_deg_h)
    turned = turned + arw * rng.standard_normal(turned.shape)
    accel = wandering(
        rng, seconds.size, turn_on=ACCEL_ON_UG, instability=ACCEL_FLICKER_UG, walk=ACCEL_WALK_UG
    )
    accel += ACCEL_SLOPE_UG * rng.standard_normal(3) * (degC - degC[0])
    pushed = pushed * (1.0 + 1e-6 * ACCEL_SCALE_PPM * rng.standard_normal(3))
    pushed = pushed + dt * UG * at_rows(accel)
    return turned, pushed + VRW_UG * UG * np.sqrt(dt) * rng.standard_normal(pushed.shape)


def _write_fixes(
    folder: Path, rng: np.random.Generator, motion: Motion, faults: Faults, *, silent: bool
) -> NDArray:
    """Fixes of an antenna that turns with the body, stamped late; the arm as declared."""
    late = float(rng.uniform(0.02, 0.05)) if faults.late_s is None else faults.late_s
    arm = rng.standard_normal(3)
    arm *= rng.uniform(0.5, 3.0) / np.linalg.norm(arm)
    if faults.arm_m is not None:
        arm = np.array(faults.arm_m)
    off = rng.standard_normal(3)
    true_arm = arm + faults.arm_off_m * off / np.linalg.norm(off)
    stamps = np.arange(1.0, np.floor(motion.end_s) - 1.0)
    if faults.outage_s:
        up = stamps[motion.airborne(stamps) > 0.5]
        gone = rng.uniform(up[0] + 300.0, up[-1] - 600.0)
        stamps = stamps[(stamps < gone) | (stamps > gone + faults.outage_s)]
    r_e, v_n = motion.at(stamps - (0.0 if silent else late)).antenna(true_arm)
    lat, lon, height = geodetic(r_e)
    count = stamps.size
    noise = 0.0 if silent else 1.0
    slow_m, slow_s = rng.uniform(0.5, 2.0), rng.uniform(150.0, 600.0)
    drift_m_s, drift_s = rng.uniform(0.004, 0.014), rng.uniform(30.0, 120.0)
    place = np.column_stack(
        [markov(rng, count, slow_m, np.exp(-1.0 / slow_s)) for _ in range(3)]
    ) + rng.standard_normal((count, 3)) * [0.5, 0.5, WHITE["vertical"]]
    v_n = v_n + noise * np.column_stack(
        [markov(rng, count, drift_m_s, np.exp(-1.0 / drift_s)) for _ in range(3)]
    )
    v_n = v_n + noise * WHITE["velocity"] * rng.standard_normal((count, 3))
    lat = lat + noise * place[:, 0] / (6.37e6 + height)
    lon = lon + noise * place[:, 1] / ((6.38e6 + height) * np.cos(lat))
    frame = pd.DataFrame({"time_s": stamps, "lat_deg": lat / DEG, "lon_deg": lon / DEG})
    frame["height_m"] = height + noise * place[:, 2]
    frame[["vn_m_s", "ve_m_s", "vd_m_s"]] = v_n
    frame["sigma_horizontal_m"] = faults.declared * np.hypot(WHITE["horizontal"], slow_m)
    frame["sigma_vertical_m"] = faults.declared * np.hypot(WHITE["vertical"], slow_m)
    frame["sigma_velocity_m_s"] = faults.declared * np.hypot(WHITE["velocity"], drift_m_s)
    frame.to_parquet(folder / "gnss.parquet")
    return arm


def _write_rows(path: Path, time_s: NDArray, **vectors: NDArray) -> None:
    """A stream of vectors (n, 3), named as `gyro_x_degC`."""
    frame = pd.DataFrame({"time_s": time_s})
    for name, rows in vectors.items():
        head, unit = name.split("_", 1)
        for axis, column in zip("xyz", rows.T):
            frame[f"{head}_{axis}_{unit}"] = column
    frame.to_parquet(path)
