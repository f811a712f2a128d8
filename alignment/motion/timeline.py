"""One motion of a run: what every witness says of each second, and the rule that joins them.

The witnesses: the inertial rows (steady or turning), navigation (`stillness.classify`), a
receiver, the wheels, the declared phases. Each returns `WitnessEvidence` over the same epochs. The
rule:

1. A receiver or wheels that move for LASTING_S beyond their noise move the vehicle, however quiet
   the inertial sensors are: a steady roll looks like rest to them.
2. Where navigation moves the vehicle moves, though a receiver stands: it does not see a push. But
   a steady speed that the receiver, or wheels that turn, would have seen is drift.
3. After take-off navigation has no baseline left: what it says while steady and slow is nothing,
   and rows, receiver and wheels speak.
4. Wheels that read zero while the vehicle rolls are dead, and silent.
5. A phase only adds: what is declared airborne is. A declared stand overrules nobody.
6. Where nobody speaks, the motion is unknown.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.excursions import STOP_SPEED_M_S, STOP_WINDOW_S
from alignment.motion.imu_faults import ImuFault
from alignment.motion.inertial import TURN_RAD_S, steady_seconds
from alignment.motion.kinds import (
    AIRBORNE,
    DISTURBED,
    ROLLING,
    STILL,
    UNKNOWN,
    Says,
    Witness,
    WitnessEvidence,
)
from alignment.motion.seconds import LogSeconds, seconds_of
from alignment.motion.speeds import (
    DEAD_M_S,
    LASTING_S,
    gnss_evidence,
    receiver_says,
    wheel_evidence,
)
from alignment.motion.stillness import Motion, classify
from ins.records import AIRBORNE_PHASES, PARKED_PHASES, GnssLog, NavHistory, Phase, Run
from ins.robust import runs_of_true
from ins.units import KNOT

# spread of the velocity within a standing vehicle's eight seconds, above its own noise
STEADY_M_S = 0.03
# faster is a flight or a roll: 10 kt, twice the speed error after which a solution is aligned anew
DRIFT_BELOW_M_S = 10.0 * KNOT
# at the start of a stop: the last 2 m/s of the braking at 1 m/s^2, and a receiver that is late
BRAKING_S = 2.0


def timeline(run: Run, history: NavHistory, faults: tuple[ImuFault, ...] = ()) -> Motion:
    """The motion of a run on the epochs of a navigation solution of it, at about 1 Hz.

    faults: what was repaired in the rows that the solution is made of.
    """
    return fused(run, history, classify(history, run.phases, faults=faults))


def fused(run: Run, history: NavHistory, navigated: Motion) -> Motion:
    """What navigation found, joined with what rows, receiver, wheels and phases of the run say."""
    t = history.time_s
    steady = steady_epochs(history, navigated)
    wheels = without_dead(wheel_evidence(run.odometer, t), t, navigated)
    seen = {
        e.witness: e
        for e in (
            navigation_evidence(history, navigated, steady),
            row_evidence(seconds_of(run.imu), t),
            gnss_evidence(run.gnss, t),
            wheels,
            phase_evidence(run.phases, t),
        )
    }
    kind = joined_kinds(run.gnss, t, navigated.kind, seen, steady)
    cause = np.where(kind == DISTURBED, navigated.cause, "")
    return replace(navigated, kind=kind, cause=cause, evidence=tuple(seen.values()))


def steady_epochs(history: NavHistory, motion: Motion) -> NDArray:
    """Epochs (k,) within eight seconds over which the computed velocity stays where it is."""
    v = history.v_n_m_s[:, :2]
    quiet = max(8.0 * motion.sigma_v_m_s, STEADY_M_S)
    steady = np.zeros(len(v), bool)
    if len(v) < STOP_WINDOW_S:
        return steady
    windows = np.lib.stride_tricks.sliding_window_view(v, STOP_WINDOW_S, axis=0)
    calm = np.ptp(windows, axis=2).max(axis=1) <= quiet
    for k in range(STOP_WINDOW_S):
        steady[k : k + calm.size] |= calm
    return steady


def navigation_evidence(history: NavHistory, motion: Motion, steady: NDArray) -> WitnessEvidence:
    """What a solution's own excursions say; nothing after take-off while it is steady and slow."""
    speed = np.linalg.norm(history.v_n_m_s[:, :2], axis=1)
    says = np.where(motion.kind >= ROLLING, Says.MOVES, Says.STANDS)
    says[(motion.kind == AIRBORNE) & steady & (speed < DRIFT_BELOW_M_S)] = Says.SILENT
    return WitnessEvidence(Witness.NAVIGATION, says, speed, STOP_SPEED_M_S)


def row_evidence(log: LogSeconds, end_s: NDArray) -> WitnessEvidence:
    """Whether force and rate are steady, or the vehicle turns, in the second that holds the middle
    of each epoch (k,).
    """
    at = np.searchsorted(log.end_s, end_s - 0.5)
    inside = at < log.end_s.size
    at = np.minimum(at, log.end_s.size - 1)
    turn = np.linalg.norm(log.mean[:, 3:], axis=1)
    says = np.where(steady_seconds(log), Says.STANDS, Says.SILENT)
    says[turn > TURN_RAD_S] = Says.MOVES
    return WitnessEvidence(
        Witness.ROWS,
        np.where(inside, says[at], Says.SILENT),
        np.where(inside, turn[at], np.nan),
        TURN_RAD_S,
    )


def phase_evidence(phases: tuple[Phase, ...], end_s: NDArray) -> WitnessEvidence:
    """What the declared phases call each epoch (k,): parked stands, airborne moves."""
    says = np.full(end_s.size, Says.SILENT)
    for named, word in ((PARKED_PHASES, Says.STANDS), (AIRBORNE_PHASES, Says.MOVES)):
        for phase in phases:
            if phase.phase in named:
                says[(end_s > phase.start_s) & (end_s <= phase.end_s)] = word
    return WitnessEvidence(Witness.PHASES, says, np.full(end_s.size, np.nan), 1.0)


def without_dead(wheels: WitnessEvidence, end_s: NDArray, motion: Motion) -> WitnessEvidence:
    """The wheels' words; none where they read zero while the vehicle rolls for LASTING_S."""
    rolls = (motion.at(end_s).kind == ROLLING) & np.isfinite(wheels.seen)
    if np.count_nonzero(rolls) < LASTING_S or np.median(wheels.seen[rolls]) > DEAD_M_S:
        return wheels
    return replace(wheels, says=np.full(end_s.size, Says.SILENT))


def joined_kinds(
    gnss_log: GnssLog | None,
    t: NDArray,
    kind: NDArray,
    seen: dict[Witness, WitnessEvidence],
    steady: NDArray,
) -> NDArray:
    """The rule of this module, epoch by epoch (k,).

    kind: by navigation; steady: epochs in which its velocity stays; gnss_log: whose mean velocity
    over a whole stand must be none, too.
    """
    says = {witness: evidence.says for witness, evidence in seen.items()}
    gnss, wheels = says[Witness.GNSS], says[Witness.WHEELS]
    moved = (gnss == Says.MOVES) | (wheels == Says.MOVES)
    stood = ((gnss == Says.STANDS) | (wheels == Says.STANDS)) & ~moved
    rests = says[Witness.ROWS] == Says.STANDS
    silent = says[Witness.NAVIGATION] == Says.SILENT
    silent |= _drifts(seen, kind, steady & rests)
    found = kind.copy()
    found[silent] = np.where(rests[silent], STILL, np.where(stood[silent], DISTURBED, UNKNOWN))
    for a, b in runs_of_true(silent & (found <= DISTURBED)):
        if receiver_says(gnss_log, t[a] + BRAKING_S, t[b - 1]).said is Says.MOVES:
            found[a:b] = ROLLING
    found[moved & (found <= DISTURBED)] = ROLLING
    found[says[Witness.PHASES] == Says.MOVES] = AIRBORNE
    return found


def _drifts(seen: dict[Witness, WitnessEvidence], kind: NDArray, steady: NDArray) -> NDArray:
    """Epochs (k,) that roll for navigation alone, at a steady speed that a receiver or the wheels
    would see, and do not.
    """
    speed = seen[Witness.NAVIGATION].seen
    against = np.zeros(kind.size, bool)
    for witness in (Witness.GNSS, Witness.WHEELS):
        other = seen[witness]
        against |= (other.says == Says.STANDS) & (speed > other.allowed)
    drifts = (kind == ROLLING) & steady & (speed < DRIFT_BELOW_M_S) & against
    for a, b in runs_of_true(drifts):
        drifts[a:b] = b - a >= STOP_WINDOW_S  # the epochs before a roll belong to it
    return np.asarray(drifts)
