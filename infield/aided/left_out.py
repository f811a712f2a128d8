"""Stretches without fixes: those left out on purpose, with how far off the solution is from them
(what a user gets where the receiver is without sky), and what is known of the motion meanwhile.

A vehicle goes about as fast without fixes as it went with them. Its velocity is a process about
zero whose size and time constant the log's own fixes show; where it has none, that is a measurement
of no velocity once a second, with the variance of white noise of the same effect (2 tau sigma^2 / 1
s). It says next to nothing of a vehicle that cruises (tau is long), or to sensors that drift by
less, and bounds a solution that would run away at several times the speed that the log has ever
shown.

Decision: docs/decisions/0063-leaps.md.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from alignment.motion.inertial import Where
from ins.earth import dcm_en, ecef_from_geodetic
from ins.filters.aided_records import AidedHistory, Fixes
from ins.filters.states import AIDED_POS
from ins.records import InputError

# without a velocity, from which on the motion is what it usually is; chosen: of 1 fix a second 2
# may be lost
WITHOUT_S = 3.0
USUAL_EVERY_S = 1.0  # chosen: as wheels are asked; times of 5 s and longer need no more
# chosen: under way, for a vehicle that stood says nothing; 20 s are 4 of SHORTEST_USUAL_S. With 10
# a copter's 3rd log (docs/real_logs.md) is off by 2.3 sigmas instead of 0.2
FEWEST_SECONDS = 20
MANY_SECONDS = 60.0  # chosen: speeds are taken larger by it over those seen, as few show little
UNDER_WAY_M_S = 0.5  # 5 sigmas of a receiver of 0.1 m/s
# of level speeds: that of one component, so that straight stretches at full speed are within it
USUAL_SHARE = 0.95
# of a log: a velocity that lasts longer has not been seen to change often enough
LONGEST_OF_LOG = 0.125
# of the correlation, below which a velocity has forgotten itself: the scatter of one over 400
# independent seconds is 1 / sqrt(400)
UNCORRELATED = 0.05
SHORTEST_USUAL_S = 5.0  # chosen: one that circles or hovers may fly a straight leg without fixes
LEAST_DOWN_M_S = 1.0  # chosen: a vehicle that kept its height may climb


@dataclass(frozen=True, kw_only=True)
class UsualMotion:
    """Sigmas of a component of the velocity, level and down [m/s], and how long it lasts [s]."""

    level_m_s: float
    down_m_s: float
    lasts_s: float


@dataclass(frozen=True, kw_only=True)
class OutageScore:
    """A stretch whose fixes were left out: level and vertical error of the solution there [m], RMS
    and at the last fix, sigma there, and RMS error over sigma of the three components, the fixes'
    own sigma in it.
    """

    start_s: float
    end_s: float
    fixes: int
    rms_level_m: float
    rms_down_m: float
    end_level_m: float
    sigma_end_level_m: float
    error_over_sigma: float


def usual_motion(fixes: Fixes) -> UsualMotion | None:
    """How the vehicle goes where it has fixes; None where they do not show it."""
    rows = np.isfinite(fixes.v_n_m_s).all(axis=1)
    t, v = fixes.time_s[rows], fixes.v_n_m_s[rows]
    if t.size < FEWEST_SECONDS:
        return None
    second = np.arange(t[0], t[-1], USUAL_EVERY_S)
    near = np.clip(np.searchsorted(t, second), 1, t.size - 1)
    held = t[near] - t[near - 1] < WITHOUT_S
    each = np.stack([np.interp(second, t, v[:, k]) for k in range(3)], axis=1)
    speed = np.linalg.norm(each[:, :2], axis=1)
    goes = held & (speed > UNDER_WAY_M_S)
    if goes.sum() < FEWEST_SECONDS:
        return None
    lasts_s = _lasts_s(each[:, :2], held, goes)
    if lasts_s is None:
        return None
    unsure = 1.0 + MANY_SECONDS / float(goes.sum())
    down = float(np.quantile(np.abs(each[goes, 2]), USUAL_SHARE))
    return UsualMotion(
        level_m_s=unsure * float(np.quantile(speed[goes], USUAL_SHARE)),
        down_m_s=unsure * max(down, LEAST_DOWN_M_S),
        lasts_s=lasts_s,
    )


def _lasts_s(level: NDArray, held: NDArray, goes: NDArray) -> float | None:
    """How long velocities (n, 2) at USUAL_EVERY_S last once it goes: the integral of their
    correlation, the time constant of a first-order process; None where they do not forget
    themselves.
    """
    size = float(np.mean(np.sum(level[goes] ** 2, axis=1)))
    lasts = 0.5
    for lag in range(1, int(LONGEST_OF_LOG * len(level))):
        pairs = goes[:-lag] & held[lag:]
        if not pairs.any():
            return None
        alike = float(np.mean(np.sum(level[lag:][pairs] * level[:-lag][pairs], axis=1))) / size
        if alike < UNCORRELATED:
            return max(lasts * USUAL_EVERY_S, SHORTEST_USUAL_S)
        lasts += alike
    return None


def with_usual_motion(
    fixes: Fixes, usual: UsualMotion | None, end_s: float
) -> tuple[Fixes, NDArray]:
    """The fixes up to a time with those of the usual motion among them where velocities are
    missing; which rows (k,) are the receiver's.
    """
    own = np.ones(fixes.time_s.size, dtype=bool)
    if usual is None:
        return fixes, own
    seen = fixes.time_s[np.isfinite(fixes.v_n_m_s).all(axis=1)]
    ends = np.append(seen, max(end_s, seen[-1]))
    times = [
        np.arange(a + WITHOUT_S, b, USUAL_EVERY_S)
        for a, b in pairwise(ends)
        if b - a > WITHOUT_S + USUAL_EVERY_S
    ]
    if not times:
        return fixes, own
    more = np.concatenate(times) + 0.5 * USUAL_EVERY_S
    order = np.argsort(np.concatenate([fixes.time_s, more]), kind="stable")
    none = np.full((more.size, 3), np.nan)
    white = np.sqrt(2.0 * usual.lasts_s / USUAL_EVERY_S)
    sigma = white * np.array([usual.level_m_s, usual.level_m_s, usual.down_m_s])
    return Fixes(
        time_s=np.concatenate([fixes.time_s, more])[order],
        r_e_m=np.vstack([fixes.r_e_m, none])[order],
        v_n_m_s=np.vstack([fixes.v_n_m_s, np.zeros((more.size, 3))])[order],
        sigma_position_m=np.vstack([fixes.sigma_position_m, np.ones((more.size, 3))])[order],
        sigma_velocity_m_s=np.vstack([fixes.sigma_velocity_m_s, np.tile(sigma, (more.size, 1))])[
            order
        ],
        other_type=np.concatenate([fixes.other_type, np.zeros(more.size, dtype=bool)])[order],
    ), np.concatenate([own, np.zeros(more.size, dtype=bool)])[order]


def of_receiver(history: AidedHistory, own: NDArray) -> AidedHistory:
    """The history with what became of the receiver's own fixes (k,) alone."""
    if own.all():
        return history
    return replace(
        history,
        fix_time_s=history.fix_time_s[own],
        residual=history.residual[own],
        sigma=history.sigma[own],
        nis=history.nis[own],
        used=history.used[own],
        loglik=history.loglik[own],
    )


def check_left_out(spans: tuple[Where, ...], fixes: Fixes, end_s: float) -> None:
    """InputError where a stretch is not in the log, or has no fixes to score."""
    for start_s, stop_s in spans:
        if not start_s < stop_s <= end_s:
            raise InputError(
                f"outage {start_s:g}:{stop_s - start_s:g}: ends at {stop_s:g} s, needed a stretch"
                f" within the log, which ends at {end_s:.6g} s"
            )
        if not _inside(fixes, (start_s, stop_s)).any():
            raise InputError(
                f"outage {start_s:g}:{stop_s - start_s:g}: no satellite fix in it, needed one at"
                " least to score"
            )


def without(fixes: Fixes, spans: tuple[Where, ...]) -> Fixes:
    """The fixes less those of these stretches."""
    if not spans:
        return fixes
    gone = np.any([_inside(fixes, span) for span in spans], axis=0)
    hole = np.where(gone[:, None], np.nan, 0.0)
    return replace(fixes, r_e_m=fixes.r_e_m + hole, v_n_m_s=fixes.v_n_m_s + hole)


def scored(
    history: AidedHistory, fixes: Fixes, spans: tuple[Where, ...]
) -> tuple[OutageScore, ...]:
    """The solution against the fixes that it was not given; stretches before its start have no
    score.
    """
    antenna = history.antenna
    times_s = fixes.time_s - antenna.delay_s
    known = (times_s >= history.time_s[0]) & (times_s <= history.time_s[-1])
    found = []
    for span in spans:
        rows = np.flatnonzero(_inside(fixes, span) & known & np.isfinite(fixes.r_e_m[:, 0]))
        if rows.size:
            found.append(_score(history, fixes, rows, times_s[rows], span))
    return tuple(found)


def _inside(fixes: Fixes, span: Where) -> NDArray:
    return (fixes.time_s >= span[0]) & (fixes.time_s <= span[1])


def _score(
    history: AidedHistory, fixes: Fixes, rows: NDArray, times_s: NDArray, span: Where
) -> OutageScore:
    lever = history.C_nb @ history.antenna.lever_arm_m
    C_en = dcm_en(history.lat_rad, history.lon_rad)
    r_e = ecef_from_geodetic(history.lat_rad, history.lon_rad, history.height_m)
    v_e = np.einsum("kij,kj->ki", C_en, history.v_n_m_s)
    at = CubicHermiteSpline(history.time_s, r_e, v_e)(times_s)
    arm = np.stack([np.interp(times_s, history.time_s, axis) for axis in lever.T], axis=1)
    variance = np.stack(
        [np.interp(times_s, history.time_s, v) for v in history.variance[:, AIDED_POS].T], axis=1
    )
    near = C_en[np.clip(np.searchsorted(history.time_s, times_s), 0, len(C_en) - 1)]
    off = np.einsum("kji,kj->ki", near, at - fixes.r_e_m[rows]) + arm
    level = np.linalg.norm(off[:, :2], axis=1)
    over = off**2 / (variance + fixes.sigma_position_m[rows] ** 2)
    return OutageScore(
        start_s=span[0],
        end_s=span[1],
        fixes=int(rows.size),
        rms_level_m=float(np.sqrt(np.mean(level**2))),
        rms_down_m=float(np.sqrt(np.mean(off[:, 2] ** 2))),
        end_level_m=float(level[-1]),
        sigma_end_level_m=float(np.sqrt(variance[-1, :2].sum())),
        error_over_sigma=float(np.sqrt(np.mean(over))),
    )
