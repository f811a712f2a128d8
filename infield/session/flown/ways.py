"""What lies between the rests of a unit whose own solution does not stand free for a flight (MEMS),
as a tape: the errors of an aided solution that is set anew each second, the biases of a session's
bins among its states.

The aided solution (`infield.aided`) says where a stretch begins, where gravity and Coriolis are
looked up, and what the errors are linearised about; no bias of the aided filter is used, and what
its rows are counts for nothing (`ins.filters.reference`). States: those of
`ins.estimation.states` that move, the accelerometers, the bins, then what comes and goes (slow
errors of the receiver, flicker of the gyros) and the constants of a flight. Motion and slow errors
begin anew with each stretch.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.session.flown.flight import OF_POSITION, OF_VELOCITY
from infield.session.flown.priors import Further, Layout
from ins.attitude import skew
from ins.estimation import error_model as em
from ins.estimation import sensors
from ins.estimation.error_filter import GATE_SIGMA, ErrorFilter
from ins.estimation.measurements import fix
from ins.estimation.measurements.antenna import Antenna
from ins.estimation.states import ACCEL_Z, BASE, POS, POS_DOWN, THETA, W_DOWN, W
from ins.estimation.tape import GYRO, Tape
from ins.filters.aided_records import AidedNoise, Fixes
from ins.filters.aided_tape import Receiver, measure_fixes
from ins.filters.reference import About
from ins.units import DEG

# flicker of the gyros within a bin: Gauss-Markov processes of these shares of its length, a factor
# of FLICKER_STEP apart; slower flicker is what the bins tell, faster is below white noise
FLICKER_SHARES, FLICKER_STEP = np.array([0.0125, 0.05, 0.2]), 4.0
# states that come and go, by their place after the bins: of the receiver's positions, of those of
# the other type of fixes, of its velocities, of gyros x, y, z
SLOW_POSITION, SLOW_OTHER, SLOW_VELOCITY = range(3), range(3, 6), range(6, 9)
FLICKER = range(9, 9 + 3 * FLICKER_SHARES.size)
COMES_AND_GOES = FLICKER.stop
# of position, velocity, tilt and heading where a stretch begins: beyond what a solution may be off
BEGIN_M, BEGIN_SPEED_M_S, BEGIN_TILT_RAD, BEGIN_HEADING_RAD = 30.0, 5.0, 5.0 * DEG, 20.0 * DEG
# of what the turning arm adds to the velocity of the antenna: the rate within a second is not
# its mean
SWING_SHARE = 0.1
STAND, STAND_M_S = "stand", 0.01  # of a standing vehicle, as infield.aided.flight
# a body turns where a gyro reads more than so many sigmas of its bias and noise: 6e-5 of noise do
TURNS_SIGMAS = 4.0


@dataclass(frozen=True)
class Believed:
    """What the filter takes for known.

    noise: of the sensors and of the receiver's slow errors; antenna: about which the fixes are
    compared; layout: the constants of a flight, their places; bias_mean (3N,), bias_covariance (3N,
    3N): of the bins [rad/s]; accel_m_s2: prior sigma of the accelerometers' biases; flicker_rad_s:
    bias instability of the gyros; bin_s: length of a bin.
    """

    noise: AidedNoise
    antenna: Antenna
    layout: Layout
    bias_mean: NDArray
    bias_covariance: NDArray
    accel_m_s2: float
    flicker_rad_s: float
    bin_s: float

    @property
    def flicker_process_rad_s(self) -> float:
        """Sigma of each process that the flicker is made of: processes of time constants a factor r
        apart sum to sigma^2 / (f ln r), flicker is B^2 / (pi f), one-sided (IEEE Std 952, annex C).
        """
        return float(self.flicker_rad_s * np.sqrt(np.log(FLICKER_STEP) / np.pi))

    @property
    def of_mean(self) -> float:
        """Variance of what these processes leave in the mean of a bin [(rad/s)^2]."""
        u = 1.0 / FLICKER_SHARES
        return float(self.flicker_process_rad_s**2 * np.sum(2.0 * (u + np.expm1(-u)) / u**2))

    def fading(self) -> tuple[NDArray, NDArray]:
        """Time constants [s] and sigmas (k,) of the states that come and go."""
        noise = self.noise
        flicker_s = np.repeat(FLICKER_SHARES * self.bin_s, 3)
        seconds = np.concatenate([[noise.slow_s] * 6, [noise.slow_velocity_s] * 3, flicker_s])
        sigmas = [
            *[noise.slow_level_m] * 2,
            noise.slow_down_m,
            *[noise.slow_other_level_m] * 2,
            noise.slow_other_down_m,
            *[noise.slow_velocity_m_s] * 3,
            *[self.flicker_process_rad_s] * flicker_s.size,
        ]
        return seconds, np.array(sigmas)


@dataclass(frozen=True)
class Way:
    """Stretches under way, over the K steps of their reference.

    bins (K,): number of the gyros' bin; flies (K,): in the air or on wheels,
    where vibration may change what gyros read; warmer_degC (K,): than at the start of the log;
    stands: steps at whose end the vehicle stands.
    """

    about: About
    fixes: Fixes
    bins: NDArray
    flies: NDArray
    warmer_degC: NDArray
    stands: NDArray


def estimated_ways(way: Way, believed: Believed) -> ErrorFilter:
    """The filter at the end of its last stretch; its bins are their means, flicker included."""
    noise = believed.noise
    own = np.diag(np.full(believed.bias_mean.size, believed.of_mean))
    flt = ErrorFilter(
        sigma0={"ACCEL": believed.accel_m_s2, "ACCEL_Z": believed.accel_m_s2},
        noise=em.ProcessNoise(
            arw=noise.arw,
            vrw=noise.vrw,
            accel_rrw=noise.accel_walk,
            yaw_creep=0.0,
            lateral_rms=0.0,
            lateral_time_s=1.0,
        ),
        bias_mean=believed.bias_mean,
        bias_covariance=believed.bias_covariance - own,
        further_sigma=(*[0.0] * COMES_AND_GOES, *believed.layout.sigma),
        further_walks={ACCEL_Z: noise.accel_walk**2},
    )
    flt.run(_tape(way, believed))
    bins = slice(BASE, BASE + believed.bias_mean.size)
    flt.P[bins, bins] += own
    return flt


def first_fading(believed: Believed) -> int:
    """Where the states that come and go begin."""
    return BASE + believed.bias_mean.size


def _tape(way: Way, believed: Believed) -> Tape:
    tape = Tape(way.about.reference.steps(way.bins))
    _begin_and_fade(tape, believed)
    _drive(tape, way, believed)
    _measure_fixes(tape, way, believed)
    at = way.stands
    z = way.about.reference.end.v_n[at].T
    tape.measure(STAND, at, z, [{k: 1.0} for k in range(3)], [STAND_M_S**2] * 3, gate=GATE_SIGMA)
    return tape


def _begin_and_fade(tape: Tape, believed: Believed) -> None:
    """Motion and slow errors where a stretch begins, a step of no length; how the latter fade."""
    dt = np.asarray(tape.steps.dt_s)
    begins, moves = np.flatnonzero(dt == 0.0), np.flatnonzero(dt > 0.0)
    tilts = [BEGIN_TILT_RAD, BEGIN_TILT_RAD, BEGIN_HEADING_RAD]
    for state, sigma in zip(range(THETA.start, THETA.stop), tilts):
        tape.assign(begins, state, {}, sigma**2)
    for state in range(POS.start, POS_DOWN + 1):
        tape.assign(begins, state, {}, BEGIN_M**2)
    of_theta = skew(np.asarray(tape.steps.v_n)[begins])
    for k in range(W.start, W_DOWN + 1):
        row = {THETA.start + j: of_theta[:, k, j] for j in range(3)}
        tape.assign(begins, k, row, BEGIN_SPEED_M_S**2)
    first = first_fading(believed)
    for k, (seconds, sigma) in enumerate(zip(*believed.fading())):
        kept = np.exp(-dt[moves] / seconds)
        tape.assign(begins, first + k, {}, sigma**2)
        tape.assign(moves, first + k, {first + k: kept}, sigma**2 * (1.0 - kept**2))


def _drive(tape: Tape, way: Way, believed: Believed) -> None:
    """Let the sensors' errors act."""
    states, force_b = believed.layout.indices, way.about.reference.force_b
    turns_b = _turns(way, believed)
    sensors.bin_biases(tape, BASE)
    for k, state in enumerate(FLICKER):
        tape.drive(first_fading(believed) + state, GYRO + k % 3, 1.0)
    sensors.gyro_shifts(tape, states(Further.SHIFT), way.flies)
    sensors.force_sensitivities(tape, states(Further.FORCE), force_b)
    sensors.gyro_scales(tape, states(Further.GYRO_SCALE), turns_b)
    sensors.misalignments(tape, states(Further.MISALIGNMENT), turns_b)
    sensors.accelerometer_biases(tape, (*range(em.ACCEL.start, em.ACCEL.stop), ACCEL_Z))
    sensors.accelerometer_scales(tape, states(Further.ACCEL_SCALE), force_b)
    sensors.accelerometer_slopes(tape, states(Further.ACCEL_SLOPE), way.warmer_degC)


def _turns(way: Way, believed: Believed) -> NDArray:
    """Rate of the body (K, 3), no rate where bias and noise alone may read as much."""
    mean = believed.bias_mean.reshape(-1, 3)[way.bins]
    variance = np.diag(believed.bias_covariance).reshape(-1, 3)[way.bins]
    variance = variance + believed.flicker_process_rad_s**2 * FLICKER_SHARES.size
    dt, rate_b = way.about.reference.dt_s[:, None], way.about.reference.rate_b
    variance = variance + believed.noise.arw**2 / np.where(dt > 0.0, dt, np.inf)
    return np.where(np.abs(rate_b - mean) > TURNS_SIGMAS * np.sqrt(variance), rate_b, 0.0)


def _measure_fixes(tape: Tape, way: Way, believed: Believed) -> None:
    """Positions and velocities, where a fix has them."""
    layout, first = believed.layout, first_fading(believed)
    delays = layout.indices(Further.DELAY)
    states = fix.ReceiverStates(
        arm=layout.indices(Further.ANTENNA),
        delay=delays[:1],
        velocity_delay=delays[1:],
        slow_position=[first + state for state in SLOW_POSITION],
        slow_velocity=[first + state for state in SLOW_VELOCITY],
    )
    antenna = believed.antenna
    receiver = Receiver(
        antenna=antenna,
        delays_s=(antenna.delay_s, antenna.velocity_delay_s),
        states=states,
        slow_other=[first + state for state in SLOW_OTHER],
        names=(OF_POSITION, OF_VELOCITY),
        gate=GATE_SIGMA,
        swing_share=SWING_SHARE,
    )
    measure_fixes(tape, way.about, way.fixes, receiver)
