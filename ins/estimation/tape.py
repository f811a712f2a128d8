"""What the estimator is to do, as arrays: steps to propagate over, what drives the errors then,
and at each step rows to measure or states to set.

Written with numpy, a whole run at once; worked through by `ins.estimation.kernel` without Python in
the loop.

Decision: docs/decisions/0003-filter-tape.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.estimation.states import THETA, YAW

ADVANCE, MEASURE, ADD, ASSIGN, RENEW, RECORD = 0, 1, 2, 3, 4, 5  # operations
# what became of one, below 0 the sweep stops; of RENEW: position and velocity were begun anew, or
# the positions had leapt
REFUSED, USED, RENEWED, LEAPT, LOST, NOT_FINITE = 0, 1, 2, 3, -1, -2
BIN, ROLLING, KEEP, MOVING = 0, 1, 2, 3  # columns 0 to 3 of a step's flags
# what the core errors are driven by: wrong rates of the gyros (0 to 2) and specific forces of the
# accelerometers (3 to 5), body axes, and a wrong acceleration north, east, down (6 to 8)
INPUTS = 9
GYRO, ACCELEROMETER, ACCELERATION = 0, 3, 6  # first input of each kind
SOLUTION = THETA.stop  # errors of the solution, w, p and theta, which `Steps.shift` may change

Row = Mapping[int, ArrayLike]  # state index: coefficient, one for all or (m,)


class Measured(NamedTuple):
    """One kind of measurement at m steps, as `Tape.measure` takes it: one entry a row in each.

    Parameters
    ----------
    z : sequence of array_like, () or (m,)
        Computed less measured.
    rows : sequence of mapping
        State: coefficient, () or (m,).
    variance : sequence of array_like, () or (m,)
        Of independent noise.
    """

    z: Sequence[ArrayLike] | NDArray
    rows: Sequence[Row]
    variance: Sequence[ArrayLike]


@dataclass(frozen=True, kw_only=True)
class Steps:
    """K successive filter steps along a navigation solution: means over each, SI, navigation axes.

    Parameters
    ----------
    end_s, dt_s : ndarray, shape (K,)
    C_nb : ndarray, shape (K, 3, 3)
    v_n, omega_ie_n : ndarray, shape (K, 3)
    transport : ndarray, shape (K, 3)
        1/(R_E + h), 1/(R_N + h) and tanL/(R_E + h) [1/m], so that omega_en_n = (a v_E, -b v_N, -c
        v_E).
    gravity, radius_m, turn_rad : ndarray, shape (K,)
        As in `error_model.Step`.
    bin_index : ndarray of int, shape (K,)
        Whose gyro bias drives the step.
    rolling, keep, moving : ndarray of bool, shape (K,)
        Rolling and keep_displacement as in `error_model.discretize`. Moving steps are linearised
        about v_n less the filter's own velocity error.
    jump_yaw, jump_w, jump_theta : ndarray, shape (K,)
        Variances of a sudden turn of the vehicle, a velocity jump, an attitude jump.
    shift : ndarray, shape (K, 9), optional
        How much larger the errors w, p, theta are after each step, because the solution was set
        anew there: it need not be a free one.
    level : bool
        The height is given: velocity and position down have no error.
    wheels : bool
        The way over a step and the lateral velocity are of use: they move.
    """

    end_s: NDArray
    dt_s: NDArray
    C_nb: NDArray
    v_n: NDArray
    omega_ie_n: NDArray
    transport: NDArray
    gravity: NDArray
    radius_m: NDArray
    turn_rad: NDArray
    bin_index: NDArray
    rolling: NDArray
    keep: NDArray
    moving: NDArray
    jump_yaw: NDArray
    jump_w: NDArray
    jump_theta: NDArray
    shift: NDArray | None = None
    level: bool = True
    wheels: bool = True

    def table(self) -> tuple[NDArray, NDArray]:
        """The steps as the kernel takes them.

        Returns
        -------
        table : ndarray, shape (K, 23)
        flags : ndarray of int64, shape (K, 4)
        """
        count = len(self.end_s)
        table = np.column_stack(
            [
                self.dt_s,
                np.reshape(self.C_nb, (count, 9)),
                self.v_n,
                self.omega_ie_n,
                self.transport,
                self.gravity,
                self.radius_m,
                self.jump_w,
                self.jump_theta,
            ]
        )
        flags = np.column_stack([self.bin_index, self.rolling, self.keep, self.moving])
        return np.ascontiguousarray(table, dtype=float), np.ascontiguousarray(flags, dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class Block:
    """Operations of one call.

    Parameters
    ----------
    operation : int
        Their kind.
    at : ndarray of int, shape (m,)
        The steps.
    index, value : ndarray, shape (m, r, nz)
        States and coefficients of the rows.
    z, variance : ndarray, shape (m, r)
    name : str
    target : int
        The state that is changed.
    gate : float
        In sigmas.
    """

    operation: int
    at: NDArray
    index: NDArray
    value: NDArray
    z: NDArray
    variance: NDArray
    name: str = ""
    target: int = 0
    gate: float = 0.0


@dataclass(frozen=True)
class Drives:
    """What states make the inputs of the core wrong by, ordered by steps, then states.

    Parameters
    ----------
    first : ndarray of int, shape (K + 1,)
        First of the entries of each step.
    state, target : ndarray of int, shape (entries,)
        State, and the input that it makes wrong.
    value : ndarray, shape (entries,)
        Per unit of the state.
    """

    first: NDArray
    state: NDArray
    target: NDArray
    value: NDArray

    def only(self, kept: NDArray) -> "Drives":
        """Some of the entries.

        Parameters
        ----------
        kept : ndarray of bool, shape (entries,)

        Returns
        -------
        drives : Drives
        """
        first = np.concatenate([[0], np.cumsum(kept)])[self.first]
        return Drives(first, self.state[kept], self.target[kept], self.value[kept])


@dataclass(frozen=True)
class Compiled:
    """A tape as arrays for `kernel.sweep`, and the name and end time of each operation.

    Parameters
    ----------
    steps : ndarray, shape (K, 23)
    flags : ndarray of int64, shape (K, 4)
        Both as of `Steps.table`.
    shift : ndarray, shape (K, 9) or (0, 9)
    level, wheels : bool
    drives : Drives
    ops : ndarray of int64, shape (m, 4)
        Kind of operation, step or target state, first row, number of rows.
    first_entry : ndarray of int64, shape (rows + 1,)
        First of the entries of each row.
    index, value : ndarray, shape (entries,)
        States and coefficients.
    z, variance : ndarray, shape (rows,)
    gate : ndarray, shape (m,)
        In sigmas.
    name : ndarray of int, shape (m,)
        Number of the operation's name in `names`.
    names : tuple of str
    time_s : ndarray, shape (m,)
    """

    steps: NDArray
    flags: NDArray
    shift: NDArray
    level: bool
    wheels: bool
    drives: Drives
    ops: NDArray
    first_entry: NDArray
    index: NDArray
    value: NDArray
    z: NDArray
    variance: NDArray
    gate: NDArray
    name: NDArray
    names: tuple[str, ...]
    time_s: NDArray

    @property
    def operation_of_row(self) -> NDArray:
        """The operation that each row (rows,) belongs to."""
        order = np.argsort(self.ops[:, 2])
        return np.repeat(order, self.ops[order, 3])

    def under(self, variance: NDArray, gates: Mapping[str, float]) -> "Compiled":
        """The tape with other noise.

        Parameters
        ----------
        variance : ndarray, shape (rows,)
        gates : mapping of float
            By the names of measurements, in sigmas; the others keep theirs.

        Returns
        -------
        tape : Compiled

        Raises
        ------
        ValueError
            Of another number of variances than rows.
        """
        if variance.shape != self.z.shape:
            raise ValueError(f"variance has shape {variance.shape}, needed {self.z.shape}")
        gate = self.gate.copy()
        for number, name in enumerate(self.names):
            gate[(self.name == number) & (self.ops[:, 0] == MEASURE)] = gates.get(name, np.nan)
        return replace(self, variance=variance, gate=np.where(np.isnan(gate), self.gate, gate))


class Tape:
    """Steps, what drives the errors over each, and what is done at its end.

    What is done at the end of one step is done in the order of the calls below.

    Parameters
    ----------
    steps : Steps
    """

    def __init__(self, steps: Steps) -> None:
        self.steps = steps
        every = np.arange(len(steps.end_s))
        self._blocks = [_block(ADVANCE, every, [{}], [0.0], [0.0])]
        self._drives: list[tuple[NDArray, NDArray, int, NDArray]] = []
        turned = np.flatnonzero(np.asarray(steps.jump_yaw) > 0.0)
        self.widen(turned, YAW, np.asarray(steps.jump_yaw)[turned])

    @property
    def rows(self) -> int:
        """Rows laid down so far: those of one call are numbered from what this was before it."""
        return sum(b.z.size for b in self._blocks)

    def drive(self, state: ArrayLike, target: int, value: ArrayLike) -> None:
        """Let a state make an input of the core wrong over the steps.

        Parameters
        ----------
        state : array_like of int, () or (K,)
            The state; one for all steps, or each step's own.
        target : int
            The input: GYRO, ACCELEROMETER or ACCELERATION and the axis.
        value : array_like, () or (K,)
            Per unit of the state, mean over each step; where it is zero nothing drives.

        Raises
        ------
        ValueError
            There is no such input.
        """
        if not 0 <= target < INPUTS:
            raise ValueError(f"input {target}, needed 0 to {INPUTS - 1}")
        count = len(self.steps.end_s)
        values = np.broadcast_to(np.asarray(value, dtype=float), (count,))
        at = np.flatnonzero(values)
        states = np.broadcast_to(np.asarray(state, dtype=np.int64), (count,))
        self._drives.append((at, states[at], target, values[at]))

    def measure(
        self,
        name: str,
        at: NDArray,
        z: Sequence[ArrayLike] | NDArray,
        rows: Sequence[Row],
        variance: Sequence[ArrayLike],
        *,
        gate: float = np.inf,
    ) -> None:
        """Measure linear combinations of states, at several steps.

        Parameters
        ----------
        name : str
            Kind of measurement, for the tally.
        at : ndarray of int, shape (m,)
            The steps.
        z : sequence of array_like, () or (m,)
            Measured values, one entry a row.
        rows : sequence of mapping
            State: coefficient, the latter () or (m,).
        variance : sequence of array_like, () or (m,)
            Of the rows' noise, which is independent.
        gate : float
            Innovations beyond so many sigmas leave the whole measurement out.

        Raises
        ------
        ValueError
            Where z, rows and variance are not as many, or a step or state is below zero.
        """
        self.lay(unweighed(name, at, z, rows, gate), variance)

    def lay(self, block: Block, variance: Sequence[ArrayLike]) -> None:
        """Measure what several tapes of the same steps do, each with its own noise.

        Parameters
        ----------
        block : Block
            As of `unweighed`.
        variance : sequence of array_like, () or (m,)
            As of `measure`.

        Raises
        ------
        ValueError
            Of another number of variances than rows.
        """
        noise = _of_each_step(variance, len(block.at))
        if noise.shape != block.z.shape:
            raise ValueError(f"{block.z.shape[1]} values and {len(variance)} variances")
        if len(block.at):
            self._blocks.append(replace(block, variance=noise))

    def widen(self, at: NDArray, index: int, variance: ArrayLike) -> None:
        """Add independent variance to a state, at several steps.

        Parameters
        ----------
        at : ndarray of int, shape (m,)
            The steps.
        index : int
            The state.
        variance : array_like, () or (m,)
            In its unit, squared.
        """
        if len(at):
            self._blocks.append(_block(ADD, at, [{}], [0.0], [variance], target=index))

    def assign(self, at: NDArray, index: int, row: Row, variance: ArrayLike) -> None:
        """Replace a state by a combination of the others plus independent noise, at several steps.

        Parameters
        ----------
        at : ndarray of int, shape (m,)
            The steps.
        index : int
            The state.
        row : mapping
            State: coefficient, the latter () or (m,).
        variance : array_like, () or (m,)
            Of the noise.
        """
        if len(at):
            self._blocks.append(_block(ASSIGN, at, [row], [0.0], [variance], target=index))

    def renew(self, at: NDArray, slow: Sequence[int], measured: int, after_s: float) -> None:
        """Begin a filter anew that refuses the positions of fixes one after the other.

        Parameters
        ----------
        at : ndarray of int, shape (m,)
            The steps of the fixes, whose measurements were asked for last.
        slow : sequence of int
            States of the slow error of the positions, north, east, down.
        measured : int
            How many measurements each fix has: 2, the second its velocity, or 1.
        after_s : float
            How long it refuses them; 0: for ever.
        """
        if len(at):
            row = dict.fromkeys(slow, 1.0)
            block = _block(RENEW, at, [row], [0.0], [0.0], target=measured, gate=after_s)
            self._blocks.append(block)

    def record(self, at: NDArray) -> None:
        """Record states and covariances as they stand at the end of steps.

        Parameters
        ----------
        at : ndarray of int, shape (m,)
            The steps.
        """
        self._blocks.append(_block(RECORD, at, [{}], [0.0], [0.0]))

    def clone(self, at: NDArray, target: slice) -> None:
        """Copy theta as it stands at the end of steps.

        Parameters
        ----------
        at : ndarray of int, shape (m,)
            The steps.
        target : slice
            The three states that become the copy.
        """
        for k in range(3):
            self.assign(at, target.start + k, {THETA.start + k: 1.0}, 0.0)

    def compiled(self) -> Compiled:
        """Operations in the order of steps, within a step in the order they were asked for.

        Returns
        -------
        tape : Compiled

        Raises
        ------
        ValueError
            Where the shift has another shape than `Steps` says.
        IndexError
            At a step beyond the last.
        """
        blocks, names = self._blocks, tuple(dict.fromkeys(b.name for b in self._blocks))
        rows, width = [b.z.size for b in blocks], [b.index.shape[2] for b in blocks]
        count = np.concatenate([np.full(len(b.at), b.z.shape[1]) for b in blocks])
        at = np.concatenate([b.at for b in blocks])
        order = np.lexsort((np.repeat(np.arange(len(blocks)), [len(b.at) for b in blocks]), at))
        first = np.cumsum(count) - count
        target = np.concatenate(
            [b.at if b.operation == ADVANCE else np.full(len(b.at), b.target) for b in blocks]
        )
        operation = np.concatenate([np.full(len(b.at), b.operation) for b in blocks])
        ops = np.column_stack([operation, target, first, count])[order]
        steps, flags = self.steps.table()
        shift = np.zeros((0, SOLUTION)) if self.steps.shift is None else self.steps.shift
        if self.steps.shift is not None and shift.shape != (len(steps), SOLUTION):
            raise ValueError(f"shift has shape {shift.shape}, needed {(len(steps), SOLUTION)}")
        return Compiled(
            steps,
            flags,
            np.ascontiguousarray(shift, dtype=float),
            self.steps.level,
            self.steps.wheels,
            self._driving(),
            np.ascontiguousarray(ops, dtype=np.int64),
            np.concatenate([[0], np.cumsum(np.repeat(width, rows))]),
            np.concatenate([b.index.ravel() for b in blocks]),
            np.concatenate([b.value.ravel() for b in blocks]),
            np.concatenate([b.z.ravel() for b in blocks]),
            np.concatenate([b.variance.ravel() for b in blocks]),
            np.concatenate([np.full(len(b.at), b.gate) for b in blocks])[order],
            np.concatenate([np.full(len(b.at), names.index(b.name)) for b in blocks])[order],
            names,
            self.steps.end_s[at[order]],
        )

    def _driving(self) -> Drives:
        """All that drives, in the kernel's order."""
        count = len(self.steps.end_s)
        at = np.concatenate([np.zeros(0, np.int64), *(part[0] for part in self._drives)])
        state = np.concatenate([np.zeros(0, np.int64), *(part[1] for part in self._drives)])
        lengths = [len(part[0]) for part in self._drives]
        target = np.repeat(np.array([part[2] for part in self._drives], dtype=np.int64), lengths)
        value = np.concatenate([np.zeros(0), *(part[3] for part in self._drives)])
        order = np.lexsort((target, state, at))
        first = np.searchsorted(at[order], np.arange(count + 1))
        return Drives(first, state[order], target[order], value[order])


def unweighed(
    name: str, at: NDArray, z: Sequence[ArrayLike] | NDArray, rows: Sequence[Row], gate: float
) -> Block:
    """A measurement of a tape without its noise, for `Tape.lay`.

    Parameters
    ----------
    name, at, z, rows, gate
        As of `Tape.measure`.

    Returns
    -------
    block : Block

    Raises
    ------
    ValueError
        Where z and rows are not as many, or a step or state is below zero.
    """
    return _block(MEASURE, at, rows, z, [0.0] * len(rows), name=name, gate=gate)


def _block(
    operation: int,
    at: ArrayLike,
    rows: Sequence[Row],
    z: Sequence[ArrayLike] | NDArray,
    variance: Sequence[ArrayLike],
    **more: Any,
) -> Block:
    """The operation at the steps `at`; more: its name, target and gate, where it has them."""
    if not len(z) == len(rows) == len(variance):
        raise ValueError(f"{len(z)} values, {len(rows)} rows and {len(variance)} variances")
    steps = np.atleast_1d(np.asarray(at, dtype=np.int64))
    width = max(max(len(row) for row in rows), 1)
    index = np.zeros((len(steps), len(rows), width), dtype=np.int64)
    value = np.zeros(index.shape)
    for i, row in enumerate(rows):
        for k, (state, coefficient) in enumerate(row.items()):
            index[:, i, k] = state
            value[:, i, k] = coefficient
    if min(steps.min(initial=0), index.min(initial=0)) < 0:
        raise ValueError(f"step {steps.min(initial=0)}, state {index.min(initial=0)}: below zero")
    return Block(
        operation=operation,
        at=steps,
        index=index,
        value=value,
        z=_of_each_step(z, len(steps)),
        variance=_of_each_step(variance, len(steps)),
        **more,
    )


def _of_each_step(entries: Sequence[ArrayLike] | NDArray, count: int) -> NDArray:
    """One entry a row, scalar or one a step, as (count, rows)."""
    columns = [np.broadcast_to(np.asarray(e, dtype=float), (count,)) for e in entries]
    return np.stack(columns, axis=1)
