"""Truth from samples: standing stretches and moving ones given at even steps, joined into one
smooth run.

For the motion of a run that was estimated from its own sensors. As in `truth`, a quintic spline of
Earth-fixed velocity and of roll, pitch, heading IS the truth; at rest everything is constant. On
wheels the IMU's velocity follows from speed, heading and lever arm (no side slip); in the air it is
taken from the samples.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly, make_interp_spline

from ins.earth import ecef_from_geodetic
from ins.records import InputError, Site
from trajectories.simulator.motions import SimulatedMotion
from trajectories.simulator.truth import Truth, TruthSpan, imu_velocity_n, moving_span, spline_ends

# of a moving stretch: a quintic has 6 coefficients, and 2 rows are its ends at rest
FEWEST_SAMPLES = 8


@dataclass(frozen=True, kw_only=True)
class SampledStand:
    """A stretch at rest; roll, pitch, heading (3,) [rad]."""

    start_s: float
    end_s: float
    euler_rad: NDArray


@dataclass(frozen=True, kw_only=True)
class SampledMove:
    """A moving stretch at m even steps, its ends included.

    euler_rad (m, 3): roll, pitch, heading, not wrapped; speed_m_s (m,): of the wheel reference
    point, level, along the heading; v_n_m_s (m, 3): velocity of the IMU, used as far as it is
    airborne (m,): 0 on wheels to 1 in the air.
    """

    time_s: NDArray
    euler_rad: NDArray
    speed_m_s: NDArray
    v_n_m_s: NDArray
    airborne: NDArray

    @property
    def start_s(self) -> float:
        return float(self.time_s[0])

    @property
    def end_s(self) -> float:
        return float(self.time_s[-1])


Sampled = SampledStand | SampledMove


def truth_from_samples(
    site: Site,
    stretches: Sequence[Sampled],
    *,
    wheel_reference_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Truth:
    """The truth that starts at a site at time 0, at rest, and goes through the stretches in order.

    Where a moving stretch meets a standing one, its speed, rates and accelerations are zero and its
    attitude is that of the standing one, whatever the samples say. Headings run on from stretch to
    stretch, not wrapped. Raises InputError where the stretches leave a hole, do not start standing
    at 0, or a moving one is too short.
    """
    _check(stretches)
    joined = [_joined(stretches, k) for k in range(len(stretches))]
    motion = _motion(joined)
    r_e = ecef_from_geodetic(site.lat_rad, site.lon_rad, site.height_m)
    found: list[TruthSpan] = []
    for k, stretch in enumerate(joined):
        if isinstance(stretch, SampledStand):
            found.append(
                TruthSpan(stretch.start_s, r_e, np.asarray(stretch.euler_rad, dtype=float))
            )
            continue
        moving = _moving(
            stretch,
            motion,
            r_e,
            np.asarray(wheel_reference_m, dtype=float),
            stops=k + 1 < len(joined),
        )
        found.append(moving)
        r_e = moving.at(np.array([stretch.end_s]))[0][0]
    return Truth(site, motion, wheel_reference_m, tuple(found))


def _check(stretches: Sequence[Sampled]) -> None:
    if not stretches or not isinstance(stretches[0], SampledStand) or stretches[0].start_s != 0.0:
        raise InputError("sampled truth: needed a standing stretch at 0 s first")
    for a, b in pairwise(stretches):
        if a.end_s != b.start_s or isinstance(a, SampledStand) == isinstance(b, SampledStand):
            raise InputError(
                f"sampled truth: {a.end_s:g} s to {b.start_s:g} s: needed standing and moving in"
                " turn, without holes"
            )
    for stretch in stretches:
        if isinstance(stretch, SampledMove) and stretch.time_s.size < FEWEST_SAMPLES:
            raise InputError(
                f"sampled truth: {stretch.time_s.size} samples of a moving stretch, needed"
                f" {FEWEST_SAMPLES}"
            )


def _joined(stretches: Sequence[Sampled], k: int) -> Sampled:
    """The stretch, its ends at rest with the attitude of the standing ones beside it."""
    stretch = stretches[k]
    if isinstance(stretch, SampledStand):
        return stretch
    euler, speed, v_n = stretch.euler_rad.copy(), stretch.speed_m_s.copy(), stretch.v_n_m_s.copy()
    for row, beside in (
        (0, stretches[k - 1]),
        (-1, stretches[k + 1] if k + 1 < len(stretches) else None),
    ):
        if isinstance(beside, SampledStand):
            euler[row], speed[row], v_n[row] = beside.euler_rad, 0.0, 0.0
    return replace(stretch, euler_rad=euler, speed_m_s=speed, v_n_m_s=v_n)


def _moving(
    stretch: SampledMove, motion: SimulatedMotion, r_e: NDArray, lever_p_b: NDArray, *, stops: bool
) -> TruthSpan:
    t = stretch.time_s
    euler = make_interp_spline(t, stretch.euler_rad, k=5, bc_type=spline_ends(3, stops))
    air = stretch.airborne[:, None]
    v_n = (1.0 - air) * imu_velocity_n(motion, euler, t, lever_p_b) + air * stretch.v_n_m_s
    return moving_span(t, r_e, euler, v_n, stops=stops)


def _motion(stretches: Sequence[Sampled]) -> SimulatedMotion:
    """The profiles that sensors beside the inertial ones read, relative to the first heading;
    phases are not named.
    """
    first = float(stretches[0].euler_rad[2])  # a standing one
    heading = _profile(stretches, lambda s: s.euler_rad[..., 2] - first, _clamped)
    speed = _profile(
        stretches, lambda s: s.speed_m_s if isinstance(s, SampledMove) else 0.0, _clamped
    )
    climb = _profile(
        stretches,
        lambda s: -s.airborne * s.v_n_m_s[:, 2] if isinstance(s, SampledMove) else 0.0,
        _clamped,
    )
    airborne = _profile(
        stretches, lambda s: s.airborne if isinstance(s, SampledMove) else 0.0, PchipInterpolator
    )
    rest = tuple((s.start_s, s.end_s) for s in stretches if isinstance(s, SampledStand))
    return SimulatedMotion(
        end_s=stretches[-1].end_s,
        speed_m_s=speed,
        course_rate_rad_s=heading.derivative(),
        course_rad=heading,
        climb_rate_m_s=climb,
        airborne=airborne,
        rest=rest,
        phases=(),
    )


def _clamped(t: NDArray, values: NDArray) -> PPoly:
    return CubicSpline(t, values, bc_type="clamped")


def _profile(
    stretches: Sequence[Sampled],
    value: Callable[[Sampled], Any],
    curve: Callable[[NDArray, NDArray], PPoly],
) -> PPoly:
    """Constant while standing; while moving, the curve of piecewise cubics through the samples."""
    breaks, pieces = [stretches[0].start_s], []
    for stretch in stretches:
        if isinstance(stretch, SampledStand):
            pieces.append(np.array([[0.0], [0.0], [0.0], [float(value(stretch))]]))
            breaks.append(stretch.end_s)
        else:
            pieces.append(curve(stretch.time_s, value(stretch)).c)
            breaks.extend(stretch.time_s[1:])
    return PPoly(np.hstack(pieces), np.array(breaks))
