"""When does the vehicle stand, roll, or shake? Found from the navigation solution itself, one epoch
a second.

A parked inertial solution drifts slowly (Schuler), so rest is judged against a baseline that
follows the computed velocity while the vehicle stands. Thresholds are in SI units and in sigmas of
this unit's own noise, never in counts.

Decision: docs/decisions/0009-motion-two-ways.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from alignment.motion.disturbed_epochs import JOLT_RAD, DisturbedEpochs, find_disturbed_epochs
from alignment.motion.excursions import (
    GUARD_S,
    LEAD_S,
    PUSH_S,
    PUSHED_M,
    TAIL_S,
    find_excursions,
    velocity_noise,
)
from alignment.motion.imu_faults import ImuFault
from alignment.motion.kinds import (
    AIRBORNE,
    DISTURBED,
    ROLLING,
    STILL,
    Disturbance,
    Witness,
    WitnessEvidence,
)
from ins.records import AIRBORNE_PHASES, ImuSource, NavHistory, Phase, Span
from ins.robust import robust_sigma, runs_of_true

# beside rolling a shake belongs to the start or the stop; chosen: an airliner brakes from 10 kt
# in 5 s
ROLL_EDGE_S = 5.0
# 2.9 deg: a vehicle that turned by more on the spot rolls; a tug's push turns by 1 deg at most in
# the simulator (tests/alignment/test_stillness.py)
PUSH_TURN_RAD = 0.05
# epochs of the median that a push of 15 is held against; chosen: four pushes, over which the gyro
# error of `_displaced` bends a line by 1 mm/s
RUNNING = 61
# epochs of rest on either side of a disturbance, for the line between them, whose end is known to
# 0.5 of an epoch's noise (2 / sqrt(15))
BESIDE = 15
# chosen: 68 kt; a taxi is up to 30 kt fast, what is faster takes off or has landed
TAKE_OFF_M_S = 35.0
PIVOT_RAD_S = 2e-3  # turning on the spot (0.11 deg/s) is movement
# a turn on the spot begins and ends where it stands out of this unit's noise at rest by as much;
# chosen: by chance 6e-7 of the epochs do
PIVOT_EDGE_SIGMAS = 5.0
# jolt of a vehicle that was pushed: twice NEW_HEADING_RAD of the filter (1e-3), beyond what the
# parked heading survives; tests/alignment/test_stillness.py asks for more than that
NEW_PLACE_RAD = 2e-3
ALIGNMENT_S = 600.0  # first alignment where the log does not say: 10 min of requirements.md


@dataclass(frozen=True)
class Motion:
    """Per epoch (row k of the history, interval ending there): kind code and the jolt about down
    [rad].

    sigma_v_m_s: noise of the one-second velocity, from its second differences. cause (k,): why an
    epoch is DISTURBED (a Cause); "" elsewhere. velocity_jump_m_s, turn_jump_rad (k,): sigma of what
    a repaired fault of the log may have left in the solution; None: no faults. disturbed: what the
    rows showed, None where they were not asked. turn_rad (k,): rotation about down in each epoch.
    evidence: what each witness said, where they were joined (`alignment.motion.timeline`).
    """

    time_s: NDArray
    kind: NDArray
    jolt_rad: NDArray
    sigma_v_m_s: float
    cause: NDArray = field(default_factory=lambda: np.zeros(0, dtype=object))
    velocity_jump_m_s: NDArray | None = None
    turn_jump_rad: NDArray | None = None
    disturbed: DisturbedEpochs | None = None
    turn_rad: NDArray | None = None
    evidence: tuple[WitnessEvidence, ...] = ()

    @property
    def parked_until_s(self) -> float:
        """End of the first parked time: of the last epoch before the vehicle rolls, or of the log
        [s].
        """
        rolls = np.flatnonzero(self.kind >= ROLLING)
        return float(self.time_s[max(rolls[0] - 1, 0)] if rolls.size else self.time_s[-1])

    def of(self, witness: Witness) -> WitnessEvidence:
        """What one witness said of each epoch."""
        return next(found for found in self.evidence if found.witness is witness)

    def stands(
        self, shortest_s: float, *, after_s: float = -np.inf, where: NDArray | None = None
    ) -> tuple[Span, ...]:
        """The stretches in which the vehicle stands, shakes included, from their first epoch to
        their last; where (k,): epochs that a caller wants besides.
        """
        stands = (self.kind <= DISTURBED) & (self.time_s > after_s)
        if where is not None:
            stands &= where
        return tuple(
            Span(start_s=float(self.time_s[a]), end_s=float(self.time_s[b - 1]), reason="")
            for a, b in runs_of_true(stands)
            if b - a >= shortest_s
        )

    def excluded(self) -> tuple[Span, ...]:
        """What is left out of the parked time, guard included; each stretch with its causes."""
        return tuple(
            Span(
                start_s=float(self.time_s[max(a - 1, 0)]),
                end_s=float(self.time_s[b - 1]),
                reason=", ".join(dict.fromkeys(self.cause[a:b])) or Disturbance.MOTION,
            )
            for a, b in runs_of_true(self.kind == DISTURBED)
        )

    def at(self, time_s: NDArray) -> "Motion":
        """The same motion on other epochs (n,) [s], each with the kind of the epoch it ends in."""
        index = np.searchsorted(self.time_s, time_s - 1e-6)
        index = np.minimum(index, self.time_s.size - 1)
        cause = self.cause[index] if self.cause.size else self.cause
        return Motion(time_s, self.kind[index], self.jolt_rad[index], self.sigma_v_m_s, cause)

    def seconds(self, kind: int) -> float:
        return float(np.sum(np.diff(self.time_s)[self.kind[1:] == kind]))


def classify(
    history: NavHistory,
    phases: tuple[Phase, ...] = (),
    imu: ImuSource | None = None,
    faults: Sequence[ImuFault] = (),
    disturbed: DisturbedEpochs | None = None,
) -> Motion:
    """Motion of each epoch of a navigation solution at about 1 Hz.

    `phases`, where the log has them, only add: take-off and what follows is airborne. A phase that
    says parked while the solution moves is not believed. `imu`: a log with the rows behind the
    history; without them bumps that are gone within an epoch, loading and gusts below the gate of
    the velocity are not seen. `faults`: what `imu_faults.repair` found in it. `disturbed`: of an
    earlier pass over the same epochs, so that the rows need not be gone over again.
    """
    t, v = history.time_s, history.v_n_m_s[:, :2]
    sigma = velocity_noise(v)
    kind, cause, pushed = find_excursions(t, v, sigma)
    speed = np.linalg.norm(v, axis=1)
    fast = np.flatnonzero(speed > TAKE_OFF_M_S)
    if fast.size:
        kind[fast[0] :] = AIRBORNE
    pushed += _pivots(history, kind, cause)
    for phase in phases:
        if phase.phase in AIRBORNE_PHASES:
            kind[(t > phase.start_s) & (t <= phase.end_s)] = AIRBORNE
    velocity_jump, turn_jump = np.zeros((2, len(t)))
    for fault in faults:
        at = slice(*np.searchsorted(t, [fault.start_s + 0.01, fault.end_s + 0.99]))
        inside = np.zeros(len(t), bool)
        inside[at] = kind[at] <= DISTURBED
        if fault.reason:
            exclude(t, kind, cause, inside, fault.reason)
        last = min(at.stop, len(t)) - 1
        velocity_jump[last] = np.hypot(velocity_jump[last], fault.velocity_sigma_m_s)
        turn_jump[last] = np.hypot(turn_jump[last], fault.turn_sigma_rad)
    if imu is not None and disturbed is None:
        disturbed = find_disturbed_epochs(
            imu, history, quiet=kind == STILL, parked=kind <= DISTURBED
        )
    if disturbed is not None:
        apart = ~beside_rolling(t, kind)
        for name, seen in (
            (Disturbance.BUMP, disturbed.bump),
            (Disturbance.LOADING, disturbed.loading),
            (Disturbance.GUST, disturbed.gust & ~disturbed.bump),
        ):
            standing = seen & (kind <= DISTURBED)
            for a, b in runs_of_true(standing):
                # what runs into rolling is its slow start or end
                standing[a:b] = apart[a:b].all()
            exclude(t, kind, cause, standing, name)
    cause[kind != DISTURBED] = ""
    jolt = _jolts(history, kind)
    pushed += _displaced(t, v, kind)
    jolt[pushed] = np.maximum(jolt[pushed], NEW_PLACE_RAD)
    return Motion(
        time_s=t,
        kind=kind,
        jolt_rad=np.hypot(jolt, turn_jump),
        sigma_v_m_s=sigma,
        cause=cause,
        velocity_jump_m_s=velocity_jump if faults else None,
        turn_jump_rad=turn_jump if faults else None,
        disturbed=disturbed,
        turn_rad=turn_about_down(history),
    )


def _pivots(history: NavHistory, kind: NDArray, cause: NDArray) -> list[int]:
    """Turning on the spot is rolling, in place; but a turn of a few degrees away from any rolling
    is a tug's.
    """
    t, turn = history.time_s, turn_about_down(history)
    # epochs whose turn stands out of what the unit reads at rest
    still, felt = kind == STILL, np.zeros(len(kind), bool)
    if still[1:].any():
        own, noise = _beside_rest(history, still)
        felt = np.abs(own) > PIVOT_EDGE_SIGMAS * noise
    ends = []
    for a, b in runs_of_true(
        (np.abs(turn) > PIVOT_RAD_S * np.gradient(t))
        & (kind <= DISTURBED)
        & (cause != Disturbance.PUSH)
    ):
        beside = slice(*np.searchsorted(t, [t[a] - ROLL_EDGE_S, t[b - 1] + ROLL_EDGE_S]))
        if abs(turn[a:b].sum()) < PUSH_TURN_RAD and (kind[beside] <= DISTURBED).all():
            seen = np.zeros(len(t), bool)
            seen[a:b] = True
            kind[seen], cause[seen] = DISTURBED, Disturbance.PUSH
            exclude(t, kind, cause, seen, Disturbance.PUSH)
            ends.append(b - 1)
        else:
            kind[a:b] = ROLLING
            for edge, way in ((a, -1), (b - 1, 1)):
                _to_the_rest(kind, felt, edge, way)
    return ends


def _to_the_rest(kind: NDArray, felt: NDArray, edge: int, way: int) -> None:
    """A turn on the spot (ROLLING) goes on before or behind its edge for as long as it is felt, and
    an epoch longer, in place.
    """
    k = edge + way
    while 0 <= k < len(kind) and kind[k] <= DISTURBED:
        kind[k] = ROLLING
        if not felt[k]:
            return
        k += way


def _displaced(t: NDArray, v: NDArray, kind: NDArray) -> list[int]:
    """Fastest epoch of each disturbed stretch that leaves the vehicle elsewhere, by the way about
    the line between rests. A gyro error of 0.01 deg/h bends that line by 1 m in 300 s: a stretch
    longer than a push is looked through for a way in BESIDE epochs about its running median.
    """
    found = []
    for a, b in runs_of_true(kind == DISTURBED):
        before, after = slice(max(a - BESIDE, 0), a), slice(b, b + BESIDE)
        if (
            min(len(kind[before]), len(kind[after])) < BESIDE
            or (kind[before] != STILL).any()
            or (kind[after] != STILL).any()
        ):
            continue
        v0 = v[before].mean(axis=0)
        v1 = v[after].mean(axis=0)
        t0 = t[before].mean()
        t1 = t[after].mean()
        deviation = v[a:b] - (v0 + (v1 - v0) * ((t[a:b] - t0) / (t1 - t0))[:, None])
        step_s = np.gradient(t)[a:b, None]
        epochs = b - a
        if epochs * float(np.median(step_s)) > PUSH_S:
            deviation = deviation - median_filter(deviation, (RUNNING, 1), mode="nearest")
            epochs = BESIDE
        way_m = np.cumsum(np.vstack([np.zeros(2), deviation * step_s]), axis=0)
        moved_m = np.linalg.norm(way_m[epochs:] - way_m[:-epochs], axis=1)
        first = int(np.argmax(moved_m))
        if moved_m[first] > PUSHED_M:
            speed = np.linalg.norm(deviation[first : first + epochs], axis=1)
            found.append(a + first + int(np.argmax(speed)))
    return found


def exclude(t: NDArray, kind: NDArray, cause: NDArray, seen: NDArray, name: str) -> None:
    """Take the epochs `seen` (k,) with their guard out of the still ones, in place; what was left
    out keeps its cause.
    """
    for a, b in runs_of_true(seen):
        near = slice(*np.searchsorted(t, [t[a] - LEAD_S - 0.5, t[b - 1] + GUARD_S + TAIL_S + 0.5]))
        label = cause[a] if kind[a] == DISTURBED else name
        cause[near] = np.where(kind[near] == STILL, label, cause[near])
        kind[near] = np.where(kind[near] == STILL, DISTURBED, kind[near])


def beside_rolling(t: NDArray, kind: NDArray) -> NDArray:
    """Epochs within ROLL_EDGE_S of one that rolls."""
    near = np.zeros(len(t), bool)
    for a, b in runs_of_true(kind >= ROLLING):
        near |= (t > t[a] - ROLL_EDGE_S - 0.5) & (t <= t[b - 1] + ROLL_EDGE_S + 0.5)
    return near


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
            found.append(
                Phase(phase=name, start_s=float(t[max(index[0] - 1, 0)]), end_s=float(t[index[-1]]))
            )
    last = moving[-1] if moving.size else len(t) - 1
    if last < len(t) - 60:
        found.append(Phase(phase="parked", start_s=float(t[last]), end_s=float(t[-1])))
    return tuple(sorted(found, key=lambda p: p.start_s))


def turn_about_down(history: NavHistory) -> NDArray:
    """Rotation about down that the gyros saw in each epoch [rad], Earth rate included; row 0
    repeats row 1.
    """
    turn = np.einsum("ij,ij->i", history.C_nb[:, 2, :], history.dtheta_b_rad)
    turn[0] = turn[1]
    return turn


def _beside_rest(history: NavHistory, still: NDArray) -> tuple[NDArray, float]:
    """Rotation about down in each epoch beyond what the gyros read in the still ones [rad], and the
    sigma of that noise; row 0, which repeats row 1, is not asked.
    """
    dt = np.diff(history.time_s, prepend=2.0 * history.time_s[0] - history.time_s[1])
    rate = turn_about_down(history) / dt
    deviation = (rate - np.median(rate[1:][still[1:]])) * dt
    return deviation, robust_sigma(deviation[1:][still[1:]])


def _jolts(history: NavHistory, kind: NDArray) -> NDArray:
    """Sudden turns of the standing vehicle about down [rad], epoch by epoch."""
    still = kind <= DISTURBED
    if not np.any(still[1:]):
        return np.zeros(len(still))
    deviation, noise = _beside_rest(history, still)
    jolt = np.where(
        still & (np.abs(deviation) > max(6.0 * noise, JOLT_RAD)), np.abs(deviation), 0.0
    )
    jolt[0] = 0.0
    return jolt
