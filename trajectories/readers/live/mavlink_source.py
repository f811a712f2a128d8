"""MAVLink as it comes by udp, tcp or a serial line: inertial messages with their temperature, and
fixes.

Messages are taken apart by pymavlink (extra `live`). HIGHRES_IMU is taken before SCALED_IMU before
RAW_IMU, which is read in the units that ArduPilot sends: mg, mrad/s, hundredths of a degree.

Source: MAVLink common message set, mavlink.io/en/messages/common.html.
"""

import socket
import threading
from collections import Counter, deque
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

from ins.columns import FIX_SIGMA_COLUMNS, GYRO_DEGC, POSITION, RATE_COLUMNS, VELOCITY
from ins.records import InputError, RunHeader
from ins.units import DEG, MILLIRADIAN, STANDARD_GRAVITY
from trajectories.readers.columns.imu_columns import second_means
from trajectories.readers.live.rows import Dropped, Rows
from trajectories.readers.rows.row_cleaning import MAX_LATE_S

RANK = ("HIGHRES_IMU", "SCALED_IMU", "RAW_IMU")
# of messages, after which it is settled which kind is recorded; chosen: 2 of the slowest, 1 Hz
KIND_S = 2.0
DATAGRAM_BYTES = 1 << 16
BUFFER_BYTES = 1 << 22  # of the socket, where the system allows it
MOST_HELD = 1_000_000  # packets that wait to be read: an hour of 200 Hz
# packets at once, so that what is shown keeps up: 0.5 s of work
MOST_READ = 5_000
SILENCE_S = 0.5  # after which a thread looks whether it is to end
MOST_EARLY = (
    20_000  # messages in which it has to be settled what is recorded: 2 s at 2 kHz, 5 times
)
LEAST_FIX = 3  # GPS_FIX_TYPE_3D_FIX
UNKNOWN_U16 = 65_535
TEMPERATURE_BIT = 1 << 12  # of HIGHRES_IMU.fields_updated
NEEDS_EXTRA = "MAVLink needs pymavlink and pyserial: pip install strapdown-recal[live]"

Fix = tuple[float, ...]


class MavlinkSource:
    """The messages of one imu of one sender.

    Parameters
    ----------
    address : str
        `udp:HOST:PORT` (listened on), `tcp:HOST:PORT` (connected to) or `serial:DEVICE:BAUD`.
    header : callable
        Makes the run's header of the first fix, or of none; None where the options lack a place.
    """

    rereads = False

    def __init__(
        self, address: str, header: Callable[[Fix | None, bool], RunHeader | None]
    ) -> None:
        if not all(map(find_spec, ("pymavlink", "serial"))):
            raise InputError(NEEDS_EXTRA)
        from pymavlink.dialects.v20 import ardupilotmega as dialect  # it holds the common ones

        self.dropped = Counter[str]()
        self._link = opened(address)
        self._in_packets = address.startswith("udp:")
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True
        self._made = header
        self._kind: tuple[str, int, int, int] | None = None
        self._early: list[Any] = []
        self._counts: dict[tuple[int, int], int] = {}
        self._first_fix: Fix | None = None
        self._warm = np.zeros((0, 4))
        self._imu_s, self._astray = np.nan, False

    def header(self) -> RunHeader | None:
        """Of the options and the first fix, which is waited for where nobody gave a place."""
        return self._made(self._first_fix, self._kind is not None)

    def run_json(self) -> str | None:
        """None."""
        return None

    def read(self, wait_s: float) -> list[Rows] | None:
        """What has come since, a second's mean of the temperatures."""
        data = self._link.read(wait_s)
        if data is None:
            return None
        messages = [message for part in data for message in self._parsed(part)]
        if self._kind is None:
            self._early += messages
            messages = self._settle()
        imu = [row for m in messages if (row := self._imu_row(m)) is not None]
        fixes = [fix for m in messages if (fix := self._fix_row(m)) is not None]
        found = []
        if imu:
            values = np.array(imu)
            self._imu_s = float(values[-1, 0])
            found.append(Rows("imu", ("time_s", *RATE_COLUMNS), values[:, :7]))
            found += self._temperatures(values)
        if fixes:
            columns = ("time_s", *POSITION, *VELOCITY, *FIX_SIGMA_COLUMNS)
            found.append(Rows("gnss", columns, np.array(fixes)))
        return found

    def close(self) -> None:
        """Let go of socket or line."""
        self._link.close()

    def _parsed(self, data: bytes) -> list[Any]:
        """The messages in some bytes; what is none, and what was lost on the way, is counted."""
        good = []
        self._parser.buf.extend(data)
        while (message := self._next()) is not None:
            if message.get_type() == "BAD_DATA":
                self.dropped[Dropped.GARBAGE] += not self._astray
                self._astray = True
                # a length may be wrong: what it took along may hold messages
                rest = self._parser.buf[self._parser.buf_index :]
                self._parser.buf = bytearray(message.get_msgbuf()[1:]) + rest
                self._parser.buf_index = 0
                continue
            self._astray = False
            if message.get_type().startswith("UNKNOWN"):
                self.dropped[Dropped.UNKNOWN] += 1
                continue
            good.append(message)
            sender = message.get_srcSystem(), message.get_srcComponent()
            gap = (message.get_seq() - self._counts.get(sender, message.get_seq() - 1) - 1) % 256
            # more is a message that came late, or again
            self.dropped[Dropped.LOST] += gap if gap < 128 else 0
            self._counts[sender] = message.get_seq()
        rest = self._parser.buf[self._parser.buf_index :]
        if self._in_packets:  # a packet holds whole messages
            self.dropped[Dropped.GARBAGE] += bool(rest) and not self._astray
            rest, self._astray = bytearray(), False
        self._parser.buf, self._parser.buf_index = bytearray(rest), 0
        return good

    def _next(self) -> Any:
        """The next message in what has come, None where it holds no whole one."""
        try:
            return self._parser.parse_char(b"")
        except Exception:  # of the library, on what robust_parsing does not catch
            self.dropped[Dropped.GARBAGE] += 1
            return None

    def _settle(self) -> list[Any]:
        """The messages so far, once it is known which kind of them is recorded."""
        kinds = [key for m in self._early if (key := _kind(m)) is not None]
        times = [time_s for m in self._early if _kind(m) and np.isfinite(time_s := _time_s(m))]
        if not times or (abs(times[-1] - times[0]) < KIND_S and len(times) < MOST_EARLY):
            return []
        often = Counter(kinds)
        self._kind = min(often, key=lambda key: (RANK.index(key[0]), -often[key]))
        early, self._early = self._early, []
        return early

    def _imu_row(self, m: Any) -> list[float] | None:
        key = _kind(m)
        if key is None:
            return None
        if key != self._kind:
            self.dropped[Dropped.OTHER] += key[0] == (self._kind or ("",))[0]
            return None
        raw = [m.xgyro, m.ygyro, m.zgyro, m.xacc, m.yacc, m.zacc]
        if key[0] == "HIGHRES_IMU":
            degC = m.temperature if m.fields_updated & TEMPERATURE_BIT else np.nan
            return [_time_s(m), *raw, degC]
        scale = [MILLIRADIAN] * 3 + [1e-3 * STANDARD_GRAVITY] * 3
        degC = 0.01 * m.temperature if m.temperature else np.nan
        return [_time_s(m), *(value * unit for value, unit in zip(raw, scale)), degC]

    def _temperatures(self, values: Any) -> list[Rows]:
        """One thermometer, as that of each gyro: means of the seconds that are over."""
        warm = values[:, [0, 7, 7, 7]]
        warm = warm[np.isfinite(warm).all(axis=1) & (np.abs(warm[:, 1]) < 200.0)]
        self._warm = np.concatenate([self._warm, warm])
        if not len(self._warm):
            return []
        over = self._warm[:, 0] < np.floor(np.median(self._warm[-20:, 0]))
        order = np.argsort(self._warm[over, 0], kind="stable")
        done, self._warm = self._warm[over][order], self._warm[~over]
        means = second_means(done[:, 0], done[:, 1:])
        if means is None:
            return []
        rows = np.column_stack([means.time_s, means.gyro_degC])
        return [Rows("temperature", ("time_s", *GYRO_DEGC), rows)]

    def _fix_row(self, m: Any) -> Fix | None:
        """A fix in three dimensions, by the height above the ellipsoid where that is sent."""
        if m.get_type() != "GPS_RAW_INT" or m.fix_type < LEAST_FIX or self._kind is None:
            return None
        if (m.get_srcSystem(), m.get_srcComponent()) != self._kind[1:3]:
            return None
        speed = np.nan if m.vel == UNKNOWN_U16 else 0.01 * m.vel
        course = np.nan if m.cog == UNKNOWN_U16 else 0.01 * m.cog * DEG
        height = 1e-3 * (m.alt_ellipsoid or m.alt)
        sigmas = [1e-3 * value if value else np.nan for value in (m.h_acc, m.v_acc, m.vel_acc)]
        place = (1e-7 * m.lat, 1e-7 * m.lon, height)
        if not (abs(place[0]) <= 90.0 and abs(place[1]) <= 180.0):
            self.dropped[Dropped.VALUE] += 1
            return None
        if self._first_fix is None:
            self._first_fix = (*place, sigmas[0])
        level = (speed * np.cos(course), speed * np.sin(course))
        time_s = _time_s(m)
        if abs(time_s - self._imu_s) > MAX_LATE_S:  # ArduPilot stamps fixes by another clock
            time_s = self._imu_s
        return (time_s, *place, *map(float, level), 0.0, *sigmas)


def _kind(m: Any) -> tuple[str, int, int, int] | None:
    """Message, sender and number of the imu; None of a message without an imu."""
    name = m.get_type()
    if name not in RANK:
        return None
    return name, m.get_srcSystem(), m.get_srcComponent(), int(getattr(m, "id", 0) or 0)


def _time_s(m: Any) -> float:
    return 1e-6 * m.time_usec if hasattr(m, "time_usec") else 1e-3 * m.time_boot_ms


class Link:
    """Bytes of a socket or a line, taken by a thread as they come: what the system holds of a
    socket is a second of 200 Hz.

    receive: gives some bytes, b"" where nothing came for a while, None where the other end closed.
    """

    def __init__(self, receive: Callable[[], bytes | None], close: Callable[[], None]) -> None:
        self._receive, self._close = receive, close
        self._held: deque[bytes | None] = deque(maxlen=MOST_HELD)
        self._came, self._ends = threading.Event(), False
        self._thread = threading.Thread(target=self._take, daemon=True)
        self._thread.start()

    def _take(self) -> None:
        while not self._ends:
            try:
                data = self._receive()
            except OSError:
                data = None
            if data != b"":
                self._held.append(data)
                self._came.set()
            if data is None:
                return

    def read(self, wait_s: float) -> list[bytes] | None:
        """What has come, after at most so long; None where nothing more will."""
        self._came.wait(wait_s)
        if not self._held:
            self._came.clear()
        found: list[bytes] = []
        while self._held and self._held[0] is not None and len(found) < MOST_READ:
            found.append(self._held.popleft() or b"")
        return None if self._held and not found else found

    def close(self) -> None:
        """Let go of socket or line."""
        self._ends = True
        self._thread.join(timeout=2.0 * SILENCE_S)
        self._close()


def opened(address: str) -> Link:
    """The bytes of an address. InputError where it is none, or cannot be had."""
    kind, _, rest = address.partition(":")
    place, _, number = rest.rpartition(":")
    if not place or not number.isdecimal():
        raise InputError(f"{address}: needed udp:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD")
    try:
        return _serial(place, int(number)) if kind == "serial" else _socket(kind, place, number)
    except (OSError, OverflowError) as error:
        raise InputError(f"{address}: {getattr(error, 'strerror', None) or error}") from None


def _socket(kind: str, host: str, port: str) -> Link:
    is_udp = kind == "udp"
    if is_udp:
        family = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)[0][0]
        link = socket.socket(family, socket.SOCK_DGRAM)
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        link.bind((host, int(port)))
    else:
        link = socket.create_connection((host, int(port)), timeout=10.0)
    link.settimeout(SILENCE_S)

    def receive() -> bytes | None:
        try:
            data = link.recv(DATAGRAM_BYTES)
        except TimeoutError:
            return b""
        return data if data or is_udp else None

    return Link(receive, link.close)


def _serial(device: str, baud: int) -> Link:
    import serial

    line = serial.Serial(device, baud, timeout=SILENCE_S)
    return Link(lambda: line.read(max(line.in_waiting, 1)), line.close)
