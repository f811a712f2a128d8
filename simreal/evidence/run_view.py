"""One run as the diagnosis sees it: what the twin expects at each second, where it is parked, where
it moves.

Attitude, motion and heading come from the run itself: gravity and Earth rate over the parked
stretch, then free-inertial navigation. The `reference` stream is never read. Time is the run's
clock (seconds since power-on).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from alignment import coarse
from alignment.motion import kinds
from alignment.motion.imu_faults import ImuFault, repair
from alignment.motion.parked_seconds import parked_places
from alignment.motion.seconds import LogSeconds
from alignment.motion.seconds import seconds_of as seconds_of_log
from alignment.motion.timeline import timeline
from infield.session.log import (
    compensated_imu,
    compensated_seconds,
    find_rest,
    with_applied_table_undone,
)
from infield.session.navigated.run_telemetry import standing, thermal
from infield.session.parked.stretches import stationary_segments
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import (
    GyroTemperature,
    gyro_temperature,
    plausible_range,
    too_short,
)
from ins.attitude import dcm_from_euler, euler_from_dcm, wrap_pi
from ins.earth import EARTH_RATE_RAD_S
from ins.errors.telemetry import AIRBORNE, PARKED, ROLLING, Telemetry
from ins.records import PARKED_PHASES, ImuSource, NavHistory, NavState, Run, TwinModel
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG_PER_HOUR
from ins.verdicts import sentence
from simreal.evidence.at_range import share_at_range
from simreal.evidence.dead_channels import dead_columns, with_dead_filled
from simreal.evidence.noise_model import channel_noises
from simreal.evidence.seconds import Seconds, seconds_of
from simreal.evidence.vehicle_motion import (
    VehicleMotion,
    bends_of,
    level_axes,
    motion_of,
    turned_back,
)

# beside movement: the vehicle may be on its way already; chosen: twice the longest sum of the
# rows in which a start shows (3 s)
MOVEMENT_EDGE_S = 6.0
BLIND_EDGE_S = 60.0  # the same, where a sensor is dead and a slow start may go unseen
SHORTEST_PARK_S = 60.0
SHORTEST_LEVEL_S = 30.0  # of a unit that does not find north
# of a phase logged as parked: means of 10 s, 2.8 periods of rocking at 0.28 Hz, and a push of
# 0.15 m/s^2, FORCE_STEP_M_S2 of alignment.motion.inertial
MEAN_S, MOVING_M_S2 = 10, 0.15
# turn-on bias over the level Earth rate beyond this: no heading, no navigation; 6 deg
UNKNOWN_HEADING_RAD = 0.1
MOVED = (
    "people, wind or loads moved the parked vehicle: its turns are taken out as an update takes"
    " them out, and the noise of this stretch is not judged"
)
SHAKEN = (
    "people, wind or loads moved the parked vehicle: the noise of this stretch is theirs, and is"
    " not judged"
)


@dataclass(frozen=True)
class RunView:
    """A run cut in two: the parked stretch (start_s, end_s], judged on the sensors themselves, and
    what follows,

    judged through navigation (`history`, from end_s on, None where nothing follows or no heading is
    known). seconds : of the log less what the twin expects of the unit (table, scale factors,
    misalignment, biases). C_nb (3, 3) : nominal parked attitude. sigma_heading_rad : what is known
    of its heading (survey), else wide. notes : what had to be left out, in words. motion : of a
    vehicle that moves on its gear; its turns are taken out of `seconds` then.
    """

    run: Run
    telemetry: Telemetry
    seconds: Seconds
    start_s: float
    end_s: float
    C_nb: NDArray
    sigma_heading_rad: float
    history: NavHistory | None
    temperature: GyroTemperature | None
    notes: tuple[str, ...] = field(default=())
    motion: VehicleMotion | None = None

    @property
    def name(self) -> str:
        return self.run.header.run_id

    @property
    def run_s(self) -> float:
        """Length of the log [s]."""
        return float(self.run.imu.end_s - self.run.imu.start_s)


def view_run(
    run: Run,
    index: int,
    table: ThermalTable | None,
    twin: TwinModel,
    *,
    table_sha256: str = "",
    moved: bool = False,
) -> RunView | str:
    """The run as the diagnosis sees it; words where it cannot be used at all.

    table None: the twin has none, or the run no gyro temperature to enter it with. A log from which
    the twin's own table was subtracted already (`applied_table_sha256`) has it added back first;
    InputError for another one. moved: the vehicle moves on its gear while it is parked.
    """
    notes: list[str] = []
    temperature = _temperature(run, table, notes)
    applied = run.header.applied_table_sha256
    if applied is not None:
        found = (lambda _: table) if table is not None and applied == table_sha256 else None
        run = with_applied_table_undone(run, found)
    dead = dead_columns(run.imu)
    filled = with_dead_filled(run, dead)
    if isinstance(filled, str):
        return filled
    run, fill, said = filled
    notes += said
    imu = compensated_imu(run, table, temperature, twin)
    level_earth_rate = EARTH_RATE_RAD_S * np.cos(run.header.site.lat_rad)
    knows_north = bool(
        twin.gyro.turn_on_deg_h * DEG_PER_HOUR < UNKNOWN_HEADING_RAD * level_earth_rate
    )
    log = compensated_seconds(run, table, temperature, twin)
    seconds = _without(seconds_of(log), dead, fill)
    rest = find_rest(run) if knows_north else _longest_rest(run, log)
    shortest = SHORTEST_PARK_S if knows_north else SHORTEST_LEVEL_S
    if rest is None:
        return (
            f"the log never rests for {shortest:.0f} s; a parked stretch of 5 min or more is needed"
        )
    start_s = float(np.ceil(rest[0] - 1e-6))
    C_nb = _attitude(imu, rest)
    whole = imu
    faults: tuple[ImuFault, ...] = ()
    if knows_north:
        mended, faults = repair(run.imu, seconds_of_log(run.imu), rest[0], run.imu.end_s)
        if mended is not run.imu:
            whole = compensated_imu(replace(run, imu=mended), table, temperature, twin)
    kind = _kinds(run, whole, faults, rest, C_nb, seconds, navigable=knows_north)
    moves = np.flatnonzero((kind != PARKED) & (seconds.end_s > start_s))
    edge_s = _edge_s(dead, knows_north)
    end_s = (
        float(seconds.end_s[moves[0]] - 1.0 - edge_s) if moves.size else float(seconds.end_s[-1])
    )
    if end_s - start_s < shortest:
        return (
            f"parked for {max(end_s - start_s, 0.0):.0f} s only, {shortest:.0f} s or more are"
            " needed"
        )
    C_nb, sigma_heading = _best_attitude(imu, run, seconds, (start_s, end_s))
    motion = None
    if moved and not dead.any() and level_axes(C_nb) is not None:
        if knows_north:
            seconds, C_nb = turned_back(
                seconds,
                (start_s, end_s),
                C_nb,
                run.header.site,
                finds_north=not np.isfinite(sigma_heading),
                bends=bends_of(run.imu, seconds.end_s),
            )
        motion = motion_of(
            _ten_second_means(seconds, start_s, end_s),
            C_nb,
            run.header.site,
            channel_noises(twin, float(run.imu.end_s - run.imu.start_s), C_nb),
            turned=knows_north,
        )
        notes.append(MOVED if knows_north else SHAKEN)
    history = None
    if moves.size and knows_north and not dead.any():
        history = _navigation(imu, run, end_s, C_nb)
    elif moves.size and not knows_north:
        notes.append(
            "the unit does not find north: what follows the parked stretch is not looked at"
        )
    telemetry = replace(
        _telemetry(run, seconds, kind, C_nb, history), run_index=index, heading_known=knows_north
    )
    if temperature is not None:
        telemetry = replace(telemetry, **thermal(run, table, temperature, telemetry.time_s))
    return RunView(
        run,
        telemetry,
        seconds,
        start_s,
        end_s,
        C_nb,
        sigma_heading,
        history,
        temperature,
        tuple(notes),
        motion,
    )


def _ten_second_means(seconds: Seconds, start_s: float, end_s: float) -> NDArray:
    """Of the parked stretch (6, bins)."""
    first = int(np.searchsorted(seconds.end_s, start_s + 1e-6))
    bins = int((end_s - start_s + 1e-6) // MEAN_S)
    means = seconds.mean[first : first + bins * MEAN_S].reshape(bins, MEAN_S, 6)
    return np.asarray(means.mean(axis=1).T)


def _edge_s(dead: NDArray, knows_north: bool) -> float:
    """What is taken off the parked stretch before the first movement [s]. The rest of a unit that
    finds no north ends where its own rows stop being quiet: nothing more is.
    """
    if dead.any():
        return BLIND_EDGE_S
    return MOVEMENT_EDGE_S if knows_north else 0.0


def _without(seconds: Seconds, dead: NDArray, fill: NDArray) -> Seconds:
    """The seconds with the dead sensors marked, their means those that attitude is taken from."""
    return replace(seconds, mean=np.where(dead, fill, seconds.mean), dead=dead | seconds.dead)


def _temperature(run: Run, table: ThermalTable | None, notes: list[str]) -> GyroTemperature | None:
    if why := too_short(run.temperature):
        notes.append(
            sentence(why)
            if run.temperature is not None
            else "no gyro temperature logged: the twin's table is not applied"
        )
        return None
    assert run.temperature is not None
    found = (
        gyro_temperature(run.temperature)
        if table is None
        else gyro_temperature(run.temperature, plausible_degC=plausible_range(table))
    )
    if len(found.unusable) == 3:
        notes.append("no gyro thermometer can be used: the twin's table is not applied")
        return None
    return found


def _attitude(imu: ImuSource, rest: tuple[float, float]) -> NDArray:
    """Over the whole first rest: what boarding or rocking does to it is for the diagnosis to
    find.
    """
    return coarse.gyrocompass_dcm(coarse.rest_means(imu.between(*rest)))


def _best_attitude(
    imu: ImuSource, run: Run, seconds: Seconds, span: tuple[float, float]
) -> tuple[NDArray, float]:
    """Nominal attitude over the whole parked stretch; a surveyed heading, where there is one, with
    its sigma.
    """
    means = coarse.rest_means(imu.between(*span))
    inside = (seconds.end_s > span[0]) & (seconds.end_s <= span[1])
    # what rocks has no mean; a median of blocks keeps some of it
    rate = seconds.mean[inside, :3].mean(axis=0)
    C_nb = coarse.gyrocompass_dcm(
        coarse.RestMeans(means.f_ib_b, rate, means.sigma_omega_rad_s, means.seconds)
    )
    survey = run.header.survey
    if survey.heading_rad is None or not survey.sigma_heading_rad:
        return C_nb, np.inf
    roll, pitch, _ = euler_from_dcm(C_nb)
    return dcm_from_euler(roll, pitch, survey.heading_rad), survey.sigma_heading_rad


def _kinds(
    run: Run,
    imu: ImuSource,
    faults: Sequence[ImuFault],
    rest: tuple[float, float],
    C_nb: NDArray,
    seconds: Seconds,
    *,
    navigable: bool,
) -> NDArray:
    """PARKED, ROLLING or AIRBORNE for each second; before the first rest ROLLING.

    imu: with its `faults` repaired, or a stuck gyro would fly away.
    """
    start_s = float(np.ceil(rest[0] - 1e-6))
    kind = np.full(seconds.end_s.size, PARKED)
    kind[seconds.end_s <= start_s] = ROLLING
    if navigable:
        start = NavState(time_s=start_s, site=run.header.site, v_n_m_s=np.zeros(3), C_nb=C_nb)
        history = navigate(
            imu.pieces(start_s, imu.end_s), start, epoch_s=1.0, vertical=_vertical(run)
        )
        motion = timeline(run, history, tuple(faults))
        codes = np.select(
            [motion.kind == kinds.AIRBORNE, motion.kind >= kinds.ROLLING],
            [AIRBORNE, ROLLING],
            PARKED,
        )
        at = np.searchsorted(seconds.end_s, motion.time_s - 1e-6)
        inside = at < kind.size
        kind[at[inside]] = codes[inside]
        kind[0] = kind[1]
        _trust_phases(run, seconds, kind)
    else:
        # nothing is made of what follows; a rest ends with a row, near a full second
        kind[seconds.end_s > rest[1] + 0.5] = ROLLING
    return kind


def _trust_phases(run: Run, seconds: Seconds, kind: NDArray) -> None:
    """A phase logged as parked is believed as long as nothing accelerates the vehicle for ten
    seconds.

    The diagnosis never drops sway: rocking and gusts have no mean, a vehicle that leaves has.
    """
    force = np.stack(
        [np.convolve(c, np.ones(MEAN_S) / MEAN_S, mode="same") for c in seconds.mean[:, 3:].T],
        axis=1,
    )
    for phase in run.phases:
        if phase.phase not in PARKED_PHASES:
            continue
        own = (seconds.end_s > phase.start_s) & (seconds.end_s <= phase.end_s - MOVEMENT_EDGE_S)
        inner = (
            own
            & (seconds.end_s > seconds.end_s[0] + MEAN_S)
            & (seconds.end_s < seconds.end_s[-1] - MEAN_S)
        )
        if inner.sum() < MEAN_S:
            continue
        if (
            np.linalg.norm(force[inner] - np.median(force[inner], axis=0), axis=1) < MOVING_M_S2
        ).all():
            kind[own] = PARKED


def _longest_rest(run: Run, log: LogSeconds) -> tuple[float, float] | None:
    """The longest rest, on one heading and level, of a unit that drifts too fast for a rest to be
    told from its rates.
    """
    spans = []
    for stretch in stationary_segments(run, shortest_s=SHORTEST_LEVEL_S).stretches:
        places = parked_places(log, *stretch)
        spans += [(float(p.start_s[0]), float(p.end_s[-1])) for p in places] or [stretch]
    return max(spans, key=lambda rest: rest[1] - rest[0], default=None)


def _navigation(imu: ImuSource, run: Run, start_s: float, C_nb: NDArray) -> NavHistory:
    start = NavState(time_s=start_s, site=run.header.site, v_n_m_s=np.zeros(3), C_nb=C_nb)
    return navigate(
        imu.pieces(start_s - 2.0, imu.end_s), start, epoch_s=1.0, vertical=_vertical(run)
    )


def _vertical(run: Run) -> VerticalChannel:
    if run.gnss is None or run.gnss.time_s.size < 2 or not np.isfinite(run.gnss.height_m).all():
        return VerticalChannel(mode="hold")
    offset = run.header.site.height_m - float(run.gnss.height_m[0])
    return VerticalChannel(
        mode="aided", time_s=run.gnss.time_s, height_m=run.gnss.height_m + offset
    )


def _telemetry(
    run: Run, seconds: Seconds, kind: NDArray, C_nb: NDArray, history: NavHistory | None
) -> Telemetry:
    """Motion and force at the seconds; temperatures and the number of the run are not in it."""
    stands = standing(run, seconds.middle_s, C_nb)
    C, v, rate = stands.C_nb.copy(), stands.v_n_m_s.copy(), stands.rate_rad_s.copy()
    force, turn = stands.force_m_s2.copy(), stands.turn_rad_s.copy()
    if history is not None:
        at = np.searchsorted(seconds.end_s, history.time_s[1:] - 1e-6)
        keep = at < stands.n
        at, rows = at[keep], 1 + np.flatnonzero(keep)
        # mean over the second
        C[at] = history.C_nb_dt[rows] / np.diff(history.time_s)[rows - 1][:, None, None]
        moving = kind[at] != PARKED
        # epochs of a second: way is mean velocity
        v[at] = np.where(moving[:, None], history.displacement_n_m[rows], 0.0)
        heading = euler_from_dcm(history.C_nb)[2]
        turn[at] = np.where(moving, wrap_pi(heading[rows] - heading[rows - 1]), 0.0)
        rate[at], force[at] = seconds.mean[at, :3], seconds.mean[at, 3:]
    return replace(
        stands,
        rate_rad_s=rate,
        force_m_s2=force,
        C_nb=C,
        v_n_m_s=v,
        speed_m_s=np.einsum("nj,nj->n", C[:, :, 0], v),
        turn_rad_s=turn,
        kind=kind,
        vibration_m2_s4=_beyond_parked(seconds, kind, slice(3, 6)),
        swing_rad2_s2=_beyond_parked(seconds, kind, slice(0, 3)),
        at_range=share_at_range(run.imu, seconds.end_s, kind != PARKED),
    )


def _beyond_parked(seconds: Seconds, kind: NDArray, sensors: slice) -> NDArray:
    """Variance of some sensors' rows within each second beyond the median of the parked ones."""
    variance = seconds.scatter[:, sensors] / np.maximum(seconds.rows - 1, 1)[:, None]
    parked = (kind == PARKED) & (seconds.rows > 1)
    if not parked.any():
        return variance
    return np.asarray(np.maximum(variance - np.median(variance[parked], axis=0), 0.0))
