"""When does the vehicle stand, roll, or shake? Found from the navigation solution itself, one epoch a second.

A parked inertial solution drifts slowly (Schuler), so rest is judged against a baseline that follows the computed
velocity while the vehicle stands. Thresholds are in SI units and in sigmas of this unit's own noise, never in counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.records import NavHistory, Phase, Span

STILL, DISTURBED, ROLLING, AIRBORNE = 0, 1, 2, 3
EXCESS_MOTION_M_S = 0.061  # 0.2 ft/s, the aviation gate for excess motion during alignment
SMALLEST_GATE_M_S = 0.015  # above the random walk of a quiet solution about its own trend over a minute
GUARD_S = 30.0  # after excess motion the alignment restarts 30 s later
ROLLED_M = 2.0  # net way after which an excursion is a movement, not a shake
LONGEST_SHAKE_S = 60.0
FRESH = 30  # epochs of rest before the line through them may have a slope
STOP_WINDOW_S = 8
STOP_SPEED_M_S = 0.25  # baseline uncertainty after rolling: accelerometer bias turned with the body
STOP_DRIFT_M_S2 = 5e-4
TAKE_OFF_M_S = 35.0
PIVOT_RAD_S = 2e-3  # turning on the spot (0.11 deg/s) is movement
JOLT_RAD = 1.5e-5  # 3 arcsec turned within an epoch beyond the noise
CHI2_MEDIAN = 0.4549  # median of chi-square with one degree of freedom
ALIGNMENT_S = 600.0  # length of the first alignment where the log does not say


@dataclass(frozen=True)
class Motion:
    """Per epoch (row k of the history, interval ending there): kind code and the jolt about down [rad].

    sigma_v_m_s: noise of the one-second velocity, from its second differences.
    """

    time_s: NDArray
    kind: NDArray
    jolt_rad: NDArray
    sigma_v_m_s: float

    def spans(self, kind: int, reason: str) -> tuple[Span, ...]:
        """The stretches of one kind."""
        return tuple(
            Span(start_s=float(self.time_s[max(a - 1, 0)]), end_s=float(self.time_s[b - 1]), reason=reason)
            for a, b in _runs(self.kind == kind)
        )

    def seconds(self, kind: int) -> float:
        return float(np.sum(np.diff(self.time_s)[self.kind[1:] == kind]))


def classify(history: NavHistory, phases: tuple[Phase, ...] = ()) -> Motion:
    """Motion of each epoch of a navigation solution at about 1 Hz.

    `phases`, where the log has them, only add: take-off and what follows is airborne. A phase that says parked
    while the solution moves is not believed.
    """
    t, v = history.time_s, history.v_n_m_s[:, :2]
    sigma = _velocity_noise(v)
    kind = _walk(t, v, sigma)
    speed = np.linalg.norm(v, axis=1)
    fast = np.flatnonzero(speed > TAKE_OFF_M_S)
    if fast.size:
        kind[fast[0] :] = AIRBORNE
    turning = np.abs(_turn_about_down(history)) > PIVOT_RAD_S * np.gradient(t)
    kind[turning & (kind <= DISTURBED)] = ROLLING
    for phase in phases:
        if phase.phase in ("takeoff", "flight", "landing"):
            kind[(t > phase.start_s) & (t <= phase.end_s)] = AIRBORNE
    return Motion(time_s=t, kind=kind, jolt_rad=_jolts(history, kind), sigma_v_m_s=sigma)


def detect_phases(motion: Motion) -> tuple[Phase, ...]:
    """Phases of formats.md from the motion: alignment, extended alignment, taxi, flight, parked."""
    t, kind = motion.time_s, motion.kind
    moving = np.flatnonzero(kind >= ROLLING)
    first_move = moving[0] if moving.size else len(t)
    start, parked_end = float(t[0]), float(t[max(first_move - 1, 1)])
    split = min(start + ALIGNMENT_S, parked_end)
    found = [Phase(phase="alignment", start_s=start, end_s=split)]
    if parked_end > split:
        found.append(Phase(phase="extended_alignment", start_s=split, end_s=parked_end))
    names = {ROLLING: "taxi", AIRBORNE: "flight"}
    for code, name in names.items():
        index = np.flatnonzero(kind == code)
        if index.size:
            found.append(Phase(phase=name, start_s=float(t[max(index[0] - 1, 0)]), end_s=float(t[index[-1]])))
    last = moving[-1] if moving.size else len(t) - 1
    if last < len(t) - 60:
        found.append(Phase(phase="parked", start_s=float(t[last]), end_s=float(t[-1])))
    return tuple(sorted(found, key=lambda p: p.start_s))


def sway_position_sigma(history: NavHistory, motion: Motion) -> float:
    """RMS of the parked vehicle's horizontal position jitter [m], per axis.

    From 30 s pieces of the integrated velocity with a cubic taken out (errors of the solution are smoother than
    that); pieces beyond four times the median variance are gusts and do not count.
    """
    length, order = 30, 3
    cubic = np.vander(np.linspace(-1, 1, length), order + 1)
    project = np.eye(length) - cubic @ np.linalg.pinv(cubic)
    variances = []
    for a, b in _runs(motion.kind == STILL):
        for i in range(max(a, 1), b - length + 1, length):
            way = np.cumsum(history.displacement_n_m[i : i + length, :2], axis=0)
            variances.append(np.sum((project @ way) ** 2, axis=0) / (length - order - 1))
    if not variances:
        return 0.0
    v = np.concatenate(variances)
    return float(np.sqrt(np.mean(v[v <= 4.0 * np.median(v)])))


def yaw_jitter_sigma(history: NavHistory, motion: Motion) -> float:
    """RMS of the parked vehicle's heading about its slow creep [rad], gyro quantization included.

    Turns over 1 s and over 10 s: gyro noise and creep add up with time, the jitter e of an angle does not, so
    V1 = w + 2 e^2 and V10 = 10 w + 2 e^2. Robust variances (median of squares).
    """
    turn, still = _turn_about_down(history), motion.kind == STILL
    tens = [turn[k : k + 10].sum() for a, b in _runs(still) for k in range(max(a, 1), b - 9, 10)]
    if len(tens) < 20:
        return 0.0
    ones, rate = turn[still], float(np.median(tens)) / 10.0
    v1, v10 = (np.median((x - centre) ** 2) / CHI2_MEDIAN for x, centre in ((ones, rate), (np.array(tens), 10.0 * rate)))
    return float(np.sqrt(max(10.0 * v1 - v10, 0.0) / 18.0))


def _turn_about_down(history: NavHistory) -> NDArray:
    """Rotation about down that the gyros saw in each epoch [rad], Earth rate included; row 0 repeats row 1."""
    turn = np.einsum("ij,ij->i", history.C_nb[:, 2, :], history.dtheta_b_rad)
    turn[0] = turn[1]
    return turn


def _velocity_noise(v: NDArray) -> float:
    second = np.diff(v, n=2, axis=0)
    return float(1.4826 * np.median(np.abs(second)) / np.sqrt(6.0)) + 1e-6


class _Baseline:
    """Straight line through the velocity of the last still epochs, refitted every fifth."""

    def __init__(self, t: NDArray, v: NDArray) -> None:
        self._t, self._v = t, v
        self._rows: list[int] = []
        self._misses: list[float] = []
        self._mean, self._slope, self._centre = np.zeros(2), np.zeros(2), 0.0
        self.gate = 0.0  # eight times the median miss of the line's own predictions, kept over restarts

    @property
    def fresh(self) -> bool:
        return len(self._rows) < FRESH

    def add(self, k: int) -> None:
        if not self.fresh:
            self._misses.append(float(np.hypot(*(self._v[k] - self.at(self._t[k])))))
            if len(self._misses) % 30 == 0 and len(self._misses) >= 60:
                self.gate = 8.0 * float(np.median(self._misses[-300:]))
        self._rows.append(k)
        del self._rows[:-90]
        if k % 5 == 0 or len(self._rows) < 10 or len(self._rows) == FRESH:
            self._fit(self._v[self._rows])

    def restart(self, k: int, v: NDArray) -> None:
        """Begin anew at epoch k with v (m, 2) as what rest looks like."""
        self._rows = [k]
        self._fit(v)

    def _fit(self, v: NDArray) -> None:
        T = self._t[self._rows]
        self._centre, self._mean, self._slope = float(T.mean()), v.mean(axis=0), np.zeros(2)
        if not self.fresh:
            s = T - self._centre
            self._slope = s @ v / (s @ s)

    def at(self, t: float | NDArray) -> NDArray:
        return self._mean + self._slope * (np.asarray(t)[..., None] - self._centre)


def _walk(t: NDArray, v: NDArray, sigma: float) -> NDArray:
    """Sequential classification of the epochs into still, disturbed, rolling."""
    kind = np.full(len(t), STILL)
    gate = max(min(8.0 * sigma, EXCESS_MOTION_M_S), 5.0 * sigma, SMALLEST_GATE_M_S)
    base = _Baseline(t, v)
    base.restart(0, v[: min(len(t), 20)])
    k, guard_until = 0, -np.inf
    while k < len(t):
        limit = max(gate, base.gate) + (0.03 if base.fresh else 0.0)
        if np.hypot(*(v[k] - base.at(t[k]))) <= limit:
            kind[k] = DISTURBED if t[k] < guard_until else STILL
            base.add(k)
            k += 1
            continue
        end, rolled = _excursion(t, v, k, base, limit, sigma)
        kind[max(k - 2, 0) : end] = ROLLING if rolled else DISTURBED
        if end < len(t):
            base.restart(end, v[end : end + STOP_WINDOW_S])
        guard_until = t[min(end, len(t) - 1)] + (2.0 if rolled else GUARD_S)
        k = end
    return kind


def _excursion(
    t: NDArray, v: NDArray, k: int, base: _Baseline, gate: float, sigma: float
) -> tuple[int, bool]:
    """End of the excursion that begins at epoch k, and whether the vehicle went anywhere."""
    rest = base.at(t[k:])
    deviation = v[k:] - rest
    way = np.linalg.norm(np.cumsum(deviation * np.gradient(t)[k:, None], axis=0), axis=1)
    for j in range(1, len(deviation)):
        elapsed = t[k + j] - t[k]
        window = v[k + j : k + j + STOP_WINDOW_S]
        if len(window) < STOP_WINDOW_S:
            break
        rolled = way[j] > ROLLED_M or elapsed > LONGEST_SHAKE_S
        near = STOP_SPEED_M_S + STOP_DRIFT_M_S2 * elapsed if rolled else gate
        level = np.linalg.norm(window.mean(axis=0) - rest[j]) <= near
        if level and np.ptp(window, axis=0).max() <= max(8.0 * sigma, 0.03):
            return k + j, bool(rolled)
    return len(t), bool(way[-1] > ROLLED_M or t[-1] - t[k] > LONGEST_SHAKE_S)


def _jolts(history: NavHistory, kind: NDArray) -> NDArray:
    """Sudden turns of the standing vehicle about down [rad], epoch by epoch; zero where there is none."""
    dt = np.diff(history.time_s, prepend=2.0 * history.time_s[0] - history.time_s[1])
    rate = _turn_about_down(history) / dt
    still = kind <= DISTURBED
    if not np.any(still[1:]):
        return np.zeros(len(rate))
    centre = np.median(rate[1:][still[1:]])
    deviation = (rate - centre) * dt
    noise = 1.4826 * np.median(np.abs(deviation[1:][still[1:]]))
    jolt = np.where(still & (np.abs(deviation) > max(6.0 * noise, JOLT_RAD)), np.abs(deviation), 0.0)
    jolt[0] = 0.0
    return jolt


def _runs(mask: NDArray) -> list[tuple[int, int]]:
    """[start, end) of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2])]
