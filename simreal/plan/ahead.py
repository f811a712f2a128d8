"""What more of a session would bring: the sigma that each gyro's bias would have after a candidate
continuation, by the estimator itself.

A session is continued as a perfect unit would record the candidate, on the attitude that the
estimate found, with the unit's own rest: the mean that it reads beyond the perfect one, and what
its rows scatter about that mean, played backwards: what came last goes on, as where people have
left, and a vehicle that they tilted does not jump. Its temperatures go on as they went, and the
parked vehicle moves as the session found. The covariance of the filter does not depend on the
values that it is given, but on what is measured when and how well, so that the estimate of the
continued session is the prediction.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alignment.motion.kinds import ROLLING
from infield.session.joint_update import Walk
from infield.session.log import find_rest
from infield.session.navigated.estimator import estimate_under
from infield.session.navigated.own_errors import LoggedRun
from infield.session.pipeline import update_calibration
from infield.session.points import AxisObservability, observability
from infield.session.results import SessionResult, UpdateResult
from infield.thermometer.gyro_temperature import gyro_temperature, plausible_range
from ins.attitude import euler_from_dcm, level_angles, rotation_vector_from_dcm
from ins.records import ImuLog, ImuSource, Run, TemperatureLog
from ins.units import MINUTE
from trajectories.runs.checks import MIN_RATE_HZ
from trajectories.runs.imu_stream import Columns, ImuParts
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Pivot, Segment, Stop, Straight, Turn
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.truth import build_truth

# of rest that is repeated, with what people and wind do now and then in it
LONGEST_REST_S = 3600.0
# of rest that shows what the unit reads; chosen: 60 s, as a gyrocompass needs
SHORTEST_REST_S = 60.0
# over which the temperature's slope is taken, twice one after the other; chosen: 10 min
SLOPE_S = 600.0
# time constants of a warm-up that are believed: 10 min of a small unit to 2 h of a large one
FASTEST_S, SLOWEST_S = 600.0, 7200.0


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A continuation: its name, and the motion, which begins at rest."""

    name: str
    segments: tuple[Segment, ...]


def stay(minutes: float) -> Candidate:
    """At rest for so long."""
    return Candidate(name="stay", segments=(Park(duration_s=minutes * MINUTE),))


TURN = Candidate(name="turn", segments=(Pivot(angle_deg=90.0), Park(duration_s=5.0 * MINUTE)))
TAXI = Candidate(
    name="taxi",
    segments=(
        Turn(angle_deg=90.0),
        Straight(duration_s=120.0),
        Stop(duration_s=60.0),
        Turn(angle_deg=90.0),
        Straight(duration_s=120.0),
        Stop(duration_s=120.0),
    ),
)


@dataclass(frozen=True, kw_only=True)
class Outlook:
    """What a candidate brings: how long it takes [s], each gyro's sigma [deg/h] and its temperature
    after it.
    """

    name: str
    duration_s: float
    sigma_deg_h: tuple[float, float, float]
    gyro_degC: tuple[float, float, float]


def outlook(result: UpdateResult, candidates: Sequence[Candidate]) -> list[Outlook]:
    """The sigma of each gyro's mean bias after each candidate, by the update of a session so far.

    Parameters
    ----------
    result : UpdateResult
        Its last run, in memory, is the session. Without an estimate, or where it does not end at
        rest, there is no outlook.
    candidates : sequence of Candidate

    Returns
    -------
    list of Outlook
        Of the candidates that can be predicted.

    Notes
    -----
    Temperatures go on towards their end by one time constant, from two slopes. How often the sigma
    is right within 10 %: docs/at_the_aircraft.md.
    """
    found = []
    for candidate in candidates:
        session = result.sessions[-1]
        longer = continued(session, candidate)
        if longer is None or longer.temperature is None:
            break
        seen = _seen(longer, session, result)
        if len(seen) == 3:
            sx, sy, sz = (axis.sigma_after_deg_h for axis in seen)
            tx, ty, tz = longer.temperature.gyro_degC[-1].tolist()
            found.append(
                Outlook(
                    name=candidate.name,
                    duration_s=float(longer.imu.end_s - session.run.imu.end_s),
                    sigma_deg_h=(sx, sy, sz),
                    gyro_degC=(tx, ty, tz),
                )
            )
    return found


def _seen(longer: Run, session: SessionResult, result: UpdateResult) -> Sequence[AxisObservability]:
    """What the continued session shows of each gyro, the parked vehicle moving as it did before."""
    estimate, temperature = session.estimate, longer.temperature
    assert estimate is not None and temperature is not None
    table, twin, settings = result.before, result.twin, result.settings
    rest = find_rest(longer)
    solution = estimate.solution
    if solution is None or rest is None or solution.level.swing_m:
        more = update_calibration([longer], table, twin, settings=settings, ageing=result.ageing)
        return more.sessions[0].seen
    gyros = gyro_temperature(temperature, plausible_degC=plausible_range(table))
    low, high = gyros.temperature_degC.min(), gyros.temperature_degC.max()
    known = Walk(ageing=result.ageing).until(table, longer, None)
    known = known.extended_to(float(low), float(high))
    more_estimate = estimate_under(
        LoggedRun(longer, known, gyros),
        twin,
        settings,
        rest=rest,
        end_s=longer.imu.end_s,
        level=solution.level,
    )
    return observability(more_estimate, hold_heading=settings.hold_heading)


def continued(session: SessionResult, candidate: Candidate) -> Run | None:
    """The run with the candidate behind it; None where it does not end at rest, or was not
    estimated.
    """
    run, estimate = session.run, session.estimate
    if estimate is None or run.temperature is None:
        return None
    rows = run.imu
    still = _last_rest(session, rows)
    if still is None:
        return None
    roll, pitch, heading = _attitude(session, still)
    truth = build_truth(
        lay(candidate.segments),
        run.header.site,
        heading_rad=heading,
        roll_rad=roll,
        pitch_rad=pitch,
        wheel_reference_m=run.header.wheel_reference_m,
    )
    ideal = ideal_sensors(truth, max(rows.rate_hz, MIN_RATE_HZ))
    more = ImuLog(
        time_s=rows.end_s + ideal.time_s,
        dt_s=np.full(ideal.time_s.size, ideal.dt_s),
        dtheta_rad=_goes_on(
            ideal.dtheta_rad, still.dtheta_rad, backwards=-1.0, net=_turned(session, still)
        ),
        dv_m_s=_goes_on(ideal.dv_m_s, still.dv_m_s, backwards=1.0),
        source=rows.source,
    )
    imu = ContinuedImu(run.imu, more)
    warmer = _warmer(run.temperature, float(imu.end_s))
    header = replace(run.header, applied_table_sha256=None)  # the session's rows are raw
    return replace(run, header=header, imu=imu, temperature=warmer, sha256="")


@dataclass(frozen=True, eq=False)
class ContinuedImu(ImuParts):
    """A log, which stays where it is, and what follows it (an `ins.records.ImuSource`).

    Parameters
    ----------
    before : ImuSource
    more : ImuLog
        Later than `before`.
    """

    before: ImuSource
    more: ImuLog

    @property
    def source(self) -> str:  # type: ignore[override]
        """That of the log."""
        return self.before.source

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.before.rows + self.more.rows

    @property
    def start_s(self) -> float:
        """Time of the first row."""
        return self.before.start_s

    @property
    def end_s(self) -> float:
        """Time of the last row."""
        return self.more.end_s

    @property
    def rate_hz(self) -> float:
        """That of the log."""
        return self.before.rate_hz

    def parts(self, start_s: float, end_s: float) -> Iterator[Columns]:
        """The pieces of the one, then the other."""
        split_s = self.before.end_s
        pieces: Iterable[ImuLog] = [self.more]
        if start_s < split_s:
            # a log of one row is none
            pieces = chain(self.before.pieces(min(start_s, split_s - 1.0)), pieces)
        for piece in pieces:
            a, b = np.searchsorted(piece.time_s, [start_s, end_s], side="right")
            if a < b:
                yield piece.time_s[a:b], piece.dt_s[a:b], piece.dtheta_rad[a:b], piece.dv_m_s[a:b]
            if b < piece.rows:
                return


def _last_rest(session: SessionResult, rows: ImuSource) -> ImuLog | None:
    """The rows since the vehicle last moved, bumps and gusts among them; None where it moves, or
    moved a moment ago.
    """
    assert session.estimate is not None
    motion = session.estimate.motion
    if motion is None or motion.kind[-1] >= ROLLING:
        return None
    moves = np.flatnonzero(motion.kind >= ROLLING)
    stands_s = float(motion.time_s[moves[-1] if moves.size else 0])
    start_s = max(stands_s, rows.end_s - LONGEST_REST_S)
    if rows.end_s - start_s < SHORTEST_REST_S:
        return None
    return rows.between(start_s, np.inf)


def _attitude(session: SessionResult, still: ImuLog) -> tuple[float, float, float]:
    """Roll, pitch, heading [rad] at the end of a session; without a heading, 0 for it."""
    assert session.estimate is not None
    solution = session.estimate.solution
    if solution is not None:
        roll, pitch, heading = euler_from_dcm(solution.history.C_nb[-1])
        return float(roll), float(pitch), float(heading)
    return *level_angles(still.dv_m_s.mean(axis=0)), 0.0


def _turned(session: SessionResult, still: ImuLog) -> NDArray:
    """By what the vehicle is turned at the end of a rest against its start (3,), body axes: people
    and freight tilt it, and the unit's own mean rate is without that.
    """
    assert session.estimate is not None
    solution = session.estimate.solution
    if solution is None:
        return np.zeros(3)
    C_nb = solution.history.C_nb
    start = int(np.searchsorted(solution.history.time_s, still.start_s))
    return rotation_vector_from_dcm(C_nb[start].T @ C_nb[-1])


def _goes_on(ideal: NDArray, still: NDArray, *, backwards: float, net: ArrayLike = 0.0) -> NDArray:
    """The ideal rows (n, 3) with the mean of the rest beyond the ideal rest, and the
    scatter of the rest about its mean, backwards from its end, then forwards, as often as needed.

    backwards: what a scatter is multiplied by where time runs backwards: -1 of rates, 1 of forces;
    net: the part of the rest's sum that is the vehicle's.
    """
    mean = (still.sum(axis=0) - net) / len(still)
    scatter = still - mean
    there_and_back = np.concatenate([backwards * scatter[::-1], scatter])
    return np.asarray(ideal + (mean - ideal[0]) + np.resize(there_and_back, ideal.shape))


def _warmer(log: TemperatureLog, end_s: float) -> TemperatureLog:
    """The temperatures until a later end, by two slopes: T' = r exp(-t / tau)."""
    t = log.time_s
    step = float(np.median(np.diff(t)))
    new_s = np.arange(t[-1] + step, end_s + 0.5 * step, step)
    columns = {}
    for name, values in vars(log).items():
        if isinstance(values, np.ndarray) and name != "time_s":
            columns[name] = np.concatenate([values, _extrapolated(t, values, new_s)])
    times = np.concatenate([t, new_s])
    return TemperatureLog(time_s=times, constant=log.constant, **columns)


def _extrapolated(t: NDArray, values: NDArray, new_s: NDArray) -> NDArray:
    """Values (n,) or (n, 3) at later times; the last slope's scatter is repeated."""
    last = t > t[-1] - SLOPE_S
    before = (t > t[-1] - 2.0 * SLOPE_S) & ~last
    level, slope = _line(t[last] - t[-1], values[last])
    tau = np.full(np.shape(slope), SLOWEST_S)
    if np.count_nonzero(before) > 2 and t[-1] - t[0] >= 2.0 * SLOPE_S:
        earlier = _line(t[before] - t[-1], values[before])[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            tau = SLOPE_S / np.log(earlier / slope)
        tau = np.clip(np.nan_to_num(tau, nan=SLOWEST_S), FASTEST_S, SLOWEST_S)
    ahead = (new_s - t[-1])[:, None]
    smooth = level + slope * tau * -np.expm1(-ahead / tau)
    line = level + slope * (t[last] - t[-1])[:, None]
    scatter = np.resize(values[last].reshape(line.shape) - line, smooth.shape)
    return (smooth + scatter).reshape(new_s.size, *values.shape[1:])


def _line(t: NDArray, values: NDArray) -> tuple[NDArray, NDArray]:
    """Value at 0 and slope of each column, by least squares."""
    slope, level = np.polyfit(t, values.reshape(t.size, -1), 1)
    return level, slope
