"""When a unit rests in a run, and what its sensors do then: an even grid of seconds, which of them
are still, and where the vehicle may have been left on another level.

Rest is what `alignment.motion` says: the joined timeline for a unit that finds north, the parked
seconds for one that does not.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from alignment import coarse, gyrocompass
from alignment.motion.imu_faults import repair
from alignment.motion.kinds import DISTURBED, STILL, Disturbance
from alignment.motion.parked_seconds import parked_places
from alignment.motion.seconds import seconds_of as log_seconds
from alignment.motion.stillness import Motion, classify
from alignment.motion.timeline import fused
from infield.session.log import compensated_imu, compensated_seconds, find_rest
from infield.session.parked.stretches import stationary_segments
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature, gyro_temperature, too_short
from ins.records import ImuSource, InputError, NavState, Run, TwinModel
from ins.robust import runs_of_true
from ins.strapdown.mechanization import VerticalChannel, navigate
from simreal.evidence.seconds import Seconds, seconds_of

STILL_AT_LEAST_S = 60.0  # of a still stretch: 3 of the slow means of 20 s
WHOLE_SECOND = 0.9  # of the usual number of rows: 0.1 fewer change a mean by 5 % of its sigma
# causes that may leave the vehicle on another level; a gust or a lost row does not, but what makes
# a sensor clip may: of a person who boarded, a clip was all that the timeline said
LEAVES_A_STEP = (
    Disturbance.MOTION,
    Disturbance.BUMP,
    Disturbance.LOADING,
    Disturbance.PUSH,
    Disturbance.CLIPPING,
    Disturbance.SHOCK,
)


@dataclass(frozen=True)
class DitherLine:
    """A line of one channel: its frequency [Hz], amplitude in rad/s or m/s^2, and sigma of that;
    swing: amplitude of the angle [rad] or velocity [m/s] whose changes the rows are.
    """

    channel: int
    frequency_hz: float
    amplitude: float
    sigma: float
    swing: float


@dataclass(frozen=True)
class ParkedStream:
    """A run's parked time.

    seconds: on an even grid, less the table and the twin's nominal errors; still (n,): seconds at
    rest with all their rows; place (n,): number of the level on which the vehicle stands, it grows
    with each disturbance that may have moved it; up_b (3,): the vertical in body axes, as the mean
    specific force shows it; imu: the log, less the same; temperature: None where none can be used;
    motion: for the others.
    """

    run: Run
    imu: ImuSource
    seconds: Seconds
    still: NDArray
    place: NDArray
    up_b: NDArray
    temperature: GyroTemperature | None
    motion: Motion | None

    @property
    def still_s(self) -> float:
        """Seconds at rest."""
        return float(np.count_nonzero(self.still))

    @property
    def run_s(self) -> float:
        """Length of the log [s]."""
        return float(self.run.imu.end_s - self.run.imu.start_s)

    @property
    def spans(self) -> list[tuple[int, int]]:
        """First and behind-last second of each still stretch on one level."""
        found = []
        for a, b in runs_of_true(self.still):
            cuts = a + 1 + np.flatnonzero(np.diff(self.place[a:b]))
            edges = [a, *cuts.tolist(), b]
            found += [(i, j) for i, j in pairwise(edges) if j - i >= STILL_AT_LEAST_S]
        return found


def stream_of(run: Run, twin: TwinModel, table: ThermalTable | None = None) -> ParkedStream | None:
    """The parked time of a run; None where it never rests for STILL_AT_LEAST_S."""
    temperature = _temperature(run)
    try:
        seconds = seconds_of(compensated_seconds(run, table, temperature, twin))
    except InputError:
        return None
    imu = compensated_imu(run, table, temperature, twin)
    if run.header.gyro_technology == "mems":
        return _of_rests(run, imu, seconds, temperature)
    return _of_timeline(run, imu, seconds, temperature, twin)


def _temperature(run: Run) -> GyroTemperature | None:
    if run.temperature is None or too_short(run.temperature):
        return None
    found = gyro_temperature(run.temperature)
    return None if len(found.unusable) == 3 else found


def _of_timeline(
    run: Run, imu: ImuSource, seconds: Seconds, temperature: GyroTemperature | None, twin: TwinModel
) -> ParkedStream | None:
    """Rest of a unit that finds north: navigated from its first rest, every witness asked."""
    rest = find_rest(run)
    if rest is None:
        return None
    mended, faults = repair(run.imu, log_seconds(run.imu), rest[0], run.imu.end_s)
    whole = imu if mended is run.imu else mended
    means = coarse.rest_means(imu.between(*rest))
    C_nb = coarse.gyrocompass_dcm(means)
    start = NavState(time_s=rest[0], site=run.header.site, v_n_m_s=np.zeros(3), C_nb=C_nb)
    history = navigate(
        whole.pieces(rest[0], whole.end_s),
        start,
        epoch_s=1.0,
        vertical=VerticalChannel(mode="hold"),
    )
    motion = fused(run, history, classify(history, run.phases, whole, faults))
    stream = ParkedStream(run, imu, seconds, *_nowhere(seconds), temperature, motion)
    return _of_still(stream, motion) or _of_alignment(stream, twin) or _of_parked(stream, motion)


def _of_alignment(stream: ParkedStream, twin: TwinModel) -> ParkedStream | None:
    """What an alignment used of a vehicle that is never still. Navigated from the mean of a rest
    that people or wind move, it seems to roll; the alignment finds the start together with the
    level of that motion (`alignment.level_fit`).
    """
    run, seconds = stream.run, stream.seconds
    found = gyrocompass.align(stream.imu, run.header.site, twin, phases=run.phases)
    end_s = seconds.end_s
    still = (end_s > found.time_s - found.duration_s + 1.0) & (end_s <= found.time_s)
    for span in found.excluded:
        still &= (end_s <= span.start_s) | (end_s > span.end_s + 1.0)
    still &= seconds.rows > 0
    return _checked(replace(stream, still=still, place=np.zeros(still.size, int)))


def _nowhere(seconds: Seconds) -> tuple[NDArray, NDArray, NDArray]:
    """No second still, one place, no vertical."""
    n = seconds.end_s.size
    return np.zeros(n, bool), np.zeros(n, int), np.zeros(3)


def stream_at_rest(
    run: Run,
    twin: TwinModel,
    table: ThermalTable | None,
    *,
    motion: Motion | None = None,
    rest: tuple[float, float] | None = None,
    temperature: GyroTemperature | None = None,
) -> ParkedStream | None:
    """The parked time of a run whose rest somebody has judged already: the still epochs of a
    motion, or one rest from start to end [s]. temperature: where it is smoothed already.
    """
    temperature = temperature or _temperature(run)
    try:
        seconds = seconds_of(compensated_seconds(run, table, temperature, twin))
    except InputError:
        return None
    stream = ParkedStream(run, run.imu, seconds, *_nowhere(seconds), temperature, motion)
    if motion is not None:
        return _with_motion(stream, motion)
    if rest is None:
        return None
    inside = (seconds.end_s > rest[0] + 1.0) & (seconds.end_s <= rest[1])
    return _checked(replace(stream, still=inside & (seconds.rows > 0)))


def _with_motion(stream: ParkedStream, motion: Motion) -> ParkedStream | None:
    """The stream, still where the motion is; where it never is for STILL_AT_LEAST_S, all that the
    vehicle stood: people and wind move it on its gear, and the fit reads its rows above that.
    """
    return _of_still(stream, motion) or _of_parked(stream, motion)


def _of_parked(stream: ParkedStream, motion: Motion) -> ParkedStream | None:
    end_s = stream.seconds.end_s
    parked = motion.kind <= DISTURBED
    epoch = np.minimum(np.searchsorted(motion.time_s, end_s), motion.time_s.size - 1)
    inside = (end_s > motion.time_s[0]) & (end_s <= motion.time_s[-1])
    still = inside & parked[epoch] & (stream.seconds.rows > 0)
    place = np.cumsum(np.diff(parked[epoch].astype(int), prepend=1) < 0)
    return _checked(replace(stream, still=still, place=place))


def _of_still(stream: ParkedStream, motion: Motion) -> ParkedStream | None:
    seconds = stream.seconds
    still = np.zeros(seconds.end_s.size, bool)
    steps = np.zeros(still.size, bool)
    # an epoch ends anywhere within a second of the grid: it touches that second and the one before
    at = np.clip(np.ceil(motion.time_s - seconds.end_s[0]).astype(int), 0, still.size - 1)
    still[at] = True
    restless = motion.kind != STILL
    moved = restless & (np.isin(motion.cause, LEAVES_A_STEP) | (motion.kind > DISTURBED))
    for k in (0, 1):
        still[np.maximum(at[restless] - k, 0)] = False
        steps[np.maximum(at[moved] - k, 0)] = True
    still &= seconds.rows > 0
    place = np.cumsum(np.diff(steps.astype(int), prepend=0) > 0)
    return _checked(replace(stream, still=still, place=place))


def _of_rests(
    run: Run, imu: ImuSource, seconds: Seconds, temperature: GyroTemperature | None
) -> ParkedStream | None:
    """Rest of a unit that finds no north: its parked places, by its own quiet seconds."""
    still = np.zeros(seconds.end_s.size, bool)
    place = np.zeros(still.size, int)
    log = log_seconds(run.imu)
    number = 0
    for stretch in stationary_segments(run).stretches:
        for found in parked_places(log, *stretch):
            number += 1
            at = np.rint(found.end_s - seconds.end_s[0]).astype(int)
            inside = (at >= 0) & (at < still.size)
            still[at[inside]] = found.still[inside]
            place[at[inside]] = number
    still &= seconds.rows > 0
    return _checked(ParkedStream(run, imu, seconds, still, place, np.zeros(3), temperature, None))


def _up(seconds: Seconds, still: NDArray) -> NDArray:
    force = seconds.mean[still, 3:].mean(axis=0)
    return np.asarray(force / max(float(np.linalg.norm(force)), 1e-9))


def _checked(stream: ParkedStream) -> ParkedStream | None:
    """The stream less seconds that lack rows, with its vertical; None where too little is left."""
    if not stream.still.any():
        return None
    rows = np.median(stream.seconds.rows[stream.still])
    still = stream.still & (stream.seconds.rows > WHOLE_SECOND * rows)
    if not still.any():
        return None
    whole = replace(stream, still=still, up_b=_up(stream.seconds, still))
    return whole if whole.spans else None
