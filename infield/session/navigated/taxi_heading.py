"""What a rolling vehicle shows of heading and gyro bias: aids for the navigation-mode filter.

Without an outside reference the body-lateral velocity of a straight taxi does not show a heading
error: the filter's velocity error w is taken against the true velocity in the computed frame, and
the lateral row has no heading in it (physics.md 6.5). Heading becomes visible after a turn, at a
stop on another heading, or against GNSS, a surveyed heading or a centre line. Cross-track position
enters as the displacement over each step (US 5,574,650).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.kinds import ROLLING
from alignment.navigation_filter import StepViews
from infield.session.navigated.nuisances import AS_DECLARED, CRAB_TURN_RAD, GUST_TIME_S, Assumed
from infield.session.navigated.receiver import WHITE, FixAid, ReceiverErrors, Sigmas
from infield.session.reasons import HeadingSource, Nuisance
from ins.attitude import wrap_pi
from ins.errors.catalogue import prior
from ins.estimation import error_model as em
from ins.estimation.error_filter import GATE_SIGMA
from ins.estimation.measurements import survey
from ins.estimation.measurements.antenna import Antenna, RowSums
from ins.estimation.measurements.fix import ReceiverStates
from ins.estimation.measurements.wheels import forward, lateral
from ins.estimation.tape import Tape
from ins.records import GnssLog, OdometerLog
from ins.units import DEG

OF_FIXES = "gnss"  # kind of measurement
LATERAL_FLOOR_M = 5e-4  # displacement noise of a step beyond crab, lever arm and lateral motion
# per square root of a second about the painted line, beyond side motion
CENTRE_LINE_WANDER_M = prior("centre_line_wander", "taxi").size
# chosen: a vehicle on its line is within 5 deg of it, taxiways that leave it are not
CENTRE_LINE_NEAR_RAD = 5 * DEG
CENTRE_LINE_TURN_RAD_S = 0.01  # chosen: on a line; 0.6 deg/s, a circle of 1 km at 10 m/s


@dataclass
class LateralAid:
    """No side slip at the wheels: the lateral displacement is crab, lever arm and a bounded
    transient, and what else of wind and tyres is assumed possible.

    wheel_reference_m: from the IMU to the no-slip point, body axes.
    """

    wheel_reference_m: tuple[float, float, float]
    assumed: Assumed = AS_DECLARED

    def measure(self, tape: Tape, views: StepViews) -> None:
        at = np.flatnonzero(views.kind == ROLLING)
        self._wander(tape, views, at)
        way = views.way_of(self.wheel_reference_m, at)
        tape.measure("lateral", at, *lateral(way, _way_variance(views)), gate=GATE_SIGMA)

    def _wander(self, tape: Tape, views: StepViews, at: NDArray) -> None:
        """Crabs that change with heading or with time: first-order Gauss-Markov processes."""
        turned = np.cumsum(np.abs(views.heading_change_rad))[at]
        since = {
            Nuisance.TURNING_CRAB: (
                em.CRAB_TURN,
                turned / CRAB_TURN_RAD,
                self.assumed.turning_crab_rad,
            ),
            Nuisance.GUSTS: (
                em.CRAB_GUST,
                views.end_s[at] / GUST_TIME_S,
                self.assumed.gust_crab_rad,
            ),
        }
        for nuisance, (state, lengths, sigma) in since.items():
            if nuisance in self.assumed.free:
                kept = np.exp(-np.diff(lengths, prepend=lengths[:1]))
                tape.assign(at, state, {state: kept}, sigma**2 * (1.0 - kept**2))


@dataclass
class OdometerAid:
    """Way along body x by the wheels, with a scale error as a state."""

    log: OdometerLog
    noise_m_s: float
    wheel_reference_m: tuple[float, float, float]

    def measure(self, tape: Tape, views: StepViews) -> None:
        t = self.log.time_s
        # those stamped after a step's start, up to its end: each is of one step
        first, last = (
            np.searchsorted(t, edge, side="right") for edge in (views.start_s, views.end_s)
        )
        samples = last - first
        logged = (views.start_s >= t[0]) & (views.end_s <= t[-1]) & (samples > 0)
        at = np.flatnonzero((views.kind == ROLLING) & logged)
        rolled = self._way(views.end_s[at]) - self._way(views.start_s[at])
        of_times = np.interp([views.start_s[at], views.end_s[at]], t, self.log.speed_m_s)
        wheels = self.noise_m_s * views.dt_s[at] / np.sqrt(samples[at])
        way = views.way_of(self.wheel_reference_m, at)
        variance = wheels**2 + _way_variance(views)
        measured = forward(way, rolled, of_times[1] - of_times[0], variance)
        tape.measure("odometer", at, *measured, gate=GATE_SIGMA)

    def _way(self, time_s: NDArray) -> NDArray:
        """Integral of the speed, straight between samples, from the first sample to given times
        [m].
        """
        t, v = self.log.time_s, self.log.speed_m_s
        whole = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
        k = np.clip(np.searchsorted(t, time_s, side="right") - 1, 0, len(t) - 2)
        into = time_s - t[k]
        return whole[k] + into * (v[k] + 0.5 * into * (v[k + 1] - v[k]) / (t[k + 1] - t[k]))


@dataclass
class GnssAid:
    """Satellite position and velocity; while parked one fix a step is used.

    rows: of the log that is navigated. Arm and delays are taken as found so far (`assumed`), and
    their states are about the declared ones.
    """

    log: GnssLog
    rows: RowSums
    lever_arm_m: tuple[float, float, float]
    sigma_horizontal_m: float
    sigma_velocity_m_s: float
    assumed: Assumed = AS_DECLARED
    slow: ReceiverErrors = WHITE

    def measure(self, tape: Tape, views: StepViews) -> None:
        self._wander(tape, views)
        found = np.array([*self.assumed.antenna_m, 0.0])
        FixAid(
            log=self.log,
            sigmas=Sigmas(self.sigma_horizontal_m, self.sigma_velocity_m_s),
            antenna=Antenna(
                arm_m=np.asarray(self.lever_arm_m, dtype=float) + found,
                delay_s=self.assumed.gnss_delay_s,
                velocity_delay_s=self.assumed.gnss_velocity_delay_s,
                found_m=found,
            ),
            states=self._states(),
            history=views.history,
            rows=self.rows,
            names=(OF_FIXES, OF_FIXES),
            of_each_step=2,
        ).measure(tape, views)

    def _wander(self, tape: Tape, views: StepViews) -> None:
        """The receiver's slow errors: first-order Gauss-Markov processes."""
        every = np.arange(len(views.kind))
        for slow, states in (
            (self.slow.position, em.GNSS_SLOW_POS),
            (self.slow.velocity, em.GNSS_SLOW_VEL),
        ):
            if slow.sigma > 0.0:
                kept = np.exp(-views.dt_s / slow.time_s)
                for k in range(states.start, states.stop):
                    tape.assign(every, k, {k: kept}, slow.sigma**2 * (1.0 - kept**2))

    def _states(self) -> ReceiverStates:
        """Those of the base states that take part."""

        def where(takes_part: bool, states: slice) -> range:
            return range(states.start, states.stop if takes_part else states.start)

        late = Nuisance.GNSS_DELAY in self.assumed.free
        of_velocity = em.GNSS_VELOCITY_DELAY
        return ReceiverStates(
            arm=where(Nuisance.ANTENNA in self.assumed.free, em.GNSS_ARM),
            delay=where(late, slice(em.GNSS_DELAY, em.GNSS_DELAY + 1)),
            velocity_delay=where(late, slice(of_velocity, of_velocity + 1)),
            slow_position=where(self.slow.position.sigma > 0.0, em.GNSS_SLOW_POS),
            slow_velocity=where(self.slow.velocity.sigma > 0.0, em.GNSS_SLOW_VEL),
        )


@dataclass
class SurveyedHeadingAid:
    """A surveyed parked heading, used once: in the standing step that holds the time `at_s`."""

    heading_rad: float
    sigma_rad: float
    at_s: float

    def measure(self, tape: Tape, views: StepViews) -> None:
        at = np.flatnonzero(
            (views.kind != ROLLING) & (views.start_s < self.at_s) & (self.at_s <= views.end_s)
        )
        measured = survey.heading(
            views.heading_rad[at],
            self.heading_rad,
            self.sigma_rad**2,
            lat_rad=views.lat_rad[at],
            radius_m=views.radius_m[at],
        )
        tape.measure("survey", at, *measured, gate=GATE_SIGMA)


@dataclass
class CentreLineAid:
    """A surveyed centre line that the taxi follows: cross-track displacement against its
    azimuth.
    """

    azimuth_rad: float

    def measure(self, tape: Tape, views: StepViews) -> None:
        backward = np.abs(wrap_pi(views.heading_rad - self.azimuth_rad)) > np.pi / 2
        chi = self.azimuth_rad + np.where(backward, np.pi, 0.0)
        straight = np.abs(views.heading_change_rad) <= CENTRE_LINE_TURN_RAD_S * views.dt_s
        near = np.abs(wrap_pi(views.heading_rad - chi)) <= CENTRE_LINE_NEAR_RAD
        at = np.flatnonzero((views.kind == ROLLING) & straight & near)
        measured = survey.cross_track(
            views.displacement_n_m[at],
            views.C_mean[at],
            chi[at],
            CENTRE_LINE_WANDER_M**2 * views.dt_s[at],
            lat_rad=views.lat_rad[at],
            radius_m=views.radius_m[at],
        )
        tape.measure("centre line", at, *measured, gate=GATE_SIGMA)


def _way_variance(views: StepViews) -> float:
    """Variance of a step's way by sway, which the wheels do not see."""
    return LATERAL_FLOOR_M**2 + 2.0 * views.jitter_m**2


# the evidence behind each kind of measurement
EVIDENCE = {
    "lateral": HeadingSource.TURNS,
    "stop": HeadingSource.STOPS,
    "odometer": HeadingSource.ODOMETER,
    OF_FIXES: HeadingSource.GNSS,
    "survey": HeadingSource.SURVEY,
    "centre line": HeadingSource.SURVEY,
}
# of the gain in heading: below it no one kind of evidence is named; chosen: the others have told
# less than 1/4 of what it told
MOST_OF_IT = 0.8


def heading_source(gains: dict[str, float]) -> HeadingSource | None:
    """Which evidence found the heading error, `combined` where no one kind gave most of it."""
    total: dict[HeadingSource, float] = {}
    for kind, gain in gains.items():
        if kind in EVIDENCE and gain > 0:
            total[EVIDENCE[kind]] = total.get(EVIDENCE[kind], 0.0) + gain
    if not total:
        return None
    best = max(total, key=lambda source: total[source])
    return best if total[best] >= MOST_OF_IT * sum(total.values()) else HeadingSource.COMBINED
