"""What a filter is to do, as arrays: steps to propagate over, and at each step rows to measure or
states to set.

Written with numpy, a whole run at once; worked through by `ins.filters.error_kernel` without Python
in the loop.

Decision: docs/decisions/0003-filter-program.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.filters.states import THETA

ADVANCE, MEASURE, ADD, ASSIGN = 0, 1, 2, 3  # operations
REFUSED, USED, LOST, NOT_FINITE = 0, 1, -1, -2  # what became of one
BIN, ROLLING, KEEP, MOVING = 0, 1, 2, 3  # columns 0 to 3 of a step's flags

Row = Mapping[int, ArrayLike]  # state index: coefficient, one for all or (m,)


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

    def table(self) -> tuple[NDArray, NDArray]:
        """The steps as the kernel takes them.

        Returns
        -------
        table : ndarray, shape (K, 25)
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
                self.turn_rad,
                self.jump_yaw,
                self.jump_w,
                self.jump_theta,
            ]
        )
        flags = np.column_stack([self.bin_index, self.rolling, self.keep, self.moving])
        return np.ascontiguousarray(table, dtype=float), np.ascontiguousarray(flags, dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class _Block:
    """Operations of one call: kind of operation, steps (m,), rows (m, r, nz), z and variance (m,
    r); target: the state that is changed.
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
class Compiled:
    """A program as arrays for `error_kernel.run`, and the name and end time of each operation.

    Parameters
    ----------
    steps : ndarray, shape (K, 25)
    flags : ndarray of int64, shape (K, 4)
        Both as of `Steps.table`.
    ops : ndarray of int64, shape (m, 4)
        Kind of operation, step or target state, first row, number of rows.
    index, value : ndarray, shape (rows, nz)
        States and coefficients of each row.
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
    ops: NDArray
    index: NDArray
    value: NDArray
    z: NDArray
    variance: NDArray
    gate: NDArray
    name: NDArray
    names: tuple[str, ...]
    time_s: NDArray

    def under(self, variance: NDArray, gates: Mapping[str, float]) -> "Compiled":
        """The program with other noise.

        Parameters
        ----------
        variance : ndarray, shape (rows,)
        gates : mapping of float
            By the names of measurements, in sigmas; the others keep theirs.

        Returns
        -------
        program : Compiled
        """
        gate = self.gate.copy()
        for number, name in enumerate(self.names):
            gate[(self.name == number) & (self.ops[:, 0] == MEASURE)] = gates.get(name, np.nan)
        return replace(self, variance=variance, gate=np.where(np.isnan(gate), self.gate, gate))


class FilterProgram:
    """Steps, and what is done at the end of each; within a step in the order of the calls below.

    Parameters
    ----------
    steps : Steps
    """

    def __init__(self, steps: Steps) -> None:
        self.steps = steps
        every = np.arange(len(steps.end_s))
        self._blocks = [_block(ADVANCE, every, [{}], [0.0], [0.0])]

    @property
    def rows(self) -> int:
        """Rows laid down so far: those of one call are numbered from what this was before it."""
        return sum(b.z.size for b in self._blocks)

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
        """
        if len(at):
            self._blocks.append(_block(MEASURE, at, rows, z, variance, name=name, gate=gate))

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
        program : Compiled
        """
        blocks, names = self._blocks, tuple(dict.fromkeys(b.name for b in self._blocks))
        width = max(b.index.shape[2] for b in blocks)
        count = np.concatenate([np.full(len(b.at), b.z.shape[1]) for b in blocks])
        at = np.concatenate([b.at for b in blocks])
        order = np.lexsort((np.repeat(np.arange(len(blocks)), [len(b.at) for b in blocks]), at))
        first = np.concatenate([[0], np.cumsum(count)[:-1]])
        target = np.concatenate(
            [b.at if b.operation == ADVANCE else np.full(len(b.at), b.target) for b in blocks]
        )
        operation = np.concatenate([np.full(len(b.at), b.operation) for b in blocks])
        ops = np.column_stack([operation, target, first, count])[order]
        steps, flags = self.steps.table()
        return Compiled(
            steps,
            flags,
            np.ascontiguousarray(ops, dtype=np.int64),
            np.concatenate([_padded(b.index, width) for b in blocks]),
            np.concatenate([_padded(b.value, width) for b in blocks]),
            np.concatenate([b.z.ravel() for b in blocks]),
            np.concatenate([b.variance.ravel() for b in blocks]),
            np.concatenate([np.full(len(b.at), b.gate) for b in blocks])[order],
            np.concatenate([np.full(len(b.at), names.index(b.name)) for b in blocks])[order],
            names,
            self.steps.end_s[at[order]],
        )


def _block(
    operation: int,
    at: ArrayLike,
    rows: Sequence[Row],
    z: Sequence[ArrayLike] | NDArray,
    variance: Sequence[ArrayLike],
    **more: Any,
) -> _Block:
    """The operation at the steps `at`; more: its name, target and gate, where it has them."""
    steps = np.atleast_1d(np.asarray(at, dtype=np.int64))
    width = max(max(len(row) for row in rows), 1)
    index = np.zeros((len(steps), len(rows), width), dtype=np.int64)
    value = np.zeros(index.shape)
    for i, row in enumerate(rows):
        for k, (state, coefficient) in enumerate(row.items()):
            index[:, i, k] = state
            value[:, i, k] = coefficient
    return _Block(
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


def _padded(rows: NDArray, width: int) -> NDArray:
    """(m, r, nz) as (m r, width), zeros at the end."""
    out = np.zeros((rows.shape[0] * rows.shape[1], width), dtype=rows.dtype)
    out[:, : rows.shape[2]] = rows.reshape(-1, rows.shape[2])
    return out
