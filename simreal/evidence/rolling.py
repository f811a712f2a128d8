"""What follows the parked stretch: innovations of the navigation-mode filter, whitened, for the
data and every signature.

The nominal solution starts at the end of the parked stretch; its errors obey
`ins.estimation.error_model`, and the wheels (no side slip), odometer, GNSS and stops measure them
as in `infield.session.navigated.taxi_heading`. The filter is linear, so its gains are worked out
once and then replayed: a column is the data, or what an effect would add to them::

    e- = Phi e + u,   nu = H e- + m,   e+ = e- - K nu

e: state that the effect makes less what the filter makes of it; u: sensor errors over the step; m:
the effect's own part in the measurement.

Decision: docs/decisions/0078-fixes-as-innovations.md.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dger

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
from ins.estimation.measurements.antenna import RowSums
from ins.estimation.tape import ADD, ADVANCE, MEASURE, Compiled, Steps, Tape
from ins.records import TwinModel
from ins.units import ARCSEC, DEG_PER_HOUR, MILLIRADIAN, PPM
from simreal.evidence.noise_model import oscillator
from simreal.evidence.parked import Handoff
from simreal.evidence.parked_fixes import ParkedFixes
from simreal.evidence.run_view import RunView

GYRO_STATES = slice(em.BASE, em.BASE + 3)
ROLLING_STATES = em.BASE + 3  # base states, the 3 gyros
# of the vertical accelerometer: banked, a part of its bias is level; 80 ug through a turn at 20 deg
# were 6 sigma
ACCEL_Z = em.ACCEL_Z
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
        self.views, self.program = _lay_down(view, twin)
        self.compiled = self.program.compiled()
        self.seconds = _step_seconds(view, self.views)
        self._noise = process_noise(twin)
        self._x0, self._P0 = _start(twin, start, fixes, view.C_nb)
        self._walk = _bias_walk(twin)
        self._work_out()

    @property
    def rows(self) -> int:
        return len(self.labels.time_s)

    def _work_out(self) -> None:
        """Transition and gains of every step, once: the covariance does not depend on data."""
        c, steps, now = self.compiled, self.program.steps, 0
        made = {
            int(op[1]): _transition(steps, int(op[1]), self._noise)
            for op in c.ops
            if op[0] == ADVANCE
        }
        # states that nothing moves, starts or reads are left out: half of them
        self._at = _taking_part(made.values(), c, self._P0, self._x0)
        at = np.ix_(self._at, self._at)
        self._place = np.full(ROLLING_STATES, -1)
        self._place[self._at] = np.arange(self._at.size)
        P, walk = self._P0[at].copy(), self._walk[self._at]
        self._steps: dict[int, tuple[NDArray, NDArray]] = {}
        self._rows: list[tuple[NDArray, NDArray, NDArray, float]] = []
        labels = []
        diagonal = np.diag_indices(self._at.size)
        for number, (kind, which, first, count) in enumerate(c.ops):
            own = int(self._place[which]) if kind not in (ADVANCE, MEASURE) else -1
            if kind == ADVANCE:
                now = int(which)
                Phi, Gamma, Q = made[now]
                entering = self._entering(Phi, Gamma, now)
                Phi = np.ascontiguousarray(Phi[at])
                P = Phi @ P @ Phi.T + Q[at]
                P[diagonal] += walk * steps.dt_s[now]
                self._steps[now] = Phi, entering
            elif kind == ADD:
                P[own, own] += c.variance[first]
            elif kind == MEASURE:
                for r in range(first, first + count):
                    index, value = self._read(r)
                    v = P[:, index] @ value
                    root = float(np.sqrt(value @ v[index] + c.variance[r]))
                    P -= np.outer(v, v / root**2)
                    self._rows.append((index, value, v / root, root))
                    labels.append(
                        (
                            steps.end_s[now],
                            CHANNEL[c.names[c.name[number]]],
                            KIND[Kind(self.views.kind[now])],
                            root**2,
                        )
                    )
            else:
                M = np.eye(self._at.size)
                M[own] = self._combined(first)
                P = M @ P @ M.T
                P[own, own] += c.variance[first]
        time_s, channel, kinds, variance = zip(*labels) if labels else ((), (), (), ())
        self.labels = RollingRows(
            np.array(time_s), np.array(channel, dtype=object), np.array(kinds), np.array(variance)
        )

    def _entering(self, Phi: NDArray, Gamma: NDArray, now: int) -> NDArray:
        """What a unit of each sensor's error over a step does to the states (6, states)."""
        out = np.zeros((6, ROLLING_STATES))
        out[:3] = Gamma.T
        out[3:5] = Phi[:, em.ACCEL].T
        out[3:5, em.ACCEL] -= np.eye(2)
        steps = self.program.steps
        out[5, em.W] = steps.C_nb[now][:2, 2] * steps.dt_s[now]
        return np.ascontiguousarray(out[:, self._at])

    def _read(self, row: int) -> tuple[NDArray, NDArray]:
        """Places and factors of the states that a row of the program reads."""
        read = self.compiled.value[row] != 0.0
        return self._place[self.compiled.index[row][read]], self.compiled.value[row][read]

    def _combined(self, row: int) -> NDArray:
        """A row of the program as a combination of the states that take part."""
        return _row(self.compiled.index[row], self.compiled.value[row])[self._at]

    def whiten_data(self) -> NDArray:
        """Innovations of the run itself over their sigmas (rows,)."""
        c = self.compiled
        return self._replay(-self._x0[:, None], None, lambda r, _: c.z[r])[:, 0]

    def whiten(self, traces: list[Trace], start: Handoff, site_m: NDArray) -> NDArray:
        """What effects add to the innovations (rows, m); start, site_m (2, m): what the parked
        stretch made of them.
        """
        m = len(traces)
        imu = np.zeros((len(self.seconds), 6, m))
        # lateral, odometer, GNSS north, east, velocity north, east
        own = np.zeros((len(self.seconds), 6, m))
        for array, at, name in (
            (imu, slice(0, 3), "gyro_rad_s"),
            (imu, slice(3, 6), "accel_m_s2"),
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
        e = np.zeros((ROLLING_STATES, m))
        _set_start(e, -start.mean)
        e[em.POS] = -site_m
        dt = self.program.steps.dt_s
        names, names_of = self.compiled.names, self._name_of_row()

        def measured(r: int, step: int) -> NDArray:
            name, first_state = names[names_of[r]], int(self.compiled.index[r][0])
            if name == "lateral":
                return own[step, 0] * dt[step]
            if name == "odometer":
                return -own[step, 1] * dt[step]
            if name == "gnss":
                return -own[
                    step,
                    (
                        2 + first_state - em.POS.start
                        if first_state >= em.POS.start
                        else 4 + first_state
                    ),
                ]
            return np.zeros(m)

        return self._replay(e, imu, measured)

    def _name_of_row(self) -> NDArray:
        c = self.compiled
        out = np.zeros(len(c.z), dtype=int)
        for number, (_, _, first, count) in enumerate(c.ops):
            out[first : first + count] = c.name[number]
        return out

    def _replay(
        self, e: NDArray, imu: NDArray | None, measured: Callable[[int, int], NDArray | float]
    ) -> NDArray:
        c, place = self.compiled, self._place
        out = np.zeros((len(self._rows), e.shape[1]))
        row, now = 0, 0
        # a row a column: the updates below then run along memory
        E = np.ascontiguousarray(e[self._at].T)
        for kind, which, first, count in c.ops:
            if kind == ADVANCE:
                now = int(which)
                Phi, entering = self._steps[now]
                E = E @ Phi.T
                if imu is not None:
                    E += imu[now].T @ entering
            elif kind == MEASURE:
                for r in range(first, first + count):
                    index, value, gain, root = self._rows[row]
                    nu = (E[:, index] @ value + measured(r, now)) / root
                    dger(-1.0, gain, nu, a=E.T, overwrite_a=1)  # E -= outer(nu, gain), in place
                    out[row] = nu
                    row += 1
            elif kind != ADD:
                E[:, place[which]] = E @ self._combined(first)
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
    program = Tape(filter_steps(views))
    parked = ParkedConstraint(displacement_sigma_m=sway, yaw_jitter_rad=YAW_JITTER_RAD)
    hold_position(program, views, parked)
    hold_heading(program, views, parked)
    on_wheels = replace(views, kind=np.where(flying, AIR, views.kind), jitter_m=_sway_way(twin))
    for aid in _aids(view, twin):
        aid.measure(program, views if isinstance(aid, GnssAid) else on_wheels)
    return on_wheels, program


def _level(views: StepViews) -> StepViews:
    """The way in body axes by the level velocity alone: the vertical loop's own velocity, seen
    through the unit's tilt, is

    no way of the wheels (on a slope s of the ground this leaves s^2 of the way).
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


def _transition(steps: Steps, k: int, noise: em.ProcessNoise) -> tuple[NDArray, NDArray, NDArray]:
    """Phi, Gamma (of a gyro error over the step), Q with the gyro biases appended as constants."""
    v = steps.v_n[k]
    east, north, down = steps.transport[k]
    step = em.Step(
        dt_s=float(steps.dt_s[k]),
        C_nb=steps.C_nb[k],
        v_n=v,
        omega_ie_n=steps.omega_ie_n[k],
        omega_en_n=np.array([east * v[1], -north * v[0], -down * v[1]]),
        gravity=float(steps.gravity[k]),
        radius_m=float(steps.radius_m[k]),
        turn_rad=float(steps.turn_rad[k]),
    )
    Phi, Gamma, Q = em.discretize(
        step, noise, rolling=bool(steps.rolling[k]), keep_displacement=bool(steps.keep[k])
    )
    full, noise_full = np.eye(ROLLING_STATES), np.zeros((ROLLING_STATES, ROLLING_STATES))
    full[: em.BASE, : em.BASE] = Phi
    full[: em.BASE, GYRO_STATES] = Gamma[:, :3]
    full[em.W, ACCEL_Z] = steps.C_nb[k][:2, 2] * steps.dt_s[k]
    noise_full[: em.BASE, : em.BASE] = Q
    return full, full[:, GYRO_STATES] * (np.arange(ROLLING_STATES) < em.BASE)[:, None], noise_full


def _taking_part(
    made: Iterable[tuple[NDArray, NDArray, NDArray]], compiled: Compiled, P0: NDArray, x0: NDArray
) -> NDArray:
    """Numbers of the states that a step moves, a row of the program reads or the start knows of."""
    seen = (np.diag(P0) != 0.0) | (x0 != 0.0)
    for Phi, Gamma, _ in made:
        moves = Phi != np.eye(ROLLING_STATES)
        seen |= moves.any(axis=0) | moves.any(axis=1) | Gamma.any(axis=1)
    for index, value in zip(compiled.index, compiled.value):
        seen[index[value != 0.0]] = True
    for kind, which, *_ in compiled.ops:
        if kind not in (ADVANCE, MEASURE):
            seen[which] = True
    seen[[*_start_states(), *range(em.W.start, em.W.stop), *range(em.POS.start, em.POS.stop)]] = (
        True
    )
    return np.flatnonzero(seen)


def _row(index: NDArray, value: NDArray) -> NDArray:
    h = np.zeros(ROLLING_STATES)
    np.add.at(h, index, value)
    return h


def _start(
    twin: TwinModel, start: Handoff, fixes: ParkedFixes, C_nb: NDArray
) -> tuple[NDArray, NDArray]:
    """State and covariance at the end of the parked stretch (column 0 of the handoff is the
    data).
    """
    x, P = np.zeros((ROLLING_STATES, 1)), np.zeros((ROLLING_STATES, ROLLING_STATES))
    _set_start(x, start.mean[:, :1])
    x[em.KAPPA] = -twin.vehicle.crab_mrad * MILLIRADIAN
    x[em.ODOMETER] = twin.odometer.scale_ppm * PPM
    at = _start_states()
    P[np.ix_(at, at)] = start.covariance
    P[em.W, em.W] = np.eye(2) * max(twin.vehicle.sway_m_s, 1e-4) ** 2
    x[em.POS, 0] = fixes.whiten_data()[1]
    P[em.POS, em.POS] = np.eye(2) * fixes.site_variance_m2
    # of the unit on its wheels: body axes are not quite the wheels'
    tilt = np.arccos(min(abs(float(C_nb[2, 2])), 1.0))
    P[em.ODOMETER, em.ODOMETER] = P[em.KAPPA, em.KAPPA] = (0.5 * tilt**2) ** 2
    P[em.LATERAL, em.LATERAL] = max(twin.vehicle.lateral_noise_m_s, 1e-3) ** 2
    return x[:, 0], P


def _start_states() -> list[int]:
    """Where phi, the gyro biases and the accelerometer biases sit."""
    return [
        *range(em.THETA.start, em.THETA.stop),
        *range(GYRO_STATES.start, GYRO_STATES.stop),
        *range(em.ACCEL.start, em.ACCEL.stop),
        ACCEL_Z,
    ]


def _set_start(e: NDArray, mean: NDArray) -> None:
    e[_start_states()] = mean


def _bias_walk(twin: TwinModel) -> NDArray:
    """Variance per second by which the gyro biases wander: random walk and a walk that reaches the
    flicker in an hour.
    """
    walk = (
        np.hypot(twin.gyro.rate_random_walk_deg_h_sqrt_h, twin.gyro.bias_instability_deg_h)
        * DEG_PER_HOUR
        / 60.0
    )
    out = np.zeros(ROLLING_STATES)
    out[GYRO_STATES] = walk**2
    return out
