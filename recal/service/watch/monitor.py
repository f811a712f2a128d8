"""What the last minutes of rows show at once: the phase, the temperatures, clipping, gaps, silence.

The seconds are those of `alignment.motion.seconds`, the limits those of its witnesses; only the
last HELD_S are held.
"""

from collections.abc import Sequence
from dataclasses import fields
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from alignment.motion.excursions import STOP_SPEED_M_S, STOP_WINDOW_S
from alignment.motion.inertial import steady_seconds
from alignment.motion.seconds import LogSeconds, quiet_seconds, read_seconds
from alignment.motion.stillness import ALIGNMENT_S, TAKE_OFF_M_S
from trajectories.readers.live.rows import Rows
from trajectories.runs.checks import MAX_GAP_S
from trajectories.runs.imu_stream import imu_log

HELD_S = 300  # chosen: 5 min, as a time bin of the estimate
SILENT_S = 2.0  # without a row; chosen: twice the 1 s of a run's longest gap


class Phase(StrEnum):
    """What the vehicle does."""

    WAITING = "waiting"
    ALIGNING = "aligning"
    PARKED = "parked"
    ROLLING = "rolling"
    FLYING = "flying"


class Monitor:
    """Takes the recorded rows, in run time."""

    def __init__(self) -> None:
        self.rows = 0
        self.part = 1
        self.time_s = 0.0
        self.gyro_degC: NDArray | None = None
        self.visited_degC = np.array([np.inf, -np.inf])
        self._rest: list[NDArray] = []
        self._seconds: LogSeconds | None = None
        self._speed_m_s, self._rests_s, self._parked_s = 0.0, 0.0, 0.0
        self._fix_m_s = 0.0
        self._along_m_s2: float | None = None

    @property
    def rate_hz(self) -> float | None:
        """Of the rows; None before there are some seconds of them."""
        return None if self._seconds is None else self._seconds.rate_hz

    def take(self, batch: Sequence[Rows]) -> None:
        """Rows of any stream."""
        for rows in batch:
            if not len(rows):
                continue
            if rows.stream == "imu":
                self._imu(rows)
            elif rows.stream == "temperature":
                at = [list(rows.columns).index(f"gyro_{axis}_degC") for axis in "xyz"]
                self._warm(rows.values[:, at])
            elif rows.stream == "gnss":
                self._fix_m_s = float(np.hypot(*rows.values[-1, 4:6]))

    def _warm(self, degC: NDArray) -> None:
        self.gyro_degC = degC[-1]
        low, high = self.visited_degC
        self.visited_degC = np.array(
            [np.fmin(low, np.nanmin(degC)), np.fmax(high, np.nanmax(degC))]
        )

    def _imu(self, rows: Rows) -> None:
        time_s = rows.time_s
        if time_s[0] < self.time_s:  # another part
            self._rest, self._seconds = [], None
            self.part += 1
        self.rows += len(rows)
        self.time_s = float(time_s[-1])
        self._rest.append(rows.values[:, :7])
        values = np.concatenate(self._rest)
        until = int(np.searchsorted(values[:, 0], np.floor(values[-1, 0]) + 1e-9, side="right"))
        if until < 3 or values[until - 1, 0] - values[0, 0] < 0.5:
            self._rest = [values]
            return
        self._rest = [values[until:]]
        source = "rates" if rows.columns[1].startswith("gyro") else "increments"
        done = values[:until].copy()
        log, _ = imu_log(done[:, 0].copy(), done[:, 1:4].copy(), done[:, 4:7].copy(), source=source)
        self._add(read_seconds(log))

    def _add(self, new: LogSeconds) -> None:
        held = new if self._seconds is None else _joined(self._seconds, new)
        steady = steady_seconds(held)[-new.end_s.size :]
        self._seconds = held.where(slice(-HELD_S, None))
        for k in range(new.end_s.size):
            self._step(new, k, is_steady=bool(steady[k]))

    def _step(self, new: LogSeconds, k: int, *, is_steady: bool) -> None:
        """Speed along x by what the force is beyond that of the last rest."""
        along, dt_s = float(new.mean[k, 0]), float(new.dt_s[k])
        self._rests_s = self._rests_s + dt_s if is_steady else 0.0
        if self._along_m_s2 is not None:
            self._speed_m_s += (along - self._along_m_s2) * dt_s
        stands = self._rests_s >= STOP_WINDOW_S and abs(self._speed_m_s) < STOP_SPEED_M_S
        # a force that stays for longer is a floor that slopes, no roll
        if stands or self._rests_s >= HELD_S or (self._along_m_s2 is None and is_steady):
            self._speed_m_s, self._along_m_s2 = 0.0, along
            self._parked_s += dt_s

    @property
    def phase(self) -> Phase:
        """Of the last second; a receiver says whether it flies."""
        if self._seconds is None:
            return Phase.WAITING
        if self._fix_m_s > TAKE_OFF_M_S:
            return Phase.FLYING
        if self._rests_s < STOP_WINDOW_S and self.time_s > 2 * STOP_WINDOW_S:
            return Phase.ROLLING
        if abs(self._speed_m_s) >= STOP_SPEED_M_S:
            return Phase.ROLLING
        return Phase.ALIGNING if self._parked_s < ALIGNMENT_S else Phase.PARKED

    def faults(self, silent_s: float) -> list[str]:
        """What is wrong with the last minutes; silent_s: since the last row came."""
        found = []
        if silent_s > SILENT_S and self.rows:
            found.append(f"no row for more than {SILENT_S:.0f} s: is the source still there?")
        if self.part > 1 and self.time_s < HELD_S:
            found.append(
                f"gap: no row for more than {MAX_GAP_S:g} s, part {self.part} of the session begins"
            )
        quiet = None if self._seconds is None else quiet_seconds(self._seconds)
        if quiet is None:
            return found
        clipped = np.flatnonzero(quiet.stuck)
        if clipped.size:
            at = quiet.end_s[clipped[-1]]
            found.append(
                f"clipping: three rows on end at the limit, {clipped.size} s, last {at:.0f} s"
            )
        lost = np.flatnonzero(quiet.lost)
        if lost.size:
            at = quiet.end_s[lost[-1]]
            found.append(
                f"gap: rows lost for {quiet.longest_s[lost].max():.2f} s, last at {at:.0f} s"
            )
        return found


def _joined(one: LogSeconds, other: LogSeconds) -> LogSeconds:
    names = [f.name for f in fields(one) if f.name != "rate_hz"]
    columns = {n: np.concatenate([getattr(one, n), getattr(other, n)]) for n in names}
    return LogSeconds(rate_hz=other.rate_hz, **columns)
