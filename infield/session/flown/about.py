"""A filter of the errors of a solution that it keeps correcting, the biases of a session's bins
among its states: for units whose own solution does not stand free for a flight (MEMS).

The aided solution (`infield.aided`) says where a stretch begins, and where gravity and Coriolis are
looked up; from there on the increments are integrated anew, and each second what the filter found
of position, velocity and attitude is taken off. So no bias of the aided filter is used, and nothing
that its start was found with counts twice. Errors, computed - true, resolved north, east, down::

    p' = v
    v' = theta x f + C del
    theta' = -(omega_ie + omega_en) x theta + C eps
    eps = b(bin) + flicker + shift + force f + scale omega + misalignment of omega
    del = bias + scale f + slope (T - T at the start)

Position, velocity and attitude begin anew after each rest, known to BEGIN_*. Source: Groves (2013),
section 14.2.4, with the signs of CONVENTIONS.md; bins as `infield.session.bins`.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from infield.session.flown.fixes import OF_POSITION, OF_VELOCITY
from infield.session.flown.gates import FlightEnd
from infield.session.flown.priors import Further, Layout
from infield.session.flown.steps import Steady, Steps
from ins.attitude import cross, dcm_from_rotation_vector, skew
from ins.estimation.error_filter import Tally
from ins.filters.aided_filter import REJECT_PROBABILITY
from ins.filters.aided_records import AidedNoise, Antenna
from ins.filters.states import READ_AXIS, READING_GYRO
from ins.robust import chi2
from ins.units import DEG, STANDARD_GRAVITY

PLACE_ERROR, SPEED_ERROR, TILT_ERROR, ACCEL_ERROR = (
    slice(0, 3),
    slice(3, 6),
    slice(6, 9),
    slice(9, 12),
)
# of the receiver; of the positions of one type of fixes, and of the other
SLOW_POSITION, SLOW_OTHER, SLOW_VELOCITY = slice(12, 15), slice(15, 18), slice(18, 21)
OF_SPEED = list(range(SPEED_ERROR.start, SPEED_ERROR.stop))
# flicker of the gyros within a bin: Gauss-Markov processes of these shares of its length, a factor
# of FLICKER_STEP apart; slower flicker is what the bins tell, faster is below white noise
FLICKER_SHARES, FLICKER_STEP = np.array([0.0125, 0.05, 0.2]), 4.0
WANDER = slice(SLOW_VELOCITY.stop, SLOW_VELOCITY.stop + 3 * FLICKER_SHARES.size)
FADING = slice(SLOW_POSITION.start, WANDER.stop)  # states that come and go
MOVING_ERRORS, FIRST_FURTHER = (
    9,
    WANDER.stop,
)  # states that move; where the constants of a flight begin
# of position, velocity, tilt and heading where a stretch begins: beyond what a solution may be off
BEGIN_M, BEGIN_SPEED_M_S, BEGIN_TILT_RAD, BEGIN_HEADING_RAD = 30.0, 5.0, 5.0 * DEG, 20.0 * DEG
LEVEL_AND_DOWN = 3  # of every measurement: north, east, down
LEVEL_AND_DOWN_AT = np.diag_indices(LEVEL_AND_DOWN)
UNIT_MATRIX = np.eye(3)
# of what the turning arm adds to the velocity of the antenna: the rate within a second is not
# its mean
SWING_SHARE = 0.1
STAND, STAND_M_S = "stand", 0.01  # of a standing vehicle, as infield.aided.flight
REST_B = np.array([0.0, 0.0, -STANDARD_GRAVITY])  # specific force of a level rest
# a body turns where a gyro reads more than so many sigmas of its bias and noise: 6e-5 of noise do
TURNS_SIGMAS = 4.0
TILTED = slice(TILT_ERROR.start, ACCEL_ERROR.stop)  # what moves the specific force in NED
# rows of body axes that a gyro's six misalignments read: xy, xz, yx, yz, zx, zy
READS, OF = np.array(READING_GYRO), np.array(READ_AXIS)


@dataclass(frozen=True)
class Believed:
    """What the filter takes for known.

    noise: of the sensors and of the receiver's slow errors; antenna: about which lever arm and
    delays are estimated; layout: the constants of a flight, their places from FIRST_FURTHER on;
    mean (n,), covariance (n, n): of these, then of the bins [rad/s]; accel_m_s2: prior sigma of the
    accelerometers' biases; flicker_rad_s: bias instability of the gyros; bin_s: length of a bin.
    """

    noise: AidedNoise
    antenna: Antenna
    layout: Layout
    mean: NDArray
    covariance: NDArray
    accel_m_s2: float
    flicker_rad_s: float
    bin_s: float

    @property
    def wander_rad_s(self) -> float:
        """Sigma of each process that the flicker is made of: processes of time constants a factor r
        apart sum to sigma^2 / (f ln r), flicker is B^2 / (pi f), one-sided (IEEE Std 952, annex C).
        """
        return float(self.flicker_rad_s * np.sqrt(np.log(FLICKER_STEP) / np.pi))

    @property
    def first_bin(self) -> int:
        """Where the bins' biases begin."""
        return FIRST_FURTHER + self.layout.sigma.size

    @property
    def of_mean(self) -> float:
        """Variance of what these processes leave in the mean of a bin [(rad/s)^2]."""
        u = 1.0 / FLICKER_SHARES
        return float(self.wander_rad_s**2 * np.sum(2.0 * (u + np.expm1(-u)) / u**2))


@dataclass
class AboutFilter:
    """State x (n,), covariance P (n, n) and the tally of its measurements; gate: NIS of the three
    components of one, beyond which it is rejected.
    """

    x: NDArray
    P: NDArray
    gate: float
    tally: Tally = field(default_factory=Tally)
    normalised: dict[str, list[NDArray]] = field(default_factory=dict)

    def update(self, kind: str, at: tuple[float, NDArray], H: "Rows") -> None:
        """Use a measurement z (3,) of variance (3,)."""
        time_s, (z, variance) = at[0], at[1]
        columns, rows = H.states, H.columns
        PHt = self.P[:, columns] @ rows.T
        S = rows @ PHt[columns]
        S[LEVEL_AND_DOWN_AT] += variance
        y = z - rows @ self.x[columns]
        inverse = np.linalg.inv(S)
        nis = float(y @ inverse @ y)
        if nis > self.gate:
            self.tally.rejected.append((time_s, kind))
            return
        K = PHt @ inverse
        self.x += K @ y
        P = self.P - K @ PHt.T
        self.P = 0.5 * (P + P.T)
        self.tally.nis[kind] = self.tally.nis.get(kind, 0.0) + nis
        self.tally.dof[kind] = self.tally.dof.get(kind, 0) + y.size
        self.normalised.setdefault(kind, []).append(y / np.sqrt(S[LEVEL_AND_DOWN_AT]))

    def biases(self, believed: Believed) -> tuple[NDArray, NDArray]:
        """Mean and covariance of the bins' mean biases, flicker within them included [rad/s]."""
        of = slice(believed.first_bin, None)
        P = self.P[of, of]
        return self.x[of], P + believed.of_mean * np.eye(len(P))

    def end(self, found: NDArray) -> FlightEnd:
        """As the gates read it: the antenna's states about what was declared. found (5,): less
        declared.
        """
        self.tally.normalised = {kind: np.stack(rows) for kind, rows in self.normalised.items()}
        x = self.x.copy()
        x[FIRST_FURTHER : FIRST_FURTHER + found.size] -= found
        return FlightEnd(x, self.P, self.tally)


class Rows(NamedTuple):
    """Rows of a measurement: the states (m,) that it reads, and the column (3, m) of each."""

    states: list[int]
    columns: NDArray


class Course(NamedTuple):
    """Where a step ends, NED: way from the row before, velocity, acceleration over the step, as the
    unit alone has it; attitude.
    """

    way_m: NDArray
    v_n_m_s: NDArray
    gained_m_s2: NDArray
    C_nb: NDArray


def begun(believed: Believed) -> AboutFilter:
    """The filter before its first stretch."""
    n = FIRST_FURTHER + believed.mean.size
    x, P = np.zeros(n), np.zeros((n, n))
    x[FIRST_FURTHER:] = believed.mean
    P[FIRST_FURTHER:, FIRST_FURTHER:] = believed.covariance
    own = np.arange(believed.first_bin, n)
    P[own, own] -= believed.of_mean
    P[ACCEL_ERROR, ACCEL_ERROR] = believed.accel_m_s2**2 * np.eye(3)
    return AboutFilter(x, P, gate=float(chi2.isf(REJECT_PROBABILITY, LEVEL_AND_DOWN)))


def over(flt: AboutFilter, steps: Steps, believed: Believed) -> None:
    """Take the filter over a stretch, in place."""
    _begin(flt, believed)
    C, v, way = steps.C_nb[0], steps.v_n_m_s[0], np.zeros(3)
    reading = Reading(believed)
    for k in range(steps.dt_s.size):
        dt, turn, at = steps.dt_s[k], steps.turn_n_rad[k], int(steps.row[k])
        pushed = C @ steps.dv_b_m_s[k]
        before = v
        v = v + pushed - 0.5 * cross(turn, pushed) + steps.pull_m_s2[at] * dt
        lagging = C @ (steps.way_b_m[k] - 0.5 * dt * steps.dv_b_m_s[k])
        way = way + 0.5 * (v + before) * dt + lagging
        _predict(flt, steps, k, reading.of(flt, steps, k, C), reading)
        C = (UNIT_MATRIX - skew(turn)) @ C @ steps.C_bb[k]
        if steps.fix[k] >= 0:
            _take_fix(flt, steps, k, Course(way, v, (v - before) / dt, C), believed)
        if not steps.closes[k]:
            continue
        if steps.stands[at + 1]:
            z = np.stack([v, np.full(3, STAND_M_S**2)])
            flt.update(STAND, (float(steps.time_s[at + 1]), z), Rows(OF_SPEED, UNIT_MATRIX))
        way = way - flt.x[PLACE_ERROR] - steps.way_m[at]
        v = v - flt.x[SPEED_ERROR]
        C = dcm_from_rotation_vector(-flt.x[TILT_ERROR]) @ C
        flt.x[:MOVING_ERRORS] = 0.0


class Read(NamedTuple):
    """A step as the covariance moves with it, its noise taken off: the mean of C_nb over it,
    specific force NED and body (3,) [m/s^2], rate in body axes (3,) [rad/s].
    """

    C_nb: NDArray
    force_n_m_s2: NDArray
    force_b_m_s2: NDArray
    rate_b_rad_s: NDArray


@dataclass
class Reading:
    """What the sensors of a stretch read but for their noise."""

    believed: Believed
    force_n: Steady = field(default_factory=Steady)
    force_b: Steady = field(default_factory=Steady)

    @cached_property
    def fading(self) -> tuple[NDArray, NDArray]:
        return _fading(self.believed)

    def of(self, flt: AboutFilter, steps: Steps, k: int, C: NDArray) -> Read:
        """Of the next step; C: its attitude."""
        dt, force_b = float(steps.dt_s[k]), steps.force_b_m_s2[k]
        force_n = C @ force_b
        moves = np.concatenate([-skew(force_n), C], axis=1)
        unsure = (moves @ flt.P[TILTED, TILTED] @ moves.T).diagonal()
        white = self.believed.noise.vrw**2 / dt
        # of a car that turns by 20 deg in a step the sensors' axes at its start are 10 deg off
        turned = skew(steps.angle_b_rad[k])
        return Read(
            C @ (UNIT_MATRIX + 0.5 * turned + turned @ turned / 6.0),
            self.force_n.of(force_n, white, unsure),
            self.force_b.of(force_b, white),
            self._turns(flt, steps, k),
        )

    def _turns(self, flt: AboutFilter, steps: Steps, k: int) -> NDArray:
        """Rate of the body, no rate where bias and noise alone may read as much.

        A gyro's noise turns the attitude once for each unit of it, as a scale error of 1 would:
        on straight flights a scale is found that is as much of 1 as the noise tells of it. No mean
        helps, for means of noise sum up to as much.
        """
        rate = steps.angle_b_rad[k] / steps.dt_s[k]
        first = self.believed.first_bin + 3 * int(steps.bin[k])
        bias = slice(first, first + 3)
        variance = flt.P.diagonal()[bias] + self.believed.wander_rad_s**2 * FLICKER_SHARES.size
        variance = variance + self.believed.noise.arw**2 / steps.dt_s[k]
        turns = np.abs(rate - flt.x[bias]) > TURNS_SIGMAS * np.sqrt(variance)
        return np.asarray(np.where(turns, rate, 0.0))


def _begin(flt: AboutFilter, believed: Believed) -> None:
    """Motion and slow errors as where a stretch begins."""
    _, fading = _fading(believed)
    tilt = [*[BEGIN_TILT_RAD] * 2, BEGIN_HEADING_RAD]
    fresh = np.array([*[BEGIN_M] * 3, *[BEGIN_SPEED_M_S] * 3, *tilt, *fading])
    states = np.r_[0:MOVING_ERRORS, FADING]
    flt.x[states] = 0.0
    flt.P[states, :] = 0.0
    flt.P[:, states] = 0.0
    flt.P[states, states] = fresh**2


def _gyro_columns(
    steps: Steps, k: int, read: Read, believed: Believed
) -> tuple[list[int], NDArray]:
    """States that gyros read, and what each turns the attitude by over a step (3, m) per unit."""
    dt, C, force = steps.dt_s[k], read.C_nb, read.force_b_m_s2
    angle = read.rate_b_rad_s * dt
    first = believed.first_bin + 3 * int(steps.bin[k])
    states: list[int] = [first, first + 1, first + 2, *range(WANDER.start, WANDER.stop)]
    columns = [C * dt] * (1 + FLICKER_SHARES.size)
    flies = float(steps.flies[k])
    for state, of in (
        (Further.SHIFT, flies * dt * C),
        (Further.FORCE, dt * C * (force - REST_B)),
        (Further.GYRO_SCALE, C * angle),
        (Further.MISALIGNMENT, C[:, READS] * angle[OF]),
    ):
        places = list(believed.layout.indices(state))
        if places:
            states += places
            columns.append(of)
    return states, np.concatenate(columns, axis=1)


def _accel_columns(steps: Steps, k: int, read: Read, layout: Layout) -> tuple[list[int], NDArray]:
    """States that accelerometers read, and what each adds to the velocity over a step (3, m)."""
    dt, C = steps.dt_s[k], read.C_nb
    states, columns = list(range(ACCEL_ERROR.start, ACCEL_ERROR.stop)), [C * dt]
    for state, of in (
        (Further.ACCEL_SCALE, C * (read.force_b_m_s2 * dt)),
        (Further.ACCEL_SLOPE, C * (steps.warmer_degC[k] * dt)),
    ):
        places = list(layout.indices(state))
        if places:
            states += places
            columns.append(of)
    return states, np.concatenate(columns, axis=1)


def _predict(flt: AboutFilter, steps: Steps, k: int, read: Read, reading: Reading) -> None:
    """Over step k."""
    believed, fading = reading.believed, reading.fading
    dt, noise = float(steps.dt_s[k]), believed.noise
    gyro, turned = _gyro_columns(steps, k, read, believed)
    accel, gained = _accel_columns(steps, k, read, believed.layout)
    states = [*range(MOVING_ERRORS), *accel, *gyro]
    of_accel = slice(MOVING_ERRORS, MOVING_ERRORS + len(accel))
    of_gyro = slice(of_accel.stop, len(states))
    Phi = np.eye(MOVING_ERRORS, len(states))
    Phi[PLACE_ERROR, SPEED_ERROR] = dt * UNIT_MATRIX
    tilted = -skew(read.force_n_m_s2 * dt)
    Phi[SPEED_ERROR, TILT_ERROR], Phi[PLACE_ERROR, TILT_ERROR] = tilted, 0.5 * dt * tilted
    Phi[TILT_ERROR, TILT_ERROR] -= skew(steps.turn_n_rad[k])
    Phi[SPEED_ERROR, of_accel], Phi[PLACE_ERROR, of_accel] = gained, 0.5 * dt * gained
    Phi[TILT_ERROR, of_gyro] = turned
    Phi[SPEED_ERROR, of_gyro] = 0.5 * tilted @ turned
    Phi[PLACE_ERROR, of_gyro] = dt / 6.0 * tilted @ turned
    moved = Phi @ flt.P[states]
    flt.x[:MOVING_ERRORS] = Phi @ flt.x[states]
    flt.P[:MOVING_ERRORS] = moved
    flt.P[:, :MOVING_ERRORS] = moved.T
    flt.P[:MOVING_ERRORS, :MOVING_ERRORS] = moved[:, states] @ Phi.T
    seconds, sigma = fading
    fades = np.exp(-dt / seconds)
    flt.x[FADING] *= fades
    flt.P[FADING] *= fades[:, None]
    flt.P[:, FADING] *= fades
    own = np.arange(FADING.start, FADING.stop)
    flt.P[own, own] += np.square(sigma) * (1.0 - fades**2)
    own = np.arange(3)
    flt.P[own, own] += noise.vrw**2 * dt**3 / 3.0
    flt.P[own, own + 3] += noise.vrw**2 * dt**2 / 2.0
    flt.P[own + 3, own] += noise.vrw**2 * dt**2 / 2.0
    flt.P[own + 3, own + 3] += noise.vrw**2 * dt
    flt.P[own + 6, own + 6] += noise.arw**2 * dt
    flt.P[own + 9, own + 9] += noise.accel_walk**2 * dt


def _fading(believed: Believed) -> tuple[NDArray, NDArray]:
    """States that come and go: time constants and sigmas (18,)."""
    noise = believed.noise
    flicker_s = np.repeat(FLICKER_SHARES * believed.bin_s, 3)
    seconds = np.concatenate([[noise.slow_s] * 6, [noise.slow_velocity_s] * 3, flicker_s])
    sigmas = [
        *[noise.slow_level_m] * 2,
        noise.slow_down_m,
        *[noise.slow_other_level_m] * 2,
        noise.slow_other_down_m,
        *[noise.slow_velocity_m_s] * 3,
        *[believed.wander_rad_s] * flicker_s.size,
    ]
    return seconds, np.array(sigmas)


def _take_fix(flt: AboutFilter, steps: Steps, k: int, course: Course, believed: Believed) -> None:
    """Use the fix at the end of step k."""
    v, C, fix = course.v_n_m_s, course.C_nb, int(steps.fix[k])
    antenna, layout = believed.antenna, believed.layout
    arm = C @ antenna.lever_arm_m
    rate_b = steps.fix_rate_b_rad_s[fix]
    swing_b = cross(rate_b, antenna.lever_arm_m)
    swing = C @ swing_b
    late = float(steps.late_s[k])
    lever, delays = list(layout.indices(Further.ANTENNA)), list(layout.indices(Further.DELAY))
    time_s = float(steps.fix_time_s[fix])
    z = course.way_m + arm - (v + swing) * (late + antenna.delay_s) - steps.fix_way_m[fix]
    if np.isfinite(z).all():
        H = _rows(
            (PLACE_ERROR, UNIT_MATRIX),
            (TILT_ERROR, -skew(arm)),
            (SLOW_OTHER if steps.fix_of_other_type[fix] else SLOW_POSITION, UNIT_MATRIX),
            (lever, C),
            (delays[:1], -(v + swing)[:, None]),
        )
        flt.update(OF_POSITION, (time_s, np.stack([z, steps.fix_variance[fix, :3]])), H)
    z = v + swing - course.gained_m_s2 * (late + antenna.velocity_delay_s) - steps.fix_v_n_m_s[fix]
    if np.isfinite(z).all():
        H = _rows(
            (SPEED_ERROR, UNIT_MATRIX),
            (TILT_ERROR, -skew(swing)),
            (SLOW_VELOCITY, UNIT_MATRIX),
            (lever, C @ skew(rate_b)),
            (delays[1:], -course.gained_m_s2[:, None]),
        )
        variance = steps.fix_variance[fix, 3:] + (SWING_SHARE * swing) ** 2
        flt.update(OF_VELOCITY, (time_s, np.stack([z, variance])), H)


def _rows(*blocks: tuple[slice | list[int], NDArray]) -> Rows:
    """Rows of a measurement from blocks of states and their columns (3, m)."""
    states: list[int] = []
    columns = []
    for where, of in blocks:
        places = where if isinstance(where, list) else range(where.start, where.stop)
        if places:
            states += places
            columns.append(of)
    return Rows(states, np.concatenate(columns, axis=1))
