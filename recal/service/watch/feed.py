"""A run sent as MAVLink, as an autopilot sends what it measures: to try `recal watch` on."""

import socket
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ins.records import InputError, Run
from ins.units import DEG
from trajectories.readers.live.mavlink_source import NEEDS_EXTRA, TEMPERATURE_BIT
from trajectories.runs.directory import read_run

BOOT_S = 10.0  # of the autopilot's clock, at the start of the run
# sent at once, by the clock, and at most: a socket's buffer holds them
BURST_S, BURST_ROWS = 0.02, 200
IMU_BITS = 0x3F | TEMPERATURE_BIT  # of HIGHRES_IMU: gyros, accelerometers, temperature


def feed(
    run: Run | Path,
    address: str,
    *,
    speed: float = 1.0,
    told: Callable[[str], None] = lambda words: None,
) -> int:
    """Send a run as HIGHRES_IMU and GPS_RAW_INT.

    Parameters
    ----------
    run : Run or path
        Or its run directory. Its rates are sent in float32, as the message has them; the
        temperature is the mean of the three gyros'.
    address : str
        `udp:HOST:PORT` to send to, or `tcp:HOST:PORT` to wait on for one that connects.
    speed : float
        Times as fast as it was.
    told : callable
        Told what is being done.

    Returns
    -------
    sent : int
        Messages.

    Raises
    ------
    InputError
        Where the address cannot be had, or pymavlink is not installed.
    """
    if not find_spec("pymavlink"):
        raise InputError(NEEDS_EXTRA)
    run = read_run(run) if isinstance(run, Path) else run
    link = _opened(address, told)
    told(f"sending {run.header.run_id} to {address}, {speed:g} times as fast")
    burst = max(min(int(BURST_S * speed * run.imu.rate_hz), BURST_ROWS), 1)
    begun_s = time.monotonic()
    sent = refused = 0
    try:
        for k, (time_s, packet) in enumerate(packets(run)):
            if k % burst == 0:
                ahead_s = time_s / speed - (time.monotonic() - begun_s)
                if ahead_s > 0:
                    time.sleep(ahead_s)
            try:
                link.sendall(packet)
                sent += 1
            except ConnectionRefusedError:  # by udp: who listens may come yet, or come again
                refused += 1
    except (BrokenPipeError, ConnectionResetError):
        told(f"the other end closed after {sent} messages")
    finally:
        link.close()
    if refused:
        told(f"{refused} messages found nobody at {address}")
    return sent


def packets(run: Run) -> Iterator[tuple[float, bytes]]:
    """Run time [s] and bytes of each message, in the order of time."""
    from pymavlink.dialects.v20 import common

    encoder = common.MAVLink(None, srcSystem=1, srcComponent=1)
    encoder.robust_parsing = True
    fixes = _fixes(run)
    next_fix = next(fixes, None)
    for piece in run.imu.pieces():
        rates = np.column_stack([piece.dv_m_s, piece.dtheta_rad]) / piece.dt_s[:, None]
        degC = _degC(run, piece.time_s)
        for time_s, row, warm in zip(piece.time_s.tolist(), rates.tolist(), degC.tolist()):
            while next_fix is not None and next_fix[0] <= time_s:
                yield next_fix[0], common.MAVLink_gps_raw_int_message(*next_fix[1]).pack(encoder)
                _count(encoder)
                next_fix = next(fixes, None)
            bits = IMU_BITS if np.isfinite(warm) else IMU_BITS & ~TEMPERATURE_BIT
            nothing = (0.0,) * 6
            message = common.MAVLink_highres_imu_message(_usec(time_s), *row, *nothing, warm, bits)
            yield time_s, message.pack(encoder)
            _count(encoder)


def _count(encoder) -> None:
    encoder.seq = (encoder.seq + 1) % 256


def _usec(time_s: float) -> int:
    return round(1e6 * (time_s + BOOT_S))


def _degC(run: Run, time_s: np.ndarray) -> np.ndarray:
    if run.temperature is None:
        return np.full(time_s.size, np.nan)
    log = run.temperature
    return np.interp(time_s, log.time_s, log.gyro_degC.mean(axis=1))


def _fixes(run: Run) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Time and fields of each fix."""
    log = run.gnss
    if log is None:
        return
    zeros = np.zeros(log.time_s.size)
    h_m, v_m, s_m_s = (
        zeros if sigma is None else np.nan_to_num(sigma)
        for sigma in (log.sigma_horizontal_m, log.sigma_vertical_m, log.sigma_velocity_m_s)
    )
    north, east = log.v_n_m_s[:, 0], log.v_n_m_s[:, 1]
    course = np.degrees(np.arctan2(east, north)) % 360.0
    for k, time_s in enumerate(log.time_s.tolist()):
        height = round(1e3 * log.height_m[k])
        place = (round(1e7 * log.lat_rad[k] / DEG), round(1e7 * log.lon_rad[k] / DEG), height)
        motion = (round(100.0 * np.hypot(north[k], east[k])), round(100.0 * course[k]) % 36_000)
        sigmas = (round(1e3 * h_m[k]), round(1e3 * v_m[k]), round(1e3 * s_m_s[k]))
        yield time_s, (_usec(time_s), 3, *place, 65_535, 65_535, *motion, 12, height, *sigmas)


def _opened(address: str, told: Callable[[str], None]) -> socket.socket:
    kind, _, rest = address.partition(":")
    host, _, port = rest.rpartition(":")
    if kind not in ("udp", "tcp") or not host or not port.isdecimal():
        raise InputError(f"{address}: needed udp:HOST:PORT or tcp:HOST:PORT")
    try:
        if kind == "udp":
            family = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)[0][0]
            link = socket.socket(family, socket.SOCK_DGRAM)
            link.connect((host, int(port)))
            return link
        with socket.create_server((host, int(port))) as listener:
            told(f"waiting on {address} for one that connects")
            return listener.accept()[0]
    except (OSError, OverflowError) as error:
        raise InputError(f"{address}: {getattr(error, 'strerror', None) or error}") from None
