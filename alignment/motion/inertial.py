"""What the inertial rows alone say of rest, from the seconds of a log.

Three questions, each with its limits here and nowhere else. `first_rest`: a minute and more on
which a gyrocompass may start, bumps allowed, judged on ten-second means. `quiet_stretches`: where a
unit that finds no north scatters no more than in its own quiet seconds. `steady_seconds`: seconds
in which force and rate do not change, which a steady roll does not either, so that a receiver must
agree (`alignment.motion.speeds`).
"""

import numpy as np
from numpy.typing import NDArray

from alignment.motion.seconds import Blocks, LogSeconds
from ins.robust import robust_sigmas, runs_of_true

Where = tuple[float, float]

REST_BLOCKS = 6  # of 10 s: less than a minute is no rest (tests/alignment/test_motion_timeline.py)
# half a minute shows a level, which is all that gyros find which find no heading: scatter of the
# blocks is judged on three (tests/alignment/test_gyrocompass.py)
BRIEF_BLOCKS = 3
REST_FORCE_M_S2 = 0.03  # of a block mean off its stretch's median: 3 mrad of tilt
REST_RATE_RAD_S = 3e-4  # 62 deg/h, four times Earth rate: a vehicle that turns a degree a minute
# Where the gyros see the body tilt (people, loading), force and rate may follow: a turn since the
# stretch began of 1 deg, no faster than a vehicle that turns on the spot.
REST_TILT_RAD = 0.02
REST_TILT_RATE_RAD_S = 2e-3  # as PIVOT_RAD_S of motion.stillness, 0.11 deg/s
# block means that scatter by more (0.17 deg/s, 0.3 m/s^2) are a vehicle that moves, not a noisy
# unit
NOISIEST = 10.0
# of rest for the first attitude: more only adds the warm-up's drift; 10 min, as the alignment of
# the reference scenario (requirements.md; tests/alignment/test_coarse.py)
LONGEST_COARSE_S = 600.0

WINDOW = 10  # seconds over which scatter is taken
# the quietest minute of the log is where the quiet level is looked for: six windows of 10 s
QUIET_S = 60.0
QUIETEST = 0.6  # of a sigma: RMS of the quietest of many windows
# times the quiet scatter is motion: of 10 Gaussian steps 5e-15 scatter by as much; at half of it
# tests/alignment/test_parked_seconds.py fails
LOUD = 3.0
# m/s^2 and rad/s of scatter: beyond, a vehicle that moves, not a noisy unit
CAPS = np.array([NOISIEST * REST_FORCE_M_S2] * 3 + [NOISIEST * REST_RATE_RAD_S] * 3)
# 9.78 to 9.83 anywhere; consumer accelerometers are off by up to 60 mg (0.6 m/s^2)
GRAVITY_M_S2, GRAVITY_LIMIT_M_S2 = 9.81, 1.0
SPIN_RAD_S = 0.35  # 20 deg/s: the zero-rate output of a consumer gyro may be that large
# parts of a turn this near belong together; chosen: a vehicle that halts for 30 s has stopped
TURN_PARTS_S = 15
# of disturbance inside a stretch; chosen: a bump or a door of 10 s, and its ringing
BRIDGED_S = 15.0

# of the mean force from second to second, and of the mean rate; wind on a parked aircraft passes:
# a sway of 0.02 m/s at 0.28 Hz (R1) makes steps of 0.05 m/s^2 RMS
FORCE_STEP_M_S2 = 0.15
# 0.6 deg/s: noise of the default MEMS unit (0.3 deg/sqrt(h)) makes steps of 1.2e-4 rad/s
RATE_STEP_RAD_S = 0.01
# above the bias of units as they are: an ArduPilot plane's 911 deg/h are 4.4e-3 rad/s; a vehicle
# that turns on the spot, by 90 deg in 79 s, does not stand still
TURN_RAD_S = 0.02


def first_rest(seconds: LogSeconds, blocks_needed: int = REST_BLOCKS) -> Where | None:
    """Start and end [s] of the first stretch of at least a minute, or of so many blocks of 10 s,
    that looks at rest, at most 10 min of it.

    Judged on 10 s block means against their median over the stretch, as they are or turned back by
    what the gyros saw of people and loading; three bad blocks in a row end it, single ones do not.
    A block that moves by the word of a receiver or the wheels is bad however quiet it is. None: the
    log never rests.
    """
    if not seconds.end_s.size:
        return None
    blocks: Blocks = seconds.blocks()
    if blocks.seconds.size < blocks_needed:
        return None
    f = blocks.dv_m_s / blocks.seconds[:, None]
    omega = blocks.dtheta_rad / blocks.seconds[:, None]
    off = omega - np.median(omega, axis=0)
    turned = np.cumsum(off * blocks.seconds[:, None], axis=0) - 0.5 * off * blocks.seconds[:, None]
    slow = (np.abs(off) <= REST_TILT_RATE_RAD_S).all(axis=1)
    up = np.median(f, axis=0)
    # what turns about down is no tilt, however slowly: it stands on another heading then
    slow &= _near((omega @ up / np.linalg.norm(up))[:, None], slice(None), REST_RATE_RAD_S)
    for i in range(len(f) - blocks_needed + 1):
        reference = slice(i, i + blocks_needed)
        good = _near(f, reference, REST_FORCE_M_S2) & _near(omega, reference, REST_RATE_RAD_S)
        tilt = turned - turned[i]
        tilted = slow & (np.abs(tilt) <= REST_TILT_RAD).all(axis=1)
        level = f + np.cross(tilt, f)
        off_level = np.abs(level - np.median(level[reference], axis=0))
        good |= tilted & (off_level <= REST_FORCE_M_S2).all(axis=1)
        good &= ~blocks.moves
        if not good[reference].all():
            continue
        last = i + blocks_needed - 1
        while (
            good[last + 1 : last + 4].any()
            and blocks.end_s[last + 1] - blocks.end_s[i] < LONGEST_COARSE_S
        ):
            last += 1
        while not good[last]:
            last -= 1
        return float(blocks.begin_s[i]), float(blocks.end_s[last])
    return None


def _near(values: NDArray, reference: slice, limit: float) -> NDArray:
    """Rows within `limit`, or within 6 robust sigmas (up to NOISIEST limits), of the median of the
    reference rows.
    """
    centre = np.median(values[reference], axis=0)
    noise = robust_sigmas(np.diff(values, axis=0)) / np.sqrt(2.0)
    allowed = np.clip(6.0 * noise, limit, NOISIEST * limit)
    return np.asarray((np.abs(values - centre) <= allowed).all(axis=1))


def quiet_stretches(seconds: LogSeconds) -> tuple[Where, ...]:
    """Start and end [s] of every quiet stretch, however short, disturbances of up to BRIDGED_S
    bridged.
    """
    if seconds.end_s.size < QUIET_S:
        return ()
    quiet = _quiet(seconds.mean)
    found: list[Where] = []
    for a, b in runs_of_true(quiet):
        start, end = float(seconds.start_s[a]), float(seconds.end_s[b - 1])
        if found and start - found[-1][1] <= BRIDGED_S:
            found[-1] = (found[-1][0], end)
        else:
            found.append((start, end))
    return tuple(found)


def _quiet(mean: NDArray) -> NDArray:
    """Seconds (m,) whose surroundings scatter like the quietest ones of the log."""
    step = np.diff(mean, axis=0, prepend=mean[:1]) / np.sqrt(2.0)
    kernel = np.ones(WINDOW) / WINDOW
    rms = np.sqrt(np.stack([np.convolve(s, kernel, "same") for s in (step**2).T], axis=1))
    share = min(max(QUIET_S / len(mean), 0.02), 1.0)
    level = np.quantile(rms, share, axis=0) / QUIETEST
    for _ in range(3):
        quiet = (rms <= LOUD * level + 1e-12).all(axis=1)
        level = np.median(rms[quiet], axis=0) if quiet.any() else level
    calm = np.all(rms <= np.minimum(LOUD * level + 1e-12, CAPS), axis=1)
    gravity = np.abs(np.linalg.norm(mean[:, :3], axis=1) - GRAVITY_M_S2) < GRAVITY_LIMIT_M_S2
    return np.asarray(calm & gravity & (np.linalg.norm(mean[:, 3:], axis=1) < SPIN_RAD_S))


def steady_seconds(seconds: LogSeconds) -> NDArray:
    """Whether force and rate are steady in each second (m,), and the vehicle does not turn."""
    mean = seconds.mean
    step = np.abs(np.diff(mean, axis=0, prepend=mean[:1]))
    quiet = (step[:, :3] < FORCE_STEP_M_S2).all(axis=1)
    quiet &= (step[:, 3:] < RATE_STEP_RAD_S).all(axis=1)
    return np.asarray(quiet & (np.linalg.norm(mean[:, 3:], axis=1) < TURN_RAD_S))


def between_turns(seconds: LogSeconds, *, turn_rad: float, rate_rad_s: float) -> tuple[Where, ...]:
    """Start and end [s] of the stretches, however short, between turns by more than `turn_rad` that
    are faster than `rate_rad_s`.
    """
    rate = seconds.mean[:, 3:]
    fast = np.linalg.norm(rate - np.median(rate, axis=0), axis=1) > rate_rad_s
    near = np.convolve(fast, np.ones(2 * TURN_PARTS_S + 1), mode="same") > 0
    edges = [float(seconds.start_s[0])]
    for a, b in runs_of_true(near):
        if np.linalg.norm(seconds.sums[a:b, 3:].sum(axis=0)) > turn_rad:
            edges += [float(seconds.start_s[a]), float(seconds.end_s[b - 1])]
    edges.append(float(seconds.end_s[-1]))
    return tuple((a, b) for a, b in zip(edges[::2], edges[1::2]) if b > a)
