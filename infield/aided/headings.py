"""A start where the heading is unknown: flights of a first stretch from headings all round the
compass, weighed by the likelihood of their innovations::

    level at the beginning of the fixes -> COARSE headings -> noise that the stretch needs
    -> weights -> FINE headings about the likeliest -> heading and its sigma

The heading is that of the beginning, seen through all that the vehicle does within the stretch: the
biases of the gyros are states of each flight, so a slow vehicle shows it too, given time. Stretches
grow until a heading is known and the next longer one says the same; where two headings explain
what was flown, or none better than any other, there is no start.

The likelihood is that of white innovations. Those of a real receiver are correlated, so logarithms
are divided by how much larger the scatter of sums of ten innovations is than white ones' would be,
and the heading is held for no better known than a flight from WIDEST_RAD knows it at any time.
The start's sigma is three of those found, since the filter sees the same fixes again: its own sigma
is then too small by 5 % (1 / sqrt(1 + 1/9)).

Decision: docs/decisions/0060-unknown-heading.md.
"""

from dataclasses import dataclass, field, replace
from functools import cache
from operator import sub

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from infield.aided.reasons import AidedReason, StartMethod
from infield.aided.start import (
    FIRST_WINDOW_S,
    FLOORS_RAD,
    FoundStart,
    RateBefore,
    Stretch,
    bias_before,
    last_fix,
    level_change,
    started,
)
from infield.aided.velocity_match import Pairs, pairs_of, whole_fixes
from ins.attitude import dcm_from_rotation_vector, wrap_pi
from ins.estimation.choice import Level, Sizes, climb
from ins.filters.aided_filter import AidedNavigator
from ins.filters.aided_records import USED, AidedHistory, AidedNoise, AidedOptions, Antenna, Fixes
from ins.filters.states import AIDED_THETA
from ins.records import ImuLog, ImuSource, TwinModel
from ins.units import DEG
from ins.verdicts import Reason, because

# of log that a start is sought on, one after the other [s]; the last is FIT_S of
# `infield.aided.flight`, the stretch that noise and antenna are fitted on
STRETCHES_S = (60.0, 180.0, 600.0, 1800.0)
COARSE, FINE = 24, 9  # headings all round, 15 deg apart; about the likeliest
FINE_RAD = 4.0 * DEG  # between two of the FINE: 9 of them reach 16 deg to either side
# of each flight's first heading, of the step between two: sums of Gaussians so far apart are flat
# to 1.5 %, so that no heading is preferred (2 exp(-2 pi^2 / 4))
WIDTH = 0.5
# heading known so well ends the search; three of it, 9 deg, are nearly linear (1 - cos is 1.2 %)
SURE_RAD = 3.0 * DEG
# and up to here there is a start: WIDEST_RAD then is 1.7 of it, and the filter's own sigma at first
# too small by 14 % (1 / sqrt(1 + 0.36))
UNSURE_RAD = 15.0 * DEG
UNKNOWN_RAD = np.pi / np.sqrt(3.0)  # sigma of a heading of which nothing is known
WIDEST_RAD = 25.0 * DEG  # sin is 3 % off there, 1 - cos is 9 %: the filter is linear to that
# odds of another heading, 30 deg or more away, up to which one is taken: 1 of 1 000
ELSEWHERE, ELSEWHERE_RAD = 1e-3, 30.0 * DEG
AGREES_SIGMAS = 3.0  # between two stretches; the shorter one is within the longer: 3 are many
# of change of velocity within the longest stretch that is worth a search: at 1 m/s a slow vehicle
# shows its heading in 3 min (tests/infield/test_aided_headings.py), noise of 0.1 m/s makes 0.4 m/s
LEAST_MOVED_M_S = 0.5
FIRST_SOUGHT_S = 120.0  # after the first fix, within which there are FIRST_WINDOW_S of whole fixes
DELAY_S = 0.3  # the fixes may be older than their time by, as in `infield.aided.antenna`
BLOCK = 10  # innovations that are summed to see whether they are white: 10 s
# how many times the declared noise a stretch may need: the sensors', to a quarter of the 1024 that
# `infield.aided.noise` tries; the receiver's, a default of 0.03 m/s for one of 1 m/s
NOISE_STEPS = {"sensors": (1.0, 4.0, 16.0, 64.0, 256.0), "receiver": (1.0, 3.0, 10.0, 30.0)}
FIRST_NOISE = {"sensors": 64.0, "receiver": 10.0}  # where every heading explains something
# m and m/s: sides of the cube that a wild position or velocity is in; chosen: 200 m are two blocks
# of a street, 20 m/s a car's speed
WILD = (200.0, 20.0)
LARGEST_WALK = 32.0  # `WIDE` of `infield.aided.antenna`
HEADING = AIDED_THETA.start + 2  # theta about down
NOISE_ROUNDS = 3  # of noise and headings in turn; the third has changed neither on any log here


@dataclass(frozen=True, kw_only=True)
class Sky:
    """What flights of a first stretch are flown with."""

    imu: ImuSource
    fixes: Fixes
    twin: TwinModel
    noise: AidedNoise
    options: AidedOptions
    gyro_sigma_deg_h: NDArray
    lever_arm_m: NDArray

    def with_antenna(self, fixes: Fixes, lever_arm_m: NDArray) -> "Sky":
        return replace(self, fixes=fixes, lever_arm_m=lever_arm_m)


@dataclass(frozen=True)
class Seen:
    """A heading as an angle from the match of the first window [rad], its sigma, and the
    probability that it is another.
    """

    turn_rad: float
    sigma_rad: float
    elsewhere: float

    @property
    def known(self) -> bool:
        return self.sigma_rad <= UNSURE_RAD and self.elsewhere <= ELSEWHERE

    def agrees(self, other: "Seen") -> bool:
        off = abs(float(wrap_pi(self.turn_rad - other.turn_rad)))
        return off <= AGREES_SIGMAS * float(np.hypot(self.sigma_rad, other.sigma_rad))


@dataclass(frozen=True)
class HeadingFound:
    """The attitude at the end of a log's first window, with the covariance (3, 3) of its NED error
    that a start takes; span: of log that showed the heading.
    """

    window: Where
    C_nb: NDArray
    rate_b: NDArray
    theta: NDArray
    span: Where
    gyro: RateBefore

    def start(self, sky: Sky) -> FoundStart | Reason:
        """The start with the fixes and the lever arm of another antenna."""
        log = sky.imu.between(*self.window)
        fix = last_fix(sky.fixes, log)
        if fix is None:
            return because(
                AidedReason.NO_VELOCITY_CHANGE,
                needed_m_s=LEAST_MOVED_M_S,
                longest_s=STRETCHES_S[-1],
            )
        ground = Stretch(
            log=log,
            fixes=sky.fixes,
            fix=fix,
            lever_arm_m=sky.lever_arm_m,
            gyro=self.gyro,
            twin=sky.twin,
        )
        found = started(ground, self.C_nb, self.rate_b, self.theta)
        return replace(found, method=StartMethod.HEADINGS, span=self.span)


@dataclass(frozen=True)
class HeadingOpen:
    """No heading is known, and why; turn_rad: of the likeliest, from the match; `bank` begins at
    any.
    """

    why: Reason
    turn_rad: float
    bank: "Bank"

    def starts(self, sky: Sky) -> list[FoundStart]:
        """A start at each of the COARSE headings."""
        bank = replace(self.bank, sky=sky)
        step = 2.0 * np.pi / COARSE
        return [bank.begun(k * step, WIDTH * step) for k in range(COARSE)]

    def likeliest(self, sky: Sky) -> FoundStart:
        """The start at the likeliest heading, as wide as is linear: what noise and antenna are
        found with.
        """
        found = replace(self.bank, sky=sky).begun(self.turn_rad, WIDEST_RAD)
        first, last = self.bank.ground.log.time_s[[0, -1]]
        return replace(
            found,
            method=StartMethod.ALL_HEADINGS,
            span=(float(first), float(last)),
            sigma_heading_rad=UNKNOWN_RAD,
        )


def find_heading(sky: Sky, stands: tuple[Where, ...]) -> HeadingFound | HeadingOpen | Reason:
    """The heading at the beginning of the fixes, or all of them; what is missing where there is
    nothing to begin on.
    """
    first = _first_window(sky, stands)
    end_s = min(STRETCHES_S[-1] + float(sky.fixes.time_s[0]), sky.imu.end_s)
    still = because(
        AidedReason.NO_VELOCITY_CHANGE, needed_m_s=LEAST_MOVED_M_S, longest_s=STRETCHES_S[-1]
    )
    if first is None or not fixes_move(sky.fixes):
        return still
    ground, pairs = first
    begin_s = float(ground.log.time_s[-1])
    bank = Bank(replace(sky, fixes=_thinned(sky.fixes)), ground, pairs)
    if level_change(sky.fixes, sky.imu.start_s, end_s) < LEAST_MOVED_M_S:
        seen = bank.look(sky.imu.between(begin_s - 2.0, begin_s + STRETCHES_S[0]))
        return HeadingOpen(still, seen.turn_rad, bank)
    held, taken = None, None
    for length_s in STRETCHES_S:
        log = sky.imu.between(begin_s - 2.0, begin_s + length_s)
        seen = bank.look(log)
        last = begin_s + length_s >= sky.imu.end_s
        tested = held is not None and held.known and held.agrees(seen)
        taken = seen if seen.known and (tested or last) else None
        held = seen
        if last or (taken is not None and taken.sigma_rad <= SURE_RAD):
            break
    if taken is None:
        assert held is not None
        if held.sigma_rad <= UNSURE_RAD:
            differ = because(AidedReason.HEADINGS_DIFFER, longest_s=STRETCHES_S[-1])
            return HeadingOpen(differ, held.turn_rad, bank)
        unsure = because(
            AidedReason.HEADING_UNSURE,
            best_rad=min(held.sigma_rad, np.pi),
            limit_rad=UNSURE_RAD,
            longest_s=STRETCHES_S[-1],
        )
        return HeadingOpen(unsure, held.turn_rad, bank)
    sigma = float(np.clip(3.0 * taken.sigma_rad, FLOORS_RAD[2], WIDEST_RAD))
    C_nb, theta = bank.attitude(taken.turn_rad, sigma)
    return HeadingFound(
        window=(float(ground.log.time_s[0]), begin_s),
        C_nb=C_nb,
        rate_b=pairs.rate_b,
        theta=theta,
        span=(float(ground.log.time_s[0]), float(log.time_s[-1])),
        gyro=ground.gyro,
    )


def fixes_move(fixes: Fixes) -> bool:
    """Whether the satellite velocities are ever more than noise; a parked log has no flight.

    Parameters
    ----------
    fixes : Fixes

    Returns
    -------
    moves : bool
        True where a level speed is by LEAST_MOVED_M_S beyond four sigmas.
    """
    speed = np.linalg.norm(fixes.v_n_m_s[:, :2], axis=1)
    seen = np.isfinite(speed)
    noise = 4.0 * float(np.median(fixes.sigma_velocity_m_s[seen, 0])) if seen.any() else 0.0
    return bool(seen.any() and float(speed[seen].max()) - noise > LEAST_MOVED_M_S)


def _thinned(fixes: Fixes) -> Fixes:
    """About one whole fix a second: the likelihood takes errors of neighbouring fixes for
    independent.
    """
    keep = whole_fixes(fixes, -np.inf, np.inf)
    return Fixes(**{name: column[keep] for name, column in vars(fixes).items()})


def _first_window(sky: Sky, stands: tuple[Where, ...]) -> tuple[Stretch, Pairs] | None:
    """The first FIRST_WINDOW_S of log with whole fixes."""
    first_s = max(sky.imu.start_s, float(sky.fixes.time_s[0]))
    for begin_s in np.arange(first_s, first_s + FIRST_SOUGHT_S, FIRST_WINDOW_S):
        end_s = float(begin_s) + FIRST_WINDOW_S
        if end_s > sky.imu.end_s:
            break
        log = sky.imu.between(float(begin_s), end_s)
        gyro = bias_before(sky.imu, stands, end_s, sky.twin, sky.gyro_sigma_deg_h)
        pairs = pairs_of(
            log, sky.fixes, lever_arm_m=sky.lever_arm_m, gyro_bias_rad_s=gyro.bias_rad_s
        )
        fix = last_fix(sky.fixes, log)
        if pairs is not None and fix is not None:
            ground = Stretch(
                log=log,
                fixes=sky.fixes,
                fix=fix,
                lever_arm_m=sky.lever_arm_m,
                gyro=gyro,
                twin=sky.twin,
            )
            return ground, pairs
    return None


@dataclass
class Bank:
    """Flights of longer and longer stretches from headings all round, with the noise that the last
    one needed.
    """

    sky: Sky
    ground: Stretch
    pairs: Pairs
    noise: Sizes = field(default_factory=FIRST_NOISE.copy)

    def attitude(self, turn_rad: float, sigma_rad: float) -> tuple[NDArray, NDArray]:
        """C_nb at the end of the first window, turned about the vertical from its match and
        levelled there, with the covariance of its error.
        """
        pairs = self.pairs
        turned = dcm_from_rotation_vector(np.array([0.0, 0.0, turn_rad])) @ pairs.attitude()
        C_nb = pairs.levelled(turned)
        left = pairs.residuals(C_nb)
        variance = max(float(np.mean(left**2)), pairs.variance)
        tilt = variance * np.linalg.inv(pairs.information(C_nb)[:2, :2])
        drift = (float(self.ground.gyro.sigma_rad_s.max()) * pairs.seconds) ** 2
        theta = np.diag([FLOORS_RAD[0] ** 2, FLOORS_RAD[1] ** 2, sigma_rad**2])
        theta[:2, :2] += 9.0 * (tilt + drift * np.eye(2))
        return C_nb @ pairs.C_b0b, theta

    def look(self, log: ImuLog) -> Seen:
        """What a stretch shows of the heading."""
        turns = np.arange(COARSE) * 2.0 * np.pi / COARSE
        logliks = self._logliks(log, turns)
        for _ in range(NOISE_ROUNDS):
            noise = self._noise(log, turns[int(np.argmax(logliks))])
            if noise == self.noise:
                break
            self.noise = noise
            logliks = self._logliks(log, turns)
        top = float(turns[int(np.argmax(logliks))])
        off = np.asarray(wrap_pi(turns - top))
        near = np.abs(off) < 0.5 * np.pi
        mean, sigma = _moments(off[near], logliks[near], turns[1])
        if sigma < 2.0 * FINE_RAD:
            steps = (np.arange(FINE) - FINE // 2) * FINE_RAD
            more, fine = _moments(steps, self._logliks(log, top + mean + steps), FINE_RAD)
            mean, sigma = mean + more, fine
        rival = _rival(turns - top - mean, logliks)
        flight = self._fly(log, top + mean, WIDEST_RAD)
        sigma = max(sigma, float(np.sqrt(flight.variance[:, HEADING].min())))
        colour = colour_of(flight)
        return Seen(
            turn_rad=float(wrap_pi(top + mean)),
            sigma_rad=float(np.sqrt(colour)) * sigma,
            elsewhere=float(np.exp((rival - logliks.max()) / colour)),
        )

    def _noise(self, log: ImuLog, turn_rad: float) -> Sizes:
        """The likeliest noise at a heading, from the present one up and down."""

        @cache
        def loglik(**noise: float) -> float:
            return _loglik(self._fly(log, turn_rad, WIDTH * 2.0 * np.pi / COARSE, noise))

        levels = [Level(name, grid, self.noise[name]) for name, grid in NOISE_STEPS.items()]
        return climb(loglik(**self.noise), levels, lambda sizes, _: loglik(**sizes), sub)[1]

    def _logliks(self, log: ImuLog, turns: NDArray) -> NDArray:
        width = WIDTH * float(turns[1] - turns[0])
        return np.array([_loglik(self._fly(log, float(turn), width)) for turn in turns])

    def begun(self, turn_rad: float, sigma_rad: float) -> FoundStart:
        """The start at a heading."""
        C_nb, theta = self.attitude(turn_rad, sigma_rad)
        return started(self.ground, C_nb, self.pairs.rate_b, theta)

    def _fly(
        self, log: ImuLog, turn_rad: float, sigma_rad: float, noise: Sizes | None = None
    ) -> AidedHistory:
        """A stretch from a heading."""
        sky = self.sky
        found = self.begun(turn_rad, sigma_rad)
        times = noise or self.noise
        sensors, receiver = times["sensors"], times["receiver"]
        walk = min(sensors, LARGEST_WALK)
        louder = replace(
            sky.noise,
            arw=sensors * sky.noise.arw,
            vrw=sensors * sky.noise.vrw,
            gyro_walk=walk * sky.noise.gyro_walk,
            accel_walk=walk * sky.noise.accel_walk,
        )
        late = np.diag([0.0, 0.0, 0.0, DELAY_S, DELAY_S]) ** 2
        navigator = AidedNavigator(
            found.start,
            louder,
            sky.fixes.scaled(receiver, receiver),
            antenna=Antenna(lever_arm_m=sky.lever_arm_m, covariance=late, estimated=True),
            options=sky.options,
        )
        navigator.feed(log)
        return navigator.finish()


def _loglik(history: AidedHistory) -> float:
    """Log likelihood of a flight."""
    return float(fix_logliks(history).sum())


def fix_logliks(history: AidedHistory) -> NDArray:
    """Log likelihood (n,) of each fix; one that the flight could not use is a wild one, as likely
    anywhere within WILD.
    """
    seen = np.isfinite(history.loglik)
    fits = seen & (history.used == USED)
    wild = (seen & ~fits) * -np.log(np.array(WILD) ** 3 / (2.0 * np.pi) ** 1.5)
    return np.asarray((np.where(fits, history.loglik, 0.0) + wild).sum(axis=1))


def _moments(off_rad: NDArray, logliks: NDArray, step_rad: float) -> tuple[float, float]:
    """Mean and sigma of a heading from flights a step apart, less the width of each."""
    weights = np.exp(logliks - logliks.max())
    weights /= weights.sum()
    mean = float(weights @ off_rad)
    width = WIDTH * step_rad
    variance = float(weights @ (off_rad - mean) ** 2) - width**2
    return mean, float(np.sqrt(max(variance, (0.2 * width) ** 2)))


def _rival(off_rad: NDArray, logliks: NDArray) -> float:
    """Log likelihood of the likeliest heading elsewhere that is likelier than both beside it."""
    peak = (logliks >= np.roll(logliks, 1)) & (logliks >= np.roll(logliks, -1))
    peak &= np.abs(wrap_pi(off_rad)) > ELSEWHERE_RAD
    return float(logliks[peak].max()) if peak.any() else -np.inf


def colour_of(history: AidedHistory) -> float:
    """How much larger the variance of sums of BLOCK innovations is than that of white ones, at
    least 1.
    """
    u = history.residual / history.sigma
    u = u[np.isfinite(u).all(axis=1)]
    blocks = u[: len(u) // BLOCK * BLOCK].reshape(-1, BLOCK, u.shape[1]).sum(axis=1)
    return max(float(np.mean(blocks**2)) / BLOCK, 1.0) if len(blocks) else 1.0
