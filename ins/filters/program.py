"""What a filter is to do, as arrays: steps to propagate over, and at each step rows to measure or
states to set.

Written with numpy, a whole run at once; worked through by `ins.filters.error_kernel` without Python
in the loop.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.filters.states import THETA

ADVANCE, MEASURE, ADD, ASSIGN = 0, 1, 2, 3  # operations
REFUSED, USED, LOST, NOT_FINITE = 0, 1, -1, -2  # what became of one
BIN, ROLLING, KEEP, MOVING = 0, 1, 2, 3  # columns of a step's flags

Row = Mapping[int, ArrayLike]  # state index: coefficient, one for all or (m,)


@dataclass(frozen=True, kw_only=True)
class Steps:
    """K successive filter steps along a navigation solution: means over each, SI, navigation axes.

    end_s, dt_s (K,); C_nb (K, 3, 3); v_n (K, 3); omega_ie_n (K, 3); transport (K, 3): 1/(R_E + h),
    1/(R_N + h) and tanL/(R_E + h) [1/m], so that omega_en_n = (a v_E, -b v_N, -c v_E); gravity,
    radius_m, turn_rad (K,) as in `error_model.Step`; bin_index (K,): whose gyro bias drives it;
    rolling, keep (keep_displacement), moving (K,) bool: moving steps are linearised about v_n less
    the filter's own velocity error. jump_yaw, jump_w, jump_theta (K,): variance of a sudden turn of
    the vehicle, a velocity or an attitude jump.
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
        """The same as `filter_kernel` takes it: (K, 25) float64 and flags (K, 4) int64."""
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


@dataclass(frozen=True)
class _Block:
    """Operations of one call: kind of operation, name, steps (m,), rows (m, r, nz), z and variance
    (m, r), gate.
    """

    operation: int
    name: str
    at: NDArray
    target: int
    index: NDArray
    value: NDArray
    z: NDArray
    variance: NDArray
    gate: float


@dataclass(frozen=True)
class Compiled:
    """Arrays for `filter_kernel.run`, and the name and end time of each operation."""

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


class FilterProgram:
    """Steps, and what is done at the end of each; within a step in the order of the calls below."""

    def __init__(self, steps: Steps) -> None:
        self.steps = steps
        every = np.arange(len(steps.end_s))
        self._blocks = [_block(ADVANCE, "", every, 0, [{}], [0.0], [0.0], 0.0)]

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
        """At steps `at` (m,): r rows with independent noise. z, rows, variance: one entry a row,
        scalars or (m,).

        gate: innovations beyond so many sigmas leave the whole measurement out.
        """
        if len(at):
            self._blocks.append(_block(MEASURE, name, at, 0, rows, z, variance, gate))

    def widen(self, at: NDArray, index: int, variance: ArrayLike) -> None:
        """Add independent variance to a state."""
        if len(at):
            self._blocks.append(_block(ADD, "", at, index, [{}], [0.0], [variance], 0.0))

    def assign(self, at: NDArray, index: int, row: Row, variance: ArrayLike) -> None:
        """Replace a state by a combination of the others plus independent noise."""
        if len(at):
            self._blocks.append(_block(ASSIGN, "", at, index, [row], [0.0], [variance], 0.0))

    def clone(self, at: NDArray, target: slice) -> None:
        """Copy theta as it stands at the end of a step."""
        for k in range(3):
            self.assign(at, target.start + k, {THETA.start + k: 1.0}, 0.0)

    def compiled(self) -> Compiled:
        """Operations in the order of steps, within a step in the order they were asked for."""
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
    name: str,
    at: ArrayLike,
    target: int,
    rows: Sequence[Row],
    z: Sequence[ArrayLike] | NDArray,
    variance: Sequence[ArrayLike],
    gate: float,
) -> _Block:
    at = np.atleast_1d(np.asarray(at, dtype=np.int64))
    m, r, width = len(at), len(rows), max(max(len(row) for row in rows), 1)
    index, value = np.zeros((m, r, width), dtype=np.int64), np.zeros((m, r, width))
    for i, row in enumerate(rows):
        for k, (state, coefficient) in enumerate(row.items()):
            index[:, i, k], value[:, i, k] = state, coefficient
    spread = [
        np.stack([np.broadcast_to(np.asarray(e, dtype=float), (m,)) for e in part], axis=1)
        for part in (z, variance)
    ]
    return _Block(operation, name, at, target, index, value, spread[0], spread[1], gate)


def _padded(rows: NDArray, width: int) -> NDArray:
    """(m, r, nz) as (m r, width), zeros at the end."""
    out = np.zeros((rows.shape[0] * rows.shape[1], width), dtype=rows.dtype)
    out[:, : rows.shape[2]] = rows.reshape(-1, rows.shape[2])
    return out
