"""A stretch of an aided solution as what an error filter is linearised about: from each row of the
solution the increments are integrated anew, and at the next the solution is set to that row.

So no bias of the aided filter is used, and nothing that its start was found with counts twice: what
the rows are is known, however they were found.

Decision: docs/decisions/0076-mean-specific-force.md.
"""

from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, median_filter
from scipy.signal import lfilter

from ins.attitude import rotation_vector_from_dcm, skew
from ins.earth import (
    SEMI_MAJOR_AXIS_M,
    displacement_ned,
    ecef_from_geodetic,
    geodetic_from_ecef,
    gravity_n,
    omega_en_n,
    omega_ie_n,
    transport_by_speed,
)
from ins.estimation.measurements.antenna import AntennaMotion, Epoch, RowSums, motion_from, moved_by
from ins.estimation.sensors import REST_B
from ins.estimation.tape import Steps
from ins.filters.aided_records import AidedHistory, AidedStart, Antenna, Fixes
from ins.filters.states import AIDED_VEL
from ins.records import ImuLog, ImuSource, InputError, NavState
from ins.strapdown.compensation import compensate, corrected
from ins.strapdown.increments import joined

# rows of the solution, a second apart, whose log is read at a time; chosen: of 200 Hz 8 MB
READ_ROWS = 600
# squared sigmas of a velocity's change in a second beyond which it is motion: 1.5e-5 of noise
CHANGES_SQUARES = 25.0
LEAST_NOISE_M_S = 1e-6  # of a solution that has none
SLOW_ROWS = 30.0  # sigma of the mean of the slow part; chosen: of noise 1 % is left in its changes
BEFORE_S = 0.2  # in which a row before ends; a log of fewer rows a second begins without its coning
UNIT_MATRIX = np.eye(3)
LEAPS = 5  # of fixes in a row, of which up to two may be wild; chosen
SHAKEN_S = 2.0  # chosen: of 100 rows at 50 Hz the shaking is known to 7 %
# integral of the squared difference of the shaking and its mean over SHAKEN_S after a jump from 0
# to 1, over SHAKEN_S: of sqrt(1 - exp(-u)) less its exponential mean, by numbers
OF_A_JUMP = 0.2954
Columns = TypeVar("Columns", "Reference", "_Increments", Epoch)


@dataclass(frozen=True)
class Reference:
    """K steps, each of which ends at a fix or at a row of the solution.

    The first, of no length, is where the stretch begins.

    Parameters
    ----------
    end_s, dt_s : ndarray, shape (K,)
    closes : ndarray of bool, shape (K,)
        The step ends at a row.
    end : Epoch
        The reference at the ends; of a step that closes the row itself.
    C_mean : ndarray, shape (K, 3, 3)
        Over the step.
    travels_n, travels_mean_n : ndarray, shape (K, 3)
        The velocity that the errors are linearised about, at the end and over the step [m/s].
    shift : ndarray, shape (K, 9)
        Of the errors w, p, theta at a row, as of `ins.estimation.tape.Steps`.
    rate_b, force_b : ndarray, shape (K, 3)
        Means that the sensors read [rad/s], [m/s^2].
    plain : ndarray of bool, shape (K,)
        Within the second of the step the velocity changes by no more than noise may.
    push_n, lag_n : ndarray, shape (K, 3)
        Velocity that the specific force adds [m/s], and by how much it leads further than by the
        mean of the velocities [m].
    omega_ie_n, pull_n : ndarray, shape (K, 3)
        Earth rate [rad/s], gravity with Coriolis [m/s^2].
    gravity, transport, radius_m : ndarray, shapes (K,), (K, 3), (K,)
        As of `Steps`.
    fix : ndarray of int, shape (K,)
        The fix at the end, -1: none.
    """

    end_s: NDArray
    dt_s: NDArray
    closes: NDArray
    end: Epoch
    C_mean: NDArray
    travels_n: NDArray
    travels_mean_n: NDArray
    shift: NDArray
    rate_b: NDArray
    force_b: NDArray
    plain: NDArray
    push_n: NDArray
    lag_n: NDArray
    omega_ie_n: NDArray
    pull_n: NDArray
    gravity: NDArray
    transport: NDArray
    radius_m: NDArray
    fix: NDArray

    def steps(self, bin_index: NDArray, jump_w: NDArray | None = None) -> Steps:
        """The steps of a tape.

        Parameters
        ----------
        bin_index : ndarray of int, shape (K,)
            The bins of the gyros.
        jump_w : ndarray, shape (K,), optional
            As of `ins.estimation.tape.Steps`.

        Returns
        -------
        steps : Steps
        """
        none, off = np.zeros(self.dt_s.size), np.zeros(self.dt_s.size, dtype=bool)
        return Steps(
            end_s=self.end_s,
            dt_s=self.dt_s,
            C_nb=self.C_mean,
            v_n=self.travels_mean_n,
            omega_ie_n=self.omega_ie_n,
            transport=self.transport,
            gravity=self.gravity,
            radius_m=self.radius_m,
            turn_rad=none,
            bin_index=bin_index,
            rolling=off,
            keep=off,
            moving=off,
            jump_yaw=none,
            jump_w=none if jump_w is None else jump_w,
            jump_theta=none,
            shift=self.shift,
            level=False,
            wheels=False,
        )


@dataclass(frozen=True)
class Rows:
    """Rows of a solution.

    Parameters
    ----------
    time_s : ndarray, shape (R,)
    place : ndarray, shape (R, 3)
        Latitude, longitude [rad], height [m].
    v_n_m_s : ndarray, shape (R, 3)
    C_nb : ndarray, shape (R, 3, 3)
    v_variance : ndarray, shape (R, 3)
        Of the velocities [m^2/s^2].
    """

    time_s: NDArray
    place: NDArray
    v_n_m_s: NDArray
    C_nb: NDArray
    v_variance: NDArray

    @classmethod
    def of(cls, history: AidedHistory) -> "Rows":
        """Those of an aided solution.

        Parameters
        ----------
        history : AidedHistory

        Returns
        -------
        rows : Rows
        """
        h = history
        place = np.column_stack([h.lat_rad, h.lon_rad, h.height_m])
        return cls(h.time_s, place, h.v_n_m_s, h.C_nb, h.variance[:, AIDED_VEL])


@dataclass(frozen=True)
class About:
    """What an aided filter is linearised about: a solution, with the log that it is integrated by.

    Parameters
    ----------
    rows : Rows
    reference : Reference
    sums : RowSums
    imu : ImuSource
        The log less taken_off.
    taken_off : ndarray, shape (6,)
        Biases of gyros [rad/s] and accelerometers [m/s^2].
    done : dict
        What the log did between fixes at several times, and rows.
    measured : dict
        What fixes that were measured last say of it, since a search of noise asks for the same.
    laid : dict
        Tapes along it, which other noise is laid on.
    near : dict
        What antennas that are free were last linearised about.
    """

    rows: Rows
    reference: Reference
    sums: RowSums
    imu: ImuSource
    taken_off: NDArray
    done: dict[bytes, "_Increments"] = field(default_factory=dict, repr=False)
    measured: dict[tuple[object, ...], Any] = field(default_factory=dict, init=False, repr=False)
    laid: dict[tuple[object, ...], Any] = field(default_factory=dict, init=False, repr=False)
    near: dict[bytes, Antenna] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(
        cls, imu: ImuSource, rows: Rows, taken_off: NDArray, fix_s: NDArray, vrw: float
    ) -> "About":
        """A whole solution with steps that end at fixes.

        Parameters
        ----------
        imu : ImuSource
            The log with all its biases.
        rows : Rows
        taken_off : ndarray, shape (6,)
            Biases of gyros [rad/s] and accelerometers [m/s^2].
        fix_s : ndarray, shape (F,)
        vrw : float
            As of `reference`.

        Returns
        -------
        about : About
        """
        log = corrected(imu, partial(less, biases=taken_off))
        did = _done(log, rows.time_s, fix_s)
        about = cls(rows, _over(did, rows, vrw), RowSums(log), log, taken_off)
        about.done[fix_s.tobytes()] = did
        return about

    @classmethod
    def by_fixes(
        cls, imu: ImuSource, start: AidedStart, fixes: Fixes, end_s: float, vrw: float
    ) -> "About":
        """About where the fixes say that it was, each second, with the attitude of the gyros alone.

        Parameters
        ----------
        imu : ImuSource
            The log with all its biases.
        start : AidedStart
        fixes : Fixes
        end_s : float
            Of the solution.
        vrw : float
            As of `reference`.

        Returns
        -------
        about : About

        Raises
        ------
        InputError
            Where the log ends within a second of the start.
        """
        state = start.state
        biases = np.concatenate([start.gyro_bias_rad_s, start.accel_bias_m_s2])
        log = corrected(imu, partial(less, biases=biases))
        t = _seconds(log, state.time_s, end_s)
        did = _done(log, t, fixes.time_s)
        C_nb = [state.C_nb]
        for C_bb in did.C_bb:
            C_nb.append(C_nb[-1] @ C_bb)
        at_rows = np.array(C_nb)[np.concatenate([[0], 1 + np.flatnonzero(did.closes)])]
        place, v_n = _seen(state, fixes, t)
        variance = np.tile(np.diag(start.covariance)[AIDED_VEL], (t.size, 1))
        seen = np.isfinite(fixes.v_n_m_s).all(axis=1)
        if seen.any():
            variance[1:] = np.median(fixes.sigma_velocity_m_s[seen], axis=0) ** 2
        rows = Rows(t, place, v_n, at_rows, variance)
        about = cls(rows, _over(did, rows, vrw), RowSums(log), log, biases)
        about.done[fixes.time_s.tobytes()] = did
        return about

    def along(self, rows: Rows, fix_s: NDArray, vrw: float) -> "About":
        """About other rows at the same times, with other fixes.

        Parameters
        ----------
        rows : Rows
        fix_s : ndarray, shape (F,)
        vrw : float
            As of `reference`.

        Returns
        -------
        about : About
        """
        key = fix_s.tobytes()
        if key not in self.done:
            self.done[key] = _done(self.imu, rows.time_s, fix_s)
        whole = _over(self.done[key], rows, vrw)
        return replace(self, rows=rows, reference=whole, sums=RowSums(self.imu))

    def motion(self, at: NDArray, arm_m: NDArray, time_s: NDArray) -> AntennaMotion:
        """Of a point of the body, each time from the end of a step.

        Parameters
        ----------
        at : ndarray of int, shape (m,)
            The steps.
        arm_m : ndarray, shape (3,)
            From the unit, body axes.
        time_s : ndarray, shape (m,)

        Returns
        -------
        motion : AntennaMotion
        """
        ref = self.reference
        epoch = Epoch(*(column[at] for column in vars(ref.end).values()))
        return motion_from(epoch, ref.pull_n[at], self.sums, arm_m, time_s)

    def errors_of(self, state: NavState) -> NDArray:
        """Errors of the first row where a state at its time is true.

        Parameters
        ----------
        state : NavState

        Returns
        -------
        errors : ndarray, shape (9,)
            w [m/s], p [m], theta [rad].
        """
        site, rows = state.site, self.rows
        place = np.array([[site.lat_rad, site.lon_rad, site.height_m]])
        true = Epoch(rows.time_s[:1], place, state.v_n_m_s[None], state.C_nb[None])
        first = rows.place[:1], rows.v_n_m_s[:1], rows.C_nb[:1]
        return _shift(true, np.array([0]), first, self.reference.travels_n[:1])[0]

    @cached_property
    def _shaken(self) -> tuple[NDArray, NDArray]:
        """Shaking (K,) at the ends of the steps, and the integral (K,) of the square of what it is
        off its mean over SHAKEN_S, over each step.
        """
        squares, times, last = [], [], None
        for piece in self.imu.pieces():
            force = piece.dv_m_s / piece.dt_s[:, None]
            change = np.diff(force, axis=0, prepend=force[:1] if last is None else last)
            squares.append(np.sum(change**2, axis=1) / 6.0)
            times.append(piece.time_s)
            last = force[-1:]
        t, each = np.concatenate(times), np.concatenate(squares)
        each[0] = each[1]  # the first row has none before it
        share = min(1.0 / (self.imu.rate_hz * SHAKEN_S), 1.0)

        def lately(rows: NDArray) -> NDArray:
            begin = [(1.0 - share) * rows[0]]
            return np.asarray(lfilter([share], [1.0, share - 1.0], rows, zi=begin)[0])

        shaking = np.sqrt(lately(each))
        off = np.cumsum((shaking - lately(shaking)) ** 2) / self.imu.rate_hz
        ends_s = self.reference.end_s
        integral = np.diff(np.interp(ends_s, t, off), prepend=0.0)
        integral[0] = 0.0
        return np.interp(ends_s, t, shaking), integral

    @property
    def shaking(self) -> NDArray:
        """Vibration over SHAKEN_S before the end of each step (K,) [m/s^2].

        Root mean square of what the specific force changes by from row to row: of white noise its
        sigma; a third of the squares of three components, half of it each row's.
        """
        return self._shaken[0]

    def white(self, stirred: float) -> NDArray | None:
        """What vibration adds to the velocity where biases go with it.

        Parameters
        ----------
        stirred : float
            As of `AidedNoise`.

        Returns
        -------
        variance : ndarray, shape (K,) [m^2/s^2], or None
        """
        if stirred == 0.0:
            return None
        return self.shaking**2 * self.reference.dt_s / self.imu.rate_hz

    @property
    def stirs(self) -> NDArray:
        """Variance (K,) that a random walk which goes as far as vibration jumps gains in each step.

        It is the same however long the steps are.
        """
        return self._shaken[1] / (OF_A_JUMP * SHAKEN_S)


def _seconds(imu: ImuSource, start_s: float, end_s: float) -> NDArray:
    """The start, and the rows of a log each second after it."""
    found = [np.array([start_s])]
    for piece in imu.pieces(start_s + 1e-6, end_s + 1e-6):
        since = np.floor(np.append(found[-1][-1], piece.time_s) - start_s + 1e-6)
        found.append(piece.time_s[since[1:] > since[:-1]])
    t = np.concatenate(found)
    if t.size < 2:
        raise InputError(
            f"imu: ends at {end_s:.6g} s, needed a second of rows after {start_s:.6g} s"
        )
    return t


def _seen(state: NavState, fixes: Fixes, t: NDArray) -> tuple[NDArray, NDArray]:
    """Place and velocity (R, 3) at times by the fixes after a state, which are joined by lines."""
    later = fixes.time_s > state.time_s + 1e-6
    placed = later & np.isfinite(fixes.r_e_m).all(axis=1)
    moving = later & np.isfinite(fixes.v_n_m_s).all(axis=1)
    site = state.site
    first = np.array(
        ecef_from_geodetic(np.array(site.lat_rad), np.array(site.lon_rad), np.array(site.height_m))
    )

    def between(first: NDArray, of: NDArray, rows: NDArray) -> NDArray:
        plain = median_filter(np.vstack([first, rows[of]]), size=(LEAPS, 1), mode="nearest")
        return _at(t, np.append(state.time_s, fixes.time_s[of]), plain)

    place = np.column_stack(geodetic_from_ecef(between(first, placed, fixes.r_e_m)))
    return place, between(state.v_n_m_s, moving, fixes.v_n_m_s)


def less(imu: ImuLog, biases: NDArray) -> ImuLog:
    """A log less constant biases.

    Parameters
    ----------
    imu : ImuLog
    biases : ndarray, shape (6,)
        Of gyros [rad/s] and accelerometers [m/s^2].

    Returns
    -------
    log : ImuLog
    """
    return compensate(imu, gyro_bias_rad_s=biases[:3], accel_bias_m_s2=biases[3:])


def reference(
    imu: ImuSource, solution: Rows, fix_s: NDArray, stretches: list[slice], vrw: float
) -> Reference:
    """The reference over stretches of a solution, one after the other.

    Parameters
    ----------
    imu : ImuSource
        Compensated; holds the stretches.
    solution : Rows
    fix_s : ndarray, shape (F,)
        Times of fixes.
    stretches : list of slice
        Rows of the solution.
    vrw : float
        Velocity random walk of the accelerometers [m/s/sqrt(s)].

    Returns
    -------
    reference : Reference
    """
    parts = [Rows(*(c[of] for c in vars(solution).values())) for of in stretches]
    return _joined([_over(_done(imu, rows.time_s, fix_s), rows, vrw) for rows in parts])


def _done(imu: ImuSource, t: NDArray, fix_s: NDArray) -> "_Increments":
    """What a log did between rows of a solution and fixes. t (R,): times of the rows."""
    edges = [*range(0, t.size - 1, READ_ROWS), t.size - 1]
    return _joined([_increments(imu, t, span, fix_s) for span in pairwise(edges)])


def _over(log: "_Increments", solution: Rows, vrw: float) -> Reference:
    t = solution.time_s
    row = np.searchsorted(t, log.end_s - 0.5 * log.dt_s, side="right") - 1
    place, v_n, C_nb = solution.place, solution.v_n_m_s, solution.C_nb
    # amid two rows: who gains 4 m/s in a second turns by 0.3 microrad more than at its start
    (lat, _, height), v_mid = _amid(place).T, _amid(v_n)
    earth, transport_n = omega_ie_n(lat), omega_en_n(lat, height, v_mid)
    gravity = gravity_n(lat, height)
    pull = gravity - np.cross(2.0 * earth + transport_n, v_mid)
    transport = transport_by_speed(lat, height)
    end, C_mean, C_begin = _integrated(log, row, (v_n, C_nb), (earth + transport_n, pull))
    lag_b = log.way_b_m - 0.5 * log.dt_s[:, None] * log.dv_b_m_s
    reached = Epoch(log.end_s, moved_by(place[row], end.way_n), end.v_n, end.C_nb)
    last = np.flatnonzero(log.closes)
    travels, plain = _travels(t, v_n, solution.v_variance, vrw)
    slow = plain[row + 1, None]
    travels_end = np.where(slow, _at(log.end_s, t, travels), travels[row] + reached.v_n - v_n[row])
    begins = np.concatenate([travels[:1], travels_end[:-1]])
    begins[np.append(0, last[:-1] + 1)] = travels[:-1]
    travels_mean = 0.5 * (begins + travels_end)
    travels_end[last] = travels[1:]
    shift = np.zeros((log.dt_s.size, 9))
    shift[last] = _shift(reached, last, (place[1:], v_n[1:], C_nb[1:]), travels[1:])
    for values, of_rows in zip((reached.place, reached.v_n, reached.C_nb), (place, v_n, C_nb)):
        values[last] = of_rows[1:]

    def from_start(values: NDArray, first: NDArray | float) -> NDArray:
        return np.concatenate([np.broadcast_to(first, values[:1].shape), values])

    return Reference(
        end_s=from_start(log.end_s, t[0]),
        dt_s=from_start(log.dt_s, 0.0),
        closes=from_start(log.closes, True),
        end=Epoch(
            from_start(log.end_s, t[0]),
            from_start(reached.place, place[0]),
            from_start(reached.v_n, v_n[0]),
            from_start(reached.C_nb, C_nb[0]),
        ),
        C_mean=from_start(C_mean, C_nb[0]),
        travels_n=from_start(travels_end, travels[0]),
        plain=from_start(plain[row + 1], True),
        travels_mean_n=from_start(travels_mean, travels[0]),
        shift=from_start(shift, 0.0),
        rate_b=from_start(log.angle_b_rad / log.dt_s[:, None], 0.0),
        force_b=from_start(log.dv_b_m_s / log.dt_s[:, None], REST_B),
        push_n=from_start(np.einsum("kij,kj->ki", C_begin, log.dv_b_m_s), 0.0),
        lag_n=from_start(np.einsum("kij,kj->ki", C_begin, lag_b), 0.0),
        omega_ie_n=from_start(earth[row], earth[0]),
        pull_n=from_start(pull[row], pull[0]),
        gravity=from_start(gravity[row, 2], gravity[0, 2]),
        transport=from_start(transport[row], transport[0]),
        radius_m=SEMI_MAJOR_AXIS_M + from_start(place[row, 2], place[0, 2]),
        fix=from_start(log.fix, -1),
    )


class _Ends(NamedTuple):
    """Way from the row before (k, 3), velocity (k, 3), attitude (k, 3, 3), as integrated."""

    way_n: NDArray
    v_n: NDArray
    C_nb: NDArray

    def at(self, steps: NDArray) -> "_Ends":
        return _Ends(*(column[steps] for column in self))


def _integrated(
    log: "_Increments",
    row: NDArray,
    begins: tuple[NDArray, NDArray],
    pulls: tuple[NDArray, NDArray],
) -> tuple[_Ends, NDArray, NDArray]:
    """Where each step ends, and the attitudes (K, 3, 3) over it: the mean, and at its beginning.
    row (K,).
    """
    count, dt = row.size, log.dt_s[:, None]
    begin = _Ends(np.zeros((count, 3)), begins[0][row], begins[1][row])
    end = _Ends(*(np.zeros_like(column) for column in begin))
    turn, pull = pulls[0][row] * dt, pulls[1][row] * dt
    frame = UNIT_MATRIX - skew(turn)
    number = np.arange(count) - np.searchsorted(row, row)  # of a step since its row
    for k in range(int(number.max()) + 1):
        of = np.flatnonzero(number == k)
        if k:
            for column, ended in zip(begin, end.at(of - 1)):
                column[of] = ended
        way, v, C = begin.at(of)
        pushed = np.einsum("kij,kj->ki", C, log.dv_b_m_s[of])
        lags = np.einsum("kij,kj->ki", C, log.way_b_m[of] - 0.5 * dt[of] * log.dv_b_m_s[of])
        end.v_n[of] = v + pushed - 0.5 * np.cross(turn[of], pushed) + pull[of]
        end.way_n[of] = way + 0.5 * (v + end.v_n[of]) * dt[of] + lags
        end.C_nb[of] = frame[of] @ C @ log.C_bb[of]
    # of a car that turns by 20 deg in a step the sensors' axes at its start are 10 deg off
    turned = skew(log.angle_b_rad)
    C_mean = begin.C_nb @ (UNIT_MATRIX + 0.5 * turned + turned @ turned / 6.0)
    return end, C_mean, begin.C_nb


def _travels(t: NDArray, v_n: NDArray, variance: NDArray, vrw: float) -> tuple[NDArray, NDArray]:
    """The velocity (R, 3) of rows of a solution without the noise of its fixes and accelerometers,
    which the errors are linearised about, and whether it may be noise that it changed by (R,).

    Where the velocity changes by less than noise may, the slow part of it: a filter that takes
    noise for motion of a known size sees a heading in it that fixes do not confirm (of gyro z the
    sigma was 6 deg/h after 40 min straight ahead, 10 with a solution that has no noise). variance
    (R, 3): of the velocities; vrw: velocity random walk.
    """
    change = np.diff(v_n, axis=0, prepend=v_n[:1])
    white = variance + vrw**2 * np.diff(t, prepend=t[0])[:, None] + LEAST_NOISE_M_S**2
    plain = np.sum(change**2 / white, axis=1) < CHANGES_SQUARES
    at_once = np.cumsum(np.where(plain[:, None], 0.0, change), axis=0)
    slow = gaussian_filter1d(v_n - at_once, SLOW_ROWS, axis=0, mode="nearest")
    return at_once + slow, plain


def _amid(rows: NDArray) -> NDArray:
    """Means of two rows that follow each other, from those of R rows."""
    return np.asarray(0.5 * (rows[1:] + rows[:-1]))


def _at(time_s: NDArray, t: NDArray, rows: NDArray) -> NDArray:
    """Rows (R, 3) in between."""
    return np.stack([np.interp(time_s, t, column) for column in rows.T], axis=1)


def _shift(
    reached: Epoch, last: NDArray, rows: tuple[NDArray, NDArray, NDArray], travels: NDArray
) -> NDArray:
    """How much larger the errors w, p, theta (R - 1, 9) are at rows of the solution than at what
    the increments reached there, at the steps `last`. rows: place, velocity, attitude of them;
    travels (R - 1, 3): the velocity that w is about.

    p and theta as of `ins.estimation.error_model`: theta is the turn less that of the place.
    """
    place, v_n, C_nb = rows
    lat, lon, height = reached.place[last].T
    level = displacement_ned(place[:, 0], place[:, 1], lat0_rad=lat, lon0_rad=lon, height0_m=height)
    dp = np.column_stack([level, height - place[:, 2]])
    turn = rotation_vector_from_dcm(C_nb @ np.swapaxes(reached.C_nb[last], 1, 2))
    north, east, _ = dp.T / (SEMI_MAJOR_AXIS_M + place[:, 2])
    dtheta = turn - np.column_stack([-east, north, east * np.tan(place[:, 0])])
    dw = v_n - reached.v_n[last] - np.cross(dtheta, travels)
    return np.hstack([dw, dp, dtheta])


@dataclass(frozen=True)
class _Increments:
    """What the log did over K steps: end_s, dt_s (K,); closes (K,): the step ends at a row of the
    solution; fix (K,): the fix at its end, -1: none; C_bb (K, 3, 3): rotation; dv_b_m_s, way_b_m
    (K, 3): velocity gained and its integral, in the body frame of the start; angle_b_rad (K, 3):
    sum of angles.
    """

    end_s: NDArray
    closes: NDArray
    fix: NDArray
    dt_s: NDArray
    C_bb: NDArray
    dv_b_m_s: NDArray
    way_b_m: NDArray
    angle_b_rad: NDArray


def _increments(imu: ImuSource, t: NDArray, rows: tuple[int, int], fix_s: NDArray) -> _Increments:
    """Those between two rows of the solution. t (R,): its times; fix_s (F,): of all fixes."""
    first, last = rows
    begin_s, end_s = float(t[first]), float(t[last])
    # a row before: the first one's coning needs its angles
    log = imu.between(begin_s - BEFORE_S, end_s + 1e-6)
    before = int(np.searchsorted(log.time_s, begin_s + 1e-6, side="right"))
    at_row = np.searchsorted(log.time_s, t[first + 1 : last + 1] - 1e-6)
    here = np.flatnonzero((fix_s > begin_s + 1e-6) & (fix_s <= end_s + 1e-6))
    at_fix = np.searchsorted(log.time_s, fix_s[here] - 1e-6)
    ends = np.unique(np.concatenate([at_row, at_fix]))
    fix = np.full(ends.size, -1)
    fix[np.searchsorted(ends, at_fix)] = here  # of several in one row, the last
    starts = np.concatenate([[before], ends[:-1] + 1])
    edges = ends + 1 if before == 0 else np.concatenate([[before], ends + 1])
    C_bb, dv, way = joined(log.between(-np.inf, float(log.time_s[ends[-1]])), edges)
    own = slice(int(before > 0), None)
    inside = slice(None, int(ends[-1]) + 1)
    return _Increments(
        end_s=log.time_s[ends],
        closes=np.isin(ends, at_row),
        fix=fix,
        dt_s=np.add.reduceat(log.dt_s[inside], starts),
        C_bb=C_bb[own],
        dv_b_m_s=dv[own],
        way_b_m=way[own],
        angle_b_rad=np.add.reduceat(log.dtheta_rad[inside], starts, axis=0),
    )


def _joined(parts: list[Columns]) -> Columns:
    """Records of columns, one after the other."""

    def column(name: str) -> Any:
        of_parts = [getattr(part, name) for part in parts]
        return _joined(of_parts) if isinstance(of_parts[0], Epoch) else np.concatenate(of_parts)

    return type(parts[0])(*(column(field.name) for field in fields(parts[0])))
