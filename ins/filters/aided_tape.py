"""The satellite-aided recipe as a tape: errors of a reference, sensors, receiver and antenna, and
what is measured of them.

States: those of `ins.estimation.states` that move and the accelerometers, the gyros' biases as one
bin that walks, then those below. What a prior leaves at zero takes no part. Errors of the receiver
and of the vertical come and go: first-order Gauss-Markov processes of time and of the way.

Decision: docs/decisions/0063-leaps.md.
Decision: docs/decisions/0077-scale-states.md.
Decision: docs/decisions/0081-gate-for-wild-fixes.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ins.attitude import skew
from ins.earth import displacement_ned, geodetic_from_ecef
from ins.estimation import error_model as em
from ins.estimation import sensors
from ins.estimation.error_filter import ErrorFilter, FedBack
from ins.estimation.measurements import antenna as at_antenna
from ins.estimation.measurements import fix
from ins.estimation.states import ACCEL, ACCEL_Z, BASE, POS, THETA, W
from ins.estimation.tape import Block, Compiled, Tape, unweighed
from ins.filters.aided_records import AidedNoise, AidedOptions, AidedStart, Antenna, Fixes
from ins.filters.reference import About, Reference
from ins.records import InputError, frozen_array
from ins.robust import chi2

_FIRST = BASE + 3
GYRO_SCALE, MISALIGNED = range(_FIRST, _FIRST + 3), range(_FIRST + 3, _FIRST + 9)
ACCEL_SCALE, DEFLECTION = range(_FIRST + 9, _FIRST + 12), range(_FIRST + 12, _FIRST + 14)
SLOW_POSITION, SLOW_OTHER = range(_FIRST + 14, _FIRST + 17), range(_FIRST + 17, _FIRST + 20)
SLOW_VELOCITY, ANTENNA = range(_FIRST + 20, _FIRST + 23), range(_FIRST + 23, _FIRST + 28)
STATES = ANTENNA.stop
ACCELEROMETERS = (*range(ACCEL.start, ACCEL.stop), ACCEL_Z)
# position, velocity, attitude, gyros, accelerometers: the order of `ins.filters.states`
MOTION = np.array(
    [
        *range(POS.start, POS.start + 3),
        *range(W.start, W.start + 3),
        *range(THETA.start, THETA.stop),
        *range(BASE, BASE + 3),
        *ACCELEROMETERS,
    ]
)
SCALES = np.array([*GYRO_SCALE, *MISALIGNED, *ACCEL_SCALE])
POSITION, VELOCITY, STAND, STAND_RATE, ROLL = "position", "velocity", "stand", "stand rate", "roll"
REJECT_PROBABILITY = 1e-6  # of a good fix: one of its three components is beyond the gate
GATE_NIS = float(chi2.isf(REJECT_PROBABILITY, 3))
GATE_SIGMA = float(np.sqrt(GATE_NIS))
# a body turns where a gyro reads more than so many sigmas of its bias and noise: 6e-5 of noise do.
# A gyro's noise turns the attitude once for each unit of it, as a scale error of 1 would: on
# straight ways a scale is found that is as much of 1 as the noise tells of it
TURNS_SIGMAS = 4.0
# of tapes along a reference that are kept, chosen: a search has a dozen of them, and a row with its
# entries takes 100 bytes
KEPT_ROWS = 400_000
# of the trace: how negative an eigenvalue of a covariance may be; a file of ten digits has 1e-10
ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a log is flown with.

    Parameters
    ----------
    start : AidedStart
    noise : AidedNoise
    fixes : Fixes
    antenna : Antenna
        Where and when the fixes are measured.
    options : AidedOptions
    near : Antenna, optional
        What its errors are linearised about; the antenna itself by default.
    """

    start: AidedStart
    noise: AidedNoise
    fixes: Fixes
    antenna: Antenna
    options: AidedOptions
    near: Antenna | None = None

    @property
    def linearised(self) -> Antenna:
        """What the antenna's errors are linearised about."""
        return self.antenna if self.near is None else self.near

    @property
    def receiver(self) -> tuple[tuple[range, tuple[float, ...], float], ...]:
        """States of the receiver's slow errors, their sigmas and time constants."""
        n = self.noise
        level, other = n.slow_level_m, n.slow_other_level_m
        return (
            (SLOW_POSITION, (level, level, n.slow_down_m), n.slow_s),
            (SLOW_OTHER, (other, other, n.slow_other_down_m), n.slow_s),
            (SLOW_VELOCITY, (n.slow_velocity_m_s,) * 3, n.slow_velocity_s),
        )


@dataclass(frozen=True)
class Laid:
    """A tape, and where it measures positions and velocities of fixes.

    Parameters
    ----------
    tape : Compiled
    fixes : (ndarray, ndarray), shapes (m,)
        Numbers of the fixes.
    rows : (ndarray, ndarray), shapes (m,)
        The first row of each on the tape.
    fades : dict of int
        The first row that says how a state of the receiver fades, by its number.
    compared : Compared
    """

    tape: Compiled
    fixes: tuple[NDArray, NDArray]
    rows: tuple[NDArray, NDArray]
    fades: dict[int, int]
    compared: "Compared"


def aided_filter(task: Task, about: About) -> ErrorFilter:
    """The filter at the start of a task, for errors of the reference that it is linearised about.

    Parameters
    ----------
    task : Task
    about : About

    Returns
    -------
    filter : ErrorFilter
    """
    noise, start = task.noise, task.start
    flt = ErrorFilter(
        sigma0={},
        noise=em.ProcessNoise(
            arw=noise.arw,
            vrw=noise.vrw,
            accel_rrw=noise.accel_walk,
            yaw_creep=0.0,
            lateral_rms=0.0,
            lateral_time_s=1.0,
        ),
        bias_mean=start.gyro_bias_rad_s - about.taken_off[:3],
        bias_covariance=np.zeros((3, 3)),
        further_sigma=(0.0,) * (STATES - _FIRST),
        further_walks={
            ACCEL_Z: noise.accel_walk**2,
            **dict.fromkeys(range(BASE, BASE + 3), noise.gyro_walk**2),
        },
    )
    flt.x[np.array(ACCELEROMETERS)] = start.accel_bias_m_s2 - about.taken_off[3:]
    flt.x[: THETA.stop] = about.errors_of(start.state)
    to_w = np.eye(MOTION.size)
    to_w[3:6, 6:9] = skew(about.reference.travels_n[0])
    P = checked_covariance(start.covariance, MOTION.size, "AidedStart.covariance")
    flt.P[np.ix_(MOTION, MOTION)] = to_w @ P @ to_w.T
    priors: tuple[tuple[range, float | tuple[float, ...]], ...] = (
        (GYRO_SCALE, noise.gyro_scale),
        (MISALIGNED, noise.misalignment_rad),
        (ACCEL_SCALE, noise.accel_scale),
        (DEFLECTION, noise.deflection_rad),
        *((states, sigmas) for states, sigmas, _ in task.receiver),
    )
    for states, sigmas in priors:
        flt.P[states, states] = np.square(sigmas)
    antenna = checked_covariance(task.antenna.covariance, len(ANTENNA), "Antenna.covariance")
    flt.P[np.ix_(ANTENNA, ANTENNA)] = antenna
    flt.x[np.array(ANTENNA)] = task.antenna.values - task.linearised.values
    if not task.antenna.estimated:
        flt.considered_from = ANTENNA.start
    return flt


def aided_tape(task: Task, about: About, gyro_sigma_rad_s: NDArray, *, record: bool = True) -> Laid:
    """The steps of a reference with what drives its errors and what is measured of them.

    Parameters
    ----------
    task : Task
    about : About
    gyro_sigma_rad_s : ndarray, shape (3,)
        Of what is left of the gyros' biases.
    record : bool
        At each row of the reference.

    Returns
    -------
    laid : Laid
    """
    key = (record, gyro_sigma_rad_s.tobytes(), *_laid_by(task))
    if key not in about.laid:
        while sum(laid.tape.z.size for laid in about.laid.values()) > KEPT_ROWS:
            del about.laid[next(iter(about.laid))]
        about.laid[key] = _laid(task, about, gyro_sigma_rad_s, record=record)
    return _weighed(about.laid[key], task, about)


def _laid_by(task: Task) -> tuple[object, ...]:
    """What a tape hangs on beside its reference, all but the noise of receiver and walks."""
    noise, options = task.noise, task.options
    wheels = tuple(np.asarray(column).tobytes() for column in vars(options.wheels).values())
    noisy = noise.arw, noise.stirred, noise.deflection_rad, noise.deflection_m
    stands = np.asarray(options.stands, dtype=float).tobytes()
    stand = options.stand_sigma_m_s, options.stand_rate_rad_s, options.reset_s
    fading = tuple(state for state, _, _ in _fading(task))
    return *noisy, stands, *stand, *wheels, fading, *_measured_by(task.fixes, _receiver(task))


def _fading(task: Task) -> list[tuple[int, float, float]]:
    """States of the receiver that fade, their sigmas and time constants."""
    found = []
    for states, sigmas, seconds in task.receiver:
        other = states is SLOW_OTHER and not task.fixes.other_type.any()
        for state, sigma in zip(states, sigmas):
            if sigma > 0.0 or (states is not SLOW_VELOCITY and not other):
                found.append((state, sigma, seconds))
    return found


def _weighed(laid: Laid, task: Task, about: About) -> Laid:
    """The tape under the noise of a task."""
    tape, fixes = laid.tape, task.fixes
    variance, value = tape.variance.copy(), tape.value.copy()
    dt = about.reference.dt_s[about.reference.dt_s > 0.0]
    for state, sigma, seconds in _fading(task):
        first = laid.fades[state]
        kept = np.exp(-dt / seconds)
        variance[first : first + dt.size] = sigma**2 * (1.0 - kept**2)
        entry = tape.first_entry[first]
        value[entry : entry + dt.size] = kept
    (placed, moving), (of_place, of_velocity) = laid.fixes, laid.rows
    for i in range(3):
        variance[of_place + i] = fixes.sigma_position_m[placed, i] ** 2
        variance[of_velocity + i] = (
            fixes.sigma_velocity_m_s[moving, i] ** 2 + laid.compared.swing[i]
        )
    return replace(laid, tape=replace(tape, variance=variance, value=value))


def _laid(task: Task, about: About, gyro_sigma_rad_s: NDArray, *, record: bool) -> Laid:
    """The tape, and where its noise stands."""
    ref, noise = about.reference, task.noise
    tape = Tape(ref.steps(np.zeros(ref.dt_s.size, dtype=np.int64), about.white(noise.stirred)))
    fades = _come_and_go(tape, task, about)
    white = noise.arw**2 / np.where(ref.dt_s > 0.0, ref.dt_s, np.inf)[:, None]
    shown = TURNS_SIGMAS * np.sqrt(gyro_sigma_rad_s**2 + white)
    turns_b = np.where(np.abs(ref.rate_b) > shown, ref.rate_b, 0.0)
    sensors.bin_biases(tape, BASE)
    sensors.gyro_scales(tape, GYRO_SCALE, turns_b)
    sensors.misalignments(tape, MISALIGNED, turns_b)
    sensors.accelerometer_biases(tape, ACCELEROMETERS)
    sensors.accelerometer_scales(tape, ACCEL_SCALE, ref.force_b)
    sensors.deflections(tape, DEFLECTION)
    stands = _stands(task.options.stands, ref.end_s) & ref.closes & (ref.dt_s > 0.0)
    _measure_stands(tape, task, about, np.flatnonzero(stands))
    _measure_wheels(tape, task, about, stands)
    numbers, rows = _measure_fixes(tape, task, about)
    if record:
        tape.record(np.flatnonzero(ref.closes))
    compared = next(iter(about.measured.values()))
    return Laid(tape.compiled(), numbers, rows, fades, compared)


def fed_back(about: About, laid: Laid) -> FedBack:
    """What a sweep needs that feeds the errors of attitude back at each step.

    Parameters
    ----------
    about : About
    laid : Laid

    Returns
    -------
    fed_back : FedBack
    """
    ref, levers = about.reference, np.zeros((laid.tape.z.size, 15))
    for first, columns in zip(laid.rows, laid.compared.levers):
        turned, held, shown, rest = np.split(columns, 4, axis=1)
        for i in range(3):
            levers[first + i, i] = 1.0
            levers[first + i, 3:6] = turned
            levers[first + i, 6 + i] = held[:, i]
            levers[first + i, 9:12] = shown
            levers[first + i, 12:] = rest
    whole = [(state, 0) for state in (*ACCELEROMETERS, *ANTENNA[:3])]
    turning = np.array([*whole, *((state, 1) for state in ANTENNA[3:])])
    pushes = np.column_stack([ref.push_n, ref.travels_n, ref.lag_n, ~ref.plain])
    return FedBack(pushes, levers, turning)


def _come_and_go(tape: Tape, task: Task, about: About) -> dict[int, int]:
    """What fades over the steps, and how far the accelerometers' biases go with the shaking; the
    first rows of the receiver's states.
    """
    noise, dt = task.noise, np.asarray(tape.steps.dt_s)
    moves, fades = np.flatnonzero(dt > 0.0), {}
    for state, _, _ in _fading(task):
        fades[state] = tape.rows
        tape.assign(moves, state, {state: 1.0}, 0.0)
    if noise.deflection_rad > 0.0:
        way = np.linalg.norm(np.asarray(tape.steps.v_n)[moves, :2], axis=1) * dt[moves]
        kept = np.exp(-way / noise.deflection_m)
        for state in DEFLECTION:
            tape.assign(moves, state, {state: kept}, noise.deflection_rad**2 * (1.0 - kept**2))
    if noise.stirred > 0.0:
        added = noise.stirred**2 * about.stirs
        for state in ACCELEROMETERS:
            tape.widen(moves, state, added[moves])
    return fades


def _stands(spans: object, end_s: NDArray) -> NDArray:
    """Which steps (K,) end within a standstill."""
    stands = np.asarray(spans, dtype=float).reshape(-1, 2)
    if not stands.size:
        return np.zeros(end_s.size, dtype=bool)
    number = np.searchsorted(stands[:, 0], end_s, side="left") - 1
    return np.asarray((number >= 0) & (end_s <= stands[number, 1]))


def _measure_stands(tape: Tape, task: Task, about: About, at: NDArray) -> None:
    """No velocity and, where a sigma is given, no turn but Earth's."""
    ref, options = about.reference, task.options
    rows: list[dict] = [{W.start + k: 1.0} for k in range(3)]
    tape.measure(STAND, at, ref.end.v_n[at].T, rows, [options.stand_sigma_m_s**2] * 3)
    if options.stand_rate_rad_s == 0.0:
        return
    C_nb = ref.end.C_nb[at]
    z = ref.rate_b[at] - np.einsum("kji,kj->ki", C_nb, ref.omega_ie_n[at])
    of_theta = -np.swapaxes(C_nb, 1, 2) @ skew(ref.omega_ie_n[at])
    rows = [
        {BASE + i: 1.0, **{THETA.start + j: of_theta[:, i, j] for j in range(3)}} for i in range(3)
    ]
    white = task.noise.arw**2 / ref.dt_s[at] + options.stand_rate_rad_s**2
    tape.measure(STAND_RATE, at, z.T, rows, [white] * 3)


def _measure_wheels(tape: Tape, task: Task, about: About, stands: NDArray) -> None:
    """A vehicle on wheels goes where it points, at the speed that its wheels tell."""
    wheels, ref = task.options.wheels, about.reference
    step = np.searchsorted(ref.end_s, wheels.time_s - 1e-6)
    inside = step < ref.end_s.size
    inside[inside] = (np.abs(ref.end_s[step[inside]] - wheels.time_s[inside]) < 1e-6) & (
        ~stands[step[inside]]
    )
    told = np.isfinite(wheels.speed_m_s)
    for speeds in (True, False):
        of = np.flatnonzero(inside & (told == speeds))
        at = step[of]
        if not at.size:
            continue
        motion = about.motion(at, wheels.arm_m, ref.end_s[at])
        C_vn = wheels.C_vb @ np.swapaxes(motion.C_nb, 1, 2)
        v_v = np.einsum("kij,kj->ki", C_vn, motion.v_n + motion.swing_n(wheels.arm_m))
        v_v[:, 0] -= np.where(told[of], wheels.speed_m_s[of], v_v[:, 0])
        axes = range(0 if speeds else 1, 3)
        rows = [{W.start + j: C_vn[:, i, j] for j in range(3)} for i in axes]
        variance = [wheels.variance[of, i] for i in axes]
        tape.measure(ROLL, at, v_v[:, axes.start :].T, rows, variance, gate=GATE_SIGMA)


def _receiver(task: Task) -> "Receiver":
    """How the fixes of a task are measured."""
    antenna = task.linearised
    states = fix.ReceiverStates(
        arm=ANTENNA[:3],
        delay=ANTENNA[3:4],
        velocity_delay=ANTENNA[4:],
        slow_position=SLOW_POSITION,
        slow_velocity=SLOW_VELOCITY,
    )
    return Receiver(
        antenna=at_antenna.Antenna(antenna.lever_arm_m),
        delays_s=(antenna.delay_s, antenna.velocity_delay_s),
        states=states,
        slow_other=SLOW_OTHER,
        accelerometers=ACCELEROMETERS,
    )


def _measure_fixes(
    tape: Tape, task: Task, about: About
) -> tuple[tuple[NDArray, NDArray], tuple[NDArray, NDArray]]:
    """Positions and velocities, as of `measure_fixes`, and what a filter does that is lost."""
    numbers, rows = measure_fixes(tape, about, task.fixes, _receiver(task))
    steps = np.flatnonzero(about.reference.fix >= 0)
    k = about.reference.fix[steps]
    moves = np.isfinite(task.fixes.v_n_m_s[k]).all(axis=1)
    for slow, of_type in zip((SLOW_POSITION, SLOW_OTHER), _placed_by_type(task.fixes, k)):
        tape.renew(steps[of_type & moves], slow, 2, task.options.reset_s)
        tape.renew(steps[of_type & ~moves], slow, 1, task.options.reset_s)
    return numbers, rows


@dataclass(frozen=True, kw_only=True)
class Receiver:
    """What a receiver may have wrong, and how its fixes are measured.

    Parameters
    ----------
    antenna : Antenna
        As the fixes are compared with it.
    delays_s : (float, float)
        By which positions and velocities are older than their stamps.
    states : ReceiverStates
    slow_other : sequence of int
        States of the slow error of positions of the other type.
    names : (str, str)
        Of the measurements of position and velocity.
    gate : float
        In sigmas.
    swing_share : float
        Sigma of a velocity over what turning adds to it.
    accelerometers : sequence of int
        States of their biases: what delays lead back over has them.
    """

    antenna: at_antenna.Antenna
    delays_s: tuple[float, float]
    states: fix.ReceiverStates
    slow_other: Sequence[int]
    names: tuple[str, str] = (POSITION, VELOCITY)
    gate: float = GATE_SIGMA
    swing_share: float = 0.0
    accelerometers: Sequence[int] = ()


def measure_fixes(
    tape: Tape, about: About, fixes: Fixes, receiver: Receiver
) -> tuple[tuple[NDArray, NDArray], tuple[NDArray, NDArray]]:
    """Positions and velocities of the fixes at which steps end, where a fix has them.

    Parameters
    ----------
    tape : Tape
    about : About
    fixes : Fixes
    receiver : Receiver

    Returns
    -------
    numbers, rows : (ndarray, ndarray), (ndarray, ndarray)
        Of positions and of velocities: the fixes (m,), and the first row of each (m,).
    """
    kept = about.measured
    key = _measured_by(fixes, receiver)
    if key not in kept:
        kept.clear()
        kept[key] = _compared(about, fixes, receiver)
    compared = kept[key]
    none = np.zeros(0, dtype=np.int64)
    numbers, first = [none], [none]
    for block, of in compared.positions:
        numbers.append(of)
        first.append(tape.rows + 3 * np.arange(of.size))
        tape.lay(block, list(fixes.sigma_position_m[of].T ** 2))
    of_velocity = tape.rows + 3 * np.arange(compared.moving.size)
    variance = fixes.sigma_velocity_m_s[compared.moving].T ** 2 + compared.swing
    tape.lay(compared.velocities, list(variance))
    return (np.concatenate(numbers), compared.moving), (np.concatenate(first), of_velocity)


@dataclass(frozen=True, kw_only=True)
class Compared:
    """Fixes against a reference: what is laid down whatever their noise is.

    Parameters
    ----------
    positions : list of (Block, ndarray)
        Of a type of fixes, and their numbers (m,).
    velocities : Block
    moving : ndarray, shape (k,)
        Numbers of the fixes that have velocities.
    swing : ndarray, shape (3, k)
        What turning adds to the variances of the velocities.
    levers : (ndarray, ndarray), shapes (m, 12), (k, 12)
        Of positions, of all types, and of velocities, as of `FedBack.levers`: b, what of the
        velocity each component holds, d and e.
    """

    positions: list[tuple[Block, NDArray]]
    velocities: Block
    moving: NDArray
    swing: NDArray
    levers: tuple[NDArray, NDArray]


def _measured_by(fixes: Fixes, receiver: Receiver) -> tuple[object, ...]:
    """What the rows of fixes hang on beside the reference."""
    antenna = receiver.antenna
    arm = antenna.arm_m, antenna.found_m, [antenna.delay_s, antenna.velocity_delay_s]
    numbers = np.concatenate([*arm, receiver.delays_s, fixes.time_s])
    seen = np.isfinite(fixes.r_e_m[:, 0]), np.isfinite(fixes.v_n_m_s).all(axis=1)
    columns = b"".join(values.tobytes() for values in (numbers, *seen, fixes.other_type))
    states = tuple(tuple(states) for states in vars(receiver.states).values())
    named = receiver.names, receiver.gate, receiver.swing_share
    others = tuple(receiver.slow_other), tuple(receiver.accelerometers)
    return columns, states, others, named


def _compared(about: About, fixes: Fixes, receiver: Receiver) -> Compared:
    """Positions and velocities against a reference."""
    arm, (delay_s, velocity_delay_s) = receiver.antenna, receiver.delays_s
    steps = np.flatnonzero(about.reference.fix >= 0)
    k = about.reference.fix[steps]
    own = receiver.states, replace(receiver.states, slow_position=receiver.slow_other)
    ref, biases = about.reference, receiver.accelerometers
    positions, levers = [], [np.zeros((0, 12))]
    for of_states, of_type in zip(own, _placed_by_type(fixes, k)):
        at, of = steps[of_type], k[of_type]
        if not at.size:
            continue
        motion = about.motion(at, arm.arm_m, fixes.time_s[of] - delay_s)
        places = geodetic_from_ecef(fixes.r_e_m[of])
        z, rows = fix.position(motion, arm, places, of_states, level=False)
        late = (fixes.time_s[of] - delay_s - ref.end_s[at])[:, None]
        by_force = _way_by_force(about, at, late, motion)
        way = _shown(ref, at, by_force, -0.5 * ref.pull_n[at] * late**2)
        _lead_back(rows, ref, at, late * ref.travels_n[at] + way, 0.5 * late**2, biases)
        for i, row in enumerate(rows):
            row[W.start + i] = late[:, 0]
        arm_n = motion.C_nb @ arm.arm_m
        held = np.broadcast_to(late, arm_n.shape)
        levers.append(
            np.hstack([arm_n + by_force, held, arm_n + _shown(ref, at, by_force), motion.v_n])
        )
        positions.append((unweighed(receiver.names[0], at, z, rows, receiver.gate), of))
    moves = np.isfinite(fixes.v_n_m_s[k]).all(axis=1)
    at, of = steps[moves], k[moves]
    motion = about.motion(at, arm.arm_m, fixes.time_s[of] - velocity_delay_s)
    swing, pull_n = motion.swing_n(arm.arm_m), ref.pull_n[at]
    late = (fixes.time_s[of] - velocity_delay_s - ref.end_s[at])[:, None]
    by_force = motion.v_n - ref.end.v_n[at] - pull_n * late
    gained = swing + _shown(ref, at, by_force, -pull_n * late)
    z, rows = fix.velocity(
        motion,
        arm,
        fixes.v_n_m_s[of],
        receiver.states,
        about_n=ref.travels_n[at] + gained,
        level=False,
    )
    _lead_back(rows, ref, at, np.zeros_like(swing), late, biases)
    return Compared(
        positions=positions,
        velocities=unweighed(receiver.names[1], at, z, rows, receiver.gate),
        moving=of,
        swing=(receiver.swing_share * swing.T) ** 2,
        levers=(
            np.concatenate(levers),
            np.hstack(
                [swing + by_force, np.ones_like(swing), swing + _shown(ref, at, by_force), pull_n]
            ),
        ),
    )


def _shown(
    ref: Reference, at: NDArray, by_force_n: NDArray, steady_n: NDArray | float = 0.0
) -> NDArray:
    """What the specific force adds (m, 3), or where that may be noise what a steady one does."""
    return np.where(ref.plain[at, None], steady_n, by_force_n)


def _lead_back(
    rows: fix.Rows,
    ref: Reference,
    at: NDArray,
    way_n: NDArray,
    by_bias: NDArray,
    biases: Sequence[int],
) -> None:
    """Add to rows, in place, what errors do between a measurement and the end of its step.

    way_n (m, 3): turns with the attitude; by_bias (m, 1): of one unit of the accelerometers.
    """
    C_nb, of_theta = ref.end.C_nb[at], -skew(way_n)
    for i, row in enumerate(rows):
        for m in range(3):
            theta = THETA.start + m
            row[theta] = row.get(theta, 0.0) + of_theta[:, i, m]
        for m, state in enumerate(biases):
            row[state] = by_bias[:, 0] * C_nb[:, i, m]


def _way_by_force(
    about: About, at: NDArray, late_s: NDArray, motion: at_antenna.AntennaMotion
) -> NDArray:
    """The way (m, 3) since the end of steps that is not of the velocity there nor of gravity."""
    end, pull_n = about.reference.end, about.reference.pull_n[at]
    (lat, lon, height), (lat0, lon0, height0) = motion.place.T, end.place[at].T
    level = displacement_ned(lat, lon, lat0_rad=lat0, lon0_rad=lon0, height0_m=height0)
    way_n = np.column_stack([level, height0 - height])
    return np.asarray(way_n - (end.v_n[at] + 0.5 * pull_n * late_s) * late_s)


def _placed_by_type(fixes: Fixes, k: NDArray) -> tuple[NDArray, NDArray]:
    """Which of fixes k (m,) have a position, of the one type and of the other."""
    placed, other = np.isfinite(fixes.r_e_m[k]).all(axis=1), fixes.other_type[k]
    return placed & ~other, placed & other


def checked_covariance(P: NDArray, size: int, name: str) -> NDArray:
    """A covariance as given.

    Parameters
    ----------
    P : ndarray, shape (size, size)
    size : int
    name : str
        As told where it is none.

    Returns
    -------
    P : ndarray, shape (size, size)

    Raises
    ------
    InputError
        Where it is not finite and positive semidefinite.
    """
    P = frozen_array(P, (size, size), name)
    if not (np.isfinite(P).all() and np.linalg.eigvalsh(P).min() >= -ROUNDING * np.trace(P)):
        raise InputError(f"{name}: needed finite and positive semidefinite")
    return P
