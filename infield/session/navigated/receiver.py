"""How far a receiver's fixes stray together: slow errors of its positions and velocities, by what
it says while the vehicle stands.

A fix's error is white noise of the declared sigma plus a first-order Gauss-Markov process of known
time constant (`FlightPriors`) whose level is sought. A standing vehicle's place is one unknown
point and its velocity zero, so that means over blocks of fixes are jointly normal and every level
has a likelihood in closed form (Rasmussen and Williams 2006, Gaussian Processes, eq. 2.30, with a
flat prior on the place: eq. 2.45). The likeliest level is taken where all of them, equally probable
beforehand, are SURE_NATS likelier than white noise; none where the assumed level is as much less
likely than white noise; else, the fixes being too few to tell, the assumed one.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from alignment.motion.kinds import ROLLING
from alignment.navigation_filter import StepViews
from infield.session.estimate import Found
from infield.session.reasons import Nuisance
from infield.session.settings import FlightPriors
from ins.earth import displacement_ned
from ins.estimation.choice import SURE_NATS
from ins.estimation.error_filter import GATE_SIGMA
from ins.estimation.measurements import fix
from ins.estimation.measurements.antenna import Antenna, AntennaMotion, RowSums, motion_at
from ins.estimation.tape import Tape
from ins.records import GnssLog, NavHistory


@dataclass(frozen=True)
class Sigmas:
    """Declared noise of a receiver, one component [m], [m/s]."""

    horizontal_m: float
    velocity_m_s: float


@dataclass(frozen=True, kw_only=True)
class FixAid:
    """The fixes of a log against a solution.

    rows: of the solution's log; names: of the kinds of measurement, positions and velocities;
    of_each_step: how many fixes at most a rolling step takes, its last ones; any other takes one.
    """

    log: GnssLog
    sigmas: Sigmas
    antenna: Antenna
    states: fix.ReceiverStates
    history: NavHistory
    rows: RowSums
    names: tuple[str, str]
    of_each_step: int = 1

    def measure(self, tape: Tape, views: StepViews) -> None:
        """Lay down the fixes of each step."""
        for back in range(self.of_each_step, 0, -1):
            self._positions(tape, views, *self._fixes(views, back, self.antenna.delay_s))
            delay_s = self.antenna.velocity_delay_s
            self._velocities(tape, views, *self._fixes(views, back, delay_s))

    def _fixes(self, views: StepViews, back: int, delay_s: float) -> tuple[NDArray, NDArray]:
        """Steps (m,), and their fix that is the last but `back` - 1."""
        measured_s = self.log.time_s - delay_s
        before = np.searchsorted(measured_s, views.start_s + 1e-6, side="right")
        fixes = np.searchsorted(measured_s, views.end_s + 1e-6) - back
        takes = (views.kind == ROLLING) | (back == 1)
        at = np.flatnonzero((fixes >= before) & takes)
        return at, fixes[at]

    @cached_property
    def _motions(self) -> tuple[AntennaMotion, AntennaMotion]:
        """When each position and each velocity of the log was measured."""
        delays = self.antenna.delay_s, self.antenna.velocity_delay_s
        time_s = np.concatenate([self.log.time_s - delay for delay in delays])
        every = motion_at(self.history, self.rows, self.antenna.arm_m, time_s)
        count = self.log.time_s.size
        return every.at(slice(count)), every.at(slice(count, None))

    def _positions(self, tape: Tape, views: StepViews, at: NDArray, k: NDArray) -> None:
        log, motion = self.log, self._motions[0].at(k)
        places = log.lat_rad[k], log.lon_rad[k], log.height_m[k]
        z, rows = fix.position(motion, self.antenna, places, self.states)
        variance = sigma_of_fixes(log.sigma_horizontal_m, k, self.sigmas.horizontal_m) ** 2
        tape.measure(self.names[0], at, z, rows, [variance, variance], gate=GATE_SIGMA)

    def _velocities(self, tape: Tape, views: StepViews, at: NDArray, k: NDArray) -> None:
        log, motion = self.log, self._motions[1].at(k)
        rolls = (views.kind[at] == ROLLING)[:, None]
        about = np.where(rolls, motion.v_n + motion.swing_n(self.antenna.arm_m), 0.0)
        z, rows = fix.velocity(motion, self.antenna, log.v_n_m_s[k], self.states, about_n=about)
        variance = sigma_of_fixes(log.sigma_velocity_m_s, k, self.sigmas.velocity_m_s) ** 2
        tape.measure(self.names[1], at, z, rows, [variance, variance], gate=GATE_SIGMA)


FIXES_MEAN_S = 10.0  # a sixth of the shorter time constant
# of parked time, the last: 360 blocks, whose matrices take milliseconds
HEARD_S = 3600.0
# sigmas of positions [m]: centimetres of a fixed carrier phase to a code receiver among buildings;
# of velocities [m/s]: a tenth of a Doppler's 0.03 m/s to three times that
POSITION_LEVELS_M = (0.03, 0.06, 0.12, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.5, 6.0)
VELOCITY_LEVELS_M_S = (0.002, 0.003, 0.005, 0.007, 0.01, 0.015, 0.02, 0.03, 0.05, 0.1)
OF_RECEIVER = frozenset([Nuisance.GNSS_SLOW_POSITION, Nuisance.GNSS_SLOW_VELOCITY])


@dataclass(frozen=True)
class SlowError:
    """RMS of a slow error, its time constant [s], and the log of its odds against white noise.

    sigma is 0 where the fixes show none.
    """

    sigma: float
    time_s: float
    gain_nats: float


@dataclass(frozen=True)
class ReceiverErrors:
    """Slow errors of a receiver's positions [m] and velocities [m/s], each level component."""

    position: SlowError
    velocity: SlowError

    @property
    def found(self) -> tuple[Found, ...]:
        """The same as nuisances of the session."""
        kinds = {
            Nuisance.GNSS_SLOW_POSITION: self.position,
            Nuisance.GNSS_SLOW_VELOCITY: self.velocity,
        }
        return tuple(
            Found(nuisance, np.array([slow.sigma]), None, np.array([slow.sigma]), slow.gain_nats)
            for nuisance, slow in kinds.items()
            if slow.sigma > 0.0
        )

    @property
    def priors(self) -> dict[str, float]:
        """Prior sigmas of the filter's states, by their names."""
        return {"GNSS_SLOW_POS": self.position.sigma, "GNSS_SLOW_VEL": self.velocity.sigma}


WHITE = ReceiverErrors(SlowError(0.0, 1.0, 0.0), SlowError(0.0, 1.0, 0.0))


@dataclass(frozen=True)
class _Blocks:
    """Means (n, 2) of fixes of a component over blocks, when, and the variance of their white noise
    (n,).
    """

    time_s: NDArray
    mean: NDArray
    white: NDArray


def receiver_errors(
    log: GnssLog, stood: tuple[float, float], sigmas: tuple[float, float], priors: FlightPriors
) -> ReceiverErrors:
    """The slow errors of a receiver.

    Parameters
    ----------
    log : GnssLog
    stood : (float, float)
        Within which time [s] the vehicle stood.
    sigmas : (float, float)
        Noise of positions [m] and velocities [m/s] where the log declares none.
    priors : FlightPriors
        The assumed levels, and the time constants.

    Returns
    -------
    errors : ReceiverErrors
    """
    heard = _heard(log, stood)
    white_m = sigma_of_fixes(log.sigma_horizontal_m, heard, sigmas[0])
    white_m_s = sigma_of_fixes(log.sigma_velocity_m_s, heard, sigmas[1])
    places, velocities = np.empty((0, 2)), log.v_n_m_s[heard, :2]
    if heard.size:
        first = heard[0]
        places = displacement_ned(
            log.lat_rad[heard],
            log.lon_rad[heard],
            lat0_rad=log.lat_rad[first],
            lon0_rad=log.lon_rad[first],
            height0_m=log.height_m[first],
        )
    time_s = log.time_s[heard]
    return ReceiverErrors(
        _slow(
            _blocks(time_s, places, white_m),
            (*POSITION_LEVELS_M, priors.slow_position_m),
            priors.slow_position_s,
            about=True,
        ),
        _slow(
            _blocks(time_s, velocities, white_m_s),
            (*VELOCITY_LEVELS_M_S, priors.slow_velocity_m_s),
            priors.slow_velocity_s,
            about=False,
        ),
    )


def _heard(log: GnssLog, stood: tuple[float, float]) -> NDArray:
    """Fixes (n,) of the standing vehicle that are whole and no repetition of the one before."""
    inside = (log.time_s >= max(stood[0], stood[1] - HEARD_S)) & (log.time_s <= stood[1])
    inside &= np.isfinite(log.lat_rad) & np.isfinite(log.lon_rad) & np.isfinite(log.height_m)
    inside &= np.isfinite(log.v_n_m_s[:, :2]).all(axis=1)
    same = np.zeros(log.time_s.size, dtype=bool)
    same[1:] = (np.diff(log.lat_rad) == 0.0) & (np.diff(log.lon_rad) == 0.0)
    return np.flatnonzero(inside & ~same)


def sigma_of_fixes(logged: NDArray | None, fixes: NDArray, declared: float) -> NDArray:
    """Sigma (m,) of fixes by their rows, as logged, else as declared: all of it taken for their
    own, beside a slow error that is a state. What a receiver declares of its whole error is safe.
    """
    if logged is None:
        return np.full(fixes.size, declared)
    told = logged[fixes]
    return np.where(np.isfinite(told) & (told > 0), told, declared)


def _blocks(time_s: NDArray, values: NDArray, sigma: NDArray) -> _Blocks:
    """Means over FIXES_MEAN_S."""
    _, number = np.unique(np.floor(time_s / FIXES_MEAN_S), return_inverse=True)
    count = np.bincount(number)
    mean = np.column_stack([np.bincount(number, weights=column) / count for column in values.T])
    when = np.bincount(number, weights=time_s) / count
    return _Blocks(when, mean, np.bincount(number, weights=sigma**2) / count**2)


def _slow(blocks: _Blocks, levels: tuple[float, ...], time_s: float, *, about: bool) -> SlowError:
    """The level of a slow error, the last of `levels` being assumed; about: an unknown constant."""
    assumed = levels[-1]
    if assumed <= 0.0:
        return SlowError(0.0, time_s, 0.0)
    if blocks.time_s.size < 2:
        return SlowError(assumed, time_s, 0.0)
    apart = np.exp(-np.abs(blocks.time_s[:, None] - blocks.time_s) / time_s)
    white = _log_likelihood(blocks, apart, 0.0, about=about)
    gains = {level: _log_likelihood(blocks, apart, level, about=about) - white for level in levels}
    likeliest = max(gains, key=lambda level: gains[level])
    odds = float(logsumexp(list(gains.values())) - np.log(len(gains)))
    if odds >= SURE_NATS:
        return SlowError(likeliest, time_s, odds)
    if gains[assumed] <= -SURE_NATS:
        return SlowError(0.0, time_s, 0.0)
    return SlowError(assumed, time_s, gains[assumed])


def _log_likelihood(blocks: _Blocks, apart: NDArray, level: float, *, about: bool) -> float:
    """Of both components, but for a constant that all levels share."""
    factor = cho_factor(level**2 * apart + np.diag(blocks.white), lower=True)
    one = np.ones(blocks.time_s.size)
    solved, of_one = cho_solve(factor, blocks.mean), cho_solve(factor, one)
    square = float(np.sum(blocks.mean * solved))
    log_det = 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
    if about:
        information = float(one @ of_one)
        square -= float(np.sum((of_one @ blocks.mean) ** 2)) / information
        log_det += float(np.log(information))
    return -0.5 * square - log_det  # log_det of two components
