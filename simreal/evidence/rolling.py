"""What follows the parked stretch: innovations of the navigation-mode filter, whitened, for the
data and every signature.

The nominal solution starts at the end of the parked stretch; its errors obey
`ins.estimation.error_model`, and the wheels (no side slip), odometer, GNSS and stops measure them
as in `infield.session.navigated.taxi_heading`. The filter is linear: the gains of its sweep over
the data serve every signature (`ins.estimation.error_filter.Response`).

Decision: docs/decisions/0078-fixes-as-innovations.md.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.kinds import AIRBORNE as AIR
from alignment.motion.kinds import DISTURBED, STILL, Kind
from alignment.motion.kinds import ROLLING as ROLL
from alignment.motion.stillness import Motion
from alignment.navigation_filter import (
    Aid,
    ParkedConstraint,
    StepViews,
    declared_sway_m,
    filter_steps,
    hold_heading,
    hold_position,
    plan_steps,
    process_noise,
    views_of,
)
from infield.session.navigated.taxi_heading import LATERAL_FLOOR_M, GnssAid, LateralAid, OdometerAid
from ins.errors.telemetry import AIRBORNE, PARKED, ROLLING, Trace, stacked
from ins.estimation import error_model as em
from ins.estimation.error_filter import ErrorFilter
from ins.estimation.measurements.antenna import RowSums
from ins.estimation.sensors import accelerometer_biases, bin_biases
from ins.estimation.tape import ACCELEROMETER, GYRO, INPUTS, Tape
from ins.noise import walk_with_flicker
from ins.records import TwinModel
from ins.units import ARCSEC, DEG_PER_HOUR, MILLIRADIAN, PPM
from simreal.evidence.noise_model import oscillator
from simreal.evidence.parked import Handoff
from simreal.evidence.parked_fixes import ParkedFixes
from simreal.evidence.run_view import RunView

GYRO_STATES = range(em.BASE, em.BASE + 3)
# banked, a part of the vertical accelerometer's bias is level: 80 ug through a turn at 20 deg were
# 6 sigma
ACCEL_STATES = range(em.ACCEL.start, em.ACCEL_Z + 1)
# phi, gyro biases, accelerometer biases: in the order of a handoff
START_STATES = [*range(em.THETA.start, em.THETA.stop), *GYRO_STATES, *ACCEL_STATES]
YAW_JITTER_RAD = 0.1 * ARCSEC
# seconds at both ends of a stop in which the vehicle may still roll; chosen: BRAKING_S (2) of
# alignment.motion.timeline, and 3 of a late receiver
STOP_EDGE = 5
CHANNEL = {
    "lateral": "vehicle",
    "odometer": "odometer",
    "gnss": "gnss",
    "still": "vehicle",
    "stop": "vehicle",
    "heading held": "gyro_z",
}


@dataclass(frozen=True)
class RollingRows:
    """Labels of the whitened rows (k): time, channel ("vehicle", "odometer", "gnss", "gyro_z"),
    kind as in Telemetry.
    """

    time_s: NDArray
    channel: NDArray
    kind: NDArray
    variance: NDArray


class RollingBlock:
    """Whitening of what a run shows after its parked stretch."""

    def __init__(self, view: RunView, twin: TwinModel, start: Handoff, fixes: ParkedFixes) -> None:
        self.views, tape = _lay_down(view, twin)
        compiled = tape.compiled()
        # no gate: what is far off is what the diagnosis is asked about
        self.tape = compiled.under(compiled.variance, dict.fromkeys(compiled.names, np.inf))
        self.seconds = _step_seconds(view, self.views)
        flt = _filter(twin, start, fixes, view.C_nb)
        self._states = flt.x.size
        self._response = flt.run_for_response(self.tape)
        operation = self.tape.operation_of_row
        self._name = np.array(self.tape.names)[self.tape.name[operation]]
        self._step = np.searchsorted(self.views.end_s, self.tape.time_s[operation])
        used = self._response.used_rows
        self.labels = RollingRows(
            self.views.end_s[self._step[used]],
            np.array([CHANNEL[name] for name in self._name[used]], dtype=object),
            np.array([KIND[Kind(kind)] for kind in self.views.kind[self._step[used]]]),
            self._response.spread[used],
        )

    @property
    def rows(self) -> int:
        return len(self.labels.time_s)

    def whiten_data(self) -> NDArray:
        """Innovations of the run itself over their sigmas (rows,)."""
        return self._response.normalised[self._response.used_rows]

    def whiten(self, traces: list[Trace], start: Handoff, site_m: NDArray) -> NDArray:
        """What effects add to the innovations (rows, m); start, site_m (2, m): what the parked
        stretch made of them.
        """
        m = len(traces)
        sensed = np.zeros((len(self.seconds), INPUTS, m))
        # lateral, odometer, GNSS north, east, velocity north, east
        own = np.zeros((len(self.seconds), 6, m))
        for array, at, name in (
            (sensed, slice(GYRO, GYRO + 3), "gyro_rad_s"),
            (sensed, slice(ACCELEROMETER, ACCELEROMETER + 3), "accel_m_s2"),
            (own, slice(0, 1), "lateral_m_s"),
            (own, slice(1, 2), "odometer_m_s"),
            (own, slice(2, 4), "gnss_position_m"),
            (own, slice(4, 6), "gnss_velocity_m_s"),
        ):
            # read at the end of a step, the others over it
            fixes = array is own and at.start >= 2
            follows = slice(None) if fixes else slice(int(self.seconds[0, 0]), None)
            for held, series in stacked(traces, name, follows):
                array[:, at, held] = self._ends(series) if fixes else self._means(series, at)
        e = np.zeros((self._states, m))
        e[START_STATES] = -start.mean
        e[em.POS] = -site_m
        return self._response.of(e, sensed, self._measured(own))

    def _measured(self, own: NDArray) -> NDArray:
        """What each row's measured value is changed by (rows, m); own (K, 6, m): as of `whiten`."""
        out = np.zeros((len(self._name), own.shape[2]))
        dt, first_state = self.views.dt_s[self._step], self.tape.index[self.tape.first_entry[:-1]]
        for name, state, column, factor in (
            ("lateral", em.S.start + 1, 0, dt),
            ("odometer", em.S.start, 1, -dt),
            ("gnss", em.POS.start, 2, -np.ones_like(dt)),
            ("gnss", em.POS.start + 1, 3, -np.ones_like(dt)),
            ("gnss", em.W.start, 4, -np.ones_like(dt)),
            ("gnss", em.W.start + 1, 5, -np.ones_like(dt)),
        ):
            rows = np.flatnonzero((self._name == name) & (first_state == state))
            out[rows] = factor[rows, None] * own[self._step[rows], column]
        return out

    def _means(self, series: NDArray, at: slice) -> NDArray:
        """Means of traces (rows, ..., k), from the first step's row on, over the steps
        (K, width, k).
        """
        width, count = at.stop - at.start, series.shape[-1]
        columns = series.reshape(len(series), -1, count)[:, :width]
        sums = np.concatenate([np.zeros((1, width, count)), np.cumsum(columns, axis=0)])
        first, last = self.seconds.T - self.seconds[0, 0]
        return np.asarray((sums[last] - sums[first]) / np.maximum(last - first, 1)[:, None, None])

    def _ends(self, series: NDArray) -> NDArray:
        """North and east of traces (rows, 3, k) at the ends of the steps (K, 2, k): between the
        middles of the seconds.
        """
        last = self.seconds[:, 1]
        after = np.minimum(last, len(series) - 1)
        return np.asarray(0.5 * (series[np.maximum(last - 1, 0), :2] + series[after, :2]))


KIND = {STILL: PARKED, DISTURBED: PARKED, ROLL: ROLLING, AIR: AIRBORNE}


def _lay_down(view: RunView, twin: TwinModel) -> tuple[StepViews, Tape]:
    """The filter's steps and measurements over the solution, as
    `alignment.navigation_filter.lay_down` lays them down.
    """
    history = view.history
    assert history is not None
    codes = {PARKED: STILL, ROLLING: ROLL, AIRBORNE: AIR}
    at = np.clip(
        np.searchsorted(view.seconds.end_s, history.time_s - 1e-6), 0, view.seconds.end_s.size - 1
    )
    kind = np.array([codes[int(k)] for k in view.telemetry.kind[at]])
    moves = (kind == ROLL) | (kind == AIR)  # a landing's roll-out may be told airborne to its end
    rolls = np.convolve(moves, np.ones(2 * STOP_EDGE + 1), mode="same") > 0.5
    kind[rolls & (kind == STILL)] = ROLL  # the wheels do not slip while they stand either
    motion = Motion(history.time_s, kind.copy(), np.zeros(len(kind)), 0.0)
    airborne = np.flatnonzero(kind == AIR)
    with_gnss = view.run.gnss is not None
    until = history.time_s[airborne[0]] - 0.5 if airborne.size and not with_gnss else np.inf
    motion.kind[kind == AIR] = ROLL  # one epoch a step; the wheels are left out below
    edges = np.array([history.time_s[0], history.time_s[-1] + 1.0])
    plan = plan_steps(motion, edges, until_s=until)
    sway = declared_sway_m(twin)
    views = _level(views_of(history, plan, sway))
    flying = np.zeros(len(views.end_s), bool)
    flying[:] = kind[plan.last] == AIR
    # linearised about the solution itself, so that one sweep's gains serve every signature
    steps = replace(filter_steps(views), moving=np.zeros(len(views.end_s), bool))
    tape = Tape(steps)
    bin_biases(tape, GYRO_STATES.start)
    accelerometer_biases(tape, ACCEL_STATES)
    place_m, yaw_rad = sway, YAW_JITTER_RAD
    if view.motion is not None:
        place_m = float(np.hypot(sway, view.motion.sway_m_s / (2.0 * np.pi * twin.vehicle.sway_hz)))
        yaw_rad = max(yaw_rad, view.motion.yaw_rad)
    parked = ParkedConstraint(displacement_sigma_m=place_m, yaw_jitter_rad=yaw_rad)
    hold_position(tape, views, parked)
    hold_heading(tape, views, parked)
    on_wheels = replace(views, kind=np.where(flying, AIR, views.kind), jitter_m=_sway_way(twin))
    for aid in _aids(view, twin):
        aid.measure(tape, views if isinstance(aid, GnssAid) else on_wheels)
    return on_wheels, tape


def _level(views: StepViews) -> StepViews:
    """The way in body axes by the level velocity alone: the vertical loop's own velocity, seen
    through the unit's tilt, is no way of the wheels (on a slope s this leaves s^2 of the way).
    """
    down = views.C_mean[:, 2, :] * views.displacement_n_m[:, 2:3]
    return replace(views, displacement_b_m=views.displacement_b_m - down)


def _aids(view: RunView, twin: TwinModel) -> list[Aid]:
    header, run = view.run.header, view.run
    aids: list[Aid] = [LateralAid(header.wheel_reference_m)]
    if run.odometer is not None and run.odometer.time_s.size > 1:
        n = max(round(1.0 / float(np.median(np.diff(run.odometer.time_s)))), 1)
        # the way of n intervals of 1/n s by trapezoids; the aid takes n - 1 independent samples
        noise_m_s = twin.odometer.noise_m_s * (np.sqrt((n - 0.5) * (n - 1)) / n if n > 1 else 1.0)
        # the unit sways on its wheels, over the second as a whole
        noise_m_s = float(np.hypot(noise_m_s, np.sqrt(max(n - 1, 1) * _sway_variance(twin))))
        aids.append(OdometerAid(run.odometer, noise_m_s, header.wheel_reference_m))
    if run.gnss is not None and run.gnss.time_s.size > 1:
        noise = twin.gnss
        bare = replace(
            run.gnss, sigma_horizontal_m=None, sigma_vertical_m=None, sigma_velocity_m_s=None
        )
        aids.append(
            GnssAid(
                bare,
                RowSums(run.imu),
                header.gnss_lever_arm_m,
                noise.sigma_horizontal_m,
                noise.sigma_velocity_m_s,
            )
        )
    return aids


def _sway_way(twin: TwinModel) -> float:
    """The jitter that gives a step of a second the variance that sway gives its way
    (`taxi_heading._way_variance`).
    """
    return float(np.sqrt(max(0.5 * (_sway_variance(twin) - LATERAL_FLOOR_M**2), 0.0)))


def _sway_variance(twin: TwinModel) -> float:
    """Variance of the way [m^2] that sway makes over a second."""
    v = twin.vehicle
    w = 2.0 * np.pi * max(v.sway_hz, 1e-3)
    # integral of the velocity's autocorrelation, triangle weight
    fine = np.arange(-20, 20) / 20.0 + 0.025
    weight = (1.0 - np.abs(fine)) * oscillator(np.abs(fine), w, v.sway_damping)
    return 2.0 * v.sway_m_s**2 * float(np.mean(weight))


def _step_seconds(view: RunView, views: StepViews) -> NDArray:
    """First and last row (K, 2) of the seconds that each step holds."""
    end = view.seconds.end_s
    return np.stack(
        [np.searchsorted(end, views.start_s + 1e-6), np.searchsorted(end, views.end_s + 1e-6)],
        axis=1,
    )


def _filter(twin: TwinModel, start: Handoff, fixes: ParkedFixes, C_nb: NDArray) -> ErrorFilter:
    """The filter at the end of the parked stretch (column 0 of the handoff is the data)."""
    # of the unit on its wheels: body axes are not quite the wheels'
    tilt = np.arccos(min(abs(float(C_nb[2, 2])), 1.0))
    # a random walk, and one that reaches the flicker in an hour
    walk = walk_with_flicker(
        twin.gyro.rate_random_walk_deg_h_sqrt_h, twin.gyro.bias_instability_deg_h
    )
    flt = ErrorFilter(
        sigma0={
            "W": max(twin.vehicle.sway_m_s, 1e-4),
            "POS": np.sqrt(fixes.site_variance_m2),
            "LATERAL": max(twin.vehicle.lateral_noise_m_s, 1e-3),
            "ODOMETER": 0.5 * tilt**2,
            "KAPPA": 0.5 * tilt**2,
        },
        noise=process_noise(twin),
        bias_mean=start.mean[3:6, 0],
        bias_covariance=start.covariance[3:6, 3:6],
        further_walks=dict.fromkeys(GYRO_STATES, (walk * DEG_PER_HOUR / 60.0) ** 2),
    )
    flt.x[START_STATES] = start.mean[:, 0]
    flt.P[np.ix_(START_STATES, START_STATES)] = start.covariance
    flt.x[em.POS] = fixes.whiten_data()[1]
    flt.x[em.KAPPA] = -twin.vehicle.crab_mrad * MILLIRADIAN
    flt.x[em.ODOMETER] = twin.odometer.scale_ppm * PPM
    return flt
