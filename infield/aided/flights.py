"""A log flown as often as models are tried on it: from which start, with which filter, on which
part of it.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from infield.aided.headings import HeadingFound, HeadingOpen, Sky, find_heading
from infield.aided.left_out import UsualMotion, of_receiver, with_usual_motion
from infield.aided.noise import Model
from infield.aided.start import FoundStart, moving_start, parked_start, surveyed_start
from ins.filters.aided_filter import FromHeadings, first_about, solved, without_start
from ins.filters.aided_records import (
    NO_WHEELS,
    USED,
    AidedHistory,
    AidedNoise,
    AidedOptions,
    Antenna,
    Fixes,
    Wheels,
)
from ins.filters.aided_tape import Task
from ins.filters.reference import About, Rows
from ins.records import ImuSource, RunHeader
from ins.robust import chi2
from ins.verdicts import Reason

# chosen, of log that noise and antenna are fitted on from the first time on that the vehicle moves:
# of white noise 1,800 fixes of one a second show 1.0 % of its sigma
FIT_S = 1800.0
KEPT_FLIGHTS = 32  # of a part of the log; chosen: half an hour of ten fixes a second has 3 MB each
# of log under way before a start by matching, which needs 60 s of it at most and tries every 20 s;
# beyond it the heading is sought from the beginning on
LATE_S = 75.0
STAND_SIGMA_M_S = 0.01
# a parked vehicle's own turning; 0: no measurement (a gyrocompass does better with what the gyros
# read)
STAND_RATE_RAD_S = {"mems": 1e-4, "fog": 0.0, "rlg": 0.0}
# a solution that rejects every position for so long is begun anew
BEGIN_ANEW_S = {"mems": 10.0, "fog": 120.0, "rlg": 120.0}


@dataclass
class Beginning:
    """Finds the start of a log, for fixes at other times and for other lever arms; headings all
    round are sought once.
    """

    sky: Sky
    header: RunHeader
    rest: Where | None
    stands: tuple[Where, ...]
    heading: HeadingFound | HeadingOpen | Reason | None = None

    def __call__(self, late: Fixes, lever_arm_m: NDArray) -> FoundStart | Reason:
        """Parked on a gyrocompass, else at a surveyed heading, else in motion."""
        sky = self.sky
        known = {"gyro_sigma_deg_h": sky.gyro_sigma_deg_h, "lever_arm_m": lever_arm_m}
        if self.rest is not None:
            return parked_start(sky.imu, late, self.header.site, sky.twin, rest=self.rest, **known)
        surveyed = surveyed_start(sky.imu, late, self.header, sky.twin, stands=self.stands, **known)
        return self._moving(late, lever_arm_m) if surveyed is None else surveyed

    def _moving(self, late: Fixes, lever_arm_m: NDArray) -> FoundStart | Reason:
        """By velocity matching where that is soon, else from headings all round."""
        here = self.sky.with_antenna(late, lever_arm_m)
        if isinstance(self.heading, HeadingFound):  # all flights begin alike
            return self.heading.start(here)
        found = moving_start(
            here.imu,
            late,
            here.twin,
            self.stands,
            gyro_sigma_deg_h=here.gyro_sigma_deg_h,
            lever_arm_m=lever_arm_m,
        )
        if isinstance(found, FoundStart) and not _comes_late(found, late, self.stands):
            return found
        if self.heading is None:
            self.heading = find_heading(here, self.stands)
        if isinstance(self.heading, HeadingFound):
            return self.heading.start(here)
        if isinstance(found, FoundStart):
            return found
        return (
            self.heading.likeliest(here) if isinstance(self.heading, HeadingOpen) else self.heading
        )


@dataclass(frozen=True, kw_only=True)
class Given:
    """What a log was flown with: noise of sensors and receiver, and fixes, whose times are the
    receiver's, with the sigmas that were taken.
    """

    noise: AidedNoise
    fixes: Fixes


@dataclass(frozen=True)
class Flights:
    """Flies the log as often as it is asked to; a start is looked for once for each antenna, the
    solution that flights are linearised about once for each start, and a part of the log flown once
    for each model: of such a flight what the fixes say is kept alone. A copy with something
    replaced keeps `references` alone.
    """

    imu: ImuSource
    fixes: Fixes
    noise: AidedNoise
    declared_m: tuple[float, float, float]
    stands: tuple[Where, ...]
    technology: str
    begin: "Beginning"
    wheels: Wheels = NO_WHEELS
    usual: UsualMotion | None = None
    declared_other_m: tuple[float, float] = (0.0, 0.0)
    references: dict[tuple[float, float], About] = field(default_factory=dict)
    starts: dict[tuple[float, ...], FoundStart | Reason] = field(default_factory=dict, init=False)
    abouts: dict[tuple[float, ...], About] = field(default_factory=dict, init=False)
    tried: dict[bytes, AidedHistory] = field(default_factory=dict, init=False)

    def by_type(self) -> "Flights":
        """The same with slow errors as large as the fixes of each type say of themselves, where
        they are of two types.
        """
        if not self.two_types:
            return self
        of_type = _typical_m(self.fixes, other=False)
        return replace(
            self,
            declared_m=(*of_type, self.declared_m[2]),
            declared_other_m=_typical_m(self.fixes, other=True),
        )

    @property
    def two_types(self) -> bool:
        """Whether the fixes are of two types, each with a slow error of its own."""
        return bool(self.fixes.other_type.any())

    @property
    def typical(self) -> float:
        """Median level sigma of the fixes, over the one that was declared for the log."""
        level = self.fixes.sigma_position_m[~self.fixes.other_type, 0]
        return float(np.median(level)) / self.declared_m[0]

    def scatter(self, history: AidedHistory) -> float:
        """What positions change by from one to the next beside the sensors' way, over what their
        declared sigmas allow for. The median: leaps do not count. 1 where there are none.
        """
        rows = np.flatnonzero(history.used[:, 0] == USED)
        pairs = np.flatnonzero(np.diff(rows) == 1)
        if not pairs.size:
            return 1.0
        before, after = rows[pairs], rows[pairs + 1]
        off_m = history.residual[after] - history.residual[before]
        sigma_m = self.fixes.sigma_position_m
        over = off_m[:, :3] ** 2 / (sigma_m[after] ** 2 + sigma_m[before] ** 2)
        return float(np.sqrt(np.median(over) / chi2.ppf(0.5, 1)))

    @property
    def rows_of_receiver(self) -> NDArray:
        """Which rows that the filter is given are the receiver's, not of the usual motion."""
        return with_usual_motion(self.fixes, self.usual, self.imu.end_s)[1]

    def start(self, antenna: Antenna) -> FoundStart | Reason:
        key = antenna.velocity_delay_s, *antenna.lever_arm_m
        if key not in self.starts:
            self.starts[key] = self.begin(
                self.fixes.earlier(antenna.velocity_delay_s), antenna.lever_arm_m
            )
        return self.starts[key]

    def __call__(self, model: Model, *, whole: bool = False) -> AidedHistory | None:
        found = self.start(model.antenna)
        if isinstance(found, Reason):
            return None
        if whole:
            return self.from_start(found, model, whole=True)
        key = _key(model)
        if key not in self.tried:
            self.tried[key] = self.from_start(found, model, whole=False)
            while len(self.tried) > KEPT_FLIGHTS:
                del self.tried[next(iter(self.tried))]
        history = self.tried[key]
        antenna = replace(history.antenna, estimated=model.antenna.estimated)
        return replace(history, antenna=antenna)

    def from_start(
        self, found: FoundStart, model: Model, *, whole: bool, smooth: bool = False
    ) -> AidedHistory:
        """A flight from a start."""
        task = self.task(found, model)
        about = self.about(task, model, whole=whole)
        if smooth:  # over an outage the solution may be far off that of other delays and noise
            rows = Rows.of(FromHeadings(about, task, record=True).flown(task.start))
            about = about.along(rows, task.fixes.time_s, task.noise.vrw)
        history = solved(about, task, smooth=smooth, rows=whole)
        timed = replace(history, antenna=history.antenna.later(_base_s(model)))
        return of_receiver(timed, self.rows_of_receiver)

    def from_headings(
        self, starts: list[FoundStart], model: Model, *, smooth: bool = False
    ) -> list[AidedHistory]:
        """Flights from starts that differ in heading, each about the same solution turned."""
        tasks = [self.task(found, model) for found in starts]
        about = self.about(tasks[0], model, whole=True)
        fan = FromHeadings(about, tasks[0], record=True)
        found = []
        for task in tasks:
            history = fan.flown(task.start)
            if smooth:
                near = about.along(Rows.of(history), task.fixes.time_s, task.noise.vrw)
                history = solved(near, task, smooth=True)
            else:
                history = without_start(history)
            timed = replace(history, antenna=history.antenna.later(_base_s(model)))
            found.append(of_receiver(timed, self.rows_of_receiver))
        return found

    def given(self, model: Model) -> Given:
        """What the filter is given under a model."""
        scales = model.scales
        return Given(
            noise=scales.of(self.noise, *self.declared_m, self.declared_other_m),
            fixes=self.fixes.scaled(scales.position, scales.velocity),
        )

    def task(self, found: FoundStart, model: Model) -> Task:
        """What is flown under a model, from a start; its delays are those beyond the lesser one."""
        base_s, given = _base_s(model), self.given(model)
        fixes, _ = with_usual_motion(given.fixes, self.usual, self.imu.end_s)
        return Task(
            start=found.start,
            noise=given.noise,
            fixes=fixes.earlier(base_s),
            antenna=model.antenna.later(-base_s),
            options=replace(options_of(self.technology, self.stands), wheels=self.wheels),
        )

    def about(self, task: Task, model: Model, *, whole: bool) -> About:
        """What flights are linearised about: all of the log, or FIT_S, counted from the end of a
        stand at the start.
        """
        start_s = task.start.state.time_s
        stands_s = next((b for a, b in self.stands if a <= start_s + 1.0 < b), start_s)
        end_s = np.inf if whole or stands_s + FIT_S >= self.imu.end_s else stands_s + FIT_S
        if (start_s, end_s) not in self.references:
            self.references[start_s, end_s] = first_about(self.imu, task, end_s)
        first = self.references[start_s, end_s]
        key = start_s, end_s, _base_s(model)
        if key not in self.abouts:
            self.abouts[key] = first.along(first.rows, task.fixes.time_s, task.noise.vrw)
        return self.abouts[key]


def _typical_m(fixes: Fixes, *, other: bool) -> tuple[float, float]:
    """Median sigmas of the positions of a type, level and down [m]."""
    of_type = fixes.sigma_position_m[fixes.other_type == other]
    return float(np.median(of_type[:, 0])), float(np.median(of_type[:, 2]))


def _base_s(model: Model) -> float:
    """The delay that positions and velocities have in common [s]."""
    return min(model.antenna.delay_s, model.antenna.velocity_delay_s)


def _key(model: Model) -> bytes:
    """What a flight hangs on, to the last bit: an antenna that is known is not estimated."""
    antenna, scales = model.antenna, model.scales
    free = antenna.estimated and antenna.covariance.any()
    values = [*vars(scales).values(), antenna.delay_s, antenna.velocity_delay_s, free]
    return np.concatenate([values, antenna.lever_arm_m, antenna.covariance.ravel()]).tobytes()


def _comes_late(found: FoundStart, fixes: Fixes, stands: tuple[Where, ...]) -> bool:
    """Whether a vehicle was under way for longer than LATE_S before its start was found."""
    first_s, start_s = float(fixes.time_s[0]), found.start.state.time_s
    stood = sum(max(min(b, start_s) - max(a, first_s), 0.0) for a, b in stands)
    return start_s - first_s - stood > LATE_S


def options_of(technology: str, stands: tuple[Where, ...]) -> AidedOptions:
    """What the filter is told of a technology's standstills."""
    return AidedOptions(
        stands=stands,
        stand_sigma_m_s=STAND_SIGMA_M_S,
        stand_rate_rad_s=STAND_RATE_RAD_S[technology],
        reset_s=BEGIN_ANEW_S[technology],
    )
