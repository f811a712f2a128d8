"""Whether a log is of a vehicle on wheels, and what its wheels are worth to an aided flight.

A car goes where it points (no velocity to the side or off the ground) and stays level as it turns;
an aircraft banks, a copter and a boat slip. All of it is read off a solution that the fixes hold:
the vehicle's axes in the unit are where it goes, what is left to the side and upward is slip, with
its size and its time constant, and an odometer's scale is its speed over the solution's.

What is left is not white: a tyre slips for a curve, an axis that is off stays off. Variances of
measurements a second apart are therefore those of white noise with the same effect: twice the time
constant as large, and errors of axes and scale AXES_LAST_S times, the longest outage that they are
to be honest for.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from infield.aided.reasons import WheelsFound
from ins.attitude import euler_from_dcm, rotation_vector_from_dcm, wrap_pi
from ins.earth import gravity_magnitude
from ins.filters.aided_records import AidedHistory, Wheels
from ins.filters.states import AIDED_THETA, AIDED_VEL
from ins.records import OdometerLog
from ins.robust import robust_sigma
from ins.units import DEG

BETWEEN_WHEELS_S = 1.0  # chosen: a row of the solution is 1 s; slips last as long or longer
LEAST_ROLLING_M_S = 2.0  # a velocity of 0.05 m/s is 1.4 deg of direction there
ROLLED_ROWS = 60  # a minute of rolling: slips of 5 s are told from 12 of them
LEAST_TURNED_RAD = 90.0 * DEG  # chosen: 1 corner; a straight road shows neither slip nor bank
# chosen: sigmas of a solution that fixes hold, 0.3 m/s is 10 of the default receiver's; its errors
# are in what is left and make it larger
SURE_VELOCITY_M_S, SURE_HEADING_RAD = 0.3, 3.0 * DEG
# of roll by the bank of a coordinated turn: cars lean out by up to 0.1, aircraft have 1
MOST_BANK = 0.3
LEAST_SIDEWAYS_M_S2 = 0.2  # RMS of speed times turn rate, 1.2 deg of bank; less tells none
# RMS to the side and upward, and of the speed: tyres slip by 1 to 2 deg, 0.03 is 1.7
MOST_SLIP_M_S, MOST_SLIP = 0.3, 0.03
LONGEST_SLIP_S = 30.0  # chosen: what lasts longer is an axis that is off
AXES_LAST_S = 60.0  # of errors of axes and scale: the outage that docs/replay.md measures, 60 s
# of turn rate: at 10 m/s and 0.5 m of arm an unknown no-slip point is 2.6 cm/s off, 0.15 deg
ALMOST_STRAIGHT_RAD_S = 3.0 * DEG
MOUNTED_BLOCK_S = 64.0  # chosen: a heading that wanders for a minute; a drive has 5 of them or more
SLIP_SIGMAS = 4.0  # beyond it a wheel slips: 6e-5 of Gaussian errors lie there
WHEEL_SIGMA_M_S = 0.03  # chosen: no wheel is better than a receiver's velocity, 0.03 m/s


@dataclass(frozen=True, kw_only=True)
class Mounting:
    """How the way that a vehicle goes stands in the axes of its unit.

    C_vb: vehicle axes from body axes. yaw_rad: of that way, from body x to y; pitch_rad: above the
    plane of body x and y; sigma_rad: of these two.
    """

    C_vb: NDArray
    yaw_rad: float
    pitch_rad: float
    sigma_rad: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class SeenWheels:
    """What a log shows of its wheels: `found` says whether, and why not.

    mounting: of the unit, None where it rolls too little. slip_m_s: RMS to the side and upward;
    scale: of the odometer, NaN without one; bank: roll over that of a coordinated turn.
    """

    found: WheelsFound
    wheels: Wheels | None = None
    mounting: Mounting | None = None
    slip_m_s: tuple[float, float] = (float("nan"), float("nan"))
    scale: float = float("nan")
    bank: float = float("nan")


def seen_wheels(
    history: AidedHistory,
    odometer: OdometerLog | None,
    arm_m: NDArray,
    left_out: tuple[Where, ...] = (),
    *,
    declared: bool = False,
) -> SeenWheels:
    """What the wheels of a log are worth, off a solution of it.

    left_out: stretches that say nothing, for they are to be tested. declared: it is known to be a
    car, and need not show it.
    """
    t = history.time_s
    v_b = np.einsum("kji,kj->ki", history.C_nb, history.v_n_m_s) + np.cross(_rates(history), arm_m)
    speed = np.linalg.norm(v_b, axis=1)
    held = np.sqrt(history.variance[:, AIDED_VEL].max(axis=1)) < SURE_VELOCITY_M_S
    held &= np.sqrt(history.variance[:, AIDED_THETA.start + 2]) < SURE_HEADING_RAD
    for start_s, end_s in left_out:
        held &= (t < start_s) | (t > end_s)
    rows = np.flatnonzero(held & (speed > LEAST_ROLLING_M_S))
    if rows.size < ROLLED_ROWS:
        return SeenWheels(found=WheelsFound.TOO_SHORT)
    straight = rows[np.abs(_turn_rates(history)[rows]) < ALMOST_STRAIGHT_RAD_S]
    if straight.size < ROLLED_ROWS:
        straight = rows
    C_vb = _axes(v_b[straight])
    v_v = v_b @ C_vb.T
    mounting = _mounting(C_vb, history, v_v, straight)
    bank, shown = _bank(history, C_vb, speed, rows)
    aside, up = (float(np.sqrt(np.mean(v_v[rows, k] ** 2))) for k in (1, 2))
    slip, rms = (aside, up), float(np.sqrt(np.mean(speed[rows] ** 2)))
    if not declared and np.abs(_turn_rates(history)[rows]).sum() < LEAST_TURNED_RAD:
        return SeenWheels(found=WheelsFound.TOO_STRAIGHT, mounting=mounting)
    if not declared and shown and bank > MOST_BANK:
        return SeenWheels(found=WheelsFound.BANKS, bank=bank, mounting=mounting)
    if not declared and max(slip) > max(MOST_SLIP_M_S, MOST_SLIP * rms):
        return SeenWheels(found=WheelsFound.SLIPS, bank=bank, slip_m_s=slip, mounting=mounting)
    forward, scale = _forward(odometer, t, v_v[:, 0], rows)
    side = [_white(v_v[rows, k], t[rows], speed, rms) for k in (1, 2)]
    ahead = _white((forward - v_v[:, 0])[rows], t[rows], speed, rms)
    return SeenWheels(
        found=WheelsFound.ROLLS,
        wheels=Wheels(
            time_s=t,
            speed_m_s=forward,
            variance=np.column_stack([ahead, *side]),
            C_vb=C_vb,
            arm_m=arm_m,
        ),
        mounting=mounting,
        slip_m_s=slip,
        scale=scale,
        bank=bank,
    )


def _rates(history: AidedHistory) -> NDArray:
    """Angular rates (k, 3) in body axes between the rows before and after each [rad/s]."""
    C, t = history.C_nb, history.time_s
    after, before = (
        np.minimum(np.arange(t.size) + 1, t.size - 1),
        np.maximum(np.arange(t.size) - 1, 0),
    )
    turned = rotation_vector_from_dcm(np.swapaxes(C[before], 1, 2) @ C[after])
    return np.asarray(turned / (t[after] - t[before])[:, None])


def _turn_rates(history: AidedHistory) -> NDArray:
    """Of the heading (k,) [rad/s], as rows follow each other."""
    heading = np.arctan2(history.C_nb[:, 1, 0], history.C_nb[:, 0, 0])
    return np.asarray(np.gradient(np.unwrap(heading), history.time_s))


def _axes(v_b: NDArray) -> NDArray:
    """Vehicle axes from body axes (3, 3): forward is where it goes, down is near body z."""
    forward = v_b.mean(axis=0)
    forward = forward / np.linalg.norm(forward)
    down = np.array([0.0, 0.0, 1.0]) - forward[2] * forward
    down = down / np.linalg.norm(down)
    return np.stack([forward, np.cross(down, forward), down])


def _bank(
    history: AidedHistory, C_vb: NDArray, speed_m_s: NDArray, rows: NDArray
) -> tuple[float, bool]:
    """Slope of the roll over that of a coordinated turn; whether turns show it."""
    force = (speed_m_s * _turn_rates(history))[rows]
    if float(np.sqrt(np.mean(force**2))) < LEAST_SIDEWAYS_M_S2:
        return float("nan"), False
    roll = euler_from_dcm(history.C_nb[rows] @ C_vb.T)[0]
    gravity = float(gravity_magnitude(history.lat_rad[0], history.height_m[0]))
    bank = np.arctan(force / gravity)
    bank, roll = bank - bank.mean(), wrap_pi(roll - roll.mean())
    return float(roll @ bank / (bank @ bank)), True


def _forward(
    odometer: OdometerLog | None, t: NDArray, v_x: NDArray, rows: NDArray
) -> tuple[NDArray, float]:
    """Speed of the odometer at these times less its scale, NaN where none tells it; the scale."""
    none = np.full(t.size, np.nan)
    if odometer is None or odometer.time_s.size < ROLLED_ROWS:
        return none, float("nan")
    told = np.interp(t, odometer.time_s, odometer.speed_m_s)
    near = np.clip(np.searchsorted(odometer.time_s, t), 1, odometer.time_s.size - 1)
    apart = np.minimum(t - odometer.time_s[near - 1], odometer.time_s[near] - t)
    told = np.where(np.abs(apart) < BETWEEN_WHEELS_S, told, np.nan)
    both = rows[np.isfinite(told[rows])]
    if both.size < ROLLED_ROWS:
        return none, float("nan")
    scale = float(np.median(told[both] / v_x[both]))
    return told / scale, scale


def _white(left_m_s: NDArray, time_s: NDArray, speed_m_s: NDArray, rms_speed: float) -> NDArray:
    """Variance (k,) of white noise BETWEEN_WHEELS_S apart that does what these residuals do over
    AXES_LAST_S.
    """
    seen = np.isfinite(left_m_s)
    if not seen.any():
        return np.ones(speed_m_s.size)  # of a speed that nothing tells
    slip = _slip(left_m_s[seen], time_s[seen])
    axis = slip.mean_m_s / rms_speed
    return np.asarray(
        slip.rms_m_s**2 * 2.0 * slip.lasts_s / BETWEEN_WHEELS_S
        + (axis * speed_m_s) ** 2 * AXES_LAST_S / BETWEEN_WHEELS_S
    )


@dataclass(frozen=True, kw_only=True)
class _Slip:
    """RMS of a slip [m/s], how long it lasts [s], and the sigma of its mean [m/s]."""

    rms_m_s: float
    lasts_s: float
    mean_m_s: float


def _slip(left: NDArray, t: NDArray) -> _Slip:
    """What residual velocities are as a process that lasts."""
    rms = max(robust_sigma(left), WHEEL_SIGMA_M_S)
    left = np.clip(left, -SLIP_SIGMAS * rms, SLIP_SIGMAS * rms)
    next_to = np.diff(t) < 1.5 * BETWEEN_WHEELS_S
    alike = float(np.mean(left[1:][next_to] * left[:-1][next_to])) / rms**2
    lasts = float(
        np.clip(-1.0 / np.log(np.clip(alike, 1e-3, 0.999)), 0.5 * BETWEEN_WHEELS_S, LONGEST_SLIP_S)
    )
    return _Slip(rms_m_s=rms, lasts_s=lasts, mean_m_s=rms * float(np.sqrt(2.0 * lasts / left.size)))


def _mounting(C_vb: NDArray, history: AidedHistory, v_v: NDArray, rows: NDArray) -> Mounting:
    """The angles of the vehicle's axes in the unit from these rows; what the attitude of the
    solution may be off throughout, its least sigma, is in theirs.
    """
    forward = C_vb[0]
    speed = float(np.sqrt(np.mean(v_v[rows, 0] ** 2)))
    attitude = np.sqrt(history.variance[rows][:, AIDED_THETA].min(axis=0))
    off = float(attitude[2]), float(attitude[:2].max())
    shown = [_mean_sigma(v_v[rows, k], history.time_s[rows]) / speed for k in (1, 2)]
    return Mounting(
        C_vb=C_vb,
        yaw_rad=float(np.arctan2(forward[1], forward[0])),
        pitch_rad=float(-np.arcsin(forward[2])),
        sigma_rad=(float(np.hypot(off[0], shown[0])), float(np.hypot(off[1], shown[1]))),
    )


def _mean_sigma(values: NDArray, time_s: NDArray) -> float:
    """Sigma of a mean: the largest that means over blocks of a row to MOUNTED_BLOCK_S show."""
    found = []
    length_s = BETWEEN_WHEELS_S
    while length_s <= MOUNTED_BLOCK_S:
        _, block = np.unique(np.floor(time_s / length_s), return_inverse=True)
        count = np.bincount(block)
        means = np.bincount(block, values - values.mean()) / count
        found.append(float(np.sqrt(np.sum((count * means) ** 2)) / values.size))
        length_s *= 2.0
    return max(found)
