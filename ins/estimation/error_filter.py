"""Kalman filter over the errors of a navigation solution, with the gyro bias as constants over time
bins.

State: the base states of `ins.estimation.error_model`, then the gyro bias of each time bin in body
axes [rad/s] (bin 0 x, y, z, bin 1 x, ...), then further states of the caller's, if any. The bins
are static and start with their full joint covariance, so the last posterior of every bin is its
smoothed estimate; no backward pass is needed.

Decision: docs/decisions/0003-filter-tape.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ins.estimation import error_model as em
from ins.estimation.tape import (
    ADD,
    ASSIGN,
    BIN,
    INPUTS,
    LOST,
    MEASURE,
    MOVING,
    RECORD,
    REFUSED,
    USED,
    Compiled,
    Drives,
    Tape,
)

GATE_SIGMA = 6.0  # a residual beyond this many sigmas is left out and listed, not used


@dataclass
class Tally:
    """What a filter keeps of its measurements, by kind.

    Parameters
    ----------
    nis : dict of float
        Sum of the squared normalised innovations.
    dof : dict of int
        Degrees of freedom of that sum.
    rejected : list of (float, str)
        Time [s] and kind of what the gate left out.
    normalised : dict of ndarray, shape (k, r)
        Innovations over their sigmas.
    heading_gain : dict of float
        Log of the ratio in variance of the cloned heading.
    log_likelihood : dict of float
        Of the measurements given those before, less its constant: -(nu^2 + ln S) / 2, summed.
    refused_log_likelihood : float
        The same of those that the gate left out, each innovation at the gate at most.
    """

    nis: dict[str, float] = field(default_factory=dict)
    dof: dict[str, int] = field(default_factory=dict)
    rejected: list[tuple[float, str]] = field(default_factory=list)
    normalised: dict[str, NDArray] = field(default_factory=dict)
    heading_gain: dict[str, float] = field(default_factory=dict)
    log_likelihood: dict[str, float] = field(default_factory=dict)
    refused_log_likelihood: float = 0.0

    @property
    def loglik(self) -> float:
        """Log likelihood of all measurements, but for its constant.

        Its difference to that of another filter over the same measurements is the log of the Bayes
        factor of what the two take for possible.
        """
        return sum(self.log_likelihood.values()) + self.refused_log_likelihood


class ErrorFilter:
    """State x (n,) and covariance P (n, n) of the error filter.

    n is 42 + 3 for each bin + further states.

    Parameters
    ----------
    sigma0 : mapping of float
        Prior sigmas of base states by their names in `ins.estimation.states`; the others start
        known.
    noise : ProcessNoise
    bias_mean : ndarray, shape (3 bins,)
        Prior of the gyro bias [rad/s].
    bias_covariance : ndarray, shape (3 bins, 3 bins)
        In (rad/s)^2.
    further_sigma : tuple of float
        Priors of further states, of mean zero. They stand still unless the tape moves them.
    further_walks : mapping of float
        States beyond those of `noise` that walk at random, and the variance that each gains in a
        second.

    Attributes
    ----------
    filtered : ndarray, shape (bins, 2, 3)
        Bias and variance of each bin as they stood when its time was over.
    tally : Tally
    considered_from : int
        The state from which on they are considered: they widen what is estimated and are left as
        they are. None by default.
    """

    def __init__(
        self,
        *,
        sigma0: Mapping[str, float],
        noise: em.ProcessNoise,
        bias_mean: NDArray,
        bias_covariance: NDArray,
        further_sigma: tuple[float, ...] = (),
        further_walks: Mapping[int, float] = MappingProxyType({}),
    ) -> None:
        self._bins = slice(em.BASE, em.BASE + bias_mean.size)
        n = self._bins.stop + len(further_sigma)
        self.noise = noise
        self.walks = {**noise.walks(), **further_walks}
        self.x, self.P = np.zeros(n), np.zeros((n, n))
        for name, sigma in sigma0.items():
            index = getattr(em, name)
            for i in range(index.start, index.stop) if isinstance(index, slice) else (index,):
                self.P[i, i] = sigma**2
        self.x[self._bins] = bias_mean
        self.P[self._bins, self._bins] = bias_covariance
        further = np.arange(self._bins.stop, n)
        self.P[further, further] = np.square(further_sigma)
        self.filtered = np.full((bias_mean.size // 3, 2, 3), np.nan)
        self.clone_start()
        self.tally = Tally()
        self.considered_from = n

    def clone_start(self) -> None:
        """Copy theta as it stands now into its clone at the start, fully correlated with it."""
        M = np.eye(self.x.size)
        M[em.THETA_START] = 0.0
        M[em.THETA_START, em.THETA] = np.eye(3)
        self.x, self.P = M @ self.x, M @ self.P @ M.T

    def widen_prior(self, index: int, sigma: float) -> None:
        """Give one state a fresh, independent prior of mean zero.

        Parameters
        ----------
        index : int
            The state.
        sigma : float
            In its unit.
        """
        self.x[index], self.P[index], self.P[:, index] = 0.0, 0.0, 0.0
        self.P[index, index] = sigma**2

    def withdraw_prior(self, index: int, sigma: float) -> None:
        """Take back what the prior N(0, sigma^2) of a static state said.

        Parameters
        ----------
        index : int
            The state.
        sigma : float
            Of the prior, in its unit.

        Notes
        -----
        It is the update of that state with variance -sigma^2, which is exact. It needs the
        posterior of the state to be well inside its prior; else nothing is done.
        """
        S = self.P[index, index] - sigma**2
        if S > -0.5 * sigma**2:
            return
        gain = self.P[:, index] / S
        self.x = self.x - gain * self.x[index]
        P = self.P - np.outer(gain, self.P[index, :])
        self.P = 0.5 * (P + P.T)

    def run(self, tape: Tape | Compiled) -> None:
        """Work through a tape, in place.

        Parameters
        ----------
        tape : Tape or Compiled

        Raises
        ------
        ArithmeticError
            Where the covariance loses its digits; names the kind of measurement and the time.
        ValueError
            Where a value is not finite, likewise, or a bin is not one of the filter.
        """
        self._sweep(tape, keep_gains=False)

    def run_for_response(self, tape: Tape | Compiled) -> "Response":
        """Work through a tape, in place, and keep its gains for further columns.

        Parameters
        ----------
        tape : Tape or Compiled
            None of its steps may be linearised about the filter's own velocity error.

        Returns
        -------
        response : Response

        Raises
        ------
        ArithmeticError
            As `run`.
        ValueError
            As `run`, or where a step is linearised about the filter's own velocity error.
        """
        compiled = tape if isinstance(tape, Compiled) else tape.compiled()
        if compiled.flags[:, MOVING].any():
            step = int(np.argmax(compiled.flags[:, MOVING]))
            raise ValueError(f"step {step} is linearised about the filter's own velocity error")
        return self._sweep(compiled, keep_gains=True)

    def run_for_records(
        self,
        tape: Tape | Compiled,
        states: NDArray,
        *,
        smooth: bool = False,
        fed_back: "FedBack | None" = None,
    ) -> tuple["Response", NDArray, NDArray]:
        """Work through a tape, in place, and keep what it records.

        Parameters
        ----------
        tape : Tape or Compiled
        states : ndarray of int, shape (q,)
            States whose errors are recorded.
        smooth : bool
            Given all measurements of the tape, those that come later too.
        fed_back : FedBack, optional
            Where attitudes are fed back at each step: not to be smoothed.

        Returns
        -------
        response : Response
        x, P : ndarray, shapes (records, q), (records, q, q)

        Raises
        ------
        ArithmeticError, ValueError
            As `run`.
        """
        recorded = None if smooth else states
        found = self._sweep(tape, keep_gains=smooth, recorded=recorded, fed_back=fed_back)
        kept = np.isin(states, found.own)
        x, P = (
            np.zeros((len(found.x_rows), kept.size)),
            np.zeros((len(found.x_rows), kept.size, kept.size)),
        )
        of_own = found.smoothed(states[kept]) if smooth else (found.x_rows, found.P_rows)
        at = found.placed.of[states[kept]]
        x[:, kept] = of_own[0][:, at]
        P[:, kept[:, None] & kept] = of_own[1].reshape(len(x), at.size**2)
        return found, x, P

    def _sweep(
        self,
        tape: Tape | Compiled,
        *,
        keep_gains: bool,
        recorded: NDArray | None = None,
        fed_back: "FedBack | None" = None,
    ) -> "Response":
        """The sweep over the states in use."""
        from ins.estimation import kernel

        c = tape if isinstance(tape, Compiled) else tape.compiled()
        bins = c.flags[:, BIN]
        wrong = bins[(bins < 0) | (bins >= max(len(self.filtered), 1))]
        if wrong.size:
            raise ValueError(f"bin {wrong[0]}, the filter has {len(self.filtered)}")
        use = _in_use(c, self.x, self.P, self.walks)
        own, count = np.flatnonzero(use), len(c.ops)
        x, P = self.x[own], np.ascontiguousarray(self.P[np.ix_(own, own)])
        placed = _placed(c, use)
        walks = {state: density for state, density in self.walks.items() if use[state]}
        outcome, gain = np.zeros(count, dtype=np.int64), np.full(count, np.nan)
        normalised, spread = np.zeros(len(c.z)), np.ones(len(c.z))
        gains = np.zeros((len(c.z) if keep_gains else 0, own.size))
        alone, records = np.zeros((len(c.z), 2)), int((c.ops[:, 0] == RECORD).sum())
        kept = np.arange(own.size) if recorded is None else placed.of[recorded[use[recorded]]]
        x_rows, P_rows = np.zeros((records, own.size)), np.zeros((records, kept.size, kept.size))
        back = (
            FedBack(np.zeros((0, 10)), np.zeros((0, 15)), np.zeros((0, 2), np.int64))
            if fed_back is None
            else fed_back
        )
        turning = back.turning[use[back.turning[:, 0]]]
        turns = np.tile(np.eye(3), (records, 1, 1))
        stopped = kernel.sweep(
            x,
            P,
            placed.moves,
            placed.core,
            c.steps,
            c.flags,
            c.shift,
            self.noise.values(),
            placed.of[np.array(list(walks), dtype=np.int64)],
            np.array(list(walks.values()), dtype=float),
            placed.drives.first,
            placed.drives.state,
            placed.drives.target,
            placed.drives.value,
            placed.ops,
            c.first_entry,
            placed.index,
            placed.value if fed_back is None else placed.value.copy(),
            c.z if fed_back is None else c.z.copy(),
            c.variance,
            c.gate,
            placed.of[em.THETA_CLONE.stop - 1],
            placed.of[np.arange(self._bins.start, self._bins.stop).reshape(-1, 3)],
            outcome,
            normalised,
            spread,
            gain,
            self.filtered,
            gains,
            alone,
            int(use[: self.considered_from].sum()),
            kept,
            x_rows,
            P_rows,
            back.pushes,
            back.levers,
            np.column_stack([placed.of[turning[:, 0]], turning[:, 1]]),
            np.eye(3),
            turns,
        )
        self.x[own], self.P[np.ix_(own, own)] = x, P
        if stopped >= 0:
            where = f"{c.names[c.name[stopped]]} at {c.time_s[stopped]:.1f} s"
            if outcome[stopped] == LOST:
                raise ArithmeticError(f"{where}: the covariance has lost its digits")
            raise ValueError(f"{where}: measurement, state or covariance is not finite")
        self._book(c, outcome, normalised, spread, gain)
        return Response(
            c,
            placed,
            own,
            self.noise,
            outcome,
            normalised,
            spread,
            gains,
            alone,
            x_rows,
            P_rows,
            turns,
        )

    def _book(
        self, c: Compiled, outcome: NDArray, normalised: NDArray, spread: NDArray, gain: NDArray
    ) -> None:
        """Enter what became of the measurements into the tally."""
        tally, measured = self.tally, c.ops[:, 0] == MEASURE
        for number, name in enumerate(c.names):
            of_kind = measured & (c.name == number)
            used = np.flatnonzero(of_kind & (outcome == USED))
            if used.size:
                rows = c.ops[used, 2][:, None] + np.arange(c.ops[used[0], 3])
                seen = normalised[rows]
                tally.nis[name] = tally.nis.get(name, 0.0) + float(np.sum(seen**2))
                tally.dof[name] = tally.dof.get(name, 0) + seen.size
                likelihood = -0.5 * float(np.sum(seen**2 + np.log(spread[rows])))
                tally.log_likelihood[name] = tally.log_likelihood.get(name, 0.0) + likelihood
                before = tally.normalised.get(name)
                tally.normalised[name] = seen if before is None else np.concatenate([before, seen])
                gained = gain[used][np.isfinite(gain[used])]  # NaN before the clone was made
                if gained.size:
                    tally.heading_gain[name] = tally.heading_gain.get(name, 0.0) + float(
                        np.sum(gained)
                    )
        refused = np.flatnonzero(measured & (outcome == REFUSED))
        left_out = np.repeat(c.ops[refused, 2], c.ops[refused, 3])
        left_out += np.concatenate([np.arange(0), *map(np.arange, c.ops[refused, 3])])
        tally.refused_log_likelihood -= 0.5 * float(
            np.sum(normalised[left_out] ** 2 + np.log(spread[left_out]))
        )
        tally.rejected.extend((float(c.time_s[k]), c.names[c.name[k]]) for k in refused)

    @property
    def bias(self) -> tuple[NDArray, NDArray]:
        """Mean (3 bins,) [rad/s] and covariance (3 bins, 3 bins) of the gyro bias bins."""
        return self.x[self._bins].copy(), self.P[self._bins, self._bins].copy()


@dataclass(frozen=True)
class FedBack:
    """A reference whose attitude the errors are taken off at each step, so that they are small
    from whatever heading they begin.

    Parameters
    ----------
    pushes : ndarray, shape (K, 10)
        Velocity that the specific force adds to the reference over each step, the velocity at its
        end that w is about [m/s], and by how much the specific force takes it further than by the
        mean of its velocities [m], navigation axes; 1: the mean velocity of the step is by that
        force, 0: by none.
    levers : ndarray, shape (rows, 15)
        Vectors a, b, c, d, e of each row: of an attitude turned by R its z is larger by
        a' (R - 1) b; it holds c times the velocity; theta x d is in it, d turned; e: see below.
    turning : ndarray of int, shape (q, 2)
        States whose coefficients in three rows are a vector that turns with the attitude; 1: all
        but e of it.
    """

    pushes: NDArray
    levers: NDArray
    turning: NDArray


@dataclass(frozen=True)
class _Placed:
    """A tape over the states in use: of (n,): where each state stands among them, 0 where it is
    not in use; core (12,): where the core's errors stand, and which of them move; its drives, ops,
    index and value by these places.
    """

    of: NDArray
    core: NDArray
    moves: NDArray
    drives: Drives
    ops: NDArray
    index: NDArray
    value: NDArray


def _in_use(c: Compiled, x: NDArray, P: NDArray, walks: Mapping[int, float]) -> NDArray:
    """States (n,) that are not known to be zero throughout: the others would be rows of zeros."""
    use = (np.diag(P) != 0.0) | (x != 0.0)
    use[[state for state, density in walks.items() if density > 0.0]] = True
    use[: em.CORE] = False
    use[em.moving(c.level, c.wheels)] = True
    changed = (c.ops[:, 0] == ADD) | (c.ops[:, 0] == ASSIGN)
    use[c.ops[changed, 1]] = True
    use[em.THETA_CLONE.stop - 1] = True
    use[em.BASE : em.BASE + 3 * (1 + int(c.flags[:, BIN].max(initial=-1)))] = True
    return np.asarray(use)


def _placed(c: Compiled, use: NDArray) -> _Placed:
    of = np.where(use, np.cumsum(use) - 1, 0)
    ops = c.ops.copy()
    changed = (ops[:, 0] == ADD) | (ops[:, 0] == ASSIGN)
    ops[changed, 1] = of[ops[changed, 1]]
    drives = c.drives.only(use[c.drives.state])
    drives = Drives(drives.first, of[drives.state], drives.target, drives.value)
    value = np.where(use[c.index], c.value, 0.0)
    return _Placed(of, of[: em.CORE], em.moving(c.level, c.wheels), drives, ops, of[c.index], value)


@dataclass(frozen=True)
class Response:
    """A sweep's own gains, for what further columns add to its innovations.

    A column holds what the errors are less what the filter takes them for: e- = Phi e + u,
    nu = H e + m, e+ = e- - K nu. So whitening is the filter itself.

    Parameters
    ----------
    tape : Compiled
    placed : _Placed
    own : ndarray of int, shape (k,)
        The states in use.
    noise : ProcessNoise
    outcome : ndarray of int, shape (m,)
        What became of each operation.
    normalised : ndarray, shape (rows,)
        The sweep's own innovations over their sigmas.
    spread : ndarray, shape (rows,)
        Variances of the innovations.
    gains : ndarray, shape (rows, k)
    alone : ndarray, shape (rows, 2)
        Innovation of each row as if it were measured alone, and its variance.
    x_rows, P_rows : ndarray, shapes (records, k), (records, q, q)
        As recorded.
    turns : ndarray, shape (records, 3, 3)
        From the reference to the attitudes that x_rows are errors of.
    """

    tape: Compiled
    placed: _Placed
    own: NDArray
    noise: em.ProcessNoise
    outcome: NDArray
    normalised: NDArray
    spread: NDArray
    gains: NDArray
    alone: NDArray
    x_rows: NDArray
    P_rows: NDArray
    turns: NDArray

    def smoothed(self, states: NDArray) -> tuple[NDArray, NDArray]:
        """What was recorded of all states in use, given all measurements.

        Parameters
        ----------
        states : ndarray of int, shape (q,)
            States in use, whose covariance is wanted.

        Returns
        -------
        x, P : ndarray, shapes (records, k), (records, q, q)
        """
        from ins.estimation import kernel

        c, placed, k = self.tape, self.placed, self.own.size
        kept = placed.of[states]
        x, P = self.x_rows.copy(), np.zeros((len(self.x_rows), kept.size, kept.size))
        kernel.smooth(
            placed.moves,
            placed.core,
            c.steps,
            c.flags,
            self.noise.values(),
            placed.drives.first,
            placed.drives.state,
            placed.drives.target,
            placed.drives.value,
            placed.ops,
            c.first_entry,
            placed.index,
            placed.value,
            self.outcome,
            self.normalised,
            self.spread,
            self.gains,
            np.zeros(k),
            np.zeros((k, k)),
            kept,
            x,
            self.P_rows,
            P,
        )
        return x, P

    def counted(self, name: str) -> tuple[int, int]:
        """Measurements of a kind that were used, and those refused.

        Parameters
        ----------
        name : str

        Returns
        -------
        used, refused : int
        """
        c = self.tape
        became = self.outcome[(c.ops[:, 0] == MEASURE) & (np.array(c.names)[c.name] == name)]
        return int((became == USED).sum()), int((became == REFUSED).sum())

    @property
    def used_rows(self) -> NDArray:
        """Rows of measurements that were used (m,), in the order of the sweep."""
        used = self.tape.ops[(self.tape.ops[:, 0] == MEASURE) & (self.outcome == USED)]
        rows = [np.arange(first, first + count) for _, _, first, count in used]
        return np.concatenate([np.zeros(0, dtype=np.int64), *rows])

    def of(self, start: NDArray, sensed: NDArray, measured: NDArray) -> NDArray:
        """Innovations of further columns over the sweep's sigmas.

        Parameters
        ----------
        start : ndarray, shape (n, m)
            Errors less what the filter takes them for, at the start.
        sensed : ndarray, shape (K, 9, m)
            What the inputs of the core are wrong by over each step (`Tape.drive`).
        measured : ndarray, shape (rows, m)
            What each row's measured value is changed by.

        Returns
        -------
        innovations : ndarray, shape (used, m)
            Of the rows in use, in the order of the sweep.

        Raises
        ------
        ValueError
            Where a shape is another one, or a column starts with a state that the filter takes for
            zero throughout.
        """
        from ins.estimation import kernel

        c, placed = self.tape, self.placed
        self._check(start, sensed, measured)
        out = np.zeros(measured.shape)
        kernel.respond(
            np.ascontiguousarray(start[self.own]),
            placed.moves,
            placed.core,
            c.steps,
            c.flags,
            self.noise.values(),
            placed.drives.first,
            placed.drives.state,
            placed.drives.target,
            placed.drives.value,
            placed.ops,
            c.first_entry,
            placed.index,
            placed.value,
            self.outcome,
            self.spread,
            self.gains,
            np.ascontiguousarray(sensed),
            np.ascontiguousarray(measured),
            out,
        )
        return np.asarray(out[self.used_rows])

    def _check(self, start: NDArray, sensed: NDArray, measured: NDArray) -> None:
        """ValueError where columns do not fit the sweep."""
        m, states = start.shape[-1], len(self.placed.of)
        needed = {
            "start": (start, (states, m)),
            "sensed": (sensed, (len(self.tape.steps), INPUTS, m)),
            "measured": (measured, (len(self.tape.z), m)),
        }
        for name, (given, shape) in needed.items():
            if given.shape != shape:
                raise ValueError(f"{name} has shape {given.shape}, needed {shape}")
        started = np.setdiff1d(np.flatnonzero(start.any(axis=1)), self.own)
        if started.size:
            raise ValueError(f"start of state {started[0]}, which the filter takes for zero")
